//! Layers of edits, changed maps, and graphs for other programs, on a small real map.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_planner::Progress;
use surefoot_planner::edits::{Edit, Layer, LayerError, MapTerrain, UnappliedReason, apply_layers};
use surefoot_planner::export::{About, Format, body_of, export, export_about, frame_of, import_json};
use surefoot_planner::graph::GraphData;
use surefoot_planner::links::{NavMesh, expected_seconds};
use surefoot_planner::reachability::{compare, describe};
use surefoot_planner::update::Change;
use surefoot_planner::{BuildSettings, EdgeKey, NavGraph, Probing, VertexId};
use surefoot_policy::Policy;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::graphs::{self, build};
use surefoot_world::map::{LevelFrame, Placed, UpAxis};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, DVec3, Map, MapSpec, Vec3};

fn context(map: Map) -> ProbeContext {
    ProbeContext { map: Arc::new(map), profile: CharacterProfile::default(), policy: Policy::shipped().unwrap() }
}

fn small() -> ProbeContext {
    context(surefoot_generate::generate(&MapSpec::with_side(31, 80).unwrap()))
}

fn settings(vertices: usize, neighbours: usize) -> BuildSettings {
    BuildSettings::default()
        .with(|it| {
            it.vertices = vertices;
            it.neighbours = neighbours;
            it.seed = 4;
        })
        .unwrap()
}

fn terrain(context: &ProbeContext, settings: BuildSettings) -> MapTerrain {
    graphs::terrain(context, settings, 2)
}

fn layer(edits: Vec<Edit>) -> Layer {
    Layer { name: "test".to_owned(), edits }
}

#[test]
fn edits_change_the_graph_and_leave_what_was_proved_alone() {
    let (context, settings) = (small(), settings(40, 6));
    let graph = build(&context, &settings, 2, &Progress::default()).unwrap().graph;
    let terrain = terrain(&context, settings);
    let edited = |edits| apply_layers(&graph, &[layer(edits)], settings.threshold, &terrain).unwrap();
    let edge = *graph.edges().next().unwrap();
    let (from, to) = (graph.position(edge.key.from), graph.position(edge.key.to));

    let forbidden = edited(vec![Edit::ForbidEdge { from, to }]);
    assert!(forbidden.unapplied.is_empty());
    assert!(forbidden.graph.edge(edge.key).is_none());
    assert!(forbidden.forbidden.iter().eq([&edge.key]));
    let vouched = edited(vec![Edit::ForbidEdge { from, to }, Edit::ForceEdge { from, to, seconds: None }]);
    assert!(vouched.forbidden.is_empty() && vouched.forced.contains(&edge.key));
    assert_eq!(forbidden.graph.edge_count(), graph.edge_count() - 1);

    let priced = edited(vec![Edit::PriceEdge { from, to, factor: 5.0 }]);
    let cost = |graph: &NavGraph| graph.edge(edge.key).unwrap().evidence.cost();
    assert!((cost(&priced.graph) / cost(&graph) - 5.0).abs() < 1.0e-3);

    let missing = graph
        .vertices()
        .flat_map(|from| graph.vertices().map(move |to| EdgeKey { from, to }))
        .find(|&key| key.from != key.to && graph.edge(key).is_none())
        .unwrap();
    let (a, b) = (graph.position(missing.from), graph.position(missing.to));
    let forced = edited(vec![Edit::ForceEdge { from: a, to: b, seconds: Some(3.0) }]);
    let evidence = forced.graph.edge(missing).unwrap().evidence;
    assert!((evidence.decisions_mean().0 - 18.0).abs() < 1.0e-3 && evidence.chance().get() > 0.99);
    let absent = edited(vec![Edit::ForbidEdge { from: a, to: b }]);
    assert_eq!(absent.unapplied[0].reason, UnappliedReason::NoEdge(missing));

    let removed = edited(vec![Edit::RemoveVertex { at: from }, Edit::ForbidEdge { from, to }]);
    assert_eq!(removed.graph.vertex_count(), graph.vertex_count(), "indices stay");
    assert!(!removed.graph.has_exit(edge.key.from) && !removed.graph.has_entrance(edge.key.from));
    assert_eq!(removed.unapplied.len(), 1, "the edge went with its vertex: {:?}", removed.unapplied);

    let spot = from + (to - from) * 0.5;
    let added = edited(vec![Edit::AddVertex { at: spot }]);
    if added.unapplied.is_empty() {
        let vertex = VertexId::at(graph.vertex_count());
        assert_eq!(added.graph.vertex_count(), graph.vertex_count() + 1);
        assert!(added.graph.has_exit(vertex) || added.graph.has_entrance(vertex), "its edges were not proved");
    }
    let nowhere =
        edited(vec![Edit::AddVertex { at: Vec3::new(40.0, 79.0, 40.0) }, Edit::RemoveVertex { at: Vec3::ZERO }]);
    assert!(matches!(nowhere.unapplied[0].reason, UnappliedReason::NoGround(_)));
    assert!(matches!(nowhere.unapplied[1].reason, UnappliedReason::NoVertex(_)));
    assert_eq!(nowhere.graph.to_data(), graph.to_data());
}

#[test]
fn layers_survive_a_rebuild_with_other_settings() {
    let context = small();
    let graph = build(&context, &settings(40, 6), 2, &Progress::default()).unwrap().graph;
    let at = graph.position(VertexId(3));
    let night = layer(vec![Edit::RemoveVertex { at }]);
    let text = serde_json::to_string(&night).unwrap();
    assert_eq!(serde_json::from_str::<Layer>(&text).unwrap(), night);
    let rebuilt = build(&context, &settings(40, 8), 2, &Progress::default()).unwrap().graph;
    let terrain = terrain(&context, settings(40, 8));
    let edited = apply_layers(&rebuilt, &[night], 0.5, &terrain).unwrap();
    assert!(edited.unapplied.is_empty(), "placement does not depend on the neighbours");
    assert!(!edited.graph.has_exit(VertexId(3)));
}

#[test]
fn layers_that_make_no_sense_are_refused_by_name() {
    let one = Vec3::ONE;
    let refused = |layer: Layer| layer.validate().unwrap_err();
    assert_eq!(refused(Layer { name: String::new(), edits: Vec::new() }), LayerError::Name);
    assert_eq!(refused(Layer { name: "a\nb".to_owned(), edits: Vec::new() }), LayerError::Name);
    let edit = |edit| refused(layer(vec![Edit::AddVertex { at: one }, edit])).to_string();
    assert!(edit(Edit::AddVertex { at: Vec3::new(0.0, f32::NAN, 0.0) }).starts_with("edit 1: position"));
    assert!(edit(Edit::PriceEdge { from: one, to: one, factor: 0.0 }).contains("factor"));
    assert!(edit(Edit::ForceEdge { from: one, to: one, seconds: Some(-1.0) }).contains("seconds"));
    assert!(serde_json::from_str::<Layer>(r#"{"name":"x","edits":[{"edit":"blow_up"}]}"#).is_err());
}

/// The solid triangles of the map, so that a test can add to them.
fn ground_of(map: &Map, extra: Vec<Triangle>) -> Map {
    let solid = map.mesh().triangles().iter().filter(|triangle| triangle.surface() == Surface::Ground).copied();
    Map::from_parts(map.size(), solid.chain(extra).collect(), Placed::default())
}

/// A solid block that stands on a place, with faces outwards.
fn block(at: Vec3, half: f32, height: f32) -> Vec<Triangle> {
    let corner = |x: f32, y: f32, z: f32| at + Vec3::new(x * half, y, z * half);
    let ring = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mut faces = vec![ring.map(|(x, z)| corner(x, height, z))];
    for side in 0..4 {
        let ((ax, az), (bx, bz)) = (ring[side], ring[(side + 1) % 4]);
        faces.push([corner(ax, -4.0, az), corner(bx, -4.0, bz), corner(bx, height, bz), corner(ax, height, az)]);
    }
    let inside = at + Vec3::new(0.0, 0.5 * height, 0.0);
    let outwards = |[a, b, c]: [Vec3; 3]| {
        let triangle = Triangle::new([a, b, c], Surface::Ground).unwrap();
        if triangle.normal().dot(a - inside) > 0.0 {
            triangle
        } else {
            Triangle::new([a, c, b], Surface::Ground).unwrap()
        }
    };
    faces.into_iter().flat_map(|[a, b, c, d]| [outwards([a, b, c]), outwards([a, c, d])]).collect()
}

#[test]
fn after_a_local_change_only_what_it_touches_is_probed_again() {
    let generated = surefoot_generate::generate(&MapSpec::with_side(31, 120).unwrap());
    let before = context(ground_of(&generated, Vec::new()));
    let settings = settings(150, 10)
        .with(|it| {
            it.probing = Probing::Exhaustive;
            it.special_moves = false;
        })
        .unwrap();
    let old = build(&before, &settings, 2, &Progress::default()).unwrap();
    // 12 m x 12 m of 120 m x 120 m: 1 % of the map.
    let at = old.graph.position(VertexId(20));
    let after = context(ground_of(&generated, block(at, 6.0, 14.0)));
    let change = Change::between(&before.map, &after.map);
    assert!(change.area() < 250.0 && !change.is_empty());
    assert!(Change::between(&before.map, &before.map).is_empty());

    let progress = Progress::default();
    let updated = graphs::update((&old.graph, &before.map), &after, &settings, 2, &progress).unwrap();
    assert_eq!(progress.done.load(Ordering::Relaxed), updated.built.stats.probes);
    assert!(updated.retried > 0);
    assert!(updated.built.stats.probes * 10 <= old.stats.probes, "{} probes", updated.built.stats.probes);

    // Compares with probing every candidate of the same vertices again, with the same noise and with other noise.
    let full = |seed| {
        let none = GraphData { edges: Vec::new(), ..old.graph.to_data() };
        let blank = context(Map::from_parts(before.map.size(), Vec::new(), Placed::default()));
        let settings = settings.with(|it| it.seed = seed).unwrap();
        let none = NavGraph::check(none).unwrap();
        graphs::update((&none, &blank.map), &after, &settings, 2, &Progress::default()).unwrap().built.graph
    };
    let pairs = |graph: &NavGraph| graph.edges().map(|edge| edge.key).collect::<BTreeSet<_>>();
    let rebuilt = pairs(&full(settings.seed));
    let differing = |graph: &NavGraph| pairs(graph).symmetric_difference(&rebuilt).count();
    let (ours, noise) = (differing(&updated.built.graph), differing(&full(settings.seed + 1)));
    assert!(ours * 25 <= rebuilt.len(), "{ours} of {} edges differ", rebuilt.len());
    assert!(2 * ours < 3 * noise, "{ours} edges differ, by noise alone {noise}");
    // The vertex under the block was connected before and is no longer.
    assert!(old.graph.has_entrance(VertexId(20)) && old.graph.has_exit(VertexId(20)));
    assert!(!updated.built.graph.has_entrance(VertexId(20)) && !updated.built.graph.has_exit(VertexId(20)));
}

#[test]
fn json_comes_back_and_other_forms_hold_every_edge() {
    let context = small();
    let graph = build(&context, &settings(40, 6), 2, &Progress::default()).unwrap().graph;
    let back = import_json(&export(&graph, Format::Json)).unwrap();
    assert_eq!(back.to_data(), graph.to_data());
    let body = CharacterProfile::default().with(|body| body.max_slope = 0.7).unwrap();
    let with_body = export_about(&graph, Format::Json, About { frame: None, body: Some(body.clone()) });
    assert_eq!((body_of(&with_body), frame_of(&with_body)), (Some(body), None));
    assert_eq!(import_json(&with_body).unwrap().to_data(), back.to_data());
    assert_eq!(body_of(&export(&graph, Format::Json)), None);
    assert!(export(&graph, Format::Json).contains("\"ability\": \"Walk\""), "files of 0.2.0 have such names");
    let far = LevelFrame { origin: DVec3::new(-512_345.25, 2.0, 5_400_123.5), scale: 0.01, up: UpAxis::Z };
    for frame in [LevelFrame::default(), far] {
        let with_frame = export_about(&graph, Format::Json, About { frame: Some(frame), body: None });
        assert_eq!(frame_of(&with_frame), Some(frame));
        assert_eq!(import_json(&with_frame).unwrap().to_data(), back.to_data());
    }
    let count = |format, needle: &str| export(&graph, format).matches(needle).count();
    assert_eq!((count(Format::GraphMl, "<edge "), count(Format::GraphMl, "<node ")), (graph.edge_count(), 40));
    assert!(import_json("{}").is_err());
    assert!(import_json(&export(&graph, Format::Json).replacen("\"id\": 0", "\"id\": 7", 1)).is_err());
}

#[test]
fn traps_islands_and_losses_are_reported() {
    let context = small();
    let settings = settings(60, 8);
    let graph = build(&context, &settings, 2, &Progress::default()).unwrap().graph;
    let description = describe(&graph);
    assert_eq!(description.islands.iter().map(|island| island.vertices).sum::<usize>(), graph.vertex_count());
    assert!(description.islands[0].entered && description.islands[0].left);
    // A vertex that can be entered but not left is a trap.
    let main = description.islands[0].id;
    let vertex = graph.vertices().find(|vertex| graph.islands()[vertex.idx()] == main).unwrap();
    let mut data = graph.to_data();
    data.edges.retain(|edge| edge.key.from != vertex);
    let trapped = NavGraph::check(data).unwrap();
    let islands = describe(&trapped).islands;
    assert!(islands.iter().any(|island| island.is_trap() && island.vertices == 1), "{islands:?}");
    let mut data = graph.to_data();
    data.edges.retain(|edge| edge.key.to != vertex && edge.key.from != vertex);
    let difference = compare(&graph, &NavGraph::check(data).unwrap());
    assert!(difference.connected_after < difference.connected_before);
}

#[test]
fn a_nav_mesh_gets_the_links_that_nothing_replaces_and_reaches_as_much() {
    let context = small();
    let graph = build(&context, &settings(60, 10), 2, &Progress::default()).unwrap().graph;
    // Three islands on foot, regardless of the ground.
    let islands: Vec<Option<u32>> = graph.vertices().map(|vertex| Some(vertex.0 % 3)).collect();
    let nav_mesh = NavMesh { radius: 0.3, speed: 11.0, islands: &islands };
    let needed = graph.edges().filter(|edge| nav_mesh.needs_link(&graph, edge));
    let candidates: Vec<(EdgeKey, f64)> = needed.map(|edge| (edge.key, expected_seconds(edge))).collect();
    let all: Vec<EdgeKey> = candidates.iter().map(|candidate| candidate.0).collect();
    let few: Vec<EdgeKey> = nav_mesh.spanner(&graph, &candidates, 3.0).into_iter().collect();
    assert!(!few.is_empty() && few.len() * 4 < all.len(), "{} of {}", few.len(), all.len());
    assert!(few.iter().all(|key| all.contains(key)));
    assert!(nav_mesh.spanner(&graph, &candidates, 1.2).len() > few.len(), "less is replaced where detours are short");
    // Between islands, the few links lead wherever all links lead.
    let reached = |links: &[EdgeKey]| {
        let mut reached = [[false; 3]; 3];
        (0..3).for_each(|island| reached[island][island] = true);
        for _ in 0..3 {
            for key in links {
                let (from, to) = ((key.from.0 % 3) as usize, (key.to.0 % 3) as usize);
                for row in &mut reached {
                    row[to] |= row[from];
                }
            }
        }
        reached
    };
    assert_eq!(reached(&few), reached(&all));
}
