//! The levels that a service keeps, and the sources of maps.

use super::file::LevelFile;
use super::uploads::Uploads;
use crate::memory::{MemoryBudget, MemoryError, Reservation};
use crate::reader::DEFAULT_PATIENCE;
use crate::serving::Caller;
use parking_lot::{Mutex, MutexGuard};
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use surefoot_world::exchange::{self, ImportOptions};
use surefoot_world::map::piece::{self, Piece, PieceError};
use surefoot_world::{Map, MapHash, MapSpec, Vec3};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Most imported maps that a service keeps by default.
pub const DEFAULT_MAX_MAPS: usize = 16;

/// Bytes that reading a file takes at most for each byte of it, the index aside.
pub(super) const PARSE_FACTOR: u64 = 8;
/// Time without use after which any import may take the place of a level.
const UNUSED_LIMIT: Duration = Duration::from_secs(600);

/// A map made elsewhere, with the name of its level.
#[derive(Debug)]
pub struct Level {
    /// Name of the level; edits belong to it.
    pub name: String,
    /// The imported map.
    pub map: Arc<Map>,
    /// The client that imported it.
    pub owner: Arc<str>,
    /// Its file while a client reads it.
    pub(super) file: Arc<tokio::sync::Mutex<Weak<LevelFile>>>,
    /// What it takes of the memory budget.
    _memory: Reservation,
}

/// What a map was made of.
#[derive(Debug, Clone)]
pub enum BaseMap {
    /// It is generated from a spec.
    Spec(MapSpec),
    /// It was imported.
    Level(Arc<Level>),
}

impl BaseMap {
    /// Returns a key that is different for all that differ.
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
}

/// Source of a map: what it was made of, and the pieces that were put onto it.
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
    /// The map of the same making with these pieces.
    ///
    /// # Errors
    /// If one of them is not valid, or they are too many.
    pub fn with_pieces(self, mut pieces: Vec<Piece>) -> Result<Self, PieceError> {
        piece::arrange(&mut pieces, self.base.extent())?;
        Ok(Self { pieces: pieces.into(), ..self })
    }

    /// What the map was made of.
    pub fn base(&self) -> &BaseMap {
        &self.base
    }

    /// The pieces on the map, by name.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Returns the map. Generating one takes a while: call this from a thread that may block.
    pub fn map(&self) -> Arc<Map> {
        let base = match &self.base {
            BaseMap::Spec(spec) => Arc::new(Map::generate(spec)),
            BaseMap::Level(level) => level.map.clone(),
        };
        self.finish(&base)
    }

    /// Puts the pieces of the source onto the map that was made.
    pub fn finish(&self, base: &Arc<Map>) -> Arc<Map> {
        base.holding(&self.pieces).expect("the pieces of a source were checked")
    }

    /// Returns a key that is different for every source.
    pub fn key(&self) -> String {
        let base = self.base.key();
        if self.pieces.is_empty() { base } else { format!("{base} with {:?}", self.pieces) }
    }
}

/// Why a level cannot be kept or found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LevelError {
    /// The store is full, and no map in it may be replaced; holds the limit.
    #[error(
        "all {0} maps that may be kept are in use, or were used less than ten minutes ago by clients with fewer maps (--max-maps)"
    )]
    Full(usize),
    /// There is no memory for it.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// Somebody else imported this very map under another name.
    #[error(
        "this map was imported as level `{0}` by another client: import it under that name, or ask its owner to rename it"
    )]
    OtherName(String),
    /// No such map is kept.
    #[error("map {0} is not kept here: call ImportMap first")]
    Unknown(String),
    /// The file holds no valid map; says why.
    #[error("{0}")]
    File(String),
    /// The archive that services share cannot be used now; says why.
    #[error("{0}")]
    Away(String),
}

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

/// The levels that a service keeps; clones share one store.
#[derive(Debug, Clone)]
pub struct LevelStore {
    limit: usize,
    memory: MemoryBudget,
    uploads: Uploads,
    /// One import at a time: what it needs is known only when it has been read.
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
    /// Keeps at most `limit` maps, which are paid for from `memory`.
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

    /// Keeps levels in an archive as well, where other services find them.
    #[must_use]
    pub fn archived(self, archive: Arc<dyn LevelArchive>) -> Self {
        Self { archive: Some(archive), ..self }
    }

    /// Cuts off readers of levels that read nothing for so long.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    pub(super) fn patience(&self) -> Duration {
        self.patience
    }

    /// The memory budget that levels are paid for from.
    pub fn memory(&self) -> &MemoryBudget {
        &self.memory
    }

    /// Keeps a level in the archive as well, if there is one. Call this from a thread that may block.
    pub(super) fn archive(&self, level: &Level) -> Result<(), LevelError> {
        let Some(archive) = &self.archive else { return Ok(()) };
        let saved = SavedLevel {
            map_hash: level.map.hash().to_hex(),
            name: level.name.clone(),
            owner: level.owner.to_string(),
            file: exchange::encode(&level.map),
        };
        archive.save(saved).map_err(LevelError::Away)
    }

    /// Returns the level whose map has the hash `map_hash`, which is loaded from the archive if it is not in memory.
    ///
    /// # Errors
    /// [`LevelError::Unknown`] if there is none; if the archive cannot be read, or there is no room for the level.
    pub async fn fetch(&self, map_hash: &str) -> Result<Arc<Level>, LevelError> {
        let found = self.get(map_hash);
        let (Some(archive), Err(LevelError::Unknown(_))) = (self.archive.clone(), &found) else { return found };
        // One at a time: what a level needs is known only when its file is here.
        let turn = self.turn().await;
        if let Ok(level) = self.get(map_hash) {
            return Ok(level);
        }
        let (levels, hash) = (self.clone(), map_hash.to_owned());
        let task = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            let Some(saved) = archive.load(&hash).map_err(LevelError::Away)? else {
                return Err(LevelError::Unknown(hash));
            };
            let _memory = levels.reserve(&saved.owner, saved.file.len())?;
            let map = exchange::decode(&saved.file).map_err(|error| LevelError::File(error.to_string()))?;
            if map.hash().to_hex() != hash {
                return Err(LevelError::File(format!("the archive holds another map as {hash}")));
            }
            levels.keep(&saved.owner.into(), |_| true, saved.name, Arc::new(map))
        });
        task.await.map_err(|error| LevelError::File(format!("the map cannot be read: {error}")))?
    }

    /// The level as a file. A client that asks while another one reads it gets the same bytes.
    ///
    /// # Errors
    /// If there is no memory for it.
    pub(super) async fn file_of(&self, client: &str, level: Arc<Level>) -> Result<Arc<LevelFile>, LevelError> {
        let mut slot = level.file.clone().lock_owned().await;
        if let Some(file) = slot.upgrade() {
            return Ok(file);
        }
        let turn = self.turn().await;
        let memory = LevelFile::reserve(&self.memory, client, &level.map)?;
        let task = tokio::task::spawn_blocking(move || {
            // The caller may be gone: turn and memory are released when the work is done.
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

    /// The turn of an import, to be held until it is done.
    pub(super) async fn turn(&self) -> Option<OwnedSemaphorePermit> {
        // Never closed.
        self.importing.clone().acquire_owned().await.ok()
    }

    /// Memory for reading a file of a client.
    ///
    /// # Errors
    /// If there is not enough left.
    pub(super) fn reserve(&self, client: &str, file_bytes: usize) -> Result<Reservation, MemoryError> {
        self.memory.reserve(client, PARSE_FACTOR * file_bytes as u64)
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock()
    }

    /// Keeps a level. If there is no room, it takes the place of levels that nobody uses now: first of the client with
    /// the most levels, the longest unused one first. A client with fewer levels loses only those that were not used for
    /// ten minutes.
    ///
    /// # Errors
    /// If no kept map may be replaced, or another client gave the level another name.
    pub fn put(&self, caller: &Caller, name: String, map: Arc<Map>) -> Result<Arc<Level>, LevelError> {
        self.keep(&caller.name, |owner| caller.may_change(owner), name, map)
    }

    fn keep(
        &self,
        owner: &Arc<str>,
        may_change: impl Fn(&str) -> bool,
        name: String,
        map: Arc<Map>,
    ) -> Result<Arc<Level>, LevelError> {
        let mut kept = self.kept();
        let (now, hash) = (Instant::now(), map.hash().to_hex());
        if let Some((used, level)) = kept.levels.get_mut(&hash) {
            if level.name == name {
                *used = now;
                return Ok(level.clone());
            }
            if !may_change(&level.owner) {
                return Err(LevelError::OtherName(level.name.clone()));
            }
        } else if kept.levels.len() >= self.limit {
            kept.forget_one(owner, 1, |_| 1).ok_or(LevelError::Full(self.limit))?;
        }
        let bytes = map.memory_bytes() as u64;
        let memory = loop {
            match self.memory.reserve(owner, bytes) {
                Ok(memory) => break memory,
                Err(error) => kept.forget_one(owner, bytes, Level::memory_bytes).ok_or(error)?,
            }
        };
        let level = Arc::new(Level { name, map, owner: owner.clone(), file: Arc::default(), _memory: memory });
        kept.levels.insert(hash, (now, level.clone()));
        Ok(level)
    }

    /// Returns the level whose map has the hash `map_hash`, in hexadecimal digits.
    ///
    /// # Errors
    /// [`LevelError::Unknown`] if there is none.
    pub fn get(&self, map_hash: &str) -> Result<Arc<Level>, LevelError> {
        let mut kept = self.kept();
        let found = kept.levels.get_mut(map_hash).map(|(used, level)| {
            *used = Instant::now();
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

impl Level {
    fn memory_bytes(&self) -> u64 {
        self.map.memory_bytes() as u64
    }

    /// Whether nobody uses it now.
    fn is_idle(self: &Arc<Self>) -> bool {
        Arc::strong_count(self) == 1 && Arc::strong_count(&self.map) == 1
    }
}

impl Kept {
    /// Forgets an idle level to make room for one of `client` that weighs `added`; `None` if none may be forgotten.
    fn forget_one(&mut self, client: &Arc<str>, added: u64, weight: impl Fn(&Level) -> u64) -> Option<()> {
        let mut weights = BTreeMap::from([(client.clone(), added)]);
        for (_, level) in self.levels.values() {
            *weights.entry(level.owner.clone()).or_default() += weight(level);
        }
        let (now, own) = (Instant::now(), weights[client]);
        let may_go =
            |used: &Instant, level: &Level| weights[&level.owner] >= own || now.duration_since(*used) >= UNUSED_LIMIT;
        let idle = self.levels.iter().filter(|(_, (used, level))| level.is_idle() && may_go(used, level));
        // Among clients that weigh the same, the one that imports gives way.
        let rank = |used: &Instant, level: &Level| (Reverse(weights[&level.owner]), level.owner != *client, *used);
        let hash = idle.min_by_key(|(_, (used, level))| rank(used, level)).map(|(hash, _)| hash.clone())?;
        self.levels.remove(&hash);
        Some(())
    }
}

/// What a file may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LevelFormat {
    /// A saved map (`.sfmap`).
    Saved,
    /// glTF or GLB.
    Gltf,
    /// Wavefront OBJ.
    Obj,
}

/// A level as it was read.
pub(super) struct Read {
    pub map: Map,
    /// Where the level's origin lies on the map, m.
    pub origin: Vec3,
    /// Problems that a designer may want to correct.
    pub warnings: Vec<String>,
}

/// Reads the map in a file.
///
/// # Errors
/// [`LevelError::File`] with what is wrong with the file.
pub(super) fn read(
    format: LevelFormat,
    file: &[u8],
    sidecar: Option<&str>,
    options: &ImportOptions,
) -> Result<Read, LevelError> {
    let imported = match format {
        LevelFormat::Saved => {
            let map = exchange::decode(file).map_err(|error| LevelError::File(error.to_string()))?;
            return Ok(Read { map, origin: Vec3::ZERO, warnings: Vec::new() });
        }
        LevelFormat::Gltf => exchange::import_gltf(file, sidecar, options),
        LevelFormat::Obj => exchange::import_obj(file, sidecar, options),
    };
    let imported = imported.map_err(|error| LevelError::File(error.to_string()))?;
    let warnings = imported.warnings.iter().map(ToString::to_string).collect();
    Ok(Read { map: imported.map, origin: imported.origin, warnings })
}
