//! Environments of remote trainers: creating, stepping and closing them, and removing idle ones.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use surefoot_rollout::env::{Ended, Env};
use surefoot_world::navigable::NoGround;
use surefoot_world::{Action, Map, MapSpec, Seed};

/// An environment that was unused for this long is removed when another is created.
const IDLE_LIMIT: Duration = Duration::from_secs(600);
const POISON: &str = "no holder of this lock panics";

/// Why an environment cannot be created, stepped or closed.
#[derive(Debug, thiserror::Error)]
pub enum EnvError {
    /// No environment has this id.
    #[error("environment {0} does not exist")]
    Unknown(EnvId),
    /// The limit of environments is reached.
    #[error("there are already {0} environments, the most allowed (--max-envs): close one")]
    TooMany(usize),
    /// Two steps of one environment overlap.
    #[error("another step of environment {0} is under way")]
    Busy(EnvId),
    /// The map has no navigable ground.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// A background task ended without a result.
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

/// Settings of a new environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvSettings {
    /// Spec of the map.
    pub spec: MapSpec,
    /// Number of NPCs.
    pub npc_count: usize,
    /// Least and greatest distance of goals, m.
    pub goal_band: (f32, f32),
    /// Seed of starts and goals.
    pub seed: Seed,
}

/// Result of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResults {
    /// [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN) values for each NPC.
    pub observations: Vec<f32>,
    /// One reward for each NPC.
    pub rewards: Vec<f32>,
    /// Episodes that ended in this step.
    pub ended: Vec<Ended>,
}

/// An environment and the time of its last use.
#[derive(Debug)]
struct Kept {
    env: Mutex<Env>,
    used: Mutex<Instant>,
}

/// All environments; clones share them.
#[derive(Debug, Clone)]
pub struct Envs {
    limit: usize,
    inner: Arc<Mutex<Inner>>,
}

#[derive(Debug, Default)]
struct Inner {
    last_id: u64,
    /// Environments that are being created.
    pending: usize,
    by_id: BTreeMap<EnvId, Arc<Kept>>,
}

impl Envs {
    /// Allows at most `limit` environments at a time.
    pub fn new(limit: usize) -> Self {
        Self { limit, inner: Arc::default() }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().expect(POISON)
    }

    fn find(&self, id: EnvId) -> Result<Arc<Kept>, EnvError> {
        let kept = self.inner().by_id.get(&id).cloned().ok_or(EnvError::Unknown(id))?;
        *kept.used.lock().expect(POISON) = Instant::now();
        Ok(kept)
    }

    /// Returns the number of NPCs of an environment.
    ///
    /// # Errors
    /// If no environment has this id, or it is being stepped.
    pub fn npc_count(&self, id: EnvId) -> Result<usize, EnvError> {
        let kept = self.find(id)?;
        let env = kept.env.try_lock().map_err(|_| EnvError::Busy(id))?;
        Ok(env.npc_count())
    }

    /// Creates an environment; returns its id and the first observations of its NPCs.
    ///
    /// # Errors
    /// If there are too many environments, or the map cannot be generated or has no navigable ground.
    pub async fn create(&self, settings: EnvSettings) -> Result<(EnvId, Vec<f32>), EnvError> {
        let reserved = self.reserve()?;
        let task = tokio::task::spawn_blocking(move || {
            let EnvSettings { spec, npc_count, goal_band, seed } = settings;
            let map = Arc::new(Map::generate(&spec));
            Ok::<_, EnvError>(Env::new(map, npc_count, goal_band, seed.0)?)
        });
        let env = task.await??;
        let observations = env.observations().to_vec();
        Ok((reserved.fill(env), observations))
    }

    /// Reserves a place for a new environment, after removing idle ones.
    fn reserve(&self) -> Result<Reserved, EnvError> {
        let mut inner = self.inner();
        inner.by_id.retain(|_, kept| kept.used.lock().expect(POISON).elapsed() < IDLE_LIMIT);
        if inner.by_id.len() + inner.pending >= self.limit {
            return Err(EnvError::TooMany(self.limit));
        }
        inner.pending += 1;
        Ok(Reserved { envs: self.clone() })
    }

    /// Steps every NPC by one decision; `actions` holds one action for each NPC.
    ///
    /// # Errors
    /// If no environment has this id, it is being stepped, or the number of actions is wrong ([`EnvError::Lost`]).
    pub async fn step(&self, id: EnvId, actions: Vec<Action>) -> Result<StepResults, EnvError> {
        let kept = self.find(id)?;
        let task = tokio::task::spawn_blocking(move || {
            let mut env = kept.env.try_lock().map_err(|_| EnvError::Busy(id))?;
            let ended = env.step(&actions);
            let (observations, rewards) = (env.observations().to_vec(), env.rewards().to_vec());
            Ok(StepResults { observations, rewards, ended })
        });
        task.await?
    }

    /// Closes an environment.
    ///
    /// # Errors
    /// If no environment has this id.
    pub fn close(&self, id: EnvId) -> Result<(), EnvError> {
        self.inner().by_id.remove(&id).map(drop).ok_or(EnvError::Unknown(id))
    }
}

/// A place for an environment that is being created; dropping it gives the place back.
struct Reserved {
    envs: Envs,
}

impl Reserved {
    fn fill(self, env: Env) -> EnvId {
        let mut inner = self.envs.inner();
        inner.last_id += 1;
        let id = EnvId(inner.last_id);
        inner.by_id.insert(id, Arc::new(Kept { env: Mutex::new(env), used: Mutex::new(Instant::now()) }));
        id
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        self.envs.inner().pending -= 1;
    }
}
