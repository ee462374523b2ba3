//! Statuses have machine-readable details: the field to change, the missing resource, when to retry.

use e2e::{
    build_graph, create_world, ground, planner_client, small_graph, small_map, start_planner, start_server,
    world_client,
};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;
use tonic::{Code, Status};
use tonic_types::StatusExt;

/// The fields that a status names as invalid.
fn fields(status: &Status) -> Vec<String> {
    let details = status.get_error_details();
    let bad = details.bad_request().unwrap_or_else(|| panic!("no fields in {status}"));
    for violation in &bad.field_violations {
        assert_eq!(violation.description, status.message());
    }
    bad.field_violations.iter().map(|violation| violation.field.clone()).collect()
}

/// Kind and name of the resource that a status names as missing.
fn resource(status: &Status) -> (String, String) {
    assert_eq!(status.code(), Code::NotFound, "{status}");
    let details = status.get_error_details();
    let info = details.resource_info().unwrap_or_else(|| panic!("no resource in {status}"));
    (info.resource_type.clone(), info.resource_name.clone())
}

fn says_when_to_retry(status: &Status) -> bool {
    status.get_error_details().retry_info().is_some_and(|info| info.retry_delay.is_some_and(|delay| !delay.is_zero()))
}

#[tokio::test(flavor = "multi_thread")]
async fn the_world_server_gives_details() {
    let server = start_server(ServerConfig { max_npcs_per_world: 1, ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    let none =
        client.create_world(wire::CreateWorldRequest { map: None, mode: 0, ..Default::default() }).await.unwrap_err();
    assert_eq!(fields(&none), ["map"]);
    let size = Some(wire::MapSize { width: 10, height: 80, depth: 100 });
    let small = wire::CreateWorldRequest {
        map: Some(wire::MapSpec { seed: 1, size, ..Default::default() }),
        mode: 0,
        ..Default::default()
    };
    assert_eq!(fields(&client.create_world(small).await.unwrap_err()), ["map.size.width"]);
    let world_id = create_world(&mut client, 1, wire::TimeMode::Realtime).await.world_id;
    let many = wire::SampleGroundRequest { world_id, count: 0, seed: 0, body: None, ..Default::default() };
    assert_eq!(fields(&client.sample_ground(many).await.unwrap_err()), ["count"]);
    let at = |position| wire::SpawnNpcRequest { world_id, position: Some(position), ..Default::default() };
    let outside = client.spawn_npc(at(wire::Vec3 { x: 5000.0, y: 1.0, z: 1.0 })).await.unwrap_err();
    assert_eq!(fields(&outside), ["position"]);
    let start = ground(&mut client, world_id, 1).await[0];
    client.spawn_npc(at(start)).await.unwrap();
    let full = client.spawn_npc(at(start)).await.unwrap_err();
    let quota = full.get_details_quota_failure().expect("whose quota it is");
    assert_eq!(
        (full.code(), quota.violations[0].subject.clone()),
        (Code::ResourceExhausted, format!("world:{world_id}"))
    );
    assert!(!says_when_to_retry(&full), "capacity is freed by despawning, not by waiting");
    let gone = client.get_npc(wire::GetNpcRequest { npc_id: 77, ..Default::default() }).await.unwrap_err();
    assert_eq!(resource(&gone), ("npc".to_owned(), "77".to_owned()));

    let watch = wire::WatchWorldRequest { world_id, rate_hz: 30.0, ..Default::default() };
    let snapshots = client.watch_world(watch).await.unwrap().into_inner();
    server.begin_stop();
    let end = snapshots.filter_map(Result::err).next().await.expect("the stream ends with a status");
    assert!(end.code() == Code::Unavailable && says_when_to_retry(&end), "{end}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_planner_gives_details() {
    let cache = tempfile::tempdir().unwrap();
    let config = PlannerConfig { max_vertices: 100, max_queries: 1, ..PlannerConfig::default() };
    let planner = start_planner(cache.path(), config);
    let mut client = planner_client(&planner).await;
    for (settings, code) in [
        (plan::BuildSettings { vertices: 1, ..small_graph() }, Code::InvalidArgument),
        (plan::BuildSettings { vertices: 101, ..small_graph() }, Code::OutOfRange),
    ] {
        let request =
            plan::StartBuildRequest { map: Some(small_map(1)), settings: Some(settings), ..Default::default() };
        let refused = client.start_build(request).await.unwrap_err();
        assert_eq!((refused.code(), fields(&refused)), (code, vec!["settings.vertices".to_owned()]));
    }
    let unknown = "0".repeat(64);
    let absent =
        client.get_graph(plan::GetGraphRequest { graph_id: unknown.clone(), ..Default::default() }).await.unwrap_err();
    assert_eq!(resource(&absent), ("graph".to_owned(), unknown));
    let (graph_id, _) = build_graph(&mut client, 1).await;
    let query = plan::FindPathRequest { graph_id: graph_id.clone(), query: None, ..Default::default() };
    assert_eq!(fields(&client.find_path(query).await.unwrap_err()), ["query"]);
    let queries = vec![plan::PathQuery::default(); 2];
    let batch = client
        .find_paths(plan::FindPathsRequest { graph_id: graph_id.clone(), queries, traffic: None, ..Default::default() })
        .await
        .unwrap_err();
    assert_eq!((batch.code(), fields(&batch)), (Code::OutOfRange, vec!["queries".to_owned()]));
    // Retrying the same batch is no use.
    assert!(!says_when_to_retry(&batch));
    let undo = plan::UndoEditsRequest { graph_id, layer: "night".to_owned(), count: 1, ..Default::default() };
    let missing = client.undo_edits(undo).await.unwrap_err();
    assert_eq!(resource(&missing), ("layer".to_owned(), "night".to_owned()));
    planner.stop().await;
}
