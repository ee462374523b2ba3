//! Movers at their places, and which of them are near a place.

use crate::Vec3;
use crate::map::{Map, Mover, MoverStop};
use crate::mesh::{Surface, Triangle};

/// How far from a body movers are looked for, m: what it moves and they move in a tick, and the step that it may take.
pub(crate) const REACH_M: f32 = 1.5;
/// Side of a cell of the grid that finds movers, m.
const CELL_M: f32 = 16.0;

/// A mover at its place.
#[derive(Debug, Clone)]
pub(crate) struct Posed {
    pub(crate) triangles: Vec<Triangle>,
    /// Least and greatest coordinates, m; reversed while it is not there.
    pub(crate) low: Vec3,
    pub(crate) high: Vec3,
    pub(crate) pose: MoverStop,
    /// The pose one tick before.
    pub(crate) former: MoverStop,
}

impl Posed {
    pub(crate) fn new(mover: &Mover, pose: MoverStop) -> Self {
        let mut posed = Self { triangles: Vec::new(), low: Vec3::ZERO, high: Vec3::ZERO, pose, former: pose };
        posed.place(mover, pose);
        posed
    }

    pub(crate) fn place(&mut self, mover: &Mover, pose: MoverStop) {
        self.pose = pose;
        self.triangles.clear();
        (self.low, self.high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        if !pose.is_there {
            return;
        }
        for corners in &mover.triangles {
            let corners = corners.map(|corner| mover.placed(pose, corner));
            for corner in corners {
                (self.low, self.high) = (self.low.min(corner), self.high.max(corner));
            }
            self.triangles.extend(Triangle::new(corners, Surface::Ground));
        }
    }

    pub(crate) fn touches(&self, low: Vec3, high: Vec3) -> bool {
        self.low.cmple(high).all() && self.high.cmpge(low).all()
    }

    /// Distance of the first hit of a ray within `most` metres.
    pub(crate) fn cast_ray(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<f32> {
        let hit = |far: f32, triangle: &Triangle| triangle.ray(origin, direction, 0.0, far).unwrap_or(far);
        let nearest = self.triangles.iter().fold(most, hit);
        (nearest < most).then_some(nearest)
    }
}

/// The cells from the first to the last column and row that a mover may be near to.
type Span = [[usize; 2]; 2];

/// The movers that may be near a place, by cells seen from above, in the order of their indices.
#[derive(Debug, Clone, Default)]
pub(crate) struct Near {
    columns: usize,
    rows: usize,
    cells: Vec<Vec<u16>>,
    /// Where each mover is listed.
    spans: Vec<Span>,
}

impl Near {
    pub(crate) fn new(map: &Map) -> Self {
        if map.movers().is_empty() {
            return Self::default();
        }
        let extent = map.extent();
        let [columns, rows] = [extent.x, extent.z].map(|side| (side / CELL_M) as usize + 1);
        let mut near = Self { columns, rows, cells: vec![Vec::new(); columns * rows], spans: Vec::new() };
        for (idx, mover) in (0..).zip(map.movers()) {
            let all = (0..mover.stops.len()).map(|stop| mover.bounds_at(stop));
            let swept = all.reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)));
            let (low, high) = swept.expect("a mover has stops");
            // On its way a mover that turns reaches farther than at its stops.
            let turned = if mover.stops.iter().any(|stop| stop.yaw != 0.0) { (high - low).length() } else { 0.0 };
            let span = near.span(low, high, REACH_M + turned);
            near.spans.push(span);
            near.list(idx, span);
        }
        near
    }

    /// Lists a crate where it is now.
    pub(crate) fn follow(&mut self, idx: u16, posed: &Posed) {
        // Where a crate is that is not there does not matter.
        if !posed.pose.is_there {
            return;
        }
        let (former, span) = (self.spans[usize::from(idx)], self.span(posed.low, posed.high, REACH_M));
        if former == span {
            return;
        }
        for cell in self.cells_in(former) {
            self.cells[cell].retain(|listed| *listed != idx);
        }
        self.spans[usize::from(idx)] = span;
        self.list(idx, span);
    }

    fn list(&mut self, idx: u16, span: Span) {
        for cell in self.cells_in(span) {
            let cell = &mut self.cells[cell];
            // What a body meets first must not depend on how the crates came to where they are.
            cell.insert(cell.partition_point(|listed| *listed < idx), idx);
        }
    }

    fn span(&self, low: Vec3, high: Vec3, reach: f32) -> Span {
        [self.cell(low - Vec3::splat(reach)), self.cell(high + Vec3::splat(reach))]
    }

    fn cells_in(&self, [[left, top], [right, bottom]]: Span) -> impl Iterator<Item = usize> + use<> {
        let columns = self.columns;
        (top..=bottom).flat_map(move |row| (left..=right).map(move |column| row * columns + column))
    }

    fn cell(&self, point: Vec3) -> [usize; 2] {
        let number = |metres: f32, count: usize| ((metres / CELL_M).max(0.0) as usize).min(count - 1);
        [number(point.x, self.columns), number(point.z, self.rows)]
    }

    pub(crate) fn of(&self, point: Vec3) -> &[u16] {
        if self.cells.is_empty() {
            return &[];
        }
        let [column, row] = self.cell(point);
        &self.cells[row * self.columns + column]
    }
}
