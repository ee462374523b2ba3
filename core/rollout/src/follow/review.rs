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
