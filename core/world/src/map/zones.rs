//! Finds the pools and devices near a place, with one lookup per body and tick.

use super::features::{DISC_RADIUS_M, Placed};
use crate::Vec3;

/// Side of a cell of the grid, m.
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

/// Zones in a horizontal grid over the map.
#[derive(Debug)]
pub(super) struct ZoneGrid {
    columns: usize,
    rows: usize,
    starts: Vec<u32>,
    zones: Vec<Zone>,
}

impl ZoneGrid {
    pub(super) fn new(extent: Vec3, placed: &Placed) -> Self {
        let (columns, rows) = ((extent.x / CELL_M) as usize + 1, (extent.z / CELL_M) as usize + 1);
        let mut cells: Vec<Vec<Zone>> = vec![Vec::new(); columns * rows];
        let mut put = |zone: Zone, centre: Vec3, half_x: f32, half_z: f32| {
            let cell = |value: f32, count: usize| ((value / CELL_M).max(0.0) as usize).min(count - 1);
            for row in cell(centre.z - half_z, rows)..=cell(centre.z + half_z, rows) {
                for column in cell(centre.x - half_x, columns)..=cell(centre.x + half_x, columns) {
                    cells[row * columns + column].push(zone);
                }
            }
        };
        for (idx, pool) in (0..).zip(&placed.pools) {
            let (half_x, half_z) = pool.outline.half_extents();
            put(Zone::Pool(idx), pool.centre, half_x, half_z);
        }
        let mut disc = |zone: Zone, centre: Vec3| put(zone, centre, DISC_RADIUS_M, DISC_RADIUS_M);
        for (idx, pad) in (0..).zip(&placed.pads) {
            disc(Zone::Pad(idx), pad.centre);
        }
        for (idx, line) in (0..).zip(&placed.zip_lines) {
            disc(Zone::ZipLine(idx), line.from);
        }
        for (idx, teleporter) in (0..).zip(&placed.teleporters) {
            disc(Zone::Teleporter(idx), teleporter.from);
            if teleporter.two_way {
                disc(Zone::TeleporterBack(idx), teleporter.to);
            }
        }
        for (idx, jetpack) in (0..).zip(&placed.jetpacks) {
            disc(Zone::Jetpack(idx), jetpack.centre);
        }
        let mut starts = vec![0];
        let mut zones = Vec::new();
        for cell in cells {
            zones.extend(cell);
            starts.push(zones.len() as u32);
        }
        Self { columns, rows, starts, zones }
    }

    /// All zones that may contain a point with these horizontal coordinates, m.
    pub(super) fn near(&self, x: f32, z: f32) -> &[Zone] {
        let (column, row) = ((x / CELL_M) as usize, (z / CELL_M) as usize);
        if column >= self.columns || row >= self.rows {
            return &[];
        }
        let cell = row * self.columns + column;
        &self.zones[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}
