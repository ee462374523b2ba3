//! `EnvService`: decode, call, encode.

use crate::envs::{EnvId, Envs, FirstState};
use crate::wire::env::{env_actions, env_settings, results_to_wire};
use surefoot_net::idempotency::{AnswerCache, Repeatable};
use surefoot_net::levels::{LevelStore, grpc as levels};
use surefoot_net::serving::{Caller, Shutdown, shutting_down};
use surefoot_net::status::Answer;
use surefoot_proto::convert;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_server::EnvService;
use surefoot_world::Vec3;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{OBSERVATION_VERSION, observation_len};
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::codegen::BoxStream;
use tonic::{Request, Response, Status, Streaming};

/// Most results waiting for one trainer.
const QUEUE: usize = 2;

/// Implementation of `EnvService`; clones share all state.
#[derive(Debug, Clone)]
pub struct EnvApi {
    pub envs: Envs,
    /// Imported maps; `None` for a game, which always runs its own level.
    pub levels: Option<LevelStore>,
    /// Signal that ends open streams.
    pub shutdown: Shutdown,
    /// Ids and first states of recently created environments, for repeated calls.
    pub created: AnswerCache<(EnvId, FirstState)>,
}

impl EnvApi {
    async fn step(
        &self,
        caller: &Caller,
        id: EnvId,
        actions: Option<wire::EnvActions>,
    ) -> Result<wire::EnvResults, Status> {
        let actions = env_actions(actions, self.envs.npc_count(caller, id)?)?;
        Ok(results_to_wire(self.envs.step(caller, id, actions).await?))
    }
}

#[tonic::async_trait]
impl EnvService for EnvApi {
    async fn create_env(&self, request: Request<wire::CreateEnvRequest>) -> Answer<wire::CreateEnvResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let source = match &self.levels {
            Some(levels) => Some(levels::source(levels, request.map.as_ref(), &request.map_hash)?),
            None => None,
        };
        let settings = env_settings(&request, source)?;
        let (envs, owner) = (self.envs.clone(), caller.clone());
        let npc_bytes = observation_len(request.solid_npcs) * size_of::<f32>() + size_of::<Vec3>();
        let answer_bytes = settings.episodes.npc_count() * npc_bytes;
        let create = async move { Ok(envs.create(&owner, settings).await?) };
        let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes };
        let (env_id, first) = self.created.once(call, &request, create).await?;
        Ok(Response::new(wire::CreateEnvResponse {
            env_id: env_id.0,
            observation_len: observation_len(request.solid_npcs) as u32,
            observation_version: OBSERVATION_VERSION,
            action_len: ACTION_LEN as u32,
            observations: convert::pack(first.observations),
            positions: convert::pack_points(first.positions),
        }))
    }

    async fn step_env(&self, request: Request<wire::StepEnvRequest>) -> Answer<wire::StepEnvResponse> {
        let caller = Caller::of(&request);
        let wire::StepEnvRequest { env_id, actions } = request.into_inner();
        Ok(Response::new(wire::StepEnvResponse { results: Some(self.step(&caller, EnvId(env_id), actions).await?) }))
    }

    type StreamEnvStream = BoxStream<wire::StreamEnvResponse>;

    async fn stream_env(&self, request: Request<Streaming<wire::StreamEnvRequest>>) -> Answer<Self::StreamEnvStream> {
        let caller = Caller::of(&request);
        let mut requests = request.into_inner();
        let (queue, results) = mpsc::channel(QUEUE);
        let api = self.clone();
        let stopping = self.shutdown.wait();
        tokio::spawn(async move {
            tokio::pin!(stopping);
            loop {
                let request = tokio::select! {
                    request = requests.next() => request,
                    () = &mut stopping => Some(Err(shutting_down())),
                    () = queue.closed() => None,
                };
                let result = match request {
                    None => return,
                    Some(Err(status)) => Err(status),
                    Some(Ok(wire::StreamEnvRequest { env_id, actions })) => {
                        api.step(&caller, EnvId(env_id), actions).await
                    }
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

    async fn close_env(&self, request: Request<wire::CloseEnvRequest>) -> Answer<wire::CloseEnvResponse> {
        let caller = Caller::of(&request);
        self.envs.close(&caller, EnvId(request.into_inner().env_id))?;
        Ok(Response::new(wire::CloseEnvResponse {}))
    }
}
