//! `WorldService`: decode, call, encode.
//!
//! `batches` has the calls for many NPCs, `readers` the streams to readers, `living` the calls about movers and players, `work`
//! the streams of workers, `env` implements
//! `EnvService`, `directory` `DirectoryService` (`redirect` says where worlds are that are not here), `errors` converts the server's errors to statuses.

mod batches;
pub mod directory;
pub mod env;
mod errors;
mod living;
mod readers;
pub mod redirect;
mod work;

use crate::geometry::Tiles;
use crate::hosted::{HostedWorld, TimeMode};
use crate::ids::{NpcId, WorldId};
use crate::view::View;
use crate::wire::{
    MAX_CUT_OFF, MAX_SURVEYED, features_to_wire, npc_to_wire, region as convert_region, survey_to_wire, time_mode,
    world_to_wire,
};
use crate::worlds::{NpcAccess, WorldSettings, Worlds};
use readers::EventSource;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, SystemTime};
use surefoot_net::idempotency::{AnswerCache, Repeatable};
use surefoot_net::levels::grpc as levels;
use surefoot_net::paging::{PageSize, page_by_id};
use surefoot_net::reader::ReaderStream;
use surefoot_net::serving::Caller;
use surefoot_net::status;
use surefoot_proto::convert;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_server::WorldService;
use surefoot_world::character::bodies::BODIES;
use surefoot_world::sense::OBSERVATION_VERSION;
use surefoot_world::{CharacterProfile, Map, OBSERVATION_LEN, Seed, TICKS_PER_DECISION, TICKS_PER_SECOND};
use tokio::sync::Semaphore;
use tonic::{Request, Response, Status, Streaming};
use work::WorkStream;

/// Most threads that build tiles of meshes at the same time, so that worlds keep stepping.
const MESHES_AT_A_TIME: usize = 2;
/// Most bytes of the description of a world that has just been created.
const WORLD_BYTES: usize = 1024;
/// Time without a sign of a world's thread after which ListWorlds says that the world is silent.
const SILENCE: Duration = Duration::from_millis(500);
/// Page size of ListNpcs.
const NPC_PAGE: PageSize = PageSize { default: 1000, max: 4096 };

/// Implementation of `WorldService`; clones share all state.
#[derive(Debug, Clone)]
pub struct WorldApi {
    worlds: Worlds,
    meshing: Arc<Semaphore>,
    created_worlds: AnswerCache<wire::World>,
    spawned: AnswerCache<NpcId>,
    spawned_batches: AnswerCache<Arc<[batches::Spawned]>>,
}

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

    fn worlds(&self) -> &Worlds {
        &self.worlds
    }

    /// How long a reader may leave all messages unread until it is cut off.
    fn patience(&self) -> Duration {
        self.worlds.config().reader_patience
    }
}

#[tonic::async_trait]
impl WorldService for WorldApi {
    async fn get_server(
        &self,
        _: Request<wire::GetServerRequest>,
    ) -> Result<Response<wire::GetServerResponse>, Status> {
        let config = self.worlds.config();
        Ok(Response::new(wire::GetServerResponse {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            epoch: self.worlds.epoch(),
            server_time: Some(SystemTime::now().into()),
            ticks_per_second: TICKS_PER_SECOND,
            ticks_per_decision: TICKS_PER_DECISION,
            max_worlds: config.max_worlds as u32,
            max_npcs_per_world: config.max_npcs_per_world as u32,
            observation_len: OBSERVATION_LEN as u32,
            observation_version: OBSERVATION_VERSION,
            body_presets: BODIES.map(|body| body.name.to_owned()).to_vec(),
        }))
    }

    async fn create_world(
        &self,
        request: Request<wire::CreateWorldRequest>,
    ) -> Result<Response<wire::CreateWorldResponse>, Status> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let base = levels::source(self.worlds.levels(), request.map.as_ref(), &request.map_hash)?;
        let source = levels::with_pieces(base, &request.pieces)?;
        let mode = time_mode(request.mode)?;
        let settings = WorldSettings {
            mode,
            body: convert::body(request.body.as_ref())?,
            solid_npcs: request.solid_npcs.unwrap_or(mode == TimeMode::Realtime),
        };
        let (worlds, owner) = (self.worlds.clone(), caller.clone());
        // What is kept must not hold the map.
        let create = async move { Ok(world_to_wire(&worlds.create(&owner, source, settings).await?)) };
        let answer_bytes = WORLD_BYTES;
        let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes };
        let world = self.created_worlds.once(call, &request, create).await?;
        Ok(Response::new(wire::CreateWorldResponse { world: Some(world) }))
    }

    async fn get_world(
        &self,
        request: Request<wire::GetWorldRequest>,
    ) -> Result<Response<wire::GetWorldResponse>, Status> {
        let caller = Caller::of(&request);
        let world = self.worlds.describe(&caller, WorldId(request.into_inner().world_id)).await?;
        Ok(Response::new(wire::GetWorldResponse { world: Some(world_to_wire(&world)) }))
    }

    async fn list_worlds(
        &self,
        request: Request<wire::ListWorldsRequest>,
    ) -> Result<Response<wire::ListWorldsResponse>, Status> {
        let wire::ListWorldsRequest { page_size, page_token } = request.into_inner();
        // Worlds that may be moving to another server are left out.
        let here = self.worlds.figures().into_iter().filter(|world| self.worlds.handle(world.summary.id).is_ok());
        let page = page_by_id(here, |world| world.summary.id.0, PageSize::USUAL, page_size, &page_token)?;
        let silent = page.items.iter().filter(|world| world.age() > SILENCE);
        Ok(Response::new(wire::ListWorldsResponse {
            silent_world_ids: silent.map(|world| world.summary.id.0).collect(),
            worlds: page.items.iter().map(|world| world_to_wire(&world.summary)).collect(),
            next_page_token: page.next_token,
        }))
    }

    async fn drop_world(
        &self,
        request: Request<wire::DropWorldRequest>,
    ) -> Result<Response<wire::DropWorldResponse>, Status> {
        let caller = Caller::of(&request);
        self.worlds.drop_world(&caller, WorldId(request.into_inner().world_id)).await?;
        Ok(Response::new(wire::DropWorldResponse {}))
    }

    async fn sample_ground(
        &self,
        request: Request<wire::SampleGroundRequest>,
    ) -> Result<Response<wire::SampleGroundResponse>, Status> {
        let caller = Caller::of(&request);
        let wire::SampleGroundRequest { world_id, count, seed, body } = request.into_inner();
        // An unknown world is reported before a bad count.
        self.worlds.handle(WorldId(world_id))?;
        convert::in_range(f64::from(count), 1.0, 10_000.0, "count")?;
        let body = body.map(|body| convert::body(Some(&body))).transpose()?;
        let points = self.worlds.sample_ground(&caller, WorldId(world_id), body, count as usize, Seed(seed)).await?;
        Ok(Response::new(wire::SampleGroundResponse { points: points.into_iter().map(convert::to_wire).collect() }))
    }

    async fn survey_map(
        &self,
        request: Request<wire::SurveyMapRequest>,
    ) -> Result<Response<wire::SurveyMapResponse>, Status> {
        let caller = Caller::of(&request);
        let wire::SurveyMapRequest { map, map_hash, bodies, max_cut_off, pieces } = request.into_inner();
        let base = levels::source(self.worlds.levels(), map.as_ref(), &map_hash)?;
        let source = levels::with_pieces(base, &pieces)?;
        convert::in_range(bodies.len() as f64, 0.0, MAX_SURVEYED, "the number of bodies")?;
        convert::in_range(f64::from(max_cut_off), 0.0, MAX_CUT_OFF, "max_cut_off")?;
        let bodies: Vec<_> = bodies.iter().map(|body| convert::body(Some(body))).collect::<Result<_, _>>()?;
        let bodies = if bodies.is_empty() { vec![CharacterProfile::default()] } else { bodies };
        let surveys = self.worlds.survey(&caller, source, bodies, max_cut_off as usize).await?;
        Ok(Response::new(wire::SurveyMapResponse { surveys: surveys.iter().map(survey_to_wire).collect() }))
    }

    async fn spawn_npc(
        &self,
        request: Request<wire::SpawnNpcRequest>,
    ) -> Result<Response<wire::SpawnNpcResponse>, Status> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let world = WorldId(request.world_id);
        self.worlds.handle(world)?;
        let wire::SpawnNpcRequest { position, yaw, body, .. } = request.clone();
        let order = batches::spawn(&wire::Spawn { position, yaw, goal: None, body })?;
        let (worlds, owner) = (self.worlds.clone(), caller.clone());
        let spawn = async move { Ok(worlds.spawn(&owner, world, order).await?) };
        let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes: 0 };
        let npc = self.spawned.once(call, &request, spawn).await?;
        Ok(Response::new(wire::SpawnNpcResponse { npc_id: npc.0 }))
    }

    async fn batch_spawn_npcs(
        &self,
        request: Request<wire::BatchSpawnNpcsRequest>,
    ) -> Result<Response<wire::BatchSpawnNpcsResponse>, Status> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let count = request.spawns.len();
        batches::check_count(count, "spawns")?;
        let order = |spawn| Ok(batches::spawn(spawn)?);
        let orders = request.spawns.iter().map(order).collect();
        let (worlds, owner, world) = (self.worlds.clone(), caller.clone(), WorldId(request.world_id));
        // The call that spawns answers with the messages of errors as well. They are too large to be kept.
        let full = Arc::new(OnceLock::new());
        let answer = full.clone();
        let spawn = async move {
            let results = worlds.spawn_many(&owner, world, orders).await?;
            let (kept, results): (Vec<_>, Vec<_>) = results.into_iter().map(batches::spawn_result).unzip();
            // The call runs at most once.
            let _ = answer.set(results);
            Ok(kept.into())
        };
        let answer_bytes = count * size_of::<batches::Spawned>();
        let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes };
        let kept = self.spawned_batches.once(call, &request, spawn).await?;
        let full = Arc::try_unwrap(full).ok().and_then(OnceLock::into_inner);
        let results = full.unwrap_or_else(|| kept.iter().map(batches::kept_result).collect());
        Ok(Response::new(wire::BatchSpawnNpcsResponse { results }))
    }

    async fn despawn_npc(
        &self,
        request: Request<wire::DespawnNpcRequest>,
    ) -> Result<Response<wire::DespawnNpcResponse>, Status> {
        let caller = Caller::of(&request);
        let npc = NpcId(request.into_inner().npc_id);
        self.worlds.with_npc(&caller, NpcAccess::Change, npc, move |world| world.despawn(npc)).await?;
        Ok(Response::new(wire::DespawnNpcResponse {}))
    }

    async fn batch_despawn_npcs(
        &self,
        request: Request<wire::BatchDespawnNpcsRequest>,
    ) -> Result<Response<wire::BatchDespawnNpcsResponse>, Status> {
        let caller = Caller::of(&request);
        let ids = request.into_inner().npc_ids;
        batches::check_count(ids.len(), "npc_ids")?;
        let items = ids.into_iter().map(|id| Ok((NpcId(id), ()))).collect();
        let results =
            self.worlds.with_npcs(&caller, NpcAccess::Change, items, |world, npc, ()| world.despawn(npc)).await;
        let results = results.into_iter().map(batches::item_result).collect();
        Ok(Response::new(wire::BatchDespawnNpcsResponse { results }))
    }

    async fn set_goal(
        &self,
        request: Request<wire::SetGoalRequest>,
    ) -> Result<Response<wire::SetGoalResponse>, Status> {
        let caller = Caller::of(&request);
        let (npc, goal) = batches::goal(&request.into_inner())?;
        let attempt =
            self.worlds.with_npc(&caller, NpcAccess::Change, npc, move |world| world.set_goal(npc, goal)).await?;
        Ok(Response::new(wire::SetGoalResponse { attempt }))
    }

    async fn batch_set_goals(
        &self,
        request: Request<wire::BatchSetGoalsRequest>,
    ) -> Result<Response<wire::BatchSetGoalsResponse>, Status> {
        let caller = Caller::of(&request);
        use wire::set_goal_result::Result as Kind;
        let goals = request.into_inner().goals;
        batches::check_count(goals.len(), "goals")?;
        let items = goals.iter().map(|goal| Ok(batches::goal(goal)?)).collect();
        let results =
            self.worlds.with_npcs(&caller, NpcAccess::Change, items, HostedWorld::set_goal).await.into_iter().map(
                |result| {
                    let result = result.map_or_else(|error| Kind::Error(batches::item_error(error)), Kind::Attempt);
                    wire::SetGoalResult { result: Some(result) }
                },
            );
        Ok(Response::new(wire::BatchSetGoalsResponse { results: results.collect() }))
    }

    async fn teleport_npc(
        &self,
        request: Request<wire::TeleportNpcRequest>,
    ) -> Result<Response<wire::TeleportNpcResponse>, Status> {
        let caller = Caller::of(&request);
        let (npc, (position, yaw)) = batches::teleport(&request.into_inner())?;
        self.worlds.with_npc(&caller, NpcAccess::Change, npc, move |world| world.teleport(npc, position, yaw)).await?;
        Ok(Response::new(wire::TeleportNpcResponse {}))
    }

    async fn batch_teleport_npcs(
        &self,
        request: Request<wire::BatchTeleportNpcsRequest>,
    ) -> Result<Response<wire::BatchTeleportNpcsResponse>, Status> {
        let caller = Caller::of(&request);
        let teleports = request.into_inner().teleports;
        batches::check_count(teleports.len(), "teleports")?;
        let items = teleports.iter().map(|teleport| Ok(batches::teleport(teleport)?)).collect();
        let teleport = |world: &mut HostedWorld, npc, (position, yaw)| world.teleport(npc, position, yaw);
        let results = self.worlds.with_npcs(&caller, NpcAccess::Change, items, teleport).await;
        let results = results.into_iter().map(batches::item_result).collect();
        Ok(Response::new(wire::BatchTeleportNpcsResponse { results }))
    }

    async fn get_npc(&self, request: Request<wire::GetNpcRequest>) -> Result<Response<wire::GetNpcResponse>, Status> {
        let caller = Caller::of(&request);
        let npc = NpcId(request.into_inner().npc_id);
        let state = self.worlds.with_npc(&caller, NpcAccess::Read, npc, move |world| world.npc(npc)).await?;
        Ok(Response::new(wire::GetNpcResponse { npc: Some(npc_to_wire(&state)) }))
    }

    async fn batch_get_npcs(
        &self,
        request: Request<wire::BatchGetNpcsRequest>,
    ) -> Result<Response<wire::BatchGetNpcsResponse>, Status> {
        let caller = Caller::of(&request);
        use wire::get_npc_result::Result as Kind;
        let ids = request.into_inner().npc_ids;
        batches::check_count(ids.len(), "npc_ids")?;
        let items = ids.into_iter().map(|id| Ok((NpcId(id), ()))).collect();
        let results = self
            .worlds
            .with_npcs(&caller, NpcAccess::Read, items, |world, npc, ()| world.npc(npc))
            .await
            .into_iter()
            .map(|result| {
                let result = result.map(|npc| Kind::Npc(npc_to_wire(&npc)));
                wire::GetNpcResult {
                    result: Some(result.unwrap_or_else(|error| Kind::Error(batches::item_error(error)))),
                }
            });
        Ok(Response::new(wire::BatchGetNpcsResponse { results: results.collect() }))
    }

    async fn list_npcs(
        &self,
        request: Request<wire::ListNpcsRequest>,
    ) -> Result<Response<wire::ListNpcsResponse>, Status> {
        let caller = Caller::of(&request);
        let wire::ListNpcsRequest { world_id, region, page_size, page_token } = request.into_inner();
        let handle = self.worlds.handle_for(&caller, WorldId(world_id))?;
        let region = convert_region(region.as_ref())?;
        let (tick, npcs) =
            handle.sim.call(|state| (state.world.tick(), state.world.npcs().collect::<Vec<_>>())).await?;
        let npcs = npcs.into_iter().filter(|npc| region.is_none_or(|region| region.holds(npc.position)));
        let page = page_by_id(npcs, |npc| npc.id.0, NPC_PAGE, page_size, &page_token)?;
        let npcs = page.items.iter().map(npc_to_wire).collect();
        Ok(Response::new(wire::ListNpcsResponse { npcs, next_page_token: page.next_token, tick: tick.0 }))
    }

    type WatchWorldStream = ReaderStream<wire::WatchWorldResponse>;

    async fn watch_world(
        &self,
        request: Request<wire::WatchWorldRequest>,
    ) -> Result<Response<Self::WatchWorldStream>, Status> {
        let caller = Caller::of(&request);
        let wire::WatchWorldRequest { world_id, rate_hz, region, delta } = request.into_inner();
        let world = WorldId(world_id);
        let handle = self.worlds.handle_for(&caller, world)?;
        let pause = readers::pause_of(rate_hz)?;
        let view = View::new(convert_region(region.as_ref())?, delta);
        let subscribed = handle.sim.call(|state| {
            let receiver = state.snapshots.subscribe();
            state.show_snapshot();
            receiver
        });
        Ok(Response::new(readers::watch_world(
            world,
            subscribed.await?,
            view,
            pause,
            self.patience(),
            self.worlds.shutdown(),
        )))
    }

    type WatchEventsStream = ReaderStream<wire::WatchEventsResponse>;

    async fn watch_events(
        &self,
        request: Request<wire::WatchEventsRequest>,
    ) -> Result<Response<Self::WatchEventsStream>, Status> {
        let caller = Caller::of(&request);
        let wire::WatchEventsRequest { world_id, after, npc_ids } = request.into_inner();
        batches::check_count(npc_ids.len(), "npc_ids")?;
        let (world, epoch) = (WorldId(world_id), self.worlds.epoch_of(WorldId(world_id)));
        let handle = self.worlds.handle_for(&caller, world)?;
        if let Some(after) = after.filter(|after| after.epoch != epoch && after.sequence != 0) {
            let message =
                format!("after.epoch is {}, the epoch is {epoch}: the server has restarted since", after.epoch);
            return Err(status::failure(Reason::EventsLost, message));
        }
        let sequence = after.map(|after| after.sequence);
        let subscribed = handle.sim.call(move |state| {
            let log = state.world.events();
            let after = sequence.unwrap_or_else(|| log.latest());
            log.after(after, 0).map(|_| (after, state.world.tick(), state.events.subscribe()))
        });
        let (after, tick, batches) = subscribed.await?.map_err(Status::from)?;
        let begin = wire::WatchEventsResponse {
            tick: tick.0,
            server_time: Some(SystemTime::now().into()),
            cursor: Some(wire::EventCursor { epoch, sequence: after }),
            events: Vec::new(),
        };
        let npcs = npc_ids.into_iter().map(NpcId).collect();
        let source = EventSource { epoch, world, npcs, sim: handle.sim, batches, after, is_behind: true };
        Ok(Response::new(readers::watch_events(begin, source, self.patience(), self.worlds.shutdown())))
    }

    type WatchStatsStream = ReaderStream<wire::WatchStatsResponse>;

    async fn watch_stats(
        &self,
        request: Request<wire::WatchStatsRequest>,
    ) -> Result<Response<Self::WatchStatsStream>, Status> {
        let caller = Caller::of(&request);
        let wire::WatchStatsRequest { world_id, period_s } = request.into_inner();
        let world = WorldId(world_id);
        let sim = self.worlds.handle_for(&caller, world)?.sim;
        let pause = readers::period_of(period_s)?;
        Ok(Response::new(readers::watch_stats(world, sim, pause, self.patience(), self.worlds.shutdown())))
    }

    type FollowNpcStream = ReaderStream<wire::FollowNpcResponse>;

    async fn follow_npc(
        &self,
        request: Request<wire::FollowNpcRequest>,
    ) -> Result<Response<Self::FollowNpcStream>, Status> {
        let caller = Caller::of(&request);
        let wire::FollowNpcRequest { npc_id, rate_hz, rays } = request.into_inner();
        let npc = NpcId(npc_id);
        let asked = readers::pause_of(rate_hz)?;
        // Rays are cast on the world's own thread.
        let pause = if rays { asked.max(readers::pause_of(0.0)?) } else { asked };
        self.worlds.with_npc(&caller, NpcAccess::Read, npc, move |world| world.npc(npc)).await?;
        let sim = self.worlds.handle_for(&caller, npc.world())?.sim;
        Ok(Response::new(readers::follow_npc(npc, sim, rays, pause, self.patience(), self.worlds.shutdown())))
    }

    type GetMeshStream = ReaderStream<wire::GetMeshResponse>;

    async fn get_mesh(&self, request: Request<wire::GetMeshRequest>) -> Result<Response<Self::GetMeshStream>, Status> {
        let wire::GetMeshRequest { world_id, region, cell_m } = request.into_inner();
        let map = self.worlds.handle(WorldId(world_id))?.shown.get();
        let region = convert_region(region.as_ref())?;
        if cell_m != 0.0 {
            convert::in_range(f64::from(cell_m), 0.5, 16.0, "cell_m")?;
        }
        let tiles = move |map: &Map| Tiles::of(map, region.map(|region| region.corners()), cell_m);
        let turns = self.meshing.clone();
        Ok(Response::new(readers::send_mesh(map, tiles, turns, self.patience(), self.worlds.shutdown())))
    }

    async fn get_features(
        &self,
        request: Request<wire::GetFeaturesRequest>,
    ) -> Result<Response<wire::GetFeaturesResponse>, Status> {
        let map = self.worlds.handle(WorldId(request.into_inner().world_id))?.shown.get();
        Ok(Response::new(features_to_wire(&map)))
    }

    async fn list_movers(
        &self,
        request: Request<wire::ListMoversRequest>,
    ) -> Result<Response<wire::ListMoversResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.movers_of(&caller, request.into_inner()).await?))
    }

    async fn set_mover(
        &self,
        request: Request<wire::SetMoverRequest>,
    ) -> Result<Response<wire::SetMoverResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.order_mover(&caller, request.into_inner()).await?))
    }

    async fn edit_map(
        &self,
        request: Request<wire::EditMapRequest>,
    ) -> Result<Response<wire::EditMapResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.put_pieces(&caller, request.into_inner()).await?))
    }

    async fn list_pieces(
        &self,
        request: Request<wire::ListPiecesRequest>,
    ) -> Result<Response<wire::ListPiecesResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.pieces_of(&caller, request.into_inner()).await?))
    }

    async fn spawn_player(
        &self,
        request: Request<wire::SpawnPlayerRequest>,
    ) -> Result<Response<wire::SpawnPlayerResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.add_player(&caller, request.into_inner()).await?))
    }

    async fn move_players(
        &self,
        request: Request<wire::MovePlayersRequest>,
    ) -> Result<Response<wire::MovePlayersResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.place_players(&caller, request.into_inner()).await?))
    }

    async fn remove_player(
        &self,
        request: Request<wire::RemovePlayerRequest>,
    ) -> Result<Response<wire::RemovePlayerResponse>, Status> {
        let caller = Caller::of(&request);
        Ok(Response::new(self.drop_player(&caller, request.into_inner()).await?))
    }

    type WorkStream = WorkStream;

    async fn work(&self, request: Request<Streaming<wire::WorkRequest>>) -> Result<Response<Self::WorkStream>, Status> {
        let mut requests = request.into_inner();
        let hello = work::read_hello(&mut requests).await?;
        Ok(Response::new(work::serve_worker(self.worlds.clone(), hello, requests)))
    }
}
