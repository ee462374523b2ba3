//! The grid: sorts triangles into cells and finds those that touch a box.

use super::triangle::Triangle;
use crate::Vec3;
use rayon::prelude::*;

/// Side of a grid cell in metres.
pub(super) const CELL_M: f32 = 1.6;
/// Cells per metre.
const CELLS_PER_M: f32 = 1.0 / CELL_M;
/// Longest empty-space skip that is stored, in cells.
const MAX_SKIP: u8 = 15;
/// Number of collected indices from which duplicates are removed before the search ends.
const MANY_FOUND: usize = 4096;
/// Smallest number of cells for which another thread saves time.
const CELLS_PER_THREAD: usize = 1 << 16;

/// Centre of a grid cell.
#[inline]
fn centre_of([x, y, z]: [i32; 3]) -> Vec3 {
    (Vec3::new(x as f32, y as f32, z as f32) + Vec3::splat(0.5)) * CELL_M
}

/// Slabs of so many values, with their indices.
fn each_slab(values: &mut [u8], slab_len: usize) -> impl IndexedParallelIterator<Item = (usize, &mut [u8])> {
    values.par_chunks_mut(slab_len).enumerate().with_min_len(CELLS_PER_THREAD.div_ceil(slab_len))
}

/// Bit set in the entry of a cell without triangles; the other bits are a lower bound of the Chebyshev distance, in
/// cells, to the nearest cell with triangles.
pub(super) const EMPTY: u32 = 1 << 31;

/// The triangles of one occupied cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Occupied {
    /// Index of the cell's first item; the items end where those of the next cell begin.
    start: u32,
    /// Lowest and highest y of the cell's triangles, m: rays that pass above or below are not tested.
    pub lowest: f32,
    pub highest: f32,
}

/// Triangles indexed by a uniform grid.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    pub(super) triangles: Vec<Triangle>,
    pub(super) counts: [i32; 3],
    /// For each cell, [`EMPTY`] with a distance, or an index into `occupied`.
    pub(super) cells: Vec<u32>,
    /// Occupied cells in the order of `cells`, and a sentinel at the end.
    pub(super) occupied: Vec<Occupied>,
    /// Indices of the triangles of each occupied cell, in the order of the cells.
    items: Vec<u32>,
}

impl Grid {
    /// Indexes `triangles` inside the box from the origin to `extent`.
    pub fn new(triangles: Vec<Triangle>, extent: Vec3) -> Self {
        let counts = extent.to_array().map(|side| ((side / CELL_M).ceil() as i32).max(1));
        let cell_count = counts.iter().map(|&count| count as usize).product::<usize>();
        let (cells, occupied, items) = Default::default();
        let mut mesh = Self { triangles, counts, cells, occupied, items };
        let mut cells = vec![0u32; cell_count];
        mesh.for_each_cell_of_triangles(|cell, _| cells[cell] += 1);
        let skips = mesh.empty_space_skips(&cells);
        let mut item_count = 0;
        let mut occupied = Vec::new();
        for (cell, skip) in cells.iter_mut().zip(skips) {
            if *cell == 0 {
                *cell = EMPTY | u32::from(skip);
                continue;
            }
            let triangle_count = std::mem::replace(cell, occupied.len() as u32);
            occupied.push(Occupied { start: item_count, lowest: f32::INFINITY, highest: f32::NEG_INFINITY });
            item_count += triangle_count;
        }
        let mut ends: Vec<u32> = occupied.iter().map(|range| range.start).collect();
        occupied.push(Occupied { start: item_count, lowest: 0.0, highest: 0.0 });
        let mut items = vec![0u32; item_count as usize];
        mesh.for_each_cell_of_triangles(|cell, triangle_idx| {
            let idx = cells[cell] as usize;
            items[ends[idx] as usize] = triangle_idx;
            ends[idx] += 1;
            let (low, high) = mesh.triangles[triangle_idx as usize].bounds();
            occupied[idx].lowest = occupied[idx].lowest.min(low.y);
            occupied[idx].highest = occupied[idx].highest.max(high.y);
        });
        (mesh.cells, mesh.occupied, mesh.items) = (cells, occupied, items);
        mesh
    }

    /// Memory of the triangles and the grid, in bytes.
    pub fn memory_bytes(&self) -> usize {
        std::mem::size_of_val(self.triangles.as_slice())
            + std::mem::size_of_val(self.cells.as_slice())
            + std::mem::size_of_val(self.occupied.as_slice())
            + std::mem::size_of_val(self.items.as_slice())
    }

    /// Triangles of an occupied cell.
    #[inline]
    pub(super) fn items_of(&self, occupied_idx: usize) -> &[u32] {
        let range = self.occupied[occupied_idx].start as usize..self.occupied[occupied_idx + 1].start as usize;
        &self.items[range]
    }

    pub(super) fn cell_idx(&self, [x, y, z]: [i32; 3]) -> usize {
        ((z * self.counts[1] + y) * self.counts[0] + x) as usize
    }

    pub(super) fn cell_of(&self, point: Vec3) -> [i32; 3] {
        // Truncation rounds towards zero, which is the floor wherever the grid has cells.
        [point.x, point.y, point.z].map(|c| (c * CELLS_PER_M) as i32)
    }

    fn clamped_cells(&self, low: Vec3, high: Vec3) -> ([i32; 3], [i32; 3]) {
        let clamp = |cell: [i32; 3]| [0, 1, 2].map(|axis| cell[axis].clamp(0, self.counts[axis] - 1));
        (clamp(self.cell_of(low)), clamp(self.cell_of(high)))
    }

    fn for_each_cell_of_triangles(&self, mut visit: impl FnMut(usize, u32)) {
        // Slightly widened bounds, so that a triangle on a cell's border is found from both sides.
        let slack = Vec3::splat(1.0e-3);
        let half = Vec3::splat(CELL_M * 0.5 + 1.0e-3);
        for (idx, triangle) in self.triangles.iter().enumerate() {
            let (low, high) = triangle.bounds();
            let (from, to) = self.clamped_cells(low - slack, high + slack);
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    for x in from[0]..=to[0] {
                        let centre = centre_of([x, y, z]);
                        let reach = triangle.normal().abs().dot(half);
                        let on_border =
                            [(x, 0), (y, 1), (z, 2)].iter().any(|&(c, axis)| c == 0 || c == self.counts[axis] - 1);
                        if on_border || triangle.normal().dot(centre - triangle.corners()[0]).abs() <= reach {
                            visit(self.cell_idx([x, y, z]), idx as u32);
                        }
                    }
                }
            }
        }
    }

    /// Chebyshev distance transform of the cells with a count above 0, capped at [`MAX_SKIP`].
    ///
    /// The transform is separable: first the distance along x, then `min over j of max(d(j), |i - j|)` along y and z.
    /// The inner loops run over consecutive bytes.
    fn empty_space_skips(&self, triangle_counts: &[u32]) -> Vec<u8> {
        let [nx, ny, nz] = self.counts.map(|count| count as usize);
        let slab_len = nx * ny;
        let mut along_x = vec![0u8; triangle_counts.len()];
        each_slab(&mut along_x, nx).for_each(|(row_idx, row)| {
            let counts = &triangle_counts[row_idx * nx..(row_idx + 1) * nx];
            let mut distance = MAX_SKIP;
            for (value, &count) in row.iter_mut().zip(counts) {
                distance = if count > 0 { 0 } else { (distance + 1).min(MAX_SKIP) };
                *value = distance;
            }
            for value in row.iter_mut().rev() {
                distance = if *value == 0 { 0 } else { (distance + 1).min(*value) };
                *value = distance;
            }
        });
        let combine = |into: &mut [u8], from: &[u8], reach: u8| {
            for (value, &other) in into.iter_mut().zip(from) {
                *value = (*value).min(other.max(reach));
            }
        };
        let mut along_xy = along_x.clone();
        each_slab(&mut along_xy, slab_len).for_each(|(z, slab)| {
            for y in 0..ny {
                let into = &mut slab[y * nx..(y + 1) * nx];
                for reach in 1..MAX_SKIP {
                    let row = |y: usize| &along_x[z * slab_len + y * nx..z * slab_len + (y + 1) * nx];
                    if let Some(below) = y.checked_sub(usize::from(reach)) {
                        combine(into, row(below), reach);
                    }
                    if y + usize::from(reach) < ny {
                        combine(into, row(y + usize::from(reach)), reach);
                    }
                }
            }
        });
        let mut skips = along_x;
        skips.copy_from_slice(&along_xy);
        each_slab(&mut skips, slab_len).for_each(|(z, slab)| {
            for reach in 1..MAX_SKIP {
                let layer = |z: usize| &along_xy[z * slab_len..(z + 1) * slab_len];
                if let Some(before) = z.checked_sub(usize::from(reach)) {
                    combine(slab, layer(before), reach);
                }
                if z + usize::from(reach) < nz {
                    combine(slab, layer(z + usize::from(reach)), reach);
                }
            }
        });
        skips
    }

    /// Replaces the content of `found` with the indices of the solid triangles whose bounds touch the box, in ascending
    /// order.
    pub fn gather_solids(&self, low: Vec3, high: Vec3, found: &mut Vec<u32>) {
        found.clear();
        let (from, to) = self.clamped_cells(low, high);
        let mut most = MANY_FOUND;
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                let row = self.cell_idx([0, y, z]);
                for entry in &self.cells[row + from[0] as usize..=row + to[0] as usize] {
                    if entry & EMPTY == 0 {
                        found.extend_from_slice(self.items_of(*entry as usize));
                    }
                }
                if found.len() > most {
                    // Large triangles are in many cells.
                    found.sort_unstable();
                    found.dedup();
                    most = MANY_FOUND.max(2 * found.len());
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found.retain(|&idx| self.triangles[idx as usize].is_solid_in(low, high));
    }
}
