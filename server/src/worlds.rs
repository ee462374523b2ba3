//! All worlds of a server: their owners and lifecycle, calls to them, and how they outlive the process.

use crate::ServerConfig;
use crate::errors::SimError;
use crate::hosted::{HostedWorld, NpcError, SavedError, SavedMap, SavedWorld, SpawnOrder, TimeMode};
use crate::ids::{ID_PERIOD, NpcId, WorkerId, WorldId};
use crate::messages::{Answer, Hello, ToWorker};
use crate::metrics::{self, WorldFigures};
use crate::quota::{Quota, QuotaError, Ticket};
use crate::registry::{Joined, Registry};
use crate::sim::{SimHandle, SimState};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, RwLock};
use std::time::SystemTime;
use surefoot_net::levels::{LevelStore, MapSource};
use surefoot_net::serving::Shutdown;
use surefoot_world::{Map, Seed, Tick, Vec3};
use tokio::sync::mpsc;
use tracing::{info, warn};

/// Phase between two worlds with consecutive ids, as a fraction of a period: the fractional parts of multiples of the golden
/// ratio are spread evenly for any number of worlds.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Why the server cannot do what a client requests.
#[derive(Debug, thiserror::Error)]
pub enum WorldsError {
    /// No world has this id.
    #[error("world {0} does not exist")]
    UnknownWorld(WorldId),
    /// The server has as many worlds as allowed.
    #[error("there are already {0} worlds, the most allowed (--max-worlds)")]
    TooManyWorlds(usize),
    /// The system cannot create a thread for another world.
    #[error("cannot create a thread for another world: {0}")]
    NoThread(std::io::Error),
    /// The client has as many worlds as allowed.
    #[error("{0}")]
    WorldQuota(QuotaError),
    /// The client has as many NPCs as allowed.
    #[error("{0}")]
    NpcQuota(QuotaError),
    /// The world refuses the call.
    #[error(transparent)]
    Npc(#[from] NpcError),
    /// The world's thread does not accept the call.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// An item of a batch is invalid: the field, and what is wrong with it.
    #[error("{1}")]
    BadItem(String, String),
    /// A background task ended without a result: what it was, and why it ended.
    #[error("{0} failed: {1}")]
    Lost(&'static str, tokio::task::JoinError),
}

/// A running world: the handle to its thread, and its constant properties.
#[derive(Debug, Clone)]
pub struct WorldHandle {
    /// Handle to the world's thread.
    pub sim: SimHandle,
    /// The map of the world.
    pub map: Arc<Map>,
    /// How the world's time passes.
    pub mode: TimeMode,
    /// The world's place in its client's quota.
    ticket: Arc<Ticket>,
}

/// Description of a world at one moment.
#[derive(Debug, Clone)]
pub struct WorldSummary {
    /// Id of the world.
    pub id: WorldId,
    /// The map of the world.
    pub map: Arc<Map>,
    /// How the world's time passes.
    pub mode: TimeMode,
    /// Number of NPCs.
    pub npc_count: usize,
    /// Number of ticks stepped.
    pub tick: Tick,
}

/// All worlds; clones share them.
#[derive(Debug, Clone)]
pub struct Worlds {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    config: ServerConfig,
    worlds: RwLock<BTreeMap<WorldId, WorldHandle>>,
    last_world: AtomicU64,
    /// The smallest id that a new world may get.
    epoch: WorldId,
    world_quota: Arc<Quota>,
    npc_quota: Arc<Quota>,
    registry: Arc<Registry>,
    levels: LevelStore,
    /// Held while saving: two saves at a time would write the same files.
    saving: tokio::sync::Mutex<()>,
    shutdown: Shutdown,
}

const POISON: &str = "no holder of this lock panics";

impl Worlds {
    /// Creates a server without worlds.
    pub fn new(config: ServerConfig, shutdown: Shutdown) -> Self {
        let shared = Shared {
            world_quota: Quota::new(config.max_worlds_per_client, "worlds, the most allowed (--max-worlds-per-client)"),
            npc_quota: Quota::new(config.max_npcs_per_client, "NPCs, the most allowed (--max-npcs-per-client)"),
            levels: LevelStore::new(config.max_maps),
            config,
            worlds: RwLock::default(),
            last_world: AtomicU64::new(0),
            epoch: WorldId::at(SystemTime::now()),
            registry: Arc::default(),
            saving: tokio::sync::Mutex::default(),
            shutdown,
        };
        Self { shared: Arc::new(shared) }
    }

    /// Returns the configuration of the server.
    pub fn config(&self) -> &ServerConfig {
        &self.shared.config
    }

    /// Returns the store of imported levels.
    pub fn levels(&self) -> &LevelStore {
        &self.shared.levels
    }

    /// Returns the signal that stops the server.
    pub fn shutdown(&self) -> &Shutdown {
        &self.shared.shutdown
    }

    // --- worlds ---

    /// Creates a world for `client` and starts it.
    ///
    /// # Errors
    /// If the server or the client has too many worlds, the map cannot be generated, or the world's thread cannot be started
    /// or does not answer.
    pub async fn create(&self, client: &str, source: MapSource, mode: TimeMode) -> Result<WorldSummary, WorldsError> {
        let limit = self.shared.config.max_worlds;
        if self.shared.worlds.read().expect(POISON).len() >= limit {
            return Err(WorldsError::TooManyWorlds(limit));
        }
        let ticket = self.shared.world_quota.acquire(client).map_err(WorldsError::WorldQuota)?;
        let map = in_background("map generation", move || source.map()).await?;
        let id = self.next_id().await;
        let map_hash = map.hash();
        let world = HostedWorld::new(id, map.clone(), mode, self.shared.registry.clone());
        self.start(id, world, map, ticket)?;
        info!(world_id = id.0, map = %map_hash, ?mode, client, "world created");
        self.describe(id).await
    }

    /// Returns an id that no world of this or an earlier epoch has had.
    async fn next_id(&self) -> WorldId {
        let earliest = WorldId::at(SystemTime::now()).0;
        let last = &self.shared.last_world;
        let next = |last: u64| earliest.max(last + 1);
        let before = last.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |last| Some(next(last)));
        let id = WorldId(next(before.unwrap_or_else(|last| last)));
        // Ids must not run ahead of the clock, or the next epoch could use the same ones.
        while WorldId::at(SystemTime::now()) < id {
            tokio::time::sleep(ID_PERIOD).await;
        }
        id
    }

    /// Returns the epoch, which is greater after every restart of the server.
    pub fn epoch(&self) -> u64 {
        self.shared.epoch.0
    }

    /// Starts a world's thread and registers the world.
    fn start(&self, id: WorldId, world: HostedWorld, map: Arc<Map>, ticket: Ticket) -> Result<(), WorldsError> {
        let limit = self.shared.config.max_worlds;
        let mode = world.mode();
        let mut worlds = self.shared.worlds.write().expect(POISON);
        if worlds.len() >= limit {
            return Err(WorldsError::TooManyWorlds(limit));
        }
        let phase = (id.0 as f64 * GOLDEN).fract();
        let sim = SimHandle::start(format!("world-{id}"), world, phase).map_err(WorldsError::NoThread)?;
        worlds.insert(id, WorldHandle { sim, map, mode, ticket: Arc::new(ticket) });
        Ok(())
    }

    /// Returns the handle of a running world.
    ///
    /// # Errors
    /// If no world has this id.
    pub fn handle(&self, id: WorldId) -> Result<WorldHandle, WorldsError> {
        let worlds = self.shared.worlds.read().expect(POISON);
        worlds.get(&id).cloned().ok_or(WorldsError::UnknownWorld(id))
    }

    /// Describes one world.
    ///
    /// # Errors
    /// If no world has this id, or its thread does not answer.
    pub async fn describe(&self, id: WorldId) -> Result<WorldSummary, WorldsError> {
        let WorldHandle { sim, map, mode, .. } = self.handle(id)?;
        let (npc_count, tick) = sim.call(|state| (state.world.npc_count(), state.world.tick())).await?;
        Ok(WorldSummary { id, map, mode, npc_count, tick })
    }

    /// Returns the ids of all worlds in ascending order.
    pub fn ids(&self) -> Vec<WorldId> {
        self.shared.worlds.read().expect(POISON).keys().copied().collect()
    }

    /// Ends a world and removes its file, if it was saved.
    ///
    /// # Errors
    /// If no world has this id, or its thread does not answer.
    pub async fn drop_world(&self, id: WorldId) -> Result<(), WorldsError> {
        let dropped = self.shared.worlds.write().expect(POISON).remove(&id);
        let handle = dropped.ok_or(WorldsError::UnknownWorld(id))?;
        handle.sim.call(|state| state.is_over = true).await?;
        if let Some(folder) = &self.shared.config.state
            && let Err(error) = SavedWorld::forget(folder, id)
        {
            warn!(world_id = id.0, %error, "the file of a dropped world cannot be removed: a restart would restore the world");
        }
        info!(world_id = id.0, "world dropped");
        Ok(())
    }

    /// Ends all worlds.
    pub fn stop(&self) {
        let worlds = std::mem::take(&mut *self.shared.worlds.write().expect(POISON));
        for WorldHandle { sim, .. } in worlds.into_values() {
            // A world that is too busy for the call ends with its last handle.
            let _ = sim.cast(|state| state.is_over = true);
        }
    }

    fn sims(&self) -> Vec<SimHandle> {
        self.shared.worlds.read().expect(POISON).values().map(|handle| handle.sim.clone()).collect()
    }

    /// Renders the metrics of the server as Prometheus text.
    pub async fn metrics(&self) -> String {
        let mut worlds = Vec::new();
        for sim in self.sims() {
            // A world that does not answer is left out.
            worlds.extend(sim.call(|state| WorldFigures::of(state)).await);
        }
        metrics::render(&worlds, &self.shared.registry.load())
    }

    // --- NPCs ---

    /// Adds an NPC for `client`.
    ///
    /// # Errors
    /// If there is no such world, its thread does not answer, the world or the client has too many NPCs, or the position or
    /// the goal lies outside the map.
    pub async fn spawn(&self, client: &str, world: WorldId, order: SpawnOrder) -> Result<NpcId, WorldsError> {
        self.spawn_many(client, world, vec![Ok(order)]).await?.pop().expect("one result for one order")
    }

    /// Adds NPCs for `client`; each has its own result, in the order of `orders`.
    ///
    /// # Errors
    /// If there is no such world, or its thread does not answer.
    pub async fn spawn_many(
        &self,
        client: &str,
        world: WorldId,
        orders: Vec<Result<SpawnOrder, WorldsError>>,
    ) -> Result<Vec<Result<NpcId, WorldsError>>, WorldsError> {
        let handle = self.handle(world)?;
        let limit = self.shared.config.max_npcs_per_world;
        let acquire = |order| Ok((order?, self.shared.npc_quota.acquire(client).map_err(WorldsError::NpcQuota)?));
        let orders: Vec<Result<_, WorldsError>> = orders.into_iter().map(acquire).collect();
        let results = handle.sim.call(move |state| {
            let mut spawn = |(order, ticket)| Ok(state.world.spawn_to(order, limit, ticket)?);
            orders.into_iter().map(|order| order.and_then(&mut spawn)).collect()
        });
        Ok(results.await?)
    }

    /// Runs `call` for each item on the world that its NPC belongs to, and returns the results in the order of `items`. All items
    /// of a world run between two of its ticks.
    pub async fn with_npcs<T: Send + 'static, R: Send + 'static>(
        &self,
        items: Vec<Result<(NpcId, T), WorldsError>>,
        call: impl Fn(&mut HostedWorld, NpcId, T) -> Result<R, NpcError> + Clone + Send + 'static,
    ) -> Vec<Result<R, WorldsError>> {
        let mut results: Vec<Option<Result<R, WorldsError>>> = (0..items.len()).map(|_| None).collect();
        let mut by_world: BTreeMap<WorldId, Vec<(usize, NpcId, T)>> = BTreeMap::new();
        for (idx, item) in items.into_iter().enumerate() {
            match item {
                Ok((npc, item)) => by_world.entry(npc.world()).or_default().push((idx, npc, item)),
                Err(error) => results[idx] = Some(Err(error)),
            }
        }
        for (world, items) in by_world {
            let places: Vec<(usize, NpcId)> = items.iter().map(|(idx, npc, _)| (*idx, *npc)).collect();
            let call = call.clone();
            let done = match self.handle(world) {
                Ok(handle) => {
                    let work = move |state: &mut SimState| -> Vec<_> {
                        items.into_iter().map(|(_, npc, item)| call(&mut state.world, npc, item)).collect()
                    };
                    handle.sim.call(work).await
                }
                Err(_) => Ok(places.iter().map(|(_, npc)| Err(NpcError::Unknown(*npc))).collect()),
            };
            match done {
                Ok(done) => {
                    for ((idx, _), result) in places.into_iter().zip(done) {
                        results[idx] = Some(result.map_err(WorldsError::from));
                    }
                }
                Err(error) => places.into_iter().for_each(|(idx, _)| results[idx] = Some(Err(error.into()))),
            }
        }
        results.into_iter().map(|result| result.expect("every item belongs to a world or has failed")).collect()
    }

    /// Runs `call` on the world that `npc` belongs to.
    ///
    /// # Errors
    /// If there is no such NPC, its world's thread does not answer, or `call` fails.
    pub async fn with_npc<R: Send + 'static>(
        &self,
        npc: NpcId,
        call: impl FnOnce(&mut HostedWorld) -> Result<R, NpcError> + Send + 'static,
    ) -> Result<R, WorldsError> {
        let handle = self.handle(npc.world()).map_err(|_| NpcError::Unknown(npc))?;
        Ok(handle.sim.call(move |state| call(&mut state.world)).await??)
    }

    /// Draws `count` random places of a world where a character can stand.
    ///
    /// # Errors
    /// If there is no such world, or its map has no navigable ground.
    pub async fn sample_ground(&self, world: WorldId, count: usize, seed: Seed) -> Result<Vec<Vec3>, WorldsError> {
        let map = self.handle(world)?.map;
        Ok(in_background("sampling", move || HostedWorld::sample_ground(&map, count, seed)).await??)
    }

    // --- workers ---

    /// Adds a worker; `queue` receives the welcome, then all other messages to the worker.
    pub fn join(&self, hello: Hello, queue: mpsc::Sender<ToWorker>) -> Joined {
        info!(name = hello.name, policy = hello.policy, capacity = hello.capacity, "worker joined");
        let joined = self.shared.registry.join(hello.name, hello.policy, hello.capacity, queue.clone());
        // The queue is new and empty.
        let _ = queue.try_send(ToWorker::Welcome(joined.id));
        self.cast_all(HostedWorld::rebalance);
        joined
    }

    /// Removes a worker and assigns its NPCs to others.
    pub fn leave(&self, worker: WorkerId) {
        info!(worker = worker.0, "worker left");
        self.shared.registry.leave(worker);
        self.cast_all(move |world| world.lose_worker(worker));
    }

    /// Passes a worker's answer to a world.
    ///
    /// # Errors
    /// If the world's thread does not accept the call.
    pub fn answer(&self, worker: WorkerId, world: WorldId, answer: Answer) -> Result<(), SimError> {
        // A world that has just been dropped needs no answers.
        let Ok(handle) = self.handle(world) else { return Ok(()) };
        handle.sim.cast(move |state| state.world.answer(worker, answer))
    }

    /// Runs `call` on every world except those that are too busy.
    fn cast_all(&self, call: impl Fn(&mut HostedWorld) + Clone + Send + 'static) {
        for sim in self.sims() {
            let call = call.clone();
            if let Err(error) = sim.cast(move |state| call(&mut state.world)) {
                warn!(%error, "a world did not accept a call");
            }
        }
    }

    // --- what outlives the process ---

    /// Restores all saved worlds. A world that cannot be restored is logged, and its file is kept.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub async fn restore_all(&self) -> Result<(), SavedError> {
        let Some(folder) = self.shared.config.state.clone() else { return Ok(()) };
        for saved in SavedWorld::read_all(&folder)? {
            let restored = saved.and_then(|saved| {
                // The id of a world that cannot be restored now is not reused either.
                self.shared.last_world.fetch_max(saved.id().0, Ordering::Relaxed);
                let map = saved.map()?;
                Ok((saved, map))
            });
            match restored {
                Ok((saved, map)) => self.restore(&saved, map),
                Err(error) => warn!(%error, "a saved world cannot be restored"),
            }
        }
        Ok(())
    }

    fn restore(&self, saved: &SavedWorld, map: Arc<Map>) {
        let world_id = saved.id().0;
        let world = HostedWorld::restore(saved, map.clone(), self.shared.registry.clone(), &self.shared.npc_quota);
        info!(world_id, npcs = world.npc_count(), tick = world.tick().0, "world restored");
        let ticket = self.shared.world_quota.grant(saved.owner());
        if map.spec().is_none()
            && let Err(error) = self.shared.levels.put(saved.level().to_owned(), map.clone())
        {
            warn!(world_id, %error, "the map of a restored world cannot be kept: MapService will not return it");
        }
        if let Err(error) = self.start(saved.id(), world, map, ticket) {
            warn!(world_id, %error, "a saved world cannot be restored");
        }
    }

    /// Saves all worlds, if a folder is configured; with `is_last` the worlds end.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub async fn save_all(&self, is_last: bool) -> Result<(), SavedError> {
        let Some(folder) = self.shared.config.state.clone() else { return Ok(()) };
        let _saving = self.shared.saving.lock().await;
        let worlds = self.shared.worlds.read().expect(POISON).clone();
        let mut all = Vec::new();
        for WorldHandle { sim, ticket, map, .. } in worlds.into_values() {
            let level = self.shared.levels.name_of(map.hash()).unwrap_or_default();
            let source = tokio::task::spawn_blocking(move || SavedMap::of(&map, level));
            let Ok(source) = source.await else { continue };
            let saved = sim.call(move |state| {
                state.is_over |= is_last;
                state.world.save(ticket.client(), source)
            });
            // A world that does not answer was just dropped or is too busy; then its earlier save stays.
            all.extend(saved.await.ok());
        }
        let worlds = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            std::fs::create_dir_all(&folder).map_err(|error| SavedError::Io(folder.clone(), error))?;
            for saved in &all {
                saved.write(&folder)?;
                // The world may have been dropped meanwhile.
                if worlds.handle(saved.id()).is_err() {
                    SavedWorld::forget(&folder, saved.id())?;
                }
            }
            Ok(())
        });
        task.await.unwrap_or(Ok(()))
    }

    /// Saves all worlds periodically until the shutdown.
    pub async fn keep_saving(self) {
        let mut due = tokio::time::interval(self.shared.config.save_every);
        due.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = self.shared.shutdown.wait();
        tokio::pin!(stopping);
        // The first tick of an interval is due at once.
        due.tick().await;
        loop {
            tokio::select! {
                _ = due.tick() => {}
                () = &mut stopping => return,
            }
            if let Err(error) = self.save_all(false).await {
                warn!(%error, "worlds cannot be saved");
            }
        }
    }
}

/// Runs CPU work on a blocking thread; `what` names it in errors.
async fn in_background<T: Send + 'static>(
    what: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, WorldsError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| WorldsError::Lost(what, error))
}
