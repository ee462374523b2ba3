//! Square cells on the horizontal plane: which of many items are near a place.
//!
//! [`Cells`] cover a rectangle, and [`CellLists`] hold the items of each cell. [`CellKey`] names a cell of an unbounded
//! plane, for indices that change with every tick.

use crate::Vec3;
use crate::csr::Csr;
use std::ops::{Range, RangeInclusive};

/// Square cells over a rectangle of the horizontal plane, numbered row by row. Places outside belong to the nearest
/// cell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cells {
    low: [f32; 2],
    side_m: f32,
    counts: [i32; 2],
}

/// The cells from one column and row to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    from: [i32; 2],
    to: [i32; 2],
}

impl Cells {
    /// Cells with sides of `side_m` metres over the rectangle from `low` to `high`.
    pub fn over(low: Vec3, high: Vec3, side_m: f32) -> Self {
        let count = |metres: f32| (metres / side_m) as i32 + 1;
        Self { low: [low.x, low.z], side_m, counts: [count(high.x - low.x), count(high.z - low.z)] }
    }

    /// Side of a cell, m.
    pub fn side_m(&self) -> f32 {
        self.side_m
    }

    /// Numbers of columns and rows.
    pub fn counts(&self) -> [i32; 2] {
        self.counts
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        (self.counts[0] * self.counts[1]) as usize
    }

    /// Column and row of a place.
    pub fn place_of(&self, point: Vec3) -> [i32; 2] {
        let place = |metres: f32, axis: usize| {
            (((metres - self.low[axis]) / self.side_m) as i32).clamp(0, self.counts[axis] - 1)
        };
        [place(point.x, 0), place(point.z, 1)]
    }

    /// Number of the cell at a column and row.
    pub fn idx(&self, [column, row]: [i32; 2]) -> usize {
        (row * self.counts[0] + column) as usize
    }

    /// Whether there is such a column and row.
    pub fn contains(&self, [column, row]: [i32; 2]) -> bool {
        (0..self.counts[0]).contains(&column) && (0..self.counts[1]).contains(&row)
    }

    /// The cells that touch the rectangle from `low` to `high`.
    pub fn span(&self, low: Vec3, high: Vec3) -> Span {
        Span { from: self.place_of(low), to: self.place_of(high) }
    }

    /// Numbers of the cells of a span, ascending.
    pub fn in_span(&self, Span { from, to }: Span) -> impl Iterator<Item = usize> + use<> {
        let cells = *self;
        (from[1]..=to[1]).flat_map(move |row| (from[0]..=to[0]).map(move |column| cells.idx([column, row])))
    }
}

/// Items by cell; an item that touches several cells is in the list of each.
#[derive(Debug, Clone)]
pub struct CellLists<T> {
    cells: Cells,
    /// The items of each cell.
    lists: Csr<T>,
}

impl<T: Copy> CellLists<T> {
    /// Lists items that touch these rectangles, each list in the order of `items`.
    pub fn new(cells: Cells, items: impl IntoIterator<Item = ((Vec3, Vec3), T)>) -> Self {
        let listed = items.into_iter().flat_map(|((low, high), item)| {
            let touched = cells.in_span(cells.span(low, high));
            touched.map(move |cell| (cell, item))
        });
        let listed: Vec<(usize, T)> = listed.collect();
        Self { cells, lists: Csr::group(cells.count(), listed.iter().copied()) }
    }

    /// The cells that the items are listed by.
    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// The items of a cell.
    pub fn of(&self, cell: usize) -> &[T] {
        self.lists.row(cell)
    }

    /// The items of all cells, cell by cell.
    pub fn items(&self) -> &[T] {
        self.lists.items()
    }

    /// The places in [`items`](Self::items) of the items of consecutive cells.
    pub fn range(&self, cells: RangeInclusive<usize>) -> Range<usize> {
        self.lists.range(*cells.start()).start..self.lists.range(*cells.end()).end
    }

    /// The items of the cell of a place.
    pub fn at(&self, point: Vec3) -> &[T] {
        self.of(self.cells.idx(self.cells.place_of(point)))
    }

    /// Memory of the lists, in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.lists.memory_bytes()
    }
}

/// Column and row of a cell of an unbounded plane as one number. Cells are ordered by column, then by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CellKey(u64);

impl CellKey {
    /// The cell with this side, m, in which a place lies.
    pub fn at(place: Vec3, side_m: f32) -> Self {
        // No map is so large that a row or a column would overflow; places far outside share the last one.
        let number = |metres: f32| ((metres / side_m) as i32).clamp(-(1 << 20), 1 << 20) as i64 + (1 << 21);
        Self((number(place.x) << 32 | number(place.z)) as u64)
    }

    /// The cell that is so many columns and rows further.
    pub fn shifted(self, columns: u64, rows: i64) -> Self {
        Self(self.0.wrapping_add(columns << 32).wrapping_add_signed(rows))
    }

    /// The cells of the rectangle between two cells, as one range for each column.
    pub fn rectangle(low: Self, high: Self) -> impl Iterator<Item = RangeInclusive<Self>> {
        let row = |cell: Self| cell.0 & u64::from(u32::MAX);
        let (first, last) = (row(low), row(high));
        (low.0 >> 32..=high.0 >> 32).map(move |column| Self(column << 32 | first)..=Self(column << 32 | last))
    }
}
