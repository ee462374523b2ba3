//! Finds the pools and devices near a place, with one lookup per body and tick.

use super::device::Device;
use super::features::{DISC_RADIUS_M, Placed};
use crate::Vec3;
use crate::cells::{CellLists, Cells};

/// Side of a cell of the index, m.
pub const CELL_M: f32 = 5.0;

/// Pools and entrances of devices, by cell.
#[derive(Debug)]
pub(super) struct Zones {
    /// Indices of pools.
    pub(super) pools: CellLists<u32>,
    pub(super) entrances: CellLists<Device>,
    /// Ways of spots by where they begin, with the indices of the spots.
    pub(super) ways: CellLists<(u32, [Vec3; 2])>,
}

impl Zones {
    pub(super) fn new(extent: Vec3, placed: &Placed) -> Self {
        let cells = Cells::over(Vec3::ZERO, extent, CELL_M);
        let around = |centre: Vec3, (half_x, half_z): (f32, f32)| {
            let half = Vec3::new(half_x, 0.0, half_z);
            (centre - half, centre + half)
        };
        let pools = placed.pools.iter().map(|pool| around(pool.centre, pool.outline.half_extents())).zip(0..);
        let entrances = placed.devices().flat_map(Device::entrances);
        let entrances = entrances.map(|it| (around(it.from, (DISC_RADIUS_M, DISC_RADIUS_M)), it));
        let ways = (0..).zip(&placed.spots).flat_map(|(idx, spot)| spot.ways().map(move |way| (idx, way)));
        let ways = ways.map(|it| (around(it.1[0], (DISC_RADIUS_M, DISC_RADIUS_M)), it));
        Self {
            pools: CellLists::new(cells, pools),
            entrances: CellLists::new(cells, entrances),
            ways: CellLists::new(cells, ways),
        }
    }
}
