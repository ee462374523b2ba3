//! Legs on which an NPC is steered by a controller of its own: leaps over a single gap or ledge on their straight way,
//! and crossings.
//!
//! Their rehearsals show whether the NPC arrives so. Where it does not, its policy moves it.

use super::ground::Ground;
use surefoot_planner::{LegKey, Plan};
use surefoot_world::arrival::Rims;
use surefoot_world::crossings::Approach;
use surefoot_world::{Motion, Vec3};

/// How an NPC is steered on a leg that cannot be walked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SteeredMove {
    /// Over a gap between two rims.
    Leap(Rims),
    /// By a move.
    Cross(Approach),
}

/// The legs of a plan on which the NPC is steered so.
#[derive(Debug, Clone, Default)]
pub(super) struct SteeredMoves(Vec<(LegKey, SteeredMove)>);

impl SteeredMoves {
    /// Looks for such legs in a new plan from `feet`, m.
    pub fn find(plan: &Plan, feet: Vec3, ground: &impl Ground) -> Self {
        let starts = std::iter::once(&feet).chain(&plan.waypoints);
        let legs = plan.legs.iter().zip(starts.zip(&plan.waypoints));
        let moves = legs.filter_map(|(leg, (start, end))| {
            let by = match leg.ability.motion() {
                Motion::Jump | Motion::AirJump | Motion::Dash => SteeredMove::Leap(ground.rims(*start, *end)?),
                Motion::Surface | Motion::WallRun | Motion::Own => {
                    SteeredMove::Cross(ground.approach([*start, *end], leg.ability)?)
                }
                _ => return None,
            };
            Some((leg.key, by))
        });
        Self(moves.collect())
    }

    /// How the NPC is steered on a leg, if it is.
    pub fn on(&self, leg: LegKey) -> Option<SteeredMove> {
        self.0.iter().find(|(key, _)| *key == leg).map(|(_, by)| *by)
    }

    /// Forgets a leg, since its end has moved.
    pub fn forget(&mut self, leg: LegKey) {
        self.0.retain(|(key, _)| *key != leg);
    }
}
