//! Finds the pools and devices near a place, with one lookup per body and tick.

use super::features::{DISC_RADIUS_M, Placed};
use crate::Vec3;
use crate::cells::{CellLists, Cells};
use std::iter;

/// Side of a cell, m.
pub const CELL_M: f32 = 5.0;

/// A pool or device, by its index among those of its kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zone {
    /// A pool.
    Pool(u32),
    /// A jump pad.
    Pad(u32),
    /// The station of a zip line.
    ZipLine(u32),
    /// Entrance of a teleporter.
    Teleporter(u32),
    /// Far end of a two-way teleporter.
    TeleporterBack(u32),
    /// A jetpack pick-up.
    Jetpack(u32),
}

/// Zones by the cells that they touch.
#[derive(Debug)]
pub(super) struct ZoneGrid(CellLists<Zone>);

impl ZoneGrid {
    pub(super) fn new(extent: Vec3, placed: &Placed) -> Self {
        let within = |zone: Zone, centre: Vec3, (half_x, half_z): (f32, f32)| {
            let half = Vec3::new(half_x, 0.0, half_z);
            ((centre - half, centre + half), zone)
        };
        let disc = |zone: Zone, centre: Vec3| within(zone, centre, (DISC_RADIUS_M, DISC_RADIUS_M));
        let pools = (0..).zip(&placed.pools);
        let pools = pools.map(|(idx, pool)| within(Zone::Pool(idx), pool.centre, pool.outline.half_extents()));
        let pads = (0..).zip(&placed.pads).map(|(idx, pad)| disc(Zone::Pad(idx), pad.centre));
        let lines = (0..).zip(&placed.zip_lines).map(|(idx, line)| disc(Zone::ZipLine(idx), line.from));
        let teleporters = (0..).zip(&placed.teleporters).flat_map(|(idx, teleporter)| {
            let back = teleporter.two_way.then(|| disc(Zone::TeleporterBack(idx), teleporter.to));
            iter::once(disc(Zone::Teleporter(idx), teleporter.from)).chain(back)
        });
        let jetpacks = (0..).zip(&placed.jetpacks).map(|(idx, jetpack)| disc(Zone::Jetpack(idx), jetpack.centre));
        let zones = pools.chain(pads).chain(lines).chain(teleporters).chain(jetpacks);
        Self(CellLists::new(Cells::over(Vec3::ZERO, extent, CELL_M), zones))
    }

    /// All zones that may contain a point; none beyond the last column and row.
    pub(super) fn near(&self, point: Vec3) -> &[Zone] {
        let [columns, rows] = self.0.cells().counts();
        let is_beyond = point.x / CELL_M >= columns as f32 || point.z / CELL_M >= rows as f32;
        if is_beyond { &[] } else { self.0.at(point) }
    }
}
