//! Plans: from a start through proved edges to a goal.
//!
//! Start and goal are joined to several near vertices, each at an estimated price, and one multi-source
//! Dijkstra finds the best total. That differs from the paper, which snaps blindly to the nearest vertex.

use crate::graph::{Ability, NavGraph};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use surefoot_world::{DECISION_SECONDS, Vec3};

/// Vertices that a start or goal is joined to.
const ATTACHMENTS: usize = 6;
/// Metres that a character covers per decision on a leg that nobody has proved.
const METRES_PER_DECISION: f64 = 1.5;
/// Metres that one metre of climb counts for on such a leg.
const CLIMB_FACTOR: f64 = 4.0;
/// Metres that one metre of drop counts for.
const DROP_FACTOR: f64 = 1.0;
/// Factor on the price of a leg that nobody has proved.
const UNPROVED_FACTOR: f64 = 1.6;
/// Up to this distance heading straight for the goal is weighed against the graph, m.
const DIRECT_M: f32 = 20.0;
/// Stands for the start or goal of a query in place of a vertex index.
pub const OFF_GRAPH: u32 = u32::MAX;

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
    /// Expected duration, s.
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
}

impl Plan {
    fn direct(query: &Query, no_path: Option<NoPath>) -> Self {
        let leg = unproved_leg(OFF_GRAPH, OFF_GRAPH, query.start, query.goal);
        Self { waypoints: vec![query.goal], legs: vec![leg], no_path }
    }

    /// Expected duration of all legs, s.
    pub fn seconds(&self) -> f32 {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    /// Estimated chance that every leg succeeds, in [0, 1].
    pub fn chance(&self) -> f32 {
        self.legs.iter().map(|leg| leg.chance).product()
    }
}

/// Cost in decisions of a leg that nobody has proved.
fn unproved_cost(from: Vec3, to: Vec3) -> f64 {
    let horizontal = f64::from((to.x - from.x).hypot(to.z - from.z));
    let climb = f64::from((to.y - from.y).max(0.0));
    let drop = f64::from((from.y - to.y).max(0.0));
    UNPROVED_FACTOR * (horizontal + CLIMB_FACTOR * climb + DROP_FACTOR * drop) / METRES_PER_DECISION
}

fn unproved_leg(from_idx: u32, to_idx: u32, from: Vec3, to: Vec3) -> Leg {
    let decisions = unproved_cost(from, to) / UNPROVED_FACTOR;
    Leg {
        from: from_idx,
        to: to_idx,
        seconds: decisions as f32 * DECISION_SECONDS,
        chance: 1.0 / (1.0 + decisions as f32 / 100.0),
        ability: Ability::Walk,
    }
}

/// The cheapest vertices to walk to from a point (or from which to walk to it, if `towards_point`). Vertices
/// that no proved edge leaves (or reaches) lead nowhere and are left out.
fn attachments(graph: &NavGraph, point: Vec3, towards_point: bool, avoid: &[(u32, u32)]) -> Vec<(u32, f64)> {
    let mut priced: Vec<(u32, f64)> = (0..graph.vertex_count() as u32)
        .filter(|&vertex| if towards_point { graph.is_reached(vertex) } else { graph.is_left(vertex) })
        .filter(|&vertex| !avoid.contains(&if towards_point { (vertex, OFF_GRAPH) } else { (OFF_GRAPH, vertex) }))
        .map(|vertex| {
            let position = graph.position(vertex);
            (vertex, if towards_point { unproved_cost(position, point) } else { unproved_cost(point, position) })
        })
        .collect();
    let by_price = |a: &(u32, f64), b: &(u32, f64)| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0));
    if priced.len() > ATTACHMENTS {
        priced.select_nth_unstable_by(ATTACHMENTS, by_price);
        priced.truncate(ATTACHMENTS);
    }
    priced.sort_unstable_by(by_price);
    priced
}

/// Finds the cheapest plan.
pub fn find_path(graph: &NavGraph, query: &Query) -> Plan {
    let starts = attachments(graph, query.start, false, &query.avoid);
    let goals = attachments(graph, query.goal, true, &query.avoid);
    let path = cheapest(graph, &starts, &goals, &query.avoid);
    let near = query.start.distance(query.goal) <= DIRECT_M && !query.avoid.contains(&(OFF_GRAPH, OFF_GRAPH));
    match path {
        Some((cost, _)) if near && unproved_cost(query.start, query.goal) <= cost => Plan::direct(query, None),
        Some((_, vertices)) => assemble(graph, query, &vertices),
        None if near => Plan::direct(query, None),
        None => Plan::direct(query, Some(explain(graph, &starts, &goals))),
    }
}

/// Dijkstra from all priced starts to the best of all priced goals: total cost and the vertices passed.
///
/// Exact for non-negative costs; property tests hold it against petgraph's Dijkstra.
pub fn cheapest(
    graph: &NavGraph,
    starts: &[(u32, f64)],
    goals: &[(u32, f64)],
    avoid: &[(u32, u32)],
) -> Option<(f64, Vec<u32>)> {
    const NONE: u32 = u32::MAX;
    let count = graph.vertex_count();
    let mut cost = vec![f64::INFINITY; count];
    let mut came_from = vec![NONE; count];
    let mut exit = vec![f64::INFINITY; count];
    for &(vertex, price) in goals {
        exit[vertex as usize] = price;
    }
    let mut heap = BinaryHeap::new();
    for &(vertex, price) in starts {
        if price < cost[vertex as usize] {
            cost[vertex as usize] = price;
            heap.push(Reverse((Cost(price), vertex)));
        }
    }
    let mut best = (f64::INFINITY, NONE);
    while let Some(Reverse((Cost(so_far), vertex))) = heap.pop() {
        if so_far >= best.0 {
            break;
        }
        if so_far > cost[vertex as usize] {
            continue;
        }
        if so_far + exit[vertex as usize] < best.0 {
            best = (so_far + exit[vertex as usize], vertex);
        }
        for edge in graph.edges_from(vertex) {
            let next = so_far + edge.evidence.cost();
            if next < cost[edge.to as usize] && !avoid.contains(&(vertex, edge.to)) {
                cost[edge.to as usize] = next;
                came_from[edge.to as usize] = vertex;
                heap.push(Reverse((Cost(next), edge.to)));
            }
        }
    }
    if best.1 == NONE {
        return None;
    }
    let mut vertices = vec![best.1];
    while came_from[vertices[vertices.len() - 1] as usize] != NONE {
        vertices.push(came_from[vertices[vertices.len() - 1] as usize]);
    }
    vertices.reverse();
    Some((best.0, vertices))
}

/// A cost that can be ordered.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cost(f64);

impl Eq for Cost {}

impl PartialOrd for Cost {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Cost {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

fn assemble(graph: &NavGraph, query: &Query, vertices: &[u32]) -> Plan {
    let first = vertices[0];
    let last = vertices[vertices.len() - 1];
    let mut waypoints = vec![graph.position(first)];
    let mut legs = vec![unproved_leg(OFF_GRAPH, first, query.start, graph.position(first))];
    for pair in vertices.windows(2) {
        let edge = graph
            .edges_from(pair[0])
            .filter(|edge| edge.to == pair[1])
            .min_by(|a, b| a.evidence.cost().total_cmp(&b.evidence.cost()))
            .expect("a path follows edges");
        waypoints.push(graph.position(pair[1]));
        legs.push(Leg {
            from: edge.from,
            to: edge.to,
            seconds: (edge.evidence.decisions_mean() / edge.evidence.chance()) as f32 * DECISION_SECONDS,
            chance: edge.evidence.chance() as f32,
            ability: edge.evidence.ability,
        });
    }
    waypoints.push(query.goal);
    legs.push(unproved_leg(last, OFF_GRAPH, graph.position(last), query.goal));
    Plan { waypoints, legs, no_path: None }
}

fn explain(graph: &NavGraph, starts: &[(u32, f64)], goals: &[(u32, f64)]) -> NoPath {
    if starts.is_empty() {
        return NoPath::StartOffGraph;
    }
    if goals.is_empty() {
        return NoPath::GoalOffGraph;
    }
    let back = goals.iter().any(|&(goal, _)| {
        let seen = graph.reachable_from(goal);
        starts.iter().any(|&(start, _)| seen[start as usize])
    });
    if back { NoPath::OneWay } else { NoPath::DifferentIslands }
}
