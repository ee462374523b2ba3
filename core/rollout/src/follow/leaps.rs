//! Leaps over which an NPC is steered: legs that need a jump, with a single gap or ledge on their straight way.
//!
//! Their rehearsals show whether the NPC arrives so. Where it does not, its policy leaps.

use super::ground::Ground;
use surefoot_planner::{LegKey, Plan};
use surefoot_world::{Ability, Vec3};

/// The legs of a plan that are such leaps, with the rims of their gaps, m.
#[derive(Debug, Clone, Default)]
pub(super) struct Leaps(Vec<(LegKey, [Vec3; 2])>);

impl Leaps {
    /// Looks for leaps in a new plan from `feet`, m.
    pub fn find(plan: &Plan, feet: Vec3, ground: &impl Ground) -> Self {
        let starts = std::iter::once(&feet).chain(&plan.waypoints);
        let legs = plan.legs.iter().zip(starts.zip(&plan.waypoints));
        let jumps = legs.filter(|(leg, _)| matches!(leg.ability, Ability::Jump | Ability::DoubleJump));
        let rims = jumps.filter_map(|(leg, (start, end))| Some((leg.key, ground.rims(*start, *end)?)));
        Self(rims.collect())
    }

    /// The rims of the gap on a leg, m, if the NPC is steered there.
    pub fn rims(&self, leg: LegKey) -> Option<[Vec3; 2]> {
        self.0.iter().find(|(key, _)| *key == leg).map(|(_, rims)| *rims)
    }

    /// Forgets a leg, since its end has moved.
    pub fn forget(&mut self, leg: LegKey) {
        self.0.retain(|(key, _)| *key != leg);
    }
}
