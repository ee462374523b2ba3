//! Triangles in upright columns over a horizontal grid: the index for cones of rays.
//!
//! The rays of one azimuth share an upright plane, so they pass the same columns in the same order. Most steps of a ray
//! read only the lowest and the highest point of a column. The triangles of a column are in blocks of eight, sorted by
//! height, in the form that the intersection needs (Baldwin and Weber, "Fast Ray-Triangle Intersections by Coordinate
//! Transformation", 2016).

use super::lanes::LANES;
use super::triangle::{Surface, Triangle};
use crate::{Aabb, Vec3};
use rayon::prelude::*;

/// Slack around columns, heights and stretches of rays, m, so that both sides of a border find a triangle on it.
pub(super) const SLACK_M: f32 = 1.0e-3;
/// Wanted number of triangles in a column that is not empty: about one block with overlapping triangles.
const TRIANGLES_PER_COLUMN: f32 = 9.0;
/// Least and greatest side of a column, m.
const MIN_SIDE_M: f32 = 0.25;
const MAX_SIDE_M: f32 = 4.0;
/// Smallest side of the cells that estimate the density of triangles, m, and their greatest number.
const DENSITY_CELL_M: f32 = 4.0;
const MAX_DENSITY_CELLS: f32 = 65_536.0;
/// Limits on columns, columns per triangle, entries of triangles in columns, and blocks (0.6 GB). Levels beyond them
/// get wider columns.
const MIN_COLUMNS: f32 = 1024.0;
const COLUMNS_PER_TRIANGLE: f32 = 4.0;
const MAX_ENTRIES: usize = 24_000_000;
const MAX_BLOCKS: usize = 1_500_000;
/// Greatest number of quanta of height.
const MAX_QUANTA: f32 = 65_000.0;
/// A block ends at a gap of this height, m, through which rays pass.
const GAP_M: f32 = 0.75;
/// Smallest vertical component of a normal for which the plane limits the height inside a column.
const MIN_UPRIGHT: f32 = 0.02;
/// Columns of a tile along x and z; together they fill a cache line.
const TILE_X: usize = 4;
const TILE_Z: usize = 2;
const TILE_LEN: usize = TILE_X * TILE_Z;
/// Rows of tiles that are sorted together when the columns are built.
const BAND_TILES: usize = 8;

/// The part of a column that each step of a ray reads.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(super) struct Column {
    /// Height of the lowest and the highest point, in quanta and rounded outwards; `low > high` if the column is empty.
    pub low: u16,
    pub high: u16,
    /// Index of the first block, and two flags.
    blocks: u32,
}

/// Flag: all triangles are [`Surface::Ground`].
const ONLY_GROUND: u32 = 1 << 31;
/// Flag: there is a single block.
const SINGLE: u32 = 1 << 30;

impl Column {
    pub const EMPTY: Self = Self { low: u16::MAX, high: 0, blocks: 0 };

    #[inline(always)]
    pub fn first_block(self) -> usize {
        (self.blocks & !(ONLY_GROUND | SINGLE)) as usize
    }

    #[inline(always)]
    pub fn is_only_ground(self) -> bool {
        self.blocks & ONLY_GROUND != 0
    }

    #[inline(always)]
    pub fn is_single(self) -> bool {
        self.blocks & SINGLE != 0
    }
}

/// Neighbouring columns in one cache line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Tile([Column; TILE_LEN]);

/// Eight triangles as the rows of their transformations: along the normal, and along both edges.
///
/// A row is `x, y, z, offset`: for a point relative to the base of its column, the first gives the distance from the
/// plane, the others the barycentric coordinates. Unused lanes are zero and never hit.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Block {
    pub rows: [[f32; LANES]; 12],
}

/// Heights of a block in quanta, for columns with several.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub low: u16,
    pub high: u16,
    /// Whether this is the last block of its column.
    pub is_last: bool,
}

/// Triangles in columns.
#[derive(Debug)]
pub(super) struct Columns {
    /// Side of a column, m.
    pub side: f32,
    /// Least x and z of the columns, m.
    pub corner: (f32, f32),
    /// Number of columns along x and z, without the empty ring around them.
    pub counts: (i32, i32),
    /// Height at which quanta begin, m.
    pub floor: f32,
    /// Height of a quantum, m, and its inverse.
    pub quantum: f32,
    pub quanta_per_m: f32,
    tiles_across: usize,
    tiles: Vec<Tile>,
    pub spans: Vec<Span>,
    pub blocks: Vec<Block>,
    pub surfaces: Vec<[Surface; LANES]>,
}

/// A triangle in one column.
#[derive(Debug, Clone, Copy)]
struct Entry {
    /// Number of the column.
    column: u32,
    triangle: u32,
    low: f32,
    high: f32,
}

/// The columns of a band of rows, whose blocks are counted from the first of the band.
#[derive(Default)]
struct Band {
    /// The triangles of each column, sorted by column and height.
    entries: Vec<Entry>,
    /// Columns that are not empty, and their numbers.
    columns: Vec<(u32, Column)>,
    spans: Vec<Span>,
    surfaces: Vec<[Surface; LANES]>,
    /// First entry and number of entries of each block.
    blocks: Vec<(u32, u8)>,
}

impl Columns {
    pub fn new(triangles: &[Triangle]) -> Self {
        let bounds = triangles.iter().map(|triangle| Aabb::from(triangle.bounds())).reduce(Aabb::union);
        let Some(bounds) = bounds else { return Self::empty(MAX_SIDE_M, Aabb::at(Vec3::ZERO)) };
        let mut side = column_side(triangles, bounds);
        loop {
            if let Some(columns) = Self::with_side(triangles, side, bounds) {
                return columns;
            }
            side *= 2.0;
        }
    }

    /// `None` if the columns would need too much memory, because many triangles span much of the level.
    fn with_side(triangles: &[Triangle], side: f32, bounds: Aabb) -> Option<Self> {
        let mut columns = Self::empty(side, bounds);
        if triangles.iter().map(|triangle| columns.most_columns(triangle)).sum::<usize>() > MAX_ENTRIES {
            return None;
        }
        let bands = columns.triangles_by_band(triangles);
        let build = |(band, indices): (usize, &Vec<u32>)| columns.build_band(triangles, indices, band);
        let bands: Vec<Band> = bands.par_iter().enumerate().map(build).collect();
        let block_count = bands.iter().map(|band| band.blocks.len()).sum();
        if block_count > MAX_BLOCKS {
            return None;
        }
        let mut blocks = vec![Block { rows: [[0.0; LANES]; 12] }; block_count];
        let mut rest = blocks.as_mut_slice();
        let mut fills: Vec<(&Band, &mut [Block])> = Vec::with_capacity(bands.len());
        for band in &bands {
            columns.append(band);
            let (own, others) = rest.split_at_mut(band.blocks.len());
            fills.push((band, own));
            rest = others;
        }
        fills.into_par_iter().for_each(|(band, blocks)| {
            band.blocks.iter().zip(blocks).for_each(|(of, block)| columns.fill(block, triangles, band, of));
        });
        columns.blocks = blocks;
        Some(columns)
    }

    /// Number of columns that the bounds of a triangle touch.
    fn most_columns(&self, triangle: &Triangle) -> usize {
        let (low, high) = triangle.bounds();
        let (x0, x1) = self.range(low.x, high.x, self.corner.0, self.counts.0);
        let (z0, z1) = self.rows(triangle);
        ((x1 - x0 + 1) * (z1 - z0 + 1)) as usize
    }

    fn empty(side: f32, bounds: Aabb) -> Self {
        let size = bounds.high - bounds.low;
        let count = |length: f32| ((length / side) as i32 + 1).max(1);
        let counts = (count(size.x), count(size.z));
        let tiles_across = (counts.0 as usize + 2).div_ceil(TILE_X);
        let tiles_down = (counts.1 as usize + 2).div_ceil(TILE_Z);
        let quantum = size.y.max(1.0) / MAX_QUANTA;
        Self {
            side,
            corner: (bounds.low.x, bounds.low.z),
            counts,
            floor: bounds.low.y,
            quantum,
            quanta_per_m: 1.0 / quantum,
            tiles_across,
            tiles: vec![Tile([Column::EMPTY; TILE_LEN]); tiles_across * tiles_down],
            spans: Vec::new(),
            blocks: Vec::new(),
            surfaces: Vec::new(),
        }
    }

    /// Memory in bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.tiles.as_slice())
            + size_of_val(self.spans.as_slice())
            + size_of_val(self.blocks.as_slice())
            + size_of_val(self.surfaces.as_slice())
    }

    /// The column at (x, z), where (0, 0) is in the ring around the columns; `None` far outside.
    #[inline(always)]
    pub fn at(&self, place: (i32, i32)) -> Option<Column> {
        let (tile, idx) = self.locate(place);
        Some(self.tiles.get(tile)?.0[idx % TILE_LEN])
    }

    /// Index of the tile that holds a column, and the column's index in it.
    #[inline(always)]
    fn locate(&self, (x, z): (i32, i32)) -> (usize, usize) {
        let tile = (z >> 1) as usize * self.tiles_across + (x >> 2) as usize;
        (tile, ((z & 1) * TILE_X as i32 + (x & 3)) as usize)
    }

    /// The point from which the triangles of a column are measured: its centre at its lowest point.
    #[inline(always)]
    pub fn base(&self, (x, z): (i32, i32), low: u16) -> Vec3 {
        Vec3::new(
            self.corner.0 + (x as f32 - 0.5) * self.side,
            self.floor + f32::from(low) * self.quantum,
            self.corner.1 + (z as f32 - 0.5) * self.side,
        )
    }

    /// Columns that a stretch along one axis touches, counted from the ring.
    fn range(&self, low: f32, high: f32, corner: f32, count: i32) -> (i32, i32) {
        let column = |value: f32| (((value - corner) / self.side).floor() as i32 + 1).clamp(1, count);
        (column(low - SLACK_M), column(high + SLACK_M))
    }

    fn rows(&self, triangle: &Triangle) -> (i32, i32) {
        let (low, high) = triangle.bounds();
        self.range(low.z, high.z, self.corner.1, self.counts.1)
    }

    /// Indices of the triangles that touch each band of rows.
    fn triangles_by_band(&self, triangles: &[Triangle]) -> Vec<Vec<u32>> {
        let rows = TILE_Z * BAND_TILES;
        let mut bands = vec![Vec::new(); (self.counts.1 as usize + 2).div_ceil(rows)];
        for (triangle, idx) in triangles.iter().zip(0..) {
            let (first, last) = self.rows(triangle);
            for band in &mut bands[first as usize / rows..=last as usize / rows] {
                band.push(idx);
            }
        }
        bands
    }

    /// The triangles of each column of a band, sorted by column and height.
    fn entries_of_band(&self, triangles: &[Triangle], indices: &[u32], band: usize) -> Vec<Entry> {
        let rows = (TILE_Z * BAND_TILES) as i32;
        let (first_row, last_row) = (band as i32 * rows, (band as i32 + 1) * rows - 1);
        let mut entries = Vec::with_capacity(2 * indices.len());
        for &idx in indices {
            self.enter(&triangles[idx as usize], (first_row, last_row), |column, low, high| {
                entries.push(Entry { column, triangle: idx, low, high });
            });
        }
        entries.sort_unstable_by(|a, b| {
            let height = (a.low + a.high).total_cmp(&(b.low + b.high));
            a.column.cmp(&b.column).then(height).then(a.triangle.cmp(&b.triangle))
        });
        entries
    }

    /// Calls `found` with each column of some rows that a triangle touches, and its lowest and highest point there, m.
    fn enter(&self, triangle: &Triangle, (first_row, last_row): (i32, i32), mut found: impl FnMut(u32, f32, f32)) {
        let (corners, normal) = (triangle.corners(), triangle.normal());
        let (low, high) = triangle.bounds();
        let (x0, x1) = self.range(low.x, high.x, self.corner.0, self.counts.0);
        let (z0, z1) = self.rows(triangle);
        let half = 0.5 * self.side + SLACK_M;
        let edges = edges_seen_from_above(corners);
        for z in z0.max(first_row)..=z1.min(last_row) {
            for x in x0..=x1 {
                let centre = self.base((x, z), 0);
                let touches = |&(nx, nz, from): &(f32, f32, Vec3)| {
                    nx * (centre.x - from.x) + nz * (centre.z - from.z) + (nx.abs() + nz.abs()) * half >= 0.0
                };
                if (x0, z0) != (x1, z1) && !edges.iter().all(touches) {
                    continue;
                }
                let (mut lowest, mut highest) = (low.y, high.y);
                if normal.y.abs() > MIN_UPRIGHT {
                    let offset = centre - corners[0];
                    let y = corners[0].y - (normal.x * offset.x + normal.z * offset.z) / normal.y;
                    let reach = (normal.x.abs() + normal.z.abs()) * half / normal.y.abs() + SLACK_M;
                    (lowest, highest) = (lowest.max(y - reach), highest.min(y + reach));
                }
                if lowest <= highest {
                    found(self.number((x, z)), lowest - SLACK_M, highest + SLACK_M);
                }
            }
        }
    }

    /// Divides the triangles of each column of a band into blocks.
    fn build_band(&self, triangles: &[Triangle], indices: &[u32], band: usize) -> Band {
        let entries = self.entries_of_band(triangles, indices, band);
        let down = |y: f32| ((y - self.floor) * self.quanta_per_m - 1.0).floor().max(0.0) as u16;
        let up = |y: f32| ((y - self.floor) * self.quanta_per_m + 1.0).ceil() as u16;
        let mut built = Band::default();
        let mut start = 0;
        for of_column in entries.chunk_by(|a, b| a.column == b.column) {
            let first_block = built.blocks.len();
            let (mut column, mut only_ground) = (Column::EMPTY, true);
            let column_end = start + of_column.len();
            while start < column_end {
                let mut span = Span { low: u16::MAX, high: 0, is_last: false };
                let mut surfaces = [Surface::Ground; LANES];
                let (mut highest, mut end) = (entries[start].high, start);
                while end < column_end && end - start < LANES && entries[end].low <= highest + GAP_M {
                    let Entry { triangle, low, high, .. } = entries[end];
                    highest = highest.max(high);
                    span = Span { low: span.low.min(down(low)), high: span.high.max(up(high)), ..span };
                    let surface = triangles[triangle as usize].surface();
                    surfaces[end - start] = surface;
                    only_ground &= surface == Surface::Ground;
                    end += 1;
                }
                (column.low, column.high) = (column.low.min(span.low), column.high.max(span.high));
                built.spans.push(Span { is_last: end == column_end, ..span });
                built.surfaces.push(surfaces);
                built.blocks.push((start as u32, (end - start) as u8));
                start = end;
            }
            let single = if built.blocks.len() - first_block == 1 { SINGLE } else { 0 };
            let ground = if only_ground { ONLY_GROUND } else { 0 };
            column.blocks = first_block as u32 | single | ground;
            built.columns.push((of_column[0].column, column));
        }
        built.entries = entries;
        built
    }

    /// Adds a band whose blocks are still to be filled.
    fn append(&mut self, band: &Band) {
        let first_block = self.spans.len() as u32;
        for &(number, column) in &band.columns {
            let column = Column { blocks: column.blocks + first_block, ..column };
            self.tiles[number as usize / TILE_LEN].0[number as usize % TILE_LEN] = column;
        }
        self.spans.extend_from_slice(&band.spans);
        self.surfaces.extend_from_slice(&band.surfaces);
    }

    /// Writes the triangles of a block.
    fn fill(&self, block: &mut Block, triangles: &[Triangle], band: &Band, &(start, len): &(u32, u8)) {
        let entries = &band.entries[start as usize..][..usize::from(len)];
        let place = self.place(entries[0].column);
        let base = self.base(place, self.at(place).expect("a column of the level").low);
        for (lane, entry) in entries.iter().enumerate() {
            for (row, value) in block.rows.iter_mut().zip(triangles[entry.triangle as usize].transformation(base)) {
                row[lane] = value;
            }
        }
    }

    /// Number of a column, tile by tile.
    fn number(&self, place: (i32, i32)) -> u32 {
        let (tile, idx) = self.locate(place);
        (tile * TILE_LEN + idx) as u32
    }

    /// The column with a number.
    fn place(&self, number: u32) -> (i32, i32) {
        let (tile, place) = (number as usize / TILE_LEN, number as usize % TILE_LEN);
        let x = tile % self.tiles_across * TILE_X + place % TILE_X;
        let z = tile / self.tiles_across * TILE_Z + place / TILE_X;
        (x as i32, z as i32)
    }
}

/// Side of a column, m, for which most columns that are not empty have one block.
fn column_side(triangles: &[Triangle], bounds: Aabb) -> f32 {
    let size = bounds.high - bounds.low;
    let area = size.x * size.z;
    let cell_m = DENSITY_CELL_M.max((area / MAX_DENSITY_CELLS).sqrt());
    let cell = |value: f32| (value / cell_m) as usize;
    let across = cell(size.x) + 1;
    let mut is_occupied = vec![false; across * (cell(size.z) + 1)];
    for triangle in triangles {
        let centre = triangle.corners().iter().sum::<Vec3>() / 3.0 - bounds.low;
        is_occupied[cell(centre.z).min(cell(size.z)) * across + cell(centre.x).min(across - 1)] = true;
    }
    let occupied = is_occupied.iter().filter(|&&it| it).count() as f32 * cell_m * cell_m;
    let count = triangles.len() as f32;
    let side = (TRIANGLES_PER_COLUMN * occupied / count).sqrt().clamp(MIN_SIDE_M, MAX_SIDE_M);
    let longest = size.x.max(size.z);
    let most_columns = MIN_COLUMNS + COLUMNS_PER_TRIANGLE * count;
    // Limit the number of columns in total and in a row.
    side.max((area / most_columns).sqrt()).max(longest / most_columns)
}

/// The edges of a triangle from above, each as a horizontal vector to the inside and a point.
fn edges_seen_from_above([a, b, c]: [Vec3; 3]) -> [(f32, f32, Vec3); 3] {
    let turn = (b.x - a.x) * (c.z - a.z) - (b.z - a.z) * (c.x - a.x);
    let sign = if turn >= 0.0 { 1.0 } else { -1.0 };
    [(a, b), (b, c), (c, a)].map(|(from, to)| ((from.z - to.z) * sign, (to.x - from.x) * sign, from))
}
