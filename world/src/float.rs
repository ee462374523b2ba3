//! Functions of floating-point numbers whose bits are the same on every platform.
//!
//! The standard library leaves `hypot`, `sin`, `exp` and their like to the system, and systems differ in the last bit. What the
//! simulation and the planner compute must not: they use these and `libm`, and `clippy.toml` refuses the others.

/// Length of the vector `(x, y)`, rounded correctly but for double rounding: no two floats overflow a double when squared.
#[inline]
pub fn hypot(x: f32, y: f32) -> f32 {
    let (x, y) = (f64::from(x), f64::from(y));
    (x * x + y * y).sqrt() as f32
}
