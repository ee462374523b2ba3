//! All worlds of a server: their owners and lifecycle. `npcs` has the calls about NPCs, `maps` those about the ground,
//! `workers` those of workers. `persistence` saves and restores worlds, `takeovers` lists those being restored.

pub(crate) mod maps;
mod npcs;
mod persistence;
mod takeovers;
mod workers;

use crate::ServerConfig;
use crate::figures::{WorldFigures, WorldSummary};
use crate::hosted::{EditError, HostedWorld, NpcError, TimeMode, ZonesError};
use crate::ids::{ID_PERIOD, WorldId};
use crate::metrics::{self, ProcessFigures};
use crate::quota::{Quota, QuotaError, Ticket};
use crate::registry::Registry;
use crate::sim::SimError;
use crate::sim::{Schedule, SimHandle};
use crate::store::{SharedStore, StoreError, WorldStore};
use crate::turns::Turns;
use parking_lot::RwLock;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, SystemTime};
use surefoot_net::levels::{LevelStore, MapError, MapPool, MapSource, SharedMap};
use surefoot_net::serving::{Caller, Shutdown};
use surefoot_planner::Zone;
use surefoot_world::{CharacterProfile, Map};
use takeovers::Takeovers;
use tokio::time::Instant;
use tracing::info;

/// Longest wait for the clock to reach a new id; far more than a burst of new ids needs.
const MAX_ID_WAIT: Duration = Duration::from_secs(1);
/// Longest wait until a change is durable in a fleet.
const CONFIRM_LIMIT: Duration = Duration::from_secs(5);
/// Most threads that survey maps, and most that sample the ground, at the same time, so that worlds keep stepping.
const SURVEYS_AT_A_TIME: usize = 2;
const SAMPLES_AT_A_TIME: usize = 2;

/// Why the server cannot carry out a request.
#[derive(Debug, thiserror::Error)]
pub enum WorldsError {
    #[error("world {0} does not exist")]
    UnknownWorld(WorldId),
    #[error("there are already {0} worlds, the most allowed (--max-worlds)")]
    TooManyWorlds(usize),
    #[error("cannot create a thread for another world: {0}")]
    NoThread(std::io::Error),
    #[error("{0}")]
    WorldQuota(QuotaError),
    #[error("{0}")]
    NpcQuota(QuotaError),
    #[error("world {0} belongs to another client")]
    NotOwner(WorldId),
    #[error(transparent)]
    Npc(#[from] NpcError),
    #[error(transparent)]
    Sim(#[from] SimError),
    #[error("{1}")]
    BadItem(String, String),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Edit(#[from] EditError),
    #[error(transparent)]
    Zones(#[from] ZonesError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("world {0} runs on {1}")]
    Elsewhere(WorldId, String),
    #[error("world {0} is moving to another server: call LocateWorld, and retry")]
    Moving(WorldId),
    #[error("world {0}: the change was applied but is not durable: the database does not answer")]
    Unconfirmed(WorldId),
    #[error("{0} failed: {1}")]
    Lost(&'static str, tokio::task::JoinError),
}

/// A running world: the handle to its thread, and its constant properties.
#[derive(Debug, Clone)]
pub struct WorldHandle {
    pub sim: SimHandle,
    pub shown: ShownMap,
    pub mode: TimeMode,
    /// When within a period its ticks are due, in [0, 1).
    phase: f64,
    pub body: CharacterProfile,
    /// The world's place in its client's quota.
    ticket: Arc<Ticket>,
    /// The map's part of the memory budget.
    _memory: Arc<SharedMap>,
    /// Held during a save, so that a later save is newer.
    saving: Arc<tokio::sync::Mutex<()>>,
    /// Whether the world must not be saved any more. Locked while a save is written, but not while the thread is
    /// called.
    is_dropped: Arc<tokio::sync::Mutex<bool>>,
}

/// The map of a running world, for calls that only read it.
#[derive(Debug, Clone)]
pub struct ShownMap(Arc<RwLock<Arc<Map>>>);

impl ShownMap {
    fn new(map: Arc<Map>) -> Self {
        Self(Arc::new(RwLock::new(map)))
    }

    /// The current map.
    pub fn get(&self) -> Arc<Map> {
        self.0.read().clone()
    }

    /// Replaces the map. Called on the world's thread, so that the last edit wins.
    pub fn show(&self, map: &Arc<Map>) {
        *self.0.write() = map.clone();
    }
}

/// Access of a call to an NPC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NpcAccess {
    /// Reads its state: any caller may.
    Read,
    /// Changes it: the client that spawned it, the owner of its world, and admins may.
    Change,
}

/// Settings of a new world, except its map.
#[derive(Debug, Clone)]
pub struct WorldSettings {
    /// How its time passes.
    pub mode: TimeMode,
    /// The default body of its NPCs.
    pub body: CharacterProfile,
    /// Whether they collide with each other.
    pub solid_npcs: bool,
    /// Its zones, by different names.
    pub zones: Vec<Zone>,
}

/// All worlds; clones share them.
#[derive(Debug, Clone)]
pub struct Worlds {
    inner: Arc<WorldsInner>,
}

#[derive(Debug)]
struct WorldsInner {
    config: ServerConfig,
    /// Epoch of the tick schedules of all worlds.
    started: std::time::Instant,
    worlds: RwLock<BTreeMap<WorldId, WorldHandle>>,
    last_world: AtomicU64,
    /// The smallest id for new worlds.
    epoch: WorldId,
    world_quota: Arc<Quota>,
    npc_quota: Arc<Quota>,
    registry: Arc<Registry>,
    levels: LevelStore,
    /// Held while all worlds are saved: two saves at a time would write the same files.
    saving: tokio::sync::Mutex<()>,
    /// Where worlds are saved.
    store: OnceLock<Arc<dyn WorldStore>>,
    /// Worlds that panicked.
    failed_count: AtomicU64,
    /// Times that a world could not be saved.
    failed_save_count: AtomicU64,
    /// Worlds that were taken over from other servers of the fleet.
    taken_over_count: AtomicU64,
    /// Worlds of this server, in a fleet, that do not run.
    takeovers: Takeovers,
    /// Turns of surveys.
    surveys: Turns,
    /// Turns of sampling the ground.
    samples: Turns,
    shutdown: Shutdown,
}

impl Worlds {
    /// Creates a server without worlds.
    pub fn new(config: ServerConfig, shutdown: Shutdown) -> Self {
        let inner = WorldsInner {
            started: std::time::Instant::now(),
            world_quota: Quota::new(
                config.max_worlds_per_client,
                "worlds, the most it may have (--max-worlds-per-client)",
            ),
            npc_quota: Quota::new(config.max_npcs_per_client, "NPCs, the most it may have (--max-npcs-per-client)"),
            levels: LevelStore::new(config.max_maps, config.maps.memory().clone())
                .with_patience(config.reader_patience),
            config,
            worlds: RwLock::default(),
            last_world: AtomicU64::new(0),
            epoch: WorldId::at(SystemTime::now()),
            registry: Arc::default(),
            saving: tokio::sync::Mutex::default(),
            surveys: Turns::new(SURVEYS_AT_A_TIME),
            samples: Turns::new(SAMPLES_AT_A_TIME),
            store: OnceLock::new(),
            failed_count: AtomicU64::new(0),
            failed_save_count: AtomicU64::new(0),
            taken_over_count: AtomicU64::new(0),
            takeovers: Takeovers::default(),
            shutdown,
        };
        Self { inner: Arc::new(inner) }
    }

    /// Returns the configuration of the server.
    pub fn config(&self) -> &ServerConfig {
        &self.inner.config
    }

    /// Maps in use, and the memory that they take.
    pub fn maps(&self) -> &MapPool {
        &self.inner.config.maps
    }

    /// Maps that clients imported.
    pub fn levels(&self) -> &LevelStore {
        &self.inner.levels
    }

    /// Returns the signal that stops the server.
    pub fn shutdown(&self) -> &Shutdown {
        &self.inner.shutdown
    }

    /// Creates a world for `client` and starts it.
    pub async fn create(
        &self,
        caller: &Caller,
        source: MapSource,
        WorldSettings { mode, body, solid_npcs, zones }: WorldSettings,
    ) -> Result<WorldSummary, WorldsError> {
        let limit = self.inner.config.max_worlds;
        if self.inner.worlds.read().len() >= limit {
            return Err(WorldsError::TooManyWorlds(limit));
        }
        let ticket = self.inner.world_quota.acquire(&caller.name).map_err(WorldsError::WorldQuota)?;
        let base = self.maps().get(&caller.name, source.base()).await?;
        let id = self.next_id().await?;
        let map = {
            let base = base.clone();
            in_background("putting pieces onto a map", move || source.finish(base.map())).await?
        };
        let map_hash = map.hash();
        let world = HostedWorld::new(id, map, mode, self.inner.registry.clone())
            .with_bodies(vec![body])
            .with_solid_npcs(solid_npcs)
            .with_zones(zones);
        self.start(id, world, (base, ticket), limit)?;
        self.persist_new(id).await?;
        info!(world_id = id.0, map = %map_hash, ?mode, client = &*caller.name, "world created");
        self.describe(caller, id).await
    }

    /// Returns an id that is unique across epochs.
    async fn next_id(&self) -> Result<WorldId, StoreError> {
        if let Some(shared) = self.shared_store() {
            return shared.new_id(WorldId::at(SystemTime::now())).await;
        }
        let earliest = WorldId::at(SystemTime::now()).0;
        let last = &self.inner.last_world;
        let next = |last: u64| earliest.max(last + 1);
        let before = last.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |last| Some(next(last)));
        let id = WorldId(next(before.unwrap_or_else(|last| last)));
        // Ids must not be ahead of the clock, or the next epoch could assign the same ones. If the clock was set back,
        // ids of restored worlds are ahead; this does not wait for them, because the next epoch restores them too.
        let enough = Instant::now() + MAX_ID_WAIT;
        while WorldId::at(SystemTime::now()) < id && Instant::now() < enough {
            tokio::time::sleep(ID_PERIOD).await;
        }
        Ok(id)
    }

    /// Returns the epoch, which grows with each restart of the server.
    pub fn epoch(&self) -> u64 {
        self.inner.epoch.0
    }

    /// Starts a world's thread and adds it, unless there are `limit` worlds; `base` is its map without pieces.
    fn start(
        &self,
        id: WorldId,
        mut world: HostedWorld,
        (base, ticket): (Arc<SharedMap>, Ticket),
        limit: usize,
    ) -> Result<(), WorldsError> {
        let (mode, body, map) = (world.mode(), world.bodies()[0].clone(), world.map().clone());
        if self.shared_store().is_some() {
            world.await_confirmation();
        }
        let mut worlds = self.inner.worlds.write();
        if worlds.len() >= limit {
            return Err(WorldsError::TooManyWorlds(limit));
        }
        let taken = worlds.values().filter(|world| world.mode == TimeMode::Realtime).map(|world| world.phase);
        let schedule = Schedule { epoch: self.inner.started, phase: Schedule::free_phase(taken) };
        let failed = {
            let shared = Arc::downgrade(&self.inner);
            move || {
                let Some(shared) = shared.upgrade() else { return };
                shared.failed_count.fetch_add(1, Ordering::Relaxed);
                // Its save is kept. It is restored at the next start of the server; in a fleet, after a pause.
                shared.takeovers.note_failure(id);
                shared.worlds.write().remove(&id);
            }
        };
        let sim = SimHandle::start(format!("world-{id}"), world, schedule, failed).map_err(WorldsError::NoThread)?;
        worlds.insert(
            id,
            WorldHandle {
                sim,
                shown: ShownMap::new(map),
                _memory: base,
                mode,
                phase: schedule.phase,
                body,
                ticket: Arc::new(ticket),
                saving: Arc::default(),
                is_dropped: Arc::default(),
            },
        );
        Ok(())
    }

    /// Returns the handle of a running world.
    pub fn handle(&self, id: WorldId) -> Result<WorldHandle, WorldsError> {
        if self.shared_store().is_some_and(|shared| !shared.holds_lease()) {
            return Err(WorldsError::Moving(id));
        }
        let worlds = self.inner.worlds.read();
        worlds.get(&id).cloned().ok_or(WorldsError::UnknownWorld(id))
    }

    /// A running world, whose thread queues the calls as those of the caller.
    pub fn handle_for(&self, caller: &Caller, id: WorldId) -> Result<WorldHandle, WorldsError> {
        let handle = self.handle(id)?;
        Ok(WorldHandle { sim: handle.sim.for_client(&caller.name), ..handle })
    }

    /// A running world to which the caller may add: its own, or, for designers, any.
    pub fn handle_to_change(&self, caller: &Caller, id: WorldId) -> Result<WorldHandle, WorldsError> {
        let handle = self.handle_for(caller, id)?;
        if caller.may_add_to(handle.ticket.client()) { Ok(handle) } else { Err(WorldsError::NotOwner(id)) }
    }

    /// One world.
    pub async fn describe(&self, caller: &Caller, id: WorldId) -> Result<WorldSummary, WorldsError> {
        Ok(self.handle_for(caller, id)?.sim.call(|state| WorldSummary::of(&state.world)).await?)
    }

    /// The figures of all worlds after their latest ticks, ordered by id. Does not wait for a world.
    pub fn figures(&self) -> Vec<Arc<WorldFigures>> {
        self.inner.worlds.read().values().map(|world| world.sim.figures()).collect()
    }

    /// Returns the ids of all worlds in ascending order.
    pub fn ids(&self) -> Vec<WorldId> {
        self.inner.worlds.read().keys().copied().collect()
    }

    /// Ends a world and deletes its save, even if its thread is stuck. A save that is being written ends first. If its
    /// save cannot be deleted, the world continues.
    pub async fn drop_world(&self, caller: &Caller, id: WorldId) -> Result<(), WorldsError> {
        let handle = self.handle(id)?;
        if !caller.may_change(handle.ticket.client()) {
            return Err(WorldsError::NotOwner(id));
        }
        if let Some(store) = self.store().cloned() {
            let is_dropped = handle.is_dropped.clone();
            let forget = async move {
                // A save in progress finishes first, and no other save follows.
                let mut is_dropped = is_dropped.lock().await;
                store.forget(id).await?;
                *is_dropped = true;
                Ok::<(), StoreError>(())
            };
            // Continues if the client disconnects.
            let forgotten = tokio::spawn(forget).await;
            forgotten.map_err(|error| WorldsError::Lost("dropping a world", error))??;
        }
        let dropped = self.inner.worlds.write().remove(&id);
        // In a fleet, the journal task may have removed the world first, because the store no longer has it.
        if dropped.is_none() && self.shared_store().is_none() {
            return Err(WorldsError::UnknownWorld(id));
        }
        // A thread that accepts no calls ends with its last handle.
        let _ = handle.sim.cast(|state| state.is_over = true);
        info!(world_id = id.0, "world dropped");
        Ok(())
    }

    /// Ends all worlds.
    pub fn stop(&self) {
        let worlds = std::mem::take(&mut *self.inner.worlds.write());
        for WorldHandle { sim, .. } in worlds.into_values() {
            // A world that is too busy for the call ends with its last handle.
            let _ = sim.cast(|state| state.is_over = true);
        }
    }

    /// Handles to the threads of all worlds.
    pub(crate) fn running(&self) -> BTreeMap<WorldId, SimHandle> {
        self.inner.worlds.read().iter().map(|(&id, handle)| (id, handle.sim.clone())).collect()
    }

    /// Renders the metrics of the server as Prometheus text.
    pub fn metrics(&self) -> String {
        let process = ProcessFigures {
            failed_worlds: self.inner.failed_count.load(Ordering::Relaxed),
            failed_saves: self.inner.failed_save_count.load(Ordering::Relaxed),
            memory_bytes: self.maps().memory().used_bytes(),
            holds_lease: self.shared_store().is_none_or(SharedStore::holds_lease),
            taken_over: self.inner.taken_over_count.load(Ordering::Relaxed),
        };
        metrics::render(&self.figures(), &self.inner.registry.load(), process)
    }
}

/// Runs CPU work on a blocking thread.
pub(crate) async fn in_background<T: Send + 'static>(
    what: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, WorldsError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| WorldsError::Lost(what, error))
}
