//! Inspects the geometry of a level for irregular edges.

use std::collections::HashMap;
use surefoot_world::Vec3;

/// Side of a cube whose corners are welded into one vertex, m.
const WELD_M: f32 = 0.001;

/// The cube of a corner; corners in the same cube are one vertex.
pub(super) fn cube(corner: Vec3) -> [i32; 3] {
    (corner / WELD_M).round().to_array().map(|value| value as i32)
}

/// The number of the welded vertex at each corner.
pub(super) fn weld(triangles: &[[Vec3; 3]]) -> Vec<[u32; 3]> {
    let mut numbers: HashMap<[i32; 3], u32> = HashMap::with_capacity(triangles.len());
    let mut number = |corner: Vec3| {
        let next = numbers.len() as u32;
        *numbers.entry(cube(corner)).or_insert(next)
    };
    triangles.iter().map(|corners| corners.map(&mut number)).collect()
}

/// Counts of irregular edges: a regular edge is shared by exactly two triangles that face the same way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct EdgeCounts {
    /// Edges of one triangle.
    pub(super) open: usize,
    /// Edges of three or more triangles (non-manifold).
    pub(super) crowded: usize,
    /// Edges of two triangles that face opposite ways.
    pub(super) turned: usize,
}

/// Welds the corners and counts the edges.
pub(super) fn edges(triangles: &[[Vec3; 3]]) -> EdgeCounts {
    // Each edge is packed as its lower vertex, its higher vertex, and whether it runs from low to high.
    let mut edges: Vec<u64> = Vec::with_capacity(triangles.len() * 3);
    for corners in weld(triangles) {
        let corners = corners.map(u64::from);
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (corners[from], corners[to]);
            if from != to {
                edges.push(from.min(to) << 33 | from.max(to) << 1 | u64::from(from < to));
            }
        }
    }
    edges.sort_unstable();
    let mut counts = EdgeCounts::default();
    for shared in edges.chunk_by(|a, b| a >> 1 == b >> 1) {
        match shared {
            [_] => counts.open += 1,
            [one, other] => counts.turned += usize::from(one == other),
            _ => counts.crowded += 1,
        }
    }
    counts
}
