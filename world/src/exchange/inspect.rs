//! Inspects the geometry of a level for open edges and surfaces that face the wrong way.

use crate::Vec3;
use crate::map::Map;
use crate::mesh::{Surface, Triangle};
use std::collections::HashMap;

/// Side of a cube whose corners are welded into one vertex, m.
const WELD_M: f32 = 0.001;
/// Rays from above along each side of a map.
const RAYS_PER_SIDE: usize = 64;

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
pub(super) fn edges(triangles: &[Triangle]) -> EdgeCounts {
    let mut numbers: HashMap<[i32; 3], u64> = HashMap::with_capacity(triangles.len());
    // Each edge is packed as its lower vertex, its higher vertex, and whether it runs from low to high.
    let mut edges: Vec<u64> = Vec::with_capacity(triangles.len() * 3);
    for triangle in triangles {
        let corners = triangle.corners().map(|corner| {
            let cube = (corner / WELD_M).round().to_array().map(|value| value as i32);
            let next = numbers.len() as u64;
            *numbers.entry(cube).or_insert(next)
        });
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

/// Share of the solid ground visible from above that faces down, in [0, 1].
pub(super) fn share_facing_down(map: &Map) -> f64 {
    let extent = map.extent();
    let (mut down_count, mut seen_count) = (0, 0);
    let along = |i: usize, side: f32| (i as f32 + 0.5) / RAYS_PER_SIDE as f32 * side;
    for i in 0..RAYS_PER_SIDE * RAYS_PER_SIDE {
        let (x, z) = (along(i / RAYS_PER_SIDE, extent.x), along(i % RAYS_PER_SIDE, extent.z));
        let hit = map.mesh().cast_ray(Vec3::new(x, extent.y, z), Vec3::NEG_Y, extent.y);
        if let Some(hit) = hit.filter(|hit| hit.surface == Surface::Ground) {
            seen_count += 1;
            down_count += usize::from(map.mesh().triangles()[hit.triangle_idx as usize].normal().y < 0.0);
        }
    }
    if seen_count == 0 { 0.0 } else { down_count as f64 / seen_count as f64 }
}
