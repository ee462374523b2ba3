//! Search against petgraph's own algorithms, and plans on small graphs.

use petgraph::algo::{astar, dijkstra};
use petgraph::graph::NodeIndex;
use proptest::prelude::*;
use surefoot_planner::graph::{Evidence, GraphData};
use surefoot_planner::search::{OFF_GRAPH, cheapest, find_path};
use surefoot_planner::{Ability, Edge, NavGraph, NoPath, Query};
use surefoot_world::Vec3;

fn edge(from: u32, to: u32, decisions: u32, successes: u32, tries: u32) -> Edge {
    let mut evidence = Evidence::default();
    for attempt in 0..tries {
        evidence.note(attempt < successes, decisions, Ability::Walk);
    }
    Edge { from, to, evidence }
}

fn graph(vertices: Vec<Vec3>, edges: Vec<Edge>) -> NavGraph {
    NavGraph::check(GraphData { vertices, edges }).unwrap()
}

fn row(count: u32) -> Vec<Vec3> {
    (0..count).map(|idx| Vec3::new(30.0 * idx as f32, 0.0, 0.0)).collect()
}

fn query(start: Vec3, goal: Vec3) -> Query {
    Query { start, goal, avoid: Vec::new() }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, rng_seed: proptest::test_runner::RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn our_dijkstra_petgraphs_dijkstra_and_petgraphs_a_star_agree(
        edges in prop::collection::vec((0..40u32, 0..40u32, 1..60u32, 1..4u32, 0..3u32), 0..200),
        from in 0..40u32,
        to in 0..40u32,
    ) {
        let edges = edges.into_iter().filter(|(a, b, ..)| a != b).map(|(a, b, decisions, successes, failures)| edge(a, b, decisions, successes, successes + failures)).collect();
        let graph = graph(row(40), edges);
        let ours = cheapest(&graph, &[(from, 0.0)], &[(to, 0.0)], &[]);
        let (source, target) = (NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        let theirs = dijkstra(graph.as_petgraph(), source, Some(target), |edge| edge.weight().evidence.cost());
        let star = astar(graph.as_petgraph(), source, |node| node == target, |edge| edge.weight().evidence.cost(), |_| 0.0);
        match (ours, theirs.get(&target), star) {
            (None, None, None) => {}
            (Some((cost, path)), Some(reference), Some((star, _))) => {
                prop_assert!((cost - reference).abs() < 1.0e-6 && (star - reference).abs() < 1.0e-6);
                prop_assert_eq!((path[0], path[path.len() - 1]), (from, to));
                let walked: f64 = path.windows(2).map(|pair| {
                    graph.edges_from(pair[0]).filter(|edge| edge.to == pair[1]).map(|edge| edge.evidence.cost()).fold(f64::INFINITY, f64::min)
                }).sum();
                prop_assert!((walked - cost).abs() < 1.0e-6, "the path costs {} but {} was said", walked, cost);
            }
            other => prop_assert!(false, "they disagree whether there is a path: {:?}", other),
        }
    }
}

#[test]
fn a_plan_passes_proved_vertices_and_ends_at_the_goal() {
    let graph = graph(row(4), vec![edge(0, 1, 10, 2, 2), edge(1, 2, 10, 2, 2), edge(2, 3, 10, 2, 2)]);
    let goal = Vec3::new(92.0, 0.0, 1.0);
    let plan = find_path(&graph, &query(Vec3::new(-1.0, 0.0, 0.0), goal));
    assert_eq!(plan.no_path, None);
    assert_eq!(plan.waypoints.last(), Some(&goal));
    assert_eq!(plan.legs.len(), plan.waypoints.len());
    assert!(plan.legs.iter().any(|leg| (leg.from, leg.to) == (1, 2)));
    assert!(plan.chance() > 0.0 && plan.chance() <= 1.0 && plan.seconds() > 0.0);
}

#[test]
fn a_risky_short_cut_loses_against_a_safe_detour() {
    let vertices = vec![Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0), Vec3::new(30.0, 0.0, 25.0)];
    let graph = graph(vertices, vec![edge(0, 1, 30, 1, 10), edge(0, 2, 25, 10, 10), edge(2, 1, 25, 10, 10)]);
    let (_, path) = cheapest(&graph, &[(0, 0.0)], &[(1, 0.0)], &[]).unwrap();
    assert_eq!(path, [0, 2, 1]);
}

#[test]
fn a_failed_leg_is_not_used_again() {
    let graph = graph(row(3), vec![edge(0, 1, 10, 2, 2), edge(1, 2, 10, 2, 2), edge(0, 2, 50, 2, 2)]);
    let direct = cheapest(&graph, &[(0, 0.0)], &[(2, 0.0)], &[]).unwrap().1;
    assert_eq!(direct, [0, 1, 2]);
    let around = cheapest(&graph, &[(0, 0.0)], &[(2, 0.0)], &[(1, 2)]).unwrap().1;
    assert_eq!(around, [0, 2]);
}

#[test]
fn where_there_is_no_path_the_reason_is_told_and_the_goal_is_headed_for() {
    let two_islands = |edges: Vec<Edge>| {
        let mut vertices = row(8);
        vertices.extend((0..8).map(|idx| Vec3::new(5000.0 + 30.0 * idx as f32, 0.0, 0.0)));
        let chain = |from: u32, to: u32| {
            (from..to).flat_map(|idx| [edge(idx, idx + 1, 10, 2, 2), edge(idx + 1, idx, 10, 2, 2)])
        };
        graph(vertices, chain(0, 7).chain(chain(8, 15)).chain(edges).collect())
    };
    let (start, goal) = (Vec3::new(10.0, 0.0, 0.0), Vec3::new(5100.0, 0.0, 0.0));
    let plan = find_path(&two_islands(Vec::new()), &query(start, goal));
    assert_eq!((plan.no_path, plan.waypoints.as_slice()), (Some(NoPath::DifferentIslands), [goal].as_slice()));
    assert_eq!(plan.legs[0].from, OFF_GRAPH);
    let plan = find_path(&two_islands(vec![edge(8, 7, 10, 2, 2)]), &query(start, goal));
    assert_eq!(plan.no_path, Some(NoPath::OneWay));
    let plan = find_path(&two_islands(vec![edge(7, 8, 10, 2, 2)]), &query(start, goal));
    assert_eq!(plan.no_path, None);
    let bare = graph(row(3), Vec::new());
    assert_eq!(find_path(&bare, &query(Vec3::ZERO, Vec3::new(60.0, 0.0, 0.0))).no_path, Some(NoPath::StartOffGraph));
}

#[test]
fn islands_are_strongly_connected_components() {
    let graph = graph(row(4), vec![edge(0, 1, 5, 1, 1), edge(1, 0, 5, 1, 1), edge(1, 2, 5, 1, 1)]);
    assert_eq!(graph.island_count(), 3);
    assert_eq!(graph.islands()[0], graph.islands()[1]);
    assert!((graph.connected_share() - 4.0 / 12.0).abs() < 1.0e-9);
}

#[test]
fn edges_that_make_no_sense_are_refused() {
    let check = |edges| NavGraph::check(GraphData { vertices: row(2), edges });
    assert!(check(vec![edge(0, 2, 5, 1, 1)]).is_err());
    assert!(check(vec![edge(1, 1, 5, 1, 1)]).is_err());
    assert!(NavGraph::check(GraphData { vertices: vec![Vec3::new(f32::NAN, 0.0, 0.0)], edges: Vec::new() }).is_err());
}
