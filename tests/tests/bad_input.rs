//! Invalid input gets the right status and a message that names the field to change, and affects nothing else.

use e2e::{
    LIMIT, build_graph, create_world, ground, planner_client, small_graph, small_map, start_planner, start_server,
    world_client,
};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;
use tonic::{Code, Status};

fn refused<T>(result: Result<T, Status>, code: Code, words: &str) {
    match result {
        Ok(_) => panic!("accepted, expected {code:?} with `{words}`"),
        Err(status) => {
            assert_eq!(status.code(), code, "{status}");
            assert!(status.message().contains(words), "`{}` does not say `{words}`", status.message());
        }
    }
}

fn at(x: f32, y: f32, z: f32) -> Option<wire::Vec3> {
    Some(wire::Vec3 { x, y, z })
}

#[tokio::test(flavor = "multi_thread")]
async fn the_world_server_refuses_what_it_cannot_use() {
    let server = start_server(ServerConfig { max_worlds: 2, max_npcs_per_world: 3, ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    let create = |map: Option<wire::MapSpec>, mode: i32| wire::CreateWorldRequest { map, mode, ..Default::default() };
    let size = |width, height, depth| {
        Some(wire::MapSpec { seed: 1, size: Some(wire::MapSize { width, height, depth }), ..Default::default() })
    };
    refused(client.create_world(create(None, 0)).await, Code::InvalidArgument, "map is missing");
    refused(client.create_world(create(size(10, 80, 100), 0)).await, Code::InvalidArgument, "size.width is 10");
    refused(client.create_world(create(size(100, 80, 4_000_000_000), 0)).await, Code::InvalidArgument, "size.depth");
    refused(
        client.create_world(create(Some(small_map(1)), 9)).await,
        Code::InvalidArgument,
        "mode has the unknown value 9",
    );
    let mut wild = small_map(1);
    wild.features = Some(wire::Features { lava: f32::NAN, ..Default::default() });
    refused(client.create_world(create(Some(wild), 0)).await, Code::InvalidArgument, "features.lava");

    let world_id = create_world(&mut client, 1, wire::TimeMode::Realtime).await.world_id;
    create_world(&mut client, 2, wire::TimeMode::Realtime).await;
    refused(client.create_world(create(Some(small_map(3)), 0)).await, Code::ResourceExhausted, "--max-worlds");

    refused(client.drop_world(wire::DropWorldRequest { world_id: 99 }).await, Code::NotFound, "world 99");
    let sample =
        |world_id, count| wire::SampleGroundRequest { world_id, count, seed: 0, body: None, ..Default::default() };
    refused(client.sample_ground(sample(99, 1)).await, Code::NotFound, "world 99");
    refused(client.sample_ground(sample(world_id, 0)).await, Code::InvalidArgument, "count is 0");
    refused(client.sample_ground(sample(world_id, 1_000_000)).await, Code::InvalidArgument, "count");

    let spawn = |world_id, position, yaw| wire::SpawnNpcRequest { world_id, position, yaw, ..Default::default() };
    refused(client.spawn_npc(spawn(99, at(1.0, 1.0, 1.0), 0.0)).await, Code::NotFound, "world 99");
    refused(client.spawn_npc(spawn(world_id, None, 0.0)).await, Code::InvalidArgument, "position is missing");
    refused(
        client.spawn_npc(spawn(world_id, at(f32::NAN, 1.0, 1.0), 0.0)).await,
        Code::InvalidArgument,
        "position is not finite",
    );
    refused(
        client.spawn_npc(spawn(world_id, at(5000.0, 1.0, 1.0), 0.0)).await,
        Code::InvalidArgument,
        "outside the map",
    );
    refused(client.spawn_npc(spawn(world_id, at(1.0, 1.0, 1.0), f32::INFINITY)).await, Code::InvalidArgument, "yaw");
    let start = ground(&mut client, world_id, 1).await[0];
    let mut npcs = Vec::new();
    for _ in 0..3 {
        npcs.push(client.spawn_npc(spawn(world_id, Some(start), 0.0)).await.unwrap().into_inner().npc_id);
    }
    refused(client.spawn_npc(spawn(world_id, Some(start), 0.0)).await, Code::ResourceExhausted, "--max-npcs");

    refused(
        client.set_goal(wire::SetGoalRequest { npc_id: 77, goal: Some(start), ..Default::default() }).await,
        Code::NotFound,
        "npc 77",
    );
    refused(
        client.set_goal(wire::SetGoalRequest { npc_id: npcs[0], goal: None, ..Default::default() }).await,
        Code::InvalidArgument,
        "goal is missing",
    );
    refused(
        client
            .set_goal(wire::SetGoalRequest {
                npc_id: npcs[0],
                goal: at(0.0, f32::NEG_INFINITY, 0.0),
                ..Default::default()
            })
            .await,
        Code::InvalidArgument,
        "goal is not finite",
    );
    refused(
        client
            .set_goal(wire::SetGoalRequest { npc_id: npcs[0], goal: at(0.0, 500.0, 0.0), ..Default::default() })
            .await,
        Code::InvalidArgument,
        "goal lies outside",
    );
    refused(
        client
            .teleport_npc(wire::TeleportNpcRequest {
                npc_id: 77,
                position: Some(start),
                yaw: 0.0,
                ..Default::default()
            })
            .await,
        Code::NotFound,
        "npc 77",
    );
    refused(
        client
            .teleport_npc(wire::TeleportNpcRequest {
                npc_id: npcs[0],
                position: at(-1.0, 0.0, 0.0),
                yaw: 0.0,
                ..Default::default()
            })
            .await,
        Code::InvalidArgument,
        "outside",
    );
    refused(
        client.get_npc(wire::GetNpcRequest { npc_id: u64::MAX, ..Default::default() }).await,
        Code::NotFound,
        "does not exist",
    );
    refused(client.despawn_npc(wire::DespawnNpcRequest { npc_id: 77 }).await, Code::NotFound, "npc 77");
    let watch = |world_id, rate_hz| wire::WatchWorldRequest { world_id, rate_hz, ..Default::default() };
    refused(client.watch_world(watch(99, 1.0)).await, Code::NotFound, "world 99");
    refused(client.watch_world(watch(world_id, 1000.0)).await, Code::InvalidArgument, "rate_hz");
    refused(client.watch_world(watch(world_id, f32::NAN)).await, Code::InvalidArgument, "rate_hz");

    // Nothing that existed before has changed.
    assert_eq!(client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap().into_inner().worlds.len(), 2);
    for npc_id in npcs {
        client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.unwrap();
    }
    server.stop().await;
}

fn hello(hello: wire::Hello) -> wire::WorkRequest {
    wire::WorkRequest { message: Some(wire::work_request::Message::Hello(hello)) }
}

fn good_hello() -> wire::Hello {
    wire::Hello {
        name: "test".to_owned(),
        capacity: 8,
        observation_len: surefoot_world::OBSERVATION_LEN as u32,
        observation_version: surefoot_world::sense::OBSERVATION_VERSION,
        policy: "none".to_owned(),
    }
}

fn actions(batch: wire::ActionBatch) -> wire::WorkRequest {
    wire::WorkRequest { message: Some(wire::work_request::Message::Actions(batch)) }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_malformed_worker_is_cut_off_and_told_why() {
    let server = start_server(ServerConfig::default());
    let client = world_client(&server).await;
    let batch = |npc_ids: Vec<u64>, actions: Vec<u8>| wire::ActionBatch {
        world_id: 1,
        tick: 0,
        npc_ids,
        actions,
        ..Default::default()
    };
    let cases = [
        (vec![actions(batch(vec![], vec![]))], Code::InvalidArgument, "the first message must be hello"),
        (vec![hello(wire::Hello { capacity: 0, ..good_hello() })], Code::InvalidArgument, "hello.capacity is 0"),
        (vec![hello(wire::Hello { name: "x".repeat(65), ..good_hello() })], Code::InvalidArgument, "hello.name"),
        (
            vec![hello(wire::Hello { observation_len: 3, ..good_hello() })],
            Code::FailedPrecondition,
            "update the worker",
        ),
        (vec![hello(good_hello()), hello(good_hello())], Code::InvalidArgument, "only actions"),
        (
            vec![hello(good_hello()), actions(batch(vec![5], vec![0; 15]))],
            Code::InvalidArgument,
            "15 bytes, expected 16",
        ),
        (vec![hello(good_hello()), actions(batch(vec![5, 5], vec![0; 32]))], Code::InvalidArgument, "npc 5 twice"),
        (
            vec![
                hello(good_hello()),
                actions(wire::ActionBatch { attempts: vec![1], standings: vec![0; 2], ..batch(vec![5], vec![0; 16]) }),
            ],
            Code::InvalidArgument,
            "actions.standings has 2 values for 1 NPCs",
        ),
    ];
    for (requests, code, words) in cases {
        let mut client = client.clone();
        let failure = async {
            // The request stream stays open, so that only the server can end the session.
            let stream = tokio_stream::iter(requests).chain(tokio_stream::pending());
            let mut responses = client.work(stream).await?.into_inner();
            while let Some(response) = responses.next().await {
                response?;
            }
            Ok::<(), Status>(())
        };
        refused(failure.await, code, words);
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_planner_refuses_what_it_cannot_use() {
    let cache = tempfile::tempdir().unwrap();
    let planner =
        start_planner(cache.path(), PlannerConfig { max_vertices: 100, max_queries: 3, ..PlannerConfig::default() });
    let mut client = planner_client(&planner).await;
    let build = |settings: plan::BuildSettings| plan::StartBuildRequest {
        map: Some(small_map(1)),
        settings: Some(settings),
        ..Default::default()
    };
    refused(
        client.start_build(plan::StartBuildRequest { map: None, settings: None, ..Default::default() }).await,
        Code::InvalidArgument,
        "map is missing",
    );
    refused(
        client.start_build(build(plan::BuildSettings { vertices: 101, ..small_graph() })).await,
        Code::OutOfRange,
        "--max-vertices",
    );
    refused(
        client.start_build(build(plan::BuildSettings { vertices: 1, ..small_graph() })).await,
        Code::InvalidArgument,
        "settings.vertices is 1",
    );
    refused(
        client.start_build(build(plan::BuildSettings { neighbours: 1000, ..small_graph() })).await,
        Code::InvalidArgument,
        "settings.neighbours",
    );
    refused(
        client.start_build(build(plan::BuildSettings { repeats: 33, ..small_graph() })).await,
        Code::InvalidArgument,
        "settings.repeats",
    );
    refused(
        client.start_build(build(plan::BuildSettings { threshold: f32::NAN, ..small_graph() })).await,
        Code::InvalidArgument,
        "settings.threshold",
    );
    refused(
        client.start_build(build(plan::BuildSettings { placement: 99, ..small_graph() })).await,
        Code::InvalidArgument,
        "settings.placement",
    );

    let unknown = "0".repeat(64);
    refused(
        client.get_graph(plan::GetGraphRequest { graph_id: "nonsense".to_owned(), ..Default::default() }).await,
        Code::InvalidArgument,
        "64 hexadecimal digits",
    );
    refused(
        client.get_graph(plan::GetGraphRequest { graph_id: unknown.clone(), ..Default::default() }).await,
        Code::NotFound,
        "call StartBuild first",
    );
    refused(
        client.find_path(plan::FindPathRequest { graph_id: unknown, query: None, ..Default::default() }).await,
        Code::NotFound,
        "StartBuild",
    );

    let (graph_id, summary) = build_graph(&mut client, 1).await;
    let find = |query| plan::FindPathRequest { graph_id: graph_id.clone(), query, ..Default::default() };
    let query = |start, goal| Some(plan::PathQuery { start, goal, ..Default::default() });
    refused(client.find_path(find(None)).await, Code::InvalidArgument, "query is missing");
    refused(
        client.find_path(find(query(None, at(1.0, 1.0, 1.0)))).await,
        Code::InvalidArgument,
        "query.start is missing",
    );
    refused(
        client.find_path(find(query(at(1.0, 1.0, 1.0), at(1.0, f32::NAN, 1.0)))).await,
        Code::InvalidArgument,
        "query.goal is not finite",
    );
    let stubborn = plan::PathQuery {
        start: at(1.0, 1.0, 1.0),
        goal: at(2.0, 1.0, 1.0),
        avoid: vec![plan::LegEnds::default(); 65],
        ..Default::default()
    };
    refused(client.find_path(find(Some(stubborn))).await, Code::InvalidArgument, "query.avoid");
    for caution in [f32::NAN, -0.1, 1.5] {
        let reckless =
            plan::PathQuery { caution: Some(caution), ..query(at(1.0, 1.0, 1.0), at(2.0, 1.0, 1.0)).unwrap() };
        refused(client.find_path(find(Some(reckless))).await, Code::InvalidArgument, "query.caution");
    }
    let batch = plan::FindPathsRequest {
        graph_id: graph_id.clone(),
        queries: vec![query(at(1.0, 1.0, 1.0), at(9.0, 1.0, 9.0)).unwrap(); 4],
        traffic: None,
        ..Default::default()
    };
    refused(client.find_paths(batch.clone()).await, Code::OutOfRange, "--max-queries");
    let crowd = |x: f32| plan::Crowd { place: at(x, 1.0, 1.0), npcs: u32::MAX };
    for (crowds, code, words) in [
        (vec![crowd(1.0); 257], Code::OutOfRange, "at most 256"),
        (vec![crowd(f32::NAN)], Code::InvalidArgument, "traffic.crowds.place"),
    ] {
        let traffic = Some(plan::Traffic { crowds });
        let request = plan::FindPathsRequest { queries: batch.queries[..1].to_vec(), traffic, ..batch.clone() };
        refused(client.find_paths(request).await, code, words);
    }

    // A valid query after all of these is answered in full.
    let graph = client
        .get_graph(plan::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert_eq!(graph.edges.len(), summary.edges as usize);
    let edge = &graph.edges[0];
    let (from, to) = (graph.vertices[edge.from as usize], graph.vertices[edge.to as usize]);
    let plan = client.find_path(find(query(Some(from), Some(to)))).await.unwrap().into_inner().plan.unwrap();
    assert!(plan.found && plan.waypoints.last() == Some(&to) && plan.waypoints.len() == plan.legs.len());
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_above_the_size_limit_is_refused_and_the_server_goes_on() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let huge = wire::ActionBatch { actions: vec![0; 17 * 1024 * 1024], ..Default::default() };
    let stream = tokio_stream::iter([hello(good_hello()), actions(huge)]).chain(tokio_stream::pending());
    let mut responses = client.work(stream).await.unwrap().into_inner();
    let cut_off = async { while let Some(Ok(_)) = responses.next().await {} };
    tokio::time::timeout(LIMIT, cut_off).await.expect("the stream ends");
    create_world(&mut client, 1, wire::TimeMode::Realtime).await;
    server.stop().await;
}
