//! Units: all goals of one map and seed, each attempted once.

use super::maps::MapName;
use serde::{Deserialize, Serialize};
use surefoot_rollout::{AttemptResult, Motion};

/// Most goals in a batch. Independent of the number of threads, so that results are too.
const GOALS_PER_BATCH: usize = 128;

/// The attempts at all goals of one map and seed, the nearest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Name of the map.
    pub map: MapName,
    /// Seed of goals, graph and noise.
    pub seed: u64,
    /// Straight-line distance of each goal, m, ascending.
    pub distances: Vec<f32>,
    /// Whether each goal can be reached: a survey or a proved edge connects it with the start, or the attempt did.
    pub reachable: Vec<bool>,
    /// Whether a walk leads from each start to its goal, by the survey.
    pub on_foot: Vec<bool>,
    /// Result of the attempt at each goal.
    pub attempts: Vec<AttemptResult>,
    /// How the NPCs moved.
    pub motion: Motion,
    /// Figures of the graph, if one was used.
    pub graph: Option<GraphFigures>,
    /// Share of the ground that belongs to the playable area, 0 to 1, if goals were drawn there only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub playable: Option<f64>,
}

/// Figures of a graph, or means over graphs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GraphFigures {
    /// Number of vertices.
    pub vertices: f64,
    /// Number of proved edges.
    pub edges: f64,
    /// Number of islands.
    pub islands: f64,
    /// Share of ordered vertex pairs with a path.
    pub connected: f64,
    /// Build time, s.
    pub build_s: f64,
    /// Number of probes.
    pub probes: f64,
    /// Number of candidate edges.
    pub candidates: f64,
    /// Wall time of all attempts together, s.
    pub eval_s: f64,
    /// Median duration of a search, us.
    pub search_us_median: f64,
}

/// Goals of a unit that are attempted together. The result of a batch depends only on the unit's
/// key and the batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batch(usize);

impl Batch {
    /// The batches of a unit with `goals` goals.
    pub fn all(goals: usize) -> impl Iterator<Item = Batch> {
        (0..Self::count(goals)).map(Batch)
    }

    /// Indices of the goals. Every batch mixes near and far goals, so that batches take similar times.
    pub fn indices(self, goals: usize) -> impl Iterator<Item = usize> {
        (self.0..goals).step_by(Self::count(goals))
    }

    /// Index of the batch among those of its unit.
    pub(super) fn idx(self) -> usize {
        self.0
    }

    fn count(goals: usize) -> usize {
        goals.div_ceil(GOALS_PER_BATCH)
    }
}
