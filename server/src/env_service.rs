//! The gRPC face of environments: decode, call, encode.

use crate::env::{Ended, Env, actions_of};
use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::serving::{Shutdown, going_away};
use surefoot_proto::status;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_server::EnvService;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::OBSERVATION_VERSION;
use surefoot_world::{Map, OBSERVATION_LEN};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};

/// Most NPCs of one environment: their observations must fit into a message.
const MAX_NPCS: f64 = 4096.0;
/// Farthest goals, m: across the largest map.
const MAX_GOAL_M: f64 = 1500.0;
/// After so long without a step an environment makes room for others.
const IDLE_LIMIT: Duration = Duration::from_secs(600);
/// Results waiting for one trainer.
const QUEUE: usize = 2;

/// An environment and when it was last used.
struct Kept {
    env: Mutex<Env>,
    used: Mutex<Instant>,
}

/// The service; clones share everything.
#[derive(Clone)]
pub struct EnvApi {
    shared: Arc<Shared>,
}

struct Shared {
    limit: usize,
    envs: Mutex<Envs>,
    shutdown: Shutdown,
}

#[derive(Default)]
struct Envs {
    last_id: u64,
    /// Being created.
    pending: usize,
    by_id: BTreeMap<u64, Arc<Kept>>,
}

const POISON: &str = "no holder of this lock panics";

impl EnvApi {
    /// At most `limit` environments at a time.
    pub fn new(limit: usize, shutdown: Shutdown) -> Self {
        Self { shared: Arc::new(Shared { limit, envs: Mutex::default(), shutdown }) }
    }

    fn envs(&self) -> std::sync::MutexGuard<'_, Envs> {
        self.shared.envs.lock().expect(POISON)
    }

    fn find(&self, env_id: u64) -> Result<Arc<Kept>, Status> {
        let kept = self.envs().by_id.get(&env_id).cloned();
        let kept = kept.ok_or_else(|| no_env(env_id))?;
        *kept.used.lock().expect(POISON) = Instant::now();
        Ok(kept)
    }

    /// Keeps a place for a new environment, forgetting those that nobody has used for long.
    fn reserve(&self) -> Result<Reserved, Status> {
        let mut envs = self.envs();
        envs.by_id.retain(|_, kept| kept.used.lock().expect(POISON).elapsed() < IDLE_LIMIT);
        if envs.by_id.len() + envs.pending >= self.shared.limit {
            let limit = self.shared.limit;
            return Err(status::exhausted(format!(
                "{limit} environments exist already, the most allowed (--max-envs): close one"
            )));
        }
        envs.pending += 1;
        Ok(Reserved { api: self.clone() })
    }

    async fn step(&self, env_id: u64, actions: Option<wire::EnvActions>) -> Result<wire::EnvResults, Status> {
        let kept = self.find(env_id)?;
        let bytes = actions.ok_or(FieldError::Missing("actions"))?.actions;
        let task = tokio::task::spawn_blocking(move || {
            let mut env = kept
                .env
                .try_lock()
                .map_err(|_| Status::aborted(format!("another step of environment {env_id} is under way")))?;
            let values = convert::unpack(&bytes, env.npc_count() * ACTION_LEN, "actions.actions")?;
            let ended = env.step(
                &actions_of(&values, |idx| idx as u64)
                    .map_err(|message| status::invalid("actions.actions", message))?,
            );
            Ok(results_of(&env, &ended))
        });
        task.await.map_err(|error| Status::internal(format!("the step failed: {error}")))?
    }
}

fn no_env(env_id: u64) -> Status {
    status::not_found("environment", env_id.to_string(), format!("environment {env_id} does not exist"))
}

/// A place for an environment that is being created.
struct Reserved {
    api: EnvApi,
}

impl Reserved {
    fn fill(self, env: Env) -> u64 {
        let mut envs = self.api.envs();
        envs.last_id += 1;
        let id = envs.last_id;
        envs.by_id.insert(id, Arc::new(Kept { env: Mutex::new(env), used: Mutex::new(Instant::now()) }));
        id
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        self.api.envs().pending -= 1;
    }
}

fn results_of(env: &Env, ended: &[Ended]) -> wire::EnvResults {
    let ends = ended.iter().map(|ended| wire::EnvEnd {
        npc: ended.npc_idx as u32,
        outcome: convert::outcome(Some(ended.end)).into(),
        final_observation: convert::pack(ended.final_observation.iter().copied()),
    });
    wire::EnvResults {
        observations: convert::pack(env.observations().iter().copied()),
        rewards: convert::pack(env.rewards().iter().copied()),
        ends: ends.collect(),
    }
}

type BoxStream<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl EnvService for EnvApi {
    async fn create_env(
        &self,
        request: Request<wire::CreateEnvRequest>,
    ) -> Result<Response<wire::CreateEnvResponse>, Status> {
        let request = request.into_inner();
        let spec = convert::map_spec(request.map.as_ref())?;
        let npc_count = convert::in_range(f64::from(request.npc_count), 1.0, MAX_NPCS, "npc_count")? as usize;
        let nearest = convert::in_range(f64::from(request.goal_min_m), 0.0, MAX_GOAL_M, "goal_min_m")?;
        let farthest = match request.goal_max_m {
            0.0 => MAX_GOAL_M,
            farthest => convert::in_range(f64::from(farthest), nearest, MAX_GOAL_M, "goal_max_m")?,
        };
        let reserved = self.reserve()?;
        let task = tokio::task::spawn_blocking(move || {
            let map = Arc::new(Map::generate(&spec).map_err(FieldError::from)?);
            Env::new(map, npc_count, (nearest as f32, farthest as f32), request.seed)
                .map_err(|error| Status::failed_precondition(error.to_string()))
        });
        let env = task.await.map_err(|error| Status::internal(format!("the environment failed: {error}")))??;
        let observations = convert::pack(env.observations().iter().copied());
        Ok(Response::new(wire::CreateEnvResponse {
            env_id: reserved.fill(env),
            observation_len: OBSERVATION_LEN as u32,
            observation_version: OBSERVATION_VERSION,
            action_len: ACTION_LEN as u32,
            observations,
        }))
    }

    async fn step_env(
        &self,
        request: Request<wire::StepEnvRequest>,
    ) -> Result<Response<wire::StepEnvResponse>, Status> {
        let wire::StepEnvRequest { env_id, actions } = request.into_inner();
        Ok(Response::new(wire::StepEnvResponse { results: Some(self.step(env_id, actions).await?) }))
    }

    type StreamEnvStream = BoxStream<wire::StreamEnvResponse>;

    async fn stream_env(
        &self,
        request: Request<Streaming<wire::StreamEnvRequest>>,
    ) -> Result<Response<Self::StreamEnvStream>, Status> {
        let mut requests = request.into_inner();
        let (queue, results) = mpsc::channel(QUEUE);
        let api = self.clone();
        let stopping = self.shared.shutdown.wait();
        tokio::spawn(async move {
            tokio::pin!(stopping);
            loop {
                let request = tokio::select! {
                    request = requests.next() => request,
                    () = &mut stopping => Some(Err(going_away())),
                    () = queue.closed() => None,
                };
                let result = match request {
                    None => return,
                    Some(Err(status)) => Err(status),
                    Some(Ok(wire::StreamEnvRequest { env_id, actions })) => api.step(env_id, actions).await,
                };
                let is_over = result.is_err();
                let message = result.map(|results| wire::StreamEnvResponse { results: Some(results) });
                if queue.send(message).await.is_err() || is_over {
                    return;
                }
            }
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(results))))
    }

    async fn close_env(
        &self,
        request: Request<wire::CloseEnvRequest>,
    ) -> Result<Response<wire::CloseEnvResponse>, Status> {
        let env_id = request.into_inner().env_id;
        self.envs()
            .by_id
            .remove(&env_id)
            .map(|_| Response::new(wire::CloseEnvResponse {}))
            .ok_or_else(|| no_env(env_id))
    }
}
