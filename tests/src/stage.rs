//! Worlds on levels of boxes, for tests.

use crate::{Running, Worker, start_planner, start_server, start_worker_of, watch_until, worker_config, world_client};
use surefoot_agent::WorkConfig;
use surefoot_planner_service::PlannerConfig;
use surefoot_policy::Policy;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::set_mover_request::Where;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use surefoot_world::map::mover::cuboid;
use tempfile::TempDir;
use tonic::transport::Channel;

/// An OBJ file of boxes with names.
pub fn level(boxes: &[(&str, [f32; 3], [f32; 3])]) -> Vec<u8> {
    let (mut text, mut count) = (String::new(), 0);
    for (name, low, high) in boxes {
        text.push_str(&format!("o {name}\n"));
        for face in cuboid((*low).into(), (*high).into()) {
            face.iter().for_each(|corner| text.push_str(&format!("v {} {} {}\n", corner.x, corner.y, corner.z)));
            count += 3;
            text.push_str(&format!("f {} {} {count}\n", count - 2, count - 1));
        }
    }
    text.into_bytes()
}

/// A world on a level.
pub struct Stage {
    /// The client that made it.
    pub client: WorldServiceClient<Channel>,
    /// The world.
    pub world_id: u64,
    /// Where the level's origin lies on the map.
    pub origin: wire::Vec3,
    /// Height of the map, m.
    pub height: f32,
}

impl Stage {
    /// A place of the level on the map.
    pub fn at(&self, [x, y, z]: [f32; 3]) -> wire::Vec3 {
        wire::Vec3 { x: x + self.origin.x, y: y + self.origin.y, z: z + self.origin.z }
    }

    /// Tells a mover where to go.
    pub async fn order(&mut self, name: &str, r#where: Where) -> wire::MoverState {
        let r#where = Some(r#where);
        let request = wire::SetMoverRequest {
            world_id: self.world_id,
            name: name.to_owned(),
            r#where,
            pace: None,
            ..Default::default()
        };
        self.client.set_mover(request).await.unwrap().into_inner().state.unwrap()
    }

    /// Waits until the only NPC has ended so many attempts, and returns how the last one ended, and where.
    pub async fn end_of(&mut self, attempts: u32) -> (wire::Outcome, wire::Vec3) {
        let has_ended = |snapshot: &wire::WatchWorldResponse| {
            snapshot.npcs.first().is_some_and(|npc| npc.attempts_ended >= attempts)
        };
        let npc = watch_until(&mut self.client, self.world_id, has_ended).await.npcs[0];
        (npc.last_outcome(), npc.position.unwrap())
    }
}

/// Imports a level and creates a world on it.
pub async fn world_of(server: &Running, file: Vec<u8>, mode: wire::TimeMode) -> Stage {
    // Returns once the server is ready.
    let mut client = world_client(server).await;
    let mut maps = MapServiceClient::connect(server.uri.clone()).await.unwrap();
    let format = wire::MapFormat::Obj.into();
    let request = wire::ImportMapRequest { name: "level.obj".to_owned(), format, file, ..Default::default() };
    let imported = maps.import_map(request).await.unwrap().into_inner();
    let wire::Vec3d { x, y, z } = imported.origin.unwrap();
    let origin = wire::Vec3 { x: x as f32, y: y as f32, z: z as f32 };
    let wire::KeptMap { map_hash, size, .. } = imported.map.unwrap();
    let request = wire::CreateWorldRequest { map_hash, mode: mode.into(), ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    Stage { client, world_id, origin, height: size.unwrap().height as f32 }
}

/// The services of a test.
pub struct Services {
    /// The world server.
    pub server: Running,
    /// The planner.
    pub planner: Running,
    /// Its worker.
    pub worker: Worker,
    /// Where the planner keeps its graphs.
    _cache: TempDir,
}

impl Services {
    /// Starts a server, a planner, and a worker for 8 NPCs.
    pub fn start() -> Self {
        let cache = tempfile::tempdir().unwrap();
        let server = start_server(ServerConfig::default());
        let planner = start_planner(cache.path(), PlannerConfig::default());
        let worker = start_planning_worker(&server, &planner);
        Self { server, planner, worker, _cache: cache }
    }

    /// Stops them.
    pub async fn stop(self) {
        self.worker.stop().await;
        self.planner.stop().await;
        self.server.stop().await;
    }
}

/// A worker for 8 NPCs that plans on graphs of 120 vertices.
pub fn start_planning_worker(server: &Running, planner: &Running) -> Worker {
    start_planning_worker_for(8, server, planner)
}

/// A worker for so many NPCs that plans on graphs of 120 vertices.
pub fn start_planning_worker_for(capacity: u32, server: &Running, planner: &Running) -> Worker {
    let config = worker_config(server, Some(planner), capacity);
    let graph = config.graph.with(|it| (it.vertices, it.neighbours, it.repeats) = (120, 12, 2)).unwrap();
    start_worker_of(WorkConfig { graph, ..config }, Policy::shipped().unwrap())
}
