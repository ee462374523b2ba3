//! Bodies other than Surefoot's own: on worlds, NPCs, environments and graphs, over real sockets.

use e2e::{
    build_to_end, ground, planner_client, small_map, start_of, start_planner, start_server, start_worker, watch_until,
    world_client,
};
use std::collections::BTreeSet;
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::convert;
use surefoot_proto::planner::v1 as planner;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use surefoot_world::character::bodies::BODIES;
use surefoot_world::{MapSpec, OBSERVATION_LEN};
use tonic::transport::Channel;

fn preset(name: &str) -> wire::Body {
    wire::Body { preset: name.to_owned(), ..Default::default() }
}

async fn world_of(client: &mut WorldServiceClient<Channel>, body: Option<wire::Body>) -> wire::World {
    let request = wire::CreateWorldRequest {
        map: Some(small_map(1000)),
        mode: wire::TimeMode::Lockstep.into(),
        body,
        ..Default::default()
    };
    client.create_world(request).await.unwrap().into_inner().world.unwrap()
}

#[test]
fn every_body_survives_the_wire() {
    for body in BODIES {
        let profile = body.profile();
        let on_wire = convert::body_to_wire(&profile);
        assert_eq!((on_wire.preset.as_str(), convert::body(Some(&on_wire))), (body.name, Ok(profile.clone())));
        assert_eq!(convert::body(Some(&preset(body.name))), Ok(profile.clone()));
        let changed = profile.with(|it| it.height += 0.125).unwrap();
        let on_wire = convert::body_to_wire(&changed);
        assert_eq!((on_wire.preset.as_str(), convert::body(Some(&on_wire))), ("", Ok(changed)));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_of_several_bodies_reach_their_goals_each_by_a_graph_of_its_own() {
    let cache = tempfile::tempdir().unwrap();
    let (server, planner) =
        (start_server(ServerConfig::default()), start_planner(cache.path(), PlannerConfig::default()));
    let worker = start_worker(&server, Some(&planner), 64);
    let mut client = world_client(&server).await;
    let world = world_of(&mut client, Some(preset("unity"))).await;
    assert_eq!(world.bodies, [convert::body_to_wire(&convert::body(Some(&preset("unity"))).unwrap())]);

    let slow = wire::Body { forward_speed: Some(2.5), ..preset("climber") };
    let places = ground(&mut client, world.world_id, 24).await;
    let spawn = |pair: &[wire::Vec3], body: Option<wire::Body>| wire::Spawn {
        position: Some(pair[0]),
        goal: Some(pair[1]),
        body,
        ..Default::default()
    };
    let bodies = [None, Some(slow.clone()), Some(preset("unity"))];
    let spawns = places.chunks_exact(2).zip(bodies.iter().cycle()).map(|(pair, body)| spawn(pair, body.clone()));
    let request =
        wire::BatchSpawnNpcsRequest { world_id: world.world_id, spawns: spawns.collect(), ..Default::default() };
    client.batch_spawn_npcs(request).await.unwrap();
    let world = client.get_world(wire::GetWorldRequest { world_id: world.world_id }).await.unwrap().into_inner();
    let world = world.world.unwrap();
    assert_eq!(world.bodies.len(), 2, "equal bodies are one");
    assert_eq!(world.bodies[1].forward_speed, slow.forward_speed);

    // A body on foot seldom goes faster than it can run: only where it slides or lands.
    let speeds = std::sync::Mutex::new([vec![], vec![]]);
    let end = watch_until(&mut client, world.world_id, |snapshot| {
        for npc in &snapshot.npcs {
            let velocity = npc.velocity.unwrap();
            if npc.support() == wire::Support::Ground {
                speeds.lock().unwrap()[npc.body_idx as usize].push(velocity.x.hypot(velocity.z));
            }
        }
        snapshot.npcs.iter().all(|npc| npc.last_outcome() != wire::Outcome::Unspecified)
    })
    .await;
    let upper_quartile = |mut speeds: Vec<f32>| {
        speeds.sort_unstable_by(f32::total_cmp);
        speeds[speeds.len() * 3 / 4]
    };
    let [unity, slow] = speeds.into_inner().unwrap().map(upper_quartile);
    assert!((4.0..5.4).contains(&unity) && (1.5..2.51).contains(&slow), "{unity} and {slow} m/s");
    let indices: Vec<u32> = end.npcs.iter().map(|npc| npc.body_idx).collect();
    assert_eq!(indices, [0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0]);
    let ends: Vec<wire::Outcome> = end.npcs.iter().map(wire::Npc::last_outcome).collect();
    let told = |end: &&wire::Outcome| matches!(end, wire::Outcome::Reached | wire::Outcome::Unreachable);
    assert!(ends.iter().filter(told).count() >= 11, "{ends:?}");
    assert!(ends.iter().filter(|end| **end == wire::Outcome::Reached).count() >= 6, "{ends:?}");

    let mut planner_client = planner_client(&planner).await;
    let mut graph_speeds = async || {
        let graphs = planner_client.list_graphs(planner::ListGraphsRequest::default()).await.unwrap();
        let graphs = graphs.into_inner().graphs;
        graphs.iter().map(|it| it.body.as_ref().unwrap().forward_speed.unwrap().to_bits()).collect::<BTreeSet<u32>>()
    };
    let [unity, slow, quick] = [5.335f32, 2.5, 7.5].map(f32::to_bits);
    assert_eq!(graph_speeds().await, BTreeSet::from([unity, slow]));

    // The slow ones leave, another body takes the place of theirs, and its NPCs have a graph of their own.
    for npc in end.npcs.iter().filter(|npc| npc.body_idx == 1) {
        client.despawn_npc(wire::DespawnNpcRequest { npc_id: npc.npc_id }).await.unwrap();
    }
    let quick_body = wire::Body { forward_speed: Some(7.5), ..preset("unity") };
    let other = spawn(&places[..2], Some(quick_body));
    let request = wire::BatchSpawnNpcsRequest { world_id: world.world_id, spawns: vec![other], ..Default::default() };
    client.batch_spawn_npcs(request).await.unwrap();
    let end = watch_until(&mut client, world.world_id, |snapshot| {
        snapshot.npcs.iter().any(|npc| npc.body_idx == 1 && npc.last_outcome() != wire::Outcome::Unspecified)
    })
    .await;
    assert_eq!(end.npcs.iter().filter(|npc| npc.body_idx == 1).count(), 1);
    assert_eq!(graph_speeds().await, BTreeSet::from([unity, slow, quick]));
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn graphs_of_different_bodies_are_different_graphs() {
    let cache = tempfile::tempdir().unwrap();
    let service = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&service).await;
    let mut build = async |body: Option<wire::Body>| {
        build_to_end(&mut client, planner::StartBuildRequest { body, ..start_of(1000) }).await
    };
    let usual = build(None).await;
    assert_eq!(build(Some(preset("surefoot"))).await.graph_id, usual.graph_id, "the default body is the default");
    assert_eq!(usual.body.unwrap().preset, "surefoot");
    let heavy = build(Some(preset("heavy"))).await;
    assert_ne!(heavy.graph_id, usual.graph_id);
    assert_eq!(heavy.body.unwrap().preset, "heavy");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn bodies_that_make_no_sense_are_refused_and_name_the_field() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world = world_of(&mut client, None).await;
    let place = ground(&mut client, world.world_id, 1).await[0];
    let spawn = |body: wire::Body| wire::SpawnNpcRequest {
        world_id: world.world_id,
        position: Some(place),
        body: Some(body),
        ..Default::default()
    };
    let bad = [
        (preset("dragon"), "body.preset"),
        (wire::Body { radius: Some(9.0), ..Default::default() }, "body.radius"),
        (wire::Body { gravity: Some(f32::NAN), ..Default::default() }, "body.gravity"),
        (wire::Body { extra_jumps: Some(1000), ..Default::default() }, "body.extra_jumps"),
        // A body that has jumped would count as one that has just left the ground, and jump for ever.
        (
            wire::Body { coyote_ticks: Some(255), ..Default::default() },
            "body.coyote_ticks is 255, but must be 0 to 254",
        ),
        (wire::Body { height: Some(0.3), ..Default::default() }, "body.height"),
    ];
    for (body, field) in bad {
        let status = client.spawn_npc(spawn(body.clone())).await.unwrap_err();
        assert_eq!(Reason::of(&status), Some(Reason::InvalidField), "{status}");
        assert!(status.message().contains(field), "{status}");
        let request = wire::CreateWorldRequest { map: Some(small_map(1)), body: Some(body), ..Default::default() };
        assert!(client.create_world(request).await.unwrap_err().message().contains(field));
    }
    // The world's own body is the first of 64.
    let mut last = 0;
    for idx in 1..64 {
        let body = wire::Body { height: Some(1.0 + 0.01 * idx as f32), ..Default::default() };
        last = client.spawn_npc(spawn(body)).await.unwrap().into_inner().npc_id;
    }
    let status = client.spawn_npc(spawn(preset("heavy"))).await.unwrap_err();
    assert_eq!(Reason::of(&status), Some(Reason::TooManyBodies), "{status}");
    let known = spawn(wire::Body { height: Some(1.63), ..Default::default() });
    let twin = client.spawn_npc(known).await.expect("a body that it knows").into_inner().npc_id;
    client.spawn_npc(spawn(preset("surefoot"))).await.expect("its own");

    // 1.63 m is the body of two NPCs, and only the removal of both makes room for another body.
    client.despawn_npc(wire::DespawnNpcRequest { npc_id: last }).await.unwrap();
    client.spawn_npc(spawn(preset("heavy"))).await.expect_err("one NPC has it still");
    client.despawn_npc(wire::DespawnNpcRequest { npc_id: twin }).await.unwrap();
    for name in ["heavy", "small", "unity"] {
        let npc_id = client.spawn_npc(spawn(preset(name))).await.expect("there is room").into_inner().npc_id;
        let request = wire::GetWorldRequest { world_id: world.world_id };
        let bodies = client.get_world(request).await.unwrap().into_inner().world.unwrap().bodies;
        let npc = client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.unwrap().into_inner();
        assert_eq!(bodies.len(), 64);
        assert_eq!(bodies[npc.npc.unwrap().body_idx as usize].preset, name);
        client.despawn_npc(wire::DespawnNpcRequest { npc_id }).await.unwrap();
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ground_is_sampled_for_the_body_that_is_to_stand_there() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = world_of(&mut client, Some(preset("heavy"))).await.world_id;
    let mut sample = async |body| {
        let request = wire::SampleGroundRequest { world_id, count: 50, seed: 1, body, ..Default::default() };
        client.sample_ground(request).await.unwrap().into_inner().points
    };
    let usual = sample(None).await;
    assert_eq!(usual, sample(Some(preset("heavy"))).await, "the world's body unless told otherwise");
    assert_ne!(usual, sample(Some(preset("small"))).await);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn environments_take_bodies_and_imported_levels() {
    let server = start_server(ServerConfig::default());
    let file = surefoot_levels::encode(&surefoot_generate::generate(&MapSpec::with_side(3, 60).unwrap()));
    let mut maps = MapServiceClient::connect(server.uri.clone()).await.unwrap();
    let upload_id = "level".to_owned();
    let chunk = wire::UploadChunkRequest { upload_id: upload_id.clone(), offset: 0, data: file };
    maps.upload_chunk(chunk).await.unwrap();
    let format = wire::MapFormat::Saved.into();
    let request = wire::ImportMapRequest { name: "level".to_owned(), format, upload_id, ..Default::default() };
    let map_hash = maps.import_map(request).await.unwrap().into_inner().map.unwrap().map_hash;
    let mut client = EnvServiceClient::connect(server.uri.clone()).await.unwrap();
    let mut first = async |body: Option<wire::Body>| {
        let request = wire::CreateEnvRequest { map_hash: map_hash.clone(), npc_count: 2, body, ..Default::default() };
        let created = client.create_env(request).await.unwrap().into_inner();
        assert_eq!(created.observations.len(), 2 * OBSERVATION_LEN * 4);
        let steps = wire::StepEnvRequest {
            env_id: created.env_id,
            actions: Some(wire::EnvActions { actions: vec![0; 32], ..Default::default() }),
        };
        client.step_env(steps).await.unwrap();
        created.observations
    };
    let usual = first(None).await;
    assert_eq!(usual, first(Some(preset("surefoot"))).await);
    assert_ne!(usual, first(Some(preset("climber"))).await, "observations tell what body it is");
    let both = wire::CreateEnvRequest { map: Some(small_map(1)), map_hash, npc_count: 1, ..Default::default() };
    assert!(client.create_env(both).await.unwrap_err().message().contains("both set"));
    server.stop().await;
}
