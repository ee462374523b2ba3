//! A whole build: stages in a row, with their statistics.

use crate::graph::NavGraph;
use crate::probe::{InProcess, ProbeContext, ProbeExecutor, ProbeTask};
use crate::{candidates, vertices};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;
use surefoot_world::navigable::NoGround;

/// Changes whenever equal settings would build another graph.
pub const BUILDER_VERSION: u32 = 2;

/// How vertices are placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// The paper's unconstrained random placement.
    Random,
    /// The paper's distance-constrained random placement.
    Spaced,
}

/// Everything that decides a graph besides map, character and policy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BuildSettings {
    /// How vertices are placed.
    pub placement: Placement,
    /// How many, at least 2.
    pub vertices: usize,
    /// Nearest vertices that each is tried against, 1 to 64.
    pub neighbours: usize,
    /// Tries per candidate edge, 1 to 32.
    pub repeats: u32,
    /// Share of tries that must succeed, above 0, at most 1.
    pub threshold: f64,
    /// Seed of placement and probes.
    pub seed: u64,
}

impl Default for BuildSettings {
    fn default() -> Self {
        Self { placement: Placement::Spaced, vertices: 300, neighbours: 12, repeats: 2, threshold: 0.5, seed: 0 }
    }
}

/// Most vertices of any graph.
pub const MAX_VERTICES: usize = 4096;

/// Why a graph cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// A setting is out of range.
    #[error("settings.{field} is {value}, allowed are {min} to {max}")]
    Setting {
        /// Which.
        field: &'static str,
        /// What was asked for.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// The map offers nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// The build was cancelled.
    #[error("the build was cancelled")]
    Cancelled,
}

impl BuildSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// Names the first setting out of range.
    pub fn validate(&self) -> Result<(), BuildError> {
        let checks = [
            ("vertices", self.vertices as f64, 2.0, MAX_VERTICES as f64),
            ("neighbours", self.neighbours as f64, 1.0, 64.0),
            ("repeats", f64::from(self.repeats), 1.0, 32.0),
            ("threshold", self.threshold, 1.0e-6, 1.0),
        ];
        for (field, value, min, max) in checks {
            if !(min..=max).contains(&value) {
                return Err(BuildError::Setting { field, value, min, max });
            }
        }
        Ok(())
    }
}

/// Identity of a graph: hash of all that decides it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GraphId(pub [u8; 32]);

impl GraphId {
    /// The id of the graph that `settings` build in `context`.
    pub fn of(context: &ProbeContext, settings: &BuildSettings) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&BUILDER_VERSION.to_le_bytes());
        hasher.update(&context.map.hash().0);
        hasher.update(context.policy.weights_hash().as_bytes());
        let data = postcard::to_stdvec(&(&context.profile, settings)).expect("plain data");
        hasher.update(&data);
        Self(*hasher.finalize().as_bytes())
    }

    /// Reads 64 hexadecimal digits.
    pub fn parse(text: &str) -> Option<Self> {
        blake3::Hash::from_hex(text).ok().map(|hash| Self(*hash.as_bytes()))
    }
}

impl fmt::Display for GraphId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for GraphId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GraphId({self})")
    }
}

/// A finished build.
#[derive(Debug, Clone)]
pub struct Built {
    /// The graph.
    pub graph: NavGraph,
    /// Episodes run.
    pub probes: u64,
    /// Duration, s.
    pub seconds: f64,
}

/// Where a build stands; shared with whoever watches it.
#[derive(Debug, Default)]
pub struct Progress {
    /// Probes finished.
    pub done: AtomicU64,
    /// Probes in all; 0 until they are known.
    pub total: AtomicU64,
    /// Set to stop.
    pub cancel: AtomicBool,
}

/// Builds a graph on `thread_count` threads.
///
/// # Errors
/// If a setting is out of range, the map has no ground, or `progress.cancel` was set.
pub fn build(
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Built, BuildError> {
    settings.validate()?;
    let started = Instant::now();
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let positions = match settings.placement {
        Placement::Random => vertices::random(&context.map, &context.profile, settings.vertices, &mut rng)?,
        Placement::Spaced => vertices::spaced(&context.map, &context.profile, settings.vertices, &mut rng)?,
    };
    let candidates = candidates::nearest(&positions, settings.neighbours);
    let probes = candidates.len() as u64 * u64::from(settings.repeats);
    progress.total.store(probes, Ordering::Relaxed);
    let executor = InProcess { context: context.clone(), thread_count };
    let task =
        ProbeTask { vertices: &positions, candidates: &candidates, repeats: settings.repeats, seed: settings.seed };
    let evidence = executor.probe(&task, &progress.done, &progress.cancel);
    if progress.cancel.load(Ordering::Relaxed) {
        return Err(BuildError::Cancelled);
    }
    let graph = NavGraph::prove(positions, &candidates, &evidence, settings.threshold);
    Ok(Built { graph, probes, seconds: started.elapsed().as_secs_f64() })
}
