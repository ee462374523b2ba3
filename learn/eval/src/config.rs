//! Configuration and errors of an evaluation.

use super::maps::{EvalMap, MapName};
use super::record::{Record, RecordError};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use surefoot_game_client::probes::InGameError;
use surefoot_game_client::{Game, GameError};
use surefoot_planner::{BuildError, BuildSettings, NavGraph};
use surefoot_rollout::FollowConfig;
use surefoot_world::CharacterProfile;
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

/// What the edges of a graph cost in plans.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Price {
    /// The expected decisions, and what the risks of failing and of dying are worth.
    #[default]
    Risk,
    /// The mean decisions, as in the paper.
    Steps,
}

/// Configuration of an evaluation.
#[derive(Debug, Clone)]
pub struct EvalConfig {
    /// Maps to evaluate on.
    pub maps: Vec<EvalMap>,
    /// Body of the NPCs.
    pub profile: CharacterProfile,
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
    /// Whether NPCs that follow plans rehearse what lies ahead; the paper's do not.
    pub rehearses: bool,
    /// Rules of following plans; their patience holds for NPCs that head straight for goals as well.
    pub follow: FollowConfig,
    /// The game in whose physics edges are proved and goals attempted; `None` for worlds of ours.
    pub game: Option<Game>,
    /// A graph to follow instead of one that is built.
    pub graph: Option<Arc<NavGraph>>,
    /// What edges cost.
    pub price: Price,
    /// Number of threads.
    pub thread_count: usize,
    /// Folder to save finished units in and to load them from; `None` to run every unit and save none.
    pub keep_in: Option<PathBuf>,
    /// The part of the units to run, if other processes run the rest; `None` for all. The report over a part is
    /// useless: only its saved units matter.
    pub shard: Option<Shard>,
    /// Where the attempts are recorded, or the record that is checked instead of running them; `None` to do neither.
    pub record: Option<Arc<Record>>,
}

/// One of several parts into which the units of an evaluation are divided, by map and seed, wherever and in whatever
/// order they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Index of the part.
    pub idx: u64,
    /// Number of parts, at least 1.
    pub count: u64,
}

impl Shard {
    /// Whether the unit of this map and seed belongs to the part.
    pub fn holds(self, map: &str, seed: u64) -> bool {
        let hash = blake3::hash(format!("{map} {seed}").as_bytes());
        let (first, _) = hash.as_bytes().split_first_chunk::<8>().expect("32 bytes");
        u64::from_le_bytes(*first) % self.count == self.idx
    }
}

impl From<InGameError> for EvalError {
    fn from(error: InGameError) -> Self {
        match error {
            InGameError::Game(error) => Self::Game(error),
            InGameError::Build(error) => Self::Build(error),
        }
    }
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
    /// A game cannot be used.
    #[error(transparent)]
    Game(#[from] GameError),
    /// A map has too few pairs of points at the configured distance.
    #[error("map {0} has no goals at that distance")]
    NoGoals(MapName),
    /// Intervals over maps need more of them.
    #[error("an interval needs at least two maps")]
    TooFewMaps,
    /// The recorded attempts do not belong to this evaluation.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A finished unit cannot be saved.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}
