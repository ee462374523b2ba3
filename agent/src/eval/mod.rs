//! The paper's evaluation protocol: random goals on whole maps, success by difficulty, failures by their end.
//!
//! An evaluation is a list of [units](unit), one for each map and seed, that can be kept on disk and taken up again; a
//! [report](report) sums them up. [`suite`] runs the rows of the paper's table, [`variants`]
//! many graphs on one split.

pub mod report;
pub mod suite;
pub mod unit;
pub mod variants;

pub use report::{Rate, Report, Success};

use std::ops::Range;
use std::path::PathBuf;
use surefoot_planner::build::{BuildError, BuildSettings};
use surefoot_policy::Policy;
use surefoot_world::navigable::NoGround;
use surefoot_world::{MapSpec, SpecError};
use unit::Unit;

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
    /// A map spec is out of range.
    #[error(transparent)]
    Spec(#[from] SpecError),
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

/// Runs the protocol; `progress` gets the attempts finished and their total.
///
/// # Errors
/// If a map, its goals or a graph cannot be made, or a unit cannot be kept.
pub fn evaluate(policy: &Policy, config: &EvalConfig, progress: impl FnMut(usize, usize)) -> Result<Report, EvalError> {
    Ok(report::summarise(policy, config, &run_units(policy, config, progress)?))
}

/// The same, as the units themselves, map by map and seed by seed.
///
/// # Errors
/// As for [`evaluate`].
pub fn run_units(
    policy: &Policy,
    config: &EvalConfig,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<Unit>, EvalError> {
    let total = config.maps.len() * config.seeds.len() * config.goals;
    let mut units = Vec::with_capacity(config.maps.len() * config.seeds.len());
    for spec in &config.maps {
        // Generated at the first unit that has to be run.
        let mut map = None;
        for &seed in &config.seeds {
            units.push(unit::load_or_run(policy, config, spec, seed, &mut map)?);
            progress(units.len() * config.goals, total);
        }
    }
    Ok(units)
}
