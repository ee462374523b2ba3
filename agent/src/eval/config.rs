//! Configuration and errors of an evaluation.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use surefoot_planner::{BuildError, BuildSettings};
use surefoot_rollout::FollowConfig;
use surefoot_world::navigable::NoGround;
use surefoot_world::{CharacterProfile, Map, MapSpec};

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

/// A map to evaluate on.
#[derive(Debug, Clone)]
pub enum EvalMap {
    /// A map that is generated when it is needed.
    Generated(MapSpec),
    /// A map that was loaded or imported.
    Level {
        /// Name in reports.
        name: String,
        /// The map.
        map: Arc<Map>,
    },
}

/// What reports call a map: the seed that it was generated from, or the name of the level.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MapName {
    /// Seed of a generated map.
    Seed(u64),
    /// Name of a level.
    Level(String),
}

impl From<MapSpec> for EvalMap {
    fn from(spec: MapSpec) -> Self {
        Self::Generated(spec)
    }
}

impl EvalMap {
    /// What reports call the map.
    pub fn name(&self) -> MapName {
        match self {
            Self::Generated(spec) => MapName::Seed(spec.seed),
            Self::Level { name, .. } => MapName::Level(name.clone()),
        }
    }

    /// Seed from which goals are drawn: that of the map, or one that depends on the level's content alone.
    pub(super) fn seed(&self) -> u64 {
        match self {
            Self::Generated(spec) => spec.seed,
            Self::Level { map, .. } => u64::from_le_bytes(*map.hash().0.first_chunk().expect("a hash is longer")),
        }
    }

    /// Text that tells the map from all others.
    pub(super) fn identity(&self) -> String {
        match self {
            Self::Generated(spec) => format!("{spec:?}"),
            Self::Level { map, .. } => map.hash().to_hex(),
        }
    }

    /// The map; a generated one takes a while.
    pub(super) fn load(&self) -> Arc<Map> {
        match self {
            Self::Generated(spec) => Arc::new(Map::generate(spec)),
            Self::Level { map, .. } => map.clone(),
        }
    }
}

impl fmt::Display for MapName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Seed(seed) => seed.fmt(f),
            Self::Level(name) => name.fmt(f),
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
    /// What edges cost.
    pub price: Price,
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
    NoGoals(MapName),
    /// Intervals over maps need more of them.
    #[error("one map gives no interval: choose two maps or more")]
    TooFewMaps,
    /// A finished unit cannot be saved.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}
