//! Designers' edits and NPCs' traversals change everybody's plans, over real sockets.

use e2e::{build_graph, build_to_end, distance, planner_client, small_map, start_of, start_planner, watch_build};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::{Ability, ImportMapRequest, MapFormat, Vec3};
use tonic::Code;
use tonic::transport::Channel;

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

async fn plan(client: &mut Client, graph_id: &str, start: Vec3, goal: Vec3) -> wire::Plan {
    cautious_plan(client, graph_id, [start, goal], None).await
}

async fn cautious_plan(
    client: &mut Client,
    graph_id: &str,
    [start, goal]: [Vec3; 2],
    caution: Option<f32>,
) -> wire::Plan {
    let query = wire::PathQuery { start: Some(start), goal: Some(goal), caution, ..Default::default() };
    let request = wire::FindPathRequest { graph_id: graph_id.to_owned(), query: Some(query), ..Default::default() };
    client.find_path(request).await.unwrap().into_inner().plan.unwrap()
}

/// The two vertices of a leg along a proved edge; `None` for other legs.
fn vertices_of(leg: &wire::Leg) -> Option<[u32; 2]> {
    let vertex = |stop: Option<wire::Stop>| match stop?.stop? {
        wire::stop::Stop::Vertex(vertex) => Some(vertex),
        wire::stop::Stop::End(_) => None,
    };
    Some([vertex(leg.from)?, vertex(leg.to)?])
}

/// A pair of vertices whose plan passes at least one proved edge, with that edge and its ends.
async fn travelled_edge(client: &mut Client, graph_id: &str) -> (Vec3, Vec3, wire::Leg, [u32; 2]) {
    let graph = get(client, graph_id).await;
    for (idx, &start) in graph.vertices.iter().enumerate() {
        let goal = graph.vertices[(idx + 25) % graph.vertices.len()];
        let plan = plan(client, graph_id, start, goal).await;
        if let Some((leg, ends)) = plan.legs.iter().find_map(|leg| Some((leg.clone(), vertices_of(leg)?))) {
            return (start, goal, leg, ends);
        }
    }
    panic!("no plan passes an edge");
}

fn passes(plan: &wire::Plan, leg: &wire::Leg) -> bool {
    plan.legs.iter().any(|other| (other.from, other.to) == (leg.from, leg.to))
}

#[tokio::test(flavor = "multi_thread")]
async fn plans_do_without_abilities_or_pay_for_them() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let vertices = get(&mut client, &graph_id).await.vertices;
    let pairs = || vertices.iter().zip(vertices.iter().cycle().skip(25));
    let mut plans = async |without: Vec<Ability>, prices: Vec<wire::AbilityPrice>| {
        let without: Vec<i32> = without.into_iter().map(i32::from).collect();
        let query = |(start, goal): (&Vec3, &Vec3)| wire::PathQuery {
            start: Some(*start),
            goal: Some(*goal),
            without: without.clone(),
            prices: prices.clone(),
            ..Default::default()
        };
        let request = wire::FindPathsRequest {
            graph_id: graph_id.clone(),
            queries: pairs().map(query).collect(),
            traffic: None,
            ..Default::default()
        };
        client.find_paths(request).await.map(|response| response.into_inner().plans)
    };
    let jumps = |plans: &[wire::Plan]| {
        let is_jump = |leg: &&wire::Leg| matches!(leg.ability(), Ability::Jump | Ability::DoubleJump);
        plans.iter().flat_map(|plan| &plan.legs).filter(is_jump).count()
    };
    let usual = plans(vec![], vec![]).await.unwrap();
    let on_foot = plans(vec![Ability::Jump], vec![]).await.unwrap();
    assert!(jumps(&usual) > 0 && jumps(&on_foot) == 0, "{} and {}", jumps(&usual), jumps(&on_foot));
    let found = |plans: &[wire::Plan]| plans.iter().filter(|plan| plan.found).count();
    assert!(found(&on_foot) <= found(&usual));
    for senseless in [Ability::Walk, Ability::Unspecified] {
        let status = plans(vec![senseless], vec![]).await.unwrap_err();
        assert!(status.message().contains("query.without"), "{status}");
    }
    let price = |ability: Ability, seconds| wire::AbilityPrice { ability: ability.into(), seconds };
    let dear = [Ability::Jump, Ability::DoubleJump].map(|ability| price(ability, 1000.0)).to_vec();
    let rarely = plans(vec![], dear).await.unwrap();
    assert!(jumps(&rarely) < jumps(&usual) && found(&rarely) == found(&usual), "where nothing else leads there");
    for (wrong, field) in [
        (price(Ability::Walk, 1.0), "query.prices.ability"),
        (price(Ability::Jump, -1.0), "query.prices.seconds is -1; it must be between 0 and 1000"),
        (price(Ability::Jump, f32::NAN), "query.prices.seconds"),
    ] {
        let status = plans(vec![], vec![wrong]).await.unwrap_err();
        assert!(status.message().contains(field), "{status}");
    }
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_leg_that_npcs_fail_on_is_avoided_at_the_next_plan_and_remembered() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let (start, goal, leg, [from, to]) = travelled_edge(&mut client, &graph_id).await;
    let failed = wire::Traversal { from, to, reached: false, decisions: 50, died: false };
    let nowhere = wire::Traversal { from: 4000, to: 4001, reached: true, decisions: 5, died: false };
    let mut traversals = vec![failed; 30];
    traversals.push(nowhere);
    let request = wire::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals, ..Default::default() };
    let accepted = client.report_traversals(request).await.unwrap().into_inner().accepted;
    assert_eq!(accepted, 30);
    let after = plan(&mut client, &graph_id, start, goal).await;
    assert!(!passes(&after, &leg), "the next plan passes the leg that failed thirty times");
    planner.stop().await;

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (same, summary) = build_graph(&mut client, MAP).await;
    assert!(same == graph_id && summary.cached && summary.traversals == 30);
    assert!(!passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_leg_that_killed_is_avoided_by_careful_plans_and_still_used_by_bold_ones() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let vertices = get(&mut client, &graph_id).await.vertices;
    let mut differ = 0;
    for (idx, &start) in vertices.iter().enumerate().take(12) {
        let goal = vertices[(idx + 25) % vertices.len()];
        let before = plan(&mut client, &graph_id, start, goal).await;
        assert!(before.chance <= before.as_planned_chance && before.as_planned_chance <= before.arrival_chance);
        let Some((leg, [from, to])) = before.legs.iter().find_map(|leg| Some((leg.clone(), vertices_of(leg)?))) else {
            continue;
        };
        let report = async |client: &mut Client, reached, count| {
            let traversal = wire::Traversal { from, to, reached, decisions: 5, died: !reached };
            let request = wire::ReportTraversalsRequest {
                graph_id: graph_id.clone(),
                traversals: vec![traversal; count],
                ..Default::default()
            };
            client.report_traversals(request).await.unwrap();
        };
        report(&mut client, true, 40).await;
        for deaths in 1..15 {
            report(&mut client, false, 1).await;
            let careful = plan(&mut client, &graph_id, start, goal).await;
            let bold = cautious_plan(&mut client, &graph_id, [start, goal], Some(0.0)).await;
            assert!(deaths < 14 || !passes(&careful, &leg), "careful plans pass a leg that killed {deaths} times");
            if !passes(&careful, &leg) {
                differ += u32::from(passes(&bold, &leg));
                break;
            }
        }
    }
    assert!(differ > 0, "careful plans avoid no leg that bold ones use");
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_designers_edits_hold_at_once_after_a_restart_and_until_undone() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, before) = build_graph(&mut client, MAP).await;
    let (start, goal, leg, ends) = travelled_edge(&mut client, &graph_id).await;
    let graph = get(&mut client, &graph_id).await;
    let [from, to] = ends.map(|vertex| graph.vertices[vertex as usize]);
    let forbid =
        wire::Edit { edit: Some(wire::edit::Edit::ForbidEdge(wire::EdgeEdit { from: Some(from), to: Some(to) })) };
    let misfit = wire::Edit {
        edit: Some(wire::edit::Edit::RemoveVertex(wire::VertexEdit { at: Some(Vec3 { x: -90.0, y: 0.0, z: 0.0 }) })),
    };
    let append = |edits| wire::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        edits,
        ..Default::default()
    };
    let answer = client.append_edits(append(vec![forbid, misfit])).await.unwrap().into_inner();
    let summary = answer.summary.unwrap();
    assert_eq!((summary.edits, summary.unapplied_edits, summary.edges), (2, 1, before.edges - 1));
    assert!(
        answer.unapplied[0].index == 1 && answer.unapplied[0].reason.contains("no vertex"),
        "{:?}",
        answer.unapplied
    );
    assert!(!passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    planner.stop().await;

    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    build_graph(&mut client, MAP).await;
    assert!(!passes(&plan(&mut client, &graph_id, start, goal).await, &leg));
    let layers = client
        .get_layers(wire::GetLayersRequest { graph_id: graph_id.clone(), ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert_eq!((layers.layers.len(), layers.layers[0].edits.len(), layers.unapplied.len()), (1, 2, 1));
    let undo = |count| wire::UndoEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        count,
        ..Default::default()
    };
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
        let request = wire::PutLayerRequest { graph_id: graph_id.clone(), layer, ..Default::default() };
        let status = client.put_layer(request).await.unwrap_err();
        assert!(status.code() == Code::InvalidArgument && status.message().contains(words), "{status:?}");
    }
    let traversal = wire::Traversal { from: 0, to: 1, reached: true, decisions: 20_000, died: false };
    let report =
        |traversals| wire::ReportTraversalsRequest { graph_id: graph_id.clone(), traversals, ..Default::default() };
    let status = client.report_traversals(report(vec![traversal])).await.unwrap_err();
    assert!(status.message().contains("traversals.decisions is 20000"), "{status:?}");
    let undead = wire::Traversal { died: true, decisions: 9, ..traversal };
    let status = client.report_traversals(report(vec![undead])).await.unwrap_err();
    assert!(status.message().contains("traversals.died and traversals.reached exclude each other"), "{status:?}");
    let status = client.report_traversals(report(vec![traversal; 5000])).await.unwrap_err();
    assert_eq!(status.code(), Code::OutOfRange);
    let after = get(&mut client, &graph_id).await.summary.unwrap();
    assert_eq!((after.edges, after.edits, after.traversals), (before.edges, 0, 0));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_build_is_an_operation_that_outlives_its_caller_and_can_be_listed_and_cancelled() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig { max_builds: 2, ..PlannerConfig::default() });
    let mut client = planner_client(&planner).await;
    // Settings that take minutes of probing.
    let settings = wire::BuildSettings { vertices: 2000, neighbours: 64, repeats: 32, ..Default::default() };
    let long = wire::StartBuildRequest { map: Some(small_map(9)), settings: Some(settings), ..Default::default() };
    let first = client.start_build(long.clone()).await.unwrap().into_inner().build.unwrap();
    drop(client);
    let mut client = planner_client(&planner).await;
    let same = client.start_build(long).await.unwrap().into_inner().build.unwrap();
    assert_eq!(same.build_id, first.build_id, "the same graph is not built twice");
    let second = client.start_build(start_of(MAP)).await.unwrap().into_inner().build.unwrap();
    let refused = client.start_build(start_of(MAP + 1)).await.unwrap_err();
    assert_eq!((refused.code(), Reason::of(&refused)), (Code::ResourceExhausted, Some(Reason::TooManyBuilds)));

    let list = |size, token: String| wire::ListBuildsRequest { page_size: size, page_token: token };
    let page = client.list_builds(list(1, String::new())).await.unwrap().into_inner();
    assert_eq!((page.builds.len(), &page.builds[0].build_id), (1, &second.build_id), "the latest first");
    let page = client.list_builds(list(1, page.next_page_token)).await.unwrap().into_inner();
    assert_eq!((&page.builds[0].build_id, page.next_page_token.as_str()), (&first.build_id, ""));

    client.cancel_build(wire::CancelBuildRequest { build_id: first.build_id.clone() }).await.unwrap();
    let end = watch_build(&mut client, &first.build_id).await.pop().unwrap();
    assert!(end.stage() == wire::BuildStage::Cancelled && end.summary.is_none(), "{end:?}");
    let stages: Vec<_> = watch_build(&mut client, &second.build_id).await.iter().map(wire::Build::stage).collect();
    let mut order = stages.clone();
    order.dedup();
    use wire::BuildStage::{Done, Index, Map, Probes, Queued, Vertices};
    assert_eq!(order, [Queued, Map, Vertices, Probes, Index, Done]);
    let cached = build_to_end(&mut client, start_of(MAP)).await;
    assert!(cached.build_id != second.build_id && cached.stage() == Done && !cached.graph_id.is_empty());
    let unnamed = client.watch_build(wire::WatchBuildRequest::default()).await.unwrap_err();
    assert_eq!((unnamed.code(), Reason::of(&unnamed)), (Code::InvalidArgument, Some(Reason::InvalidField)));
    for build_id in ["nonsense", "0000000000000000"] {
        let request = wire::WatchBuildRequest { build_id: build_id.to_owned() };
        let unknown = client.watch_build(request).await.unwrap_err();
        assert_eq!((unknown.code(), Reason::of(&unknown)), (Code::NotFound, Some(Reason::BuildNotFound)));
    }
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_build_on_a_map_without_ground_fails_with_a_reason() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut maps = MapServiceClient::connect(planner.uri.clone()).await.unwrap();
    // A wall, on which no character can stand.
    let file = b"v 0 0 0\nv 20 0 0\nv 20 20 0\nv 0 20 0\nf 1 2 3\nf 1 3 4\n".to_vec();
    let request =
        ImportMapRequest { name: "wall".to_owned(), format: MapFormat::Obj.into(), file, ..Default::default() };
    let map_hash = maps.import_map(request).await.unwrap().into_inner().map.unwrap().map_hash;
    let mut client = planner_client(&planner).await;
    let end = build_to_end(&mut client, wire::StartBuildRequest { map_hash, ..Default::default() }).await;
    let failure = end.failure.clone().unwrap_or_else(|| panic!("no failure in {end:?}"));
    assert_eq!((end.stage(), failure.reason.as_str()), (wire::BuildStage::Failed, "NO_GROUND"));
    assert_eq!(failure.code, i32::from(Code::FailedPrecondition));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn plans_cost_the_same_with_hub_labels_as_with_a_table() {
    let cache = tempfile::tempdir().unwrap();
    let tabled = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&tabled).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let vertices = get(&mut client, &graph_id).await.vertices;
    let edit = wire::edit::Edit::ForbidEdge({
        let (_, _, _, [from, to]) = travelled_edge(&mut client, &graph_id).await;
        wire::EdgeEdit { from: Some(vertices[from as usize]), to: Some(vertices[to as usize]) }
    });
    let queries: Vec<wire::PathQuery> = (0..vertices.len() * 3)
        .map(|idx| wire::PathQuery {
            start: Some(vertices[idx % vertices.len()]),
            goal: Some(vertices[(idx * 7 + 11) % vertices.len()]),
            ..Default::default()
        })
        .collect();
    let request = wire::FindPathsRequest { graph_id: graph_id.clone(), queries, traffic: None, ..Default::default() };
    let forbid = wire::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "night".to_owned(),
        edits: vec![wire::Edit { edit: Some(edit) }],
        ..Default::default()
    };
    let before = client.find_paths(request.clone()).await.unwrap().into_inner().plans;
    client.append_edits(forbid.clone()).await.unwrap();
    let after = client.find_paths(request.clone()).await.unwrap().into_inner().plans;
    client
        .undo_edits(wire::UndoEditsRequest { graph_id, layer: "night".to_owned(), count: 1, ..Default::default() })
        .await
        .unwrap();
    tabled.stop().await;

    let labelled = start_planner(cache.path(), PlannerConfig { label_vertices: 2, ..PlannerConfig::default() });
    let mut client = planner_client(&labelled).await;
    build_graph(&mut client, MAP).await;
    let is_alike = |ours: &[wire::Plan], theirs: &[wire::Plan]| {
        assert_eq!(ours.len(), theirs.len());
        for (ours, theirs) in ours.iter().zip(theirs) {
            assert_eq!((ours.found, ours.nearest_reachable), (theirs.found, theirs.nearest_reachable));
            // Ways of equal cost may differ in time and chance by what rounding decides.
            let cost = |plan: &wire::Plan| {
                plan.legs.iter().map(|leg| 6.0 * leg.seconds - 200.0 * leg.chance.ln()).sum::<f32>()
            };
            assert!(
                (cost(ours) - cost(theirs)).abs() <= 0.02 * (1.0 + cost(theirs)),
                "{} and {}",
                cost(ours),
                cost(theirs)
            );
        }
    };
    is_alike(&client.find_paths(request.clone()).await.unwrap().into_inner().plans, &before);
    client.append_edits(forbid).await.unwrap();
    is_alike(&client.find_paths(request).await.unwrap().into_inner().plans, &after);
    labelled.stop().await;
}

/// Watches a build until plans can be made on its graph although it goes on, and returns the graph's id.
async fn interim_graph(client: &mut Client, build_id: &str) -> String {
    let request = wire::WatchBuildRequest { build_id: build_id.to_owned() };
    let mut progress = client.watch_build(request).await.unwrap().into_inner();
    while let Some(message) = progress.message().await.unwrap() {
        let build = message.build.unwrap();
        assert_ne!(build.stage(), wire::BuildStage::Done, "the build ended before anybody could plan");
        if !build.interim_graph_id.is_empty() {
            return build.interim_graph_id;
        }
    }
    panic!("the stream ended");
}

/// A build that takes many times as long as its first interim graph.
fn long_build() -> wire::StartBuildRequest {
    let settings = wire::BuildSettings { vertices: 1200, neighbours: 32, repeats: 4, ..Default::default() };
    wire::StartBuildRequest { settings: Some(settings), ..start_of(MAP) }
}

#[tokio::test(flavor = "multi_thread")]
async fn plans_are_made_on_a_graph_while_it_is_built() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let build = client.start_build(long_build()).await.unwrap().into_inner().build.unwrap();
    let graph_id = interim_graph(&mut client, &build.build_id).await;
    let request = wire::WatchGraphRequest { graph_id: graph_id.clone() };
    let mut changes = client.watch_graph(request).await.unwrap().into_inner();
    let first = get(&mut client, &graph_id).await;
    let summary = first.summary.unwrap();
    let untried = first.edges.iter().filter(|edge| edge.tries == 0).count();
    assert!(untried > 0 && summary.expected_edges as usize == untried, "{untried} of {summary:?}");
    assert!(first.edges.iter().all(|edge| edge.chance > 0.0 && edge.seconds > 0.0));
    let queries = (0..600).map(|idx| wire::PathQuery {
        start: Some(first.vertices[idx]),
        goal: Some(first.vertices[idx + 600]),
        ..Default::default()
    });
    let request = wire::FindPathsRequest {
        graph_id: graph_id.clone(),
        queries: queries.collect(),
        traffic: None,
        ..Default::default()
    };
    let early = client.find_paths(request.clone()).await.unwrap().into_inner();
    let found = |answer: &wire::FindPathsResponse| answer.plans.iter().filter(|plan| plan.found).count();
    assert!(early.interim && found(&early) > 500, "{} of 600 plans", found(&early));

    let built = watch_build(&mut client, &build.build_id).await.pop().unwrap();
    assert_eq!((built.stage(), built.graph_id.as_str()), (wire::BuildStage::Done, graph_id.as_str()));
    assert_eq!((built.interim_graph_id.as_str(), built.summary.unwrap().expected_edges), ("", 0));
    // The stream that began on an interim graph reports its successors.
    while changes.message().await.unwrap().unwrap().summary.unwrap().expected_edges > 0 {}
    let whole = get(&mut client, &graph_id).await;
    assert!(whole.edges.iter().all(|edge| edge.tries > 0));
    assert_eq!(whole.vertices[..first.vertices.len()], first.vertices, "vertices keep their indices");
    let late = client.find_paths(request).await.unwrap().into_inner();
    assert!(!late.interim && found(&late) >= found(&early), "{} and {} plans", found(&early), found(&late));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_remains_of_the_interim_graph_of_a_cancelled_build() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let build = client.start_build(long_build()).await.unwrap().into_inner().build.unwrap();
    let graph_id = interim_graph(&mut client, &build.build_id).await;
    client.cancel_build(wire::CancelBuildRequest { build_id: build.build_id.clone() }).await.unwrap();
    let last = watch_build(&mut client, &build.build_id).await.pop().unwrap();
    assert_eq!((last.stage(), last.interim_graph_id.as_str()), (wire::BuildStage::Cancelled, ""));
    let gone = client.get_graph(wire::GetGraphRequest { graph_id, ..Default::default() }).await.unwrap_err();
    assert_eq!(gone.code(), Code::NotFound);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn plans_go_around_crowds() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, MAP).await;
    let vertices = get(&mut client, &graph_id).await.vertices;
    let query = |idx: usize| wire::PathQuery {
        start: Some(vertices[idx % vertices.len()]),
        goal: Some(vertices[(idx * 7 + 11) % vertices.len()]),
        ..Default::default()
    };
    let (mut tried, mut detours) = (0, 0);
    for idx in 0..vertices.len() {
        let request = |crowds: Option<Vec<wire::Crowd>>| wire::FindPathsRequest {
            graph_id: graph_id.clone(),
            queries: vec![query(idx)],
            traffic: crowds.map(|crowds| wire::Traffic { crowds }),
            ..Default::default()
        };
        let mut plan_in = async |crowds| client.find_paths(request(crowds)).await.unwrap().into_inner().plans.remove(0);
        let free = plan_in(None).await;
        let from_start = |at: surefoot_proto::world::v1::Vec3| distance(at, query(idx).start.unwrap());
        let Some(&place) = free.waypoints.iter().find(|place| (10.0..35.0).contains(&from_start(**place))) else {
            continue;
        };
        let crowd = |npcs: u32| Some(vec![wire::Crowd { place: Some(place), npcs }]);
        assert_eq!(plan_in(Some(Vec::new())).await, free, "no traffic");
        assert_eq!(plan_in(crowd(12)).await, free, "few NPCs do not delay each other");
        let crowded = plan_in(crowd(400)).await;
        assert_eq!(crowded.found, free.found, "a crowd delays, and bars nothing");
        tried += 1;
        detours += usize::from(crowded.waypoints != free.waypoints);
    }
    assert!(detours * 4 > tried && tried > 10, "{detours} of {tried} go around");
    planner.stop().await;
}
