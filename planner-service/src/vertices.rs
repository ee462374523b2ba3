//! Where vertices go: the paper's two published placements.

use rand::Rng;
use surefoot_world::character::MoveScratch;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{CharacterProfile, Map, Vec3};

/// Rejections after which the spacing shrinks (paper: 100).
const REJECTIONS: u32 = 100;
/// Factor by which it shrinks (paper: 0.98).
const DECAY: f32 = 0.98;

/// Unconstrained random placement: `count` samples of navigable ground.
///
/// # Errors
/// If the map has no ground to stand on.
pub fn random(map: &Map, profile: &CharacterProfile, count: usize, rng: &mut impl Rng) -> Result<Vec<Vec3>, NoGround> {
    navigable::sample_many(map, profile, count, rng)
}

/// Distance-constrained random placement: a sample is kept only if no vertex is nearer than the spacing.
///
/// The spacing starts at that of `count` points spread evenly on a plane of the map's area and shrinks by
/// 2 % after every hundred rejections.
///
/// # Errors
/// If the map has no ground to stand on.
pub fn spaced(map: &Map, profile: &CharacterProfile, count: usize, rng: &mut impl Rng) -> Result<Vec<Vec3>, NoGround> {
    let extent = map.extent();
    let mut spacing = (extent.x * extent.z / count as f32).sqrt();
    let mut scratch = MoveScratch::default();
    let mut vertices: Vec<Vec3> = Vec::with_capacity(count);
    let mut rejections = 0;
    while vertices.len() < count {
        let point = navigable::sample(map, profile, rng, &mut scratch)?;
        if vertices.iter().all(|vertex| vertex.distance_squared(point) >= spacing * spacing) {
            vertices.push(point);
            rejections = 0;
            continue;
        }
        rejections += 1;
        if rejections == REJECTIONS {
            spacing *= DECAY;
            rejections = 0;
        }
    }
    Ok(vertices)
}
