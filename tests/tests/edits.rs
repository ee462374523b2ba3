//! Designers' layers are never lost and never left out, and edits, builds and loads do not wait for each other, over
//! real sockets and files.

use e2e::{
    Running, build_graph, build_to_end, planner_client, small_graph, small_map, start_of, start_planner, watch_build,
};
use std::path::{Path, PathBuf};
use std::time::Duration;
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::Vec3;
use tonic::transport::Channel;
use tonic::{Code, Status};

type Client = PlannerServiceClient<Channel>;

/// Seed of the map.
const MAP: u64 = 7;

async fn get(client: &mut Client, graph_id: &str) -> wire::GetGraphResponse {
    client
        .get_graph(wire::GetGraphRequest { graph_id: graph_id.to_owned(), ..Default::default() })
        .await
        .unwrap()
        .into_inner()
}

fn forbid(from: Vec3, to: Vec3) -> wire::Edit {
    wire::Edit { edit: Some(wire::edit::Edit::ForbidEdge(wire::EdgeEdit { from: Some(from), to: Some(to) })) }
}

fn add_vertex(at: Vec3) -> wire::Edit {
    wire::Edit { edit: Some(wire::edit::Edit::AddVertex(wire::VertexEdit { at: Some(at) })) }
}

fn put(graph_id: &str, name: &str, edits: Vec<wire::Edit>) -> wire::PutLayerRequest {
    let layer = Some(wire::Layer { name: name.to_owned(), edits });
    wire::PutLayerRequest { graph_id: graph_id.to_owned(), layer, ..Default::default() }
}

fn find(graph_id: &str, start: Vec3, goal: Vec3) -> wire::FindPathRequest {
    let query = wire::PathQuery { start: Some(start), goal: Some(goal), ..Default::default() };
    wire::FindPathRequest { graph_id: graph_id.to_owned(), query: Some(query), ..Default::default() }
}

/// Number of edges of a graph, without its layers as long as it has none.
async fn edge_count(client: &mut Client, graph_id: &str) -> usize {
    get(client, graph_id).await.edges.len()
}

/// The files of all layers in a cache folder.
fn layer_files(folder: &Path) -> Vec<PathBuf> {
    let levels = std::fs::read_dir(folder.join("layers")).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> =
        levels.flat_map(|level| std::fs::read_dir(level).unwrap().map(|entry| entry.unwrap().path())).collect();
    files.sort();
    files
}

fn refused(status: &Status, words: &str) {
    let found = (status.code(), Reason::of(status));
    assert!(found == (Code::FailedPrecondition, Some(Reason::StoreFailed)), "{status:?}");
    assert!(status.message().contains(words), "{status:?}");
}

/// A planner with a graph in which the layers `day` and `night` each forbid an edge; returns the places of both edges
/// and the number of edges that are left.
async fn edited(folder: &Path) -> (Running, Client, String, [(Vec3, Vec3); 2], usize) {
    let planner = start_planner(folder, PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let graph = get(&mut client, &graph_id).await;
    let place = |vertex: u32| graph.vertices[vertex as usize];
    let [day, night] = [0, 1].map(|edge: usize| (place(graph.edges[edge].from), place(graph.edges[edge].to)));
    client.put_layer(put(&graph_id, "day", vec![forbid(day.0, day.1)])).await.unwrap();
    client.put_layer(put(&graph_id, "night", vec![forbid(night.0, night.1)])).await.unwrap();
    assert_eq!(edge_count(&mut client, &graph_id).await, graph.edges.len() - 2);
    (planner, client, graph_id, [day, night], graph.edges.len() - 2)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_layer_is_kept_and_refuses_plans_until_it_is_replaced() {
    let cache = tempfile::tempdir().unwrap();
    let (planner, client, graph_id, [_, (from, to)], edge_count_before) = edited(cache.path()).await;
    drop(client);
    planner.stop().await;
    let file = layer_files(cache.path()).into_iter().find(|file| file.ends_with("night.layer")).unwrap();
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, &bytes).unwrap();

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let build = build_to_end(&mut client, start_of(MAP)).await;
    assert_eq!((build.graph_id.as_str(), build.stage()), (graph_id.as_str(), wire::BuildStage::Done));
    let query = find(&graph_id, from, to);
    refused(&client.find_path(query.clone()).await.unwrap_err(), "layer `night`");
    refused(&client.find_path(query.clone()).await.unwrap_err(), &file.display().to_string());
    let queries = vec![query.query.clone().unwrap()];
    let batch = wire::FindPathsRequest { graph_id: graph_id.clone(), queries, traffic: None, ..Default::default() };
    refused(&client.find_paths(batch).await.unwrap_err(), "layer `night`");
    let whole = wire::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() };
    refused(&client.get_graph(whole).await.unwrap_err(), "layer `night`");
    let layers = wire::GetLayersRequest { graph_id: graph_id.clone(), ..Default::default() };
    refused(&client.get_layers(layers.clone()).await.unwrap_err(), "layer `night`");
    let append = wire::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        edits: vec![forbid(from, to)],
        ..Default::default()
    };
    refused(&client.append_edits(append).await.unwrap_err(), "layer `night`");
    assert_eq!(std::fs::read(&file).unwrap(), bytes, "the bytes are kept");

    client.put_layer(put(&graph_id, "night", vec![forbid(from, to)])).await.unwrap();
    client.find_path(query).await.unwrap();
    assert_eq!(edge_count(&mut client, &graph_id).await, edge_count_before);
    assert_eq!(client.get_layers(layers).await.unwrap().into_inner().layers.len(), 2);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn unreadable_layers_refuse_plans_and_changes_until_they_are_back() {
    let cache = tempfile::tempdir().unwrap();
    let (planner, client, graph_id, [(from, to), _], edge_count_before) = edited(cache.path()).await;
    drop(client);
    planner.stop().await;
    let folder = layer_files(cache.path())[0].parent().unwrap().to_owned();
    let aside = cache.path().join("aside");
    std::fs::rename(&folder, &aside).unwrap();
    std::fs::write(&folder, b"a file where a folder belongs").unwrap();

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    build_graph(&mut client, MAP).await;
    let place = folder.display().to_string();
    refused(&client.find_path(find(&graph_id, from, to)).await.unwrap_err(), &place);
    refused(&client.put_layer(put(&graph_id, "new", vec![forbid(from, to)])).await.unwrap_err(), &place);
    std::fs::remove_file(&folder).unwrap();
    std::fs::rename(&aside, &folder).unwrap();
    build_graph(&mut client, MAP).await;
    assert_eq!(edge_count(&mut client, &graph_id).await, edge_count_before, "both edges are forbidden again");
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ready_and_cached_graphs_do_not_wait_for_a_running_build() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    build_graph(&mut client, MAP).await;
    build_graph(&mut client, MAP + 1).await;
    planner.stop().await;

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    build_graph(&mut client, MAP).await;
    // Settings that take minutes of probing.
    let settings = wire::BuildSettings { vertices: 2000, neighbours: 64, repeats: 32, ..Default::default() };
    let long = wire::StartBuildRequest { map: Some(small_map(9)), settings: Some(settings), ..Default::default() };
    let long = client.start_build(long).await.unwrap().into_inner().build.unwrap().build_id;
    for (seed, origin) in [(MAP, "memory"), (MAP + 1, "the cache")] {
        let build = tokio::time::timeout(Duration::from_secs(60), build_to_end(&mut client, start_of(seed))).await;
        let build = build.unwrap_or_else(|_| panic!("a graph in {origin} waits for a build"));
        assert_eq!(build.stage(), wire::BuildStage::Done);
    }
    let builds = client.list_builds(wire::ListBuildsRequest::default()).await.unwrap().into_inner().builds;
    let running = builds.iter().find(|build| build.build_id == long).unwrap();
    assert!(!matches!(running.stage(), wire::BuildStage::Done | wire::BuildStage::Failed), "{running:?}");
    client.cancel_build(wire::CancelBuildRequest { build_id: long.clone() }).await.unwrap();
    watch_build(&mut client, &long).await;
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_edit_with_many_probes_holds_nobody_up_and_ends_with_its_caller() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    // Each new vertex takes 24 candidate edges times 32 probes.
    let settings = wire::BuildSettings { vertices: 40, neighbours: 2, repeats: 32, ..small_graph() };
    let request = wire::StartBuildRequest { settings: Some(settings), ..start_of(MAP) };
    let graph_id = build_to_end(&mut client, request).await.graph_id;
    let graph = get(&mut client, &graph_id).await;
    let near = |vertex: usize, x: f32| Vec3 { x: graph.vertices[vertex].x + x, ..graph.vertices[vertex] };
    let many = (0..240).map(|idx| add_vertex(near(idx % graph.vertices.len(), 0.1 * (1 + idx / 40) as f32))).collect();
    let slow = {
        let (mut client, request) = (client.clone(), put(&graph_id, "slow", many));
        tokio::spawn(async move { client.put_layer(request).await })
    };
    tokio::time::sleep(Duration::from_secs(1)).await;
    assert!(!slow.is_finished(), "the edit is too quick to tell anything");
    let edge = graph.edges[0].clone();
    let (from, to) = (graph.vertices[edge.from as usize], graph.vertices[edge.to as usize]);
    let quick = tokio::time::timeout(
        Duration::from_secs(20),
        client.put_layer(put(&graph_id, "quick", vec![forbid(from, to)])),
    );
    quick.await.expect("an edit waits for the probes of another").unwrap();
    assert!(!slow.is_finished(), "the edit is too quick to tell anything");
    slow.abort();
    assert!(slow.await.unwrap_err().is_cancelled());

    // A further edit with probes comes after the one that was abandoned.
    client.put_layer(put(&graph_id, "after", vec![add_vertex(near(0, 1.0))])).await.unwrap();
    let request = wire::GetLayersRequest { graph_id: graph_id.clone(), ..Default::default() };
    let layers = client.get_layers(request).await.unwrap().into_inner().layers;
    let names: Vec<&str> = layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names, ["after", "quick"]);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_of_one_call_and_layers_of_one_level_are_limited() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let place = Vec3 { x: 50.0, y: 20.0, z: 50.0 };
    let too_large = |status: &Status, words: &str| {
        assert_eq!((status.code(), Reason::of(status)), (Code::OutOfRange, Some(Reason::TooLarge)), "{status:?}");
        assert!(status.message().contains(words), "{status:?}");
    };
    let many = put(&graph_id, "many", vec![add_vertex(place); 257]);
    too_large(&client.put_layer(many).await.unwrap_err(), "at most 256 are allowed in one call");
    for number in 0..64 {
        client.put_layer(put(&graph_id, &number.to_string(), vec![forbid(place, place)])).await.unwrap();
    }
    let further = put(&graph_id, "further", vec![forbid(place, place)]);
    too_large(&client.put_layer(further.clone()).await.unwrap_err(), "at most 64 are allowed in one level");
    client.put_layer(put(&graph_id, "0", Vec::new())).await.unwrap();
    client.put_layer(further).await.unwrap();
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn starts_and_goals_off_the_map_or_the_graph_are_told_apart_from_paths() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let graph = get(&mut client, &graph_id).await;
    let start = graph.vertices[graph.edges[0].from as usize];
    let beyond = Vec3 { x: 1.0e9, ..start };
    for (start, goal, field) in [(start, beyond, "query.goal"), (beyond, start, "query.start")] {
        let status = client.find_path(find(&graph_id, start, goal)).await.unwrap_err();
        assert_eq!((status.code(), Reason::of(&status)), (Code::InvalidArgument, Some(Reason::InvalidField)));
        assert!(status.message().starts_with(field), "{status:?}");
        let queries = vec![find("", start, goal).query.unwrap()];
        let batch = wire::FindPathsRequest { graph_id: graph_id.clone(), queries, traffic: None, ..Default::default() };
        assert_eq!(client.find_paths(batch).await.unwrap_err().code(), Code::InvalidArgument);
    }
    let highest = graph.vertices.iter().copied().max_by(|a, b| a.y.total_cmp(&b.y)).unwrap();
    let in_the_air = Vec3 { y: highest.y + 48.0, ..start };
    let plan = client.find_path(find(&graph_id, start, in_the_air)).await.unwrap().into_inner().plan.unwrap();
    assert_eq!((plan.found, plan.reason()), (false, wire::NoPath::GoalOffGraph), "{plan:?}");
    let there = graph.vertices[graph.edges[0].to as usize];
    assert!(client.find_path(find(&graph_id, start, there)).await.unwrap().into_inner().plan.unwrap().found);
    planner.stop().await;
}
