//! Limits on maps that would take too long or too much memory to index.

use surefoot_world::map::spec::{MAX_HEIGHT_M, MAX_SIDE_M};
use surefoot_world::map::zones::CELL_M as ZONE_CELL_M;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::Triangle;

/// Most cells of the mesh's index that triangles may touch, counted by their bounding boxes: about 1 GB of index.
const MAX_TOUCHED_CELLS: f64 = 2.0e8;
/// Side of the cells counted, m: finer than the index's own, so the estimate errs high.
const INDEX_CELL_M: f32 = 1.25;
/// Most pools, devices and spots of a map together.
const MAX_FEATURES: usize = 20_000;
/// Most cells of the zone grid that pools may cover, counted once for each pool.
const MAX_POOL_CELLS: f64 = 2.0e7;

/// A map is too large to index, although each of its parts is valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Overload {
    /// Too many triangles span much of the map.
    #[error("too many of its triangles span the whole level: split them or remove what cannot be seen or touched")]
    Triangles,
    /// There are too many pools, devices and spots.
    #[error("it has {count} pools, devices and spots, but at most {MAX_FEATURES} fit")]
    Features {
        /// Number of them.
        count: usize,
    },
    /// Too many pools cover much of the map.
    #[error("too many of its pools cover the whole level: make them smaller or join them")]
    Pools,
}

/// Rejects what would take too long or too much memory to index.
pub(super) fn check_load(size: MapSize, triangles: &[Triangle], placed: &Placed) -> Result<(), Overload> {
    let extent = size.extent();
    let cells_along = |low: f32, high: f32, axis: usize, cell_m: f32| {
        let inside = high.clamp(0.0, extent[axis]) - low.clamp(0.0, extent[axis]);
        f64::from(inside.max(0.0) / cell_m) + 2.0
    };
    // Only large triangles count: the others touch a few cells each, and their number is limited.
    let large = triangles.iter().filter_map(|triangle| {
        let (low, high) = triangle.bounds();
        ((high - low).max_element() > 4.0 * INDEX_CELL_M).then_some((low, high))
    });
    let touched = large.map(|(low, high)| -> f64 {
        (0..3).map(|axis| cells_along(low[axis], high[axis], axis, INDEX_CELL_M)).product()
    });
    if touched.sum::<f64>() > MAX_TOUCHED_CELLS {
        return Err(Overload::Triangles);
    }
    let count = placed.pools.len() + placed.devices().count() + placed.spots.len();
    if count > MAX_FEATURES {
        return Err(Overload::Features { count });
    }
    let covered = placed.pools.iter().map(|pool| {
        let (half_x, half_z) = pool.outline.half_extents();
        cells_along(pool.centre.x - half_x, pool.centre.x + half_x, 0, ZONE_CELL_M)
            * cells_along(pool.centre.z - half_z, pool.centre.z + half_z, 2, ZONE_CELL_M)
    });
    if covered.sum::<f64>() > MAX_POOL_CELLS { Err(Overload::Pools) } else { Ok(()) }
}

/// Whether a map may have this size; imported levels may be smaller than generated maps.
pub(super) fn is_allowed(size: MapSize) -> bool {
    (1..=MAX_SIDE_M).contains(&size.width)
        && (1..=MAX_HEIGHT_M).contains(&size.height)
        && (1..=MAX_SIDE_M).contains(&size.depth)
}
