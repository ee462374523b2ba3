//! Random placement, the paper's first builder: uniform samples of navigable ground (section "Unconstrained random
//! vertex placement").

use super::PlacementContext;
use crate::settings::BuildError;
use rand::Rng;
use surefoot_world::Vec3;

/// Draws as many samples of navigable ground as the settings ask for.
///
/// # Errors
/// If the map has no navigable ground, or the build was cancelled.
pub fn place(placing: &PlacementContext<'_>, rng: &mut impl Rng) -> Result<Vec<Vec3>, BuildError> {
    placing.sample(placing.settings.vertices, rng)
}
