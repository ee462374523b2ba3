//! Hosted NPCs over a void: they rehearse what lies ahead, and say so where no way leads.

use e2e::{ground, set_goal, spawn, start_planner, start_server, start_worker, stats_until, world_client};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::{self as wire, TimeMode};
use surefoot_server::ServerConfig;

/// Attempts that have ended.
fn ended(stats: &wire::WorldStats) -> u64 {
    stats.reached + harmed(stats) + stats.no_progress + stats.unreachable
}

fn harmed(stats: &wire::WorldStats) -> u64 {
    stats.fell + stats.burnt + stats.drowned
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_on_islands_arrive_and_nobody_falls() {
    let folder = tempfile::tempdir().unwrap();
    let (server, planner) =
        (start_server(ServerConfig::default()), start_planner(folder.path(), PlannerConfig::default()));
    let worker = start_worker(&server, Some(&planner), 64);
    let mut client = world_client(&server).await;
    let size = Some(wire::MapSize { width: 100, height: 80, depth: 100 });
    let map = wire::MapSpec { seed: 1000, size, kind: wire::MapKind::Islands.into(), ..Default::default() };
    let request = wire::CreateWorldRequest { map: Some(map), mode: TimeMode::Lockstep.into(), ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let places = ground(&mut client, world_id, 64).await;
    for pair in places.chunks_exact(2) {
        let npc = spawn(&mut client, world_id, pair[0]).await;
        set_goal(&mut client, npc, pair[1]).await;
    }
    let stats = stats_until(&mut client, world_id, |stats| ended(stats) == 32).await;
    assert_eq!(harmed(&stats), 0, "{stats:?}");
    assert!(stats.reached >= 24, "{stats:?}");
    worker.stop().await;
    server.stop().await;
    planner.stop().await;
}

/// Two platforms of 12 x 12 m, 40 m apart.
const PLATFORMS: &str = "v 0 5 0\nv 12 5 0\nv 12 5 12\nv 0 5 12\nv 52 5 0\nv 64 5 0\nv 64 5 12\nv 52 5 12\n\
    f 1 4 3 2\nf 5 8 7 6\n";

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_beyond_a_void_is_called_unreachable_in_a_level_that_the_worker_downloads() {
    let folder = tempfile::tempdir().unwrap();
    let (server, planner) =
        (start_server(ServerConfig::default()), start_planner(folder.path(), PlannerConfig::default()));
    let worker = start_worker(&server, Some(&planner), 64);
    let mut client = world_client(&server).await;
    let mut maps = MapServiceClient::connect(server.uri.clone()).await.unwrap();
    let import = wire::ImportMapRequest {
        name: "platforms".to_owned(),
        format: wire::MapFormat::Obj.into(),
        file: PLATFORMS.into(),
        ..Default::default()
    };
    let level = maps.import_map(import).await.unwrap().into_inner().map.unwrap();
    let mode = TimeMode::Lockstep.into();
    let request = wire::CreateWorldRequest { map_hash: level.map_hash, mode, ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let places = ground(&mut client, world_id, 200).await;
    let middle = (places.iter().map(|place| place.x).fold(f32::MIN, f32::max)
        + places.iter().map(|place| place.x).fold(f32::MAX, f32::min))
        / 2.0;
    let (left, right): (Vec<wire::Vec3>, Vec<wire::Vec3>) = places.iter().partition(|place| place.x < middle);
    for (start, goal) in left.iter().zip(&right).take(8) {
        let npc = spawn(&mut client, world_id, *start).await;
        set_goal(&mut client, npc, *goal).await;
    }
    let stats = stats_until(&mut client, world_id, |stats| ended(stats) == 8).await;
    assert_eq!((stats.unreachable, harmed(&stats)), (8, 0), "{stats:?}");
    worker.stop().await;
    server.stop().await;
    planner.stop().await;
}
