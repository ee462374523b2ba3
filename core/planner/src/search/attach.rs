//! Attaches positions to a graph: the vertices to or from which an unproved leg costs least.

use crate::graph::{Edge, NavGraph};
use crate::grid::PointGrid;
use crate::ids::VertexId;
use crate::legs::{LANES, LegPrices};
use surefoot_world::{Ability, Vec3};

/// Maximum number of vertices that a start or goal is attached to at first.
pub(crate) const ATTACHMENTS: usize = 6;
/// Maximum number if no path joins the first attachments.
pub(crate) const MORE_ATTACHMENTS: usize = 48;

/// Least limit on the climb of the leg to a goal, m: the height of a double jump with the default profile.
const LEAST_CLIMB_M: f32 = 5.0;
/// A vertex and the cost of the unproved leg between it and the start or goal, in decisions.
pub(crate) type Attachment = (VertexId, f32);

/// A spatial index of some of a graph's vertices.
#[derive(Debug)]
pub(crate) struct VertexIndex {
    grid: PointGrid,
    /// Positions, m, and ids of the vertices, in the grid's order.
    places: Vec<(Vec3, VertexId)>,
    /// The same positions, axis by axis, followed by [`LANES`] zeros.
    axes: [Vec<f32>; 3],
    /// The least and the greatest height of the vertices, m.
    heights: [f32; 2],
}

/// Whether a leg leads from the attached point or to it.
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

    /// Visits the vertices in square rings around `point`, while `visit` returns true. `visit` gets a lower bound on
    /// the square of the distance of this ring and all further ones, m2, and some of the ring's vertices.
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

    /// Finds the cheapest attachments of `point` among the vertices that `accept` accepts with their legs, in ascending
    /// order of cost: at most `most`, and not much farther away than `reach_m` on the plane. `surcharge` returns what
    /// the leg of a vertex costs in addition, in decisions; `None` if it must not be used.
    pub fn cheapest(
        &self,
        point: Vec3,
        most: usize,
        prices: &LegPrices,
        reach_m: f32,
        direction: Direction,
        (accept, surcharge): (impl Fn(VertexId, Vec3) -> bool, impl Fn(VertexId) -> Option<f32>),
    ) -> Vec<Attachment> {
        let mut best = Cheapest { entries: Vec::with_capacity(most + 1), most, prices, reach_m, limit_m: reach_m };
        // Vertices that may be among the cheapest wait until there are enough of them to be priced together.
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
                            best.insert(&mut waiting, &surcharge);
                        }
                    }
                }
            });
            best.insert(&mut waiting, &surcharge);
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
    /// Adds a vertex with its leg. Returns true if there is no room for another one.
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
    /// Prices the waiting vertices and keeps the cheapest. Only legs that may be among them are asked for surcharges.
    fn insert(&mut self, waiting: &mut Waiting, surcharge: impl Fn(VertexId) -> Option<f32>) {
        if waiting.count == 0 {
            return;
        }
        let costs = self.prices.of(&waiting.legs);
        for (&vertex, cost) in waiting.vertices[..waiting.count].iter().zip(costs) {
            let place_of = |cost: f32| self.entries.partition_point(|&(_, other)| other <= cost);
            if place_of(cost) >= self.most {
                continue;
            }
            let Some(more) = surcharge(vertex) else { continue };
            let place = place_of(cost + more);
            if place < self.most {
                self.entries.insert(place, (vertex, cost + more));
                self.entries.truncate(self.most);
            }
        }
        waiting.count = 0;
        if let Some(&(_, worst)) = self.entries.get(self.most - 1) {
            self.limit_m = self.reach_m.min(self.prices.metres_below(worst));
        }
    }
}

/// Limits of the unproved leg to a goal. A goal that is beyond them from every vertex is on ground that no vertex leads
/// to, or in the air.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LegLimits {
    /// Greatest length, m.
    pub length_m: f32,
    /// Greatest climb, m.
    climb_m: f32,
}

impl LegLimits {
    /// The length of the longest edge that was proved without devices, but at least `least_length_m`, and the climb
    /// of the highest one, but at least [`LEAST_CLIMB_M`]. Without such edges, both are the range of the leg model.
    pub fn of(graph: &NavGraph, least_length_m: f32) -> Self {
        let range_m = graph.legs().range_m() as f32;
        let is_on_foot = |edge: &&Edge| edge.evidence.bounds.is_some() && edge.evidence.ability <= Ability::DOUBLE_JUMP;
        let offset = |edge: &Edge| graph.position(edge.key.to) - graph.position(edge.key.from);
        let longest =
            |of: fn(Vec3) -> f32| graph.edges().filter(is_on_foot).map(|edge| of(offset(edge))).reduce(f32::max);
        Self {
            length_m: longest(Vec3::length).unwrap_or(range_m).max(least_length_m),
            climb_m: longest(|offset| offset.y).unwrap_or(range_m).max(LEAST_CLIMB_M),
        }
    }

    /// Returns whether a leg with this offset from start to end is within the limits.
    pub fn contains(&self, offset: Vec3) -> bool {
        offset.y <= self.climb_m && offset.length_squared() <= self.length_m * self.length_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Evidence, TryEnd};
    use crate::graph::GraphData;
    use crate::ids::EdgeKey;
    use crate::price::Caution;
    use proptest::prelude::*;

    fn graph(vertices: Vec<Vec3>, edges: Vec<Edge>) -> NavGraph {
        NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap()
    }

    fn place() -> impl Strategy<Value = Vec3> {
        (-90.0..90.0f32, 0.0..20.0f32, -90.0..90.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    /// The price of one leg.
    fn price(prices: &LegPrices, leg: Vec3) -> f32 {
        prices.of(&leg.to_array().map(|axis| [axis; LANES]))[0]
    }

    proptest! {
        #![proptest_config(crate::properties::cases(200))]

        #[test]
        fn attachments_cost_what_the_cheapest_of_all_vertices_cost(
            vertices in prop::collection::vec(place(), 0..150),
            point in place(),
            cell_m in 1.0..30.0f32,
            most in 1..20usize,
            reach_m in prop_oneof![Just(f32::INFINITY), 5.0..60.0f32],
            is_away in any::<bool>(),
            surcharge in prop_oneof![Just(0.0), 1.0..99.0f32],
        ) {
            let graph = graph(vertices, Vec::new());
            let prices = LegPrices::new(graph.legs(), Caution::CAREFUL);
            let holds = |vertex: VertexId| !vertex.0.is_multiple_of(4);
            let accept = |vertex: VertexId, leg: Vec3| !vertex.0.is_multiple_of(7) && leg.y < 9.0;
            let surcharge = |vertex: VertexId| if vertex.0.is_multiple_of(3) { surcharge } else { 0.0 };
            let leg = |vertex| (graph.position(vertex) - point) * if is_away { 1.0 } else { -1.0 };
            let direction = if is_away { Direction::Away } else { Direction::Back };
            let index = VertexIndex::new(&graph, cell_m, holds);
            let rules = (accept, |vertex| Some(surcharge(vertex)));
            let found = index.cheapest(point, most, &prices, reach_m, direction, rules);
            let price = |vertex: VertexId| price(&prices, leg(vertex)) + surcharge(vertex);

            for (vertex, cost) in &found {
                prop_assert!(holds(*vertex) && accept(*vertex, leg(*vertex)));
                prop_assert!((cost - price(*vertex)).abs() < 1.0e-3);
            }
            prop_assert!(found.is_sorted_by(|a, b| a.1 <= b.1) && found.len() <= most);
            let within = |vertex: &VertexId| {
                holds(*vertex) && accept(*vertex, leg(*vertex)) && leg(*vertex).with_y(0.0).length() <= reach_m
            };
            let mut all: Vec<f32> = graph.vertices().filter(within).map(price).collect();
            all.sort_by(f32::total_cmp);
            prop_assert!(found.len() >= all.len().min(most));
            for ((_, cost), least) in found.iter().zip(all) {
                // Vertices a little beyond the reach may be cheaper.
                let is_same = if reach_m.is_finite() { *cost <= least + 0.01 } else { (cost - least).abs() < 0.01 };
                prop_assert!(is_same, "{cost} where {least} is the least");
            }
        }

        #[test]
        fn rings_hold_each_vertex_once_and_none_is_nearer_than_its_bound(
            vertices in prop::collection::vec(place(), 0..100),
            point in place(),
            cell_m in 1.0..30.0f32,
        ) {
            let graph = graph(vertices, Vec::new());
            let (mut seen, mut bounds) = (vec![0; graph.vertex_count()], Vec::new());
            let mut is_beyond = true;
            VertexIndex::new(&graph, cell_m, |_| true).visit_from(point, |bound, vertices| {
                bounds.push(bound);
                for (at, vertex) in vertices {
                    seen[vertex.idx()] += 1;
                    is_beyond &= at.distance_squared(point) >= bound * 0.999 - 0.01;
                }
                true
            });
            prop_assert!(is_beyond && bounds.is_sorted());
            prop_assert!(seen.into_iter().all(|count| count == 1));
        }
    }

    #[test]
    fn legs_reach_as_far_as_edges_on_foot_but_not_as_far_as_devices() {
        let edge = |from: u32, to: u32, ability| {
            let mut evidence = Evidence::default();
            evidence.note(TryEnd::Arrived, 9, ability);
            evidence.widen_bounds(Vec3::ZERO);
            Edge { key: EdgeKey::new(from, to), evidence }
        };
        let vertices = vec![Vec3::ZERO, Vec3::new(40.0, 6.0, 0.0), Vec3::new(300.0, 0.0, 0.0)];
        let edges = vec![edge(0, 1, Ability::JUMP), edge(0, 2, Ability::TELEPORTER)];
        let reach = LegLimits::of(&graph(vertices, edges), 20.0);
        assert!(reach.contains(Vec3::new(40.0, 6.0, 0.0)) && reach.contains(Vec3::new(0.0, -30.0, 0.0)));
        assert!(!reach.contains(Vec3::new(45.0, 0.0, 0.0)) && !reach.contains(Vec3::new(0.0, 6.5, 0.0)));
        // Without edges, the range of the model of legs counts.
        let bare = LegLimits::of(&graph(vec![Vec3::ZERO], Vec::new()), 20.0);
        assert!(bare.contains(Vec3::new(30.0, 0.0, 0.0)) && !bare.contains(Vec3::new(31.0, 0.0, 0.0)));
    }
}
