//! Reviews of new plans: where legs that no proof covers cannot be walked, a follower asks for a plan without them, and
//! keeps the better one.

use super::ground::Ground;
use surefoot_planner::{LegKey, Plan};
use surefoot_world::{Ability, Vec3};

/// Most further plans that a review asks for, and how many more for each failed leg that no proof covers.
const MAX_ROUNDS: u32 = 3;
const MORE_ROUNDS: u32 = 6;
/// Time for which an NPC walks rather than leaps on a leg that no proof covers, s, and that of an NPC which avoids
/// jumps.
const PER_LEAP_S: f32 = 3.0;
const PER_AVOIDED_LEAP_S: f32 = 300.0;
/// Factor on the first time for each failed leg that no proof covers.
const PER_FAILURE: f32 = 4.0;
/// Most failed legs that count.
const MAX_FAILURES: u32 = 4;

/// How thoroughly a review looks for legs that can be walked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Most further plans.
    pub rounds: u32,
    /// Time for which the NPC walks rather than leaps, s.
    pub per_leap_s: f32,
}

impl Effort {
    /// The effort after so many legs have failed that no proof covers. The prices of such legs do not include walls:
    /// where one fails, the others are as doubtful, and a long walk may be the only way.
    pub fn after(failure_count: usize, avoids_jumps: bool) -> Self {
        let failures = (failure_count as u32).min(MAX_FAILURES);
        let per_leap_s = (0..failures).fold(PER_LEAP_S, |time_s, _| time_s * PER_FAILURE);
        let per_leap_s = if avoids_jumps { PER_AVOIDED_LEAP_S } else { per_leap_s.min(PER_AVOIDED_LEAP_S) };
        Self { rounds: MAX_ROUNDS + MORE_ROUNDS * failures, per_leap_s }
    }
}

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

    /// The better of a plan that takes `more_s` longer than it says, and the best one so far.
    pub fn better_of(&mut self, plan: Plan, more_s: f32) -> Reviewed {
        let cost = plan.seconds().0 + more_s;
        let is_path = plan.no_path.is_none();
        let is_worse = |best: &Reviewed| !is_path || best.cost <= cost;
        self.best.take().filter(is_worse).unwrap_or(Reviewed { plan, cost })
    }
}

/// The legs of a plan from `feet`, m, that no proof covers and that cannot be walked: not straight, and if `may_look`
/// not around what bars them. Then how much longer it takes to walk around the others, s.
pub(super) fn leaps_of(plan: &Plan, feet: Vec3, may_look: bool, ground: &impl Ground) -> (Vec<LegKey>, f32) {
    let (mut leaps, mut longer_s) = (Vec::new(), 0.0);
    let starts = std::iter::once(&feet).chain(&plan.waypoints);
    for (leg, (start, end)) in plan.legs.iter().zip(starts.zip(&plan.waypoints)) {
        if leg.key.edge().is_some() || leg.ability != Ability::WALK || ground.is_walk(*start, *end) {
            continue;
        }
        match may_look.then(|| ground.walk_around(*start, *end)).flatten() {
            Some(way) => longer_s += leg.seconds.0 * (length(*start, &way) / start.distance(*end) - 1.0).max(0.0),
            None => leaps.push(leg.key),
        }
    }
    (leaps, longer_s)
}

/// Length of a way from `start`, m.
fn length(start: Vec3, way: &[Vec3]) -> f32 {
    std::iter::once(&start).chain(way).zip(way).map(|(from, to)| from.distance(*to)).sum()
}
