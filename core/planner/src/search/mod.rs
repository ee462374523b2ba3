//! Path search: plans from a start along proved edges to a goal.
//!
//! Start and goal are each attached to several near vertices, at the cost that the graph's [model](crate::legs) of
//! unproved legs estimates, and the plan with the lowest total cost wins. The paper instead snaps to the nearest vertex, which a query may ask for.
//! For graphs that are small enough, a [`Router`] keeps a table of the next hop from every vertex to every other, so that
//! a plan is looked up rather than searched; for larger ones it can [prepare hub labels](Router::prepare_labels). It searches with A*
//! where a graph has neither, or where the path that was looked up uses an avoided or repriced edge, or an ability that the
//! query does without.

pub(crate) mod adjacency;
mod afar;
pub(crate) mod attach;
pub(crate) mod connectivity;
pub(crate) mod csr;
pub(crate) mod frontier;
pub(crate) mod labels;
pub(crate) mod table;
pub mod traffic;

use crate::graph::NavGraph;
use crate::grid::{PointGrid, spacing};
use crate::ids::{EdgeKey, LegKey, Stop, VertexId};
use crate::legs::LegPrices;
use crate::needs::Needs;
use crate::plan::{Attach, Leg, NoPath, Plan, Query};
use crate::price::{Caution, EdgeCosts};
use crate::search::adjacency::{Adjacency, EdgeIdx};
use crate::search::attach::{ATTACHMENTS, Attachment, Direction, Reach, VertexIndex};
use crate::search::connectivity::Closure;
use crate::search::frontier::Frontier;
use crate::search::labels::Hierarchy;
use crate::search::table::Table;
use crate::search::traffic::Passing;
pub use crate::search::traffic::Traffic;
use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::OnceLock;
use surefoot_world::{Seconds, Vec3};

/// Greatest distance at which heading straight for the goal is considered as an alternative to the graph, m.
const DIRECT_M: f32 = 20.0;
/// Distance from a vertex within which a start or goal counts as lying at it, m: that at which an NPC has reached it.
const AT_VERTEX_M: f32 = 1.0;
/// Default for the largest vertex count at which a router keeps a table; the table then takes 84 MB.
pub const DEFAULT_TABLE_LIMIT: usize = 4096;

/// A graph prepared for queries.
#[derive(Debug)]
pub struct Router {
    graph: NavGraph,
    adjacency: Adjacency,
    table: Option<Table>,
    /// Hub labels, once they are prepared; none if they cannot be had.
    labels: OnceLock<Option<Hierarchy>>,
    /// Which islands lead to which; none for graphs in crumbs.
    closure: Option<Closure>,
    /// All vertices.
    vertices: VertexIndex,
    /// Vertices with outgoing edges.
    sources: VertexIndex,
    /// Vertices with incoming edges.
    targets: VertexIndex,
    /// The greatest distance that any edge covers per decision of its cost, for plans of any caution, m.
    metres_per_cost: f32,
    prices: LegPrices,
    /// Limits of the unproved leg from the last vertex to the goal.
    reach: Reach,
    /// Edges that unproved legs must not stand in for, and the same edges reversed: by first and by second vertex.
    forbidden: [BTreeSet<EdgeKey>; 2],
    /// What edges hang on, of those that do.
    needs: HashMap<EdgeKey, Needs>,
    /// Which edges pass where, once somebody asks for a plan around traffic.
    passing: OnceLock<Passing>,
    /// The ride_stops on movers, which unproved legs lead to or from only where they begin or end there.
    ride_stops: HashSet<VertexId>,
}

impl Router {
    /// Prepares `graph` for queries on `thread_count` threads; with a table if it has at most `table_limit` vertices.
    pub fn new(graph: NavGraph, table_limit: usize, thread_count: usize) -> Self {
        let adjacency = Adjacency::new(&graph);
        let fits = graph.vertex_count() <= table_limit && adjacency.fits_table();
        let positions: Vec<Vec3> = graph.vertices().map(|vertex| graph.position(vertex)).collect();
        let cell_m = spacing(&positions);
        let table =
            fits.then(|| Table::fill(&adjacency, PointGrid::new(&positions, 2.0 * cell_m).order(), thread_count));
        let mut metres_per_cost = f32::MIN_POSITIVE;
        for edge in graph.edges() {
            let metres = graph.position(edge.key.from).distance(graph.position(edge.key.to));
            let least_cost = edge.evidence.cost_at(Caution::BOLD) as f32;
            metres_per_cost = metres_per_cost.max(metres / least_cost.max(f32::MIN_POSITIVE));
        }
        let hanging = graph.edges().filter(|edge| !edge.evidence.needs.is_empty());
        let rides = graph.edges().filter(|edge| edge.evidence.needs.ride.is_some());
        Self {
            needs: hanging.map(|edge| (edge.key, edge.evidence.needs)).collect(),
            ride_stops: rides.flat_map(|edge| [edge.key.from, edge.key.to]).collect(),
            vertices: VertexIndex::new(&graph, cell_m, |_| true),
            sources: VertexIndex::new(&graph, cell_m, |vertex| graph.has_exit(vertex)),
            targets: VertexIndex::new(&graph, cell_m, |vertex| graph.has_entrance(vertex)),
            prices: LegPrices::new(graph.legs(), Caution::CAREFUL),
            reach: Reach::of(&graph, DIRECT_M),
            forbidden: Default::default(),
            closure: Closure::new(graph.connectivity()),
            labels: OnceLock::new(),
            passing: OnceLock::new(),
            graph,
            adjacency,
            table,
            metres_per_cost,
        }
    }

    /// Prepares hub labels on `thread_count` threads, unless there is a table. Until they are ready, plans are searched with A*. A hundred
    /// thousand vertices take a minute or two.
    pub fn prepare_labels(&self, thread_count: usize) {
        if self.table.is_none() {
            self.labels.get_or_init(|| Hierarchy::new(&self.adjacency, thread_count));
        }
    }

    /// Whether plans are searched with A* until labels are prepared.
    pub fn wants_labels(&self) -> bool {
        self.table.is_none() && self.labels.get().is_none()
    }

    /// Returns the size of the hub labels in memory, bytes; 0 without any.
    pub fn labels_bytes(&self) -> usize {
        self.labels().map_or(0, Hierarchy::memory_bytes)
    }

    fn labels(&self) -> Option<&Hierarchy> {
        self.labels.get().and_then(Option::as_ref)
    }

    /// Whether the cheapest path between any vertices can be looked up.
    fn knows_all(&self) -> bool {
        self.table.is_some() || self.labels().is_some()
    }

    /// The same router, for a graph that lacks these edges because designers forbid them: neither do unproved legs lead along them, from a
    /// start at their first vertex or to a goal at their second one, within 1 m.
    ///
    /// # Panics
    /// If an edge names a vertex that the graph lacks.
    #[must_use]
    pub fn forbidding(mut self, edges: impl IntoIterator<Item = EdgeKey>) -> Self {
        self.forbid(edges.into_iter().collect());
        self
    }

    /// Replaces the edges that unproved legs must not stand in for; see [`forbidding`](Self::forbidding).
    ///
    /// # Panics
    /// If an edge names a vertex that the graph lacks.
    pub fn forbid(&mut self, edges: Vec<EdgeKey>) {
        let count = self.graph.vertex_count();
        assert!(edges.iter().all(|key| key.from.idx() < count && key.to.idx() < count));
        self.forbidden = [edges.iter().copied().collect(), edges.into_iter().map(EdgeKey::reversed).collect()];
    }

    /// Returns the graph.
    pub fn graph(&self) -> &NavGraph {
        &self.graph
    }

    /// Returns whether the router has a table of next hops.
    pub fn has_table(&self) -> bool {
        self.table.is_some()
    }

    /// Finds the cheapest plan. If there is no path, the plan says why and leads to the reachable vertex nearest to the goal.
    pub fn find_path(&self, query: &Query) -> Plan {
        self.find_path_at(query, &EdgeCosts::new())
    }

    /// Finds the cheapest plan at current costs. If an edge has become cheaper, the plan may not be the cheapest, because the
    /// table and the A* heuristic use the costs that the router was made with.
    pub fn find_path_at(&self, query: &Query, repriced: &EdgeCosts) -> Plan {
        if query.attach == Attach::Nearest {
            return self.find_path_between_nearest(query, repriced);
        }
        let starts = self.attach_start(query);
        let goals = self.attach_goal(query, ATTACHMENTS);
        let is_near = query.start.distance(query.goal) <= DIRECT_M
            && !query.avoid.contains(&LegKey::DIRECT)
            && !self.closed_from(query.start).iter().any(|&vertex| self.is_at(query.goal, vertex));
        match self.join(&starts, &goals, query, repriced) {
            Some(path) if is_near && self.direct_cost(query) <= path.cost => self.direct(query, None),
            Some(path) => self.assemble(query, &path),
            None if is_near => self.direct(query, None),
            None => self.plan_from_afar(query, goals, repriced),
        }
    }

    /// Finds the cheapest plan from the vertex nearest to the start to the one nearest to the goal.
    fn find_path_between_nearest(&self, query: &Query, repriced: &EdgeCosts) -> Plan {
        let starts: Vec<Attachment> =
            self.nearest_vertex(query.start).map(|vertex| (vertex, 0.0)).into_iter().collect();
        let goals: Vec<Attachment> = self.nearest_vertex(query.goal).map(|vertex| (vertex, 0.0)).into_iter().collect();
        match self.join(&starts, &goals, query, repriced) {
            Some(path) => self.assemble(query, &path),
            None => self.direct(query, Some(self.explain(query, &starts, &goals))),
        }
    }

    fn nearest_vertex(&self, point: Vec3) -> Option<VertexId> {
        let mut best: Option<(f32, VertexId)> = None;
        self.vertices.visit_from(point, |bound, vertices| {
            if best.is_some_and(|(least, _)| bound > least) {
                return false;
            }
            for &(at, vertex) in vertices {
                let distance = at.distance_squared(point);
                if best.is_none_or(|(least, _)| distance < least) {
                    best = Some((distance, vertex));
                }
            }
            true
        });
        best.map(|(_, vertex)| vertex)
    }

    /// Finds the plan of an NPC that gets in others' way, and adds it to their traffic: around the largest crowd that it would meet, if that
    /// takes less time than waiting for it.
    pub fn find_path_in(&self, traffic: &mut Traffic, query: &Query, repriced: &EdgeCosts) -> Plan {
        let mut plan = self.find_path_at(query, repriced);
        if let Some(met) = traffic.met_by(query.start, &plan) {
            let passing = self.passing.get_or_init(|| Passing::new(&self.graph, &self.adjacency));
            let around = self.find_path_at(query, &passing.delayed(&self.adjacency, met, repriced));
            let wait = traffic.met_by(query.start, &around).map_or(Seconds(0.0), |met| met.delay.seconds());
            if around.no_path == plan.no_path && around.seconds() + wait < plan.seconds() + met.delay.seconds() {
                plan = around;
            }
        }
        traffic.add_plan(query.start, &plan, 0);
        plan
    }

    /// The cheapest path from one of `starts` to one of `goals`.
    fn join(&self, starts: &[Attachment], goals: &[Attachment], query: &Query, repriced: &EdgeCosts) -> Option<Path> {
        if !self.knows_all() || query.caution != Caution::CAREFUL {
            return self.a_star(starts, goals, query, repriced);
        }
        let path = self.look_up_path(starts, goals)?;
        if query.is_usual() && repriced.is_empty() {
            return Some(path);
        }
        let is_usual = |edge: &EdgeIdx| {
            self.is_open(query, *edge) && (repriced.is_empty() || !repriced.contains_key(&self.adjacency.key(*edge)))
        };
        if path.edges.iter().all(is_usual) { Some(path) } else { self.a_star(starts, goals, query, repriced) }
    }

    /// Searches the cheapest path between two vertices with A*. Returns its cost in decisions and its vertices.
    pub fn search(&self, from: VertexId, to: VertexId) -> Option<(f32, Vec<VertexId>)> {
        let query = Query::new(self.graph.position(from), self.graph.position(to));
        self.a_star(&[(from, 0.0)], &[(to, 0.0)], &query, &EdgeCosts::new()).map(|path| self.vertices_of(&path))
    }

    /// Looks up the cheapest path between two vertices in the table or in hub labels. Returns its cost in decisions and its vertices;
    /// `None` if there is no path, or neither.
    pub fn look_up(&self, from: VertexId, to: VertexId) -> Option<(f32, Vec<VertexId>)> {
        self.look_up_path(&[(from, 0.0)], &[(to, 0.0)]).map(|path| self.vertices_of(&path))
    }

    fn vertices_of(&self, path: &Path) -> (f32, Vec<VertexId>) {
        let passed = path.edges.iter().map(|&edge| self.adjacency.key(edge).to);
        (path.cost, std::iter::once(path.first).chain(passed).collect())
    }

    /// Finds the cheapest vertices to walk to from the start. Those without outgoing edges are left out.
    fn attach_start(&self, query: &Query) -> Vec<Attachment> {
        let closed = self.closed_from(query.start);
        let accept = |vertex, _| {
            is_start_open(query, vertex) && !closed.contains(&vertex) && self.is_boarded(query.start, vertex)
        };
        self.sources.cheapest(query.start, ATTACHMENTS, &self.prices(query), f32::INFINITY, Direction::Away, accept)
    }

    /// Finds the cheapest vertices to walk from to the goal. Those without incoming edges are left out, and those farther from
    /// the goal than any character is known to get on foot.
    fn attach_goal(&self, query: &Query, most: usize) -> Vec<Attachment> {
        let closed = self.closed_to(query.goal);
        let is_open = |vertex| !query.avoid.contains(&LegKey { from: Stop::Vertex(vertex), to: Stop::Goal });
        let accept = |vertex, leg| {
            let stays = self.is_boarded(query.goal, vertex);
            is_open(vertex) && !closed.contains(&vertex) && self.reach.contains(leg) && stays
        };
        self.targets.cheapest(query.goal, most, &self.prices(query), self.reach.length_m, Direction::Back, accept)
    }

    /// What unproved legs cost in the plans that a query asks for.
    fn prices(&self, query: &Query) -> Cow<'_, LegPrices> {
        if query.caution == Caution::CAREFUL {
            Cow::Borrowed(&self.prices)
        } else {
            Cow::Owned(LegPrices::new(self.graph.legs(), query.caution))
        }
    }

    /// The vertices to which designers forbid the edge from a vertex at `start`.
    fn closed_from(&self, start: Vec3) -> Vec<VertexId> {
        self.closed_at(start, &self.forbidden[0])
    }

    /// The vertices from which designers forbid the edge to a vertex at `goal`.
    fn closed_to(&self, goal: Vec3) -> Vec<VertexId> {
        self.closed_at(goal, &self.forbidden[1])
    }

    /// The second vertices of those edges of `forbidden` whose first one is at `point`.
    fn closed_at(&self, point: Vec3, forbidden: &BTreeSet<EdgeKey>) -> Vec<VertexId> {
        let mut closed = Vec::new();
        if forbidden.is_empty() {
            return closed;
        }
        self.vertices.visit_from(point, |bound, vertices| {
            for &(_, vertex) in vertices.iter().filter(|(_, vertex)| self.is_at(point, *vertex)) {
                let edges = EdgeKey::new(vertex.0, 0)..=EdgeKey::new(vertex.0, u32::MAX);
                closed.extend(forbidden.range(edges).map(|key| key.to));
            }
            bound <= AT_VERTEX_M * AT_VERTEX_M
        });
        closed
    }

    fn is_at(&self, point: Vec3, vertex: VertexId) -> bool {
        self.graph.position(vertex).distance_squared(point) <= AT_VERTEX_M * AT_VERTEX_M
    }

    /// Looks up the cheapest of all paths from any of `starts` to any of `goals`, attachments included.
    fn look_up_path(&self, starts: &[Attachment], goals: &[Attachment]) -> Option<Path> {
        let Some(table) = &self.table else {
            return self.labels()?.path(starts, goals).map(|(cost, first, edges)| Path { cost, first, edges });
        };
        let mut best = None;
        let mut least = f32::INFINITY;
        for &(goal, exit) in goals {
            for &(start, entry) in starts {
                let cost = entry + table.cost(start, goal) + exit;
                if cost < least {
                    (least, best) = (cost, Some((start, goal)));
                }
            }
        }
        let (first, goal) = best?;
        Some(Path { cost: least, first, edges: table.path(&self.adjacency, first, goal) })
    }

    /// Whether an unproved leg between `point` and a vertex makes sense: to a ride_stop only close by.
    fn is_boarded(&self, point: Vec3, vertex: VertexId) -> bool {
        self.ride_stops.is_empty() || !self.ride_stops.contains(&vertex) || self.is_at(point, vertex)
    }

    /// What an edge hangs on.
    fn needs_of(&self, key: EdgeKey) -> Option<&Needs> {
        if self.needs.is_empty() { None } else { self.needs.get(&key) }
    }

    /// Whether the query neither avoids an edge nor does without its ability, and the movers that it hangs on stand where it needs them.
    fn is_open(&self, query: &Query, edge: EdgeIdx) -> bool {
        self.is_possible(query, edge)
            && (query.avoid.is_empty() || !query.avoid.contains(&self.adjacency.key(edge).into()))
    }

    /// Whether an edge needs no ability that the query does without, and the movers it depends on stand where it needs them.
    fn is_possible(&self, query: &Query, edge: EdgeIdx) -> bool {
        let is_met = |needs: &Needs| needs.are_met(&query.stops);
        (query.without.is_empty() || !query.without.rules_out(self.adjacency.ability(edge)))
            && (query.stops.is_empty() || self.needs_of(self.adjacency.key(edge)).is_none_or(is_met))
    }

    /// Runs A* from all of `starts` to the best of `goals`, attachments included. The heuristic is the straight-line distance
    /// at the graph's greatest distance per cost, which never overestimates, so the path is the cheapest.
    fn a_star(&self, starts: &[Attachment], goals: &[Attachment], query: &Query, repriced: &EdgeCosts) -> Option<Path> {
        if goals.is_empty() {
            // Without a goal, the heuristic would put vertices into no useful order.
            return None;
        }
        let ends: Vec<(Vec3, f32)> = goals.iter().map(|&(goal, exit)| (self.graph.position(goal), exit)).collect();
        let heuristic = |vertex: VertexId| {
            let at = self.graph.position(vertex);
            ends.iter().map(|(end, exit)| at.distance(*end) / self.metres_per_cost + exit).fold(f32::INFINITY, f32::min)
        };
        let mut frontier = Frontier::new(self.graph.vertex_count());
        let mut came_from: Vec<Option<EdgeIdx>> = vec![None; self.graph.vertex_count()];
        for &(vertex, price) in starts {
            frontier.offer_with(vertex.0, price, |cost| cost + heuristic(vertex));
        }
        let mut best: (f32, Option<VertexId>) = (f32::INFINITY, None);
        let is_careful = query.caution == Caution::CAREFUL;
        // Rounding may lift a lower bound slightly above the true cost.
        while let Some((vertex, so_far)) = frontier.settle(best.0 * (1.0 + 1.0e-5)) {
            let vertex = VertexId(vertex);
            for &(goal, exit) in goals {
                if goal == vertex && so_far + exit < best.0 {
                    best = (so_far + exit, Some(vertex));
                }
            }
            for (edge, to, careful) in self.adjacency.outgoing(vertex) {
                let key = EdgeKey { from: vertex, to };
                let changed = if repriced.is_empty() { None } else { repriced.get(&key) };
                let price = match changed {
                    Some(cost) => cost.at(query.caution),
                    None if is_careful => careful,
                    None => self.adjacency.cost(edge).at(query.caution),
                };
                let next = so_far + price;
                if next < frontier.cost(to.0) && self.is_open(query, edge) {
                    frontier.offer_with(to.0, next, |cost| cost + heuristic(to));
                    came_from[to.idx()] = Some(edge);
                }
            }
        }
        let (cost, last) = best;
        let (mut edges, mut first) = (Vec::new(), last?);
        while let Some(edge) = came_from[first.idx()] {
            edges.push(edge);
            first = self.adjacency.key(edge).from;
        }
        edges.reverse();
        Some(Path { cost, first, edges })
    }

    fn direct_cost(&self, query: &Query) -> f32 {
        let estimate = self.graph.legs().estimate(query.start, query.goal);
        estimate.cost_at(query.caution) as f32
    }

    fn direct(&self, query: &Query, no_path: Option<NoPath>) -> Plan {
        let leg = Leg::unproved(self.graph.legs(), LegKey::DIRECT, [query.start, query.goal]);
        Plan { waypoints: vec![query.goal], legs: vec![leg], no_path, needs: Vec::new(), nearest: None }
    }

    fn assemble(&self, query: &Query, path: &Path) -> Plan {
        let leg_count = path.edges.len() + 2;
        let (mut waypoints, mut legs) = (Vec::with_capacity(leg_count), Vec::with_capacity(leg_count));
        let model = self.graph.legs();
        let mut hanging = Vec::new();
        let mut last = path.first;
        let mut at = self.graph.position(last);
        waypoints.push(at);
        legs.push(Leg::unproved(model, LegKey { from: Stop::Start, to: Stop::Vertex(last) }, [query.start, at]));
        for &edge in &path.edges {
            let hop = self.adjacency.hop(edge);
            let needs = self.needs_of(EdgeKey { from: last, to: hop.to });
            hanging.extend(needs.map(|needs| (legs.len(), *needs)));
            (last, at) = (hop.to, hop.end);
            waypoints.push(at);
            legs.push(hop.leg);
        }
        waypoints.push(query.goal);
        legs.push(Leg::unproved(model, LegKey { from: Stop::Vertex(last), to: Stop::Goal }, [at, query.goal]));
        Plan { waypoints, legs, no_path: None, needs: hanging, nearest: None }
    }
}

/// A path through the graph.
#[derive(Debug)]
struct Path {
    /// Cost in decisions, attachments included.
    cost: f32,
    /// First vertex of the path.
    first: VertexId,
    /// Edges of the path, in order.
    edges: Vec<EdgeIdx>,
}

/// Whether the query does not avoid the leg from its start to `vertex`.
fn is_start_open(query: &Query, vertex: VertexId) -> bool {
    !query.avoid.contains(&LegKey { from: Stop::Start, to: Stop::Vertex(vertex) })
}
