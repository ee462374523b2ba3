//! The world server as game clients and remote trainers use it.

use e2e::{
    LIMIT, build_graph, create_world, follow_until_planned, ground, metrics, planner_client, set_goal, small_map,
    spawn, start_planner, start_server, start_worker, stats, stats_until, until_metrics_say, watch, watch_until,
    world_client,
};
use std::time::Duration;
use surefoot_net::levels::MapPool;
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::convert::{pack, unpack};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use surefoot_world::{OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN};
use tokio_stream::StreamExt;
use tonic::Code;

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_gets_its_region_and_then_only_changes() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 10, wire::TimeMode::Realtime).await.world_id;
    let mut points = ground(&mut client, world_id, 40).await;
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    let mut npcs = Vec::new();
    for point in &points[..20] {
        npcs.push(spawn(&mut client, world_id, *point).await);
    }
    // NPCs come to rest where they were spawned, so nothing changes by itself.
    let border = 0.5 * (points[9].x + points[10].x);
    let corner = |x, y, z| Some(wire::Vec3 { x, y, z });
    let region = wire::Region { low: corner(-1.0, -100.0, -1.0), high: corner(border, 1000.0, 1000.0) };
    let request =
        wire::WatchWorldRequest { world_id, rate_hz: 60.0, region: Some(region), delta: true, ..Default::default() };
    let mut snapshots = client.watch_world(request).await.unwrap().into_inner();
    let first = snapshots.next().await.unwrap().unwrap();
    assert!(!first.is_delta && first.npcs.iter().map(|npc| npc.npc_id).eq(npcs[..10].iter().copied()));
    // One NPC leaves the region, one is removed, one enters.
    let teleport = |npc_id, position| wire::TeleportNpcRequest {
        npc_id,
        position: Some(position),
        yaw: 0.0,
        ..Default::default()
    };
    client.teleport_npc(teleport(npcs[0], points[39])).await.unwrap();
    client.despawn_npc(wire::DespawnNpcRequest { npc_id: npcs[1] }).await.unwrap();
    client.teleport_npc(teleport(npcs[19], points[2])).await.unwrap();
    let (mut gone, mut came) = (Vec::new(), Vec::new());
    let changes = async {
        while gone.len() < 2 || came.is_empty() {
            let change = snapshots.next().await.unwrap().unwrap();
            assert!(change.is_delta);
            gone.extend(change.gone_npc_ids);
            came.extend(change.npcs.iter().map(|npc| npc.npc_id).filter(|id| *id == npcs[19]));
            assert!(change.npcs.iter().all(|npc| npcs[..10].contains(&npc.npc_id) || npc.npc_id == npcs[19]));
        }
    };
    tokio::time::timeout(LIMIT, changes).await.expect("the changes are sent");
    gone.sort_unstable();
    assert_eq!(gone, npcs[..2]);

    let upside_down = wire::Region { low: corner(0.0, 10.0, 0.0), high: corner(10.0, 0.0, 10.0) };
    let request = wire::WatchWorldRequest { world_id, region: Some(upside_down), ..Default::default() };
    let refusal = client.watch_world(request).await.unwrap_err();
    assert!(refusal.code() == Code::InvalidArgument && refusal.message().contains("region.high.y"), "{refusal}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_follows_an_npc_and_its_plan() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    build_graph(&mut planner_client(&planner).await, 1000).await;
    let worker = start_worker(&server, Some(&planner), 8);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    let points = ground(&mut client, world_id, 2).await;
    let npc_id = spawn(&mut client, world_id, points[0]).await;
    let mut steps = client
        .follow_npc(wire::FollowNpcRequest { npc_id, rate_hz: 60.0, rays: false, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    let first = steps.next().await.unwrap().unwrap();
    assert_eq!(first.plan.expect("the first message has a plan").waypoints, [], "an idle NPC has no plan");
    let plan = follow_until_planned(&mut client, &mut steps, npc_id, [points[0], points[1]]).await;
    assert_eq!(plan.waypoints.last(), Some(&points[1]), "a plan ends at the goal");
    assert_eq!(plan.legs.len(), plan.waypoints.len());
    assert!(plan.legs.iter().all(|leg| leg.seconds > 0.0 && (0.0..=1.0).contains(&leg.chance)));
    client.despawn_npc(wire::DespawnNpcRequest { npc_id }).await.unwrap();
    let end = loop {
        match tokio::time::timeout(LIMIT, steps.next()).await.expect("the stream ends").unwrap() {
            Ok(_) => {}
            Err(status) => break status,
        }
    };
    assert_eq!(end.code(), Code::NotFound);
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_that_does_not_read_is_cut_off_and_others_go_on() {
    let server = start_server(ServerConfig { reader_patience: Duration::from_millis(50), ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 11, wire::TimeMode::Realtime).await.world_id;
    let start = ground(&mut client, world_id, 1).await[0];
    // Snapshots larger than the connection's flow-control window.
    for _ in 0..1500 {
        spawn(&mut client, world_id, start).await;
    }
    let channel = tonic::transport::Endpoint::from_shared(server.uri.clone())
        .unwrap()
        .initial_stream_window_size(65_535)
        .initial_connection_window_size(65_535)
        .connect()
        .await
        .unwrap();
    let mut idle = WorldServiceClient::new(channel);
    let mut unread = watch(&mut idle, world_id, 60.0).await;
    let mut read = watch(&mut client, world_id, 60.0).await;
    // Both readers must be counted before one of them can be missing.
    for _ in 0..60 {
        read.next().await.unwrap().unwrap();
    }
    let one_left = format!("surefoot_watchers{{world=\"{world_id}\"}} 1");
    // The other one reads on meanwhile, or it would be cut off as well.
    tokio::select! {
        () = until_metrics_say(&server, &one_left) => {}
        () = async { while read.next().await.is_some_and(|it| it.is_ok()) {} } => {
            panic!("a reader that reads is cut off")
        }
    }
    let rest = async {
        loop {
            match unread.next().await.expect("a status at the end") {
                Ok(snapshot) => assert_eq!(snapshot.npcs.len(), 1500),
                Err(status) => break status,
            }
        }
    };
    let end = tokio::time::timeout(LIMIT, rest).await.expect("the stream ends");
    assert_eq!(end.code(), Code::Aborted, "{end}");
    let before = read.next().await.unwrap().unwrap().tick;
    assert!(read.next().await.unwrap().unwrap().tick > before, "the other reader goes on");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_has_its_quotas_and_gets_room_back() {
    let config = ServerConfig { max_worlds_per_client: 1, max_npcs_per_client: 2, ..ServerConfig::default() };
    let server = start_server(config);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 12, wire::TimeMode::Realtime).await.world_id;
    let create = wire::CreateWorldRequest { map: Some(small_map(13)), mode: 0, ..Default::default() };
    let refusal = client.create_world(create).await.unwrap_err();
    assert!(refusal.code() == Code::ResourceExhausted && refusal.message().contains("--max-worlds-per-client"));
    let start = ground(&mut client, world_id, 1).await[0];
    let npcs = [spawn(&mut client, world_id, start).await, spawn(&mut client, world_id, start).await];
    let one_more = wire::SpawnNpcRequest { world_id, position: Some(start), ..Default::default() };
    let refusal = client.spawn_npc(one_more).await.unwrap_err();
    assert!(refusal.code() == Code::ResourceExhausted && refusal.message().contains("--max-npcs-per-client"));
    client.despawn_npc(wire::DespawnNpcRequest { npc_id: npcs[0] }).await.unwrap();
    spawn(&mut client, world_id, start).await;
    client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    until_metrics_say(&server, "surefoot_worlds 0").await;
    let world_id = create_world(&mut client, 13, wire::TimeMode::Realtime).await.world_id;
    let start = ground(&mut client, world_id, 1).await[0];
    spawn(&mut client, world_id, start).await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_joins_takes_npcs_over_without_a_missed_decision() {
    let server = start_server(ServerConfig::default());
    let first = start_worker(&server, None, 64);
    let mut client = world_client(&server).await;
    // Lockstep waits for every answer: a decision lost between two workers would stop the world for good.
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await.world_id;
    let points = ground(&mut client, world_id, 24).await;
    let mut npc_ids = Vec::new();
    for idx in 0..12 {
        let npc_id = spawn(&mut client, world_id, points[idx]).await;
        set_goal(&mut client, npc_id, points[12 + idx]).await;
        npc_ids.push(npc_id);
    }
    let shared_by = |count: usize| {
        move |snapshot: &wire::WatchWorldResponse| {
            let workers: std::collections::BTreeSet<u64> = snapshot.npcs.iter().map(|npc| npc.worker_id).collect();
            !workers.contains(&0) && workers.len() == count
        }
    };
    watch_until(&mut client, world_id, shared_by(1)).await;
    let second = start_worker(&server, None, 64);
    // Each NPC moves at its next decision.
    watch_until(&mut client, world_id, |snapshot| {
        let of_second = snapshot.npcs.iter().filter(|npc| npc.worker_id == 2).count();
        assert!(of_second <= 6, "half of them: {of_second}");
        shared_by(2)(snapshot) && of_second == 6
    })
    .await;
    let answered = stats(&mut client, world_id).await.decisions_answered;
    // A lockstep world is as fast as its workers: the first attempts may have ended.
    for (&npc_id, goal) in npc_ids.iter().zip(&points[12..]) {
        client
            .teleport_npc(wire::TeleportNpcRequest {
                npc_id,
                position: Some(points[0]),
                yaw: 0.0,
                ..Default::default()
            })
            .await
            .unwrap();
        set_goal(&mut client, npc_id, *goal).await;
    }
    let stats = stats_until(&mut client, world_id, |stats| stats.decisions_answered > answered + 200).await;
    assert_eq!((stats.decisions_missed, stats.npcs_without_worker), (0, 0));
    first.stop().await;
    second.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_outlive_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let config = ServerConfig { state: Some(folder.path().join("worlds")), ..ServerConfig::default() };
    let server = start_server(config.clone());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await.world_id;
    let dropped = create_world(&mut client, 14, wire::TimeMode::Realtime).await.world_id;
    let points = ground(&mut client, world_id, 3).await;
    let seeker = spawn(&mut client, world_id, points[0]).await;
    let idler = spawn(&mut client, world_id, points[1]).await;
    set_goal(&mut client, seeker, points[2]).await;
    client.drop_world(wire::DropWorldRequest { world_id: dropped }).await.unwrap();
    server.stop().await;
    std::fs::write(folder.path().join("worlds/77.world"), b"SFWORLD\nnot a world").unwrap();

    let server = start_server(config);
    let mut client = world_client(&server).await;
    let worlds = client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap().into_inner().worlds;
    assert_eq!(worlds.len(), 1, "the dropped one stays dropped, the damaged one is skipped");
    assert_eq!((worlds[0].world_id, worlds[0].npc_count), (world_id, 2));
    let npc = client
        .get_npc(wire::GetNpcRequest { npc_id: seeker, ..Default::default() })
        .await
        .unwrap()
        .into_inner()
        .npc
        .unwrap();
    assert_eq!((npc.goal, npc.attempts_begun, npc.attempts_ended), (Some(points[2]), 1, 0));
    let other = create_world(&mut client, 15, wire::TimeMode::Realtime).await.world_id;
    assert!(other > world_id, "ids are not used twice");
    let worker = start_worker(&server, None, 8);
    watch_until(&mut client, world_id, |snapshot| {
        snapshot.npcs.iter().any(|npc| npc.npc_id == seeker && npc.last_outcome != 0)
    })
    .await;
    assert!(client.get_npc(wire::GetNpcRequest { npc_id: idler, ..Default::default() }).await.is_ok());
    worker.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_environment_of_given_goals_has_one_episode_for_each() {
    let server = start_server(ServerConfig::default());
    let mut client = EnvServiceClient::connect(server.uri.clone()).await.unwrap();
    let drawn = wire::CreateWorldRequest { map: Some(small_map(20)), ..Default::default() };
    let mut worlds = WorldServiceClient::connect(server.uri.clone()).await.unwrap();
    let world_id = worlds.create_world(drawn).await.unwrap().into_inner().world.unwrap().world_id;
    let request = wire::SampleGroundRequest { world_id, count: 2, ..Default::default() };
    let points = worlds.sample_ground(request).await.unwrap().into_inner().points;
    // The first NPC stands where it wants to be, the second one elsewhere.
    let goal =
        |start: usize, goal: usize| wire::EnvGoal { start: Some(points[start]), yaw: 1.0, goal: Some(points[goal]) };
    let request =
        wire::CreateEnvRequest { map: Some(small_map(20)), goals: vec![goal(0, 0), goal(0, 1)], ..Default::default() };
    let created = client.create_env(request.clone()).await.unwrap().into_inner();
    assert_eq!(created.observations.len(), 2 * OBSERVATION_LEN * 4);
    let mut last = Vec::new();
    for step in 0..3 {
        let actions = Some(wire::EnvActions { actions: pack([0.0; 8]), ..Default::default() });
        let step_request = wire::StepEnvRequest { env_id: created.env_id, actions };
        let results = client.step_env(step_request).await.unwrap().into_inner().results.unwrap();
        let rewards = unpack(&results.rewards, 2, "rewards").unwrap();
        let first = results.observations[..OBSERVATION_LEN * 4].to_vec();
        if step == 0 {
            assert_eq!(results.ends.len(), 1);
            assert_eq!((results.ends[0].npc, results.ends[0].outcome()), (0, wire::Outcome::Reached));
            assert!(rewards[0] > 0.9);
        } else {
            assert!(results.ends.is_empty() && rewards[0] == 0.0 && first == last, "it rests");
        }
        last = first;
    }
    let far = wire::EnvGoal { yaw: f32::NAN, ..goal(0, 1) };
    for (goals, words) in [(vec![far], "goals.yaw"), (vec![wire::EnvGoal::default()], "goals.start")] {
        let refusal = client.create_env(wire::CreateEnvRequest { goals, ..request.clone() }).await.unwrap_err();
        assert!(refusal.code() == Code::InvalidArgument && refusal.message().contains(words), "{refusal}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainer_steps_an_environment_by_call_and_by_stream_alike() {
    const NPCS: usize = 6;
    let server = start_server(ServerConfig { max_envs: 2, ..ServerConfig::default() });
    let mut client = EnvServiceClient::connect(server.uri.clone()).await.unwrap();
    let request = wire::CreateEnvRequest {
        map: Some(small_map(20)),
        npc_count: NPCS as u32,
        seed: 5,
        goal_min_m: 2.0,
        goal_max_m: 6.0,
        ..Default::default()
    };
    let one = client.create_env(request.clone()).await.unwrap().into_inner();
    let two = client.create_env(request.clone()).await.unwrap().into_inner();
    assert_eq!(one.observations, two.observations, "same seed, same start");
    assert_eq!(one.observations.len(), NPCS * OBSERVATION_LEN * 4);
    let full = client.create_env(request.clone()).await.unwrap_err();
    assert!(full.code() == Code::ResourceExhausted && full.message().contains("--max-envs"), "{full}");

    let actions = |step: usize| {
        let values = (0..NPCS * 4).map(move |idx| ((idx * 5 + step) as f32 * 0.7).sin());
        Some(wire::EnvActions { actions: pack(values), ..Default::default() })
    };
    let (requests, stream) = tokio::sync::mpsc::channel(1);
    let requests_in = tokio_stream::wrappers::ReceiverStream::new(stream);
    let mut results = client.stream_env(requests_in).await.unwrap().into_inner();
    let mut ends = 0;
    for step in 0..320 {
        let by_call = client.step_env(wire::StepEnvRequest { env_id: one.env_id, actions: actions(step) });
        let by_call = by_call.await.unwrap().into_inner().results.unwrap();
        requests.send(wire::StreamEnvRequest { env_id: two.env_id, actions: actions(step) }).await.unwrap();
        let by_stream = results.next().await.unwrap().unwrap().results.unwrap();
        assert_eq!(by_call, by_stream, "step {step}");
        assert_eq!(by_call.rewards.len(), NPCS * 4);
        assert!(by_call.ends.iter().all(|end| end.final_observation.len() == OBSERVATION_LEN * 4));
        ends += by_call.ends.len();
    }
    assert!(ends > 0, "with patience for 300 decisions some episode ends in 320");

    client.close_env(wire::CloseEnvRequest { env_id: two.env_id }).await.unwrap();
    let solid =
        client.create_env(wire::CreateEnvRequest { solid_npcs: true, ..request.clone() }).await.unwrap().into_inner();
    assert_eq!(solid.observation_len as usize, OBSERVATION_WITH_OTHERS_LEN);
    assert_eq!(solid.observations.len(), NPCS * OBSERVATION_WITH_OTHERS_LEN * 4);
    let step = client.step_env(wire::StepEnvRequest { env_id: solid.env_id, actions: actions(0) });
    let results = step.await.unwrap().into_inner().results.unwrap();
    assert_eq!(results.observations.len(), NPCS * OBSERVATION_WITH_OTHERS_LEN * 4);

    let step = |env_id, actions| wire::StepEnvRequest { env_id, actions };
    for (request, code, words) in [
        (step(99, actions(0)), Code::NotFound, "environment 99"),
        (step(one.env_id, None), Code::InvalidArgument, "actions is missing"),
        (
            step(one.env_id, Some(wire::EnvActions { actions: vec![0; 7], ..Default::default() })),
            Code::InvalidArgument,
            "7 bytes",
        ),
        (
            step(one.env_id, Some(wire::EnvActions { actions: pack([f32::NAN; NPCS * 4]), ..Default::default() })),
            Code::InvalidArgument,
            "npc 0: action[0] is NaN",
        ),
    ] {
        let refusal = client.step_env(request).await.unwrap_err();
        assert!(refusal.code() == code && refusal.message().contains(words), "{refusal}");
    }
    for (changed, words) in [
        (wire::CreateEnvRequest { npc_count: 0, ..request.clone() }, "npc_count"),
        (wire::CreateEnvRequest { goal_max_m: f32::NAN, ..request.clone() }, "goal_max_m"),
        (wire::CreateEnvRequest { goal_min_m: 9.0, ..request.clone() }, "goal_max_m"),
        (wire::CreateEnvRequest { map: None, ..request.clone() }, "map is missing"),
    ] {
        let refusal = client.create_env(changed).await.unwrap_err();
        assert!(refusal.code() == Code::InvalidArgument && refusal.message().contains(words), "{refusal}");
    }
    client.close_env(wire::CloseEnvRequest { env_id: one.env_id }).await.unwrap();
    assert_eq!(
        client.close_env(wire::CloseEnvRequest { env_id: one.env_id }).await.unwrap_err().code(),
        Code::NotFound
    );
    client.create_env(request.clone()).await.expect("there is room again");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_world_that_stands_still_is_listed_as_silent_and_hides_no_other() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let stalled = create_world(&mut client, 16, wire::TimeMode::Realtime).await.world_id;
    let other = create_world(&mut client, 17, wire::TimeMode::Realtime).await.world_id;
    // A world without a worker waits for calls: it is not silent.
    let waiting = create_world(&mut client, 18, wire::TimeMode::Lockstep).await.world_id;
    let stalls = (0..20).map(|_| tokio::spawn(server.stall(stalled, Duration::from_secs(1)))).collect::<Vec<_>>();
    let silent = async {
        loop {
            let list = client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap().into_inner();
            assert_eq!(list.worlds.iter().map(|world| world.world_id).collect::<Vec<_>>(), [stalled, other, waiting]);
            if list.silent_world_ids == [stalled] {
                return list.worlds;
            }
            tokio::task::yield_now().await;
        }
    };
    let before = tokio::time::timeout(LIMIT, silent).await.expect("the silent world is named");
    // The figures of all worlds are there, and those of the others go on.
    let going_on = async {
        loop {
            let text = metrics(&server, "").await;
            let ticks = |world_id: u64| {
                let name = format!("surefoot_ticks_total{{world=\"{world_id}\"}} ");
                text.lines().find_map(|line| line.strip_prefix(&name)?.parse::<u64>().ok()).expect("a figure")
            };
            assert!(ticks(stalled) >= before[0].tick && ticks(waiting) == 0);
            if ticks(other) > before[1].tick + 3 {
                return;
            }
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, going_on).await.expect("the other world goes on");
    drop(stalls);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_idle_environment_gives_its_memory_back() {
    // A map of 100 x 80 x 100 m takes 12.1 MB to generate, by the estimate, and 450 NPCs take 3.7 MB.
    let config = ServerConfig {
        maps: MapPool::within(16_000_000),
        idle_envs_after: Duration::from_millis(50),
        ..ServerConfig::default()
    };
    let server = start_server(config);
    let mut trainer = EnvServiceClient::connect(server.uri.clone()).await.unwrap();
    let request = wire::CreateEnvRequest { map: Some(small_map(20)), npc_count: 450, ..Default::default() };
    let env_id = trainer.create_env(request).await.unwrap().into_inner().env_id;
    // The trainer is silent, and no other environment is created.
    let mut client = world_client(&server).await;
    let request = wire::CreateWorldRequest { map: Some(small_map(21)), ..Default::default() };
    let created = async {
        while let Err(status) = client.create_world(request.clone()).await {
            assert_eq!(Reason::of(&status), Some(Reason::OutOfMemory), "{status}");
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, created).await.expect("there is memory again");
    let gone = trainer.close_env(wire::CloseEnvRequest { env_id }).await.unwrap_err();
    assert_eq!(Reason::of(&gone), Some(Reason::EnvNotFound));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_has_so_many_environments_and_leaves_the_others_to_others() {
    let server = start_server(ServerConfig { max_envs_per_client: 1, ..ServerConfig::default() });
    let mut trainer = EnvServiceClient::connect(server.uri.clone()).await.unwrap();
    let request = wire::CreateEnvRequest { map: Some(small_map(20)), npc_count: 1, ..Default::default() };
    let env_id = trainer.create_env(request.clone()).await.unwrap().into_inner().env_id;
    let refused = trainer.create_env(request.clone()).await.unwrap_err();
    assert_eq!((refused.code(), Reason::of(&refused)), (Code::ResourceExhausted, Some(Reason::TooManyEnvs)));
    assert!(refused.message().contains("--max-envs-per-client"), "{refused}");
    trainer.close_env(wire::CloseEnvRequest { env_id }).await.unwrap();
    trainer.create_env(request).await.expect("the place is free again");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stalled_world_drops_time_and_leaves_others_alone() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let stalled = create_world(&mut client, 16, wire::TimeMode::Realtime).await.world_id;
    let other = create_world(&mut client, 17, wire::TimeMode::Realtime).await.world_id;
    let mut watching = watch(&mut client, other, 60.0).await;
    let before = watching.next().await.unwrap().unwrap();
    server.stall(stalled, Duration::from_millis(500)).await;
    // 500 ms are 30 ticks, of which two are caught up.
    let after = stats_until(&mut client, stalled, |stats| stats.ticks_dropped > 0).await;
    assert!((26..=40).contains(&after.ticks_dropped), "{} dropped", after.ticks_dropped);
    watch_until(&mut client, other, |snapshot| snapshot.tick > before.tick + 20).await;
    let request = wire::WatchStatsRequest { world_id: other, ..Default::default() };
    let there = client.watch_stats(request).await.unwrap().into_inner().next().await.unwrap().unwrap();
    assert_eq!(there.stats.unwrap().tick_histogram.iter().sum::<u64>(), there.tick, "every tick is timed");
    server.stop().await;
}
