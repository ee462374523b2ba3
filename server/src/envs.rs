//! Environments of remote trainers: creating, stepping and closing them, and removing idle ones.

use crate::quota::{Quota, QuotaError, Ticket};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::{self, Arc, TryLockError};
use std::time::{Duration, Instant, SystemTime};
use surefoot_net::levels::{BaseMap, MapError, MapPool, SharedMap};
use surefoot_net::memory::{DEFAULT_MAX_MEMORY_BYTES, MemoryBudget, MemoryError, Reservation};
use surefoot_net::serving::Caller;
use surefoot_rollout::env::{Ended, Env, Episodes, Route};
use surefoot_world::navigable::NoGround;
use surefoot_world::{Ability, Action, CharacterProfile, Vec3};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::interval;
use tracing::info;

/// Default time after which an unused environment is removed.
pub const IDLE_LIMIT: Duration = Duration::from_secs(600);
/// Longest time between two removals of idle environments.
const SWEEP_EVERY: Duration = Duration::from_secs(60);
/// Bytes of an NPC: its state, its observation and a copy of it for the trainer, and a route of the greatest length.
const NPC_BYTES: u64 = 8192;

/// Why an environment cannot be created, stepped or closed.
#[derive(Debug, thiserror::Error)]
pub enum EnvError {
    #[error("environment {0} does not exist")]
    Unknown(EnvId),
    #[error("there are already {0} environments, the most allowed (--max-envs): close one")]
    TooMany(usize),
    #[error("{0}: close one")]
    Quota(QuotaError),
    #[error("another step of environment {0} is running")]
    Busy(EnvId),
    #[error("environment {0} belongs to another client")]
    NotOwner(EnvId),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Memory(#[from] MemoryError),
    #[error("environment {0} has failed: close it and create another")]
    Failed(EnvId),
    #[error(transparent)]
    NoGround(#[from] NoGround),
    #[error("map is missing")]
    NoMap,
    #[error("the game could not create an environment: {0}")]
    Host(String),
    #[error("{0}")]
    Gone(String),
    #[error("the environment failed: {0}")]
    Lost(#[from] tokio::task::JoinError),
}

/// Id of an environment on this server; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EnvId(pub u64);

impl std::fmt::Display for EnvId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// A game that runs environments in its own physics.
pub trait Host: Send + Sync + std::fmt::Debug {
    /// Creates an environment of the level that the game runs. Called on a blocking thread. The error is a sentence
    /// with the reason.
    fn open(&self, body: &CharacterProfile, solid_npcs: bool, episodes: Episodes) -> Result<Env, String>;
}

/// The simulation that environments run in.
#[derive(Debug, Clone)]
pub enum EnvBackend {
    /// Surefoot's worlds, on these maps.
    Maps(MapPool),
    /// A game.
    Game(Arc<dyn Host>),
}

/// Settings of a new environment.
#[derive(Debug, Clone)]
pub struct EnvSettings {
    /// Source of the map; `None` for a game's own level.
    pub source: Option<BaseMap>,
    pub body: CharacterProfile,
    /// Whether the NPCs collide with and see each other.
    pub solid_npcs: bool,
    pub episodes: Episodes,
}

/// State of an environment before its first step.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstState {
    pub observations: Vec<f32>,
    /// Feet of the NPCs, m.
    pub positions: Vec<Vec3>,
}

/// Result of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResults {
    pub observations: Vec<f32>,
    /// One reward for each NPC.
    pub rewards: Vec<f32>,
    /// Episodes that ended in this step.
    pub ended: Vec<Ended>,
    /// Feet of the NPCs, m.
    pub positions: Vec<Vec3>,
    /// The most demanding ability that each NPC used.
    pub abilities: Vec<Ability>,
    /// Number of waypoints of its route that each NPC has passed.
    pub passed: Vec<u32>,
}

/// An environment and the time of its last use.
#[derive(Debug)]
struct Kept {
    /// A lock with poisoning: an environment whose step panicked must not be used again.
    env: sync::Mutex<Env>,
    used: Mutex<Instant>,
    /// Its place in its client's quota.
    ticket: Ticket,
    /// Its place among all environments.
    _place: OwnedSemaphorePermit,
    _memory: Option<(Arc<SharedMap>, Reservation)>,
}

impl Kept {
    /// The environment, unless it is being stepped or a step has panicked.
    fn lock(&self, id: EnvId) -> Result<sync::MutexGuard<'_, Env>, EnvError> {
        self.env.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => EnvError::Busy(id),
            TryLockError::Poisoned(_) => EnvError::Failed(id),
        })
    }
}

/// All environments; clones share them.
#[derive(Debug, Clone)]
pub struct Envs {
    limit: usize,
    places: Arc<Semaphore>,
    quota: Arc<Quota>,
    idle_limit: Duration,
    backend: EnvBackend,
    memory: MemoryBudget,
    inner: Arc<Mutex<Inner>>,
}

#[derive(Debug, Default)]
struct Inner {
    last_id: u64,
    by_id: BTreeMap<EnvId, Arc<Kept>>,
}

impl Envs {
    /// At most `limit` environments at a time, and `limit_per_client` of each client. Environments that are not used
    /// for `idle_limit` are removed.
    pub fn new(limit: usize, limit_per_client: usize, idle_limit: Duration, backend: EnvBackend) -> Self {
        let memory = match &backend {
            EnvBackend::Maps(maps) => maps.memory().clone(),
            // The game has its own memory; this budget is for kept answers.
            EnvBackend::Game(_) => MemoryBudget::new(DEFAULT_MAX_MEMORY_BYTES),
        };
        let what = "environments, the most it may have (--max-envs-per-client)";
        let (places, quota) =
            (Arc::new(Semaphore::new(limit.min(Semaphore::MAX_PERMITS))), Quota::new(limit_per_client, what));
        Self { limit, places, quota, idle_limit, backend, memory, inner: Arc::default() }
    }

    pub fn memory(&self) -> &MemoryBudget {
        &self.memory
    }

    fn find(&self, caller: &Caller, id: EnvId) -> Result<Arc<Kept>, EnvError> {
        let kept = self.inner.lock().by_id.get(&id).cloned().ok_or(EnvError::Unknown(id))?;
        if !caller.may_change(kept.ticket.client()) {
            return Err(EnvError::NotOwner(id));
        }
        *kept.used.lock() = Instant::now();
        Ok(kept)
    }

    pub fn npc_count(&self, caller: &Caller, id: EnvId) -> Result<usize, EnvError> {
        let kept = self.find(caller, id)?;
        Ok(kept.lock(id)?.npc_count())
    }

    /// Creates an environment; returns its id and its first state.
    pub async fn create(&self, caller: &Caller, settings: EnvSettings) -> Result<(EnvId, FirstState), EnvError> {
        self.sweep();
        let place = self.places.clone().try_acquire_owned().map_err(|_| EnvError::TooMany(self.limit))?;
        let ticket = self.quota.acquire(&caller.name).map_err(EnvError::Quota)?;
        let (env, memory) = self.make(caller, settings).await?;
        let first = FirstState { observations: env.observations().to_vec(), positions: env.positions().collect() };
        let (env, used) = (sync::Mutex::new(env), Mutex::new(Instant::now()));
        let kept = Arc::new(Kept { env, used, ticket, _place: place, _memory: memory });
        // Microseconds: unique across restarts of the server.
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_micros() as u64;
        let mut inner = self.inner.lock();
        inner.last_id = now.max(inner.last_id + 1);
        let id = EnvId(inner.last_id);
        inner.by_id.insert(id, kept);
        Ok((id, first))
    }

    /// Makes an environment, with its reservation if it runs here.
    async fn make(
        &self,
        caller: &Caller,
        EnvSettings { source, body, solid_npcs, episodes }: EnvSettings,
    ) -> Result<(Env, Option<(Arc<SharedMap>, Reservation)>), EnvError> {
        match (&self.backend, source) {
            (EnvBackend::Maps(maps), Some(source)) => {
                let memory = maps.memory().reserve(&caller.name, episodes.npc_count() as u64 * NPC_BYTES)?;
                let shared = maps.get(&caller.name, &source).await?;
                let map = shared.map().clone();
                let env = tokio::task::spawn_blocking(move || Env::new(map, body, solid_npcs, episodes)).await??;
                Ok((env, Some((shared, memory))))
            }
            (EnvBackend::Maps(_), None) => Err(EnvError::NoMap),
            (EnvBackend::Game(host), _) => {
                let host = host.clone();
                let opened = tokio::task::spawn_blocking(move || host.open(&body, solid_npcs, episodes)).await?;
                Ok((opened.map_err(EnvError::Host)?, None))
            }
        }
    }

    /// Removes idle environments each minute, without end.
    pub async fn keep_sweeping(self) {
        let mut due = interval(self.idle_limit.clamp(Duration::from_millis(1), SWEEP_EVERY));
        loop {
            due.tick().await;
            self.sweep();
        }
    }

    fn sweep(&self) {
        let is_idle = |_: &EnvId, kept: &mut Arc<Kept>| kept.used.lock().elapsed() >= self.idle_limit;
        // Maps are dropped without the lock.
        let idle: Vec<_> = self.inner.lock().by_id.extract_if(.., is_idle).collect();
        for (id, kept) in idle {
            info!(env_id = id.0, client = kept.ticket.client(), "removed an idle environment");
        }
    }

    /// Steps each NPC by one decision; `actions` has one action for each NPC. `routes` apply after the step. Panics if
    /// there is not one action for each NPC, or a route is of an NPC that does not exist.
    pub async fn step(
        &self,
        caller: &Caller,
        id: EnvId,
        (actions, routes): (Vec<Action>, Vec<Route>),
    ) -> Result<StepResults, EnvError> {
        let kept = self.find(caller, id)?;
        let task = tokio::task::spawn_blocking(move || {
            let mut env = kept.lock(id)?;
            let ended = env.step_and_redirect(&actions, &routes);
            if let Some(reason) = env.failure() {
                return Err(EnvError::Gone(reason.to_owned()));
            }
            Ok(StepResults {
                observations: env.observations().to_vec(),
                rewards: env.rewards().to_vec(),
                ended,
                positions: env.positions().collect(),
                abilities: env.abilities().to_vec(),
                passed: env.passed().collect(),
            })
        });
        task.await?
    }

    pub fn close(&self, caller: &Caller, id: EnvId) -> Result<(), EnvError> {
        self.find(caller, id)?;
        // The map is dropped without the lock.
        let closed = self.inner.lock().by_id.remove(&id);
        closed.map(drop).ok_or(EnvError::Unknown(id))
    }
}
