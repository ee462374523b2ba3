//! Reviews of new plans before they are rehearsed: where legs that no proof covers cannot be walked, a follower asks
//! for a plan without them, and keeps the better one. Then it looks for shortcuts.

use super::Follower;
use super::clearance::Clearance;
use super::shortcuts::Shortcuts;
use surefoot_planner::{LegKey, Plan};
use surefoot_world::{Ability, Vec3};

/// Most further plans that a review asks for.
const MAX_ROUNDS: u32 = 3;
/// Time for which an NPC walks rather than leaps on a leg that no proof covers, s, and that of an NPC which avoids
/// jumps.
const PER_LEAP_S: f32 = 3.0;
const PER_AVOIDED_LEAP_S: f32 = 300.0;

/// The ground between two places, as far as it matters to a body that walks there straight.
pub trait Ground {
    /// Whether a body could walk straight from one place to another, m.
    fn is_walk(&self, from: Vec3, to: Vec3) -> bool;
    /// Whether it could do so with room on both sides, and with `margin` metres more except near the ends, and may
    /// leave the legs of its plan for that.
    fn is_lane(&self, from: Vec3, to: Vec3, margin: f32) -> bool;
    /// Whether it could do so, and may leave the legs of its plan for that.
    fn is_way(&self, from: Vec3, to: Vec3) -> bool;
    /// The place near `at`, m, where it has `margin` metres of room besides its radius, or as much as there is.
    fn with_room(&self, at: Vec3, margin: f32) -> Vec3;
}

/// The review of a plan.
#[derive(Debug, Clone, Default)]
pub(super) struct Review {
    is_done: bool,
    rounds: u32,
    /// Legs that cannot be walked.
    pub leaps: Vec<LegKey>,
    best: Option<Reviewed>,
}

/// A plan that was reviewed.
#[derive(Debug, Clone)]
struct Reviewed {
    plan: Plan,
    /// Its time with what its leaps cost, s.
    cost: f32,
}

impl Review {
    /// Whether it waits for another plan.
    pub fn is_under_way(&self) -> bool {
        self.rounds > 0 && !self.is_done
    }

    /// Whether the best plan so far jumps.
    pub fn jumps(&self) -> bool {
        let mut legs = self.best.iter().flat_map(|best| &best.plan.legs);
        legs.any(|leg| matches!(leg.ability, Ability::Jump | Ability::DoubleJump))
    }

    /// The better of a plan whose leaps cost `leaps_s` and the best one so far.
    fn better_of(&mut self, plan: Plan, leaps_s: f32) -> Reviewed {
        let cost = plan.seconds().0 + leaps_s;
        let is_path = plan.no_path.is_none();
        let is_worse = |best: &Reviewed| !is_path || best.cost <= cost;
        self.best.take().filter(is_worse).unwrap_or(Reviewed { plan, cost })
    }
}

impl Follower {
    /// Reviews a new plan of an NPC with the feet at `feet`, m, before it sets out. True if the driver makes another
    /// plan, for another review; otherwise the waypoint may have changed.
    pub fn review(&mut self, feet: Vec3, ground: &impl Ground) -> bool {
        let is_open = !self.review.is_done && self.config.composes && self.leg == 0;
        let is_under_way = self.review.is_under_way();
        let plan = self.plan.as_ref().filter(|plan| is_open && (plan.needs.is_empty() || is_under_way));
        let Some(plan) = plan.cloned() else { return false };
        let leaps = leaps_of(&plan, feet, ground);
        let is_settled =
            leaps.is_empty() || plan.no_path.is_some() || !plan.needs.is_empty() || self.review.rounds >= MAX_ROUNDS;
        self.review.leaps.extend_from_slice(&leaps);
        let per_leap = if self.config.gait.avoids_jumps { PER_AVOIDED_LEAP_S } else { PER_LEAP_S };
        let mut best = self.review.better_of(plan, leaps.len() as f32 * per_leap);
        if !is_settled {
            self.review.rounds += 1;
            self.review.best = Some(best);
            return true;
        }
        for leg in &mut best.plan.legs {
            if self.review.leaps.contains(&leg.key) {
                leg.ability = Ability::Jump;
            }
        }
        self.review = Review { is_done: true, ..Review::default() };
        // The goal may have moved since the plan was made.
        self.lead_to_goal(&mut best.plan);
        self.feet = feet;
        if best.plan.needs.is_empty() {
            let margin = self.config.gait.wall_distance;
            self.clearance = Clearance::make(&mut best.plan, feet, margin, ground);
            let is_lane = |from, to| ground.is_lane(from, to, margin);
            self.shortcuts = Shortcuts::find(&best.plan, feet, is_lane);
            if margin == 0.0 {
                self.clearance.tighten(&mut best.plan, feet, &self.shortcuts, is_lane);
            }
        }
        self.plan = Some(best.plan);
        self.start_leg(0);
        false
    }
}

/// The legs of a plan from `feet`, m, that no proof covers and that cannot be walked.
fn leaps_of(plan: &Plan, feet: Vec3, ground: &impl Ground) -> Vec<LegKey> {
    let starts = std::iter::once(&feet).chain(&plan.waypoints);
    let legs = plan.legs.iter().zip(starts.zip(&plan.waypoints));
    let unproved = legs.filter(|(leg, _)| leg.key.edge().is_none() && leg.ability == Ability::Walk);
    unproved.filter(|(_, (start, end))| !ground.is_walk(**start, **end)).map(|(leg, _)| leg.key).collect()
}
