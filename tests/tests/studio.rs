//! The calls that Studio makes, over real sockets.

use e2e::{
    LIMIT, build_graph, create_world, ground, planner_client, set_goal, small_map, spawn, start_planner, start_server,
    start_worker, watch_until, world_client,
};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::convert::{map_spec, point, unpack};
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use surefoot_world::Vec3;
use tokio_stream::StreamExt;
use tonic::Code;
use tonic::transport::Channel;

type Planner = PlannerServiceClient<Channel>;

/// All tiles of a mesh response.
async fn tiles(
    client: &mut WorldServiceClient<Channel>,
    world_id: u64,
    cell_m: f32,
    region: Option<wire::Region>,
) -> Vec<wire::GetMeshResponse> {
    let request = wire::GetMeshRequest { world_id, cell_m, region, ..Default::default() };
    let mut stream = client.get_mesh(request).await.unwrap().into_inner();
    let mut tiles = Vec::new();
    while let Some(tile) = stream.next().await {
        tiles.push(tile.unwrap());
    }
    assert!(tiles.iter().all(|tile| tile.tile_count as usize == tiles.len()));
    tiles
}

fn corners(tile: &wire::GetMeshResponse) -> Vec<[Vec3; 3]> {
    let places = unpack(&tile.positions, tile.positions.len() / 4, "positions").unwrap();
    let place = |index: &[u8]| {
        let at = 3 * u32::from_le_bytes(index.try_into().unwrap()) as usize;
        Vec3::new(places[at], places[at + 1], places[at + 2])
    };
    tile.indices.chunks_exact(12).map(|triangle| [0, 4, 8].map(|at| place(&triangle[at..at + 4]))).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_mesh_of_a_world_is_its_map_in_tiles_whole_or_coarse() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 21, wire::TimeMode::Realtime).await.world_id;
    let map = surefoot_generate::generate(&map_spec(Some(&small_map(21))).unwrap());
    let whole = tiles(&mut client, world_id, 0.0, None).await;
    assert_eq!(whole.len(), 4, "a map of 100 m has two tiles each way");
    let area = |[a, b, c]: [Vec3; 3]| f64::from((b - a).cross(c - a).length() / 2.0);
    let sent: f64 = whole.iter().flat_map(corners).map(area).sum();
    let real: f64 = map.mesh().triangles().iter().map(|triangle| area(triangle.corners())).sum();
    assert!((sent - real).abs() < 1.0e-4 * real, "{sent} m2 of {real} m2 are sent");
    for tile in &whole {
        assert_eq!(tile.surfaces.len() * 12, tile.indices.len());
        let first = corners(tile)[0];
        let centre = (first[0] + first[1] + first[2]) / 3.0;
        assert_eq!([tile.tile_x, tile.tile_z], [(centre.x / 64.0) as u32, (centre.z / 64.0) as u32]);
    }
    let solid = |tiles: &[wire::GetMeshResponse], surface: wire::Surface| {
        tiles.iter().flat_map(|tile| &tile.surfaces).filter(|kind| i32::from(**kind) == i32::from(surface)).count()
    };
    let water = map.mesh().triangles().iter().filter(|it| it.surface() == surefoot_world::mesh::Surface::Water);
    assert_eq!(solid(&whole, wire::Surface::Water), water.count());

    let coarse = tiles(&mut client, world_id, 4.0, None).await;
    let count = |tiles: &[wire::GetMeshResponse]| solid(tiles, wire::Surface::Ground);
    assert!(count(&coarse) * 4 < count(&whole), "{} of {} triangles are left", count(&coarse), count(&whole));
    let corner = |x, z| Some(wire::Vec3 { x, y: 0.0, z });
    let region = wire::Region { low: corner(70.0, 70.0), high: corner(80.0, 80.0) };
    let part = tiles(&mut client, world_id, 0.0, Some(region)).await;
    assert!(part.len() == 1 && [part[0].tile_x, part[0].tile_z] == [1, 1]);

    let refused = |cell_m, world_id| wire::GetMeshRequest { world_id, cell_m, region: None, ..Default::default() };
    for (request, code) in [
        (refused(99.0, world_id), Code::InvalidArgument),
        (refused(f32::NAN, world_id), Code::InvalidArgument),
        (refused(0.0, 99), Code::NotFound),
    ] {
        assert_eq!(client.get_mesh(request).await.unwrap_err().code(), code);
    }
    let features =
        client.get_features(wire::GetFeaturesRequest { world_id, ..Default::default() }).await.unwrap().into_inner();
    let placed = map.placed();
    assert_eq!(
        [features.pools.len(), features.pads.len(), features.zip_lines.len()],
        [placed.pools.len(), placed.pads.len(), placed.zip_lines.len()]
    );
    for (sent, real) in features.pads.iter().zip(&placed.pads) {
        assert_eq!((point(sent.centre.as_ref(), "centre").unwrap(), sent.speed), (real.centre, real.speed));
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_follows_an_npc_sees_its_rays_and_how_its_attempts_ended() {
    let server = start_server(ServerConfig::default());
    let worker = start_worker(&server, None, 4);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 10, wire::TimeMode::Lockstep).await.world_id;
    let start = ground(&mut client, world_id, 1).await[0];
    let npc_id = spawn(&mut client, world_id, start).await;
    let follow = |rays| wire::FollowNpcRequest { npc_id, rate_hz: 60.0, rays, ..Default::default() };
    let mut steps = client.follow_npc(follow(true)).await.unwrap().into_inner();
    let first = steps.next().await.unwrap().unwrap();
    assert!(first.rays.len() == 64 && first.history.is_empty());
    let eyes = point(first.eyes.as_ref(), "eyes").unwrap();
    assert!((1.0..2.0).contains(&(eyes.y - first.npc.unwrap().position.unwrap().y)));
    let map = surefoot_generate::generate(&map_spec(Some(&small_map(10))).unwrap());
    for ray in &first.rays {
        let end = point(ray.end.as_ref(), "end").unwrap();
        let hit = map.mesh().cast_ray(eyes, (end - eyes).normalize(), 30.0);
        assert_eq!(hit.is_some(), ray.surface() != wire::Surface::Unspecified, "{ray:?}");
        assert!((hit.map_or(30.0, |hit| hit.distance) - eyes.distance(end)).abs() < 0.05, "{ray:?}");
    }
    // The NPC stands on its goal.
    set_goal(&mut client, npc_id, start).await;
    let ended = async {
        loop {
            let step = steps.next().await.unwrap().unwrap();
            if !step.history.is_empty() {
                return step.history;
            }
        }
    };
    let history = tokio::time::timeout(LIMIT, ended).await.expect("the attempt ends");
    assert!(history.len() == 1 && history[0].attempt == 1 && history[0].goal == Some(start), "{history:?}");
    assert!(history[0].outcome() == wire::Outcome::Reached && (0.0..5.0).contains(&history[0].seconds));
    let plain = client.follow_npc(follow(false)).await.unwrap().into_inner().next().await.unwrap().unwrap();
    assert!(plain.rays.is_empty() && plain.eyes.is_none() && plain.history == history);
    worker.stop().await;
    server.stop().await;
}

async fn get(client: &mut Planner, graph_id: &str) -> plan::GetGraphResponse {
    client
        .get_graph(plan::GetGraphRequest { graph_id: graph_id.to_owned(), ..Default::default() })
        .await
        .unwrap()
        .into_inner()
}

fn forbid(graph: &plan::GetGraphResponse, edge: &plan::Edge) -> plan::Edit {
    let (from, to) = (graph.vertices[edge.from as usize], graph.vertices[edge.to as usize]);
    plan::Edit { edit: Some(plan::edit::Edit::ForbidEdge(plan::EdgeEdit { from: Some(from), to: Some(to) })) }
}

#[tokio::test(flavor = "multi_thread")]
async fn of_two_designers_the_one_who_knows_the_latest_state_is_heard() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, 7).await;
    let watch = plan::WatchGraphRequest { graph_id: graph_id.clone() };
    let mut changes = client.watch_graph(watch).await.unwrap().into_inner();
    let before = changes.next().await.unwrap().unwrap().revision;
    let graph = get(&mut client, &graph_id).await;
    assert_eq!(graph.revision, before);
    let append = |edge: &plan::Edge, if_revision| plan::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "day".to_owned(),
        edits: vec![forbid(&graph, edge)],
        if_revision,
        ..Default::default()
    };
    let after = client.append_edits(append(&graph.edges[0], before)).await.unwrap().into_inner().revision;
    assert_ne!(after, before);
    let change = tokio::time::timeout(LIMIT, changes.next()).await.expect("the change is sent").unwrap().unwrap();
    assert_eq!((change.revision, change.summary.unwrap().edits), (after, 1));

    // A designer who knows only the previous revision.
    let late = client.append_edits(append(&graph.edges[1], before)).await.unwrap_err();
    assert!(late.code() == Code::Aborted && late.message().contains("have changed"), "{late}");
    let undo = |if_revision| plan::UndoEditsRequest {
        graph_id: graph_id.clone(),
        layer: "day".to_owned(),
        count: 1,
        if_revision,
        ..Default::default()
    };
    assert_eq!(client.undo_edits(undo(before)).await.unwrap_err().code(), Code::Aborted);
    let whole = plan::PutLayerRequest {
        graph_id: graph_id.clone(),
        layer: Some(plan::Layer { name: "day".to_owned(), edits: Vec::new() }),
        if_revision: before,
        ..Default::default()
    };
    assert_eq!(client.put_layer(whole).await.unwrap_err().code(), Code::Aborted);
    assert_eq!(get(&mut client, &graph_id).await.edges.len(), graph.edges.len() - 1, "nothing else was changed");
    // The same edits have the same revision.
    assert_eq!(client.undo_edits(undo(after)).await.unwrap().into_inner().revision, before);
    assert_eq!(client.append_edits(append(&graph.edges[0], 0)).await.unwrap().into_inner().revision, after);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn edges_tell_their_evidence_and_what_designers_did_to_them() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, 7).await;
    let graph = get(&mut client, &graph_id).await;
    for edge in &graph.edges {
        let fastest = edge.decisions_mean / 6.0;
        assert!(edge.chance > 0.0 && edge.chance <= 1.0 && edge.seconds >= 0.99 * fastest, "{edge:?}");
        assert!(edge.price_factor == 1.0 && !edge.forced);
    }
    let place = |vertex: u32| Some(graph.vertices[vertex as usize]);
    let (dearer, other) = (graph.edges[0].clone(), graph.edges[1].clone());
    let has = |from, to| graph.edges.iter().any(|edge| (edge.from, edge.to) == (from, to));
    let count = graph.vertices.len() as u32;
    let gone = (0..count).find(|vertex| ![dearer.from, dearer.to].contains(vertex)).unwrap();
    let (from, to) = (0..count)
        .flat_map(|from| (0..count).map(move |to| (from, to)))
        .find(|&(from, to)| from != to && from != gone && to != gone && !has(from, to))
        .unwrap();
    use plan::edit::Edit;
    let edits = [
        Edit::PriceEdge(plan::PriceEdge { from: place(dearer.from), to: place(dearer.to), factor: 4.0 }),
        Edit::ForceEdge(plan::ForceEdge { from: place(from), to: place(to), seconds: Some(3.0) }),
        Edit::RemoveVertex(plan::VertexEdit { at: place(gone) }),
    ];
    let request = plan::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "day".to_owned(),
        edits: edits.into_iter().map(|edit| plan::Edit { edit: Some(edit) }).collect(),
        ..Default::default()
    };
    client.append_edits(request).await.unwrap();
    let edited = get(&mut client, &graph_id).await;
    let find = |from, to| edited.edges.iter().find(|edge| (edge.from, edge.to) == (from, to)).unwrap().clone();
    let priced = find(dearer.from, dearer.to);
    assert_eq!(priced.price_factor, 4.0);
    assert!((priced.seconds - 4.0 * dearer.seconds).abs() < 1.0e-3 * priced.seconds);
    assert!(find(from, to).forced && (find(from, to).seconds - 3.0).abs() < 1.0e-3);
    assert_eq!(edited.removed, [gone]);
    assert!(edited.edges.iter().all(|edge| edge.from != gone && edge.to != gone));

    let other_graph = client
        .compare_graphs(plan::CompareGraphsRequest {
            before: graph_id.clone(),
            after: graph_id.clone(),
            ..Default::default()
        })
        .await
        .unwrap()
        .into_inner();
    assert!(other_graph.lost.is_empty() && other_graph.gained.is_empty());
    let listed = client.list_graphs(plan::ListGraphsRequest::default()).await.unwrap().into_inner().graphs;
    assert!(listed.len() == 1 && listed[0].graph_id == graph_id && listed[0].map.unwrap().seed == 7);
    let unknown = plan::CompareGraphsRequest { before: graph_id.clone(), after: "0".repeat(64), ..Default::default() };
    assert_eq!(client.compare_graphs(unknown).await.unwrap_err().code(), Code::NotFound);

    let probe = |to, seed| plan::ProbeEdgeRequest {
        graph_id: graph_id.clone(),
        from: other.from,
        to,
        seed,
        ..Default::default()
    };
    let run = client.probe_edge(probe(other.to, 5)).await.unwrap().into_inner();
    let again = client.probe_edge(probe(other.to, 5)).await.unwrap().into_inner();
    assert_eq!(run, again, "the same seed gives the same run");
    let track = unpack(&run.track, run.track.len() / 4, "track").unwrap();
    assert_eq!(track.len(), 3 * (10 * run.decisions as usize + 1), "a point for every tick and the start");
    let place_at = |at: usize| Vec3::new(track[3 * at], track[3 * at + 1], track[3 * at + 2]);
    let vertex = |idx: u32| point(Some(&edited.vertices[idx as usize]), "vertex").unwrap();
    assert_eq!(place_at(0), vertex(other.from));
    let nearest = (0..track.len() / 3).map(|at| place_at(at).distance(vertex(other.to))).fold(f32::MAX, f32::min);
    assert_eq!(run.reached, nearest <= 1.0, "it came as near as {nearest} m");
    assert_eq!(client.probe_edge(probe(4000, 5)).await.unwrap_err().code(), Code::NotFound);
    planner.stop().await;
}

/// The next plan that an NPC follows.
async fn next_plan(steps: &mut tonic::Streaming<wire::FollowNpcResponse>) -> wire::NpcPlan {
    let following = async {
        loop {
            let step = steps.next().await.unwrap().unwrap();
            if let Some(plan) = step.plan.filter(|plan| !plan.waypoints.is_empty()) {
                return plan;
            }
        }
    };
    tokio::time::timeout(LIMIT, following).await.expect("a plan is sent")
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_on_its_way_plans_anew_when_a_designer_forbids_its_legs() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut planner_client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut planner_client, 1000).await;
    let graph = get(&mut planner_client, &graph_id).await;
    let worker = start_worker(&server, Some(&planner), 8);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    // A path of several legs between two vertices, farther than an NPC walks while an edit takes effect.
    let mut chosen = None;
    for (from, to) in (0..graph.vertices.len()).flat_map(|from| (0..50).map(move |to| (from, to))) {
        let query =
            plan::PathQuery { start: Some(graph.vertices[from]), goal: Some(graph.vertices[to]), ..Default::default() };
        let request = plan::FindPathRequest { graph_id: graph_id.clone(), query: Some(query), ..Default::default() };
        let found = planner_client.find_path(request).await.unwrap().into_inner().plan.unwrap();
        if found.found && found.waypoints.len() >= 6 && found.seconds > 15.0 {
            chosen = Some((graph.vertices[from], graph.vertices[to]));
            break;
        }
    }
    let (start, goal) = chosen.expect("a long path");
    let npc_id = spawn(&mut client, world_id, start).await;
    let follow = wire::FollowNpcRequest { npc_id, rate_hz: 60.0, rays: false, ..Default::default() };
    let mut steps = client.follow_npc(follow).await.unwrap().into_inner();
    set_goal(&mut client, npc_id, goal).await;
    // The NPC has no plan with a path until its worker has the graph.
    let first = next_plan(&mut steps).await;
    // The last leg along an edge, far from the NPC. The leg to the goal leads along none, although a vertex lies there,
    // too.
    let at = |place: &wire::Vec3| graph.vertices.iter().position(|vertex| vertex == place);
    let (_, vertices) = first.waypoints.split_last().expect("a plan with waypoints");
    let (from, to) = vertices
        .windows(2)
        .rev()
        .filter_map(|pair| Some((at(&pair[0])? as u32, at(&pair[1])? as u32)))
        .find(|ends| graph.edges.iter().any(|edge| (edge.from, edge.to) == *ends))
        .expect("a leg between two vertices");
    let edits = graph.edges.iter().filter(|edge| edge.from == from && edge.to == to).map(|edge| forbid(&graph, edge));
    let request = plan::AppendEditsRequest {
        graph_id: graph_id.clone(),
        layer: "day".to_owned(),
        edits: edits.collect(),
        if_revision: graph.revision,
        ..Default::default()
    };
    planner_client.append_edits(request).await.unwrap();
    let leg = [graph.vertices[from as usize], graph.vertices[to as usize]];
    let leads_along = |plan: &wire::NpcPlan| plan.waypoints.windows(2).any(|pair| pair == leg);
    assert!(leads_along(&first));
    // A rehearsal may have asked for a plan just before.
    let mut second = next_plan(&mut steps).await;
    while leads_along(&second) {
        second = next_plan(&mut steps).await;
    }
    assert_eq!(second.waypoints.last(), Some(&goal));
    // The attempt is still the same.
    let snapshot = watch_until(&mut client, world_id, |snapshot| !snapshot.npcs.is_empty()).await;
    assert_eq!((snapshot.npcs[0].attempts_begun, snapshot.npcs[0].status()), (1, wire::NpcStatus::Seeking));
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}
