//! What a follower does with a new plan before it is rehearsed. Where legs that no proof covers cannot be walked, it
//! asks for a plan without them, and keeps the better one. Then it looks for shortcuts.

use super::{Follower, shortcuts::Shortcuts};
use surefoot_planner::{LegKey, Plan};
use surefoot_world::{Ability, Vec3};

/// Most further plans that a review asks for.
const MAX_ROUNDS: u32 = 3;
/// Time for which an NPC walks rather than leaps on a leg that no proof covers, s.
const PER_LEAP_S: f32 = 3.0;

/// The ground between two places, as far as it matters to a body that walks there straight.
pub trait Ground {
    /// Whether a body could walk straight from one place to another, m.
    fn is_walk(&self, from: Vec3, to: Vec3) -> bool;
    /// Whether it could do so with room on both sides, and may leave the legs of its plan for that.
    fn is_lane(&self, from: Vec3, to: Vec3) -> bool;
}

/// What follows a review.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reviewed {
    /// The plan stays, and with it the waypoint.
    Keep,
    /// The NPC heads for this waypoint, m.
    HeadFor(Vec3),
    /// The driver makes another plan, for another review.
    Plan,
}

/// The review of a plan.
#[derive(Debug, Clone, Default)]
pub(super) struct Review {
    is_done: bool,
    rounds: u32,
    /// Legs that cannot be walked.
    pub leaps: Vec<LegKey>,
    /// The best plan so far, and its time with what its leaps cost, s.
    best: Option<(Plan, f32)>,
}

impl Review {
    /// Whether it waits for another plan.
    pub fn is_under_way(&self) -> bool {
        self.rounds > 0 && !self.is_done
    }

    /// Keeps the better of a plan and the best one so far.
    fn compare(&mut self, plan: Plan, leaps: usize) {
        let cost = plan.seconds().0 + leaps as f32 * PER_LEAP_S;
        let is_path = plan.no_path.is_none();
        if self.best.as_ref().is_none_or(|(_, best)| is_path && cost < *best) {
            self.best = Some((plan, cost));
        }
    }
}

impl Follower {
    /// Reviews a new plan of an NPC with the feet at `feet`, m, before it sets out.
    pub fn review(&mut self, feet: Vec3, ground: &impl Ground) -> Reviewed {
        let is_open = !self.review.is_done && self.config.composes && self.leg == 0;
        let plan = self.plan.as_ref().filter(|plan| is_open && plan.needs.is_empty());
        let Some(plan) = plan.cloned() else { return Reviewed::Keep };
        let planned = plan.waypoints[0];
        let leaps = leaps(&plan, feet, ground);
        let is_settled = leaps.is_empty() || plan.no_path.is_some() || self.review.rounds >= MAX_ROUNDS;
        self.review.leaps.extend_from_slice(&leaps);
        self.review.compare(plan, leaps.len());
        if !is_settled {
            self.review.rounds += 1;
            return Reviewed::Plan;
        }
        let (mut best, _) = self.review.best.take().expect("a plan was compared");
        for leg in &mut best.legs {
            if self.review.leaps.contains(&leg.key) {
                leg.ability = Ability::Jump;
            }
        }
        self.review = Review { is_done: true, ..Review::default() };
        self.feet = feet;
        self.shortcuts = Shortcuts::find(&best, feet, |from, to| ground.is_lane(from, to));
        let waypoint = best.waypoints[self.shortcuts.end(0)];
        self.plan = Some(best);
        self.start_leg(0);
        if waypoint == planned { Reviewed::Keep } else { Reviewed::HeadFor(waypoint) }
    }
}

/// The legs of a plan from `feet`, m, that no proof covers and that cannot be walked.
fn leaps(plan: &Plan, feet: Vec3, ground: &impl Ground) -> Vec<LegKey> {
    let starts = std::iter::once(&feet).chain(&plan.waypoints);
    let legs = plan.legs.iter().zip(starts.zip(&plan.waypoints));
    let unproved = legs.filter(|(leg, _)| leg.key.edge().is_none() && leg.ability == Ability::Walk);
    unproved.filter(|(_, (start, end))| !ground.is_walk(**start, **end)).map(|(leg, _)| leg.key).collect()
}
