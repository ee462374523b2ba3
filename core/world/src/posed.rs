//! Movers in their current poses, and the index of movers near a place.

use crate::aabb::Aabb;
use crate::cells::{Cells, Span};
use crate::map::{Map, Mover, MoverStop};
use crate::mesh::{Surface, Triangle};
use crate::{MoverId, Vec3};

/// Distance from a body within which movers matter, m: the motion of both in a tick, and the body's step.
pub(crate) const REACH_M: f32 = 1.5;
/// Side of a cell, m.
const CELL_M: f32 = 16.0;

/// A mover in its current pose.
#[derive(Debug, Clone)]
pub(crate) struct Posed {
    pub(crate) triangles: Vec<Triangle>,
    /// Least and greatest coordinates, m; reversed while the mover is not there.
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

/// The movers that may be near a place, in the order of their indices.
#[derive(Debug, Clone, Default)]
pub(crate) struct MoversNearby {
    cells: Cells,
    /// Movers of each cell; empty if the map has none.
    lists: Vec<Vec<MoverId>>,
    /// Cells in whose lists each mover is.
    spans: Vec<Span>,
}

impl MoversNearby {
    pub(crate) fn new(map: &Map) -> Self {
        if map.movers().is_empty() {
            return Self::default();
        }
        let cells = Cells::over(Vec3::ZERO, map.extent(), CELL_M);
        let mut nearby = Self { cells, lists: vec![Vec::new(); cells.count()], spans: Vec::new() };
        for (id, mover) in (0..).map(MoverId).zip(map.movers()) {
            let Aabb { low, high } = mover.reach();
            // While it travels, a mover that turns reaches farther than at its stops.
            let turned = if mover.stops.iter().any(|stop| stop.yaw != 0.0) { (high - low).length() } else { 0.0 };
            let span = nearby.span(low, high, REACH_M + turned);
            nearby.spans.push(span);
            nearby.list(id, span);
        }
        nearby
    }

    /// Lists a crate where it is now.
    pub(crate) fn follow(&mut self, id: MoverId, posed: &Posed) {
        // The place of a crate that is not there does not matter.
        if !posed.pose.is_there {
            return;
        }
        let (former, span) = (self.spans[id.idx()], self.span(posed.low, posed.high, REACH_M));
        if former == span {
            return;
        }
        for cell in self.cells.in_span(former) {
            self.lists[cell].retain(|listed| *listed != id);
        }
        self.spans[id.idx()] = span;
        self.list(id, span);
    }

    fn list(&mut self, id: MoverId, span: Span) {
        for cell in self.cells.in_span(span) {
            let list = &mut self.lists[cell];
            // The order in which a body meets movers must not depend on the paths of the crates.
            list.insert(list.partition_point(|listed| *listed < id), id);
        }
    }

    fn span(&self, low: Vec3, high: Vec3, reach: f32) -> Span {
        self.cells.span(low - Vec3::splat(reach), high + Vec3::splat(reach))
    }

    pub(crate) fn at(&self, point: Vec3) -> &[MoverId] {
        if self.lists.is_empty() {
            return &[];
        }
        &self.lists[self.cells.idx(self.cells.place_of(point))]
    }
}
