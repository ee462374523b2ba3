//! Path search: plans from a start along proved edges to a goal.
//!
//! Start and goal are each attached to several near vertices, at the cost that the graph's [model](crate::legs) of
//! unproved legs estimates, and the plan with the lowest total cost wins. The paper instead snaps to the nearest
//! vertex, which a query may ask for. A [`Router`] looks the path up in hub labels. It searches with A* while there
//! are no labels, and if the path that was looked up uses an avoided or repriced edge, or an ability that the query
//! excludes.

pub(crate) mod adjacency;
mod afar;
pub(crate) mod attach;
pub(crate) mod connectivity;
pub(crate) mod frontier;
pub(crate) mod labels;
pub mod many;
pub mod reach;
pub mod traffic;
mod tree;

use crate::graph::NavGraph;
use crate::grid::spacing;
use crate::ids::{EdgeKey, LegKey, Stop, VertexId};
use crate::legs::LegPrices;
use crate::needs::Needs;
use crate::plan::{Attach, Leg, NoPath, Plan, Query};
use crate::price::{Caution, EdgeCosts};
use crate::search::adjacency::{Adjacency, EdgeIdx};
use crate::search::attach::{ATTACHMENTS, Attachment, Direction, LegLimits, VertexIndex};
use crate::search::connectivity::Closure;
use crate::search::frontier::Frontier;
use crate::search::labels::Labels;
use crate::search::traffic::EdgesBySquare;
pub use crate::search::traffic::Traffic;
use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::{Mutex, OnceLock, PoisonError};
use surefoot_world::{Seconds, Vec3};

/// Greatest distance at which heading straight for the goal is considered as an alternative to the graph, m.
const DIRECT_M: f32 = 20.0;
/// Distance within which a start or goal counts as being at a vertex, m: the distance at which an NPC has reached it.
const AT_VERTEX_M: f32 = 1.0;
/// Default for the largest vertex count at which a router prepares hub labels at once, which takes a few seconds.
pub const DEFAULT_LABEL_LIMIT: usize = 4096;

/// A graph prepared for queries.
#[derive(Debug)]
pub struct Router {
    graph: NavGraph,
    adjacency: Adjacency,
    /// Hub labels, once they are prepared; `None` if a vertex has too many arcs.
    labels: OnceLock<Option<Labels>>,
    /// Which islands lead to which; `None` above 8,192 islands.
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
    /// The prices of the latest query of another caution.
    other_prices: Mutex<Option<(Caution, LegPrices)>>,
    /// Limits of the unproved leg from the last vertex to the goal.
    reach: LegLimits,
    /// Edges that unproved legs must not replace, and the same edges reversed: by first and by second vertex.
    forbidden: [BTreeSet<EdgeKey>; 2],
    /// Mover requirements, for edges that have any.
    needs: HashMap<EdgeKey, Needs>,
    /// The edges that pass each square, computed for the first plan around traffic.
    edges_by_square: OnceLock<EdgesBySquare>,
    /// The vertices on lifts and platforms. Unproved legs lead to or from them only if they begin or end there.
    ride_stops: HashSet<VertexId>,
}

impl Router {
    /// Prepares `graph` for queries. If it has at most `label_limit` vertices, hub labels are prepared at once, on
    /// `thread_count` threads.
    pub fn new(graph: NavGraph, label_limit: usize, thread_count: usize) -> Self {
        let cell_m = spacing(graph.positions());
        let mut metres_per_cost = f32::MIN_POSITIVE;
        for edge in graph.edges() {
            let metres = graph.position(edge.key.from).distance(graph.position(edge.key.to));
            let least_cost = edge.evidence.cost_at(Caution::BOLD) as f32;
            metres_per_cost = metres_per_cost.max(metres / least_cost.max(f32::MIN_POSITIVE));
        }
        let edges_with_needs = graph.edges().filter(|edge| !edge.evidence.needs.is_empty());
        let rides = graph.edges().filter(|edge| edge.evidence.needs.ride.is_some());
        let router = Self {
            needs: edges_with_needs.map(|edge| (edge.key, edge.evidence.needs)).collect(),
            ride_stops: rides.flat_map(|edge| [edge.key.from, edge.key.to]).collect(),
            vertices: VertexIndex::new(&graph, cell_m, |_| true),
            sources: VertexIndex::new(&graph, cell_m, |vertex| graph.has_exit(vertex)),
            targets: VertexIndex::new(&graph, cell_m, |vertex| graph.has_entrance(vertex)),
            prices: LegPrices::new(graph.legs(), Caution::CAREFUL),
            other_prices: Mutex::default(),
            reach: LegLimits::of(&graph, DIRECT_M),
            forbidden: Default::default(),
            closure: Closure::new(graph.connectivity()),
            labels: OnceLock::new(),
            edges_by_square: OnceLock::new(),
            adjacency: Adjacency::new(&graph),
            graph,
            metres_per_cost,
        };
        if router.graph.vertex_count() <= label_limit {
            router.prepare_labels(thread_count);
        }
        router
    }

    /// Prepares hub labels on `thread_count` threads. Until they are ready, plans are searched with A*. A graph of a
    /// hundred thousand vertices takes a minute or two.
    pub fn prepare_labels(&self, thread_count: usize) {
        self.labels.get_or_init(|| Labels::new(&self.adjacency, thread_count));
    }

    /// Whether plans are searched with A* because labels are not prepared.
    pub fn wants_labels(&self) -> bool {
        self.labels.get().is_none()
    }

    /// Returns the size of the hub labels in memory, bytes; 0 without any.
    pub fn labels_bytes(&self) -> usize {
        self.labels().map_or(0, Labels::memory_bytes)
    }

    fn labels(&self) -> Option<&Labels> {
        self.labels.get().and_then(Option::as_ref)
    }

    /// Returns this router for a graph that lacks these edges because designers forbid them. Unproved legs do not
    /// replace them: no leg leads to their second vertex from a start within 1 m of the first one, or from their
    /// first vertex to a goal within 1 m of the second one.
    ///
    /// # Panics
    /// If an edge names a vertex that the graph lacks.
    #[must_use]
    pub fn forbidding(mut self, edges: impl IntoIterator<Item = EdgeKey>) -> Self {
        self.forbid(edges.into_iter().collect());
        self
    }

    /// Sets the edges that unproved legs must not replace; see [`forbidding`](Self::forbidding).
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

    /// Finds the cheapest plan. If there is no path, the plan says why and leads to the reachable vertex nearest to
    /// the goal.
    pub fn find_path(&self, query: &Query) -> Plan {
        self.find_path_at(query, &EdgeCosts::new())
    }

    /// Finds the cheapest plan at current costs. If an edge has become cheaper, the plan may not be the cheapest,
    /// because the labels and the A* heuristic use the costs that the router was made with.
    pub fn find_path_at(&self, query: &Query, repriced: &EdgeCosts) -> Plan {
        if query.attach == Attach::Nearest {
            return self.find_path_between_nearest(query, repriced);
        }
        match self.find(query, |starts, goals| self.join(starts, goals, query, repriced)) {
            Found::Path(path) => self.assemble(query, &path),
            Found::Direct => self.direct(query, None),
            Found::Nothing { starts, goals } => self.plan_from_afar(query, &starts, &goals, repriced),
        }
    }

    /// Decides how to get from the start to the goal. `join` finds the cheapest path between attachments of both.
    fn find(&self, query: &Query, mut join: impl FnMut(&[Attachment], &[Attachment]) -> Option<Path>) -> Found {
        let starts = self.attach_start(query);
        let goals = self.attach_goal(query, ATTACHMENTS);
        let is_near = self.is_near(query);
        match join(&starts, &goals) {
            Some(path) if is_near && self.direct_cost(query) <= path.cost => Found::Direct,
            Some(path) => Found::Path(path),
            None if is_near => Found::Direct,
            None => self.find_widely(query, goals, join),
        }
    }

    /// Whether the goal is so near that a plan may lead straight to it.
    fn is_near(&self, query: &Query) -> bool {
        query.start.distance(query.goal) <= DIRECT_M
            && !query.avoid.contains(&LegKey::DIRECT)
            && !self.closed_from(query.start).iter().any(|&vertex| self.is_at(query.goal, vertex))
    }

    /// Finds the cheapest plan from the vertex nearest to the start to the one nearest to the goal.
    fn find_path_between_nearest(&self, query: &Query, repriced: &EdgeCosts) -> Plan {
        let nearest = |point| self.nearest_vertex(point, |_| true).map(|vertex| (vertex, 0.0));
        let starts: Vec<Attachment> = nearest(query.start).into_iter().collect();
        let goals: Vec<Attachment> = nearest(query.goal).into_iter().collect();
        match self.join(&starts, &goals, query, repriced) {
            Some(path) => self.assemble(query, &path),
            None => self.direct(query, Some(self.explain(query, &starts, &goals))),
        }
    }

    /// The vertex nearest to `point` among those that `accept` accepts.
    fn nearest_vertex(&self, point: Vec3, accept: impl Fn(VertexId) -> bool) -> Option<VertexId> {
        let mut best: Option<(f32, VertexId)> = None;
        self.vertices.visit_from(point, |bound, vertices| {
            if best.is_some_and(|(least, _)| bound > least) {
                return false;
            }
            for &(at, vertex) in vertices {
                let distance = at.distance_squared(point);
                if best.is_none_or(|(least, _)| distance < least) && accept(vertex) {
                    best = Some((distance, vertex));
                }
            }
            true
        });
        best.map(|(_, vertex)| vertex)
    }

    /// Finds the plan of an NPC that gets in others' way, and adds it to their traffic. The plan leads around the
    /// largest crowd that the NPC would meet, if that takes less time than waiting for it.
    pub fn find_path_in(&self, traffic: &mut Traffic, query: &Query, repriced: &EdgeCosts) -> Plan {
        let mut plan = self.find_path_at(query, repriced);
        if let Some(met) = traffic.met_by(query.start, &plan) {
            let edges_by_square = self.edges_by_square.get_or_init(|| EdgesBySquare::new(&self.graph, &self.adjacency));
            let around = self.find_path_at(query, &edges_by_square.delayed(&self.adjacency, met, repriced));
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
        self.join_or([starts, goals], query, repriced, || self.a_star(starts, goals, query, repriced))
    }

    /// The same for attachments of start and goal. `search` finds the path if it cannot be looked up.
    fn join_or(
        &self,
        [starts, goals]: [&[Attachment]; 2],
        query: &Query,
        repriced: &EdgeCosts,
        search: impl FnOnce() -> Option<Path>,
    ) -> Option<Path> {
        if self.labels().is_none() || query.caution != Caution::CAREFUL {
            return search();
        }
        let path = self.look_up_path(starts, goals)?;
        if query.is_usual() && repriced.is_empty() {
            return Some(path);
        }
        let is_usual = |edge: &EdgeIdx| {
            self.is_open(query, *edge) && (repriced.is_empty() || !repriced.contains_key(&self.adjacency.key(*edge)))
        };
        if path.edges.iter().all(is_usual) { Some(path) } else { search() }
    }

    /// Searches the cheapest path between two vertices with A*. Returns its cost in decisions and its vertices.
    pub fn search(&self, from: VertexId, to: VertexId) -> Option<(f32, Vec<VertexId>)> {
        let query = Query::new(self.graph.position(from), self.graph.position(to));
        self.a_star(&[(from, 0.0)], &[(to, 0.0)], &query, &EdgeCosts::new()).map(|path| self.vertices_of(&path))
    }

    /// Looks up the cheapest path between two vertices in hub labels. Returns its cost in decisions and its vertices;
    /// `None` if there is no path, or no labels.
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

    /// Finds the cheapest vertices to walk from to the goal, within the range of the edges that were proved on foot.
    /// Those without incoming edges are left out.
    fn attach_goal(&self, query: &Query, most: usize) -> Vec<Attachment> {
        let closed = self.closed_to(query.goal);
        let is_open = |vertex| !query.avoid.contains(&LegKey { from: Stop::Vertex(vertex), to: Stop::Goal });
        let accept = |vertex, leg| {
            let stays = self.is_boarded(query.goal, vertex);
            is_open(vertex) && !closed.contains(&vertex) && self.reach.contains(leg) && stays
        };
        self.targets.cheapest(query.goal, most, &self.prices(query), self.reach.length_m, Direction::Back, accept)
    }

    /// The prices of unproved legs at the caution of a query.
    fn prices(&self, query: &Query) -> Cow<'_, LegPrices> {
        if query.caution == Caution::CAREFUL {
            return Cow::Borrowed(&self.prices);
        }
        // To tabulate them takes longer than a search.
        let mut latest = self.other_prices.lock().unwrap_or_else(PoisonError::into_inner);
        if latest.as_ref().is_none_or(|(caution, _)| *caution != query.caution) {
            *latest = Some((query.caution, LegPrices::new(self.graph.legs(), query.caution)));
        }
        let (_, prices) = latest.as_ref().expect("just set");
        Cow::Owned(prices.clone())
    }

    /// The vertices to which designers forbid the edge from a vertex at `start`.
    fn closed_from(&self, start: Vec3) -> Vec<VertexId> {
        self.closed_at(start, &self.forbidden[0])
    }

    /// The vertices from which designers forbid the edge to a vertex at `goal`.
    fn closed_to(&self, goal: Vec3) -> Vec<VertexId> {
        self.closed_at(goal, &self.forbidden[1])
    }

    /// The second vertices of the edges of `forbidden` that have their first vertex at `point`.
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
        self.labels()?.path(starts, goals).map(|(cost, first, edges)| Path { cost, first, edges })
    }

    /// Whether an unproved leg may join `point` and a vertex: a ride stop only if `point` is there.
    fn is_boarded(&self, point: Vec3, vertex: VertexId) -> bool {
        self.ride_stops.is_empty() || !self.ride_stops.contains(&vertex) || self.is_at(point, vertex)
    }

    /// The mover requirements of an edge.
    fn needs_of(&self, key: EdgeKey) -> Option<&Needs> {
        if self.needs.is_empty() { None } else { self.needs.get(&key) }
    }

    /// Whether a plan may use an edge: it is [possible](Self::is_possible), and the query does not avoid it.
    fn is_open(&self, query: &Query, edge: EdgeIdx) -> bool {
        self.is_possible(query, edge)
            && (query.avoid.is_empty() || !query.avoid.contains(&self.adjacency.key(edge).into()))
    }

    /// Whether an edge needs no ability that the query excludes, and the movers stand where it needs them.
    fn is_possible(&self, query: &Query, edge: EdgeIdx) -> bool {
        let is_met = |needs: &Needs| needs.are_met(&query.stops);
        (query.without.is_empty() || !query.without.rules_out(self.adjacency.ability(edge)))
            && (query.stops.is_empty() || self.needs_of(self.adjacency.key(edge)).is_none_or(is_met))
    }

    /// Runs A* from all of `starts` to the best of `goals`, attachments included. The heuristic is the straight-line
    /// distance at the graph's greatest distance per cost. It never overestimates, so the path is the cheapest.
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
        // Rounding may lift a lower bound slightly above the true cost.
        while let Some((vertex, so_far)) = frontier.settle(best.0 * (1.0 + 1.0e-5)) {
            let vertex = VertexId(vertex);
            for &(goal, exit) in goals {
                if goal == vertex && so_far + exit < best.0 {
                    best = (so_far + exit, Some(vertex));
                }
            }
            for (edge, to, careful) in self.adjacency.outgoing(vertex) {
                let next = so_far + self.price(query, repriced, edge, careful);
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

    /// The current cost of an edge for a query, in decisions; `careful` is the one for careful queries that the router
    /// was made with.
    fn price(&self, query: &Query, repriced: &EdgeCosts, edge: EdgeIdx, careful: f32) -> f32 {
        let changed = if repriced.is_empty() { None } else { repriced.get(&self.adjacency.key(edge)) };
        match changed {
            Some(cost) => cost.at(query.caution),
            None if query.caution == Caution::CAREFUL => careful,
            None => self.adjacency.cost(edge).at(query.caution),
        }
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
        let mut needs_of_legs = Vec::new();
        let mut last = path.first;
        let mut at = self.graph.position(last);
        waypoints.push(at);
        legs.push(Leg::unproved(model, LegKey { from: Stop::Start, to: Stop::Vertex(last) }, [query.start, at]));
        for &edge in &path.edges {
            let hop = self.adjacency.hop(edge);
            let needs = self.needs_of(EdgeKey { from: last, to: hop.to });
            needs_of_legs.extend(needs.map(|needs| (legs.len(), *needs)));
            (last, at) = (hop.to, hop.end);
            waypoints.push(at);
            legs.push(hop.leg);
        }
        waypoints.push(query.goal);
        legs.push(Leg::unproved(model, LegKey { from: Stop::Vertex(last), to: Stop::Goal }, [at, query.goal]));
        Plan { waypoints, legs, no_path: None, needs: needs_of_legs, nearest: None }
    }
}

/// How to get from a start to a goal.
#[derive(Debug)]
enum Found {
    /// Along a path.
    Path(Path),
    /// Straight.
    Direct,
    /// No path joins these attachments.
    Nothing { starts: Vec<Attachment>, goals: Vec<Attachment> },
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
