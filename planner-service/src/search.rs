//! Plans: from a start through proved edges to a goal.
//!
//! Start and goal are joined to several near vertices, each at the price that the graph's own
//! [model](crate::legs) of unproved legs gives, and the best total wins. That differs from the paper, which snaps
//! blindly to the nearest vertex. A [`Router`] keeps, for graphs that fit, a table of the next hop from every vertex to
//! every other, so that a plan is walked off rather than searched; beyond, and where the table's way is barred, it
//! searches by A*.

use crate::graph::{Ability, Evidence, NavGraph, price};
use crate::grid::PointGrid;
use crate::legs::{Bounds, LegModel};
use crate::table::{Roads, Table};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use surefoot_world::{DECISION_SECONDS, Vec3};

/// Vertices that a start or goal is joined to.
const ATTACHMENTS: usize = 6;
/// Up to this distance heading straight for the goal is weighed against the graph, m.
const DIRECT_M: f32 = 20.0;
/// Stands for the start or goal of a query in place of a vertex index.
pub const OFF_GRAPH: u32 = u32::MAX;
/// Vertices up to which a router keeps a table unless told otherwise: 84 MB at this many.
pub const DEFAULT_TABLE_LIMIT: usize = 4096;

/// What is asked.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    /// From here, m.
    pub start: Vec3,
    /// To here, m.
    pub goal: Vec3,
    /// Legs (from, to) that must not be used; [`OFF_GRAPH`] stands for the start or the goal.
    pub avoid: Vec<(u32, u32)>,
}

/// One leg between two vertices, or between a vertex and the start or goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// Vertex it leaves, or [`OFF_GRAPH`].
    pub from: u32,
    /// Vertex it reaches, or [`OFF_GRAPH`].
    pub to: u32,
    /// Expected duration, failures included, s.
    pub seconds: f32,
    /// Estimated chance of success, in [0, 1].
    pub chance: f32,
    /// Ability it needs.
    pub ability: Ability,
}

/// Why there is no path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoPath {
    /// No vertex near the start has an edge that leaves it.
    StartOffGraph,
    /// No vertex near the goal has an edge that reaches it.
    GoalOffGraph,
    /// No proved path joins them in either direction.
    DifferentIslands,
    /// The goal leads to the start, but not the other way round.
    OneWay,
}

/// The answer to a query: waypoints to head for one after the other, ending with the goal.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Waypoint `i` is where leg `i` ends, m.
    pub waypoints: Vec<Vec3>,
    /// As many as waypoints.
    pub legs: Vec<Leg>,
    /// Why the plan is only to head for the goal directly; `None` for a real path.
    pub no_path: Option<NoPath>,
    /// Where there is no path: the vertex nearest to the goal that can be reached, m.
    pub nearest: Option<Vec3>,
}

impl Plan {
    /// Expected duration of all legs, failures included, s.
    pub fn seconds(&self) -> f32 {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    /// Estimated chance that every leg succeeds, in [0, 1].
    pub fn chance(&self) -> f32 {
        self.legs.iter().map(|leg| leg.chance).product()
    }
}

/// Present prices of edges that have changed since a router was made, in decisions; infinite for barred ones.
pub type Repriced = HashMap<(u32, u32), f32>;

/// A graph made ready to be asked.
#[derive(Debug)]
pub struct Router {
    graph: NavGraph,
    roads: Roads,
    table: Option<Table>,
    /// Vertices that an edge leaves, and those that one reaches.
    left: Shelf,
    reached: Shelf,
    /// Most metres that any edge makes good for one unit of cost.
    metres_per_cost: f32,
    bounds: Bounds,
}

/// Some vertices by place.
#[derive(Debug)]
struct Shelf {
    grid: PointGrid,
    /// Vertices with their places, in the grid's order.
    places: Vec<(Vec3, u32)>,
}

impl Shelf {
    fn new(graph: &NavGraph, cell_m: f32, holds: impl Fn(u32) -> bool) -> Self {
        let vertices: Vec<u32> = (0..graph.vertex_count() as u32).filter(|&vertex| holds(vertex)).collect();
        let positions: Vec<Vec3> = vertices.iter().map(|&vertex| graph.position(vertex)).collect();
        let grid = PointGrid::new(&positions, cell_m);
        let places = grid.order().iter().map(|&idx| (positions[idx as usize], vertices[idx as usize])).collect();
        Self { grid, places }
    }
}

/// The cheapest vertices to attach to, at most [`ATTACHMENTS`], the cheapest first.
type Attached = Vec<(u32, f32)>;

impl Router {
    /// Makes `graph` ready on `thread_count` threads; with a table if it has at most `table_limit` vertices.
    pub fn new(graph: NavGraph, table_limit: usize, thread_count: usize) -> Self {
        let roads = Roads::new(&graph);
        let fits = graph.vertex_count() <= table_limit && roads.fits_table();
        let cell_m = spacing(&graph);
        let positions: Vec<Vec3> = (0..graph.vertex_count() as u32).map(|vertex| graph.position(vertex)).collect();
        let table = fits.then(|| Table::fill(&roads, PointGrid::new(&positions, 2.0 * cell_m).order(), thread_count));
        let mut metres_per_cost = f32::MIN_POSITIVE;
        for edge in graph.edges() {
            let metres = graph.position(edge.from).distance(graph.position(edge.to));
            metres_per_cost = metres_per_cost.max(metres / (edge.evidence.cost() as f32).max(f32::MIN_POSITIVE));
        }
        Self {
            left: Shelf::new(&graph, cell_m, |vertex| graph.is_left(vertex)),
            reached: Shelf::new(&graph, cell_m, |vertex| graph.is_reached(vertex)),
            bounds: graph.legs().bounds(),
            graph,
            roads,
            table,
            metres_per_cost,
        }
    }

    /// The graph.
    pub fn graph(&self) -> &NavGraph {
        &self.graph
    }

    /// Whether plans are walked off a table.
    pub fn has_table(&self) -> bool {
        self.table.is_some()
    }

    /// Finds the cheapest plan.
    pub fn find_path(&self, query: &Query) -> Plan {
        self.find_path_at(query, &Repriced::new())
    }

    /// Finds the cheapest plan where some edges have become dearer, or nearly so where some became cheaper.
    pub fn find_path_at(&self, query: &Query, repriced: &Repriced) -> Plan {
        let starts = self.attach(query, false);
        let goals = self.attach(query, true);
        let near = query.start.distance(query.goal) <= DIRECT_M && !query.avoid.contains(&(OFF_GRAPH, OFF_GRAPH));
        let walked = self.table.as_ref().and_then(|table| self.walk(table, &starts, &goals));
        let is_plain = query.avoid.is_empty() && repriced.is_empty();
        let is_open = |path: &Path| {
            let mut legs = path.roads.iter().map(|&road| self.roads.ends(road));
            is_plain || legs.all(|leg| !query.avoid.contains(&leg) && !repriced.contains_key(&leg))
        };
        let path = match (&self.table, walked) {
            (Some(_), None) => None,
            (Some(_), Some(path)) if is_open(&path) => Some(path),
            _ => self.a_star(&starts, &goals, &query.avoid, repriced),
        };
        match path {
            Some(path) if near && self.direct_cost(query) <= path.cost => self.direct(query, None),
            Some(path) => self.assemble(query, &path),
            None if near => self.direct(query, None),
            None => {
                let reason = self.explain(&starts, &goals);
                Plan { nearest: self.nearest_reachable(&starts, query.goal), ..self.direct(query, Some(reason)) }
            }
        }
    }

    /// The cheapest path between two vertices by A*: its cost and the vertices passed.
    pub fn search(&self, from: u32, to: u32) -> Option<(f32, Vec<u32>)> {
        self.a_star(&[(from, 0.0)], &[(to, 0.0)], &[], &Repriced::new()).map(|path| self.vertices_of(&path))
    }

    /// The same off the table, if there is one.
    pub fn look_up(&self, from: u32, to: u32) -> Option<(f32, Vec<u32>)> {
        self.walk(self.table.as_ref()?, &[(from, 0.0)], &[(to, 0.0)]).map(|path| self.vertices_of(&path))
    }

    fn vertices_of(&self, path: &Path) -> (f32, Vec<u32>) {
        let passed = path.roads.iter().map(|&road| self.roads.ends(road).1);
        (path.cost, std::iter::once(path.first).chain(passed).collect())
    }

    /// The cheapest vertices to walk to from the start (or from which to walk to the goal, if `to_goal`). Vertices that
    /// no proved edge leaves (or reaches) lead nowhere and are left out.
    fn attach(&self, query: &Query, to_goal: bool) -> Attached {
        let (shelf, point) = if to_goal { (&self.reached, query.goal) } else { (&self.left, query.start) };
        let is_barred = |vertex| {
            let leg = if to_goal { (vertex, OFF_GRAPH) } else { (OFF_GRAPH, vertex) };
            query.avoid.contains(&leg)
        };
        let model = self.graph.legs();
        let mut best: Attached = Vec::with_capacity(ATTACHMENTS + 1);
        let mut worst = f32::INFINITY;
        for ring in 0..=shelf.grid.ring_count() {
            let clearance = (ring - 1).max(0) as f32 * shelf.grid.cell_m();
            if self.bounds.from_metres(clearance) > worst {
                break;
            }
            shelf.grid.ring(point, ring, |range| {
                for &(at, vertex) in &shelf.places[range] {
                    if self.bounds.of(at - point) >= worst {
                        continue;
                    }
                    let (from, to) = if to_goal { (at, point) } else { (point, at) };
                    if is_barred(vertex) {
                        continue;
                    }
                    if let Some(cost) = model.price_below(from, to, worst, &self.bounds) {
                        let place = best.partition_point(|&(_, other)| other <= cost);
                        best.insert(place, (vertex, cost));
                        best.truncate(ATTACHMENTS);
                        worst = if best.len() == ATTACHMENTS { best[ATTACHMENTS - 1].1 } else { f32::INFINITY };
                    }
                }
            });
        }
        best
    }

    /// The cheapest of all ways from a start to a goal, off the table.
    fn walk(&self, table: &Table, starts: &[(u32, f32)], goals: &[(u32, f32)]) -> Option<Path> {
        let mut best = (f32::INFINITY, 0, 0);
        for &(goal, exit) in goals {
            for &(start, entry) in starts {
                let cost = entry + table.cost(start, goal) + exit;
                if cost < best.0 {
                    best = (cost, start, goal);
                }
            }
        }
        let (cost, first, goal) = best;
        cost.is_finite().then(|| Path { cost, first, roads: table.way(&self.roads, first, goal) })
    }

    /// A* from all priced starts to the best of all priced goals. Straight-line distance at the graph's best rate
    /// never overestimates what is left, so the path is the cheapest.
    fn a_star(
        &self,
        starts: &[(u32, f32)],
        goals: &[(u32, f32)],
        avoid: &[(u32, u32)],
        repriced: &Repriced,
    ) -> Option<Path> {
        const NONE: u32 = u32::MAX;
        let ends: Vec<(Vec3, f32)> = goals.iter().map(|&(goal, exit)| (self.graph.position(goal), exit)).collect();
        let least_left = |vertex: u32| {
            let at = self.graph.position(vertex);
            ends.iter().map(|(end, exit)| at.distance(*end) / self.metres_per_cost + exit).fold(f32::INFINITY, f32::min)
        };
        let mut cost = vec![f32::INFINITY; self.graph.vertex_count()];
        let mut came_by = vec![NONE; self.graph.vertex_count()];
        let mut is_closed = vec![false; self.graph.vertex_count()];
        let mut open = BinaryHeap::new();
        for &(vertex, price) in starts {
            if price < cost[vertex as usize] {
                cost[vertex as usize] = price;
                open.push(Reverse((Key(price + least_left(vertex)), vertex)));
            }
        }
        let mut best = (f32::INFINITY, NONE);
        while let Some(Reverse((Key(bound), vertex))) = open.pop() {
            // Rounding may put a bound a hair above what it bounds.
            if bound > best.0 * (1.0 + 1.0e-5) {
                break;
            }
            if std::mem::replace(&mut is_closed[vertex as usize], true) {
                continue;
            }
            let so_far = cost[vertex as usize];
            for &(goal, exit) in goals {
                if goal == vertex && so_far + exit < best.0 {
                    best = (so_far + exit, vertex);
                }
            }
            for (road, to, price) in self.roads.leaving(vertex) {
                let leg = (vertex, to);
                let price = if repriced.is_empty() { price } else { *repriced.get(&leg).unwrap_or(&price) };
                let next = so_far + price;
                if next < cost[to as usize] && !avoid.contains(&leg) {
                    cost[to as usize] = next;
                    came_by[to as usize] = road;
                    is_closed[to as usize] = false;
                    open.push(Reverse((Key(next + least_left(to)), to)));
                }
            }
        }
        let (cost, last) = best;
        if last == NONE {
            return None;
        }
        let (mut roads, mut first) = (Vec::new(), last);
        while came_by[first as usize] != NONE {
            let road = came_by[first as usize];
            roads.push(road);
            first = self.roads.ends(road).0;
        }
        roads.reverse();
        Some(Path { cost, first, roads })
    }

    fn direct_cost(&self, query: &Query) -> f32 {
        leg_cost(self.graph.legs(), query.start, query.goal)
    }

    fn direct(&self, query: &Query, no_path: Option<NoPath>) -> Plan {
        let leg = unproved_leg(self.graph.legs(), (OFF_GRAPH, query.start), (OFF_GRAPH, query.goal));
        Plan { waypoints: vec![query.goal], legs: vec![leg], no_path, nearest: None }
    }

    fn assemble(&self, query: &Query, path: &Path) -> Plan {
        let leg_count = path.roads.len() + 2;
        let (mut waypoints, mut legs) = (Vec::with_capacity(leg_count), Vec::with_capacity(leg_count));
        let model = self.graph.legs();
        let mut last = path.first;
        let mut at = self.graph.position(last);
        waypoints.push(at);
        legs.push(unproved_leg(model, (OFF_GRAPH, query.start), (last, at)));
        for &road in &path.roads {
            let leg = self.roads.leg(road);
            last = leg.to;
            at = self.graph.position(last);
            waypoints.push(at);
            legs.push(leg);
        }
        waypoints.push(query.goal);
        legs.push(unproved_leg(model, (last, at), (OFF_GRAPH, query.goal)));
        Plan { waypoints, legs, no_path: None, nearest: None }
    }

    fn explain(&self, starts: &[(u32, f32)], goals: &[(u32, f32)]) -> NoPath {
        if starts.is_empty() {
            return NoPath::StartOffGraph;
        }
        if goals.is_empty() {
            return NoPath::GoalOffGraph;
        }
        let back = goals.iter().any(|&(goal, _)| {
            let seen = self.graph.reachable_from(goal);
            starts.iter().any(|&(start, _)| seen[start as usize])
        });
        if back { NoPath::OneWay } else { NoPath::DifferentIslands }
    }

    fn nearest_reachable(&self, starts: &[(u32, f32)], goal: Vec3) -> Option<Vec3> {
        let mut best: Option<(f32, Vec3)> = None;
        for &(start, _) in starts {
            for (vertex, _) in (0..).zip(self.graph.reachable_from(start)).filter(|&(_, reached)| reached) {
                let at = self.graph.position(vertex);
                let distance = at.distance_squared(goal);
                if best.is_none_or(|(least, _)| distance < least) {
                    best = Some((distance, at));
                }
            }
        }
        best.map(|(_, at)| at)
    }
}

/// A way through the graph.
#[derive(Debug)]
struct Path {
    cost: f32,
    /// Vertex that it begins at.
    first: u32,
    /// Roads taken, in order.
    roads: Vec<u32>,
}

/// A cost that can be ordered.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key(f32);

impl Eq for Key {}

impl PartialOrd for Key {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Key {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Cost in decisions of a leg that nobody has proved.
fn leg_cost(model: &LegModel, from: Vec3, to: Vec3) -> f32 {
    let estimate = model.estimate(from, to);
    price(estimate.decisions, estimate.chance) as f32
}

fn unproved_leg(model: &LegModel, (from, start): (u32, Vec3), (to, end): (u32, Vec3)) -> Leg {
    let estimate = model.estimate(start, end);
    Leg {
        from,
        to,
        seconds: (estimate.decisions / estimate.chance) as f32 * DECISION_SECONDS,
        chance: estimate.chance as f32,
        ability: Ability::Walk,
    }
}

/// The leg along a proved edge.
pub(crate) fn proved_leg(from: u32, to: u32, evidence: &Evidence) -> Leg {
    Leg {
        from,
        to,
        seconds: (evidence.decisions_mean() / evidence.chance()) as f32 * DECISION_SECONDS,
        chance: evidence.chance() as f32,
        ability: evidence.ability,
    }
}

/// Distance between vertices if they were spread evenly, m.
fn spacing(graph: &NavGraph) -> f32 {
    let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for vertex in 0..graph.vertex_count() as u32 {
        (low, high) = (low.min(graph.position(vertex)), high.max(graph.position(vertex)));
    }
    let area = (high.x - low.x).max(1.0) * (high.z - low.z).max(1.0);
    (area / graph.vertex_count().max(1) as f32).sqrt().max(1.0)
}
