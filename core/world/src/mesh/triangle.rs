//! One triangle: its surface, its intersection with a ray, and its contact with a capsule.

use crate::Vec3;
use strum::{IntoStaticStr, VariantArray};

/// Barycentric slack that stops rays at the seams between neighbouring triangles.
pub(super) const SEAM_SLACK: f32 = 1.0e-4;

/// Surface of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[repr(u8)]
pub enum Surface {
    /// Rock, buildings and plateaus: solid.
    Ground = 0,
    /// Surface of a water pool: stops rays, not bodies.
    Water = 1,
    /// Surface of a lava pool: stops rays, not bodies.
    Lava = 2,
    /// Disc of a jump pad: stops rays, not bodies. The position of the feet triggers the pad.
    Pad = 3,
    /// Station of a zip line; otherwise like a pad.
    ZipLine = 4,
    /// Entrance of a teleporter; otherwise like a pad.
    Teleporter = 5,
    /// Disc of a jetpack pick-up; otherwise like a pad.
    Jetpack = 6,
    /// Ladders, nets and walls that bodies climb: solid.
    Climb = 7,
}

impl Surface {
    /// All surfaces in the order of their numbers.
    pub const ALL: &[Surface] = Self::VARIANTS;

    /// Name in snake case, as in levels.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether bodies collide with the surface.
    pub fn is_solid(self) -> bool {
        matches!(self, Surface::Ground | Surface::Climb)
    }
}

/// A triangle with precomputed edges and normal.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    a: Vec3,
    ab: Vec3,
    ac: Vec3,
    normal: Vec3,
    surface: Surface,
}

impl Triangle {
    /// Creates a triangle from corners in counter-clockwise order seen from outside; `None` if it has no area.
    pub fn new([a, b, c]: [Vec3; 3], surface: Surface) -> Option<Self> {
        let (ab, ac) = (b - a, c - a);
        let cross = ab.cross(ac);
        let length = cross.length();
        (length > 1.0e-9).then(|| Self { a, ab, ac, normal: cross / length, surface })
    }

    /// The three corners, m.
    #[inline]
    pub fn corners(&self) -> [Vec3; 3] {
        [self.a, self.a + self.ab, self.a + self.ac]
    }

    /// Unit normal, pointing out of the rock.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Surface of the triangle.
    #[inline]
    pub fn surface(&self) -> Surface {
        self.surface
    }

    /// Its area, m2.
    pub fn area(&self) -> f32 {
        0.5 * self.ab.cross(self.ac).length()
    }

    /// Height of the triangle at (`x`, `z`), m; `None` if it does not cover that point.
    pub fn height_at(&self, x: f32, z: f32) -> Option<f32> {
        const HIGH: f32 = 20_000.0;
        self.ray(Vec3::new(x, HIGH, z), Vec3::NEG_Y, 0.0, 2.0 * HIGH).map(|distance| HIGH - distance)
    }

    /// Least and greatest coordinates of the corners, m.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let [a, b, c] = self.corners();
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// Whether this is part of a solid, and its bounds touch the box.
    pub(super) fn is_solid_in(&self, low: Vec3, high: Vec3) -> bool {
        let (own_low, own_high) = self.bounds();
        self.surface.is_solid() && own_low.cmple(high).all() && own_high.cmpge(low).all()
    }

    /// The rows `x, y, z, offset` that give, for a point relative to `base`, its distance from the plane and its
    /// barycentric coordinates along both edges (Baldwin and Weber, 2016).
    pub(super) fn transformation(&self, base: Vec3) -> [f32; 12] {
        let double_area = self.ab.cross(self.ac).length();
        let (u, v) = (self.ac.cross(self.normal) / double_area, self.normal.cross(self.ab) / double_area);
        let corner = self.a - base;
        let [n, u, v] = [self.normal, u, v].map(|row| [row.x, row.y, row.z, -row.dot(corner)]);
        [n[0], n[1], n[2], n[3], u[0], u[1], u[2], u[3], v[0], v[1], v[2], v[3]]
    }

    /// Distance of the two-sided intersection within `near..=far` along the ray. The plane decides most cases; the
    /// barycentric coordinates are slightly widened so that seams do not leak.
    #[inline]
    pub fn ray(&self, origin: Vec3, direction: Vec3, near: f32, far: f32) -> Option<f32> {
        let offset = origin - self.a;
        let distance = -self.normal.dot(offset) / self.normal.dot(direction);
        // Also rejects the NaN of a ray inside the plane.
        if !(distance >= near && distance <= far) {
            return None;
        }
        let point = offset + direction * distance;
        let (ab, ac) = (self.ab, self.ac);
        let (bb, bc, cc) = (ab.dot(ab), ab.dot(ac), ac.dot(ac));
        let (pb, pc) = (point.dot(ab), point.dot(ac));
        let area = bb * cc - bc * bc;
        let (b, c) = (cc * pb - bc * pc, bb * pc - bc * pb);
        let slack = -SEAM_SLACK * area;
        (b >= slack && c >= slack && b + c <= area - slack).then_some(distance)
    }

    /// Closest point of the triangle, border included, to `point`.
    fn closest_point(&self, point: Vec3) -> Vec3 {
        self.closest(point).0
    }

    /// Closest point of the triangle to `point`, and whether it is off the border (Ericson, Real-Time Collision
    /// Detection, 5.1.5).
    #[inline]
    fn closest(&self, point: Vec3) -> (Vec3, bool) {
        let (ab, ac, a) = (self.ab, self.ac, self.a);
        let ap = point - a;
        let (d1, d2) = (ab.dot(ap), ac.dot(ap));
        if d1 <= 0.0 && d2 <= 0.0 {
            return (a, false);
        }
        let bp = ap - ab;
        let (d3, d4) = (ab.dot(bp), ac.dot(bp));
        if d3 >= 0.0 && d4 <= d3 {
            return (a + ab, false);
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return (a + ab * (d1 / (d1 - d3)), false);
        }
        let cp = ap - ac;
        let (d5, d6) = (ab.dot(cp), ac.dot(cp));
        if d6 >= 0.0 && d5 <= d6 {
            return (a + ac, false);
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return (a + ac * (d2 / (d2 - d6)), false);
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            return (a + ab + (ac - ab) * t, false);
        }
        let scale = 1.0 / (va + vb + vc);
        (a + ab * (vb * scale) + ac * (vc * scale), true)
    }

    /// Penetration of an upright capsule, if any.
    ///
    /// The capsule is the vertical segment of length `height` above `low`, widened by `radius`. Contacts from behind
    /// are ignored: a body enters a solid only through a bug, and a push outwards would make that worse.
    #[inline]
    pub fn capsule_contact(&self, low: Vec3, height: f32, radius: f32) -> Option<Contact> {
        let low_side = self.normal.dot(low - self.a);
        let high_side = low_side + self.normal.y * height;
        if low_side.min(high_side) > radius || low_side.max(high_side) < 0.0 {
            return None;
        }
        if low_side.min(high_side) < 0.0 {
            // The segment crosses the plane: if it does so inside the triangle, push its buried end out.
            let t = low_side / (low_side - high_side);
            let crossing = low + Vec3::new(0.0, height * t, 0.0);
            if self.closest_point(crossing).distance_squared(crossing) < 1.0e-8 {
                let depth = radius - low_side.min(high_side);
                let Self { normal, surface, .. } = *self;
                return Some(Contact { normal, depth, point: crossing, face_normal: normal, surface });
            }
        }
        let (on_axis, on_triangle) = self.closest_to_vertical(low, height);
        let offset = on_axis - on_triangle;
        let distance_squared = offset.length_squared();
        if distance_squared >= radius * radius || offset.dot(self.normal) <= 0.0 {
            return None;
        }
        let distance = distance_squared.sqrt();
        let normal = if distance > 1.0e-5 { offset / distance } else { self.normal };
        let Self { normal: face_normal, surface, .. } = *self;
        Some(Contact { normal, depth: radius - distance, point: on_triangle, face_normal, surface })
    }

    /// Closest pair of points of the vertical segment above `low` and the triangle, if the segment does not pass
    /// through the triangle.
    #[inline]
    fn closest_to_vertical(&self, low: Vec3, height: f32) -> (Vec3, Vec3) {
        let high = low + Vec3::new(0.0, height, 0.0);
        // Nothing is closer than the plane, which is closest at the end that it faces.
        let facing = if self.normal.y >= 0.0 { low } else { high };
        let (closest, is_off_border) = self.closest(facing);
        if is_off_border && self.normal.dot(facing - self.a) >= 0.0 {
            return (facing, closest);
        }
        let mut best = (low, self.closest_point(low));
        let mut best_squared = best.0.distance_squared(best.1);
        let mut offer = |pair: (Vec3, Vec3)| {
            let squared = pair.0.distance_squared(pair.1);
            if squared < best_squared {
                (best, best_squared) = (pair, squared);
            }
        };
        offer((high, self.closest_point(high)));
        let [a, b, c] = self.corners();
        for (from, to) in [(a, b), (b, c), (c, a)] {
            offer(closest_vertical_to_edge(low, height, from, to));
        }
        best
    }
}

/// Closest pair of points of a vertical segment and an edge.
#[inline]
fn closest_vertical_to_edge(low: Vec3, height: f32, from: Vec3, to: Vec3) -> (Vec3, Vec3) {
    let edge = to - from;
    let offset = low - from;
    let horizontal_squared = edge.x * edge.x + edge.z * edge.z;
    let mut t = if horizontal_squared > 1.0e-12 {
        ((offset.x * edge.x + offset.z * edge.z) / horizontal_squared).clamp(0.0, 1.0)
    } else {
        0.5
    };
    let y_on_edge = from.y + edge.y * t;
    let y_on_axis = y_on_edge.clamp(low.y, low.y + height);
    if y_on_axis != y_on_edge || horizontal_squared <= 1.0e-12 {
        // The infinite axis is closest to the edge beyond the segment's end: use that end instead.
        let end = Vec3::new(low.x, y_on_axis, low.z);
        t = ((end - from).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let on_edge = from + edge * t;
        let y = on_edge.y.clamp(low.y, low.y + height);
        return (Vec3::new(low.x, y, low.z), on_edge);
    }
    (Vec3::new(low.x, y_on_axis, low.z), from + edge * t)
}

/// A penetration of a capsule into a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// Unit direction away from the triangle that separates the two over the shortest distance.
    pub normal: Vec3,
    /// Penetration depth, m, positive.
    pub depth: f32,
    /// The touched point on the triangle.
    pub point: Vec3,
    /// Normal of the touched triangle; differs from `normal` at its edges and corners.
    pub face_normal: Vec3,
    /// Surface of the touched triangle.
    pub surface: Surface,
}
