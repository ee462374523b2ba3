//! The maps of an evaluation, and their names in reports.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;
use surefoot_world::{Map, MapSpec};

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
        /// Where its goals come from.
        goals: GoalArea,
    },
}

/// The part of a level from which starts and goals are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GoalArea {
    /// The playable area: the ground that the body can leave and come back to, around the level's spawn points or the
    /// largest.
    Playable,
    /// All ground, roofs and closed rooms included.
    Anywhere,
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

    /// Seed of the goals: the map's seed, or a hash of the level's content.
    pub(super) fn seed(&self) -> u64 {
        match self {
            Self::Generated(spec) => spec.seed,
            Self::Level { map, .. } => u64::from_le_bytes(*map.hash().0.first_chunk().expect("a hash is longer")),
        }
    }

    /// Text that identifies the map.
    pub(super) fn identity(&self) -> String {
        match self {
            Self::Generated(spec) => format!("{spec:?}"),
            Self::Level { map, goals: GoalArea::Anywhere, .. } => map.hash().to_hex(),
            Self::Level { map, goals: GoalArea::Playable, .. } => format!("{} playable", map.hash().to_hex()),
        }
    }

    /// The map; a generated one takes a while.
    pub(crate) fn load(&self) -> Arc<Map> {
        match self {
            Self::Generated(spec) => Arc::new(surefoot_generate::generate(spec)),
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
