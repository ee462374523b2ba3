//! A spatial index of points: a grid of square columns on the horizontal plane.

use std::ops::Range;
use surefoot_world::cells::{CellLists, Cells};
use surefoot_world::{Aabb, Vec3};

/// Maximum number of columns along each side.
const MAX_COLUMNS: usize = 256;

/// No point.
const NONE: u32 = u32::MAX;

/// Cells with sides of at least `cell_m` metres from one corner to the other.
fn cells_over(low: Vec3, high: Vec3, cell_m: f32) -> Cells {
    let side = (high.x - low.x).max(high.z - low.z);
    Cells::over(low, high, cell_m.max(side / MAX_COLUMNS as f32).max(1.0e-3))
}

/// The cells that touch the square that extends `reach` metres from `point` to each side.
fn around_point(cells: &Cells, point: Vec3, reach: f32) -> impl Iterator<Item = usize> + use<> {
    let span = Vec3::new(reach, 0.0, reach);
    cells.in_span(cells.span(point - span, point + span))
}

/// Indices of points, by cell.
#[derive(Debug, Clone)]
pub struct PointGrid(CellLists<u32>);

/// The box around points; an empty one at the origin if there are none.
fn around(points: &[Vec3]) -> (Vec3, Vec3) {
    Aabb::around(points.iter().copied()).map_or((Vec3::ZERO, Vec3::ZERO), |Aabb { low, high }| (low, high))
}

impl PointGrid {
    /// Buckets `points` into columns with sides of at least `cell_m` metres.
    pub fn new(points: &[Vec3], cell_m: f32) -> Self {
        let (low, high) = around(points);
        Self(CellLists::new(cells_over(low, high, cell_m), points.iter().map(|point| (*point, *point)).zip(0..)))
    }

    /// Buckets `points` into columns that hold `per_column` of them if they are spread evenly.
    pub fn spread(points: &[Vec3], per_column: f32) -> Self {
        let (low, high) = around(points);
        let size = high - low;
        Self::new(points, (size.x * size.z * per_column / points.len().max(1) as f32).sqrt())
    }

    /// Returns the side of a column, m.
    pub fn cell_m(&self) -> f32 {
        self.0.cells().side_m()
    }

    /// Returns the number of the largest ring around any column that can hold points.
    pub fn ring_count(&self) -> i32 {
        let [columns, rows] = self.0.cells().counts();
        columns.max(rows)
    }

    /// Iterates over the points whose columns touch the square that extends `reach` metres from `point` to each side.
    pub fn within(&self, point: Vec3, reach: f32) -> impl Iterator<Item = u32> {
        around_point(self.0.cells(), point, reach).flat_map(|cell| self.0.of(cell)).copied()
    }

    /// Returns the indices of the `most` points nearest to `at` that `accept` accepts, the nearest first, and of
    /// equally near ones, the lower index first. `points` are the points of which the grid was made.
    pub fn nearest(&self, points: &[Vec3], at: Vec3, most: usize, accept: impl Fn(u32) -> bool) -> Vec<u32> {
        let mut best: Vec<(f32, u32)> = Vec::with_capacity(most.saturating_add(1).min(points.len() + 1));
        for ring in 0..=self.ring_count() {
            // A little less than the distance of the ring, because columns are computed with rounding.
            let bound = (ring - 1).max(0) as f32 * self.cell_m() * 0.999;
            if best.len() >= most && best.last().is_none_or(|(worst, _)| *worst < bound * bound) {
                break;
            }
            self.ring(at, ring, |range| {
                for &idx in &self.order()[range] {
                    let entry = (points[idx as usize].distance_squared(at), idx);
                    let comes_before = |known: &(f32, u32)| known.0.total_cmp(&entry.0).then(known.1.cmp(&idx)).is_lt();
                    let has_room = best.len() < most || best.last().is_some_and(|worst| !comes_before(worst));
                    if has_room && accept(idx) {
                        best.insert(best.partition_point(comes_before), entry);
                        best.truncate(most);
                    }
                }
            });
        }
        best.into_iter().map(|(_, idx)| idx).collect()
    }

    /// Returns the indices of all points in the order of their columns, row by row; [`ring`](Self::ring) yields
    /// ranges of it.
    pub fn order(&self) -> &[u32] {
        self.0.items()
    }

    /// Visits the columns that form square ring number `ring` around the column of `point`, as ranges of
    /// [`order`](Self::order). Their points are at least `(ring - 1) * cell_m` metres from `point` on the plane.
    pub fn ring(&self, point: Vec3, ring: i32, mut visit: impl FnMut(Range<usize>)) {
        self.rings(point, ring..ring + 1, &mut visit);
    }

    /// Visits the columns that form the square rings with these numbers, as few and long ranges of
    /// [`order`](Self::order).
    pub fn rings(&self, point: Vec3, Range { start, end }: Range<i32>, mut visit: impl FnMut(Range<usize>)) {
        let cells = self.0.cells();
        let [column, row] = cells.place_of(point);
        let outer = end - 1;
        for other in (row - outer).max(0)..=(row + outer).min(cells.counts()[1] - 1) {
            if (other - row).abs() >= start {
                visit(self.stretch(other, column - outer, column + outer));
            } else {
                visit(self.stretch(other, column - outer, column - start));
                visit(self.stretch(other, column + start, column + outer));
            }
        }
    }

    /// The columns from `left` to `right` of a row, clipped to the grid, as a range of [`order`](Self::order).
    fn stretch(&self, row: i32, left: i32, right: i32) -> Range<usize> {
        let cells = self.0.cells();
        let (left, right) = (left.max(0), right.min(cells.counts()[0] - 1));
        if left > right {
            return 0..0;
        }
        self.0.range(cells.idx([left, row])..=cells.idx([right, row]))
    }
}

/// Points that are added one by one, bucketed by column.
#[derive(Debug, Clone)]
pub struct GrowingGrid {
    cells: Cells,
    points: Vec<Vec3>,
    /// The last point that was added to each column.
    last: Vec<u32>,
    /// For each point, the previous point in its column.
    before: Vec<u32>,
}

impl GrowingGrid {
    /// A grid with `points` over a map of this extent, in columns with sides of at least `cell_m` metres.
    pub fn new(extent: Vec3, cell_m: f32, points: &[Vec3]) -> Self {
        let cells = cells_over(Vec3::ZERO, extent, cell_m);
        let mut grid = Self { cells, points: Vec::new(), last: vec![NONE; cells.count()], before: Vec::new() };
        points.iter().for_each(|point| grid.push(*point));
        grid
    }

    /// Adds a point, whose index is the number of those before it.
    pub fn push(&mut self, point: Vec3) {
        let last = &mut self.last[self.cells.idx(self.cells.place_of(point))];
        self.before.push(*last);
        *last = self.points.len() as u32;
        self.points.push(point);
    }

    /// All points, in the order in which they were added.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Iterates over the points within `reach` metres of `point`, and some others.
    pub fn within(&self, point: Vec3, reach: f32) -> impl Iterator<Item = (u32, Vec3)> {
        let known = |idx: u32| (idx != NONE).then_some(idx);
        // A little more, because distances are rounded.
        around_point(&self.cells, point, reach * 1.001)
            .flat_map(move |cell| {
                std::iter::successors(known(self.last[cell]), move |&idx| known(self.before[idx as usize]))
            })
            .map(|idx| (idx, self.points[idx as usize]))
    }
}

/// Returns the distance between neighbouring points if all were spread evenly over their bounding rectangle, m; at
/// least 1 m.
pub(crate) fn spacing(points: &[Vec3]) -> f32 {
    let (low, high) = around(points);
    let area = (high.x - low.x).max(1.0) * (high.z - low.z).max(1.0);
    (area / points.len().max(1) as f32).sqrt().max(1.0)
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

    #[test]
    fn a_grid_that_grows_holds_what_was_added_and_finds_what_is_near() {
        let place = |idx: u32| Vec3::new((idx * 37 % 211) as f32 - 20.0, (idx % 7) as f32, (idx * 53 % 197) as f32);
        let mut grid = GrowingGrid::new(Vec3::new(150.0, 9.0, 160.0), 12.0, &[place(0)]);
        for idx in 1..300 {
            grid.push(place(idx));
            let (centre, reach) = (place(idx * 7 % 300), (idx % 50) as f32);
            let mut near: Vec<(u32, Vec3)> = grid.within(centre, reach).collect();
            near.sort_unstable_by_key(|(idx, _)| *idx);
            assert!(near.windows(2).all(|pair| pair[0].0 < pair[1].0), "each once");
            assert!(near.iter().all(|&(idx, at)| at == place(idx) && idx < grid.points().len() as u32));
            let expected = (0..=idx).filter(|&other| place(other).distance(centre) <= reach);
            assert!(expected.into_iter().all(|other| near.iter().any(|(idx, _)| *idx == other)));
        }
        assert_eq!(grid.within(Vec3::ZERO, f32::INFINITY).count(), 300);
    }

    #[test]
    fn the_nearest_points_are_those_of_a_full_sort() {
        let on_a_lattice: Vec<Vec3> =
            (0..400).map(|idx| Vec3::new((idx % 20) as f32 * 3.0, (idx % 3) as f32, (idx / 20) as f32 * 3.0)).collect();
        let scattered: Vec<Vec3> =
            (0..300).map(|idx| Vec3::new((idx * 37 % 211) as f32 * 0.9, 0.0, (idx * 53 % 197) as f32 * 1.1)).collect();
        let in_a_heap = vec![Vec3::ONE; 30];
        let with_an_outlier: Vec<Vec3> = scattered.iter().copied().chain([Vec3::new(9.0e4, 0.0, -9.0e4)]).collect();
        for points in [on_a_lattice, scattered, in_a_heap, with_an_outlier, Vec::new()] {
            let grid = PointGrid::spread(&points, 2.0);
            let places = points.iter().copied().step_by(17).chain([Vec3::new(-40.0, 5.0, 500.0)]);
            for (at, most) in places.zip([1, 8, 12, 0, 1000].into_iter().cycle()) {
                let accept = |idx: u32| !idx.is_multiple_of(5);
                let mut all: Vec<u32> = (0..points.len() as u32).filter(|&idx| accept(idx)).collect();
                all.sort_by(|a, b| {
                    points[*a as usize]
                        .distance_squared(at)
                        .total_cmp(&points[*b as usize].distance_squared(at))
                        .then(a.cmp(b))
                });
                all.truncate(most);
                assert_eq!(grid.nearest(&points, at, most, accept), all);
            }
        }
    }
}
