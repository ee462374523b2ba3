//! Environments of remote trainers: which there are, and when they make room for others.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use surefoot_net::levels::{MapError, MapPool, MapSource, SharedMap};
use surefoot_net::memory::{MemoryError, Reservation};
use surefoot_net::serving::Caller;
use surefoot_rollout::env::{Ended, Env};
use surefoot_world::navigable::NoGround;
use surefoot_world::{Action, MapSpec, Seed};

/// After so long without a step an environment makes room for others.
const IDLE_LIMIT: Duration = Duration::from_secs(600);
/// Bytes of an NPC: its state, its observation, and a copy of that for whoever steps it.
const NPC_BYTES: u64 = 4096;
const POISON: &str = "no holder of this lock panics";

/// Why there is no environment, or no step of it.
#[derive(Debug, thiserror::Error)]
pub enum EnvError {
    /// There is no such environment.
    #[error("environment {0} does not exist")]
    Unknown(EnvId),
    /// There are as many as there may be.
    #[error("{0} environments exist already, the most allowed (--max-envs): close one")]
    TooMany(usize),
    /// Two steps of one environment overlap.
    #[error("another step of environment {0} is under way")]
    Busy(EnvId),
    /// It belongs to another client.
    #[error("environment {0} belongs to another client")]
    NotOwner(EnvId),
    /// There is no map for it.
    #[error(transparent)]
    Map(#[from] MapError),
    /// There is no memory for its NPCs.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The map has nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// Work in the background ended without a result.
    #[error("the environment failed: {0}")]
    Lost(#[from] tokio::task::JoinError),
}

/// An environment on this server; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EnvId(pub u64);

impl std::fmt::Display for EnvId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// What an environment is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvSettings {
    /// Its map.
    pub spec: MapSpec,
    /// NPCs in it.
    pub npc_count: usize,
    /// Distance of goals, m.
    pub goal_band: (f32, f32),
    /// Seed of places and goals.
    pub seed: Seed,
}

/// What a step came to, for all NPCs.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResults {
    /// [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN) values for each.
    pub observations: Vec<f32>,
    /// One for each.
    pub rewards: Vec<f32>,
    /// Episodes that ended.
    pub ended: Vec<Ended>,
}

/// An environment and when it was last used.
#[derive(Debug)]
struct Kept {
    env: Mutex<Env>,
    used: Mutex<Instant>,
    owner: Arc<str>,
    _memory: (Arc<SharedMap>, Reservation),
}

/// All environments; clones share them.
#[derive(Debug, Clone)]
pub struct Envs {
    limit: usize,
    maps: MapPool,
    inner: Arc<Mutex<Inner>>,
}

#[derive(Debug, Default)]
struct Inner {
    last_id: u64,
    /// Being created.
    pending: usize,
    by_id: BTreeMap<EnvId, Arc<Kept>>,
}

impl Envs {
    /// At most `limit` environments at a time, on maps of `maps`.
    pub fn new(limit: usize, maps: MapPool) -> Self {
        Self { limit, maps, inner: Arc::default() }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().expect(POISON)
    }

    fn find(&self, caller: &Caller, id: EnvId) -> Result<Arc<Kept>, EnvError> {
        let kept = self.inner().by_id.get(&id).cloned().ok_or(EnvError::Unknown(id))?;
        if !caller.may_change(&kept.owner) {
            return Err(EnvError::NotOwner(id));
        }
        *kept.used.lock().expect(POISON) = Instant::now();
        Ok(kept)
    }

    /// NPCs of an environment.
    ///
    /// # Errors
    /// If there is none of that id, it is somebody else's, or it is being stepped.
    pub fn npc_count(&self, caller: &Caller, id: EnvId) -> Result<usize, EnvError> {
        let kept = self.find(caller, id)?;
        let env = kept.env.try_lock().map_err(|_| EnvError::Busy(id))?;
        Ok(env.npc_count())
    }

    /// Makes an environment: its id, and what its NPCs observe first.
    ///
    /// # Errors
    /// If there are too many, or its map cannot be made.
    pub async fn create(&self, caller: &Caller, settings: EnvSettings) -> Result<(EnvId, Vec<f32>), EnvError> {
        let reserved = self.reserve()?;
        let EnvSettings { spec, npc_count, goal_band, seed } = settings;
        let memory = self.maps.memory().reserve(&caller.name, npc_count as u64 * NPC_BYTES)?;
        let shared = self.maps.get(&caller.name, &MapSource::Spec(spec)).await?;
        let map = shared.map().clone();
        let env = tokio::task::spawn_blocking(move || Env::new(map, npc_count, goal_band, seed.0)).await??;
        let observations = env.observations().to_vec();
        let kept = Kept {
            env: Mutex::new(env),
            used: Mutex::new(Instant::now()),
            owner: caller.name.clone(),
            _memory: (shared, memory),
        };
        Ok((reserved.fill(kept), observations))
    }

    /// Keeps a place for a new environment, forgetting those that nobody has used for long.
    fn reserve(&self) -> Result<Reserved, EnvError> {
        let mut inner = self.inner();
        inner.by_id.retain(|_, kept| kept.used.lock().expect(POISON).elapsed() < IDLE_LIMIT);
        if inner.by_id.len() + inner.pending >= self.limit {
            return Err(EnvError::TooMany(self.limit));
        }
        inner.pending += 1;
        Ok(Reserved { envs: self.clone() })
    }

    /// One decision of every NPC.
    ///
    /// # Errors
    /// If there is no such environment, it is somebody else's, or it is being stepped.
    ///
    /// # Panics
    /// If there is not one action for each NPC.
    pub async fn step(&self, caller: &Caller, id: EnvId, actions: Vec<Action>) -> Result<StepResults, EnvError> {
        let kept = self.find(caller, id)?;
        let task = tokio::task::spawn_blocking(move || {
            let mut env = kept.env.try_lock().map_err(|_| EnvError::Busy(id))?;
            let ended = env.step(&actions);
            let (observations, rewards) = (env.observations().to_vec(), env.rewards().to_vec());
            Ok(StepResults { observations, rewards, ended })
        });
        task.await?
    }

    /// Ends an environment.
    ///
    /// # Errors
    /// If there is none of that id, or it is somebody else's.
    pub fn close(&self, caller: &Caller, id: EnvId) -> Result<(), EnvError> {
        self.find(caller, id)?;
        self.inner().by_id.remove(&id).map(drop).ok_or(EnvError::Unknown(id))
    }
}

/// A place for an environment that is being created.
struct Reserved {
    envs: Envs,
}

impl Reserved {
    fn fill(self, kept: Kept) -> EnvId {
        let mut inner = self.envs.inner();
        inner.last_id += 1;
        let id = EnvId(inner.last_id);
        inner.by_id.insert(id, Arc::new(kept));
        id
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        self.envs.inner().pending -= 1;
    }
}
