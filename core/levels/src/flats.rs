//! Measures of a level's own: the steps of its stairs and the heights of its doorways, in its unit.

use crate::inspect::weld;
use std::collections::HashMap;
use surefoot_world::{Aabb, Vec3};

/// Upright component of the normal from which a face is flat.
const FLAT: f32 = 0.99;
/// Size to which a level is brought for welding: a millimetre of it is a millionth of the level.
const WELD_SIZE: f32 = 1000.0;

/// A flat piece of surface: triangles that share corners and face the same way, up or down.
pub(super) struct Flat {
    pub(super) bounds: Aabb,
    pub(super) area: f32,
    pub(super) faces_up: bool,
}
