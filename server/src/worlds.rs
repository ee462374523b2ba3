//! All worlds of a server: their owners and lifecycle, and calls to them. `keeping` has how they outlive the process.

mod keeping;

use crate::ServerConfig;
use crate::errors::SimError;
use crate::hosted::{EditError, HostedWorld, NpcError, SpawnOrder, TimeMode};
use crate::ids::{ID_PERIOD, NpcId, WorkerId, WorldId};
use crate::messages::{Answer, Hello, ToWorker};
use crate::metrics::{self, ProcessFigures, WorldFigures};
use crate::quota::{Quota, QuotaError, Ticket};
use crate::registry::{Joined, Registry};
use crate::sim::{Receipt, Schedule, SimHandle, SimState};
use crate::store::{SharedStore, StoreError, WorldStore};
use crate::survey::Survey;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock, RwLock};
use std::time::{Duration, SystemTime};
use surefoot_net::levels::{LevelStore, MapError, MapPool, MapSource, SharedMap};
use surefoot_net::serving::{Caller, Shutdown};
use surefoot_world::{CharacterProfile, Map, Seed, Tick, Vec3};
use tokio::sync::{Semaphore, mpsc};
use tokio::time::Instant;
use tracing::{info, warn};

/// Longest wait for the clock to reach a new id: far more than the ids that are created in a burst.
const MAX_ID_WAIT: Duration = Duration::from_secs(1);
/// Longest wait until a change is durable in a fleet.
const CONFIRM_LIMIT: Duration = Duration::from_secs(5);

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
    /// The world belongs to another client.
    #[error("world {0} belongs to another client")]
    NotOwner(WorldId),
    /// The world refuses.
    #[error(transparent)]
    Npc(#[from] NpcError),
    /// The world's thread does not accept the call.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// An item of a batch is invalid: the field, and what is wrong with it.
    #[error("{1}")]
    BadItem(String, String),
    /// There is no map for it.
    #[error(transparent)]
    Map(#[from] MapError),
    /// Its map cannot be edited.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// What is saved cannot be changed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The server may have lost its worlds to others.
    #[error("world {0} may be moving to another server: look where it runs, and try again")]
    Moving(WorldId),
    /// A change was made, and is not known to be durable.
    #[error(
        "world {0} has made the change, but the record of the fleet does not answer: it may be lost with this server"
    )]
    Unconfirmed(WorldId),
    /// Work in the background ended without a result.
    #[error("{0} failed: {1}")]
    Lost(&'static str, tokio::task::JoinError),
}

/// A running world: the handle to its thread, and its constant properties.
#[derive(Debug, Clone)]
pub struct WorldHandle {
    /// Handle to the world's thread.
    pub sim: SimHandle,
    /// The map of the world.
    pub shown: ShownMap,
    /// How the world's time passes.
    pub mode: TimeMode,
    /// When within a period its ticks are due, in [0, 1).
    phase: f64,
    /// Usual body of its NPCs.
    pub body: CharacterProfile,
    /// The world's place in its client's quota.
    ticket: Arc<Ticket>,
    /// What the map takes of the memory budget.
    _memory: Arc<SharedMap>,
    /// Nothing of it is to be saved any more. Locked while it is saved.
    is_dropped: Arc<tokio::sync::Mutex<bool>>,
}

/// The map of a running world, for those who only look at it.
#[derive(Debug, Clone)]
pub struct ShownMap(Arc<RwLock<Arc<Map>>>);

impl ShownMap {
    fn new(map: Arc<Map>) -> Self {
        Self(Arc::new(RwLock::new(map)))
    }

    /// The map as it is now.
    pub fn get(&self) -> Arc<Map> {
        self.0.read().expect(POISON).clone()
    }

    /// Shows another map from now on. Called on the world's thread, so that the last edit stays.
    pub fn show(&self, map: &Arc<Map>) {
        *self.0.write().expect(POISON) = map.clone();
    }
}

/// What a caller wants of an NPC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NpcAccess {
    /// Its state: anybody may.
    Read,
    /// To change it: whoever spawned it, the owner of its world, or an admin may.
    Change,
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
    /// Bodies that its NPCs have or had, the usual one first.
    pub bodies: Vec<CharacterProfile>,
    /// Whether its NPCs get in each other's way.
    pub solid_npcs: bool,
}

/// What a new world is like, beside its map.
#[derive(Debug, Clone)]
pub struct WorldSettings {
    /// How its time passes.
    pub mode: TimeMode,
    /// The usual body of its NPCs.
    pub body: CharacterProfile,
    /// Whether they get in each other's way.
    pub solid_npcs: bool,
}

/// All worlds; clones share them.
#[derive(Debug, Clone)]
pub struct Worlds {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    config: ServerConfig,
    /// When the ticks of all worlds began.
    started: std::time::Instant,
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
    /// Where worlds are saved.
    store: OnceLock<Arc<dyn WorldStore>>,
    /// Worlds that panicked.
    failed_count: AtomicU64,
    /// Times that a world could not be saved.
    failed_save_count: AtomicU64,
    /// Worlds that were taken over from other servers of the fleet.
    taken_over_count: AtomicU64,
    /// Bounds the surveys that run at a time.
    surveying: Arc<Semaphore>,
    shutdown: Shutdown,
}

const POISON: &str = "no holder of this lock panics";

impl Worlds {
    /// Creates a server without worlds.
    pub fn new(config: ServerConfig, shutdown: Shutdown) -> Self {
        let shared = Shared {
            started: std::time::Instant::now(),
            world_quota: Quota::new(
                config.max_worlds_per_client,
                "worlds, the most it may have (--max-worlds-per-client)",
            ),
            npc_quota: Quota::new(config.max_npcs_per_client, "NPCs, the most it may have (--max-npcs-per-client)"),
            levels: LevelStore::new(config.max_maps, config.maps.memory().clone()),
            config,
            worlds: RwLock::default(),
            last_world: AtomicU64::new(0),
            epoch: WorldId::at(SystemTime::now()),
            registry: Arc::default(),
            saving: tokio::sync::Mutex::default(),
            surveying: Arc::new(Semaphore::new(1)),
            store: OnceLock::new(),
            failed_count: AtomicU64::new(0),
            failed_save_count: AtomicU64::new(0),
            taken_over_count: AtomicU64::new(0),
            shutdown,
        };
        Self { shared: Arc::new(shared) }
    }

    /// Returns the configuration of the server.
    pub fn config(&self) -> &ServerConfig {
        &self.shared.config
    }

    /// Maps in use, and the memory that they take.
    pub fn maps(&self) -> &MapPool {
        &self.shared.config.maps
    }

    /// Maps that clients imported.
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
    /// If there are too many, or its map cannot be made.
    pub async fn create(
        &self,
        caller: &Caller,
        source: MapSource,
        WorldSettings { mode, body, solid_npcs }: WorldSettings,
    ) -> Result<WorldSummary, WorldsError> {
        let limit = self.shared.config.max_worlds;
        if self.shared.worlds.read().expect(POISON).len() >= limit {
            return Err(WorldsError::TooManyWorlds(limit));
        }
        let ticket = self.shared.world_quota.acquire(&caller.name).map_err(WorldsError::WorldQuota)?;
        let made = self.maps().get(&caller.name, source.made()).await?;
        let id = self.next_id().await?;
        let map = {
            let made = made.clone();
            in_background("putting pieces onto a map", move || source.finish(made.map())).await?
        };
        let map_hash = map.hash();
        let world = HostedWorld::new(id, map, mode, self.shared.registry.clone())
            .with_bodies(vec![body])
            .with_solid_npcs(solid_npcs);
        self.start(id, world, (made, ticket), limit)?;
        self.keep_new(id).await?;
        info!(world_id = id.0, map = %map_hash, ?mode, client = &*caller.name, "world created");
        self.describe(caller, id).await
    }

    /// Returns an id that no world of this or an earlier epoch has had.
    async fn next_id(&self) -> Result<WorldId, StoreError> {
        if let Some(shared) = self.shared_store() {
            return shared.new_id(WorldId::at(SystemTime::now())).await;
        }
        let earliest = WorldId::at(SystemTime::now()).0;
        let last = &self.shared.last_world;
        let next = |last: u64| earliest.max(last + 1);
        let before = last.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |last| Some(next(last)));
        let id = WorldId(next(before.unwrap_or_else(|last| last)));
        // Ids must not run ahead of the clock, or the next epoch could assign the same ones. Those of restored worlds do, if the clock
        // was set back: there is no waiting for these, because the next epoch restores them too.
        let enough = Instant::now() + MAX_ID_WAIT;
        while WorldId::at(SystemTime::now()) < id && Instant::now() < enough {
            tokio::time::sleep(ID_PERIOD).await;
        }
        Ok(id)
    }

    /// Returns the epoch, which is greater after every restart of the server.
    pub fn epoch(&self) -> u64 {
        self.shared.epoch.0
    }

    /// Starts a world's thread and lists it, unless there are `limit` worlds; `made` is its map without pieces.
    fn start(
        &self,
        id: WorldId,
        mut world: HostedWorld,
        (made, ticket): (Arc<SharedMap>, Ticket),
        limit: usize,
    ) -> Result<(), WorldsError> {
        let (mode, body, map) = (world.mode(), world.bodies()[0].clone(), world.map().clone());
        if self.shared_store().is_some() {
            world.await_confirmation();
        }
        let mut worlds = self.shared.worlds.write().expect(POISON);
        if worlds.len() >= limit {
            return Err(WorldsError::TooManyWorlds(limit));
        }
        let taken = worlds.values().filter(|world| world.mode == TimeMode::Realtime).map(|world| world.phase);
        let schedule = Schedule { epoch: self.shared.started, phase: Schedule::free_phase(taken) };
        let failed = {
            let shared = Arc::downgrade(&self.shared);
            move || {
                let Some(shared) = shared.upgrade() else { return };
                shared.failed_count.fetch_add(1, Ordering::Relaxed);
                // What was saved of it stays: it is restored when the server starts the next time.
                shared.worlds.write().expect(POISON).remove(&id);
            }
        };
        let sim = SimHandle::start(format!("world-{id}"), world, schedule, failed).map_err(WorldsError::NoThread)?;
        worlds.insert(
            id,
            WorldHandle {
                sim,
                shown: ShownMap::new(map),
                _memory: made,
                mode,
                phase: schedule.phase,
                body,
                ticket: Arc::new(ticket),
                is_dropped: Arc::default(),
            },
        );
        Ok(())
    }

    /// Returns the handle of a running world.
    ///
    /// # Errors
    /// If no world has this id, or this server may have lost it to another.
    pub fn handle(&self, id: WorldId) -> Result<WorldHandle, WorldsError> {
        if self.shared_store().is_some_and(|shared| !shared.is_sure()) {
            return Err(WorldsError::Moving(id));
        }
        let worlds = self.shared.worlds.read().expect(POISON);
        worlds.get(&id).cloned().ok_or(WorldsError::UnknownWorld(id))
    }

    /// A running world, with the caller's lane to its thread.
    ///
    /// # Errors
    /// If there is none of that id.
    pub fn handle_for(&self, caller: &Caller, id: WorldId) -> Result<WorldHandle, WorldsError> {
        let handle = self.handle(id)?;
        Ok(WorldHandle { sim: handle.sim.for_client(&caller.name), ..handle })
    }

    /// Access to a world to which the caller may add: its own, or, for designers, any.
    ///
    /// # Errors
    /// If there is none of that id, or it belongs to somebody else.
    pub fn handle_to_change(&self, caller: &Caller, id: WorldId) -> Result<WorldHandle, WorldsError> {
        let handle = self.handle_for(caller, id)?;
        if caller.may_add_to(handle.ticket.client()) { Ok(handle) } else { Err(WorldsError::NotOwner(id)) }
    }

    /// One world.
    ///
    /// # Errors
    /// If there is none of that id, or its thread does not answer.
    pub async fn describe(&self, caller: &Caller, id: WorldId) -> Result<WorldSummary, WorldsError> {
        let WorldHandle { sim, mode, .. } = self.handle_for(caller, id)?;
        let describe = move |SimState { world, .. }: &mut SimState| WorldSummary {
            id,
            map: world.map().clone(),
            mode,
            npc_count: world.npc_count(),
            tick: world.tick(),
            bodies: world.bodies().to_vec(),
            solid_npcs: world.has_solid_npcs(),
        };
        Ok(sim.call(describe).await?)
    }

    /// Returns the ids of all worlds in ascending order.
    pub fn ids(&self) -> Vec<WorldId> {
        self.shared.worlds.read().expect(POISON).keys().copied().collect()
    }

    /// Ends a world and deletes what was saved of it, also if its thread is busy.
    ///
    /// # Errors
    /// If there is none of that id, it belongs to somebody else, or its file cannot be deleted; then the world goes on.
    pub async fn drop_world(&self, caller: &Caller, id: WorldId) -> Result<(), WorldsError> {
        let handle = self.handle(id)?;
        if !caller.may_change(handle.ticket.client()) {
            return Err(WorldsError::NotOwner(id));
        }
        if let Some(store) = self.store().cloned() {
            let is_dropped = handle.is_dropped.clone();
            let forget = async move {
                // Whoever saves the world just now finishes first, and nobody saves it any more.
                let mut is_dropped = is_dropped.lock().await;
                store.forget(id).await?;
                *is_dropped = true;
                Ok::<(), StoreError>(())
            };
            // Goes on if the client disconnects.
            let forgotten = tokio::spawn(forget).await;
            forgotten.map_err(|error| WorldsError::Lost("dropping a world", error))??;
        }
        let dropped = self.shared.worlds.write().expect(POISON).remove(&id);
        // In a fleet, it goes as well when what happened in it cannot be recorded any more, because it is forgotten.
        if dropped.is_none() && self.shared_store().is_none() {
            return Err(WorldsError::UnknownWorld(id));
        }
        // A thread that takes no more calls ends with the last handle.
        let _ = handle.sim.cast(|state| state.is_over = true);
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
        self.running().into_values().collect()
    }

    /// Handles to the threads of all worlds.
    pub(crate) fn running(&self) -> BTreeMap<WorldId, SimHandle> {
        self.shared.worlds.read().expect(POISON).iter().map(|(&id, handle)| (id, handle.sim.clone())).collect()
    }

    /// Renders the metrics of the server as Prometheus text.
    pub async fn metrics(&self) -> String {
        let mut worlds = Vec::new();
        for sim in self.sims() {
            // A world that does not answer is left out.
            worlds.extend(sim.call(|state| WorldFigures::of(state)).await);
        }
        let process = ProcessFigures {
            failed_worlds: self.shared.failed_count.load(Ordering::Relaxed),
            failed_saves: self.shared.failed_save_count.load(Ordering::Relaxed),
            memory_bytes: self.maps().memory().used_bytes(),
            is_sure: self.shared_store().is_none_or(SharedStore::is_sure),
            taken_over: self.shared.taken_over_count.load(Ordering::Relaxed),
        };
        metrics::render(&worlds, &self.shared.registry.load(), process)
    }

    // --- NPCs ---

    /// Adds an NPC for the caller.
    ///
    /// # Errors
    /// If there are too many, or the position lies outside the map.
    pub async fn spawn(&self, caller: &Caller, world: WorldId, order: SpawnOrder) -> Result<NpcId, WorldsError> {
        self.spawn_many(caller, world, vec![Ok(order)]).await?.pop().expect("one result for one order")
    }

    /// Adds NPCs for the caller, each with a result of its own.
    ///
    /// # Errors
    /// If there is no such world, it belongs to somebody else, or its thread does not answer.
    pub async fn spawn_many(
        &self,
        caller: &Caller,
        world: WorldId,
        orders: Vec<Result<SpawnOrder, WorldsError>>,
    ) -> Result<Vec<Result<NpcId, WorldsError>>, WorldsError> {
        let handle = self.handle_to_change(caller, world)?;
        let limit = self.shared.config.max_npcs_per_world;
        let take = |order| Ok((order?, self.shared.npc_quota.acquire(&caller.name).map_err(WorldsError::NpcQuota)?));
        let orders: Vec<Result<_, WorldsError>> = orders.into_iter().map(take).collect();
        let spawn = handle.sim.call(move |state| {
            let mut spawn = |(order, ticket)| Ok(state.world.spawn_to(order, limit, ticket)?);
            let results = orders.into_iter().map(|order| order.and_then(&mut spawn)).collect();
            (results, state.receipt())
        });
        let (results, receipt) = spawn.await?;
        confirmed(world, receipt).await?;
        Ok(results)
    }

    /// Runs `call` for each of the `items`, on the world that its NPC belongs to; the results in order. The items of one world are
    /// handled between two of its ticks.
    pub async fn with_npcs<T: Send + 'static, R: Send + 'static>(
        &self,
        caller: &Caller,
        access: NpcAccess,
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
            let done = match self.handle_for(caller, world) {
                Ok(handle) => {
                    let may_change_all = access == NpcAccess::Read || caller.may_change(handle.ticket.client());
                    let caller = caller.clone();
                    let work = move |state: &mut SimState| -> (Vec<_>, Option<Receipt>) {
                        let world = &mut state.world;
                        let one = |(_, npc, item)| {
                            if !may_change_all && !caller.may_change(world.owner_of(npc)?) {
                                return Err(NpcError::NotOwner(npc));
                            }
                            call(world, npc, item)
                        };
                        let done = items.into_iter().map(one).collect();
                        (done, if access == NpcAccess::Change { state.receipt() } else { None })
                    };
                    handle.sim.call(work).await
                }
                Err(WorldsError::Moving(_)) => {
                    places.into_iter().for_each(|(idx, _)| results[idx] = Some(Err(WorldsError::Moving(world))));
                    continue;
                }
                Err(_) => Ok((places.iter().map(|(_, npc)| Err(NpcError::Unknown(*npc))).collect(), None)),
            };
            match done {
                Ok((done, receipt)) => {
                    let is_confirmed = confirmed(world, receipt).await.is_ok();
                    for ((idx, _), result) in places.into_iter().zip(done) {
                        let result = result.map_err(WorldsError::from);
                        let result =
                            result.and_then(|it| is_confirmed.then_some(it).ok_or(WorldsError::Unconfirmed(world)));
                        results[idx] = Some(result);
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
        caller: &Caller,
        access: NpcAccess,
        npc: NpcId,
        call: impl Fn(&mut HostedWorld) -> Result<R, NpcError> + Clone + Send + 'static,
    ) -> Result<R, WorldsError> {
        let call = move |world: &mut HostedWorld, _, ()| call(world);
        self.with_npcs(caller, access, vec![Ok((npc, ()))], call).await.pop().expect("one result for one item")
    }

    /// Draws `count` random places of a world where a character can stand.
    ///
    /// # Errors
    /// If there is no such world, or its map has no navigable ground.
    pub async fn sample_ground(
        &self,
        world: WorldId,
        body: Option<CharacterProfile>,
        count: usize,
        seed: Seed,
    ) -> Result<Vec<Vec3>, WorldsError> {
        let WorldHandle { shown, body: usual, .. } = self.handle(world)?;
        let (map, body) = (shown.get(), body.unwrap_or(usual));
        Ok(in_background("sampling", move || HostedWorld::sample_ground(&map, &body, count, seed)).await??)
    }

    /// Surveys a map for each of these bodies, and lists at most `max_cut_off` places that each cannot get to. One survey runs at a time; it
    /// goes on when its caller is gone.
    ///
    /// # Errors
    /// If the map cannot be made.
    pub async fn survey(
        &self,
        caller: &Caller,
        source: MapSource,
        bodies: Vec<CharacterProfile>,
        max_cut_off: usize,
    ) -> Result<Vec<Survey>, WorldsError> {
        // Never closed.
        let turn = self.shared.surveying.clone().acquire_owned().await.ok();
        let made = self.maps().get(&caller.name, source.made()).await?;
        let survey = move || {
            let _turn = turn;
            let map = source.finish(made.map());
            bodies.into_iter().map(|body| Survey::of(&map, body, max_cut_off)).collect()
        };
        in_background("surveying", survey).await
    }

    // --- workers ---

    /// Adds a worker; `queue` receives the welcome, then all other messages to the worker.
    pub fn join(&self, hello: Hello, queue: mpsc::Sender<ToWorker>) -> Joined {
        info!(name = hello.name, policy = hello.policy, capacity = hello.capacity, "worker joined");
        let joined = self.shared.registry.join(hello, queue.clone());
        // The queue is new and empty.
        let _ = queue.try_send(ToWorker::Welcome(joined.id));
        self.cast_all(HostedWorld::rebalance);
        joined
    }

    /// Changes how many NPCs a worker can decide for. Worlds use what is added at once.
    pub fn set_capacity(&self, worker: WorkerId, capacity: u32) {
        if self.shared.registry.set_capacity(worker, capacity) {
            self.cast_all(HostedWorld::assign_workers);
        }
    }

    /// Removes a worker and assigns its NPCs to others.
    pub fn leave(&self, worker: WorkerId) {
        info!(worker = worker.0, "worker left");
        self.shared.registry.leave(worker);
        self.cast_all(move |world| world.lose_worker(worker));
    }

    /// Hands a worker's answer to its world. A world that cannot take it counts the decisions as missed; other worlds of the worker
    /// are not affected.
    pub fn answer(&self, worker: WorkerId, world: WorldId, answer: Answer) {
        // A world that has just been dropped needs no answers any more.
        let Ok(handle) = self.handle(world) else { return };
        if let Err(error) = handle.sim.cast(move |state| state.world.answer(worker, answer)) {
            warn!(worker = worker.0, world_id = world.0, %error, "an answer is lost");
        }
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
}

/// Waits until a change is durable, where the servers of a fleet have to know it.
async fn confirmed(world: WorldId, receipt: Option<Receipt>) -> Result<(), WorldsError> {
    let Some(receipt) = receipt else { return Ok(()) };
    match tokio::time::timeout(CONFIRM_LIMIT, receipt.confirmed()).await {
        Ok(Ok(())) => Ok(()),
        // The world ended, or nobody answers.
        Ok(Err(_)) | Err(_) => Err(WorldsError::Unconfirmed(world)),
    }
}

/// Runs CPU work on a thread of its own.
pub(crate) async fn in_background<T: Send + 'static>(
    what: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, WorldsError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| WorldsError::Lost(what, error))
}
