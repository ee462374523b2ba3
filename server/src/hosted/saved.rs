//! The part of a world that outlives the process, and its file format.

use super::mode::TimeMode;
use super::snapshot::Counters;
use super::world::{HostedWorld, Record};
use crate::ids::{NpcId, WorldId};
use crate::quota::Quota;
use crate::registry::Registry;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_world::exchange;
use surefoot_world::sealed::{self, SealError};
use surefoot_world::{End, Map, MapHash, MapSpec, NpcSlot, Tick, Vec3, WorldState};

const MAGIC: &[u8; 8] = b"SFWORLD\n";
/// Version of the file format; it changes whenever [`SavedWorld`] or anything inside it changes.
const VERSION: u32 = 2;
const SUFFIX: &str = "world";
/// Numbers that are skipped when a world is restored, because NPCs may have got them after the last save.
const UNSAVED_SERIALS: u32 = 1 << 16;

/// A world as it was when it was saved.
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

/// Source of a saved world's map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum SavedMap {
    /// The map is generated from a spec.
    Spec(MapSpec),
    /// The map was imported: the name of its level, and the map as a file.
    File(String, Vec<u8>),
}

impl SavedMap {
    /// Returns what is needed to restore `map`; `level` is the level's name if the map was imported. Encoding an imported map
    /// takes a while.
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

/// Why a world cannot be saved or restored.
#[derive(Debug, thiserror::Error)]
pub enum SavedError {
    /// The file cannot be read or written.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// The file was written by another version.
    #[error("{0} has version {1}, this program reads version {VERSION}")]
    Version(PathBuf, u32),
    /// The file is no saved world, or it is truncated or corrupted.
    #[error("{0} is damaged")]
    Damaged(PathBuf),
    /// The program that saved the world generated a different map from the spec.
    #[error("world {0} was saved with a different map: this version generates it differently")]
    OtherMap(WorldId),
    /// The imported map of the world cannot be read.
    #[error("world {0}: {1}")]
    File(WorldId, surefoot_world::exchange::FileError),
}

impl SavedWorld {
    /// Returns the world's id on the server.
    pub fn id(&self) -> WorldId {
        self.id
    }

    /// Returns the client that the world belongs to.
    pub fn owner(&self) -> &str {
        &self.owner
    }

    /// Returns the name of the world's level; empty if the map was generated.
    pub fn level(&self) -> &str {
        match &self.source {
            SavedMap::Spec(_) => "",
            SavedMap::File(name, _) => name,
        }
    }

    /// Generates or decodes the world's map.
    ///
    /// # Errors
    /// If the map cannot be decoded, or it is not the one that the world was saved with.
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

    /// Returns the source of the world's map.
    pub fn source(&self) -> &SavedMap {
        &self.source
    }

    /// Encodes the world as the content of a file.
    pub fn encode(&self) -> Vec<u8> {
        sealed::seal(MAGIC, VERSION, &postcard::to_stdvec(self).expect("plain data"))
    }

    /// Decodes what [`encode`](Self::encode) returned.
    ///
    /// # Errors
    /// If `bytes` are no saved world, of another version, damaged or inconsistent.
    pub fn decode(bytes: &[u8]) -> Result<Self, SealError> {
        let content = sealed::open(MAGIC, VERSION, bytes)?;
        let saved: Self = postcard::from_bytes(content).map_err(|_| SealError::Damaged)?;
        if saved.is_consistent() { Ok(saved) } else { Err(SealError::Damaged) }
    }

    /// Writes the world into `folder`, atomically replacing an earlier save of it.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), SavedError> {
        let path = Self::path(folder, self.id);
        let temporary = path.with_extension("tmp");
        let written = std::fs::write(&temporary, self.encode()).and_then(|()| std::fs::rename(&temporary, &path));
        written.map_err(|error| SavedError::Io(path, error))
    }

    fn read(path: &Path) -> Result<Self, SavedError> {
        let bytes = std::fs::read(path).map_err(|error| SavedError::Io(path.to_owned(), error))?;
        Self::decode(&bytes).map_err(|error| match error {
            SealError::Version(version) => SavedError::Version(path.to_owned(), version),
            SealError::Magic | SealError::Damaged => SavedError::Damaged(path.to_owned()),
        })
    }

    /// Whether a world can have been saved with this content, which the checksum does not prove.
    fn is_consistent(&self) -> bool {
        let slots: BTreeSet<NpcSlot> = self.npcs.iter().map(|npc| npc.slot).collect();
        let is_ours = |npc: &SavedNpc| npc.id.world() == self.id && npc.goal.is_none_or(|goal| goal.is_finite());
        self.npcs.iter().all(is_ours)
            && slots.len() == self.npcs.len()
            && self.state.slots().eq(slots)
            // Rides on zip lines are checked in `map`, which knows the number of lines.
            && self.state.fits(1, usize::MAX)
    }

    /// Reads all worlds in `folder`, ordered by id; each is a world or the error of its file. A folder that does not exist has
    /// no worlds.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn read_all(folder: &Path) -> Result<Vec<Result<Self, SavedError>>, SavedError> {
        let fail = |error| SavedError::Io(folder.to_owned(), error);
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(fail(error)),
        };
        let mut paths = BTreeSet::new();
        for entry in entries {
            paths.insert(entry.map_err(fail)?.path());
        }
        let mut worlds: Vec<_> = paths
            .iter()
            .filter(|path| path.extension().is_some_and(|suffix| suffix == SUFFIX))
            .map(|path| Self::read(path))
            .collect();
        worlds.sort_by_key(|world| world.as_ref().map_or(WorldId(u64::MAX), |world| world.id));
        Ok(worlds)
    }

    /// Removes the file of a dropped world from `folder`, if there is one.
    ///
    /// # Errors
    /// If the file cannot be removed.
    pub fn forget(folder: &Path, id: WorldId) -> Result<(), SavedError> {
        let path = Self::path(folder, id);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(SavedError::Io(path, error)),
            _ => Ok(()),
        }
    }

    fn path(folder: &Path, id: WorldId) -> PathBuf {
        folder.join(format!("{id}.{SUFFIX}"))
    }
}

impl HostedWorld {
    /// Copies what must outlive the process; `source` is the source of the world's map.
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

    /// Restores a saved world on its map. NPCs continue to their goals once workers decide for them.
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
                // The world's state may hold a waypoint of a plan that is gone.
                world.world.set_goal(npc.slot, goal);
            }
        }
        world.assign_workers();
        world
    }
}
