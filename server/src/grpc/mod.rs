//! `WorldService`: decode, call, encode.
//!
//! `worlds` has the calls about worlds and their maps, `npcs` those about NPCs, `settings` those that change lasting
//! properties of NPCs, `groups` that about groups, `routes` those about routes, `living` those about movers, players
//! and pieces, `zones` those about zones, `readers` the streams to readers, `work` the stream of a worker. `env`
//! implements `EnvService`, `directory` `DirectoryService`. `redirect` says where worlds run that other servers have,
//! `errors` converts errors to statuses.

pub mod directory;
pub mod env;
mod errors;
mod groups;
mod living;
mod npcs;
mod readers;
pub mod redirect;
mod routes;
mod settings;
mod work;
mod worlds;
mod zones;

use crate::ids::{NpcId, WorldId};
use crate::worlds::{WorldHandle, Worlds};
use std::sync::Arc;
use surefoot_net::idempotency::AnswerCache;
use surefoot_net::reader::{self, ReaderStream, Source};
use surefoot_net::serving::Caller;
use surefoot_net::status::Answer;
use surefoot_proto::convert::FieldError;
use surefoot_proto::coordinates::{CallFrame, Places};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_server::WorldService;
use tokio::sync::Semaphore;
use tonic::codegen::BoxStream;
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

/// A call: its caller, and its message.
type Call<T> = (Caller, T);
/// The message that answers a call, or why there is none.
type Reply<T> = Result<T, Status>;

impl WorldApi {
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
        reader::stream(source, self.worlds.config().reader_patience, Some(self.worlds.shutdown()))
    }

    /// Streams messages whose places are in the coordinates of the call.
    fn stream_in<S: Source<Message: Places>>(&self, frame: CallFrame, source: S) -> ReaderStream<S::Message> {
        self.stream(InFrame { source, frame })
    }

    /// The frame of a call about a world with the field `coordinates`.
    fn frame(&self, coordinates: i32, world: u64) -> Reply<CallFrame> {
        CallFrame::of(coordinates, || Ok(*self.worlds.handle(WorldId(world))?.shown.get().frame()))
    }
}

/// The frame of a call about a running world with the field `coordinates`. Edits of its map do not change it.
fn frame_on(handle: &WorldHandle, coordinates: i32) -> Result<CallFrame, FieldError> {
    CallFrame::of(coordinates, || Ok(*handle.shown.get().frame()))
}

/// A source whose messages have places in the coordinates of a call.
struct InFrame<S> {
    source: S,
    frame: CallFrame,
}

impl<S: Source<Message: Places>> Source for InFrame<S> {
    type Message = S::Message;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        let messages = self.source.next().await?;
        Some(messages.map(|messages| self.frame.to_level(messages)))
    }
}

/// Implements the service: each method calls the function of the same name in a module.
macro_rules! world_service {
    ($($module:ident::$method:ident($request:ty) -> $(type $stream:ident =)? $response:ty;)*) => {
        #[tonic::async_trait]
        impl WorldService for WorldApi {
            $(
                $(type $stream = $response;)?

                async fn $method(&self, request: Request<$request>) -> Answer<$response> {
                    let call = (Caller::of(&request), request.into_inner());
                    $module::$method(self, call).await.map(Response::new)
                }
            )*
        }
    };
}

world_service! {
    worlds::get_server(wire::GetServerRequest) -> wire::GetServerResponse;
    worlds::create_world(wire::CreateWorldRequest) -> wire::CreateWorldResponse;
    worlds::get_world(wire::GetWorldRequest) -> wire::GetWorldResponse;
    worlds::list_worlds(wire::ListWorldsRequest) -> wire::ListWorldsResponse;
    worlds::drop_world(wire::DropWorldRequest) -> wire::DropWorldResponse;
    worlds::sample_ground(wire::SampleGroundRequest) -> wire::SampleGroundResponse;
    worlds::survey_map(wire::SurveyMapRequest) -> wire::SurveyMapResponse;
    worlds::get_features(wire::GetFeaturesRequest) -> wire::GetFeaturesResponse;
    npcs::spawn_npc(wire::SpawnNpcRequest) -> wire::SpawnNpcResponse;
    npcs::batch_spawn_npcs(wire::BatchSpawnNpcsRequest) -> wire::BatchSpawnNpcsResponse;
    npcs::despawn_npc(wire::DespawnNpcRequest) -> wire::DespawnNpcResponse;
    npcs::batch_despawn_npcs(wire::BatchDespawnNpcsRequest) -> wire::BatchDespawnNpcsResponse;
    npcs::set_goal(wire::SetGoalRequest) -> wire::SetGoalResponse;
    npcs::batch_set_goals(wire::BatchSetGoalsRequest) -> wire::BatchSetGoalsResponse;
    npcs::move_targets(wire::MoveTargetsRequest) -> wire::MoveTargetsResponse;
    groups::set_group_goal(wire::SetGroupGoalRequest) -> wire::SetGroupGoalResponse;
    npcs::clear_goals(wire::ClearGoalsRequest) -> wire::ClearGoalsResponse;
    routes::get_routes(wire::GetRoutesRequest) -> wire::GetRoutesResponse;
    routes::set_routes(wire::SetRoutesRequest) -> wire::SetRoutesResponse;
    npcs::teleport_npc(wire::TeleportNpcRequest) -> wire::TeleportNpcResponse;
    npcs::batch_teleport_npcs(wire::BatchTeleportNpcsRequest) -> wire::BatchTeleportNpcsResponse;
    npcs::get_npc(wire::GetNpcRequest) -> wire::GetNpcResponse;
    npcs::batch_get_npcs(wire::BatchGetNpcsRequest) -> wire::BatchGetNpcsResponse;
    npcs::list_npcs(wire::ListNpcsRequest) -> wire::ListNpcsResponse;
    readers::watch_world(wire::WatchWorldRequest) -> type WatchWorldStream = ReaderStream<wire::WatchWorldResponse>;
    readers::watch_segments(wire::WatchSegmentsRequest)
        -> type WatchSegmentsStream = ReaderStream<wire::WatchSegmentsResponse>;
    readers::watch_events(wire::WatchEventsRequest) -> type WatchEventsStream = ReaderStream<wire::WatchEventsResponse>;
    readers::watch_stats(wire::WatchStatsRequest) -> type WatchStatsStream = ReaderStream<wire::WatchStatsResponse>;
    readers::follow_npc(wire::FollowNpcRequest) -> type FollowNpcStream = ReaderStream<wire::FollowNpcResponse>;
    readers::get_mesh(wire::GetMeshRequest) -> type GetMeshStream = ReaderStream<wire::GetMeshResponse>;
    living::list_movers(wire::ListMoversRequest) -> wire::ListMoversResponse;
    living::set_mover(wire::SetMoverRequest) -> wire::SetMoverResponse;
    living::edit_map(wire::EditMapRequest) -> wire::EditMapResponse;
    living::list_pieces(wire::ListPiecesRequest) -> wire::ListPiecesResponse;
    zones::set_zones(wire::SetZonesRequest) -> wire::SetZonesResponse;
    zones::list_zones(wire::ListZonesRequest) -> wire::ListZonesResponse;
    settings::set_npc_tags(wire::SetNpcTagsRequest) -> wire::SetNpcTagsResponse;
    settings::set_gaits(wire::SetGaitsRequest) -> wire::SetGaitsResponse;
    settings::look_at(wire::LookAtRequest) -> wire::LookAtResponse;
    living::spawn_player(wire::SpawnPlayerRequest) -> wire::SpawnPlayerResponse;
    living::move_players(wire::MovePlayersRequest) -> wire::MovePlayersResponse;
    living::remove_player(wire::RemovePlayerRequest) -> wire::RemovePlayerResponse;
    work::work(Streaming<wire::WorkRequest>) -> type WorkStream = BoxStream<wire::WorkResponse>;
}
