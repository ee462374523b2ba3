//! What zones add to the edges of a graph and to the unproved legs of a query.
//!
//! The surcharges of all edges are computed once for each set of zones, and kept for the sets that queries used last.
//! Only queries that start in a zone that they must not enter differ from others with the same set: legs that begin in
//! that zone may lead out of it.

use crate::graph::NavGraph;
use crate::plan::Query;
use crate::price::EdgeCosts;
use crate::search::adjacency::{Adjacency, EdgeIdx};
use crate::search::labels::Labels;
use crate::zones::{Zone, ZoneMask, Zones, ZonesKey};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use surefoot_world::{Aabb, Ability, Seconds, Vec3};

/// Price of the way out of a zone that plans must not enter, in seconds per metre.
const WAY_OUT: f32 = 5.0;
/// Most surcharges that are kept; at least those of two sets are. Further sets replace the oldest.
const MAX_SURCHARGES: usize = 4 << 20;
/// Most sets that are kept.
const MAX_SETS: usize = 32;
/// Number of queries with a set after which hub labels are worth their preparation.
const LABELS_AFTER: u32 = 64;
/// Distance from a start or goal within which its zones are selected once, m. Longer legs consider all zones.
const NEAR_M: f32 = 40.0;

/// A set of zones on a graph, for NPCs that the same zones bind.
#[derive(Debug)]
pub(crate) struct Zoned {
    key: ZonesKey,
    zones: Zones,
    /// What each edge costs in addition, in decisions; infinite if no plan may use it.
    surcharges: Vec<f32>,
    /// Hub labels of the graph with these surcharges, once they are prepared.
    labels: OnceLock<Option<Labels>>,
    use_count: AtomicU32,
}

impl Zoned {
    fn new(graph: &NavGraph, adjacency: &Adjacency, zones: &Zones, key: ZonesKey) -> Self {
        let (labels, use_count) = (OnceLock::new(), AtomicU32::new(0));
        let mut zoned = Self { key, zones: zones.clone(), surcharges: Vec::new(), labels, use_count };
        let mut surcharges = Vec::new();
        for vertex in graph.vertices() {
            let from = graph.position(vertex);
            let ends = adjacency.outgoing(vertex).map(|(_, to, _)| graph.position(to));
            let near = zoned.touching(ends.map(Aabb::at).fold(Aabb::at(from), Aabb::union));
            surcharges.extend(adjacency.outgoing(vertex).map(|(edge, to, _)| {
                let to = graph.position(to);
                let of_leg = |leg| zoned.surcharge(near.iter().copied(), leg);
                if near.is_empty() {
                    0.0
                } else if adjacency.ability(edge) == Ability::TELEPORTER {
                    // Nothing between its ends is passed.
                    of_leg([from, from]) + of_leg([to, to])
                } else {
                    of_leg([from, to])
                }
            }));
        }
        zoned.surcharges = surcharges;
        zoned
    }

    /// The binding zones that touch a box.
    fn touching(&self, extent: Aabb) -> Vec<usize> {
        let bounds = self.zones.bounds().iter().enumerate();
        bounds
            .filter(|(idx, bounds)| bounds.touches(extent) && self.key.binding.contains(*idx))
            .map(|it| it.0)
            .collect()
    }

    /// What some zones add to the cost of a leg, in decisions; infinite if one of them bars it.
    fn surcharge(&self, zones: impl Iterator<Item = usize>, leg: [Vec3; 2]) -> f32 {
        let all = self.zones.all();
        let seconds: f32 = zones.map(|idx| seconds_on(&all[idx], self.key.left.contains(idx), leg)).sum();
        if seconds == 0.0 { 0.0 } else { Seconds(seconds).decisions().0 as f32 }
    }

    /// What the zones add to the cost of an edge, in decisions; infinite if no plan may use it.
    pub fn on_edge(&self, edge: EdgeIdx) -> f32 {
        self.surcharges[edge as usize]
    }

    /// Hub labels with these surcharges, once they are prepared.
    pub fn labels(&self) -> Option<&Labels> {
        self.labels.get().and_then(Option::as_ref)
    }

    /// Whether hub labels are worth their preparation.
    fn wants_labels(&self) -> bool {
        let is_common = self.key.left.is_empty() && self.use_count.load(Ordering::Relaxed) >= LABELS_AFTER;
        is_common && self.labels.get().is_none()
    }
}

/// Seconds that a zone adds to a leg; infinite if the zone bars it.
fn seconds_on(zone: &Zone, is_left: bool, [from, to]: [Vec3; 2]) -> f32 {
    let Some(metres) = zone.shape.length_inside(from, to) else { return 0.0 };
    match zone.price() {
        Some(price) => price * metres,
        None if is_left && zone.shape.contains(from) => WAY_OUT * metres,
        None => f32::INFINITY,
    }
}

/// The sets of zones that queries used last, the newest last.
#[derive(Debug, Default)]
pub(crate) struct ZonedSets(RwLock<VecDeque<Arc<Zoned>>>);

impl ZonedSets {
    fn get(&self, graph: &NavGraph, adjacency: &Adjacency, zones: &Zones, key: ZonesKey) -> Arc<Zoned> {
        let known = |sets: &VecDeque<Arc<Zoned>>| sets.iter().find(|zoned| zoned.key == key).cloned();
        let found = known(&self.0.read().unwrap_or_else(PoisonError::into_inner));
        let zoned = found.unwrap_or_else(|| {
            let made = Arc::new(Zoned::new(graph, adjacency, zones, key));
            let mut sets = self.0.write().unwrap_or_else(PoisonError::into_inner);
            let most = (MAX_SURCHARGES / made.surcharges.len().max(1)).clamp(2, MAX_SETS);
            let surplus = (sets.len() + 1).saturating_sub(most);
            sets.drain(..surplus);
            sets.push_back(made.clone());
            made
        });
        if zoned.use_count.load(Ordering::Relaxed) < LABELS_AFTER {
            zoned.use_count.fetch_add(1, Ordering::Relaxed);
        }
        zoned
    }

    /// The sets for which hub labels are worth their preparation.
    fn wanting_labels(&self) -> Vec<Arc<Zoned>> {
        let sets = self.0.read().unwrap_or_else(PoisonError::into_inner);
        sets.iter().filter(|zoned| zoned.wants_labels()).cloned().collect()
    }

    pub fn want_labels(&self) -> bool {
        self.0.read().unwrap_or_else(PoisonError::into_inner).iter().any(|zoned| zoned.wants_labels())
    }

    /// Prepares hub labels for the sets that want them, on `thread_count` threads.
    pub fn prepare_labels(&self, adjacency: &Adjacency, thread_count: usize) {
        for zoned in self.wanting_labels() {
            zoned.labels.get_or_init(|| Labels::new(adjacency, &zoned.surcharges, thread_count));
        }
    }

    /// Adds to a query the current costs of edges and what its zones cost.
    pub fn search<'a>(
        &self,
        graph: &NavGraph,
        adjacency: &Adjacency,
        query: &'a Query,
        repriced: &'a EdgeCosts,
    ) -> Search<'a> {
        let zones = &query.zones;
        let plain = Search { query, repriced, zones: None };
        if zones.is_empty() {
            return plain;
        }
        let binding = zones.binding(&query.tags);
        if binding.is_empty() {
            return plain;
        }
        let (at_start, at_goal) = (Nearby::new(zones, binding, query.start), Nearby::new(zones, binding, query.goal));
        let closed = |nearby: &Nearby, place| -> Vec<usize> {
            let all = zones.all();
            let is_inside = |idx: &usize| all[*idx].price().is_none() && all[*idx].shape.contains(place);
            nearby.zones.iter().copied().filter(is_inside).collect()
        };
        let mut left = ZoneMask::default();
        closed(&at_start, query.start).into_iter().for_each(|idx| left.insert(idx));
        let bars_goal = !closed(&at_goal, query.goal).is_empty();
        let zoned = self.get(graph, adjacency, zones, ZonesKey::new(zones, binding, left));
        Search { zones: Some(QueryZones { zoned, at_start, at_goal, bars_goal }), ..plain }
    }
}

/// The zones near the start or goal of a query.
#[derive(Debug)]
struct Nearby {
    place: Vec3,
    zones: Vec<usize>,
}

impl Nearby {
    fn new(zones: &Zones, binding: ZoneMask, place: Vec3) -> Self {
        let around = Aabb::at(place).widened(NEAR_M);
        let near = zones.bounds().iter().enumerate().filter(|(_, bounds)| bounds.touches(around)).map(|(idx, _)| idx);
        Self { place, zones: near.filter(|idx| binding.contains(*idx)).collect() }
    }
}

/// The zones of a query on a graph.
#[derive(Debug)]
struct QueryZones {
    zoned: Arc<Zoned>,
    at_start: Nearby,
    at_goal: Nearby,
    /// Whether the goal is in a zone that the plan must not enter.
    bars_goal: bool,
}

impl QueryZones {
    /// The surcharge of a leg that begins or ends at the place of `nearby`.
    fn surcharge(&self, nearby: &Nearby, leg: [Vec3; 2]) -> Option<f32> {
        let is_near = leg.iter().all(|end| (*end - nearby.place).abs().max_element() <= NEAR_M);
        let surcharge = if is_near {
            self.zoned.surcharge(nearby.zones.iter().copied(), leg)
        } else {
            let extent = Aabb::at(leg[0]).union(Aabb::at(leg[1]));
            self.zoned.surcharge(self.zoned.touching(extent).into_iter(), leg)
        };
        Some(surcharge).filter(|surcharge| surcharge.is_finite())
    }
}

/// A query, with what edges and unproved legs cost in it.
#[derive(Debug)]
pub(crate) struct Search<'a> {
    pub query: &'a Query,
    /// Current costs of edges.
    pub repriced: &'a EdgeCosts,
    zones: Option<QueryZones>,
}

impl Search<'_> {
    /// The zones on the graph; `None` if none binds the query.
    pub fn zoned(&self) -> Option<&Zoned> {
        self.zones.as_ref().map(|zones| &*zones.zoned)
    }

    /// Whether zones bar the goal.
    pub fn bars_goal(&self) -> bool {
        self.zones.as_ref().is_some_and(|zones| zones.bars_goal)
    }

    /// Whether the start is in a zone that the plan must not enter.
    pub fn leaves_zones(&self) -> bool {
        self.zoned().is_some_and(|zoned| !zoned.key.left.is_empty())
    }

    /// What zones add to the unproved leg from the start to `place`, in decisions; `None` if they bar it.
    pub fn leg_from_start(&self, place: Vec3) -> Option<f32> {
        let Some(zones) = &self.zones else { return Some(0.0) };
        zones.surcharge(&zones.at_start, [self.query.start, place])
    }

    /// What zones add to the unproved leg from `place` to the goal, in decisions; `None` if they bar it.
    pub fn leg_to_goal(&self, place: Vec3) -> Option<f32> {
        let Some(zones) = &self.zones else { return Some(0.0) };
        zones.surcharge(&zones.at_goal, [place, self.query.goal])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Evidence, TryEnd};
    use crate::graph::{Edge, GraphData};
    use crate::ids::{EdgeKey, VertexId};
    use crate::price::EdgeCost;
    use crate::search::Router;
    use crate::search::attach::{ATTACHMENTS, Attachment};
    use crate::zones::{MAX_ZONES, Rule, Shape};
    use proptest::prelude::*;

    const COUNT: u32 = 40;

    fn place() -> impl Strategy<Value = Vec3> {
        (0.0..100.0f32, 0.0..8.0f32, 0.0..90.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    fn zone() -> impl Strategy<Value = Zone> {
        let shape = prop_oneof![
            (place(), 1.0..25.0f32).prop_map(|(low, side)| Shape::Box(Aabb { low, high: low + side })),
            (place(), 1.0..15.0f32).prop_map(|(bottom, radius)| Shape::Cylinder { bottom, radius, height: 9.0 }),
        ];
        let rule = prop_oneof![
            3 => (0.1..20.0f32).prop_map(Rule::Price),
            1 => Just(Rule::Never),
            1 => prop::sample::select(vec!["red", "blue"]).prop_map(|tag| Rule::OnlyWith(tag.to_owned())),
        ];
        let concerns =
            prop::collection::btree_set(prop::sample::select(vec!["red".to_owned(), "lame".to_owned()]), 0..2);
        (shape, rule, concerns).prop_map(|(shape, rule, concerns)| Zone {
            name: "zone".to_owned(),
            shape,
            rule,
            concerns,
        })
    }

    fn graph(edges: &[(u32, u32, u32)], ability: Ability) -> NavGraph {
        let vertices =
            (0..COUNT).map(|idx| Vec3::new((idx * 37 % 101) as f32, (idx * 13 % 7) as f32, (idx * 53 % 89) as f32));
        let mut known = std::collections::BTreeSet::new();
        let once = edges.iter().filter(|(from, to, _)| from != to && known.insert((*from, *to)));
        let edges = once.map(|&(from, to, decisions)| {
            let mut evidence = Evidence::default();
            evidence.note(TryEnd::Arrived, decisions, ability);
            Edge { key: EdgeKey::new(from, to), evidence }
        });
        NavGraph::check(GraphData { vertices: vertices.collect(), edges: edges.collect(), ..GraphData::default() })
            .unwrap()
    }

    /// The definition of what zones add to a leg, in decisions; infinite if one of them bars it.
    fn added(query: &Query, [from, to]: [Vec3; 2]) -> f64 {
        let of_zone = |zone: &Zone| {
            let Some(metres) = zone.shape.length_inside(from, to) else { return 0.0 };
            match zone.rule {
                Rule::Price(price) => f64::from(price * metres),
                _ if zone.shape.contains(query.start) && zone.shape.contains(from) => f64::from(WAY_OUT * metres),
                _ => f64::INFINITY,
            }
        };
        query.zones.iter().filter(|zone| zone.binds(&query.tags)).map(of_zone).sum::<f64>() * 6.0
    }

    /// Costs from the nearest of `starts` to all vertices, relaxed until nothing changes.
    fn costs(graph: &NavGraph, query: &Query, starts: &[Attachment]) -> Vec<f64> {
        let mut costs = vec![f64::INFINITY; COUNT as usize];
        starts.iter().for_each(|(vertex, cost)| costs[vertex.idx()] = f64::from(*cost));
        for _ in 0..COUNT {
            for Edge { key, evidence } in graph.edges() {
                let ends = [key.from, key.to].map(|end| graph.position(end));
                let next = costs[key.from.idx()] + evidence.cost() + added(query, ends);
                costs[key.to.idx()] = costs[key.to.idx()].min(next);
            }
        }
        costs
    }

    proptest! {
        #![proptest_config(crate::properties::cases(300))]

        #[test]
        fn a_path_costs_what_dijkstra_finds_on_the_filtered_and_repriced_graph(
            edges in prop::collection::vec((0..COUNT, 0..COUNT, 1..60u32), 20..250),
            zones in prop::collection::vec(zone(), 0..12),
            (start, goal) in (place(), place()),
            tags in prop::collection::btree_set(prop::sample::select(vec!["red".to_owned(), "lame".to_owned()]), 0..3),
        ) {
            let graph = graph(&edges, Ability::WALK);
            let query = Query { zones: Zones::new(zones), tags, ..Query::new(start, goal) };
            let repriced = EdgeCosts::new();
            for is_labelled in [false, true] {
                let router = Router::new(graph.clone(), if is_labelled { 4096 } else { 0 }, 1);
                for has_zone_labels in [false, is_labelled] {
                    let search = router.search_for(&query, &repriced);
                    if let Some(zoned) = search.zoned().filter(|_| has_zone_labels) {
                        zoned.labels.get_or_init(|| Labels::new(&router.adjacency, &zoned.surcharges, 1));
                    }
                    let starts = router.attach_start(&search);
                    let goals = router.attach_goal(&search, ATTACHMENTS);
                    for (vertex, cost) in &starts {
                        let leg = [start, graph.position(*vertex)];
                        let estimate = graph.legs().estimate(leg[0], leg[1]);
                        let price = estimate.cost_at(query.caution) + added(&query, leg);
                        prop_assert!((f64::from(*cost) - price).abs() < 1.0e-3 * (1.0 + price));
                    }
                    let costs = costs(&graph, &query, &starts);
                    let least = goals.iter().map(|(goal, exit)| costs[goal.idx()] + f64::from(*exit));
                    let least = least.fold(f64::INFINITY, f64::min);
                    match router.join(&starts, &goals, &search) {
                        None => prop_assert!(least == f64::INFINITY, "{least}"),
                        Some(path) => {
                            let cost = f64::from(path.cost);
                            prop_assert!((cost - least).abs() < 1.0e-4 * (1.0 + least), "{cost}, not {least}");
                        }
                    }
                }
            }
        }

        #[test]
        fn no_leg_of_a_plan_leads_into_a_zone_from_outside(
            edges in prop::collection::vec((0..COUNT, 0..COUNT, 1..60u32), 20..250),
            zones in prop::collection::vec(zone(), 1..12),
            (start, goal) in (place(), place()),
        ) {
            let query = Query { zones: Zones::new(zones), ..Query::new(start, goal) };
            let plan = Router::new(graph(&edges, Ability::WALK), 4096, 1).find_path(&query);
            let way: Vec<Vec3> = std::iter::once(start).chain(plan.waypoints).collect();
            prop_assert!(way.windows(2).all(|leg| !query.zones.bars(&query.tags, [leg[0], leg[1]])));
        }
    }

    #[test]
    fn a_teleporter_passes_nothing_between_its_ends() {
        let graph = graph(&[(0, 1, 9), (1, 0, 9)], Ability::TELEPORTER);
        let at = |vertex| graph.position(VertexId(vertex));
        let around = |place| Shape::Box(Aabb::at(place).widened(0.5));
        let surcharges = |shape| {
            let zone = Zone { name: "zone".to_owned(), shape, rule: Rule::Never, concerns: Default::default() };
            let zones = Zones::new([zone]);
            let key = ZonesKey::new(&zones, zones.binding(&Default::default()), ZoneMask::default());
            Zoned::new(&graph, &Adjacency::new(&graph), &zones, key).surcharges
        };
        assert_eq!(surcharges(around((at(0) + at(1)) * 0.5)), [0.0; 2]);
        assert_eq!(surcharges(around(at(1))), [f32::INFINITY; 2]);
    }

    #[test]
    fn sets_of_zones_are_kept_up_to_a_limit_and_labelled_when_they_are_common() {
        let graph = graph(&[(0, 1, 9), (1, 0, 9)], Ability::WALK);
        let router = Router::new(graph, 4096, 1);
        let query = |side: f32| {
            let shape = Shape::Box(Aabb::at(Vec3::ZERO).widened(side));
            let zone = Zone { name: "zone".to_owned(), shape, rule: Rule::Price(2.0), concerns: Default::default() };
            Query { zones: Zones::new(vec![zone; MAX_ZONES + 9]), ..Query::new(Vec3::ONE, Vec3::splat(30.0)) }
        };
        assert_eq!(query(1.0).zones.iter().count(), MAX_ZONES);
        (0..2 * MAX_SETS).for_each(|idx| _ = router.find_path(&query(idx as f32 + 1.0)));
        assert_eq!(router.zoned_sets.0.read().unwrap().len(), MAX_SETS);
        assert!(!router.zones_want_labels(), "each was used once");
        let often = query(1.0);
        let before = router.find_path(&often);
        (0..LABELS_AFTER).for_each(|_| _ = router.find_path(&often));
        assert!(router.zones_want_labels());
        router.prepare_zone_labels(1);
        assert!(!router.zones_want_labels());
        assert_eq!(router.find_path(&often), before);
        let dearer = EdgeCosts::from([(EdgeKey::new(0, 1), EdgeCost { careful: 900.0, by_death: 0.0 })]);
        assert_eq!(router.find_path_at(&often, &dearer).no_path, before.no_path);
    }
}
