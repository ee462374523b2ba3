//! Where imported levels are kept besides in memory, for services that share them.

use std::fmt::Debug;

/// A level as it is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SavedLevel {
    /// Content hash of the map, 64 hexadecimal digits.
    pub map_hash: String,
    /// Name of the level.
    pub name: String,
    /// The client that imported it.
    pub owner: String,
    /// The map, as `surefoot_world::exchange::encode` encodes it.
    pub file: Vec<u8>,
}

/// Keeps levels for all services that share it. Calls block.
pub trait LevelArchive: Send + Sync + Debug {
    /// Keeps a level, in place of one with the same map.
    ///
    /// # Errors
    /// If it cannot be kept; says why.
    fn save(&self, level: SavedLevel) -> Result<(), String>;

    /// Returns the level whose map has this hash; `None` if there is none.
    ///
    /// # Errors
    /// If the archive cannot be read; says why.
    fn load(&self, map_hash: &str) -> Result<Option<SavedLevel>, String>;
}
