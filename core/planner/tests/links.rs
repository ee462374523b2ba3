//! Links are those of the greedy spanner, by its definition.

use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::graph::GraphData;
use surefoot_planner::links::{NavMesh, expected_seconds};
use surefoot_planner::{Edge, EdgeKey, NavGraph, VertexId};
use surefoot_world::{Ability, Vec3};

const COUNT: u32 = 60;
/// Vertices of an island to which each one leads on foot, and the length of the way against the straight line.
const FOOT_NEIGHBOURS: usize = 8;
const FOOT_DETOUR: f32 = 1.5;

/// The greedy spanner by its definition: all pairs on foot sorted by distance, and all connections tried for each
/// candidate.
fn by_definition(
    mesh: &NavMesh<'_>,
    graph: &NavGraph,
    candidates: &[(EdgeKey, f64)],
    max_detour: f64,
) -> BTreeSet<EdgeKey> {
    let mut connections: BTreeMap<VertexId, Vec<(VertexId, f64)>> = BTreeMap::new();
    let mut connect =
        |from: VertexId, to: VertexId, seconds: f64| connections.entry(from).or_default().push((to, seconds));
    let distance = |a: VertexId, b: VertexId| graph.position(a).distance(graph.position(b));
    let islands: BTreeSet<u32> = mesh.islands.iter().copied().flatten().collect();
    for island in islands {
        let members: Vec<VertexId> =
            graph.vertices().filter(|vertex| mesh.islands[vertex.idx()] == Some(island)).collect();
        let centre = members.iter().map(|vertex| graph.position(*vertex)).sum::<Vec3>() / members.len() as f32;
        let from_centre = |vertex: &&VertexId| graph.position(**vertex).distance(centre);
        let middle = *members.iter().min_by(|a, b| from_centre(a).total_cmp(&from_centre(b))).unwrap();
        for &vertex in &members {
            let mut others: Vec<VertexId> = members.iter().copied().filter(|other| *other != vertex).collect();
            others.sort_by(|a, b| distance(vertex, *a).total_cmp(&distance(vertex, *b)));
            for other in others.into_iter().take(FOOT_NEIGHBOURS).chain([middle]) {
                let seconds = f64::from(FOOT_DETOUR * distance(vertex, other) / mesh.speed);
                connect(vertex, other, seconds);
                connect(other, vertex, seconds);
            }
        }
    }
    for edge in graph.edges().filter(|edge| !mesh.needs_link(graph, edge)) {
        connect(edge.key.from, edge.key.to, expected_seconds(edge));
    }
    let mut candidates = candidates.to_vec();
    candidates.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let mut kept = BTreeSet::new();
    for (key, seconds) in candidates {
        // Bellman and Ford: until no connection leads anywhere sooner.
        let mut after = BTreeMap::from([(key.from, 0.0)]);
        let mut is_changed = true;
        while std::mem::take(&mut is_changed) {
            for (from, connections) in &connections {
                let Some(start) = after.get(from).copied() else { continue };
                for (to, seconds) in connections {
                    let known = after.entry(*to).or_insert(f64::INFINITY);
                    if start + seconds < *known {
                        (*known, is_changed) = (start + seconds, true);
                    }
                }
            }
        }
        if after.get(&key.to).is_none_or(|after| *after > max_detour * seconds) {
            connections.entry(key.from).or_default().push((key.to, seconds));
            kept.insert(key);
        }
    }
    kept
}

/// A graph on a grid of metres, where many vertices are equally far apart, and the islands of its vertices.
fn level() -> impl Strategy<Value = (NavGraph, Vec<Option<u32>>)> {
    let place = (0..40u8, 0..3u8, 0..40u8).prop_map(|(x, y, z)| Vec3::new(f32::from(x), f32::from(y), f32::from(z)));
    let vertex = (place, prop::option::weighted(0.9, 0..3u32));
    let ability = prop::sample::select(vec![Ability::WALK, Ability::JUMP]);
    let edge = (0..COUNT, 0..COUNT, 1..60u32, ability);
    (prop::collection::vec(vertex, COUNT as usize), prop::collection::vec(edge, 0..80)).prop_map(|(vertices, edges)| {
        let edges = edges.into_iter().filter(|(from, to, ..)| from != to).map(|(from, to, decisions, ability)| {
            let mut evidence = Evidence::default();
            evidence.note(TryEnd::Arrived, decisions, ability);
            (EdgeKey::new(from, to), evidence)
        });
        let edges: BTreeMap<EdgeKey, Evidence> = edges.collect();
        let edges = edges.into_iter().map(|(key, evidence)| Edge { key, evidence }).collect();
        let (vertices, islands): (Vec<Vec3>, _) = vertices.into_iter().unzip();
        (NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap(), islands)
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 60,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn links_are_those_of_the_definition((graph, islands) in level(), max_detour in 1.1..6.0f64) {
        let mesh = NavMesh { radius: 0.4, speed: 6.0, islands: &islands };
        let candidates: Vec<(EdgeKey, f64)> = graph
            .edges()
            .filter(|edge| mesh.needs_link(&graph, edge))
            .map(|edge| (edge.key, expected_seconds(edge)))
            .collect();
        let expected = by_definition(&mesh, &graph, &candidates, max_detour);
        prop_assert_eq!(mesh.spanner(&graph, &candidates, max_detour), expected);
    }
}
