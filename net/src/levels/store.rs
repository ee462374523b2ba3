//! The levels that a service keeps, and the sources of maps.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use surefoot_world::exchange::{self, ImportOptions};
use surefoot_world::{Map, MapHash, MapSpec};

/// Most imported maps that a service keeps by default.
pub const DEFAULT_MAX_MAPS: usize = 16;

/// An imported map with the name of its level.
#[derive(Debug)]
pub struct Level {
    /// Name of the level; edits belong to it.
    pub name: String,
    /// The imported map.
    pub map: Arc<Map>,
}

/// Source of a map.
#[derive(Debug, Clone)]
pub enum MapSource {
    /// The map is generated from a spec.
    Spec(MapSpec),
    /// The map was imported.
    Level(Arc<Level>),
}

impl MapSource {
    /// Returns the map. Generating one takes a while: call this from a thread that may block.
    pub fn map(&self) -> Arc<Map> {
        match self {
            MapSource::Spec(spec) => Arc::new(Map::generate(spec)),
            MapSource::Level(level) => level.map.clone(),
        }
    }

    /// Returns a key that is different for every source.
    pub fn key(&self) -> String {
        match self {
            MapSource::Spec(spec) => format!("{spec:?}"),
            MapSource::Level(level) => level.map.hash().to_hex(),
        }
    }
}

/// Why a level cannot be kept or found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LevelError {
    /// The store is full, and all its maps are in use; holds the limit.
    #[error("all {0} maps that may be kept are in use (--max-maps)")]
    Full(usize),
    /// No map with this hash is kept.
    #[error("map {0} is not kept here: call ImportMap first")]
    Unknown(String),
    /// The file holds no valid map; says why.
    #[error("{0}")]
    File(String),
}

/// The levels that a service keeps; clones share one store.
#[derive(Debug, Clone)]
pub struct LevelStore {
    limit: usize,
    kept: Arc<Mutex<Kept>>,
}

#[derive(Debug, Default)]
struct Kept {
    uses: u64,
    /// Value of `uses` at the last use, and the level, by hash of the map.
    levels: BTreeMap<String, (u64, Arc<Level>)>,
}

impl LevelStore {
    /// Creates a store for at most `limit` maps.
    pub fn new(limit: usize) -> Self {
        Self { limit, kept: Arc::default() }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().expect("no holder of this lock panics")
    }

    /// Adds a level; if there is no room, it replaces the one that was unused for longest.
    ///
    /// # Errors
    /// [`LevelError::Full`] if all kept maps are in use.
    pub fn put(&self, name: String, map: Arc<Map>) -> Result<Arc<Level>, LevelError> {
        let mut kept = self.kept();
        kept.uses += 1;
        let (uses, hash) = (kept.uses, map.hash().to_hex());
        if kept.levels.len() >= self.limit && !kept.levels.contains_key(&hash) {
            let is_idle = |level: &Arc<Level>| Arc::strong_count(level) == 1 && Arc::strong_count(&level.map) == 1;
            let idle = kept.levels.iter().filter(|(_, (_, level))| is_idle(level));
            let oldest = idle.min_by_key(|(_, (used, _))| *used).map(|(hash, _)| hash.clone());
            kept.levels.remove(&oldest.ok_or(LevelError::Full(self.limit))?);
        }
        let level = Arc::new(Level { name, map });
        kept.levels.insert(hash, (uses, level.clone()));
        Ok(level)
    }

    /// Returns the level whose map has the hash `map_hash`, in hexadecimal digits.
    ///
    /// # Errors
    /// [`LevelError::Unknown`] if there is none.
    pub fn get(&self, map_hash: &str) -> Result<Arc<Level>, LevelError> {
        let mut kept = self.kept();
        kept.uses += 1;
        let uses = kept.uses;
        let found = kept.levels.get_mut(map_hash).map(|(used, level)| {
            *used = uses;
            level.clone()
        });
        found.ok_or_else(|| LevelError::Unknown(map_hash.to_owned()))
    }

    /// Returns all levels, ordered by hash of the map.
    pub fn all(&self) -> Vec<Arc<Level>> {
        self.kept().levels.values().map(|(_, level)| level.clone()).collect()
    }

    /// Returns the level name of a kept map.
    pub fn name_of(&self, map: MapHash) -> Option<String> {
        self.kept().levels.get(&map.to_hex()).map(|(_, level)| level.name.clone())
    }
}

/// Format of a level's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LevelFormat {
    /// A saved map (`.sfmap`).
    Saved,
    /// glTF or GLB.
    Gltf,
    /// Wavefront OBJ.
    Obj,
}

/// Reads the map in a file, and returns warnings about the level.
///
/// # Errors
/// [`LevelError::File`] with what is wrong with the file.
pub(super) fn read(format: LevelFormat, file: &[u8], sidecar: Option<&str>) -> Result<(Map, Vec<String>), LevelError> {
    let options = ImportOptions::default();
    let imported = match format {
        LevelFormat::Saved => {
            let map = exchange::decode(file).map_err(|error| LevelError::File(error.to_string()))?;
            return Ok((map, Vec::new()));
        }
        LevelFormat::Gltf => exchange::import_gltf(file, sidecar, &options),
        LevelFormat::Obj => exchange::import_obj(file, sidecar, &options),
    };
    let imported = imported.map_err(|error| LevelError::File(error.to_string()))?;
    Ok((imported.map, imported.warnings.iter().map(ToString::to_string).collect()))
}
