//! What a follower does with a new plan before it is rehearsed: it reviews the plan, and looks for shortcuts.

use super::Follower;
use super::clearance::Clearance;
use super::review::{Ground, MAX_ROUNDS, Review, leaps};
use super::shortcuts::Shortcuts;
use surefoot_world::{Ability, Vec3};

impl Follower {
    /// Reviews a new plan of an NPC with the feet at `feet`, m, before it sets out. True if the driver makes another
    /// plan, for another review; otherwise the waypoint may have changed.
    pub fn review(&mut self, feet: Vec3, ground: &impl Ground) -> bool {
        let is_open = !self.review.is_done && self.config.composes && self.leg == 0;
        let plan = self.plan.as_ref().filter(|plan| is_open && plan.needs.is_empty());
        let Some(plan) = plan.cloned() else { return false };
        let leaps = leaps(&plan, feet, ground);
        let is_settled = leaps.is_empty() || plan.no_path.is_some() || self.review.rounds >= MAX_ROUNDS;
        self.review.leaps.extend_from_slice(&leaps);
        self.review.compare(plan, leaps.len(), self.config.gait.avoids_jumps);
        if !is_settled {
            self.review.rounds += 1;
            return true;
        }
        let (mut best, _) = self.review.best.take().expect("a plan was compared");
        for leg in &mut best.legs {
            if self.review.leaps.contains(&leg.key) {
                leg.ability = Ability::Jump;
            }
        }
        self.review = Review { is_done: true, ..Review::default() };
        self.feet = feet;
        let margin = self.config.gait.wall_distance;
        self.clearance = Clearance::make(&mut best, feet, margin, ground);
        self.shortcuts = Shortcuts::find(&best, feet, |from, to| ground.is_lane(from, to, margin));
        self.plan = Some(best);
        self.start_leg(0);
        false
    }

    /// The leg after the next `count` legs, shortcuts counted as one leg each.
    pub fn leg_after(&self, count: usize) -> usize {
        (0..count).fold(self.leg, |leg, _| self.shortcuts.end(leg) + 1)
    }

    /// Removes a shortcut that contains one of the legs up to `leg`; returns whether there was one. An NPC on it goes
    /// on with the leg whose end is nearest to where it was last.
    pub(super) fn remove_shortcut(&mut self, leg: usize) -> bool {
        let Some(range) = (self.leg..=leg).find_map(|leg| self.shortcuts.remove(leg)) else { return false };
        if let Some(plan) = self.plan.as_ref().filter(|_| range.contains(&self.leg)) {
            let distance = |leg: &usize| plan.waypoints[*leg].distance(self.feet);
            let nearest = range.clone().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            self.start_leg(nearest.unwrap_or(*range.start()));
        }
        true
    }
}
