//! Casts rays through the grid, skipping empty space.

use super::grid::{CELL_M, EMPTY, Grid, Occupied};
use super::triangle::Surface;
use crate::Vec3;

/// Slack around the stretch of a ray inside one cell, m.
const STRETCH_SLACK_M: f32 = 1.0e-3;

/// The hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance along the ray, m.
    pub distance: f32,
    /// Index of the triangle that was hit.
    pub triangle_idx: u32,
    /// Surface of that triangle.
    pub surface: Surface,
}

impl Grid {
    /// Finds the first triangle along the ray within `max_distance` metres; `direction` must have unit length.
    pub fn cast_ray(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<RayHit> {
        let mut travelled = self.enter(origin, direction)?;
        let inverse = Vec3::new(1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z);
        let step = [direction.x, direction.y, direction.z].map(|d| if d > 0.0 { 1 } else { -1 });
        // Along an axis where its coordinate increases, the ray leaves a cell through the upper border.
        let upper = step.map(|step| (step + 1) / 2);
        let entry = self.cell_of(origin + direction * travelled);
        let mut cell = [0, 1, 2].map(|axis| entry[axis].clamp(0, self.counts[axis] - 1));
        while travelled <= max_distance {
            if (0..3).any(|axis| cell[axis] as u32 >= self.counts[axis] as u32) {
                return None;
            }
            let entry = self.cells[self.cell_idx(cell)];
            // Leave this cell, or the empty block of cells around it.
            let margin = if entry & EMPTY == 0 { 0 } else { (entry & !EMPTY) as i32 - 1 };
            let exit = |axis: usize, o: f32, inverse: f32| {
                let border = (cell[axis] + upper[axis] + step[axis] * margin) as f32 * CELL_M;
                if inverse.is_finite() { (border - o) * inverse } else { f32::INFINITY }
            };
            let exits = [exit(0, origin.x, inverse.x), exit(1, origin.y, inverse.y), exit(2, origin.z, inverse.z)];
            let axis = if exits[0] <= exits[1] && exits[0] <= exits[2] {
                0
            } else if exits[1] <= exits[2] {
                1
            } else {
                2
            };
            let leave = exits[axis].max(travelled);
            if entry & EMPTY == 0
                && let Some(hit) = self.cast_in_cell(
                    entry as usize,
                    (origin, direction),
                    ((travelled - STRETCH_SLACK_M).max(0.0), (leave + STRETCH_SLACK_M).min(max_distance)),
                )
            {
                return Some(hit);
            }
            travelled = leave;
            if margin > 0 {
                let moved = self.cell_of(origin + direction * travelled);
                for other in 0..3 {
                    if other != axis {
                        cell[other] = moved[other].clamp(cell[other] - margin, cell[other] + margin);
                    }
                }
            }
            cell[axis] += step[axis] * (1 + margin);
        }
        None
    }

    /// Finds the first triangle of one cell on a stretch of a ray. The hit may be slightly outside the cell.
    #[inline]
    fn cast_in_cell(
        &self,
        occupied_idx: usize,
        (origin, direction): (Vec3, Vec3),
        (near, far): (f32, f32),
    ) -> Option<RayHit> {
        let (y0, y1) = (origin.y + direction.y * near, origin.y + direction.y * far);
        let Occupied { lowest, highest, .. } = self.occupied[occupied_idx];
        if y0.max(y1) < lowest - STRETCH_SLACK_M || y0.min(y1) > highest + STRETCH_SLACK_M {
            return None;
        }
        let mut best: Option<RayHit> = None;
        for &triangle_idx in self.items_of(occupied_idx) {
            let triangle = &self.triangles[triangle_idx as usize];
            let far = best.map_or(far, |hit| hit.distance);
            if let Some(distance) = triangle.ray(origin, direction, near, far) {
                best = Some(RayHit { distance, triangle_idx, surface: triangle.surface() });
            }
        }
        best
    }

    /// Distance along the ray at which it enters the grid's box, m; `None` if it misses the box.
    fn enter(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let size = Vec3::new(self.counts[0] as f32, self.counts[1] as f32, self.counts[2] as f32) * CELL_M;
        if origin.cmpge(Vec3::ZERO).all() && origin.cmple(size).all() {
            return Some(0.0);
        }
        stretch_within(origin, direction, f32::INFINITY, (Vec3::ZERO, size)).map(|(near, _)| near)
    }
}

/// Distances up to `most` at which a ray enters and leaves a box, m; `None` if it misses the box.
pub(super) fn stretch_within(
    origin: Vec3,
    direction: Vec3,
    most: f32,
    (low, high): (Vec3, Vec3),
) -> Option<(f32, f32)> {
    let (mut near, mut far) = (0.0f32, most);
    for axis in 0..3 {
        let (o, d) = (origin[axis], direction[axis]);
        if d == 0.0 {
            if o < low[axis] || o > high[axis] {
                return None;
            }
            continue;
        }
        let (t0, t1) = ((low[axis] - o) / d, (high[axis] - o) / d);
        near = near.max(t0.min(t1));
        far = far.min(t0.max(t1));
    }
    (near <= far).then_some((near, far))
}
