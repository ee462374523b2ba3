//! All worlds of a server: which there are, whose they are, how they come, go, and outlive the process.

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

/// Fractions of a period between worlds: consecutive multiples of the golden ratio spread evenly however many there are.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Why the server cannot do what a client asks of its worlds.
#[derive(Debug, thiserror::Error)]
pub enum WorldsError {
    /// There is no such world.
    #[error("world {0} does not exist")]
    UnknownWorld(WorldId),
    /// There are as many worlds as there may be.
    #[error("there are already {0} worlds, the most allowed (--max-worlds)")]
    TooManyWorlds(usize),
    /// The system has no thread for another world.
    #[error("no thread for another world: {0}")]
    NoThread(std::io::Error),
    /// The client has as many worlds as it may have.
    #[error("{0}")]
    WorldQuota(QuotaError),
    /// The client has as many NPCs as it may have.
    #[error("{0}")]
    NpcQuota(QuotaError),
    /// The world refuses.
    #[error(transparent)]
    Npc(#[from] NpcError),
    /// The world's thread does not answer.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// One item of many cannot be used: the field, and what is wrong with it.
    #[error("{1}")]
    BadItem(String, String),
    /// Work in the background ended without a result.
    #[error("{0} failed: {1}")]
    Lost(&'static str, tokio::task::JoinError),
}

/// A running world: how to reach its thread, and what never changes about it.
#[derive(Debug, Clone)]
pub struct WorldHandle {
    /// Its thread.
    pub sim: SimHandle,
    /// The map that the world stands on.
    pub map: Arc<Map>,
    /// How its time passes.
    pub mode: TimeMode,
    /// Its place in its client's quota.
    ticket: Arc<Ticket>,
}

/// A world for those who list them.
#[derive(Debug, Clone)]
pub struct WorldSummary {
    /// Identifies the world.
    pub id: WorldId,
    /// The map that the world stands on.
    pub map: Arc<Map>,
    /// How its time passes.
    pub mode: TimeMode,
    /// NPCs on it.
    pub npc_count: usize,
    /// Ticks stepped.
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
    /// One at a time: two would write the same files.
    saving: tokio::sync::Mutex<()>,
    shutdown: Shutdown,
}

const POISON: &str = "no holder of this lock panics";

impl Worlds {
    /// A server without worlds.
    pub fn new(config: ServerConfig, shutdown: Shutdown) -> Self {
        let shared = Shared {
            world_quota: Quota::new(
                config.max_worlds_per_client,
                "worlds, the most it may have (--max-worlds-per-client)",
            ),
            npc_quota: Quota::new(config.max_npcs_per_client, "NPCs, the most it may have (--max-npcs-per-client)"),
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

    /// Limits and sizes.
    pub fn config(&self) -> &ServerConfig {
        &self.shared.config
    }

    /// Maps that clients imported.
    pub fn levels(&self) -> &LevelStore {
        &self.shared.levels
    }

    /// Set when the server stops.
    pub fn shutdown(&self) -> &Shutdown {
        &self.shared.shutdown
    }

    // --- worlds ---

    /// Starts a world for `client`.
    ///
    /// # Errors
    /// If there are too many, or its map cannot be made.
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

    /// An id that no world of this or an earlier epoch has.
    async fn next_id(&self) -> WorldId {
        let earliest = WorldId::at(SystemTime::now()).0;
        let last = &self.shared.last_world;
        let next = |last: u64| earliest.max(last + 1);
        let before = last.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |last| Some(next(last)));
        let id = WorldId(next(before.unwrap_or_else(|last| last)));
        // Ids must not run ahead of the clock, or those of the next epoch could be the same.
        while WorldId::at(SystemTime::now()) < id {
            tokio::time::sleep(ID_PERIOD).await;
        }
        id
    }

    /// Changes whenever the server restarts, and only grows.
    pub fn epoch(&self) -> u64 {
        self.shared.epoch.0
    }

    /// Starts a world's thread and lists it.
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

    /// A running world.
    ///
    /// # Errors
    /// If there is none of that id.
    pub fn handle(&self, id: WorldId) -> Result<WorldHandle, WorldsError> {
        let worlds = self.shared.worlds.read().expect(POISON);
        worlds.get(&id).cloned().ok_or(WorldsError::UnknownWorld(id))
    }

    /// One world.
    ///
    /// # Errors
    /// If there is none of that id, or its thread does not answer.
    pub async fn describe(&self, id: WorldId) -> Result<WorldSummary, WorldsError> {
        let WorldHandle { sim, map, mode, .. } = self.handle(id)?;
        let (npc_count, tick) = sim.call(|state| (state.world.npc_count(), state.world.tick())).await?;
        Ok(WorldSummary { id, map, mode, npc_count, tick })
    }

    /// The ids of all worlds, in order.
    pub fn ids(&self) -> Vec<WorldId> {
        self.shared.worlds.read().expect(POISON).keys().copied().collect()
    }

    /// Ends a world and forgets what was saved of it.
    ///
    /// # Errors
    /// If there is none of that id, or its thread does not answer.
    pub async fn drop_world(&self, id: WorldId) -> Result<(), WorldsError> {
        let dropped = self.shared.worlds.write().expect(POISON).remove(&id);
        let handle = dropped.ok_or(WorldsError::UnknownWorld(id))?;
        handle.sim.call(|state| state.is_over = true).await?;
        if let Some(folder) = &self.shared.config.state
            && let Err(error) = SavedWorld::forget(folder, id)
        {
            warn!(world_id = id.0, %error, "a dropped world would come back");
        }
        info!(world_id = id.0, "world dropped");
        Ok(())
    }

    /// Ends all worlds.
    pub fn stop(&self) {
        let worlds = std::mem::take(&mut *self.shared.worlds.write().expect(POISON));
        for WorldHandle { sim, .. } in worlds.into_values() {
            // One that is too busy ends with its last handle.
            let _ = sim.cast(|state| state.is_over = true);
        }
    }

    fn sims(&self) -> Vec<SimHandle> {
        self.shared.worlds.read().expect(POISON).values().map(|handle| handle.sim.clone()).collect()
    }

    /// The Prometheus text.
    pub async fn metrics(&self) -> String {
        let mut worlds = Vec::new();
        for sim in self.sims() {
            // A world that cannot answer is absent.
            worlds.extend(sim.call(|state| WorldFigures::of(state)).await);
        }
        metrics::render(&worlds, &self.shared.registry.load())
    }

    // --- NPCs ---

    /// Adds an NPC for `client`.
    ///
    /// # Errors
    /// If there are too many, or the position lies outside the map.
    pub async fn spawn(&self, client: &str, world: WorldId, order: SpawnOrder) -> Result<NpcId, WorldsError> {
        self.spawn_many(client, world, vec![Ok(order)]).await?.pop().expect("one result for one order")
    }

    /// Adds NPCs for `client`, each with a result of its own.
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

    /// Runs `call` for each of the `items`, on the world that its NPC belongs to; the results in order. The items of one world are
    /// dealt with between two of its ticks.
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

    /// Places of a world where a character can stand.
    ///
    /// # Errors
    /// If there is no such world, or nowhere to stand.
    pub async fn sample_ground(&self, world: WorldId, count: usize, seed: Seed) -> Result<Vec<Vec3>, WorldsError> {
        let map = self.handle(world)?.map;
        Ok(in_background("sampling", move || HostedWorld::sample_ground(&map, count, seed)).await??)
    }

    // --- workers ---

    /// Lets a worker join: `queue` gets its welcome, then what it is to do.
    pub fn join(&self, hello: Hello, queue: mpsc::Sender<ToWorker>) -> Joined {
        info!(name = hello.name, policy = hello.policy, capacity = hello.capacity, "worker joins");
        let joined = self.shared.registry.join(hello.name, hello.policy, hello.capacity, queue.clone());
        // The queue is new and empty.
        let _ = queue.try_send(ToWorker::Welcome(joined.id));
        self.cast_all(HostedWorld::rebalance);
        joined
    }

    /// Hands the NPCs of a worker that is gone to others.
    pub fn leave(&self, worker: WorkerId) {
        info!(worker = worker.0, "worker left");
        self.shared.registry.leave(worker);
        self.cast_all(move |world| world.lose_worker(worker));
    }

    /// Hands a worker's answer to its world.
    ///
    /// # Errors
    /// If the world's thread does not take it.
    pub fn answer(&self, worker: WorkerId, world: WorldId, answer: Answer) -> Result<(), SimError> {
        // A world that has just been dropped needs no answers any more.
        let Ok(handle) = self.handle(world) else { return Ok(()) };
        handle.sim.cast(move |state| state.world.answer(worker, answer))
    }

    /// Runs `call` on every world; one that is too busy is left out, and looks for workers by itself soon.
    fn cast_all(&self, call: impl Fn(&mut HostedWorld) + Clone + Send + 'static) {
        for sim in self.sims() {
            let call = call.clone();
            if let Err(error) = sim.cast(move |state| call(&mut state.world)) {
                warn!(%error, "a world did not take a call");
            }
        }
    }

    // --- what outlives the process ---

    /// Restores saved worlds. One that is damaged is named and left where it is.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub async fn restore_all(&self) -> Result<(), SavedError> {
        let Some(folder) = self.shared.config.state.clone() else { return Ok(()) };
        for saved in SavedWorld::read_all(&folder)? {
            let restored = saved.and_then(|saved| {
                // Also the id of one that cannot be restored now is not given to another.
                self.shared.last_world.fetch_max(saved.id().0, Ordering::Relaxed);
                let map = saved.map()?;
                Ok((saved, map))
            });
            match restored {
                Ok((saved, map)) => self.restore(&saved, map),
                Err(error) => warn!(%error, "a saved world is not restored"),
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
            warn!(world_id, %error, "no planner will get its map");
        }
        if let Err(error) = self.start(saved.id(), world, map, ticket) {
            warn!(world_id, %error, "a saved world is not restored");
        }
    }

    /// Saves all worlds, where the configuration says so; with `is_last` they end.
    ///
    /// # Errors
    /// If they cannot be saved.
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
            // A world that does not answer was just dropped, or is too busy: then what was saved before stays.
            all.extend(saved.await.ok());
        }
        let worlds = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            std::fs::create_dir_all(&folder).map_err(|error| SavedError::Io(folder.clone(), error))?;
            for saved in &all {
                saved.write(&folder)?;
                // It may have been dropped meanwhile.
                if worlds.handle(saved.id()).is_err() {
                    SavedWorld::forget(&folder, saved.id())?;
                }
            }
            Ok(())
        });
        task.await.unwrap_or(Ok(()))
    }

    /// Saves all worlds again and again until the shutdown.
    pub async fn keep_saving(self) {
        let mut due = tokio::time::interval(self.shared.config.save_every);
        due.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = self.shared.shutdown.wait();
        tokio::pin!(stopping);
        // The first is due at once.
        due.tick().await;
        loop {
            tokio::select! {
                _ = due.tick() => {}
                () = &mut stopping => return,
            }
            if let Err(error) = self.save_all(false).await {
                warn!(%error, "worlds are not saved");
            }
        }
    }
}

/// Runs CPU work on a thread of its own.
async fn in_background<T: Send + 'static>(
    what: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, WorldsError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| WorldsError::Lost(what, error))
}
