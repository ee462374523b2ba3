//! Path search: plans from a start along proved edges to a goal.
//!
//! Start and goal are each attached to several near vertices, at the cost that the graph's [model](crate::legs) of
//! unproved legs estimates, and the plan with the lowest total cost wins. The paper instead snaps to the nearest
//! vertex, which a query may ask for. A [`Router`] looks the path up in hub labels. It searches with A* while there
//! are no labels, and if the path that was looked up uses an avoided or repriced edge, an ability that the query
//! excludes or prices, or an edge on which a zone lies.

pub(crate) mod adjacency;
mod afar;
mod astar;
pub(crate) mod attach;
pub(crate) mod connectivity;
pub(crate) mod frontier;
pub(crate) mod labels;
pub mod many;
pub mod reach;
pub mod traffic;
mod tree;
pub(crate) mod zoned;

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
use crate::search::labels::Labels;
use crate::search::traffic::EdgesBySquare;
pub use crate::search::traffic::Traffic;
use crate::search::zoned::{Search, Zoned, ZonedSets};
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
    /// The zones of recent queries.
    zoned_sets: ZonedSets,
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
            zoned_sets: ZonedSets::default(),
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
        self.labels.get_or_init(|| Labels::new(&self.adjacency, &[], thread_count));
    }

    /// Whether plans are searched with A* because labels are not prepared.
    pub fn wants_labels(&self) -> bool {
        self.labels.get().is_none()
    }

    /// Prepares hub labels for the sets of zones that queries use often, on `thread_count` threads. Until they are
    /// ready, plans that zones divert are searched with A*.
    pub fn prepare_zone_labels(&self, thread_count: usize) {
        if self.zones_want_labels() {
            self.zoned_sets.prepare_labels(&self.adjacency, thread_count);
        }
    }

    /// Whether queries often use a set of zones that has no hub labels. Only graphs with labels of at most
    /// [`DEFAULT_LABEL_LIMIT`] vertices want them.
    pub fn zones_want_labels(&self) -> bool {
        let is_small = self.graph.vertex_count() <= DEFAULT_LABEL_LIMIT;
        is_small && self.labels().is_some() && self.zoned_sets.want_labels()
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
        let search = self.search_for(query, repriced);
        if query.attach == Attach::Nearest && !search.bars_goal() {
            return self.find_path_between_nearest(&search);
        }
        match self.find(&search, |starts, goals| self.join(starts, goals, &search)) {
            Found::Path(path) => self.assemble(query, &path),
            Found::Direct(_) => self.direct(query, None),
            Found::Nothing { starts, goals } => self.plan_from_afar(&search, &starts, &goals),
        }
    }

    /// Decides how to get from the start to the goal. `join` finds the cheapest path between attachments of both.
    fn find(&self, search: &Search<'_>, mut join: impl FnMut(&[Attachment], &[Attachment]) -> Option<Path>) -> Found {
        if search.bars_goal() {
            return Found::Nothing { starts: self.attach_start_widely(search), goals: Vec::new() };
        }
        let starts = self.attach_start(search);
        let goals = self.attach_goal(search, ATTACHMENTS);
        match (join(&starts, &goals), self.direct_cost(search)) {
            (Some(path), Some(cost)) if cost <= path.cost => Found::Direct(cost),
            (Some(path), _) => Found::Path(path),
            (None, Some(cost)) => Found::Direct(cost),
            (None, None) => self.find_widely(search, goals, join),
        }
    }

    /// Adds to a query what edges cost in it.
    fn search_for<'a>(&self, query: &'a Query, repriced: &'a EdgeCosts) -> Search<'a> {
        self.zoned_sets.search(&self.graph, &self.adjacency, query, repriced)
    }

    /// Finds the cheapest plan from the vertex nearest to the start to the one nearest to the goal.
    fn find_path_between_nearest(&self, search: &Search<'_>) -> Plan {
        let query = search.query;
        let is_open_start = |vertex| search.leg_from_start(self.graph.position(vertex)).is_some();
        let is_open_goal = |vertex| search.leg_to_goal(self.graph.position(vertex)).is_some();
        let attach = |vertex: Option<VertexId>| vertex.map(|vertex| (vertex, 0.0)).into_iter().collect();
        let starts: Vec<Attachment> = attach(self.nearest_vertex(query.start, is_open_start));
        let goals: Vec<Attachment> = attach(self.nearest_vertex(query.goal, is_open_goal));
        match self.join(&starts, &goals, search) {
            Some(path) => self.assemble(query, &path),
            None => self.head_straight(search, self.explain(search, &starts, &goals)),
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
    fn join(&self, starts: &[Attachment], goals: &[Attachment], search: &Search<'_>) -> Option<Path> {
        self.join_or([starts, goals], search, |labels| self.a_star(starts, goals, search, labels))
    }

    /// The same for attachments of start and goal. `find` finds the path if it cannot be looked up; it gets the labels
    /// whose paths cost no more than those of the search, if there are any.
    fn join_or(
        &self,
        [starts, goals]: [&[Attachment]; 2],
        search: &Search<'_>,
        find: impl FnOnce(Option<&Labels>) -> Option<Path>,
    ) -> Option<Path> {
        let Search { query, repriced, .. } = search;
        let with_zones = search.zoned().and_then(Zoned::labels);
        let Some(labels) = with_zones.or(self.labels()).filter(|_| query.caution == Caution::CAREFUL) else {
            return find(None);
        };
        let path = Path::look_up(labels, starts, goals)?;
        let zoned = search.zoned().filter(|_| with_zones.is_none());
        if query.is_usual() && repriced.is_empty() && zoned.is_none() {
            return Some(path);
        }
        let is_usual = |edge: &EdgeIdx| {
            self.is_open(search, *edge)
                && (repriced.is_empty() || !repriced.contains_key(&self.adjacency.key(*edge)))
                && zoned.is_none_or(|zoned| zoned.on_edge(*edge) == 0.0)
                && query.prices.of(self.adjacency.ability(*edge)) == 0.0
        };
        if path.edges.iter().all(is_usual) { Some(path) } else { find(Some(labels)) }
    }

    /// Searches the cheapest path between two vertices with A*. Returns its cost in decisions and its vertices.
    pub fn search(&self, from: VertexId, to: VertexId) -> Option<(f32, Vec<VertexId>)> {
        let query = Query::new(self.graph.position(from), self.graph.position(to));
        let repriced = EdgeCosts::new();
        let search = self.search_for(&query, &repriced);
        self.a_star(&[(from, 0.0)], &[(to, 0.0)], &search, None).map(|path| self.vertices_of(&path))
    }

    /// Looks up the cheapest path between two vertices in hub labels. Returns its cost in decisions and its vertices;
    /// `None` if there is no path, or no labels.
    pub fn look_up(&self, from: VertexId, to: VertexId) -> Option<(f32, Vec<VertexId>)> {
        Path::look_up(self.labels()?, &[(from, 0.0)], &[(to, 0.0)]).map(|path| self.vertices_of(&path))
    }

    fn vertices_of(&self, path: &Path) -> (f32, Vec<VertexId>) {
        let passed = path.edges.iter().map(|&edge| self.adjacency.key(edge).to);
        (path.cost, std::iter::once(path.first).chain(passed).collect())
    }

    /// Finds the cheapest vertices to walk to from the start. Those without outgoing edges are left out.
    fn attach_start(&self, search: &Search<'_>) -> Vec<Attachment> {
        let query = search.query;
        let closed = self.closed_from(query.start);
        let accept = |vertex, _| {
            is_start_open(query, vertex) && !closed.contains(&vertex) && self.is_boarded(query.start, vertex)
        };
        let rules = (accept, |vertex| search.leg_from_start(self.graph.position(vertex)));
        self.sources.cheapest(query.start, ATTACHMENTS, &self.prices(query), f32::INFINITY, Direction::Away, rules)
    }

    /// Finds the cheapest vertices to walk from to the goal, within the range of the edges that were proved on foot.
    /// Those without incoming edges are left out.
    fn attach_goal(&self, search: &Search<'_>, most: usize) -> Vec<Attachment> {
        let query = search.query;
        let closed = self.closed_to(query.goal);
        let is_open = |vertex| !query.avoid.contains(&LegKey { from: Stop::Vertex(vertex), to: Stop::Goal });
        let accept = |vertex, leg| {
            let stays = self.is_boarded(query.goal, vertex);
            is_open(vertex) && !closed.contains(&vertex) && self.reach.contains(leg) && stays
        };
        let rules = (accept, |vertex| search.leg_to_goal(self.graph.position(vertex)));
        self.targets.cheapest(query.goal, most, &self.prices(query), self.reach.length_m, Direction::Back, rules)
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

    /// Whether an unproved leg may join `point` and a vertex: a ride stop only if `point` is there.
    fn is_boarded(&self, point: Vec3, vertex: VertexId) -> bool {
        self.ride_stops.is_empty() || !self.ride_stops.contains(&vertex) || self.is_at(point, vertex)
    }

    /// The mover requirements of an edge.
    fn needs_of(&self, key: EdgeKey) -> Option<&Needs> {
        if self.needs.is_empty() { None } else { self.needs.get(&key) }
    }

    /// Whether a plan may use an edge: it is [possible](Self::is_possible), and the query does not avoid it.
    fn is_open(&self, search: &Search<'_>, edge: EdgeIdx) -> bool {
        let avoid = &search.query.avoid;
        self.is_possible(search, edge) && (avoid.is_empty() || !avoid.contains(&self.adjacency.key(edge).into()))
    }

    /// Whether an edge needs no ability that the query excludes, the movers stand where it needs them, and no zone bars
    /// it.
    fn is_possible(&self, search: &Search<'_>, edge: EdgeIdx) -> bool {
        let query = search.query;
        let is_met = |needs: &Needs| needs.are_met(&query.stops);
        (query.without.is_empty() || !query.without.rules_out(self.adjacency.ability(edge)))
            && (query.stops.is_empty() || self.needs_of(self.adjacency.key(edge)).is_none_or(is_met))
            && search.zoned().is_none_or(|zoned| zoned.on_edge(edge).is_finite())
    }

    /// The cost of heading straight for the goal, in decisions; `None` if that is too far or not allowed.
    fn direct_cost(&self, search: &Search<'_>) -> Option<f32> {
        let query = search.query;
        let is_open = query.start.distance(query.goal) <= DIRECT_M
            && !query.avoid.contains(&LegKey::DIRECT)
            && !self.closed_from(query.start).iter().any(|&vertex| self.is_at(query.goal, vertex));
        let surcharge = if is_open { search.leg_to_goal(query.start)? } else { return None };
        let estimate = self.graph.legs().estimate(query.start, query.goal);
        Some(estimate.cost_at(query.caution) as f32 + surcharge)
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
    /// Straight, at this cost in decisions.
    Direct(f32),
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

impl Path {
    /// Looks up the cheapest of all paths from any of `starts` to any of `goals`, attachments included.
    fn look_up(labels: &Labels, starts: &[Attachment], goals: &[Attachment]) -> Option<Self> {
        labels.path(starts, goals).map(|(cost, first, edges)| Self { cost, first, edges })
    }
}

/// Whether the query does not avoid the leg from its start to `vertex`.
fn is_start_open(query: &Query, vertex: VertexId) -> bool {
    !query.avoid.contains(&LegKey { from: Stop::Start, to: Stop::Vertex(vertex) })
}
