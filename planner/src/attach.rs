//! Attaches places to a graph: the vertices from or to which an unproved leg costs least.

use crate::graph::NavGraph;
use crate::grid::PointGrid;
use crate::ids::VertexId;
use crate::legs::{LANES, LegPrices};
use surefoot_world::Vec3;

/// Maximum number of vertices that a start or goal is attached to at first.
pub(crate) const ATTACHMENTS: usize = 6;
/// Maximum number where no path joins the first.
pub(crate) const MORE_ATTACHMENTS: usize = 48;

/// A vertex and the cost of the unproved leg between it and the start or goal, in decisions.
pub(crate) type Attachment = (VertexId, f32);

/// A spatial index of some of a graph's vertices.
#[derive(Debug)]
pub(crate) struct VertexIndex {
    grid: PointGrid,
    /// Positions, m, and ids of the vertices, in the grid's order.
    places: Vec<(Vec3, VertexId)>,
    /// The positions once more, axis by axis, and [`LANES`] zeros after them.
    axes: [Vec<f32>; 3],
    /// The least and the greatest height of the vertices, m.
    heights: [f32; 2],
}

/// Whether a leg leads from the point that is attached or to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    /// From the point to the vertex.
    Away,
    /// From the vertex to the point.
    Back,
}

impl VertexIndex {
    /// Indexes the vertices that `holds` accepts in columns with sides of `cell_m` metres.
    pub fn new(graph: &NavGraph, cell_m: f32, holds: impl Fn(VertexId) -> bool) -> Self {
        let vertices: Vec<VertexId> = graph.vertices().filter(|&vertex| holds(vertex)).collect();
        let positions: Vec<Vec3> = vertices.iter().map(|&vertex| graph.position(vertex)).collect();
        let grid = PointGrid::new(&positions, cell_m);
        let places: Vec<(Vec3, VertexId)> =
            grid.order().iter().map(|&idx| (positions[idx as usize], vertices[idx as usize])).collect();
        let axis = |of: fn(&Vec3) -> f32| places.iter().map(|(at, _)| of(at)).chain([0.0; LANES]).collect();
        let axes = [axis(|at| at.x), axis(|at| at.y), axis(|at| at.z)];
        let heights = places.iter().fold([f32::MAX, f32::MIN], |[low, high], (at, _)| [low.min(at.y), high.max(at.y)]);
        Self { grid, places, axes, heights }
    }

    /// Visits the vertices in square rings around `point`, while `visit` returns true. It gets a lower bound on the square of the
    /// distance of this ring and all further ones, m2, and some of the ring's vertices.
    pub fn visit_from(&self, point: Vec3, mut visit: impl FnMut(f32, &[(Vec3, VertexId)]) -> bool) {
        let mut goes_on = true;
        let beyond = (self.heights[0] - point.y).max(point.y - self.heights[1]).max(0.0);
        for ring in 0..=self.grid.ring_count() {
            let clearance = (ring - 1).max(0) as f32 * self.grid.cell_m();
            let least = clearance * clearance + beyond * beyond;
            self.grid.ring(point, ring, |range| goes_on = goes_on && visit(least, &self.places[range]));
            if !goes_on {
                break;
            }
        }
    }

    /// The cheapest attachments of `point` among the vertices that `accept` lets pass with their legs, at most `most` and not much farther
    /// away than `reach_m` on the plane, in ascending order of cost.
    pub fn cheapest(
        &self,
        point: Vec3,
        most: usize,
        prices: &LegPrices,
        reach_m: f32,
        direction: Direction,
        accept: impl Fn(VertexId, Vec3) -> bool,
    ) -> Vec<Attachment> {
        let mut best = Cheapest { entries: Vec::with_capacity(most + 1), most, prices, reach_m, limit_m: reach_m };
        // Vertices that may be among the cheapest, and their legs, until there are enough of them to be priced together.
        let mut waiting = Waiting { vertices: [VertexId(0); LANES], legs: [[0.0; LANES]; 3], count: 0 };
        let (mut seen, mut next) = (0, 2);
        loop {
            self.grid.rings(point, seen..next, |range| {
                for first in range.clone().step_by(LANES) {
                    let legs = self.legs(first, point, direction);
                    let most = best.limit_m * best.limit_m;
                    let is_near: [bool; LANES] = std::array::from_fn(|lane| {
                        legs[0][lane] * legs[0][lane] + legs[2][lane] * legs[2][lane] <= most
                    });
                    if is_near == [false; LANES] {
                        continue;
                    }
                    for lane in 0..LANES.min(range.end - first) {
                        if !is_near[lane] {
                            continue;
                        }
                        let (leg, vertex) = (legs.map(|axis| axis[lane]), self.places[first + lane].1);
                        if accept(vertex, leg.into()) && waiting.push(vertex, leg) {
                            best.insert(&mut waiting);
                        }
                    }
                }
            });
            best.insert(&mut waiting);
            seen = next;
            let limit = (best.limit_m / self.grid.cell_m()).ceil().min(self.grid.ring_count() as f32) as i32 + 1;
            if seen >= limit {
                return best.entries;
            }
            next = limit.min(2 * seen + 1);
        }
    }

    /// The legs between `point` and [`LANES`] vertices from the `first` on, axis by axis, m.
    fn legs(&self, first: usize, point: Vec3, direction: Direction) -> [[f32; LANES]; 3] {
        let sign = if direction == Direction::Away { 1.0 } else { -1.0 };
        let offsets = |axis: &[f32], of: f32| {
            let at: &[f32; LANES] = axis[first..].first_chunk().expect("zeros follow the last vertex");
            at.map(|at| (at - of) * sign)
        };
        let [x, y, z] = &self.axes;
        [offsets(x, point.x), offsets(y, point.y), offsets(z, point.z)]
    }
}

/// Vertices that wait to be priced together, and their legs, axis by axis, m.
struct Waiting {
    vertices: [VertexId; LANES],
    legs: [[f32; LANES]; 3],
    count: usize,
}

impl Waiting {
    /// Adds a vertex with its leg; true if there is no room for another one.
    fn push(&mut self, vertex: VertexId, leg: [f32; 3]) -> bool {
        self.vertices[self.count] = vertex;
        self.legs.iter_mut().zip(leg).for_each(|(axis, value)| axis[self.count] = value);
        self.count += 1;
        self.count == LANES
    }
}

/// The cheapest attachments found so far.
struct Cheapest<'a> {
    entries: Vec<Attachment>,
    most: usize,
    prices: &'a LegPrices,
    reach_m: f32,
    /// Horizontal distance beyond which no vertex is of interest, m.
    limit_m: f32,
}

impl Cheapest<'_> {
    /// Prices those that wait and keeps the cheapest.
    fn insert(&mut self, waiting: &mut Waiting) {
        if waiting.count == 0 {
            return;
        }
        let costs = self.prices.of(&waiting.legs);
        for (&vertex, cost) in waiting.vertices[..waiting.count].iter().zip(costs) {
            let place = self.entries.partition_point(|&(_, other)| other <= cost);
            if place < self.most {
                self.entries.insert(place, (vertex, cost));
                self.entries.truncate(self.most);
            }
        }
        waiting.count = 0;
        if let Some(&(_, worst)) = self.entries.get(self.most - 1) {
            self.limit_m = self.reach_m.min(self.prices.metres_below(worst));
        }
    }
}
