//! What designers and NPCs tell the planner changes plans for everybody, over real sockets.

use e2e::{build_graph, planner_client, small_graph, small_map, start_planner};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1::Vec3;
use tonic::Code;
use tonic::transport::Channel;

type Client = PlannerServiceClient<Channel>;

/// Seed of the map.
const MAP: u64 = 7;

async fn get(client: &mut Client, graph_id: &str) -> wire::GetGraphResponse {
    client.get_graph(wire::GetGraphRequest { graph_id: graph_id.to_owned() }).await.unwrap().into_inner()
}

async fn plan(client: &mut Client, graph_id: &str, start: Vec3, goal: Vec3) -> wire::Plan {
    let query = wire::PathQuery { start: Some(start), goal: Some(goal), avoid: Vec::new() };
    let request = wire::FindPathRequest { graph_id: graph_id.to_owned(), query: Some(query) };
    client.find_path(request).await.unwrap().into_inner().plan.unwrap()
}

/// A pair of vertices whose plan passes at least one proved edge, with that edge.
async fn travelled_edge(client: &mut Client, graph_id: &str) -> (Vec3, Vec3, wire::Leg) {
    let graph = get(client, graph_id).await;
    for (idx, &start) in graph.vertices.iter().enumerate() {
        let goal = graph.vertices[(idx + 25) % graph.vertices.len()];
        let plan = plan(client, graph_id, start, goal).await;
        let is_proved = |leg: &&wire::Leg| leg.from != u32::MAX && leg.to != u32::MAX;
        if let Some(leg) = plan.legs.iter().find(is_proved) {
            return (start, goal, *leg);
        }
    }
    panic!("no plan passes an edge");
}

fn passes(plan: &wire::Plan, leg: &wire::Leg) -> bool {
    plan.legs.iter().any(|other| (other.from, other.to) == (leg.from, leg.to))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_leg_that_npcs_fail_on_is_avoided_at_the_next_plan_and_remembered() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let (start, goal, leg) = travelled_edge(&mut client, &graph_id).await;
    let failed = wire::Traversal { from: leg.from, to: leg.to, reached: false, decisions: 50 };
    let nowhere = wire::Traversal { from: 4000, to: 4001, reached: true, decisions: 5 };
    let mut traversals = vec![failed; 30];
    traversals.push(nowhere);
    let request = wire::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals };
    let accepted = client.report_traversals(request).await.unwrap().into_inner().accepted;
    assert_eq!(accepted, 30);
    let after = plan(&mut client, &graph_id, start, goal).await;
    assert!(!passes(&after, &leg), "the next plan passes the leg that failed thirty times");
    planner.stop().await;

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (same, summary) = build_graph(&mut client, MAP).await;
    assert!(same == graph_id && summary.cached && summary.passages == 30);
    assert!(!passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_designers_edits_hold_at_once_after_a_restart_and_until_undone() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, before) = build_graph(&mut client, MAP).await;
    let (start, goal, leg) = travelled_edge(&mut client, &graph_id).await;
    let graph = get(&mut client, &graph_id).await;
    let (from, to) = (graph.vertices[leg.from as usize], graph.vertices[leg.to as usize]);
    let forbid =
        wire::Edit { edit: Some(wire::edit::Edit::ForbidEdge(wire::EdgeEdit { from: Some(from), to: Some(to) })) };
    let misfit = wire::Edit {
        edit: Some(wire::edit::Edit::RemoveVertex(wire::VertexEdit { at: Some(Vec3 { x: -90.0, y: 0.0, z: 0.0 }) })),
    };
    let append = |edits| wire::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        edits,
        if_revision: 0,
    };
    let answer = client.append_edits(append(vec![forbid, misfit])).await.unwrap().into_inner();
    let summary = answer.summary.unwrap();
    assert_eq!((summary.edits, summary.unfit_edits, summary.edges), (2, 1, before.edges - 1));
    assert!(answer.unfit[0].index == 1 && answer.unfit[0].reason.contains("no vertex"), "{:?}", answer.unfit);
    assert!(!passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    planner.stop().await;

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    build_graph(&mut client, MAP).await;
    assert!(!passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    let layers = client.get_layers(wire::GetLayersRequest { graph_id: graph_id.clone() }).await.unwrap().into_inner();
    assert_eq!((layers.layers.len(), layers.layers[0].edits.len(), layers.unfit.len()), (1, 2, 1));
    let undo =
        |count| wire::UndoEditsRequest { graph_id: graph_id.clone(), layer: "night".to_owned(), count, if_revision: 0 };
    let answer = client.undo_edits(undo(9)).await.unwrap().into_inner();
    assert_eq!(answer.summary.unwrap().edges, before.edges);
    assert!(passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    assert_eq!(client.undo_edits(undo(1)).await.unwrap_err().code(), Code::NotFound);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_and_reports_that_make_no_sense_are_refused_and_change_nothing() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, before) = build_graph(&mut client, MAP).await;
    let place = |x| Some(Vec3 { x, y: 1.0, z: 1.0 });
    let price = |factor| wire::Edit {
        edit: Some(wire::edit::Edit::PriceEdge(wire::PriceEdge { from: place(1.0), to: place(9.0), factor })),
    };
    let nan = wire::Edit { edit: Some(wire::edit::Edit::AddVertex(wire::VertexEdit { at: place(f32::NAN) })) };
    let layer = |name: &str, edits| Some(wire::Layer { name: name.to_owned(), edits });
    for (layer, words) in [
        (layer("a", vec![price(-1.0)]), "factor is -1"),
        (layer("a", vec![nan]), "edit.at is not finite"),
        (layer("a", vec![wire::Edit { edit: None }]), "edit is missing"),
        (layer("", Vec::new()), "layer names have 1 to 64 bytes"),
        (layer("a", vec![price(2.0); 5000]), "at most 4096 edits"),
        (None, "layer is missing"),
    ] {
        let request = wire::PutLayerRequest { graph_id: graph_id.clone(), layer, if_revision: 0 };
        let status = client.put_layer(request).await.unwrap_err();
        assert!(status.code() == Code::InvalidArgument && status.message().contains(words), "{status:?}");
    }
    let traversal = wire::Traversal { from: 0, to: 1, reached: true, decisions: 20_000 };
    let report = |traversals| wire::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals };
    let status = client.report_traversals(report(vec![traversal])).await.unwrap_err();
    assert!(status.message().contains("traversals.decisions is 20000"), "{status:?}");
    let status = client.report_traversals(report(vec![traversal; 5000])).await.unwrap_err();
    assert_eq!(status.code(), Code::ResourceExhausted);
    let after = get(&mut client, &graph_id).await.summary.unwrap();
    assert_eq!((after.edges, after.edits, after.passages), (before.edges, 0, 0));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_build_that_nobody_waits_for_any_more_makes_room() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig { max_builds: 1, ..PlannerConfig::default() });
    let mut client = planner_client(&planner).await;
    // Minutes of probing, left after the first sign of life.
    let settings = wire::BuildSettings { vertices: 2000, neighbours: 64, repeats: 32, ..Default::default() };
    let request = wire::BuildGraphRequest { map: Some(small_map(9)), settings: Some(settings), ..Default::default() };
    let mut progress = client.build_graph(request).await.unwrap().into_inner();
    assert!(progress.message().await.unwrap().unwrap().summary.is_none());
    let other =
        wire::BuildGraphRequest { map: Some(small_map(MAP)), settings: Some(small_graph()), ..Default::default() };
    let refused = client.build_graph(other.clone()).await.unwrap_err();
    assert_eq!(refused.code(), Code::ResourceExhausted);
    drop(progress);
    let accepted = async {
        while client.build_graph(other.clone()).await.is_err() {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(60), accepted).await.expect("the build is cancelled");
    planner.stop().await;
}
