//! Splits polygons into triangles: into a fan where that is right, and by cutting off ears elsewhere.

use earcut::Earcut;
use glam::{DVec2, DVec3};

/// Sine of the angle up to which a corner counts as straight: smaller angles are lost when positions become `f32`.
const STRAIGHT: f64 = 1.0e-6;
/// Most work for the polygons of a level that no fan fits, in squared corners: cutting off ears may take a few seconds.
const MAX_WORK: u64 = 1_000_000_000;

/// The polygons that no fan fits have too many corners.
#[derive(Debug)]
pub(super) struct TooMuchWork;

/// Splits the polygons of one level.
pub(super) struct Splitter {
    earcut: Earcut<f64>,
    /// The polygon, seen against its normal, with its first corner at the origin.
    outline: Vec<DVec2>,
    /// Indices of the corners of triangles.
    ears: Vec<u32>,
    work_left: u64,
}

impl Splitter {
    pub(super) fn new() -> Self {
        Self { earcut: Earcut::new(), outline: Vec::new(), ears: Vec::new(), work_left: MAX_WORK }
    }

    /// Adds the triangles of a polygon, which face the same way as the polygon, to `triangles`. Holes are parts of its
    /// outline that bridges join to the rest. A polygon of n corners has at most n - 2 triangles.
    pub(super) fn split(&mut self, polygon: &[DVec3], triangles: &mut Vec<[DVec3; 3]>) -> Result<(), TooMuchWork> {
        let [first, others @ ..] = polygon else { return Ok(()) };
        if others.len() > 2 && self.flatten(polygon) && !fan_fits(&self.outline) {
            let work = (polygon.len() as u64).pow(2);
            self.work_left = self.work_left.checked_sub(work).ok_or(TooMuchWork)?;
            self.earcut.earcut(self.outline.iter().map(DVec2::to_array), &[], &mut self.ears);
            if !self.ears.is_empty() {
                let (ears, _) = self.ears.as_chunks::<3>();
                triangles.extend(ears.iter().map(|ear| self.facing(*ear).map(|corner| polygon[corner])));
                return Ok(());
            }
        }
        triangles.extend(others.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        Ok(())
    }

    /// Makes `outline` the projection of a polygon along its normal. Returns false if it has no area, or too large a
    /// one for floating-point numbers.
    fn flatten(&mut self, polygon: &[DVec3]) -> bool {
        // The sum of cross products of successive corners is the normal, with the length of twice the area (Newell).
        // Edges at the first corner add nothing, as all corners are taken relative to it.
        let relative = |corner: DVec3| corner - polygon[0];
        let double_area: DVec3 = polygon.windows(2).map(|edge| relative(edge[0]).cross(relative(edge[1]))).sum();
        let Some(normal) = double_area.try_normalize() else { return false };
        let right = normal.any_orthonormal_vector();
        let up = normal.cross(right);
        self.outline.clear();
        self.outline.extend(polygon.iter().map(|corner| {
            let corner = relative(*corner);
            DVec2::new(corner.dot(right), corner.dot(up))
        }));
        true
    }

    /// The corners of a triangle of the outline, counter-clockwise.
    fn facing(&self, ear: [u32; 3]) -> [usize; 3] {
        let [a, b, c] = ear.map(|corner| corner as usize);
        let at = |corner: usize| self.outline[corner] - self.outline[a];
        if at(b).perp_dot(at(c)) < 0.0 { [a, c, b] } else { [a, b, c] }
    }
}

/// Whether the fan from the first corner, which is the origin, covers an outline exactly: seen from there, the outline
/// always runs to the left, and less than once around.
fn fan_fits(outline: &[DVec2]) -> bool {
    let spokes = &outline[1..];
    let mut is_past_half = false;
    spokes.windows(2).all(|pair| {
        let (step, turn) = (sine(pair[0], pair[1]), sine(spokes[0], pair[1]));
        let is_around = is_past_half && turn > -STRAIGHT;
        is_past_half |= turn < -STRAIGHT;
        let is_left = step > STRAIGHT || (step >= -STRAIGHT && pair[0].dot(pair[1]) > 0.0);
        is_left && !is_around
    })
}

/// Sine of the angle between two vectors; not a number if one of them is zero.
fn sine(from: DVec2, to: DVec2) -> f64 {
    from.perp_dot(to) / (from.length() * to.length())
}
