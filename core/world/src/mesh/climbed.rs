//! The upright faces of a mesh along which bodies climb and run, and the spots at the feet of those that they climb.

use super::triangle::{Surface, Triangle};
use crate::Vec3;
use std::collections::BTreeMap;

/// Flattest face, as the upright component of its normal.
const FLATTEST: f32 = 0.5;
/// Faces whose normals and planes differ by less than this are one: as parts of a unit vector, and in metres.
const SAME_NORMAL: f32 = 0.1;
const SAME_PLANE_M: f32 = 0.1;
/// Distance at which two faces touch, m.
const TOUCHING_M: f32 = 0.05;
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallFace {
    /// Horizontal unit vector away from the face.
    pub out: Vec3,
    /// Height of its lower edge, m.
    pub low: f32,
    /// Height of the face, m.
    pub height: f32,
    /// Range along the face, and distance of its plane from the origin, m.
    along: [f32; 2],
    depth: f32,
    /// Area of its triangles, m2.
    area: f32,
}

/// The spots at the upright faces that bodies climb, in a fixed order.
pub(super) fn spots<'a>(triangles: impl IntoIterator<Item = &'a Triangle>) -> Vec<ClimbSpot> {
    let climbed = triangles.into_iter().filter(|triangle| triangle.surface() == Surface::Climb);
    faces(climbed).filter(|face| face.height >= LEAST_M).flat_map(|face| face.spots()).collect()
}

/// The upright faces of triangles, in a fixed order. Triangles of one face lie in one plane and touch.
pub(super) fn faces<'a>(triangles: impl IntoIterator<Item = &'a Triangle>) -> impl Iterator<Item = WallFace> {
    let mut planes: BTreeMap<[i32; 3], Vec<WallFace>> = BTreeMap::new();
    for triangle in triangles.into_iter().filter(|triangle| WallFace::is_upright(triangle.normal())) {
        let out = triangle.normal().with_y(0.0).normalize_or_zero();
        let parts = [out.x / SAME_NORMAL, out.z / SAME_NORMAL, triangle.corners()[0].dot(out) / SAME_PLANE_M];
        let plane = planes.entry(parts.map(|part| part.round() as i32)).or_default();
        let out = plane.first().map_or(out, |face| face.out);
        plane.push(WallFace::around(out, &triangle.corners(), triangle.area()));
    }
    planes.into_values().flat_map(joined)
}

/// Joins the faces of a plane that touch, from left to right.
fn joined(mut faces: Vec<WallFace>) -> Vec<WallFace> {
    loop {
        let count = faces.len();
        faces.sort_by(|one, other| one.along[0].total_cmp(&other.along[0]).then(one.low.total_cmp(&other.low)));
        let mut left: Vec<WallFace> = Vec::new();
        for face in std::mem::take(&mut faces) {
            match left.iter_mut().rev().find(|other| other.touches(&face)) {
                Some(other) => *other = other.with(&face),
                None => left.push(face),
            }
        }
        faces = left;
        if faces.len() == count {
            return faces;
        }
    }
}

impl WallFace {
    /// Whether a face with this normal is upright.
    pub fn is_upright(normal: Vec3) -> bool {
        normal.y.abs() <= FLATTEST
    }

    fn around(out: Vec3, corners: &[Vec3], area: f32) -> Self {
        let range = |part: &dyn Fn(&Vec3) -> f32| {
            let values = corners.iter().map(part);
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), it| (low.min(it), high.max(it)))
        };
        let along = Self::along(out);
        let (left, right) = range(&|it| it.dot(along));
        let (low, high) = range(&|it| it.y);
        Self { out, low, height: high - low, along: [left, right], depth: range(&|it| it.dot(out)).1, area }
    }

    /// Whether a face of the same plane touches this one along an edge.
    fn touches(&self, other: &Self) -> bool {
        let shared = |[a, b]: [f32; 2], [c, d]: [f32; 2]| b.min(d) - a.max(c);
        let heights = |it: &Self| [it.low, it.low + it.height];
        let (across, up) = (shared(self.along, other.along), shared(heights(self), heights(other)));
        across.min(up) >= -TOUCHING_M && across.max(up) > TOUCHING_M
    }

    /// The face around both.
    fn with(&self, other: &Self) -> Self {
        let low = self.low.min(other.low);
        Self {
            low,
            height: (self.low + self.height).max(other.low + other.height) - low,
            along: [self.along[0].min(other.along[0]), self.along[1].max(other.along[1])],
            depth: self.depth.max(other.depth),
            area: self.area + other.area,
            ..*self
        }
    }

    fn along(out: Vec3) -> Vec3 {
        Vec3::new(-out.z, 0.0, out.x)
    }

    /// Length along the face, m.
    pub fn length(&self) -> f32 {
        self.along[1] - self.along[0]
    }

    /// Share of its rectangle that its triangles cover: the rest is gaps.
    pub fn density(&self) -> f32 {
        self.area / (self.length() * self.height)
    }

    /// Both ends of its lower edge, m.
    pub fn ends(&self) -> [Vec3; 2] {
        self.along.map(|along| self.at(along))
    }

    fn at(&self, along: f32) -> Vec3 {
        Self::along(self.out) * along + self.out * self.depth + Vec3::Y * self.low
    }

    /// Spots along the lower edge, in its middle if it is narrow.
    fn spots(self) -> impl Iterator<Item = ClimbSpot> {
        let length = self.length();
        let count = if length < NARROWEST_M { 0.0 } else { (length / SPACING_M).floor().max(1.0) };
        (0..count as u32).map(move |idx| {
            let at = self.at(self.along[0] + length * (idx as f32 + 0.5) / count);
            ClimbSpot { at, out: self.out, height: self.height }
        })
    }
}
