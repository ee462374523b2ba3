//! Reviews of new plans: where legs that no proof covers cannot be walked, a follower asks for a plan without them, and
//! keeps the better one.

use surefoot_planner::{LegKey, Plan};
use surefoot_world::{Ability, Vec3};

/// Most further plans that a review asks for.
pub(super) const MAX_ROUNDS: u32 = 3;
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
    pub is_done: bool,
    pub rounds: u32,
    /// Legs that cannot be walked.
    pub leaps: Vec<LegKey>,
    /// The best plan so far, and its time with what its leaps cost, s.
    pub best: Option<(Plan, f32)>,
}

impl Review {
    /// Whether it waits for another plan.
    pub fn is_under_way(&self) -> bool {
        self.rounds > 0 && !self.is_done
    }

    /// Whether the best plan so far jumps.
    pub fn jumps(&self) -> bool {
        let mut legs = self.best.iter().flat_map(|(plan, _)| &plan.legs);
        legs.any(|leg| matches!(leg.ability, Ability::Jump | Ability::DoubleJump))
    }

    /// Keeps the better of a plan and the best one so far, for an NPC that may avoid jumps.
    pub fn compare(&mut self, plan: Plan, leaps: usize, avoids_jumps: bool) {
        let per_leap = if avoids_jumps { PER_AVOIDED_LEAP_S } else { PER_LEAP_S };
        let cost = plan.seconds().0 + leaps as f32 * per_leap;
        let is_path = plan.no_path.is_none();
        if self.best.as_ref().is_none_or(|(_, best)| is_path && cost < *best) {
            self.best = Some((plan, cost));
        }
    }
}

/// The legs of a plan from `feet`, m, that no proof covers and that cannot be walked.
pub(super) fn leaps(plan: &Plan, feet: Vec3, ground: &impl Ground) -> Vec<LegKey> {
    let starts = std::iter::once(&feet).chain(&plan.waypoints);
    let legs = plan.legs.iter().zip(starts.zip(&plan.waypoints));
    let unproved = legs.filter(|(leg, _)| leg.key.edge().is_none() && leg.ability == Ability::Walk);
    unproved.filter(|(_, (start, end))| !ground.is_walk(**start, **end)).map(|(leg, _)| leg.key).collect()
}
