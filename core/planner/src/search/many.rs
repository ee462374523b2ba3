//! Plans between one place and many: what each of them promises, and which are best.
//!
//! The answers are those of [`Router::find_path_at`] for each pair. Most paths are looked up in hub labels. The
//! others share one search from the end that all pairs have in common.

use super::afar::reason;
use super::tree::{Growth, Terms, Tree};
use super::{Found, Path, Router};
use crate::ids::VertexId;
use crate::plan::{NoPath, Plan, Query};
use crate::price::EdgeCosts;
use crate::search::attach::Attachment;
use crate::search::connectivity::flood;
use crate::search::zoned::Search;
use surefoot_world::{Chance, Decisions, Seconds, Vec3};

/// The end that many plans have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SharedEnd {
    /// All plans begin at the start of the query.
    Start,
    /// All plans end at the goal of the query.
    Goal,
}

/// What a plan promises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Expected duration of all legs, including what failures cost.
    pub seconds: Seconds,
    /// What the search minimised: the expected duration plus terms for the risks of failing and of dying.
    pub cost: Seconds,
    /// Estimated chance that every leg succeeds, for an NPC that does not rehearse.
    pub chance: Chance,
    /// Estimated chance of arriving, for an NPC that rehearses its legs and plans again when one fails.
    pub arrival_chance: Chance,
    /// Estimated chance of dying on the way, for an NPC that does not rehearse.
    pub death_chance: f64,
}

impl Arrival {
    /// What `plan` promises, which costs so many decisions.
    fn of(plan: &Plan, cost: f32) -> Self {
        Self {
            seconds: plan.seconds(),
            cost: Decisions(cost.into()).seconds(),
            chance: plan.chance(),
            arrival_chance: plan.arrival_chance(),
            death_chance: plan.death_chance(),
        }
    }
}

/// What makes one arrival better than another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::EnumString, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum RankBy {
    /// The lower cost: time and risks.
    #[default]
    Cost,
    /// The lower expected duration.
    Seconds,
}

/// Returns the indices of the `most` best arrivals, the best first. Places without a plan come last, and of equal ones
/// the lower index first.
pub fn best(arrivals: &[Result<Arrival, NoPath>], by: RankBy, most: usize) -> Vec<usize> {
    let score = |arrival: &Result<Arrival, NoPath>| match (arrival, by) {
        (Ok(arrival), RankBy::Cost) => arrival.cost.0,
        (Ok(arrival), RankBy::Seconds) => arrival.seconds.0,
        (Err(_), _) => f32::INFINITY,
    };
    let mut order: Vec<usize> = (0..arrivals.len()).collect();
    order.sort_by(|&one, &other| score(&arrivals[one]).total_cmp(&score(&arrivals[other])));
    order.truncate(most);
    order
}

impl Router {
    /// Finds what the plan between one end of `query` and each of `places` promises at current costs, or why there is
    /// none, in the order of the places. They replace the other end of the query. Both ends are attached to several
    /// vertices, as with [`Attach::Several`](crate::Attach::Several).
    pub fn arrivals(
        &self,
        query: &Query,
        shared: SharedEnd,
        places: &[Vec3],
        repriced: &EdgeCosts,
    ) -> Vec<Result<Arrival, NoPath>> {
        let mut common = SharedSearch { shared, trees: Vec::new(), leading_back: None };
        let mut query = query.clone();
        let arrival = |&place: &Vec3| {
            *(if shared == SharedEnd::Start { &mut query.goal } else { &mut query.start }) = place;
            let search = self.search_for(&query, repriced);
            match self.find(&search, |starts, goals| common.join(self, [starts, goals], &search)) {
                Found::Path(path) => Ok(Arrival::of(&self.assemble(&query, &path), path.cost)),
                Found::Direct(cost) => Ok(Arrival::of(&self.direct(&query, None), cost)),
                Found::Nothing { starts, goals } => Err(common.explain(self, [&starts, &goals], &search)),
            }
        };
        places.iter().map(arrival).collect()
    }

    /// Whether a path that the search allows leads from each vertex to one of `ends`, or from one of them to it.
    fn led_to(&self, search: &Search<'_>, growth: Growth, ends: &[Attachment]) -> Vec<bool> {
        let (count, ends) = (self.adjacency.vertex_count(), ends.iter().map(|&(vertex, _)| vertex));
        let is_possible = |&(edge, ..): &(u32, VertexId, f32)| self.is_possible(search, edge);
        let other = |(_, other, _)| other;
        match growth {
            Growth::Forwards => {
                flood(count, ends, |vertex| self.adjacency.outgoing(vertex).filter(is_possible).map(other))
            }
            Growth::Backwards => {
                flood(count, ends, |vertex| self.adjacency.incoming(vertex).filter(is_possible).map(other))
            }
        }
    }
}

/// What many queries with a common end have in common.
#[derive(Debug)]
struct SharedSearch {
    shared: SharedEnd,
    /// The trees that grow from the common end: from its first attachments, and from more of them.
    trees: Vec<Tree>,
    /// The vertices that a path joins to the common end against the direction of the queries.
    leading_back: Option<Vec<bool>>,
}

impl SharedSearch {
    /// Whether edges cost the same in a search as in the others. From a start in a zone that bars others, legs may lead
    /// out of it.
    fn holds_for(&self, search: &Search<'_>) -> bool {
        self.shared == SharedEnd::Start || !search.leaves_zones()
    }

    /// The cheapest path between attachments of start and goal.
    fn join(&mut self, router: &Router, [starts, goals]: [&[Attachment]; 2], search: &Search<'_>) -> Option<Path> {
        if !self.holds_for(search) {
            return router.join(starts, goals, search);
        }
        router.join_or([starts, goals], search, |_| {
            let (roots, others, growth) = match self.shared {
                SharedEnd::Start => (starts, goals, Growth::Forwards),
                SharedEnd::Goal => (goals, starts, Growth::Backwards),
            };
            let idx = self.trees.iter().position(|tree| tree.roots() == roots).unwrap_or_else(|| {
                self.trees.push(Tree::new(roots, growth, router));
                self.trees.len() - 1
            });
            self.trees[idx].path(others, Terms { router, search })
        })
    }

    /// Why there is no path between attachments of start and goal.
    fn explain(&mut self, router: &Router, [starts, goals]: [&[Attachment]; 2], search: &Search<'_>) -> NoPath {
        if !self.holds_for(search) {
            return router.explain(search, starts, goals);
        }
        reason(search, [starts, goals], || {
            let (roots, others, growth) = match self.shared {
                SharedEnd::Start => (starts, goals, Growth::Backwards),
                SharedEnd::Goal => (goals, starts, Growth::Forwards),
            };
            let leading_back = self.leading_back.get_or_insert_with(|| router.led_to(search, growth, roots));
            others.iter().any(|&(vertex, _)| leading_back[vertex.idx()])
        })
    }
}
