//! What an NPC reaches within some time: vertices, and the squares of ground that it passes on the way.

use super::Router;
use super::tree::{Growth, Terms, Tree};
use crate::ids::{LegKey, Stop, VertexId};
use crate::plan::{Leg, Query};
use crate::price::EdgeCosts;
use crate::search::attach::Attachment;
use std::collections::BTreeMap;
use surefoot_world::{Ability, Seconds, Vec3};

/// Height of a cell, m: ground on different storeys is in different cells.
const STOREY_M: f32 = 4.0;
/// Steps along an edge per side of a cell.
const STEPS_PER_SIDE: f32 = 2.0;
/// Greatest number of cells of an area.
pub const MAX_CELLS: usize = 1 << 16;

/// A vertex that an NPC reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachedVertex {
    /// The vertex.
    pub vertex: VertexId,
    /// Expected duration of the legs to it, including what failures cost.
    pub seconds: Seconds,
}

/// A square of ground that an NPC reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachedCell {
    /// Its centre, at the height of the place where the NPC gets there first, m.
    pub centre: Vec3,
    /// Expected time until the NPC gets there.
    pub seconds: Seconds,
}

impl Router {
    /// Finds the vertices that an NPC reaches from the start of `query` within `limit` at current costs, in ascending
    /// order of their ids. Only the cheapest path to a vertex counts, because NPCs take no other, even if a riskier one
    /// is faster. The goal of the query is ignored.
    pub fn reachable(&self, query: &Query, limit: Seconds, repriced: &EdgeCosts) -> Vec<ReachedVertex> {
        let mut seconds = vec![f32::INFINITY; self.adjacency.vertex_count()];
        let search = &self.search_for(query, repriced);
        let terms = Terms { router: self, search };
        let starts = self.attach_start(search);
        spread(&starts, limit, terms, &mut seconds);
        // The start may be near other vertices that the cheapest attachments do not lead to.
        let (more, reached) = (self.attach_start_widely(search), self.reached_from(&starts, search));
        if more.iter().any(|&(vertex, _)| !reached.contains(vertex)) {
            let mut others = vec![f32::INFINITY; seconds.len()];
            spread(&more, limit, terms, &mut others);
            let is_new = |vertex: &VertexId| !reached.contains(*vertex);
            self.graph.vertices().filter(is_new).for_each(|vertex| seconds[vertex.idx()] = others[vertex.idx()]);
        }
        let vertices = self.graph.vertices().zip(seconds).filter(|(_, seconds)| *seconds <= limit.0);
        vertices.map(|(vertex, seconds)| ReachedVertex { vertex, seconds: Seconds(seconds) }).collect()
    }

    /// Returns the squares with sides of `side_m` metres that an NPC passes on foot within `limit`, on its way from
    /// `reached` along any edge that the query allows, row by row. `None` if there are more than [`MAX_CELLS`].
    ///
    /// The area follows proved edges: only the way from the start to its first vertex may lead through a wall. Ground
    /// that no edge passes is not in it.
    pub fn reached_cells(
        &self,
        query: &Query,
        reached: &[ReachedVertex],
        limit: Seconds,
        side_m: f32,
    ) -> Option<Vec<ReachedCell>> {
        let repriced = EdgeCosts::new();
        let search = self.search_for(query, &repriced);
        let mut cells = Cells { side_m, first: BTreeMap::new() };
        for &ReachedVertex { vertex, seconds } in reached {
            let from = self.graph.position(vertex);
            cells.pass(from, seconds);
            for (edge, ..) in self.adjacency.outgoing(vertex) {
                let hop = self.adjacency.hop(edge);
                if hop.leg.ability <= Ability::DOUBLE_JUMP && self.is_open(&search, edge) {
                    cells.run([from, hop.end], [seconds, hop.leg.seconds], limit);
                }
                if cells.first.len() > MAX_CELLS {
                    return None;
                }
            }
        }
        Some(cells.into_list())
    }
}

/// Finds the cheapest paths from the attachments of the start, and the times of the vertices that they reach within
/// `limit`. The other times stay above it.
fn spread(starts: &[Attachment], limit: Seconds, terms: Terms<'_>, seconds: &mut [f32]) {
    let router = terms.router;
    let mut tree = Tree::new(starts, Growth::Forwards, router);
    for &(vertex, _) in starts {
        let key = LegKey { from: Stop::Start, to: Stop::Vertex(vertex) };
        let ends = [terms.search.query.start, router.graph.position(vertex)];
        seconds[vertex.idx()] = Leg::unproved(router.graph.legs(), key, ends).seconds.0;
    }
    let is_within = |seconds: f32| seconds <= limit.0;
    // Vertices that wait to be settled within the limit. A path that has exceeded it never comes back.
    let mut waiting = starts.iter().filter(|(vertex, _)| is_within(seconds[vertex.idx()])).count();
    while waiting > 0 {
        let offer = |edge, other: VertexId| {
            let from = router.adjacency.key(edge).from;
            let next = seconds[from.idx()] + router.adjacency.hop(edge).leg.seconds.0;
            waiting = waiting + usize::from(is_within(next)) - usize::from(is_within(seconds[other.idx()]));
            seconds[other.idx()] = next;
        };
        let Some(vertex) = tree.grow(terms, f32::INFINITY, offer) else { break };
        waiting -= usize::from(is_within(seconds[vertex.idx()]));
    }
}

/// Cells by storey, row and column, and when and where an NPC gets there first.
struct Cells {
    side_m: f32,
    first: BTreeMap<[i32; 3], (Seconds, f32)>,
}

impl Cells {
    /// Notes that an NPC is at a place after so many seconds.
    fn pass(&mut self, place: Vec3, seconds: Seconds) {
        let cell = |coordinate: f32, side: f32| (coordinate / side).floor() as i32;
        let key = [cell(place.y, STOREY_M), cell(place.z, self.side_m), cell(place.x, self.side_m)];
        let first = self.first.entry(key).or_insert((seconds, place.y));
        if seconds.0 < first.0.0 {
            *first = (seconds, place.y);
        }
    }

    /// Notes the part of an edge that an NPC runs within `limit`, from its first end after `begin` on.
    fn run(&mut self, [from, to]: [Vec3; 2], [begin, lasting]: [Seconds; 2], limit: Seconds) {
        let steps = (STEPS_PER_SIDE * from.distance(to) / self.side_m).ceil().max(1.0);
        // Bounds the steps of an edge that designers have forced across many maps.
        for step in 1..=(steps as usize).min(MAX_CELLS) {
            let share = step as f32 / steps;
            let seconds = Seconds(begin.0 + share * lasting.0);
            if seconds.0 > limit.0 {
                break;
            }
            self.pass(from.lerp(to, share), seconds);
        }
    }

    fn into_list(self) -> Vec<ReachedCell> {
        let middle = |cell: i32| (cell as f32 + 0.5) * self.side_m;
        let cell = |([_, row, column], (seconds, height)): ([i32; 3], (Seconds, f32))| ReachedCell {
            centre: Vec3::new(middle(column), height, middle(row)),
            seconds,
        };
        self.first.into_iter().map(cell).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Evidence, TryEnd};
    use crate::graph::{Edge, GraphData, NavGraph};
    use crate::ids::EdgeKey;
    use crate::zones::{Rule, Shape, Tags, Zone, Zones};
    use proptest::prelude::*;
    use std::collections::BTreeSet;
    use surefoot_world::Aabb;
    use surefoot_world::float::distance_to_segment;

    const COUNT: u32 = 30;

    fn router(edges: &[(u32, u32, u32, Ability)]) -> Router {
        let place = |idx: u32| Vec3::new((idx * 37 % 101) as f32, (idx * 13 % 7) as f32, (idx * 53 % 89) as f32);
        let mut known = BTreeSet::new();
        let once = edges.iter().filter(|(from, to, ..)| from != to && known.insert((*from, *to)));
        let edges = once.map(|&(from, to, decisions, ability)| {
            let mut evidence = Evidence::default();
            evidence.note(TryEnd::Arrived, decisions, ability);
            Edge { key: EdgeKey::new(from, to), evidence }
        });
        let (vertices, edges) = ((0..COUNT).map(place).collect(), edges.collect());
        Router::new(NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap(), 0, 1)
    }

    fn ability() -> impl Strategy<Value = Ability> {
        prop::sample::select(vec![Ability::WALK, Ability::JUMP, Ability::TELEPORTER])
    }

    fn zone() -> impl Strategy<Value = Zone> {
        let rule = prop_oneof![(0.1..20.0f32).prop_map(Rule::Price), Just(Rule::Never)];
        ((0.0..100.0f32, 0.0..90.0f32), 1.0..30.0f32, rule).prop_map(|((x, z), side, rule)| {
            let low = Vec3::new(x, 0.0, z);
            let shape = Shape::Box(Aabb { low, high: low + side });
            Zone { name: "zone".to_owned(), shape, rule, concerns: Tags::new() }
        })
    }

    /// The time to a vertex by the search of a single plan.
    fn seconds_alone(router: &Router, query: &Query, vertex: VertexId) -> Option<f32> {
        let repriced = EdgeCosts::new();
        let search = router.search_for(query, &repriced);
        let (starts, ends) = ([router.attach_start(&search), router.attach_start_widely(&search)], [(vertex, 0.0)]);
        let path = starts.iter().find_map(|starts| router.a_star(starts, &ends, &search, None))?;
        let legs = &router.assemble(query, &path).legs;
        Some(legs[..legs.len() - 1].iter().map(|leg| leg.seconds).sum::<Seconds>().0)
    }

    proptest! {
        #![proptest_config(crate::properties::cases(300))]

        #[test]
        fn times_are_those_of_the_path_to_each_vertex(
            edges in prop::collection::vec((0..COUNT, 0..COUNT, 1..60u32, ability()), 0..90),
            start in (0.0..100.0f32, 0.0..90.0f32),
            limit in 0.0..60.0f32,
            is_without in any::<bool>(),
            zones in prop::collection::vec(zone(), 0..5),
        ) {
            let router = router(&edges);
            let start = Vec3::new(start.0, 0.0, start.1);
            let query = Query {
                without: [Ability::JUMP].into_iter().filter(|_| is_without).collect(),
                zones: Zones::new(zones),
                ..Query::new(start, start)
            };
            let reached = router.reachable(&query, Seconds(limit), &EdgeCosts::new());
            prop_assert!(reached.is_sorted_by(|one, other| one.vertex < other.vertex));
            for vertex in router.graph().vertices() {
                let ours = reached.iter().find(|reached| reached.vertex == vertex).map(|reached| reached.seconds.0);
                match (ours, seconds_alone(&router, &query, vertex)) {
                    (None, None) => {}
                    (None, Some(alone)) => prop_assert!(alone > limit - 1.0e-3, "{vertex} is left out"),
                    (Some(ours), alone) => {
                        let alone = alone.unwrap_or(f32::NAN);
                        prop_assert!((ours - alone).abs() < 1.0e-3 * (1.0 + ours), "{vertex}: {ours} s, not {alone} s");
                        prop_assert!(ours <= limit);
                    }
                }
            }
        }

        #[test]
        fn cells_cover_what_is_reached_and_no_leap_of_a_teleporter(
            edges in prop::collection::vec((0..COUNT, 0..COUNT, 1..60u32, ability()), 0..60),
            limit in 1.0..40.0f32,
            side_m in 1.0..9.0f32,
        ) {
            let router = router(&edges);
            let (query, limit) = (Query::new(Vec3::ZERO, Vec3::ZERO), Seconds(limit));
            let reached = router.reachable(&query, limit, &EdgeCosts::new());
            let cells = router.reached_cells(&query, &reached, limit, side_m).unwrap();
            prop_assert!(cells.iter().all(|cell| cell.seconds.0 <= limit.0));
            let is_over = |cell: &ReachedCell, at: Vec3| {
                let offset = (cell.centre - at).abs();
                offset.x.max(offset.z) <= 0.501 * side_m && offset.y <= STOREY_M
            };
            for ReachedVertex { vertex, seconds } in &reached {
                let at = router.graph().position(*vertex);
                prop_assert!(cells.iter().any(|cell| is_over(cell, at) && cell.seconds.0 <= seconds.0));
            }
            let is_begun = |edge: &Edge| reached.iter().any(|reached| reached.vertex == edge.key.from);
            let is_on_foot = |edge: &&Edge| edge.evidence.ability != Ability::TELEPORTER && is_begun(edge);
            let on_foot = router.graph().edges().filter(is_on_foot);
            let ways: Vec<[Vec3; 2]> =
                on_foot.map(|edge| [edge.key.from, edge.key.to].map(|end| router.graph().position(end))).collect();
            let ends = reached.iter().map(|reached| [router.graph().position(reached.vertex); 2]);
            let ways: Vec<[Vec3; 2]> = ways.into_iter().chain(ends).collect();
            for cell in &cells {
                let nearest = |&[from, to]: &[Vec3; 2]| distance_to_segment(cell.centre, from, to);
                prop_assert!(ways.iter().any(|way| nearest(way) <= 0.75 * side_m), "{cell:?} is on no way");
            }
        }
    }

    #[test]
    fn an_area_of_too_many_cells_is_refused() {
        let vertices = vec![Vec3::ZERO, Vec3::new(6000.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 6000.0)];
        let edges = [(0, 1), (0, 2), (1, 2), (2, 1)].map(|(from, to)| Edge {
            key: EdgeKey::new(from, to),
            evidence: Evidence::forced(surefoot_world::Decisions(9.0)),
        });
        let graph = NavGraph::check(GraphData { vertices, edges: edges.to_vec(), ..GraphData::default() }).unwrap();
        let router = Router::new(graph, 0, 1);
        let (query, limit) = (Query::new(Vec3::ZERO, Vec3::ZERO), Seconds(600.0));
        let reached = router.reachable(&query, limit, &EdgeCosts::new());
        assert_eq!(reached.len(), 3);
        assert!(router.reached_cells(&query, &reached, limit, 0.25).is_none());
        assert!(router.reached_cells(&query, &reached, limit, 50.0).is_some_and(|cells| cells.len() > 300));
    }
}
