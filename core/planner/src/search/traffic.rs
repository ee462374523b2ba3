//! Traffic: where NPCs that get in each other's way are about to be, and how long others wait for them.
//!
//! Each NPC counts once in each square of 2 m that the next stretch of its plan passes. A door that many plans lead
//! through is therefore crowded, whichever edges they use. An NPC that meets a crowd waits until it has passed, or goes
//! around the whole crowd, for example to another door, if that takes less time; a step aside gains nothing. Crowds are
//! counted in steps, and an NPC on its way keeps its plan, so that crowds do not swing between routes.

use crate::graph::NavGraph;
use crate::plan::Plan;
use crate::price::EdgeCosts;
use crate::search::adjacency::{Adjacency, EdgeIdx};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use surefoot_world::{Decisions, Vec3};

/// Side of a square, m.
const SQUARE_M: f32 = 2.0;
/// Height of a square, m.
const STOREY_M: f32 = 4.0;
/// Length of the stretch on which an NPC counts, m: it covers this in about 5 s.
const AHEAD_M: f32 = 40.0;
/// Distance between two sampled places of a stretch, m.
const STRIDE_M: f32 = 1.0;
/// Length of an edge on which it counts as passing squares, m. Longer edges use devices and are not walked.
const PASSING_M: f32 = 200.0;
/// Number of squares on each side of a square that belong to the same crowd.
const AROUND: i32 = 1;
/// NPCs in a square that do not delay each other.
const FREE: u32 = 8;
/// Crowds are counted in steps of this many NPCs.
const STEP: u32 = 8;
/// Time for which each further NPC delays those behind it, decisions: about nine NPCs pass a door of 1.2 m in a second.
const HEADWAY_DECISIONS: f64 = 0.66;

/// A square, and its storey.
type Square = (i32, i32, i32);

fn square(place: Vec3) -> Square {
    // No map is so large; places far outside share the last square.
    let number = |metres: f32, side: f32| (metres / side).floor().clamp(-1.0e6, 1.0e6) as i32;
    (number(place.x, SQUARE_M), number(place.y, STOREY_M), number(place.z, SQUARE_M))
}

/// Calls `pass` with places on the straight lines between the places of `way`, up to `most` metres from the first.
fn walk(way: impl Iterator<Item = Vec3>, most: f32, mut pass: impl FnMut(Vec3)) {
    let mut left = most;
    let mut last: Option<Vec3> = None;
    for place in way {
        let from = last.replace(place).unwrap_or(place);
        let length = from.distance(place).min(left);
        let direction = (place - from).normalize_or_zero();
        for stride in 0..=(length / STRIDE_M) as u32 {
            pass(from + direction * (stride as f32 * STRIDE_M));
        }
        left -= length;
        if left <= 0.0 {
            return;
        }
    }
    if let Some(end) = last {
        pass(end);
    }
}

/// The position of the NPC, and the waypoints of its plan from leg `leg` on.
fn way(feet: Vec3, plan: &Plan, leg: usize) -> impl Iterator<Item = Vec3> {
    std::iter::once(feet).chain(plan.waypoints.iter().skip(leg).copied())
}

/// A crowd on the route of a plan.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CrowdAhead {
    square: Square,
    /// How long an NPC waits for the crowd.
    pub delay: Decisions,
}

/// The number of NPCs that are about to be in each square.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Traffic {
    npcs: BTreeMap<Square, u32>,
}

impl Traffic {
    /// Adds an NPC at `feet`, m, that follows a plan from its leg `leg` on.
    pub fn add_plan(&mut self, feet: Vec3, plan: &Plan, leg: usize) {
        let mut passed = BTreeSet::new();
        walk(way(feet, plan, leg), AHEAD_M, |place| _ = passed.insert(square(place)));
        passed.into_iter().for_each(|square| self.add(square, 1));
    }

    /// Adds a crowd: `npcs` NPCs in the square around `place`, m.
    pub fn add_crowd(&mut self, place: Vec3, npcs: u32) {
        self.add(square(place), npcs);
    }

    fn add(&mut self, square: Square, npcs: u32) {
        let count = self.npcs.entry(square).or_default();
        *count = count.saturating_add(npcs);
    }

    /// The crowds, the largest first: the middle of each one's densest square, m, and the number of NPCs.
    pub fn crowds(&self) -> Vec<(Vec3, u32)> {
        let middle = |&(x, storey, z): &Square| {
            Vec3::new(x as f32 * SQUARE_M, storey as f32 * STOREY_M, z as f32 * SQUARE_M)
                + Vec3::new(0.5 * SQUARE_M, 0.5 * STOREY_M, 0.5 * SQUARE_M)
        };
        let mut crowds: Vec<(Vec3, u32)> = self.densest().map(|(square, npcs)| (middle(square), *npcs)).collect();
        crowds.sort_by_key(|(_, npcs)| std::cmp::Reverse(*npcs));
        crowds
    }

    /// The largest crowd that an NPC at `feet`, m, meets on a plan.
    pub(crate) fn met_by(&self, feet: Vec3, plan: &Plan) -> Option<CrowdAhead> {
        let mut met: Option<(u32, Square)> = None;
        walk(way(feet, plan, 0), AHEAD_M, |place| {
            let square = square(place);
            let npcs = self.npcs.get(&square).copied().unwrap_or(0);
            if met.is_none_or(|(most, _)| npcs > most) {
                met = Some((npcs, square));
            }
        });
        let (npcs, square) = met?;
        delay(npcs).map(|delay| CrowdAhead { square, delay })
    }

    /// The squares in which crowds are densest, with their NPCs.
    fn densest(&self) -> impl Iterator<Item = (&Square, &u32)> {
        self.npcs.iter().filter(|(square, npcs)| delay(**npcs).is_some() && self.is_densest(**square, **npcs))
    }

    /// Whether no square around it has more NPCs; of equal ones, the first counts.
    fn is_densest(&self, square: Square, npcs: u32) -> bool {
        around(square).filter(|other| *other != square).all(|other| {
            let others = self.npcs.get(&other).copied().unwrap_or(0);
            others < npcs || (others == npcs && other > square)
        })
    }
}

/// The squares within [`AROUND`] of one.
fn around((x, storey, z): Square) -> impl Iterator<Item = Square> {
    (-AROUND..=AROUND).flat_map(move |dx| (-AROUND..=AROUND).map(move |dz| (x + dx, storey, z + dz)))
}

/// Time that an NPC waits for a crowd; `None` if the crowd is too small to delay others.
fn delay(npcs: u32) -> Option<Decisions> {
    let steps = npcs.saturating_sub(FREE) / STEP;
    (steps > 0).then(|| Decisions(f64::from(steps) * f64::from(STEP) * HEADWAY_DECISIONS))
}

/// The edges that pass each square.
#[derive(Debug)]
pub(crate) struct EdgesBySquare(HashMap<Square, Vec<EdgeIdx>>);

impl EdgesBySquare {
    pub fn new(graph: &NavGraph, adjacency: &Adjacency) -> Self {
        let mut edges: HashMap<Square, Vec<EdgeIdx>> = HashMap::new();
        for vertex in graph.vertices() {
            for (edge, to, _) in adjacency.outgoing(vertex) {
                let ends = [graph.position(vertex), graph.position(to)];
                walk(ends.into_iter(), PASSING_M, |place| {
                    let passing = edges.entry(square(place)).or_default();
                    if passing.last() != Some(&edge) {
                        passing.push(edge);
                    }
                });
            }
        }
        Self(edges)
    }

    /// `costs` with the delay of a crowd on every edge that passes it: the cheapest path goes around the crowd if
    /// that takes less time.
    pub fn delayed(&self, adjacency: &Adjacency, crowd: CrowdAhead, costs: &EdgeCosts) -> EdgeCosts {
        let passing: BTreeSet<&EdgeIdx> =
            around(crowd.square).filter_map(|square| self.0.get(&square)).flatten().collect();
        let mut costs = costs.clone();
        for &edge in passing {
            let key = adjacency.key(edge);
            let cost = costs.get(&key).copied().unwrap_or_else(|| adjacency.cost(edge));
            costs.insert(key, cost.delayed(crowd.delay));
        }
        costs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Evidence;
    use crate::graph::{Edge, GraphData};
    use crate::ids::EdgeKey;
    use crate::plan::Query;
    use crate::search::Router;
    use proptest::prelude::*;

    fn graph(vertices: Vec<Vec3>, edges: &[(u32, u32, f64)]) -> NavGraph {
        let edges = edges.iter().map(|&(from, to, decisions)| Edge {
            key: EdgeKey::new(from, to),
            evidence: Evidence::forced(Decisions(decisions)),
        });
        NavGraph::check(GraphData { vertices, edges: edges.collect(), ..GraphData::default() }).unwrap()
    }

    fn place() -> impl Strategy<Value = Vec3> {
        (-30.0..30.0f32, 0.0..9.0f32, -30.0..30.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    /// The places on the straight lines between the places of a way, every millimetre, up to `most` metres from the
    /// first.
    fn closely(way: &[Vec3], most: f32) -> Vec<Vec3> {
        let mut places = vec![way[0]];
        let mut gone = 0.0;
        for pair in way.windows(2) {
            let length = pair[0].distance(pair[1]);
            let steps = (length * 1000.0) as u32;
            let on_line = (0..=steps).map(|step| pair[0] + (pair[1] - pair[0]) * (step as f32 / steps.max(1) as f32));
            places.extend(on_line.take_while(|at| gone + pair[0].distance(*at) <= most));
            gone += length;
        }
        places
    }

    proptest! {
        #![proptest_config(crate::properties::cases(100))]

        #[test]
        fn a_walk_visits_every_metre_of_a_way_and_nothing_else(
            way in prop::collection::vec(place(), 1..6),
            most in 5.0..90.0f32,
        ) {
            let mut visited = Vec::new();
            walk(way.iter().copied(), most, |place| visited.push(place));
            let close = closely(&way, most);
            for at in &visited {
                prop_assert!(close.iter().any(|other| other.distance(*at) < 0.01), "{at} is not on the way");
            }
            for at in &close {
                prop_assert!(visited.iter().any(|other| other.distance(*at) <= STRIDE_M + 0.01), "{at} is left out");
            }
        }

        #[test]
        fn an_npc_counts_once_in_each_square_that_it_is_about_to_pass(
            ways in prop::collection::vec(prop::collection::vec(place(), 1..5), 1..12),
        ) {
            let mut traffic = Traffic::default();
            let mut expected: BTreeMap<Square, u32> = BTreeMap::new();
            for way in &ways {
                let plan = Plan { waypoints: way[1..].to_vec(), ..Plan::straight(Vec3::ZERO) };
                traffic.add_plan(way[0], &plan, 0);
                let mut squares = BTreeSet::new();
                walk(way.iter().copied(), AHEAD_M, |place| _ = squares.insert(square(place)));
                squares.into_iter().for_each(|square| *expected.entry(square).or_default() += 1);
            }
            prop_assert_eq!(&traffic.npcs, &expected);
            // What is met is the most crowded square of a way, if it is crowded at all.
            let plan = Plan { waypoints: ways[0][1..].to_vec(), ..Plan::straight(Vec3::ZERO) };
            traffic.add_crowd(ways[0][ways[0].len() - 1], 40);
            let mut most = 0;
            walk(ways[0].iter().copied(), AHEAD_M, |place| most = most.max(traffic.npcs[&square(place)]));
            let met = traffic.met_by(ways[0][0], &plan);
            prop_assert_eq!(met.map(|met| met.delay), delay(most));
            prop_assert_eq!(met.map(|met| traffic.npcs[&met.square]), delay(most).map(|_| most));
        }

        #[test]
        fn a_crowd_delays_the_edges_that_pass_it_and_no_others(
            vertices in prop::collection::vec(place(), 12),
            ends in prop::collection::btree_set((0..12u32, 0..12u32), 0..30),
            crowd in place(),
        ) {
            let ends = ends.into_iter().filter(|(from, to)| from != to);
            let edges: Vec<(u32, u32, f64)> = ends.map(|(from, to)| (from, to, 7.0)).collect();
            let graph = graph(vertices, &edges);
            let adjacency = Adjacency::new(&graph);
            let met = CrowdAhead { square: square(crowd), delay: Decisions(12.0) };
            let costs = EdgesBySquare::new(&graph, &adjacency).delayed(&adjacency, met, &EdgeCosts::new());
            for edge in graph.edges() {
                let mut passes = false;
                let ends = [edge.key.from, edge.key.to].map(|end| graph.position(end));
                let is_near = |place| around(met.square).any(|near| near == square(place));
                walk(ends.into_iter(), f32::INFINITY, |place| passes |= is_near(place));
                let expected = passes.then(|| edge.evidence.edge_cost().delayed(met.delay));
                prop_assert_eq!(costs.get(&edge.key).copied(), expected);
            }
        }
    }

    #[test]
    fn the_longest_edges_pass_a_bounded_number_of_squares() {
        let graph = graph(vec![Vec3::ZERO, Vec3::new(9999.0, 0.0, 0.0)], &[(0, 1, 50.0), (1, 0, 50.0)]);
        let passing = EdgesBySquare::new(&graph, &Adjacency::new(&graph));
        assert!(passing.0.len() <= 2 * (PASSING_M / SQUARE_M) as usize + 4, "{} squares", passing.0.len());
    }

    #[test]
    fn a_plan_goes_around_a_crowd_if_that_takes_less_time_than_waiting() {
        let vertices = [[0.0, 0.0], [80.0, 0.0], [40.0, 40.0]].map(|[x, z]| Vec3::new(x, 0.0, z)).to_vec();
        let router = Router::new(graph(vertices.clone(), &[(0, 1, 40.0), (0, 2, 35.0), (2, 1, 35.0)]), 64, 1);
        let query = Query::new(vertices[0], vertices[1] + Vec3::X);
        let passes = |npcs: u32| {
            let mut traffic = Traffic::default();
            traffic.add_crowd(Vec3::new(20.0, 0.0, 0.0), npcs);
            let plan = router.find_path_in(&mut traffic, &query, &EdgeCosts::new());
            plan.legs.iter().filter_map(|leg| leg.key.edge()).map(|key| (key.from.0, key.to.0)).collect::<Vec<_>>()
        };
        assert_eq!(passes(FREE), [(0, 1)]);
        assert_eq!(passes(FREE + STEP), [(0, 1)], "a step aside gains nothing");
        assert_eq!(passes(400), [(0, 2), (2, 1)]);
    }

    #[test]
    fn places_that_no_map_has_share_the_last_square() {
        let mut traffic = Traffic::default();
        for far in [Vec3::splat(f32::MAX), Vec3::splat(f32::MIN), Vec3::new(f32::NAN, f32::INFINITY, 0.0)] {
            traffic.add_crowd(far, u32::MAX);
            traffic.add_crowd(far, u32::MAX);
            assert!(traffic.met_by(far, &Plan::straight(Vec3::ZERO)).is_some());
        }
        assert!(!traffic.crowds().is_empty());
    }
}
