//! Plans to a goal that no path reaches: the reason, and the path to the reachable vertex nearest to the goal.

use super::{Found, Path, Router, is_start_open};
use crate::ids::VertexId;
use crate::plan::{NoPath, Plan, Query};
use crate::search::attach::{ATTACHMENTS, Attachment, Direction, MORE_ATTACHMENTS};
use crate::search::connectivity::{self, flood};
use crate::search::zoned::Search;

impl Router {
    /// Tries more attachments if no path joins the cheapest ones; `goals` are those of the goal.
    pub(super) fn find_widely(
        &self,
        search: &Search<'_>,
        goals: Vec<Attachment>,
        mut join: impl FnMut(&[Attachment], &[Attachment]) -> Option<Path>,
    ) -> Found {
        let starts = self.attach_start_widely(search);
        // Fewer than the limit are all that exist.
        let goals = if goals.len() < ATTACHMENTS { goals } else { self.attach_goal(search, MORE_ATTACHMENTS) };
        join(&starts, &goals).map_or(Found::Nothing { starts, goals }, Found::Path)
    }

    /// Leads to the reachable vertex nearest to the goal, because no path joins these attachments.
    pub(super) fn plan_from_afar(&self, search: &Search<'_>, starts: &[Attachment], goals: &[Attachment]) -> Plan {
        let reason = self.explain(search, starts, goals);
        match self.nearest_reachable(search, starts) {
            Some(nearest) => self.lead_to(search, starts, nearest, reason),
            None => self.head_straight(search, reason),
        }
    }

    /// The plan of one leg straight to a goal that no path leads to. If zones bar it, the plan stays at the start.
    pub(super) fn head_straight(&self, search: &Search<'_>, reason: NoPath) -> Plan {
        let query = search.query;
        if search.leg_to_goal(query.start).is_some() {
            return self.direct(query, Some(reason));
        }
        let stay = self.direct(&Query::new(query.start, query.start), Some(reason));
        Plan { nearest: Some(query.start), ..stay }
    }

    /// Finds more vertices to walk to from the start, within the range of the edges that were proved on foot.
    pub(super) fn attach_start_widely(&self, search: &Search<'_>) -> Vec<Attachment> {
        let query = search.query;
        let closed = self.closed_from(query.start);
        let accept = |vertex, leg| {
            is_start_open(query, vertex)
                && !closed.contains(&vertex)
                && self.reach.contains(leg)
                && self.is_boarded(query.start, vertex)
        };
        let rules = (accept, |vertex| search.leg_from_start(self.graph.position(vertex)));
        let reach_m = self.reach.length_m;
        self.sources.cheapest(query.start, MORE_ATTACHMENTS, &self.prices(query), reach_m, Direction::Away, rules)
    }

    /// Returns why there is no path between these attachments.
    pub(super) fn explain(&self, search: &Search<'_>, starts: &[Attachment], goals: &[Attachment]) -> NoPath {
        reason(search, [starts, goals], || {
            let reached = self.reached_from(goals, search);
            starts.iter().any(|&(start, _)| reached.contains(start))
        })
    }

    /// Plans to the vertex `nearest`, because no path leads to the goal.
    fn lead_to(&self, search: &Search<'_>, starts: &[Attachment], nearest: VertexId, reason: NoPath) -> Plan {
        // Avoided legs may cut off the nearest vertex.
        let Some(path) = self.join(starts, &[(nearest, 0.0)], search) else {
            return self.head_straight(search, reason);
        };
        let mut plan = self.assemble(search.query, &path);
        // Without the leg from the last vertex to the goal.
        plan.waypoints.pop();
        plan.legs.pop();
        Plan { no_path: Some(reason), nearest: Some(self.graph.position(nearest)), ..plan }
    }

    /// Returns the vertex nearest to the goal among those that a path leads to from any of `starts`.
    fn nearest_reachable(&self, search: &Search<'_>, starts: &[Attachment]) -> Option<VertexId> {
        let reached = self.reached_from(starts, search);
        self.nearest_vertex(search.query.goal, |vertex| reached.contains(vertex))
    }

    /// The vertices that open paths lead to from any of `from`, these included. All vertices of an island reach the
    /// same set, unless the query bans an ability or a mover stop, or zones bind it.
    pub(super) fn reached_from(&self, from: &[Attachment], search: &Search<'_>) -> Reached<'_> {
        let query = search.query;
        let from = from.iter().map(|&(vertex, _)| vertex);
        match &self.closure {
            Some(closure) if query.without.is_empty() && query.stops.is_empty() && search.zoned().is_none() => {
                Reached::Known(closure.reached_from(from))
            }
            _ => Reached::Searched(flood(self.graph.vertex_count(), from, |vertex| {
                let exits = self.adjacency.outgoing(vertex);
                exits.filter(|(edge, ..)| self.is_possible(search, *edge)).map(|(_, to, _)| to)
            })),
        }
    }
}

/// Returns why there is no path between attachments of start and goal; `leads_back` says whether one leads from a goal
/// to a start.
pub(super) fn reason(
    search: &Search<'_>,
    [starts, goals]: [&[Attachment]; 2],
    leads_back: impl FnOnce() -> bool,
) -> NoPath {
    if search.bars_goal() {
        NoPath::GoalInZone
    } else if starts.is_empty() {
        NoPath::StartOffGraph
    } else if goals.is_empty() {
        NoPath::GoalOffGraph
    } else if leads_back() {
        NoPath::OneWay
    } else {
        NoPath::DifferentIslands
    }
}

/// The vertices that paths lead to.
pub(super) enum Reached<'a> {
    /// Looked up in the closure of the islands.
    Known(connectivity::Reached<'a>),
    /// Found by a flood: whether it reached each vertex.
    Searched(Vec<bool>),
}

impl Reached<'_> {
    pub(super) fn contains(&self, vertex: VertexId) -> bool {
        match self {
            Self::Known(reached) => reached.contains(vertex),
            Self::Searched(reached) => reached[vertex.idx()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Evidence, TryEnd};
    use crate::graph::{Edge, GraphData, NavGraph};
    use crate::ids::EdgeKey;
    use crate::needs::{Need, Needs};
    use crate::price::EdgeCosts;
    use proptest::prelude::*;
    use std::collections::BTreeSet;
    use surefoot_world::{Ability, Vec3};
    use surefoot_world::{MoverId, StopSet};

    const COUNT: u32 = 30;

    /// A graph of edges by ability, some of which need one of the two stops of a mover.
    fn graph(edges: &[(u32, u32, Ability, u16)]) -> NavGraph {
        let place = |idx: u32| Vec3::new((idx * 37 % 101) as f32, (idx * 13 % 7) as f32, (idx * 53 % 89) as f32);
        let mut known = BTreeSet::new();
        let once = edges.iter().filter(|(from, to, ..)| from != to && known.insert((*from, *to)));
        let edges = once.map(|&(from, to, ability, stops)| {
            let mut evidence = Evidence::default();
            evidence.note(TryEnd::Arrived, 9, ability);
            let mut needs = Needs::default();
            needs.add(Need { mover: MoverId(0), stops: StopSet(stops) });
            evidence.needs = if stops == 0 { Needs::default() } else { needs };
            Edge { key: EdgeKey::new(from, to), evidence }
        });
        let (vertices, edges) = ((0..COUNT).map(place).collect(), edges.collect());
        NavGraph::check(GraphData { vertices, edges, ..GraphData::default() }).unwrap()
    }

    fn ability() -> impl Strategy<Value = Ability> {
        prop::sample::select(vec![Ability::WALK, Ability::JUMP])
    }

    fn vertices() -> impl Strategy<Value = Vec<Attachment>> {
        prop::collection::vec((0..COUNT).prop_map(|vertex| (VertexId(vertex), 1.0)), 1..6)
    }

    proptest! {
        #![proptest_config(crate::properties::cases(500))]

        /// The definition: one search from each start and each goal.
        #[test]
        fn answers_are_those_of_a_search_from_each_start_and_goal(
            edges in prop::collection::vec((0..COUNT, 0..COUNT, ability(), 0..3u16), 0..45),
            (starts, goals) in (vertices(), vertices()),
            goal in (0..100u8, 0..90u8),
            (is_without, stops) in (any::<bool>(), 0..3u16),
        ) {
            let router = Router::new(graph(&edges), 0, 1);
            let graph = router.graph();
            let query = Query {
                without: [Ability::JUMP].into_iter().filter(|_| is_without).collect(),
                stops: if stops == 0 { Vec::new() } else { vec![StopSet(stops)] },
                ..Query::new(Vec3::ZERO, Vec3::new(f32::from(goal.0), 0.0, f32::from(goal.1)))
            };
            let is_open = |edge: &Edge| {
                !query.without.rules_out(edge.evidence.ability) && edge.evidence.needs.are_met(&query.stops)
            };
            // Until no edge leads to another vertex.
            let search = |from: VertexId| -> Vec<bool> {
                let mut reached = vec![false; graph.vertex_count()];
                reached[from.idx()] = true;
                while graph.edges().filter(|edge| is_open(edge)).any(|edge| {
                    reached[edge.key.from.idx()] && !std::mem::replace(&mut reached[edge.key.to.idx()], true)
                }) {}
                reached
            };
            let reached = |from: &[Attachment]| -> Vec<bool> {
                let searches: Vec<Vec<bool>> = from.iter().map(|&(vertex, _)| search(vertex)).collect();
                (0..graph.vertex_count()).map(|idx| searches.iter().any(|reached| reached[idx])).collect()
            };
            let leads_back = reached(&goals);
            let is_one_way = starts.iter().any(|(start, _)| leads_back[start.idx()]);
            let reason = if is_one_way { NoPath::OneWay } else { NoPath::DifferentIslands };
            let repriced = EdgeCosts::new();
            let search = router.search_for(&query, &repriced);
            prop_assert_eq!(router.explain(&search, &starts, &goals), reason);
            let reached = reached(&starts);
            let distance = |vertex: VertexId| graph.position(vertex).distance_squared(query.goal);
            let nearest = graph.vertices().filter(|vertex| reached[vertex.idx()]).map(distance).min_by(f32::total_cmp);
            prop_assert_eq!(router.nearest_reachable(&search, &starts).map(distance), nearest);
        }
    }

    #[test]
    fn without_attachments_an_end_is_off_the_graph() {
        let router = Router::new(graph(&[(0, 1, Ability::WALK, 0)]), 0, 1);
        let (query, some) = (Query::new(Vec3::ZERO, Vec3::ONE), [(VertexId(0), 1.0)]);
        let repriced = EdgeCosts::new();
        let search = router.search_for(&query, &repriced);
        assert_eq!(router.explain(&search, &[], &some), NoPath::StartOffGraph);
        assert_eq!(router.explain(&search, &some, &[]), NoPath::GoalOffGraph);
        assert_eq!(router.nearest_reachable(&search, &[]), None);
    }
}
