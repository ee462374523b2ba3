//! What a follower asks about the ground of its map.

use surefoot_world::arrival::Rims;
use surefoot_world::crossings::Approach;
use surefoot_world::{Ability, Vec3};

/// The ground between two places, as far as it matters to a body that walks there straight.
pub trait Ground {
    /// Whether a body could walk straight from one place to another, m.
    fn is_walk(&self, from: Vec3, to: Vec3) -> bool;
    /// Whether it could do so with room on both sides, and with `margin` metres more except near the ends, and may
    /// leave the legs of its plan for that.
    fn is_lane(&self, from: Vec3, to: Vec3, margin: f32) -> bool;
    /// Whether it could do so, and may leave the legs of its plan for that.
    fn is_way(&self, from: Vec3, to: Vec3) -> bool;
    /// Whether something solid rises by half of the body's height above two places, m, between them.
    fn is_walled(&self, from: Vec3, to: Vec3) -> bool;
    /// The corners of a short walk around what bars the straight way, m, and its end.
    fn walk_around(&self, from: Vec3, to: Vec3) -> Option<Vec<Vec3>>;
    /// The rims of the only gap, or ledge, on the straight way from one place to another, m.
    fn rims(&self, from: Vec3, to: Vec3) -> Option<Rims>;
    /// The crossing by which the body gets from one place to another, m.
    fn approach(&self, ends: [Vec3; 2], by: Ability) -> Option<Approach>;
    /// The place near `at`, m, where it has `margin` metres of room besides its radius, or as much as there is.
    fn with_room(&self, at: Vec3, margin: f32) -> Vec3;
}
