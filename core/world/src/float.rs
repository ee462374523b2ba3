//! Functions of floating-point numbers whose bits are the same on every platform.
//!
//! The standard library delegates `hypot`, `sin`, `exp` and similar functions to the platform, and platforms differ in
//! the last bit. The simulation and the planner use this module and `libm` instead; `clippy.toml` forbids the standard
//! functions.

use crate::Vec3;
use std::f32::consts::{PI, TAU};

/// Turns a point about the y axis by the angle with this sine and cosine, counter-clockwise seen from above.
#[inline]
pub fn turned(point: Vec3, (sin, cos): (f32, f32)) -> Vec3 {
    Vec3::new(point.x * cos + point.z * sin, point.y, point.z * cos - point.x * sin)
}

/// Length of the vector `(x, y)`, computed in `f64`, where no square of an `f32` overflows, and then rounded to `f32`.
#[inline]
pub fn hypot(x: f32, y: f32) -> f32 {
    let (x, y) = (f64::from(x), f64::from(y));
    (x * x + y * y).sqrt() as f32
}

/// Horizontal length of a vector, by [`hypot`].
#[inline]
pub fn horizontal(vector: Vec3) -> f32 {
    hypot(vector.x, vector.z)
}

/// Heading of a vector, rad, in [-pi, pi]: 0 faces +z, counter-clockwise seen from above.
#[inline]
pub fn heading(vector: Vec3) -> f32 {
    libm::atan2f(vector.x, vector.z)
}

/// Where the segment from the origin to `along` is nearest to `point`, as a share of its length.
#[inline]
pub fn share_along(along: Vec3, point: Vec3) -> f32 {
    (point.dot(along) / along.length_squared().max(1.0e-9)).clamp(0.0, 1.0)
}

/// Distance of a point from the segment between two others, m.
#[inline]
pub fn distance_to_segment(point: Vec3, from: Vec3, to: Vec3) -> f32 {
    let (along, offset) = (to - from, point - from);
    offset.distance(along * share_along(along, offset))
}

/// The angle in (-pi, pi] that equals `angle`, rad, which is within two turns of it.
#[inline]
pub fn wrapped(mut angle: f32) -> f32 {
    for _ in 0..2 {
        if angle > PI {
            angle -= TAU;
        } else if angle <= -PI {
            angle += TAU;
        }
    }
    angle
}
