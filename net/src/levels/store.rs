//! The imported levels of a service, and the sources of maps.

use super::file::LevelFile;
use super::uploads::Uploads;
use crate::memory::{MemoryBudget, MemoryError, Reservation};
use crate::reader::DEFAULT_PATIENCE;
use crate::serving::Caller;
use parking_lot::Mutex;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use surefoot_levels::{ImportOptions, Imported, NoFiles};
use surefoot_world::map::LevelFrame;
use surefoot_world::map::piece::{self, Piece, PieceError};
use surefoot_world::{Map, MapHash, MapSpec, Vec3};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Most imported maps that a service keeps by default.
pub const DEFAULT_MAX_MAPS: usize = 16;

/// Most bytes that parsing needs for each byte of a file, not counting the index.
pub(super) const PARSE_FACTOR: u64 = 8;
/// Time without use after which any import may replace a level.
const UNUSED_LIMIT: Duration = Duration::from_secs(600);

/// An imported map, with the name of its level.
#[derive(Debug)]
pub struct Level {
    /// Name of the level; edits belong to it.
    pub name: String,
    /// The imported map.
    pub map: Arc<Map>,
    /// The client that imported it.
    pub owner: Arc<str>,
    /// The level as a file, while a client reads it.
    pub(super) file: Arc<tokio::sync::Mutex<Weak<LevelFile>>>,
    /// Its part of the memory budget.
    _memory: Reservation,
}

/// A map without pieces: how it is made.
#[derive(Debug, Clone)]
pub enum BaseMap {
    /// Generated from a spec.
    Spec(MapSpec),
    /// Imported.
    Level(Arc<Level>),
}

impl BaseMap {
    /// A key that is unique for each base map.
    pub fn key(&self) -> String {
        match self {
            Self::Spec(spec) => format!("{spec:?}"),
            Self::Level(level) => level.map.hash().to_hex(),
        }
    }

    fn extent(&self) -> Vec3 {
        match self {
            Self::Spec(spec) => spec.size.extent(),
            Self::Level(level) => level.map.extent(),
        }
    }

    /// How the coordinates of the level relate to the map's.
    pub fn frame(&self) -> LevelFrame {
        match self {
            Self::Spec(_) => LevelFrame::default(),
            Self::Level(level) => *level.map.frame(),
        }
    }
}

/// Source of a map: its base map, and the pieces on it.
#[derive(Debug, Clone)]
pub struct MapSource {
    base: BaseMap,
    pieces: Arc<[Piece]>,
}

impl From<BaseMap> for MapSource {
    fn from(base: BaseMap) -> Self {
        Self { base, pieces: Arc::default() }
    }
}

impl MapSource {
    /// The same base map with these pieces.
    pub fn with_pieces(self, mut pieces: Vec<Piece>) -> Result<Self, PieceError> {
        piece::arrange(&mut pieces, self.base.extent())?;
        Ok(Self { pieces: pieces.into(), ..self })
    }

    /// The base map.
    pub fn base(&self) -> &BaseMap {
        &self.base
    }

    /// The pieces on the map, by name.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Generates the map if needed. Blocks: do not call it from async code.
    pub fn map(&self) -> Arc<Map> {
        let base = match &self.base {
            BaseMap::Spec(spec) => Arc::new(surefoot_generate::generate(spec)),
            BaseMap::Level(level) => level.map.clone(),
        };
        self.finish(&base)
    }

    /// Puts the pieces onto the base map.
    pub fn finish(&self, base: &Arc<Map>) -> Arc<Map> {
        base.holding(&self.pieces).expect("the pieces of a source were checked")
    }

    /// A key that is unique for each source.
    pub fn key(&self) -> String {
        let base = self.base.key();
        if self.pieces.is_empty() { base } else { format!("{base} with {:?}", self.pieces) }
    }
}

/// Why a level cannot be kept or found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum LevelError {
    #[error("all {0} kept maps (--max-maps) are in use, or were used within ten minutes by clients with fewer maps")]
    Full(usize),
    #[error(transparent)]
    Memory(#[from] MemoryError),
    #[error("another client imported this map as level `{0}`: use that name, or ask its owner to rename the level")]
    OtherName(String),
    #[error(
        "another client imported this map as level `{0}`, with its origin, scale or upright axis elsewhere: \
         import it as that client did, or ask it to import the level again"
    )]
    OtherFrame(String),
    #[error("map {0} is not kept here: call ImportMap first")]
    Unknown(String),
    /// The file has no valid map; holds the reason.
    #[error("{0}")]
    File(String),
    /// The shared archive is unavailable; holds the reason.
    #[error("{0}")]
    Unavailable(String),
}

/// A level in an archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SavedLevel {
    /// Content hash of the map, 64 hexadecimal digits.
    pub map_hash: String,
    /// Name of the level.
    pub name: String,
    /// The client that imported it.
    pub owner: String,
    /// The map, as `surefoot_levels::encode` encodes it.
    pub file: Vec<u8>,
}

/// Keeps levels for all services that share it. Calls block.
pub trait LevelArchive: Send + Sync + Debug {
    /// Saves a level. It replaces one with the same map. The error is the reason.
    fn save(&self, level: SavedLevel) -> Result<(), String>;

    /// Returns the level whose map has this hash; `None` if there is none. The error is the reason.
    fn load(&self, map_hash: &str) -> Result<Option<SavedLevel>, String>;
}

/// The levels that a service keeps; clones share one store.
#[derive(Debug, Clone)]
pub struct LevelStore {
    limit: usize,
    memory: MemoryBudget,
    uploads: Uploads,
    /// One import at a time: the memory that it needs is known only after parsing.
    importing: Arc<Semaphore>,
    /// How long a reader of a level may read nothing.
    patience: Duration,
    kept: Arc<Mutex<Kept>>,
    archive: Option<Arc<dyn LevelArchive>>,
}

#[derive(Debug, Default)]
struct Kept {
    /// Time of the last use, and the level, by hash of the map.
    levels: BTreeMap<String, (Instant, Arc<Level>)>,
}

impl LevelStore {
    /// A store of at most `limit` maps, which count against `memory`.
    pub fn new(limit: usize, memory: MemoryBudget) -> Self {
        Self {
            limit,
            uploads: Uploads::new(memory.clone()),
            memory,
            importing: Arc::new(Semaphore::new(1)),
            patience: DEFAULT_PATIENCE,
            kept: Arc::default(),
            archive: None,
        }
    }

    /// Also keeps levels in an archive that other services share.
    #[must_use]
    pub fn archived(self, archive: Arc<dyn LevelArchive>) -> Self {
        Self { archive: Some(archive), ..self }
    }

    /// Cuts off readers of levels that read nothing for `patience`.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    pub(super) fn patience(&self) -> Duration {
        self.patience
    }

    /// The memory budget of levels.
    pub fn memory(&self) -> &MemoryBudget {
        &self.memory
    }

    /// Saves a level to the archive, if there is one. Blocks.
    pub(super) fn archive(&self, level: &Level) -> Result<(), LevelError> {
        let Some(archive) = &self.archive else { return Ok(()) };
        let saved = SavedLevel {
            map_hash: level.map.hash().to_hex(),
            name: level.name.clone(),
            owner: level.owner.to_string(),
            file: surefoot_levels::encode(&level.map),
        };
        archive.save(saved).map_err(LevelError::Unavailable)
    }

    /// Returns the level whose map has the hash `map_hash`, from memory or from the archive.
    pub async fn fetch(&self, map_hash: &str) -> Result<Arc<Level>, LevelError> {
        let found = self.get(map_hash);
        let (Some(archive), Err(LevelError::Unknown(_))) = (self.archive.clone(), &found) else { return found };
        // One at a time: the memory that a level needs is known only after loading its file.
        let turn = self.turn().await;
        if let Ok(level) = self.get(map_hash) {
            return Ok(level);
        }
        let (levels, hash) = (self.clone(), map_hash.to_owned());
        let task = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            let Some(saved) = archive.load(&hash).map_err(LevelError::Unavailable)? else {
                return Err(LevelError::Unknown(hash));
            };
            let _memory = levels.reserve(&saved.owner, saved.file.len())?;
            let map = surefoot_levels::decode(&saved.file).map_err(|error| LevelError::File(error.to_string()))?;
            if map.hash().to_hex() != hash {
                return Err(LevelError::File(format!("the archive has another map under the hash {hash}")));
            }
            levels.retain(&saved.owner.into(), |_| true, saved.name, Arc::new(map))
        });
        task.await.map_err(|error| LevelError::File(format!("the map cannot be read: {error}")))?
    }

    /// The level as a file. Clients that read it at the same time share its bytes.
    pub(super) async fn file_of(&self, client: &str, level: Arc<Level>) -> Result<Arc<LevelFile>, LevelError> {
        let mut slot = level.file.clone().lock_owned().await;
        if let Some(file) = slot.upgrade() {
            return Ok(file);
        }
        let turn = self.turn().await;
        let memory = LevelFile::reserve(&self.memory, client, &level.map)?;
        let task = tokio::task::spawn_blocking(move || {
            // The caller may disconnect; turn and memory are released when the work is done.
            let _turn = turn;
            let file = Arc::new(LevelFile::encode(&level.map, memory));
            *slot = Arc::downgrade(&file);
            file
        });
        task.await.map_err(|error| LevelError::File(format!("the map cannot be saved: {error}")))
    }

    /// Files that arrive in parts.
    pub(super) fn uploads(&self) -> &Uploads {
        &self.uploads
    }

    /// The turn of an import, to be held until its end.
    pub(super) async fn turn(&self) -> Option<OwnedSemaphorePermit> {
        // Never closed.
        self.importing.clone().acquire_owned().await.ok()
    }

    /// Reserves memory to parse a file of a client.
    pub(super) fn reserve(&self, client: &str, file_bytes: usize) -> Result<Reservation, MemoryError> {
        self.memory.reserve(client, PARSE_FACTOR * file_bytes as u64)
    }

    /// Adds a level. If there is no room, it replaces levels that are not in use: first those of the client with the
    /// most levels, the least recently used first. A client with fewer levels loses only levels that were not used for
    /// ten minutes. The same map of a level whose origin, scale or upright axis has changed replaces the kept one.
    pub fn put(&self, caller: &Caller, name: String, map: Arc<Map>) -> Result<Arc<Level>, LevelError> {
        self.retain(&caller.name, |owner| caller.may_change(owner), name, map)
    }

    fn retain(
        &self,
        owner: &Arc<str>,
        may_change: impl Fn(&str) -> bool,
        name: String,
        map: Arc<Map>,
    ) -> Result<Arc<Level>, LevelError> {
        let mut kept = self.kept.lock();
        let (now, hash) = (Instant::now(), map.hash().to_hex());
        if let Some((used, level)) = kept.levels.get_mut(&hash) {
            let (is_named_so, is_framed_so) = (level.name == name, level.map.frame() == map.frame());
            if is_named_so && is_framed_so {
                *used = now;
                return Ok(level.clone());
            }
            if !may_change(&level.owner) {
                let other = if is_named_so { LevelError::OtherFrame } else { LevelError::OtherName };
                return Err(other(level.name.clone()));
            }
        } else if kept.levels.len() >= self.limit {
            kept.evict_one(owner, 1, |_| 1).ok_or(LevelError::Full(self.limit))?;
        }
        let bytes = map.memory_bytes() as u64;
        let memory = loop {
            match self.memory.reserve(owner, bytes) {
                Ok(memory) => break memory,
                Err(error) => kept.evict_one(owner, bytes, Level::memory_bytes).ok_or(error)?,
            }
        };
        let level = Arc::new(Level { name, map, owner: owner.clone(), file: Arc::default(), _memory: memory });
        kept.levels.insert(hash, (now, level.clone()));
        Ok(level)
    }

    /// Returns the level whose map has the hash `map_hash`, in hexadecimal digits.
    pub fn get(&self, map_hash: &str) -> Result<Arc<Level>, LevelError> {
        let mut kept = self.kept.lock();
        let found = kept.levels.get_mut(map_hash).map(|(used, level)| {
            *used = Instant::now();
            level.clone()
        });
        found.ok_or_else(|| LevelError::Unknown(map_hash.to_owned()))
    }

    /// The frame of a level. A later import of the same map decides, because graphs are named by their maps alone.
    pub fn frame_of(&self, base: &BaseMap) -> LevelFrame {
        let kept = self.kept.lock();
        let latest = kept.levels.get(&base.key()).map(|(_, level)| *level.map.frame());
        latest.unwrap_or_else(|| base.frame())
    }

    /// Returns all levels, ordered by hash of the map.
    pub fn all(&self) -> Vec<Arc<Level>> {
        self.kept.lock().levels.values().map(|(_, level)| level.clone()).collect()
    }

    /// Returns the level name of a kept map.
    pub fn name_of(&self, map: MapHash) -> Option<String> {
        self.kept.lock().levels.get(&map.to_hex()).map(|(_, level)| level.name.clone())
    }
}

impl Level {
    fn memory_bytes(&self) -> u64 {
        self.map.memory_bytes() as u64
    }

    /// Whether the level is not in use.
    fn is_idle(self: &Arc<Self>) -> bool {
        Arc::strong_count(self) == 1 && Arc::strong_count(&self.map) == 1
    }
}

impl Kept {
    /// Removes an idle level to make room for one of `client` with the weight `added`; `None` if none may be removed.
    fn evict_one(&mut self, client: &Arc<str>, added: u64, weight: impl Fn(&Level) -> u64) -> Option<()> {
        let mut weights = BTreeMap::from([(client.clone(), added)]);
        for (_, level) in self.levels.values() {
            *weights.entry(level.owner.clone()).or_default() += weight(level);
        }
        let (now, own) = (Instant::now(), weights[client]);
        let may_go =
            |used: &Instant, level: &Level| weights[&level.owner] >= own || now.duration_since(*used) >= UNUSED_LIMIT;
        let idle = self.levels.iter().filter(|(_, (used, level))| level.is_idle() && may_go(used, level));
        // Among clients of equal weight, the client that imports loses a level.
        let rank = |used: &Instant, level: &Level| (Reverse(weights[&level.owner]), level.owner != *client, *used);
        let hash = idle.min_by_key(|(_, (used, level))| rank(used, level)).map(|(hash, _)| hash.clone())?;
        self.levels.remove(&hash);
        Some(())
    }
}

/// Format of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LevelFormat {
    /// A saved map (`.sfmap`).
    Saved,
    /// glTF or GLB.
    Gltf,
    /// Wavefront OBJ.
    Obj,
}

/// Parses the map in a file, which is sent alone or as a `.zip` with all that it refers to.
pub(super) fn read(
    format: LevelFormat,
    file: &[u8],
    sidecar: Option<&str>,
    options: &ImportOptions,
) -> Result<Imported, LevelError> {
    let is_packed = surefoot_levels::is_zip(file);
    let imported = match format {
        LevelFormat::Saved => {
            let map = surefoot_levels::decode(file).map_err(|error| LevelError::File(error.to_string()))?;
            return Ok(Imported::saved(map));
        }
        LevelFormat::Gltf if !is_packed => surefoot_levels::import_gltf(file, sidecar, options, &NoFiles),
        LevelFormat::Obj if !is_packed => surefoot_levels::import_obj(file, sidecar, options),
        LevelFormat::Gltf | LevelFormat::Obj => surefoot_levels::import_zip(file, sidecar, options),
    };
    imported.map_err(|error| LevelError::File(error.to_string()))
}
