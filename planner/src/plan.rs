//! Queries and their answers: plans made of legs.

use crate::evidence::Evidence;
use crate::ids::{EdgeKey, LegKey};
use crate::legs::LegModel;
use surefoot_world::{Ability, Chance, Decisions, Seconds, Vec3};

/// A path query.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    /// Where the path begins, m.
    pub start: Vec3,
    /// Where the path ends, m.
    pub goal: Vec3,
    /// Legs that must not be used.
    pub avoid: Vec<LegKey>,
}

/// One leg between two vertices, or between a vertex and the start or goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// Where it begins and ends.
    pub key: LegKey,
    /// Expected duration, failures included.
    pub seconds: Seconds,
    /// Estimated chance of success.
    pub chance: Chance,
    /// Ability it needs.
    pub ability: Ability,
}

/// Why there is no path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoPath {
    /// No vertex near the start has an edge that leaves it.
    StartOffGraph,
    /// No vertex near the goal has an edge that reaches it.
    GoalOffGraph,
    /// No proved path joins them in either direction.
    DifferentIslands,
    /// The goal leads to the start, but not the other way round.
    OneWay,
}

/// The answer to a query: waypoints to head for one after the other, ending with the goal.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Waypoint `i` is where leg `i` ends, m.
    pub waypoints: Vec<Vec3>,
    /// As many as waypoints.
    pub legs: Vec<Leg>,
    /// Why the plan is only to head for the goal directly; `None` for a real path.
    pub no_path: Option<NoPath>,
    /// Where there is no path: the vertex nearest to the goal that can be reached, m.
    pub nearest: Option<Vec3>,
}

impl Plan {
    /// Expected duration of all legs, failures included.
    pub fn seconds(&self) -> Seconds {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    /// Estimated chance that every leg succeeds.
    pub fn chance(&self) -> Chance {
        self.legs.iter().map(|leg| leg.chance).product()
    }
}

impl Leg {
    /// The leg along a proved edge.
    pub(crate) fn proved(key: EdgeKey, evidence: &Evidence) -> Self {
        Self::lasting(key.into(), evidence.decisions_mean(), evidence.chance(), evidence.ability)
    }

    /// A leg that nobody has proved, as `model` estimates it from its two ends, m.
    pub(crate) fn unproved(model: &LegModel, key: LegKey, [start, end]: [Vec3; 2]) -> Self {
        let estimate = model.estimate(start, end);
        Self::lasting(key, estimate.decisions, estimate.chance, Ability::Walk)
    }

    fn lasting(key: LegKey, decisions: Decisions, chance: Chance, ability: Ability) -> Self {
        Self { key, seconds: Decisions(decisions.0 / chance.get()).seconds(), chance, ability }
    }
}
