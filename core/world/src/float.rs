//! Functions of floating-point numbers whose bits are the same on every platform.
//!
//! The standard library delegates `hypot`, `sin`, `exp` and similar functions to the platform, and platforms differ in the last
//! bit. The simulation and the planner must not: they use this module and `libm`, and `clippy.toml` forbids the standard ones.

use crate::Vec3;

/// A point turned about the upright axis through the origin, counter-clockwise seen from above, by the angle of this sine and cosine.
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
