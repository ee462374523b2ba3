//! The triangles that edits add to a map. They are few, and every change rebuilds their index.

use super::ray::{RayHit, stretch_within};
use super::triangle::Triangle;
use crate::cells::{CellLists, Cells};
use crate::{Aabb, Vec3};

/// Side of a cell, m.
const CELL_M: f32 = 16.0;
/// Room around the bounds of the triangles, m, so that none is on the border.
const SLACK_M: f32 = 0.01;

#[derive(Debug)]
pub(super) struct Added {
    pub triangles: Vec<Triangle>,
    /// Bounds of all triangles, slightly widened, m.
    pub low: Vec3,
    pub high: Vec3,
    /// Indices of the triangles that touch each cell, ascending.
    lists: CellLists<u32>,
}

impl Added {
    /// `None` if there is nothing.
    pub fn new(triangles: Vec<Triangle>) -> Option<Self> {
        let bounds = triangles.iter().map(|triangle| Aabb::from(triangle.bounds())).reduce(Aabb::union)?;
        let Aabb { low, high } = bounds.widened(SLACK_M);
        let cells = Cells::over(low, high, CELL_M);
        let lists = CellLists::new(cells, triangles.iter().map(Triangle::bounds).zip(0..));
        Some(Self { triangles, low, high, lists })
    }

    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.triangles.as_slice()) + self.lists.memory_bytes()
    }

    /// Finds the first triangle along the ray within `most` metres.
    pub fn cast_ray(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<RayHit> {
        let (mut at, end) = stretch_within(origin, direction, most, (self.low, self.high))?;
        let mut best: Option<RayHit> = None;
        let cells = self.lists.cells();
        let mut place = cells.place_of(origin + direction * at);
        loop {
            for &triangle_idx in self.lists.of(cells.idx(place)) {
                let triangle = &self.triangles[triangle_idx as usize];
                let far = best.map_or(most, |hit| hit.distance);
                if let Some(distance) = triangle.ray(origin, direction, 0.0, far).filter(|distance| *distance < far) {
                    best = Some(RayHit { distance, triangle_idx, surface: triangle.surface() });
                }
            }
            // Distance at which the ray leaves the cell along an axis.
            let leave = |axis: usize, number: i32| {
                let ahead = direction[axis] > 0.0;
                let border = self.low[axis] + (number + i32::from(ahead)) as f32 * CELL_M;
                if direction[axis] == 0.0 { f32::INFINITY } else { (border - origin[axis]) / direction[axis] }
            };
            let (x, z) = (leave(0, place[0]), leave(2, place[1]));
            at = x.min(z).max(at);
            if at > end.min(best.map_or(end, |hit| hit.distance)) {
                return best;
            }
            let step = |axis: usize| if direction[axis] > 0.0 { 1 } else { -1 };
            if x <= z {
                place[0] += step(0)
            } else {
                place[1] += step(2)
            }
            if !cells.contains(place) {
                return best;
            }
        }
    }

    /// Adds the indices, plus `first`, of the solid triangles whose bounds touch the box, in ascending order.
    pub fn gather_solids(&self, low: Vec3, high: Vec3, first: u32, found: &mut Vec<u32>) {
        if low.cmpgt(self.high).any() || high.cmplt(self.low).any() {
            return;
        }
        let begin = found.len();
        let cells = self.lists.cells();
        for cell in cells.in_span(cells.span(low, high)) {
            let is_met = |idx: &&u32| self.triangles[**idx as usize].is_solid_in(low, high);
            found.extend(self.lists.of(cell).iter().filter(is_met).map(|idx| first + idx));
        }
        // `found` also holds built triangles; all its indices refer to the whole mesh.
        found[begin..].sort_unstable();
        found.dedup();
    }
}
