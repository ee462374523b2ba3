//! What a follower does with a new plan before it is rehearsed: it reviews the plan, moves waypoints, and looks for
//! shortcuts. Where a rehearsal fails, it takes that back.

use super::clearance::Clearance;
use super::ground::Ground;
use super::moves::SteeredMoves;
use super::review::{Effort, leaps_of};
use super::shortcuts::Shortcuts;
use super::ways::{lead_around, way_of};
use super::{Approach, Follower};
use surefoot_planner::Plan;
use surefoot_world::{Ability, Vec3};

impl Follower {
    /// Reviews a new plan of an NPC with the feet at `feet`, m, before it sets out. True if the driver makes another
    /// plan, for another review; otherwise the waypoint may have changed.
    pub fn review(&mut self, feet: Vec3, ground: &impl Ground) -> bool {
        let is_open = !self.review.is_done && self.config.composes && self.leg == 0;
        let is_under_way = self.review.is_under_way();
        let plan = self.plan.as_ref().filter(|plan| is_open && (plan.needs.is_empty() || is_under_way));
        let Some(plan) = plan.cloned() else { return false };
        let margin = self.config.gait.wall_distance;
        // A way around leads along walls, and waypoints of plans with movers must not change.
        let trusts_ways = margin == 0.0 && !self.distrusts_ways;
        let may_look = |plan: &Plan| trusts_ways && plan.needs.is_empty();
        let (leaps, longer_s) = leaps_of(&plan, feet, may_look(&plan), ground);
        let effort = Effort::after(self.failures.unproved_count(), self.config.gait.avoids_jumps);
        let is_settled =
            leaps.is_empty() || plan.no_path.is_some() || !plan.needs.is_empty() || self.review.rounds >= effort.rounds;
        self.review.leaps.extend_from_slice(&leaps);
        let mut best = self.review.better_of(plan, leaps.len() as f32 * effort.per_leap_s + longer_s);
        if !is_settled {
            self.review.rounds += 1;
            self.review.best = Some(best);
            return true;
        }
        let barred = std::mem::take(&mut self.review).leaps;
        self.review.is_done = true;
        // The goal may have moved since the plan was made.
        self.lead_to_goal(&mut best.plan);
        self.feet = feet;
        let may_look = may_look(&best.plan);
        lead_around(&mut best.plan, feet, &barred, may_look, ground);
        if best.plan.needs.is_empty() {
            self.clearance = Clearance::make(&mut best.plan, feet, margin, ground);
            let is_lane = |from, to| ground.is_lane(from, to, margin);
            self.shortcuts = Shortcuts::find(&best.plan, feet, is_lane);
            if margin == 0.0 {
                self.clearance.tighten(&mut best.plan, feet, &self.shortcuts, is_lane);
            }
            self.steered_moves = SteeredMoves::find(&best.plan, feet, ground);
        }
        self.doubtful = barred.into_iter().filter(|leap| self.steered_moves.on(*leap).is_none()).collect();
        self.plan = Some(best.plan);
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

    /// Removes the corners of the way that contains `leg`, and later changes at its ends. Returns whether there were
    /// any. A leg that no proof covers is a leap then.
    pub(super) fn remove_way(&mut self, leg: usize) -> bool {
        let Some(plan) = &mut self.plan else { return false };
        let legs = way_of(plan, leg);
        let (first, last) = (*legs.start(), *legs.end());
        if first == last {
            return false;
        }
        self.clearance.merge(plan, &legs);
        self.shortcuts.merge(&legs);
        let seconds = plan.legs[first..=last].iter().map(|leg| leg.seconds).sum();
        let leg = &mut plan.legs[last];
        leg.seconds = seconds;
        if leg.key.edge().is_none() {
            leg.ability = Ability::JUMP;
            self.distrusts_ways = true;
        }
        plan.legs.drain(first..last);
        plan.waypoints.drain(first..last);
        let moved = |leg: usize| if leg > last { leg - (last - first) } else { leg.min(first) };
        self.exact_until = moved(self.exact_until);
        self.unsteered_until = moved(self.unsteered_until);
        self.free_until = moved(self.free_until);
        self.start_leg(moved(self.leg));
        true
    }

    /// Moves the waypoints between the current one and the end of `leg` back to where the plan had them; returns
    /// whether any had moved.
    pub(super) fn move_waypoints_back(&mut self, leg: usize) -> bool {
        let Some(plan) = &mut self.plan else { return false };
        let has_moved = self.clearance.undo(plan, self.leg.min(leg)..=self.leg.max(leg));
        if has_moved {
            self.to_waypoint = Approach::NONE;
        }
        has_moved
    }
}
