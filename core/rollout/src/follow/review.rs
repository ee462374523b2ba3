//! Reviews of new plans: where legs that no proof covers cannot be walked, a follower asks for a plan without them, and
//! keeps the better one.

use super::ground::Ground;
use surefoot_planner::{LegKey, Plan};
use surefoot_world::{Ability, Vec3};

/// Most further plans that a review asks for.
pub(super) const MAX_ROUNDS: u32 = 3;
/// Time for which an NPC walks rather than leaps on a leg that no proof covers, s, and that of an NPC which avoids
/// jumps.
pub(super) const PER_LEAP_S: f32 = 3.0;
pub(super) const PER_AVOIDED_LEAP_S: f32 = 300.0;

/// The review of a plan.
#[derive(Debug, Clone, Default)]
pub(super) struct Review {
    pub is_done: bool,
    pub rounds: u32,
    /// Legs that cannot be walked.
    pub leaps: Vec<LegKey>,
    pub best: Option<Reviewed>,
}

/// A plan that was reviewed.
#[derive(Debug, Clone)]
pub(super) struct Reviewed {
    pub plan: Plan,
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
        legs.any(|leg| Ability::JUMPS.contains(&leg.ability))
    }

    /// The better of a plan whose leaps cost `leaps_s` and the best one so far.
    pub fn better_of(&mut self, plan: Plan, leaps_s: f32) -> Reviewed {
        let cost = plan.seconds().0 + leaps_s;
        let is_path = plan.no_path.is_none();
        let is_worse = |best: &Reviewed| !is_path || best.cost <= cost;
        self.best.take().filter(is_worse).unwrap_or(Reviewed { plan, cost })
    }
}

/// The legs of a plan from `feet`, m, that no proof covers and that cannot be walked.
pub(super) fn leaps_of(plan: &Plan, feet: Vec3, ground: &impl Ground) -> Vec<LegKey> {
    let starts = std::iter::once(&feet).chain(&plan.waypoints);
    let legs = plan.legs.iter().zip(starts.zip(&plan.waypoints));
    let unproved = legs.filter(|(leg, _)| leg.key.edge().is_none() && leg.ability == Ability::Walk);
    unproved.filter(|(_, (start, end))| !ground.is_walk(**start, **end)).map(|(leg, _)| leg.key).collect()
}
