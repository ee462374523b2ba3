//! Services that are killed and restarted, as real processes: no NPC is left without decisions.

use std::path::Path;
use std::time::Instant;
use surefoot_processes::{LIMIT, Process, free_address, surefoot};
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, NpcStatus};
use tonic::transport::Channel;

const NPCS: usize = 6;

async fn connect(address: &str) -> WorldServiceClient<Channel> {
    let channel = surefoot_processes::connect(address.parse().expect("an address")).await;
    let mut client = WorldServiceClient::new(channel);
    let since = Instant::now();
    // The server may still be restoring its worlds.
    while let Err(status) = client.get_server(wire::GetServerRequest {}).await {
        assert!(since.elapsed() < LIMIT, "no server: {status}");
    }
    client
}

fn start(args: &[&str]) -> Process {
    Process::spawn_silent(surefoot(args))
}

/// The services, and a world that outlives them.
struct Scene {
    address: String,
    services: [Process; 3],
    world_id: u64,
    points: Vec<wire::Vec3>,
}

impl Scene {
    async fn start(folder: &Path) -> Self {
        let (address, planner) = (free_address().to_string(), free_address().to_string());
        let (server_uri, planner_uri) = (format!("http://{address}"), format!("http://{planner}"));
        let path = |name: &str| folder.join(name).to_str().expect("a plain name").to_owned();
        let (state, cache) = (path("state"), path("cache"));
        let services = [
            start(&["serve", "--listen", &address, "--state", &state, "--save-every", "0.1"]),
            start(&["plan", "--listen", &planner, "--cache", &cache, "--threads", "2"]),
            start(&["work", "--server", &server_uri, "--planner", &planner_uri, "--vertices", "40"]),
        ];
        let mut client = connect(&address).await;
        let map = wire::MapSpec {
            seed: 1000,
            size: Some(wire::MapSize { width: 60, height: 40, depth: 60 }),
            ..Default::default()
        };
        let request =
            wire::CreateWorldRequest { map: Some(map), mode: wire::TimeMode::Realtime.into(), ..Default::default() };
        let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
        let request = wire::SampleGroundRequest { world_id, count: 100, seed: 3, body: None, ..Default::default() };
        let points = client.sample_ground(request).await.unwrap().into_inner().points;
        for point in &points[..NPCS] {
            let request = wire::SpawnNpcRequest { world_id, position: Some(*point), ..Default::default() };
            client.spawn_npc(request).await.unwrap();
        }
        Self { address, services, world_id, points }
    }

    /// A goal near `from`: the test checks that NPCs get decisions, not how far they get.
    fn goal_near(&self, from: wire::Vec3) -> wire::Vec3 {
        let distance = |a: &wire::Vec3| (a.x - from.x).hypot(a.z - from.z) + 3.0 * (a.y - from.y).abs();
        let others = self.points.iter().filter(|point| distance(point) > 2.0);
        *others.min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("several points")
    }

    /// Sends every NPC to a goal and waits until every attempt has ended. Connects each time, because the server may
    /// have been restarted.
    async fn everybody_gets_an_end(&self) {
        let mut client = connect(&self.address).await;
        let mut wanted: Vec<(u64, u32)> = Vec::new();
        for npc in self.npcs(&mut client).await {
            if npc.status() == NpcStatus::Down {
                let request = wire::TeleportNpcRequest {
                    npc_id: npc.npc_id,
                    position: Some(self.points[0]),
                    yaw: 0.0,
                    ..Default::default()
                };
                client.teleport_npc(request).await.unwrap();
            }
            let goal = self.goal_near(npc.position.unwrap());
            client
                .set_goal(wire::SetGoalRequest { npc_id: npc.npc_id, goal: Some(goal), ..Default::default() })
                .await
                .unwrap();
            wanted.push((npc.npc_id, npc.attempts_begun + 1));
        }
        assert_eq!(wanted.len(), NPCS, "all of them are still there");
        let since = Instant::now();
        loop {
            let npcs = self.npcs(&mut client).await;
            let is_done = |npc: &wire::Npc| npc.status() != NpcStatus::Seeking && npc.worker_id != 0;
            if npcs.len() == NPCS && npcs.iter().all(is_done) {
                return;
            }
            assert!(since.elapsed() < LIMIT, "stuck: {npcs:?}");
        }
    }

    /// All NPCs, from the next snapshot.
    async fn npcs(&self, client: &mut WorldServiceClient<Channel>) -> Vec<wire::Npc> {
        let request = wire::WatchWorldRequest { world_id: self.world_id, ..Default::default() };
        let mut snapshots = client.watch_world(request).await.expect("the world is there").into_inner();
        snapshots.message().await.expect("a snapshot").expect("a snapshot").npcs
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn services_that_are_killed_in_any_order_leave_no_npc_behind() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = Scene::start(folder.path()).await;
    scene.everybody_gets_an_end().await;
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        // The world must have been saved with its NPCs before the server is killed.
        let saved = || std::fs::read_dir(folder.path().join("state")).is_ok_and(|mut files| files.next().is_some());
        let since = Instant::now();
        while !saved() {
            assert!(since.elapsed() < LIMIT, "nothing is saved");
            tokio::task::yield_now().await;
        }
        for idx in order {
            scene.services[idx].restart();
        }
        scene.everybody_gets_an_end().await;
    }
}
