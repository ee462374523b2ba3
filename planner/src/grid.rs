//! A spatial index of points: a grid of square columns on the horizontal plane.

use std::ops::Range;
use surefoot_world::Vec3;

/// Maximum number of columns along each side.
const MAX_COLUMNS: usize = 256;

/// Indices of points, bucketed by column.
#[derive(Debug, Clone)]
pub struct PointGrid {
    low: (f32, f32),
    cell_m: f32,
    columns: i32,
    rows: i32,
    /// First entry of each column, followed by the number of entries.
    starts: Vec<u32>,
    entries: Vec<u32>,
}

impl PointGrid {
    /// Buckets `points` into columns with sides of at least `cell_m` metres.
    pub fn new(points: &[Vec3], cell_m: f32) -> Self {
        let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
        for point in points {
            (low, high) = (low.min(*point), high.max(*point));
        }
        if points.is_empty() {
            (low, high) = (Vec3::ZERO, Vec3::ZERO);
        }
        let side = (high.x - low.x).max(high.z - low.z);
        let cell_m = cell_m.max(side / MAX_COLUMNS as f32).max(1.0e-3);
        let count = |span: f32| (span / cell_m) as i32 + 1;
        let mut grid = Self {
            low: (low.x, low.z),
            cell_m,
            columns: count(high.x - low.x),
            rows: count(high.z - low.z),
            starts: Vec::new(),
            entries: vec![0; points.len()],
        };
        let cells: Vec<usize> = points.iter().map(|&point| grid.cell(grid.column_of(point))).collect();
        let mut starts = vec![0u32; (grid.columns * grid.rows) as usize + 1];
        cells.iter().for_each(|&cell| starts[cell + 1] += 1);
        (1..starts.len()).for_each(|idx| starts[idx] += starts[idx - 1]);
        let mut next = starts.clone();
        for (point, &cell) in (0..).zip(&cells) {
            grid.entries[next[cell] as usize] = point;
            next[cell] += 1;
        }
        grid.starts = starts;
        grid
    }

    /// Returns the side of a column, m.
    pub fn cell_m(&self) -> f32 {
        self.cell_m
    }

    /// Returns the number of the largest ring around any column that can hold points.
    pub fn ring_count(&self) -> i32 {
        self.columns.max(self.rows)
    }

    /// Returns the column and row that contain a point, clamped to the grid.
    pub fn column_of(&self, point: Vec3) -> (i32, i32) {
        let idx = |value: f32, low: f32, count: i32| (((value - low) / self.cell_m) as i32).clamp(0, count - 1);
        (idx(point.x, self.low.0, self.columns), idx(point.z, self.low.1, self.rows))
    }

    fn cell(&self, (column, row): (i32, i32)) -> usize {
        (row * self.columns + column) as usize
    }

    fn entries_at(&self, column: i32, row: i32) -> &[u32] {
        if column < 0 || row < 0 || column >= self.columns || row >= self.rows {
            return &[];
        }
        let cell = self.cell((column, row));
        &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// Iterates over the points whose columns touch the square that extends `reach` metres from `point` to each side.
    pub fn within(&self, point: Vec3, reach: f32) -> impl Iterator<Item = u32> {
        let span = Vec3::new(reach, 0.0, reach);
        let ((left, back), (right, front)) = (self.column_of(point - span), self.column_of(point + span));
        (back..=front)
            .flat_map(move |row| (left..=right).map(move |column| (column, row)))
            .flat_map(|(column, row)| self.entries_at(column, row).iter().copied())
    }

    /// Returns the indices of all points in the order of their columns, row by row; [`ring`](Self::ring) yields ranges of it.
    pub fn order(&self) -> &[u32] {
        &self.entries
    }

    /// Visits the columns that form square ring number `ring` around the column of `point`, as ranges of
    /// [`order`](Self::order). Their points are at least `(ring - 1) * cell_m` metres from `point` on the plane.
    pub fn ring(&self, point: Vec3, ring: i32, mut visit: impl FnMut(Range<usize>)) {
        self.rings(point, ring..ring + 1, &mut visit);
    }

    /// Visits the columns that form the square rings with these numbers, as few and long ranges of [`order`](Self::order).
    pub fn rings(&self, point: Vec3, Range { start, end }: Range<i32>, mut visit: impl FnMut(Range<usize>)) {
        let (column, row) = self.column_of(point);
        let outer = end - 1;
        for other in (row - outer).max(0)..=(row + outer).min(self.rows - 1) {
            if (other - row).abs() >= start {
                visit(self.stretch(other, column - outer, column + outer));
            } else {
                visit(self.stretch(other, column - outer, column - start));
                visit(self.stretch(other, column + start, column + outer));
            }
        }
    }

    /// The columns from `left` to `right` of a row, as far as there are any, as a range of [`order`](Self::order).
    fn stretch(&self, row: i32, left: i32, right: i32) -> Range<usize> {
        let (left, right) = (left.max(0), right.min(self.columns - 1));
        if left > right {
            return 0..0;
        }
        let (first, last) = (self.cell((left, row)), self.cell((right, row)));
        self.starts[first] as usize..self.starts[last + 1] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_world::float::hypot;

    #[test]
    fn rings_hold_every_point_once_and_keep_their_distance() {
        let points: Vec<Vec3> = (0..300)
            .map(|idx| Vec3::new((idx * 37 % 211) as f32 * 0.9, (idx % 7) as f32, (idx * 53 % 197) as f32 * 1.1))
            .collect();
        let grid = PointGrid::new(&points, 12.0);
        for centre in [points[0], points[99], Vec3::new(-40.0, 0.0, 500.0)] {
            let mut seen = vec![0; points.len()];
            for ring in 0..=grid.ring_count() {
                grid.ring(centre, ring, |range| {
                    for &idx in &grid.order()[range] {
                        seen[idx as usize] += 1;
                        let offset = points[idx as usize] - centre;
                        assert!(hypot(offset.x, offset.z) >= (ring - 1) as f32 * grid.cell_m());
                    }
                });
            }
            assert!(seen.iter().all(|&count| count == 1));
        }
        let near: Vec<u32> = grid.within(points[5], 20.0).collect();
        for (idx, point) in (0..).zip(&points) {
            let offset = *point - points[5];
            assert!(offset.x.abs().max(offset.z.abs()) > 20.0 || near.contains(&idx));
        }
    }
}
