//! `WorldService`: decode, call, encode. Each method calls the free function of the same name.
//!
//! `worlds` has the calls about worlds and their maps, `npcs` those about NPCs, `living` those about movers, players
//! and pieces, `readers` the streams to readers, `work` the stream of a worker. `env` implements `EnvService`,
//! `directory` `DirectoryService`. `redirect` says where worlds run that other servers have, `errors` converts errors
//! to statuses.

pub mod directory;
pub mod env;
mod errors;
mod living;
mod npcs;
mod readers;
pub mod redirect;
mod work;
mod worlds;

use crate::ids::NpcId;
use crate::worlds::Worlds;
use std::sync::Arc;
use surefoot_net::idempotency::AnswerCache;
use surefoot_net::reader::{self, ReaderStream, Source};
use surefoot_net::serving::{Caller, shutting_down};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_server::WorldService;
use tokio::sync::Semaphore;
use tonic::{Request, Response, Status, Streaming};

/// Most threads that build tiles of meshes at the same time, so that worlds keep stepping.
const MESHES_AT_A_TIME: usize = 2;

/// Implementation of `WorldService`; clones share all state.
#[derive(Debug, Clone)]
pub struct WorldApi {
    worlds: Worlds,
    meshing: Arc<Semaphore>,
    created_worlds: AnswerCache<wire::World>,
    spawned: AnswerCache<NpcId>,
    spawned_batches: AnswerCache<Arc<[npcs::Spawned]>>,
}

type Answer<T> = Result<Response<T>, Status>;

impl WorldApi {
    /// Creates the service for `worlds`.
    pub fn new(worlds: Worlds) -> Self {
        let memory = worlds.maps().memory().clone();
        Self {
            worlds,
            meshing: Arc::new(Semaphore::new(MESHES_AT_A_TIME)),
            created_worlds: AnswerCache::new(memory.clone()),
            spawned: AnswerCache::new(memory.clone()),
            spawned_batches: AnswerCache::new(memory),
        }
    }

    /// Streams messages to a reader until the server stops.
    fn stream<S: Source>(&self, source: S) -> ReaderStream<S::Message> {
        let stopping = self.worlds.shutdown().wait();
        let stopping = async move {
            stopping.await;
            shutting_down()
        };
        reader::stream(source, self.worlds.config().reader_patience, stopping)
    }
}

/// The caller and the message of a request.
fn parts<T>(request: Request<T>) -> (Caller, T) {
    (Caller::of(&request), request.into_inner())
}

#[tonic::async_trait]
impl WorldService for WorldApi {
    async fn get_server(&self, _: Request<wire::GetServerRequest>) -> Answer<wire::GetServerResponse> {
        Ok(Response::new(worlds::get_server(self)))
    }

    async fn create_world(&self, request: Request<wire::CreateWorldRequest>) -> Answer<wire::CreateWorldResponse> {
        worlds::create_world(self, request).await.map(Response::new)
    }

    async fn get_world(&self, request: Request<wire::GetWorldRequest>) -> Answer<wire::GetWorldResponse> {
        worlds::get_world(self, request).await.map(Response::new)
    }

    async fn list_worlds(&self, request: Request<wire::ListWorldsRequest>) -> Answer<wire::ListWorldsResponse> {
        worlds::list_worlds(self, request.into_inner()).map(Response::new)
    }

    async fn drop_world(&self, request: Request<wire::DropWorldRequest>) -> Answer<wire::DropWorldResponse> {
        worlds::drop_world(self, request).await.map(Response::new)
    }

    async fn sample_ground(&self, request: Request<wire::SampleGroundRequest>) -> Answer<wire::SampleGroundResponse> {
        worlds::sample_ground(self, request).await.map(Response::new)
    }

    async fn survey_map(&self, request: Request<wire::SurveyMapRequest>) -> Answer<wire::SurveyMapResponse> {
        worlds::survey_map(self, request).await.map(Response::new)
    }

    async fn get_features(&self, request: Request<wire::GetFeaturesRequest>) -> Answer<wire::GetFeaturesResponse> {
        worlds::get_features(self, request.into_inner()).map(Response::new)
    }

    async fn spawn_npc(&self, request: Request<wire::SpawnNpcRequest>) -> Answer<wire::SpawnNpcResponse> {
        npcs::spawn_npc(self, request).await.map(Response::new)
    }

    async fn batch_spawn_npcs(
        &self,
        request: Request<wire::BatchSpawnNpcsRequest>,
    ) -> Answer<wire::BatchSpawnNpcsResponse> {
        npcs::batch_spawn_npcs(self, request).await.map(Response::new)
    }

    async fn despawn_npc(&self, request: Request<wire::DespawnNpcRequest>) -> Answer<wire::DespawnNpcResponse> {
        npcs::despawn_npc(self, request).await.map(Response::new)
    }

    async fn batch_despawn_npcs(
        &self,
        request: Request<wire::BatchDespawnNpcsRequest>,
    ) -> Answer<wire::BatchDespawnNpcsResponse> {
        npcs::batch_despawn_npcs(self, request).await.map(Response::new)
    }

    async fn set_goal(&self, request: Request<wire::SetGoalRequest>) -> Answer<wire::SetGoalResponse> {
        npcs::set_goal(self, request).await.map(Response::new)
    }

    async fn batch_set_goals(
        &self,
        request: Request<wire::BatchSetGoalsRequest>,
    ) -> Answer<wire::BatchSetGoalsResponse> {
        npcs::batch_set_goals(self, request).await.map(Response::new)
    }

    async fn teleport_npc(&self, request: Request<wire::TeleportNpcRequest>) -> Answer<wire::TeleportNpcResponse> {
        npcs::teleport_npc(self, request).await.map(Response::new)
    }

    async fn batch_teleport_npcs(
        &self,
        request: Request<wire::BatchTeleportNpcsRequest>,
    ) -> Answer<wire::BatchTeleportNpcsResponse> {
        npcs::batch_teleport_npcs(self, request).await.map(Response::new)
    }

    async fn get_npc(&self, request: Request<wire::GetNpcRequest>) -> Answer<wire::GetNpcResponse> {
        npcs::get_npc(self, request).await.map(Response::new)
    }

    async fn batch_get_npcs(&self, request: Request<wire::BatchGetNpcsRequest>) -> Answer<wire::BatchGetNpcsResponse> {
        npcs::batch_get_npcs(self, request).await.map(Response::new)
    }

    async fn list_npcs(&self, request: Request<wire::ListNpcsRequest>) -> Answer<wire::ListNpcsResponse> {
        npcs::list_npcs(self, request).await.map(Response::new)
    }

    type WatchWorldStream = ReaderStream<wire::WatchWorldResponse>;

    async fn watch_world(&self, request: Request<wire::WatchWorldRequest>) -> Answer<Self::WatchWorldStream> {
        readers::watch_world(self, request).await.map(Response::new)
    }

    type WatchEventsStream = ReaderStream<wire::WatchEventsResponse>;

    async fn watch_events(&self, request: Request<wire::WatchEventsRequest>) -> Answer<Self::WatchEventsStream> {
        readers::watch_events(self, request).await.map(Response::new)
    }

    type WatchStatsStream = ReaderStream<wire::WatchStatsResponse>;

    async fn watch_stats(&self, request: Request<wire::WatchStatsRequest>) -> Answer<Self::WatchStatsStream> {
        readers::watch_stats(self, request).map(Response::new)
    }

    type FollowNpcStream = ReaderStream<wire::FollowNpcResponse>;

    async fn follow_npc(&self, request: Request<wire::FollowNpcRequest>) -> Answer<Self::FollowNpcStream> {
        readers::follow_npc(self, request).await.map(Response::new)
    }

    type GetMeshStream = ReaderStream<wire::GetMeshResponse>;

    async fn get_mesh(&self, request: Request<wire::GetMeshRequest>) -> Answer<Self::GetMeshStream> {
        readers::get_mesh(self, request.into_inner()).map(Response::new)
    }

    async fn list_movers(&self, request: Request<wire::ListMoversRequest>) -> Answer<wire::ListMoversResponse> {
        living::list_movers(self, request).await.map(Response::new)
    }

    async fn set_mover(&self, request: Request<wire::SetMoverRequest>) -> Answer<wire::SetMoverResponse> {
        living::set_mover(self, request).await.map(Response::new)
    }

    async fn edit_map(&self, request: Request<wire::EditMapRequest>) -> Answer<wire::EditMapResponse> {
        living::edit_map(self, request).await.map(Response::new)
    }

    async fn list_pieces(&self, request: Request<wire::ListPiecesRequest>) -> Answer<wire::ListPiecesResponse> {
        living::list_pieces(self, request).await.map(Response::new)
    }

    async fn spawn_player(&self, request: Request<wire::SpawnPlayerRequest>) -> Answer<wire::SpawnPlayerResponse> {
        living::spawn_player(self, request).await.map(Response::new)
    }

    async fn move_players(&self, request: Request<wire::MovePlayersRequest>) -> Answer<wire::MovePlayersResponse> {
        living::move_players(self, request).await.map(Response::new)
    }

    async fn remove_player(&self, request: Request<wire::RemovePlayerRequest>) -> Answer<wire::RemovePlayerResponse> {
        living::remove_player(self, request).await.map(Response::new)
    }

    type WorkStream = work::WorkStream;

    async fn work(&self, request: Request<Streaming<wire::WorkRequest>>) -> Answer<Self::WorkStream> {
        work::work(self, request.into_inner()).await.map(Response::new)
    }
}
