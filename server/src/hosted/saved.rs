//! The save of a world, and its file format.

use super::commands::MAX_BODIES;
use super::itinerary::Itinerary;
use super::pursuit::{Pursuit, Retry, Target};
use super::snapshot::Counters;
use super::world::{HostedWorld, NpcRecord};
use crate::ids::{NpcId, WorldId};
use crate::messages::TimeMode;
use crate::quota::Quota;
use crate::registry::Registry;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::durable;
use surefoot_planner::zones::{MAX_ZONES, check_tags};
use surefoot_planner::{Tags, Zone};
use surefoot_world::map::{Piece, PieceError};
use surefoot_world::sealed::{self, SealError};
use surefoot_world::{CharacterProfile, End, Gait, Map, MapHash, MapSpec, NpcSlot, Vec3, WorldState};
use tracing::warn;

const MAGIC: &[u8; 8] = b"SFWORLD\n";
/// Changed whenever [`WorldSave`] or anything inside it is.
///
/// From 0.3.0 on, a server reads saves of the minor version before it. A change that raises this number keeps the
/// former struct as a private `WorldSaveV9` with `impl From<WorldSaveV9> for WorldSave`, and tries the former version
/// in [`WorldSave::decode`] after this one: `sealed::open` says which version it found. What is older may go then. A
/// server of the former minor version does not read what this one saves: in a fleet it hands such worlds back, and a
/// server that was upgraded takes them over.
const VERSION: u32 = 16;
const SUFFIX: &str = "world";
/// Locked by the server that uses the folder.
const LOCK_FILE: &str = "lock";
/// Numbers reserved for NPCs that were added after the save, so that no other NPC gets them.
const UNSAVED_SERIALS: u32 = 1 << 16;

/// The save of a world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldSave {
    id: WorldId,
    owner: String,
    /// Hash of the map with its pieces.
    map: MapHash,
    source: SavedMap,
    pieces: Vec<Piece>,
    zones: Vec<Zone>,
    mode: TimeMode,
    bodies: Vec<CharacterProfile>,
    solid_npcs: bool,
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
    /// The source of `map` without its pieces; `level` is the level's name if the map was imported. Encoding an
    /// imported map takes a while.
    pub fn of(map: &Map, level: String) -> Self {
        let encode = || surefoot_levels::encode(&map.with_pieces(Vec::new()).expect("no piece is not valid"));
        map.spec().map_or_else(|| SavedMap::File(level, encode()), |spec| SavedMap::Spec(*spec))
    }
}

/// The map of a saved world.
#[derive(Debug)]
pub struct RestoredMap {
    /// Without its pieces.
    pub base: Arc<Map>,
    /// With its pieces.
    pub map: Arc<Map>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SavedNpc {
    id: NpcId,
    slot: NpcSlot,
    owner: String,
    goal: Option<Vec3>,
    pursuit: Pursuit,
    retry: Option<Retry>,
    itinerary: Option<Itinerary>,
    looks_at: Option<Target>,
    turns_to: Option<f32>,
    last_outcome: Option<End>,
    attempts: u32,
    attempts_ended: u32,
    tags: Tags,
    gait: Gait,
}

/// Why a world cannot be saved or restored.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum SavedError {
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    #[error("{} is used by another server: give each its own folder (--state)", .0.display())]
    InUse(PathBuf),
    #[error("saving took longer than {} s: the previous saves of some worlds are kept", .0.as_secs_f32())]
    TooSlow(Duration),
    #[error("{place} was written by version {written} of this format, this server reads version {read}")]
    Version { place: PathBuf, written: u32, read: u32 },
    #[error("{0} is damaged (truncated, or checksum mismatch); it was left in place")]
    Damaged(PathBuf),
    #[error("world {0} was saved with a different map: this version generates it differently")]
    OtherMap(WorldId),
    #[error("world {0}: {1}")]
    File(WorldId, surefoot_levels::FileError),
    #[error("world {0}: {1}")]
    Pieces(WorldId, PieceError),
}

impl SavedError {
    /// The error for a sealed save at `place` that cannot be opened; `read` is the supported version.
    pub(super) fn sealed(error: SealError, place: &Path, read: u32) -> Self {
        let place = place.to_owned();
        match error {
            SealError::Version(written) => Self::Version { place, written, read },
            SealError::Magic | SealError::Damaged => Self::Damaged(place),
        }
    }
}

impl WorldSave {
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

    /// Generates or decodes the world's map, and adds its pieces.
    pub fn maps(&self) -> Result<RestoredMap, SavedError> {
        let base = Arc::new(match &self.source {
            SavedMap::Spec(spec) => surefoot_generate::generate(spec),
            SavedMap::File(_, bytes) => {
                surefoot_levels::decode(bytes).map_err(|error| SavedError::File(self.id, error))?
            }
        });
        self.maps_on(base)
    }

    /// Adds the world's pieces to its base map.
    pub fn maps_on(&self, base: Arc<Map>) -> Result<RestoredMap, SavedError> {
        let map = base.holding(&self.pieces).map_err(|error| SavedError::Pieces(self.id, error))?;
        if map.hash() == self.map && self.state.fits(self.bodies.len(), &map) {
            Ok(RestoredMap { base, map })
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
    pub fn decode(bytes: &[u8], place: &Path) -> Result<Self, SavedError> {
        let damaged = || SavedError::Damaged(place.to_owned());
        let content = sealed::open(MAGIC, VERSION, bytes).map_err(|error| SavedError::sealed(error, place, VERSION))?;
        let saved: Self = postcard::from_bytes(content).map_err(|_| damaged())?;
        if saved.is_consistent() { Ok(saved) } else { Err(damaged()) }
    }

    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, SavedError> {
        let bytes = std::fs::read(path).map_err(|error| SavedError::Io(path.to_owned(), error))?;
        Self::decode(&bytes, path)
    }

    /// Whether the content is consistent, which the checksum does not prove.
    pub(super) fn is_consistent(&self) -> bool {
        let slots: BTreeSet<NpcSlot> = self.npcs.iter().map(|npc| npc.slot).collect();
        let is_ours = |npc: &SavedNpc| {
            npc.id.world() == self.id
                && npc.goal.is_none_or(|goal| goal.is_finite())
                && npc.itinerary.as_ref().is_none_or(Itinerary::is_sound)
                && npc.pursuit.is_sound()
                && npc.retry.is_none_or(|retry| retry.pursuit.is_sound())
                && npc.looks_at.is_none_or(|target| target.is_sound())
                && npc.turns_to.is_none_or(f32::is_finite)
                && npc.gait.is_allowed()
        };
        self.npcs.iter().all(is_ours)
            && self.zones.len() <= MAX_ZONES
            && self.zones.iter().all(|zone| zone.clone().check().is_ok())
            && self.npcs.iter().all(|npc| check_tags(npc.tags.iter().cloned()).is_ok())
            && slots.len() == self.npcs.len()
            && self.state.slots().eq(slots)
            // Rides on zip lines are checked in `map`, which knows the number of lines.
            && (1..=MAX_BODIES).contains(&self.bodies.len())
            && self.state.fits_some_map(self.bodies.len())
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

    /// The saved worlds by file name, ordered by id. The files are not read.
    pub fn files(&self) -> Result<BTreeMap<WorldId, PathBuf>, SavedError> {
        let fail = |error| SavedError::Io(self.path.clone(), error);
        let mut found = BTreeMap::new();
        for entry in std::fs::read_dir(&self.path).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            if path.extension().is_none_or(|suffix| suffix != SUFFIX) {
                continue;
            }
            match path.file_stem().and_then(|stem| stem.to_str()?.parse().ok()) {
                Some(id) => _ = found.insert(WorldId(id), path),
                None => warn!(path = %path.display(), "not the save of a world: its name is not an id"),
            }
        }
        Ok(found)
    }

    /// Replaces the save of a world, atomically. It is durable when this returns. If that fails, the previous save is
    /// kept.
    pub fn replace(&self, saved: &WorldSave) -> Result<(), SavedError> {
        let path = self.file_of(saved.id);
        durable::replace(&path, &saved.encode()).map_err(|error| SavedError::Io(path, error))
    }

    /// Deletes the save of a world.
    pub fn remove(&self, id: WorldId) -> Result<(), SavedError> {
        let path = self.file_of(id);
        match durable::remove(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(SavedError::Io(path, error)),
            _ => Ok(()),
        }
    }

    /// The file of a world.
    pub fn file_of(&self, id: WorldId) -> PathBuf {
        self.path.join(format!("{id}.{SUFFIX}"))
    }
}

impl HostedWorld {
    /// Makes a save; `source` is the source of the world's map.
    pub fn save(&self, owner: &str, source: SavedMap) -> WorldSave {
        let npcs = self.records.iter().map(|(&id, record)| SavedNpc {
            id,
            slot: record.slot,
            owner: record.ticket.client().to_owned(),
            goal: record.goal,
            pursuit: record.pursuit,
            retry: record.retry,
            itinerary: record.itinerary.clone(),
            looks_at: record.looks_at,
            turns_to: record.turns_to,
            last_outcome: record.last_outcome,
            attempts: record.attempts,
            attempts_ended: record.attempts_ended,
            tags: record.tags.clone(),
            gait: record.gait,
        });
        WorldSave {
            id: self.id,
            owner: owner.to_owned(),
            map: self.world.map().hash(),
            source,
            pieces: self.world.map().pieces().to_vec(),
            zones: self.zones().cloned().collect(),
            mode: self.mode,
            bodies: self.bodies().to_vec(),
            solid_npcs: self.has_solid_npcs(),
            state: self.world.save(),
            npcs: npcs.collect(),
            last_serial: self.last_serial,
            counters: self.counters.clone(),
        }
    }

    /// Restores a saved world on its map. NPCs continue to their goals once workers decide for them.
    pub fn restore(saved: &WorldSave, map: Arc<Map>, registry: Arc<Registry>, npc_quota: &Arc<Quota>) -> Self {
        let mut world = Self::new(saved.id, map, saved.mode, registry)
            .with_bodies(saved.bodies.clone())
            .with_solid_npcs(saved.solid_npcs)
            .with_zones(saved.zones.iter().cloned());
        world.world.restore(saved.state.clone());
        world.last_serial = saved.last_serial.saturating_add(UNSAVED_SERIALS).min(NpcId::MAX_SERIAL);
        world.counters = saved.counters.clone();
        for npc in &saved.npcs {
            let mut record = NpcRecord::new(npc.slot, npc_quota.grant(&npc.owner));
            (record.goal, record.pursuit, record.retry) = (npc.goal, npc.pursuit, npc.retry);
            (record.itinerary, record.looks_at, record.turns_to) = (npc.itinerary.clone(), npc.looks_at, npc.turns_to);
            record.last_outcome = npc.last_outcome;
            (record.attempts, record.attempts_ended) = (npc.attempts, npc.attempts_ended);
            record.began = saved.state.tick();
            record.tags = npc.tags.clone();
            record.gait = npc.gait;
            world.add_record(npc.id, record);
            if let Some(goal) = npc.goal {
                // The world's state may have a waypoint of a plan that was not saved.
                world.world.head_for(npc.slot, goal, npc.pursuit.arrival);
            }
        }
        world.assign_workers();
        world
    }
}
