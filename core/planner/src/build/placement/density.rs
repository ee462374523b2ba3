//! Density-based placement. The paper's authors built it but do not describe it; this is our interpretation.
//!
//! A uniform sample puts few vertices where navigable ground is scarce, such as ledges, roofs and steps of a canyon,
//! yet routes depend on these places. Density-biased sampling (Palmer and Faloutsos, "Density biased sampling: an
//! improved method for data mining and clustering", SIGMOD 2000) draws from a pool with probabilities inverse to the
//! local density of the pool, which favours scarce places.

use super::{PlacementContext, even_spacing};
use crate::grid::PointGrid;
use crate::settings::BuildError;
use rand::{Rng, RngExt};
use surefoot_world::Vec3;

/// Number of points in the pool for each vertex.
const POOL: usize = 8;
/// Factor on height differences in distances, so that points on different storeys are not near each other.
const HEIGHT_WEIGHT: f32 = 3.0;

/// Draws as many points as the settings ask for without replacement from a pool of navigable samples, with
/// probabilities inverse to the number of pool points within the even spacing.
pub fn place(placing: &PlacementContext<'_>, rng: &mut impl Rng) -> Result<Vec<Vec3>, BuildError> {
    let count = placing.settings.vertices;
    let pool = placing.sample(POOL * count, rng)?;
    let reach = even_spacing(&placing.site.map, count);
    let grid = PointGrid::new(&pool, reach);
    // Exponential keys (Efraimidis and Spirakis, 2006): the smallest are a weighted sample without replacement.
    let mut keyed: Vec<(f32, Vec3)> = pool
        .iter()
        .map(|&point| {
            let crowd = grid.within(point, reach).filter(|&other| separation(point, pool[other as usize]) < reach);
            let density = crowd.count().max(1) as f32;
            (-libm::logf(1.0 - rng.random::<f32>()) * density, point)
        })
        .collect();
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(keyed.into_iter().take(count).map(|(_, point)| point).collect())
}

fn separation(a: Vec3, b: Vec3) -> f32 {
    let offset = b - a;
    Vec3::new(offset.x, HEIGHT_WEIGHT * offset.y, offset.z).length()
}
