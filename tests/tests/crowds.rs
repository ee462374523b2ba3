//! Worlds whose NPCs get in each other's way, as a game client sees them.

use e2e::{ground, small_map, spawn, start_server, watch_until, world_client};
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;

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
        let request = wire::CreateWorldRequest { map: Some(small_map(7)), solid_npcs, ..Default::default() };
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
