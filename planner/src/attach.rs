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
}

impl VertexIndex {
    /// Indexes the vertices that `holds` accepts in columns with sides of `cell_m` metres.
    pub fn new(graph: &NavGraph, cell_m: f32, holds: impl Fn(VertexId) -> bool) -> Self {
        let vertices: Vec<VertexId> = graph.vertices().filter(|&vertex| holds(vertex)).collect();
        let positions: Vec<Vec3> = vertices.iter().map(|&vertex| graph.position(vertex)).collect();
        let grid = PointGrid::new(&positions, cell_m);
        let places = grid.order().iter().map(|&idx| (positions[idx as usize], vertices[idx as usize])).collect();
        Self { grid, places }
    }

    /// Visits the vertices in square rings around `point`, while `visit` returns true. It gets a lower bound on the horizontal
    /// distance of this ring and all further ones, m, and some of the ring's vertices.
    pub fn visit_from(&self, point: Vec3, mut visit: impl FnMut(f32, &[(Vec3, VertexId)]) -> bool) {
        let mut goes_on = true;
        for ring in 0..=self.grid.ring_count() {
            let clearance = (ring - 1).max(0) as f32 * self.grid.cell_m();
            self.grid.ring(point, ring, |range| goes_on = goes_on && visit(clearance, &self.places[range]));
            if !goes_on {
                break;
            }
        }
    }

    /// The cheapest attachments of `point` among the vertices that `accept` lets pass, at most `most`, in ascending order
    /// of cost. `leg_of` turns the offset from the point to a vertex into that of the leg, from its start to its end.
    pub fn cheapest(
        &self,
        point: Vec3,
        most: usize,
        prices: &LegPrices,
        reach_m: f32,
        leg_of: impl Fn(Vec3) -> Vec3,
        accept: impl Fn(VertexId, Vec3) -> bool,
    ) -> Vec<Attachment> {
        let mut best = Cheapest { entries: Vec::with_capacity(most + 1), most, reach_m, limit_m: reach_m };
        // Vertices that may be among the cheapest, and their legs, until there are enough of them to be priced together.
        let (mut waiting, mut legs, mut count) = ([VertexId(0); LANES], [[0.0; LANES]; 3], 0);
        self.visit_from(point, |clearance, vertices| {
            if clearance > best.limit_m {
                return false;
            }
            for &(at, vertex) in vertices {
                let offset = at - point;
                if offset.x * offset.x + offset.z * offset.z > best.limit_m * best.limit_m {
                    continue;
                }
                let leg = leg_of(offset);
                if !accept(vertex, leg) {
                    continue;
                }
                (waiting[count], [legs[0][count], legs[1][count], legs[2][count]]) = (vertex, leg.to_array());
                count += 1;
                if count == LANES {
                    best.insert(&waiting, prices.of(&legs), prices);
                    count = 0;
                }
            }
            true
        });
        best.insert(&waiting[..count], prices.of(&legs), prices);
        best.entries
    }
}

/// The cheapest attachments found so far.
struct Cheapest {
    entries: Vec<Attachment>,
    most: usize,
    reach_m: f32,
    /// Horizontal distance beyond which no vertex is of interest, m.
    limit_m: f32,
}

impl Cheapest {
    fn insert(&mut self, vertices: &[VertexId], costs: [f32; LANES], prices: &LegPrices) {
        for (&vertex, cost) in vertices.iter().zip(costs) {
            let place = self.entries.partition_point(|&(_, other)| other <= cost);
            if place < self.most {
                self.entries.insert(place, (vertex, cost));
                self.entries.truncate(self.most);
            }
        }
        if let Some(&(_, worst)) = self.entries.get(self.most - 1) {
            self.limit_m = self.reach_m.min(prices.metres_below(worst));
        }
    }
}
