//! A whole build: stages in a row, with their statistics.

use crate::candidates::{self, Candidate};
use crate::graph::{Evidence, NavGraph};
use crate::placement::{self, Placement, Placing};
use crate::probe::{InProcess, ProbeContext, ProbeExecutor};
use crate::prove::{Probing, Proving};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;
use surefoot_world::Vec3;
use surefoot_world::navigable::NoGround;

/// Changes whenever equal settings would build another graph.
pub const BUILDER_VERSION: u32 = 3;

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
    /// How many probes are spent.
    pub probing: Probing,
    /// Whether vertices and candidates also come from devices and ledges; the paper has none.
    pub special_moves: bool,
}

impl BuildSettings {
    /// One of the paper's builders as the paper has it: every candidate tried every time, nothing from features.
    pub fn of_paper(placement: Placement) -> Self {
        Self { placement, probing: Probing::Exhaustive, special_moves: false, ..Self::default() }
    }
}

impl Default for BuildSettings {
    fn default() -> Self {
        Self {
            placement: Placement::Spaced,
            vertices: 300,
            neighbours: 12,
            repeats: 2,
            threshold: 0.5,
            seed: 0,
            probing: Probing::Frugal,
            special_moves: true,
        }
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
    /// What it took.
    pub stats: BuildStats,
}

/// What a build took, stage by stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BuildStats {
    /// Candidates.
    pub candidates: u64,
    /// Those of them that come from devices and ledges.
    pub special: u64,
    /// Candidates that were never tried.
    pub untried: u64,
    /// Episodes run, those of the placement included.
    pub probes: u64,
    /// Time to place vertices, s.
    pub placing_s: f64,
    /// Time to probe, s.
    pub probing_s: f64,
    /// Time of the whole build, s.
    pub seconds: f64,
}

/// Where a build stands; shared with whoever watches it.
#[derive(Debug, Default)]
pub struct Progress {
    /// Probes finished.
    pub done: AtomicU64,
    /// Probes that are known to be needed; grows while a build finds out more, 0 while vertices are placed.
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
    let executor = InProcess { context: context.clone(), thread_count };
    build_with(&executor, context, settings, thread_count, progress)
}

/// Builds a graph with probes that `executor` runs.
///
/// # Errors
/// As [`build`].
pub fn build_with(
    executor: &dyn ProbeExecutor,
    context: &ProbeContext,
    settings: &BuildSettings,
    thread_count: usize,
    progress: &Progress,
) -> Result<Built, BuildError> {
    settings.validate()?;
    let started = Instant::now();
    let placing = Placing { context, settings, executor, progress: &progress.done, cancel: &progress.cancel };
    let draft = placement::place(&placing)?;
    progress.done.store(0, Ordering::Relaxed);
    let placing_s = started.elapsed().as_secs_f64();
    let vertices = draft.vertices;
    let tests_edges = settings.placement != Placement::Trajectories;
    let (candidates, special) = match draft.candidates {
        Some(candidates) => (candidates, 0),
        None => find_candidates(context, settings, &vertices),
    };
    let proving = Proving {
        map: &context.map,
        vertices: &vertices,
        candidates: &candidates,
        repeats: settings.repeats,
        seed: settings.seed,
        thread_count,
        executor,
        progress: &progress.done,
        total: &progress.total,
        cancel: &progress.cancel,
    };
    let evidence: Vec<Evidence> = if tests_edges {
        proving.run(settings.probing).ok_or(BuildError::Cancelled)?
    } else {
        candidates.iter().map(|candidate| draft.seen[candidate]).collect()
    };
    let stats = BuildStats {
        candidates: candidates.len() as u64,
        special,
        untried: evidence.iter().filter(|evidence| evidence.tries == 0).count() as u64,
        probes: draft.episodes + progress.done.load(Ordering::Relaxed),
        placing_s,
        probing_s: started.elapsed().as_secs_f64() - placing_s,
        seconds: started.elapsed().as_secs_f64(),
    };
    Ok(Built { graph: NavGraph::prove(vertices, &candidates, &evidence, settings.threshold), stats })
}

/// Each vertex's nearest and, if asked for, what devices and ledges join; and how many the latter are.
pub fn find_candidates(context: &ProbeContext, settings: &BuildSettings, vertices: &[Vec3]) -> (Vec<Candidate>, u64) {
    let mut candidates = candidates::nearest(vertices, settings.neighbours);
    if !settings.special_moves {
        return (candidates, 0);
    }
    let mut known = candidates.clone();
    known.sort_unstable();
    let special = candidates::by_features(&context.map, &context.profile, vertices, &known);
    candidates.extend(&special);
    (candidates, special.len() as u64)
}
