//! Graphs from files: numbers that no build writes are refused with a reason, and the largest allowed ones are
//! answered.

use serde_json::{Value, json};
use surefoot_planner::EdgeCosts;
use surefoot_planner::edits::{Edit, Layer, Terrain, UnappliedReason, apply_layers};
use surefoot_planner::evidence::Evidence;
use surefoot_planner::export::{Format, export, import_json};
use surefoot_planner::graph::{GraphData, MAX_COORDINATE_M, MAX_EDGE_M};
use surefoot_planner::{Edge, EdgeKey, NavGraph, Query, Router, Traffic};
use surefoot_world::{Decisions, Vec3};

fn graph(vertices: Vec<Vec3>, edges: &[(u32, u32)]) -> NavGraph {
    let edge =
        |&(from, to): &(u32, u32)| Edge { key: EdgeKey::new(from, to), evidence: Evidence::forced(Decisions(9.0)) };
    let edges = edges.iter().map(edge).collect();
    NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap()
}

/// A file of three vertices in a row with the value at a path replaced.
fn file_with(path: &str, value: Value) -> String {
    let row = [3.0, 9.0, 15.0].map(|x| Vec3::new(x, 1.0, 9.0)).to_vec();
    let mut file: Value = serde_json::from_str(&export(&graph(row, &[(0, 1), (1, 2), (2, 1)]), Format::Json)).unwrap();
    *file.pointer_mut(path).expect("the file has this value") = value;
    file.to_string()
}

#[test]
fn numbers_that_no_build_writes_are_refused_with_their_reason() {
    let cases = [
        ("/nodes/2/x", json!(1.0e9), "a coordinate of vertex 2 is not finite or exceeds 100000 m"),
        ("/nodes/0/y", json!(-2.0e5), "a coordinate of vertex 0 is not finite or exceeds 100000 m"),
        ("/nodes/2/z", json!(10_100.0), "edge 1 -> 2 is longer than 10000 m"),
        ("/edges/0/target", json!(3), "edge 0 -> 3 does not join two different vertices of the graph"),
        ("/edges/0/evidence/decisions_sum", json!(1.0e300), "the evidence of edge 0 -> 1 is inconsistent"),
        ("/edges/0/evidence/decisions_squared", json!(1.0e300), "the evidence of edge 0 -> 1 is inconsistent"),
        ("/edges/0/evidence/decisions_sum", json!(-1.0), "the evidence of edge 0 -> 1 is inconsistent"),
        ("/edges/1/evidence/price_factor", json!(1.0e30), "the evidence of edge 1 -> 2 is inconsistent"),
        ("/edges/1/evidence/price_factor", json!(1.0e-30), "the evidence of edge 1 -> 2 is inconsistent"),
        ("/edges/2/evidence/deaths", json!(4_294_967_295_u32), "the evidence of edge 2 -> 1 is inconsistent"),
        ("/graph/legs/decisions/1", json!(1.0e300), "the cost model of unproved legs has a coefficient"),
        ("/graph/legs/range_m", json!(1.0e30), "the cost model of unproved legs has a coefficient"),
        ("/graph/legs/death_share", json!(1.5), "the cost model of unproved legs has a coefficient"),
    ];
    for (path, value, reason) in cases {
        let error = import_json(&file_with(path, value.clone())).expect_err(path).to_string();
        assert!(error.starts_with(reason), "{path} = {value}: {error}");
    }
    assert!(import_json(&file_with("/nodes/2/x", json!(16.0))).is_ok());
}

#[test]
fn the_longest_edges_are_planned_around_in_traffic() {
    let far = MAX_COORDINATE_M;
    let vertices = vec![Vec3::splat(far), Vec3::new(far - MAX_EDGE_M, far, far), Vec3::splat(-far)];
    let router = Router::new(graph(vertices.clone(), &[(0, 1), (1, 0)]), 0, 1);
    router.prepare_labels(1);
    for goal in &vertices {
        let query = Query::new(vertices[0], *goal);
        let mut traffic = Traffic::default();
        traffic.add_crowd(vertices[0], u32::MAX);
        let plan = router.find_path_in(&mut traffic, &query, &EdgeCosts::new());
        assert!(plan.seconds().0.is_finite(), "{plan:?}");
    }
}

/// Ground everywhere, on which every edge is proved.
struct Anywhere;

impl Terrain for Anywhere {
    fn stand(&self, place: Vec3) -> Option<Vec3> {
        Some(place)
    }

    fn prove(&self, _: &[Vec3], candidates: &[EdgeKey]) -> Option<Vec<Evidence>> {
        Some(vec![Evidence::forced(Decisions(5.0)); candidates.len()])
    }
}

#[test]
fn edits_that_would_make_edges_or_vertices_beyond_the_bounds_are_reported() {
    let near = Vec3::new(MAX_EDGE_M + 100.0, 0.0, 0.0);
    let graph = graph(vec![Vec3::ZERO, near], &[]);
    let outside = Vec3::splat(MAX_COORDINATE_M * 2.0);
    let edits = vec![
        Edit::ForceEdge { from: Vec3::ZERO, to: near, seconds: None },
        Edit::AddVertex { at: outside },
        Edit::MoveVertex { from: near, to: Vec3::new(50_000.0, 0.0, 0.0) },
        Edit::ForbidEdge { from: Vec3::splat(f32::MAX), to: Vec3::ZERO },
    ];
    let layer = Layer { name: "far".to_owned(), edits };
    let edited = apply_layers(&graph, &[layer], 0.5, &Anywhere).unwrap();
    let reasons: Vec<UnappliedReason> = edited.unapplied.iter().map(|unapplied| unapplied.reason).collect();
    // Edits of vertices are applied first.
    assert_eq!(
        reasons,
        [
            UnappliedReason::NoGround(outside),
            UnappliedReason::NoVertex(near),
            UnappliedReason::NoVertex(Vec3::splat(f32::MAX))
        ]
    );
    assert_eq!(edited.graph.edge_count(), 0, "the moved vertex is too far from all others");
    let forced = Layer {
        name: "forced".to_owned(),
        edits: vec![Edit::ForceEdge { from: Vec3::ZERO, to: near, seconds: Some(9.0) }],
    };
    let edited = apply_layers(&graph, &[forced], 0.5, &Anywhere).unwrap();
    assert_eq!(edited.unapplied[0].reason, UnappliedReason::TooLong(EdgeKey::new(0, 1)));
}
