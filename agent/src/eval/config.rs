//! What is evaluated, and why it may not be.

use std::ops::Range;
use std::path::PathBuf;
use surefoot_planner::{BuildError, BuildSettings};
use surefoot_world::MapSpec;
use surefoot_world::navigable::NoGround;

/// How goals are approached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The policy heads straight for the goal.
    Policy,
    /// The policy follows plans on a graph built so.
    Graph(BuildSettings),
}

impl Method {
    /// Name in reports.
    pub fn name(&self) -> &'static str {
        match self {
            Method::Policy => "policy",
            Method::Graph(settings) => settings.placement.name(),
        }
    }
}

/// What to evaluate.
#[derive(Debug, Clone)]
pub struct EvalConfig {
    /// Maps.
    pub maps: Vec<MapSpec>,
    /// Goals per map and seed.
    pub goals: usize,
    /// Seeds of goals, graphs and noise: one whole evaluation each.
    pub seeds: Vec<u64>,
    /// How goals are approached.
    pub method: Method,
    /// Straight-line distance of goals, m.
    pub distance: Range<f32>,
    /// Share of the policy's exploration noise to act with.
    pub noise_share: f32,
    /// Threads to use.
    pub thread_count: usize,
    /// Folder that finished units are kept in and taken from.
    pub keep_in: Option<PathBuf>,
}

/// Why an evaluation cannot run.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A map offers nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// A graph cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// No two points of a map have the wanted distance.
    #[error("map {0} has no goals at that distance")]
    NoGoals(u64),
    /// A finished unit cannot be kept.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}
