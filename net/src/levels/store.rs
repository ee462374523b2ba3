//! The levels that a service keeps, and where maps come from.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use surefoot_world::exchange::{self, ImportOptions};
use surefoot_world::{Map, MapHash, MapSpec};

/// Maps that a service keeps unless told otherwise.
pub const DEFAULT_MAX_MAPS: usize = 16;

/// A map made elsewhere, with the name of its level.
#[derive(Debug)]
pub struct Level {
    /// What edits belong to.
    pub name: String,
    /// The map.
    pub map: Arc<Map>,
}

/// Where a map comes from.
#[derive(Debug, Clone)]
pub enum MapSource {
    /// It is generated.
    Spec(MapSpec),
    /// It was imported.
    Level(Arc<Level>),
}

impl MapSource {
    /// The map; generating it takes a while.
    pub fn map(&self) -> Arc<Map> {
        match self {
            MapSource::Spec(spec) => Arc::new(Map::generate(spec)),
            MapSource::Level(level) => level.map.clone(),
        }
    }

    /// Distinguishes it from other sources.
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
    /// All kept maps are in use.
    #[error("{0} maps are kept and in use, the most allowed (--max-maps)")]
    Full(usize),
    /// No such map is kept.
    #[error("map {0} is not kept here: call ImportMap first")]
    Unknown(String),
    /// The file is not a map.
    #[error("{0}")]
    File(String),
}

/// The levels that a service keeps; clones share them.
#[derive(Debug, Clone)]
pub struct LevelStore {
    limit: usize,
    kept: Arc<Mutex<Kept>>,
}

#[derive(Debug, Default)]
struct Kept {
    uses: u64,
    /// By hash, with when they were last used.
    levels: BTreeMap<String, (u64, Arc<Level>)>,
}

impl LevelStore {
    /// Keeps at most `limit` maps.
    pub fn new(limit: usize) -> Self {
        Self { limit, kept: Arc::default() }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().expect("no holder of this lock panics")
    }

    /// Keeps a level, in place of the longest unused if there is no room.
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

    /// A kept level, by the hash of its map in hexadecimal digits.
    ///
    /// # Errors
    /// [`LevelError::Unknown`].
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

    /// All of them, by hash.
    pub fn all(&self) -> Vec<Arc<Level>> {
        self.kept().levels.values().map(|(_, level)| level.clone()).collect()
    }

    /// The name that a kept map was given.
    pub fn name_of(&self, map: MapHash) -> Option<String> {
        self.kept().levels.get(&map.to_hex()).map(|(_, level)| level.name.clone())
    }
}

/// What a file may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LevelFormat {
    /// A map as this program saves it.
    Saved,
    /// glTF or GLB.
    Gltf,
    /// Wavefront OBJ.
    Obj,
}

/// The map of a file, and what is odd about it.
///
/// # Errors
/// [`LevelError::File`] says what is wrong with it.
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
