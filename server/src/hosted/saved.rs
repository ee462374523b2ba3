//! What of a world outlives the process.

use super::mode::TimeMode;
use super::snapshot::Counters;
use super::world::{HostedWorld, Record};
use crate::ids::{NpcId, WorldId};
use crate::quota::Quota;
use crate::registry::Registry;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::durable;
use surefoot_world::exchange;
use surefoot_world::sealed::{self, SealError};
use surefoot_world::{End, Map, MapHash, MapSpec, NpcSlot, Tick, Vec3, WorldState};
use tracing::warn;

const MAGIC: &[u8; 8] = b"SFWORLD\n";
/// Changed whenever [`SavedWorld`] or anything inside it is.
const VERSION: u32 = 3;
const SUFFIX: &str = "world";
/// Locked by the server that uses the folder.
const LOCK_FILE: &str = "lock";
/// Numbers that NPCs may have been given after the world was saved for the last time: no other NPC gets them.
const UNSAVED_SERIALS: u32 = 1 << 16;

/// A world as it was when the server stopped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedWorld {
    id: WorldId,
    owner: String,
    map: MapHash,
    source: SavedMap,
    mode: TimeMode,
    state: WorldState,
    npcs: Vec<SavedNpc>,
    last_serial: u32,
    counters: Counters,
}

/// Where a saved world's map comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum SavedMap {
    /// It is generated.
    Spec(MapSpec),
    /// It was imported: the name of its level, and the map as a file.
    File(String, Vec<u8>),
}

impl SavedMap {
    /// What it takes to have `map` again; `level` names an imported one. Turning that into a file takes a while.
    pub fn of(map: &Map, level: String) -> Self {
        map.spec().map_or_else(|| SavedMap::File(level, exchange::encode(map)), |spec| SavedMap::Spec(*spec))
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SavedNpc {
    id: NpcId,
    slot: NpcSlot,
    owner: String,
    goal: Option<Vec3>,
    last_outcome: Option<End>,
    attempts: u32,
    attempts_ended: u32,
}

/// A saved world that cannot be restored.
#[derive(Debug, thiserror::Error)]
pub enum SavedError {
    /// The file cannot be read or written.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// Another process has locked the folder.
    #[error("{} is used by another server: give each its own folder (--state)", .0.display())]
    InUse(PathBuf),
    /// Not all worlds could be saved in time.
    #[error("saving took longer than {} s: some worlds stay as they were saved before", .0.as_secs_f32())]
    TooSlow(Duration),
    /// It was written by another version.
    #[error("{0} has version {1}, this program reads version {VERSION}")]
    Version(PathBuf, u32),
    /// It is something else, or cut off or changed.
    #[error("{0} is damaged")]
    Damaged(PathBuf),
    /// This program generates another map from the spec than the one that saved it.
    #[error("world {0} stood on another map: this version generates it differently")]
    OtherMap(WorldId),
    /// Its imported map cannot be read.
    #[error("world {0}: {1}")]
    File(WorldId, surefoot_world::exchange::FileError),
}

impl SavedWorld {
    /// Its id on the server.
    pub fn id(&self) -> WorldId {
        self.id
    }

    /// The client that it belongs to.
    pub fn owner(&self) -> &str {
        &self.owner
    }

    /// Name of its level, where its map was imported.
    pub fn level(&self) -> &str {
        match &self.source {
            SavedMap::Spec(_) => "",
            SavedMap::File(name, _) => name,
        }
    }

    /// Generates or reads its map.
    ///
    /// # Errors
    /// If it is not the one that the world stood on.
    pub fn map(&self) -> Result<Arc<Map>, SavedError> {
        let map = match &self.source {
            SavedMap::Spec(spec) => Map::generate(spec),
            SavedMap::File(_, bytes) => exchange::decode(bytes).map_err(|error| SavedError::File(self.id, error))?,
        };
        if map.hash() == self.map && self.state.fits(1, map.placed().zip_lines.len()) {
            Ok(Arc::new(map))
        } else {
            Err(SavedError::OtherMap(self.id))
        }
    }

    /// Where its map comes from.
    pub fn source(&self) -> &SavedMap {
        &self.source
    }

    /// As the content of a file.
    pub fn encode(&self) -> Vec<u8> {
        sealed::seal(MAGIC, VERSION, &postcard::to_stdvec(self).expect("plain data"))
    }

    /// What [`encode`](Self::encode) wrote.
    ///
    /// # Errors
    /// If it is something else, of another version, damaged, or no world can have been saved like that.
    pub fn decode(bytes: &[u8]) -> Result<Self, SealError> {
        let content = sealed::open(MAGIC, VERSION, bytes)?;
        let saved: Self = postcard::from_bytes(content).map_err(|_| SealError::Damaged)?;
        if saved.makes_sense() { Ok(saved) } else { Err(SealError::Damaged) }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, or [`decode`](Self::decode) refuses it.
    pub fn read(path: &Path) -> Result<Self, SavedError> {
        let bytes = std::fs::read(path).map_err(|error| SavedError::Io(path.to_owned(), error))?;
        Self::decode(&bytes).map_err(|error| match error {
            SealError::Version(version) => SavedError::Version(path.to_owned(), version),
            SealError::Magic | SealError::Damaged => SavedError::Damaged(path.to_owned()),
        })
    }

    /// Whether a world can have been saved like that: a checksum makes bytes whole, not true.
    fn makes_sense(&self) -> bool {
        let slots: BTreeSet<NpcSlot> = self.npcs.iter().map(|npc| npc.slot).collect();
        let is_ours = |npc: &SavedNpc| npc.id.world() == self.id && npc.goal.is_none_or(|goal| goal.is_finite());
        self.npcs.iter().all(is_ours)
            && slots.len() == self.npcs.len()
            && self.state.slots().eq(slots)
            // Rides on zip lines are checked against the map once there is one.
            && self.state.fits(1, usize::MAX)
    }
}

/// The folder for saved worlds, locked against other processes while any clone of this exists.
#[derive(Debug, Clone)]
pub struct StateFolder {
    path: PathBuf,
    _lock: Arc<File>,
}

impl StateFolder {
    /// Creates the folder if it does not exist, and locks it.
    ///
    /// # Errors
    /// If that fails, or another process has locked it.
    pub fn open(path: &Path) -> Result<Self, SavedError> {
        let fail = |error| SavedError::Io(path.to_owned(), error);
        std::fs::create_dir_all(path).map_err(fail)?;
        let lock = File::create(path.join(LOCK_FILE)).map_err(fail)?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { path: path.to_owned(), _lock: Arc::new(lock) }),
            Err(TryLockError::WouldBlock) => Err(SavedError::InUse(path.to_owned())),
            Err(TryLockError::Error(error)) => Err(fail(error)),
        }
    }

    /// The worlds that it holds by the names of the files, in the order of their ids. Files may be damaged.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn list(&self) -> Result<BTreeMap<WorldId, PathBuf>, SavedError> {
        let fail = |error| SavedError::Io(self.path.clone(), error);
        let mut found = BTreeMap::new();
        for entry in std::fs::read_dir(&self.path).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            if path.extension().is_none_or(|suffix| suffix != SUFFIX) {
                continue;
            }
            match path.file_stem().and_then(|stem| stem.to_str()?.parse().ok()) {
                Some(id) => _ = found.insert(WorldId(id), path),
                None => warn!(path = %path.display(), "not the file of a world: its name is no id"),
            }
        }
        Ok(found)
    }

    /// Writes a world in place of what was saved of it before: whole or not at all, and durable when this returns.
    ///
    /// # Errors
    /// If it cannot be written; what was saved before is kept.
    pub fn write(&self, saved: &SavedWorld) -> Result<(), SavedError> {
        let path = self.file_of(saved.id);
        durable::replace(&path, &saved.encode()).map_err(|error| SavedError::Io(path, error))
    }

    /// Deletes what was saved of a world.
    ///
    /// # Errors
    /// If the file cannot be removed.
    pub fn forget(&self, id: WorldId) -> Result<(), SavedError> {
        let path = self.file_of(id);
        match durable::remove(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(SavedError::Io(path, error)),
            _ => Ok(()),
        }
    }

    fn file_of(&self, id: WorldId) -> PathBuf {
        self.path.join(format!("{id}.{SUFFIX}"))
    }
}

impl HostedWorld {
    /// A copy of what must not be lost; `source` is where its map comes from.
    pub fn save(&self, owner: &str, source: SavedMap) -> SavedWorld {
        let npcs = self.records.iter().map(|(&id, record)| SavedNpc {
            id,
            slot: record.slot,
            owner: record.ticket.client().to_owned(),
            goal: record.goal,
            last_outcome: record.last_outcome,
            attempts: record.attempts,
            attempts_ended: record.attempts_ended,
        });
        SavedWorld {
            id: self.id,
            owner: owner.to_owned(),
            map: self.world.map().hash(),
            source,
            mode: self.mode,
            state: self.world.save(),
            npcs: npcs.collect(),
            last_serial: self.last_serial,
            counters: self.counters.clone(),
        }
    }

    /// Restores a saved world on its map. NPCs go on to their goals once workers decide for them.
    pub fn restore(saved: &SavedWorld, map: Arc<Map>, registry: Arc<Registry>, npc_quota: &Arc<Quota>) -> Self {
        let mut world = Self::new(saved.id, map, saved.mode, registry);
        world.world.restore(saved.state.clone());
        world.last_serial = saved.last_serial.saturating_add(UNSAVED_SERIALS).min(NpcId::MAX_SERIAL);
        world.counters = saved.counters.clone();
        for npc in &saved.npcs {
            let mut record = Record::new(npc.slot, npc_quota.grant(&npc.owner));
            (record.goal, record.last_outcome) = (npc.goal, npc.last_outcome);
            (record.attempts, record.attempts_ended) = (npc.attempts, npc.attempts_ended);
            record.began = Tick(saved.state.tick());
            world.records.insert(npc.id, record);
            if let Some(goal) = npc.goal {
                // It may have headed for a waypoint of a plan that is gone.
                world.world.set_goal(npc.slot, goal);
            }
        }
        world.assign_workers();
        world
    }
}
