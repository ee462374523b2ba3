//! A graph of a hundred thousand vertices: copies of the graph of a square kilometre, with edges across the seams.

use std::collections::HashMap;
use surefoot_planner::evidence::Evidence;
use surefoot_planner::graph::{Edge, GraphData};
use surefoot_planner::{EdgeKey, NavGraph, VertexId};
use surefoot_world::{Decisions, Vec3};

/// Most edges across a seam from each vertex near it, and their greatest length, m.
const LEGS: usize = 4;
const LEG_M: f32 = 45.0;
/// Decisions of an edge across a seam: a constant, and a number for each metre.
const LEG_DECISIONS: [f64; 2] = [3.0, 0.7];

/// A grid of `side` x `side` copies of a graph whose map is `width` metres wide.
pub fn tiled(graph: &NavGraph, width: f32, side: u32) -> anyhow::Result<NavGraph> {
    let GraphData { vertices: tile, edges, legs, .. } = graph.to_data();
    let count = tile.len() as u32;
    let mut all = GraphData { legs, ..GraphData::default() };
    for idx in 0..side * side {
        let offset = Vec3::new((idx % side) as f32 * width, 0.0, (idx / side) as f32 * width);
        all.vertices.extend(tile.iter().map(|at| *at + offset));
        let first = idx * count;
        let key = |key: EdgeKey| EdgeKey::new(first + key.from.0, first + key.to.0);
        all.edges.extend(edges.iter().map(|edge| Edge { key: key(edge.key), ..*edge }));
    }
    let seams = over_seams(&all.vertices, count);
    all.edges.extend(seams);
    Ok(NavGraph::check(all)?)
}

/// Edges from each vertex to the nearest vertices of other tiles, each of which has `count` vertices.
fn over_seams(vertices: &[Vec3], count: u32) -> Vec<Edge> {
    let cell = |at: Vec3| ((at.x / LEG_M) as i32, (at.z / LEG_M) as i32);
    let mut cells: HashMap<(i32, i32), Vec<u32>> = HashMap::new();
    (0..).zip(vertices).for_each(|(vertex, &at)| cells.entry(cell(at)).or_default().push(vertex));
    let mut seams = Vec::new();
    for (from, &at) in (0..).zip(vertices) {
        let (x, z) = cell(at);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dz| (x + dx, z + dz)));
        let others = around.filter_map(|cell| cells.get(&cell)).flatten().filter(|&&to| to / count != from / count);
        let mut near: Vec<(f32, u32)> = others.map(|&to| (at.distance(vertices[to as usize]), to)).collect();
        near.retain(|(distance, _)| *distance < LEG_M);
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        seams.extend(near.into_iter().take(LEGS).map(|(distance, to)| {
            let decisions = LEG_DECISIONS[0] + LEG_DECISIONS[1] * f64::from(distance);
            let key = EdgeKey { from: VertexId(from), to: VertexId(to) };
            Edge { key, evidence: Evidence::forced(Decisions(decisions)) }
        }));
    }
    seams
}
