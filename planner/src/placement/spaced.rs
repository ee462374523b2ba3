//! Distance-constrained random placement, the paper's best published builder (section "Distance constrained random
//! vertex placement"): a sample is kept only if no vertex is nearer than a spacing that shrinks as the map fills.

use rand::Rng;
use surefoot_world::character::MoveScratch;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{CharacterProfile, Map, Vec3};

/// Number of consecutive rejections after which the spacing shrinks (paper: 100).
const REJECTIONS: u32 = 100;
/// Factor on the spacing when it shrinks (paper: 0.98).
const DECAY: f32 = 0.98;

/// Adds vertices until there are `count`, each at least the spacing from all others.
///
/// The spacing starts at [`even_spacing`](super::even_spacing) and shrinks by 2 % after a hundred consecutive rejections.
///
/// # Errors
/// If the map has no navigable ground.
pub fn place(
    map: &Map,
    profile: &CharacterProfile,
    mut vertices: Vec<Vec3>,
    count: usize,
    rng: &mut impl Rng,
) -> Result<Vec<Vec3>, NoGround> {
    let mut spacing = super::even_spacing(map, count);
    let mut scratch = MoveScratch::default();
    let mut rejections = 0;
    while vertices.len() < count {
        let is_free = |point: Vec3| vertices.iter().all(|vertex| vertex.distance_squared(point) >= spacing * spacing);
        if let Some(point) = navigable::sample_where(map, profile, rng, &mut scratch, is_free)? {
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
