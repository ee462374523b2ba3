//! Distance-constrained random placement, the paper's best published builder (section "Distance constrained random
//! vertex placement"): a sample is kept only if no vertex is nearer than a spacing that shrinks as the map fills.

use super::PlacementContext;
use crate::grid::GrowingGrid;
use crate::settings::BuildError;
use rand::Rng;
use surefoot_world::character::MoveScratch;
use surefoot_world::{Vec3, navigable};

/// Number of consecutive rejections after which the spacing shrinks (paper: 100).
const REJECTIONS: u32 = 100;
/// Factor on the spacing when it shrinks (paper: 0.98).
const DECAY: f32 = 0.98;
/// Least spacing, m: an NPC has passed a vertex within 1 m, so nearer ones say the same twice.
const LEAST_SPACING_M: f32 = 1.0;
/// Vertices that are placed however near they are.
const LEAST_COUNT: usize = 2;

/// Adds vertices until there are as many as the settings ask for, each at least the spacing from all others, or until
/// there is no room for more.
///
/// The spacing starts at [`even_spacing`](super::even_spacing) and shrinks by 2 % after a hundred consecutive
/// rejections, down to [`LEAST_SPACING_M`].
pub fn place(placing: &PlacementContext<'_>, vertices: Vec<Vec3>, rng: &mut impl Rng) -> Result<Vec<Vec3>, BuildError> {
    let (map, count) = (&placing.site.map, placing.settings.vertices);
    let mut spacing = super::even_spacing(map, count).max(LEAST_SPACING_M);
    let mut placed = GrowingGrid::new(map.extent(), spacing, &vertices);
    let mut scratch = MoveScratch::default();
    let mut rejections = 0;
    while placed.points().len() < count {
        placing.check_cancelled()?;
        let is_free = |point: Vec3| {
            let mut near = placed.within(point, spacing);
            near.all(|(_, vertex)| vertex.distance_squared(point) >= spacing * spacing)
        };
        if let Some(point) = navigable::sample_where(map, &placing.site.profile, rng, &mut scratch, is_free)? {
            placed.push(point);
            rejections = 0;
            continue;
        }
        rejections += 1;
        if rejections == REJECTIONS {
            spacing *= DECAY;
            rejections = 0;
            if spacing < LEAST_SPACING_M && placed.points().len() >= LEAST_COUNT {
                break;
            }
        }
    }
    Ok(placed.points().to_vec())
}
