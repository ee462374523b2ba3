//! `WorldService`: decode, call, encode.
//!
//! `readers` are the streams to those who watch, `work` those of workers, `env` is `EnvService`, `errors` turns the
//! server's errors into statuses.

pub mod env;
mod errors;
mod readers;
mod work;

use crate::geometry::Tiles;
use crate::ids::{NpcId, WorldId};
use crate::view::View;
use crate::wire::{features_to_wire, finite, npc_to_wire, region as convert_region, time_mode, world_to_wire};
use crate::worlds::Worlds;
use readers::ReaderStream;
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::levels::grpc as levels;
use surefoot_net::serving::Caller;
use surefoot_proto::convert;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_server::WorldService;
use surefoot_world::{Map, Seed};
use tokio::sync::Semaphore;
use tonic::{Request, Response, Status, Streaming};
use work::WorkStream;

/// Threads that may make tiles of meshes at the same time: worlds must go on meanwhile.
const MESHES_AT_A_TIME: usize = 2;

/// The service; clones share everything.
#[derive(Debug, Clone)]
pub struct WorldApi {
    worlds: Worlds,
    meshing: Arc<Semaphore>,
}

impl WorldApi {
    /// The service in front of `worlds`.
    pub fn new(worlds: Worlds) -> Self {
        Self { worlds, meshing: Arc::new(Semaphore::new(MESHES_AT_A_TIME)) }
    }

    /// How long a reader may leave everything unread.
    fn patience(&self) -> Duration {
        self.worlds.config().reader_patience
    }
}

/// Who calls, as far as quotas are concerned.
fn client_of<T>(request: &Request<T>) -> Arc<str> {
    request.extensions().get::<Caller>().map_or_else(|| "unknown".into(), |caller| caller.name.clone())
}

#[tonic::async_trait]
impl WorldService for WorldApi {
    async fn create_world(
        &self,
        request: Request<wire::CreateWorldRequest>,
    ) -> Result<Response<wire::CreateWorldResponse>, Status> {
        let client = client_of(&request);
        let request = request.into_inner();
        let source = levels::source(self.worlds.levels(), request.map.as_ref(), &request.map_hash)?;
        let world = self.worlds.create(&client, source, time_mode(request.mode)?).await?;
        Ok(Response::new(wire::CreateWorldResponse { world: Some(world_to_wire(&world)) }))
    }

    async fn list_worlds(
        &self,
        _: Request<wire::ListWorldsRequest>,
    ) -> Result<Response<wire::ListWorldsResponse>, Status> {
        let worlds = self.worlds.list().await.iter().map(world_to_wire).collect();
        Ok(Response::new(wire::ListWorldsResponse { worlds }))
    }

    async fn drop_world(
        &self,
        request: Request<wire::DropWorldRequest>,
    ) -> Result<Response<wire::DropWorldResponse>, Status> {
        self.worlds.drop_world(WorldId(request.into_inner().world_id)).await?;
        Ok(Response::new(wire::DropWorldResponse {}))
    }

    async fn sample_ground(
        &self,
        request: Request<wire::SampleGroundRequest>,
    ) -> Result<Response<wire::SampleGroundResponse>, Status> {
        let wire::SampleGroundRequest { world_id, count, seed } = request.into_inner();
        // Whether there is such a world comes first.
        self.worlds.handle(WorldId(world_id))?;
        convert::in_range(f64::from(count), 1.0, 10_000.0, "count")?;
        let points = self.worlds.sample_ground(WorldId(world_id), count as usize, Seed(seed)).await?;
        Ok(Response::new(wire::SampleGroundResponse { points: points.into_iter().map(convert::to_wire).collect() }))
    }

    async fn spawn_npc(
        &self,
        request: Request<wire::SpawnNpcRequest>,
    ) -> Result<Response<wire::SpawnNpcResponse>, Status> {
        let client = client_of(&request);
        let request = request.into_inner();
        let world = WorldId(request.world_id);
        self.worlds.handle(world)?;
        let position = convert::point(request.position.as_ref(), "position")?;
        let npc = self.worlds.spawn(&client, world, position, finite(request.yaw, "yaw")?).await?;
        Ok(Response::new(wire::SpawnNpcResponse { npc_id: npc.0 }))
    }

    async fn despawn_npc(
        &self,
        request: Request<wire::DespawnNpcRequest>,
    ) -> Result<Response<wire::DespawnNpcResponse>, Status> {
        let npc = NpcId(request.into_inner().npc_id);
        self.worlds.with_npc(npc, move |world| world.despawn(npc)).await?;
        Ok(Response::new(wire::DespawnNpcResponse {}))
    }

    async fn set_goal(
        &self,
        request: Request<wire::SetGoalRequest>,
    ) -> Result<Response<wire::SetGoalResponse>, Status> {
        let wire::SetGoalRequest { npc_id, goal } = request.into_inner();
        let (npc, goal) = (NpcId(npc_id), convert::point(goal.as_ref(), "goal")?);
        self.worlds.with_npc(npc, move |world| world.set_goal(npc, goal)).await?;
        Ok(Response::new(wire::SetGoalResponse {}))
    }

    async fn teleport_npc(
        &self,
        request: Request<wire::TeleportNpcRequest>,
    ) -> Result<Response<wire::TeleportNpcResponse>, Status> {
        let wire::TeleportNpcRequest { npc_id, position, yaw } = request.into_inner();
        let (npc, position) = (NpcId(npc_id), convert::point(position.as_ref(), "position")?);
        let yaw = finite(yaw, "yaw")?;
        self.worlds.with_npc(npc, move |world| world.teleport(npc, position, yaw)).await?;
        Ok(Response::new(wire::TeleportNpcResponse {}))
    }

    async fn get_npc(&self, request: Request<wire::GetNpcRequest>) -> Result<Response<wire::GetNpcResponse>, Status> {
        let npc = NpcId(request.into_inner().npc_id);
        let state = self.worlds.with_npc(npc, move |world| world.npc(npc)).await?;
        Ok(Response::new(wire::GetNpcResponse { npc: Some(npc_to_wire(&state)) }))
    }

    type WatchWorldStream = ReaderStream<wire::WatchWorldResponse>;

    async fn watch_world(
        &self,
        request: Request<wire::WatchWorldRequest>,
    ) -> Result<Response<Self::WatchWorldStream>, Status> {
        let wire::WatchWorldRequest { world_id, rate_hz, region, delta } = request.into_inner();
        let world = WorldId(world_id);
        let handle = self.worlds.handle(world)?;
        let pause = readers::pause_of(rate_hz)?;
        let view = View::new(convert_region(region.as_ref())?, delta);
        let subscribed = handle.sim.call(|state| {
            let receiver = state.snapshots.subscribe();
            state.publish();
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

    type FollowNpcStream = ReaderStream<wire::FollowNpcResponse>;

    async fn follow_npc(
        &self,
        request: Request<wire::FollowNpcRequest>,
    ) -> Result<Response<Self::FollowNpcStream>, Status> {
        let wire::FollowNpcRequest { npc_id, rate_hz, rays } = request.into_inner();
        let npc = NpcId(npc_id);
        let asked = readers::pause_of(rate_hz)?;
        // Rays are cast on the world's own thread.
        let pause = if rays { asked.max(readers::pause_of(0.0)?) } else { asked };
        self.worlds.with_npc(npc, move |world| world.npc(npc)).await?;
        let sim = self.worlds.handle(npc.world())?.sim;
        Ok(Response::new(readers::follow_npc(npc, sim, rays, pause, self.patience(), self.worlds.shutdown())))
    }

    type GetMeshStream = ReaderStream<wire::GetMeshResponse>;

    async fn get_mesh(&self, request: Request<wire::GetMeshRequest>) -> Result<Response<Self::GetMeshStream>, Status> {
        let wire::GetMeshRequest { world_id, region, cell_m } = request.into_inner();
        let map = self.worlds.handle(WorldId(world_id))?.map;
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
        let map = self.worlds.handle(WorldId(request.into_inner().world_id))?.map;
        Ok(Response::new(features_to_wire(&map)))
    }

    async fn stall_world(
        &self,
        request: Request<wire::StallWorldRequest>,
    ) -> Result<Response<wire::StallWorldResponse>, Status> {
        let wire::StallWorldRequest { world_id, milliseconds } = request.into_inner();
        let handle = self.worlds.handle(WorldId(world_id))?;
        let stall = convert::in_range(f64::from(milliseconds), 1.0, 1000.0, "milliseconds")?;
        handle.sim.call(move |_| std::thread::sleep(Duration::from_secs_f64(stall / 1000.0))).await?;
        Ok(Response::new(wire::StallWorldResponse {}))
    }

    type WorkStream = WorkStream;

    async fn work(&self, request: Request<Streaming<wire::WorkRequest>>) -> Result<Response<Self::WorkStream>, Status> {
        let mut requests = request.into_inner();
        let hello = work::read_hello(&mut requests).await?;
        Ok(Response::new(work::serve_worker(self.worlds.clone(), hello, requests)))
    }
}
