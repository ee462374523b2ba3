//! The upright faces of a mesh that bodies climb, and the spots at their feet.

use super::triangle::{Surface, Triangle};
use crate::Vec3;
use std::collections::BTreeMap;

/// Flattest face, as the upright component of its normal.
const FLATTEST: f32 = 0.5;
/// Faces whose normals and planes differ by less than this are one: as parts of a unit vector, and in metres.
const SAME_NORMAL: f32 = 0.1;
const SAME_PLANE_M: f32 = 0.1;
/// Narrowest face that is climbed, and the distance between two spots on a wide one, m.
const NARROWEST_M: f32 = 0.2;
const SPACING_M: f32 = 2.0;
/// Least height of a face that is climbed, m: jumps and steps do what is lower.
const LEAST_M: f32 = 1.0;

/// A place on the lower edge of a face that bodies climb.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClimbSpot {
    /// The place, m.
    pub at: Vec3,
    /// Horizontal unit vector away from the face.
    pub out: Vec3,
    /// Height of the face, m.
    pub height: f32,
}

/// An upright face.
#[derive(Debug)]
struct Face {
    out: Vec3,
    corners: Vec<Vec3>,
}

/// The spots at the upright faces that bodies climb, in a fixed order.
pub(super) fn spots<'a>(triangles: impl IntoIterator<Item = &'a Triangle>) -> Vec<ClimbSpot> {
    let mut faces: BTreeMap<[i32; 3], Face> = BTreeMap::new();
    let climbed = triangles.into_iter().filter(|triangle| triangle.surface() == Surface::Climb);
    for triangle in climbed.filter(|triangle| triangle.normal().y.abs() <= FLATTEST) {
        let out = triangle.normal().with_y(0.0).normalize_or_zero();
        let parts = [out.x / SAME_NORMAL, out.z / SAME_NORMAL, triangle.corners()[0].dot(out) / SAME_PLANE_M];
        let face = faces.entry(parts.map(|part| part.round() as i32)).or_insert(Face { out, corners: Vec::new() });
        face.corners.extend(triangle.corners());
    }
    faces.into_values().flat_map(|face| face.spots()).collect()
}

impl Face {
    /// Spots along the lower edge, in its middle if it is narrow.
    fn spots(&self) -> Vec<ClimbSpot> {
        let Self { out, corners } = self;
        let along = Vec3::new(-out.z, 0.0, out.x);
        let range = |part: &dyn Fn(&Vec3) -> f32| {
            let values = corners.iter().map(part);
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), it| (low.min(it), high.max(it)))
        };
        let (left, right) = range(&|it| it.dot(along));
        let (low, high) = range(&|it| it.y);
        let depth = range(&|it| it.dot(*out)).1;
        if right - left < NARROWEST_M || high - low < LEAST_M {
            return Vec::new();
        }
        let count = ((right - left) / SPACING_M).floor().max(1.0);
        let at = |idx: u32| left + (right - left) * (idx as f32 + 0.5) / count;
        let place = |idx: u32| along * at(idx) + *out * depth + Vec3::Y * low;
        (0..count as u32).map(|idx| ClimbSpot { at: place(idx), out: *out, height: high - low }).collect()
    }
}
