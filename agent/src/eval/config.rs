//! Configuration and errors of an evaluation.

use std::ops::Range;
use std::path::PathBuf;
use surefoot_planner::{BuildError, BuildSettings};
use surefoot_world::MapSpec;
use surefoot_world::navigable::NoGround;

/// How NPCs approach goals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The policy heads straight for the goal.
    Policy,
    /// The policy follows plans on a graph built with these settings.
    Graph(BuildSettings),
}

impl Method {
    /// Name in reports: `policy`, or the name of the placement.
    pub fn name(&self) -> &'static str {
        match self {
            Method::Policy => "policy",
            Method::Graph(settings) => settings.placement.name(),
        }
    }
}

/// Configuration of an evaluation.
#[derive(Debug, Clone)]
pub struct EvalConfig {
    /// Specs of the maps to evaluate on.
    pub maps: Vec<MapSpec>,
    /// Number of goals per map and seed.
    pub goals: usize,
    /// Seeds of goals, graphs and noise; each runs one whole evaluation.
    pub seeds: Vec<u64>,
    /// How NPCs approach goals.
    pub method: Method,
    /// Straight-line distance from start to goal, m.
    pub distance: Range<f32>,
    /// Share of the policy's exploration noise to add to actions, 0 to 1.
    pub noise_share: f32,
    /// Number of threads.
    pub thread_count: usize,
    /// Folder to save finished units in and to load them from; `None` to run every unit and save none.
    pub keep_in: Option<PathBuf>,
}

/// Why an evaluation cannot run.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A map has no ground to stand on.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// A graph cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// A map has too few pairs of points at the configured distance.
    #[error("map {0} has no goals at that distance")]
    NoGoals(u64),
    /// A finished unit cannot be saved.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}
