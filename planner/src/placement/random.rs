//! Random placement, the paper's first builder: uniform samples of navigable ground (section "Unconstrained random
//! vertex placement").

use rand::Rng;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{CharacterProfile, Map, Vec3};

/// Draws `count` samples of navigable ground.
///
/// # Errors
/// If the map has no navigable ground.
pub fn place(map: &Map, profile: &CharacterProfile, count: usize, rng: &mut impl Rng) -> Result<Vec<Vec3>, NoGround> {
    navigable::sample_many(map, profile, count, rng)
}
