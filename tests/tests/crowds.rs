//! Worlds whose NPCs get in each other's way, as a game client sees them.

use e2e::{
    ground, set_goal, small_map, spawn, start_server, start_worker, start_worker_with, watch_until, world_client,
};
use surefoot_policy::{ActorConfig, Manifest, Policy, Weights};
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;

/// The shipped policy with inputs for others, which it does not use yet.
fn seeing() -> Policy {
    let shipped = Policy::shipped().unwrap();
    let own = shipped.manifest().actor;
    let config = ActorConfig { sees_others: true, ..own };
    let weights = Weights::from_burnpack(&own, shipped.weights()).unwrap();
    let mut parameters = weights.parameters().clone();
    let first = parameters.get_mut("trunk.first.weight").unwrap();
    let rows = config.sensed_len() - own.sensed_len();
    first.values.resize(first.values.len() + rows * config.hidden, 0.0);
    first.shape[0] += rows;
    let weights = Weights::new(&config, parameters).unwrap().to_burnpack();
    Policy::from_bytes(Manifest::new("seeing", config, &weights, serde_json::Value::Null), &weights).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_get_in_each_others_way_only_where_the_world_says_so_also_after_a_restart() {
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let closest = |snapshot: &wire::WatchWorldResponse| {
        let places: Vec<wire::Vec3> = snapshot.npcs.iter().filter_map(|npc| npc.position).collect();
        let apart = |a: &wire::Vec3, b: &wire::Vec3| (a.x - b.x).hypot(a.z - b.z);
        let pairs = (0..places.len()).flat_map(|one| (0..one).map(move |other| (one, other)));
        pairs.map(|(one, other)| apart(&places[one], &places[other])).fold(f32::INFINITY, f32::min)
    };
    let server = start_server(config());
    let mut client = world_client(&server).await;
    let mut worlds = Vec::new();
    for solid_npcs in [true, false] {
        // Solid is what realtime worlds are unless they say otherwise.
        let asked = if solid_npcs { None } else { Some(false) };
        let request = wire::CreateWorldRequest { map: Some(small_map(7)), solid_npcs: asked, ..Default::default() };
        let world = client.create_world(request).await.unwrap().into_inner().world.unwrap();
        assert_eq!(world.solid_npcs, solid_npcs);
        let place = ground(&mut client, world.world_id, 1).await[0];
        for _ in 0..4 {
            spawn(&mut client, world.world_id, place).await;
        }
        worlds.push((world.world_id, place));
    }
    // As far apart as they are wide.
    watch_until(&mut client, worlds[0].0, |snapshot| snapshot.npcs.len() == 4 && closest(snapshot) > 0.55).await;
    let later = watch_until(&mut client, worlds[1].0, |snapshot| snapshot.tick > 60).await;
    assert!(closest(&later) < 0.01, "{}", closest(&later));
    server.stop().await;

    let server = start_server(config());
    let mut client = world_client(&server).await;
    let (world_id, place) = worlds[0];
    watch_until(&mut client, world_id, |snapshot| snapshot.npcs.len() == 4).await;
    let request = wire::GetWorldRequest { world_id };
    assert!(client.get_world(request).await.unwrap().into_inner().world.unwrap().solid_npcs);
    spawn(&mut client, world_id, place).await;
    watch_until(&mut client, world_id, |snapshot| snapshot.npcs.len() == 5 && closest(snapshot) > 0.55).await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_whose_policy_sees_others_decides_beside_one_whose_policy_does_not() {
    let server = start_server(ServerConfig::default());
    let workers = [start_worker(&server, None, 1), start_worker_with(seeing(), &server, None, 1)];
    let mut client = world_client(&server).await;
    let request = wire::CreateWorldRequest { map: Some(small_map(7)), ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let places = ground(&mut client, world_id, 2).await;
    let npcs = [spawn(&mut client, world_id, places[0]).await, spawn(&mut client, world_id, places[0]).await];

    // Beside each other, each sees the other.
    let follow = wire::FollowNpcRequest { npc_id: npcs[0], rate_hz: 60.0, rays: true, ..Default::default() };
    let mut steps = client.follow_npc(follow).await.unwrap().into_inner();
    let sees_body = |step: &wire::FollowNpcResponse| step.rays.iter().any(|ray| ray.surface() == wire::Surface::Body);
    let meeting = async { while !sees_body(&steps.message().await.unwrap().expect("an NPC that is there")) {} };
    tokio::time::timeout(e2e::LIMIT, meeting).await.expect("it sees the other");

    for npc in npcs {
        set_goal(&mut client, npc, places[1]).await;
    }
    let decided = |stats: &wire::WorldStats| stats.decisions_answered >= 6;
    let stats = e2e::stats_until(&mut client, world_id, decided).await;
    assert_eq!((stats.npcs_without_worker, stats.answers_invalid), (0, 0), "{stats:?}");
    for worker in workers {
        worker.stop().await;
    }
    server.stop().await;
}
