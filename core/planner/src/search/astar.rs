//! A* on the edges of a graph, for queries whose plan cannot be looked up.

use super::{Path, Router};
use crate::ids::VertexId;
use crate::price::Caution;
use crate::search::adjacency::EdgeIdx;
use crate::search::attach::Attachment;
use crate::search::frontier::Frontier;
use crate::search::labels::{Bounds, Labels};
use crate::search::zoned::Search;
use surefoot_world::Vec3;

/// A lower bound on the cost from a vertex to the best of the goals, attachments included.
enum Heuristic<'a> {
    /// The cost without what this search adds.
    Labels(Bounds<'a>),
    /// The straight-line distance at the graph's greatest distance per cost: the goals, m, and their costs.
    Straight(Vec<(Vec3, f32)>),
}

impl Router {
    /// Runs A* from all of `starts` to the best of `goals`, attachments included. `labels` give the heuristic of a
    /// careful query. It never overestimates, so the path is the cheapest.
    pub(super) fn a_star(
        &self,
        starts: &[Attachment],
        goals: &[Attachment],
        search: &Search<'_>,
        labels: Option<&Labels>,
    ) -> Option<Path> {
        if goals.is_empty() {
            // Without a goal, the heuristic would put vertices into no useful order.
            return None;
        }
        let heuristic = labels.map_or_else(
            || Heuristic::Straight(goals.iter().map(|&(goal, exit)| (self.graph.position(goal), exit)).collect()),
            |labels| Heuristic::Labels(labels.bounds_to(goals)),
        );
        let bound = |vertex: VertexId| self.bound(&heuristic, vertex);
        let mut frontier = Frontier::new(self.graph.vertex_count());
        let mut came_from: Vec<Option<EdgeIdx>> = vec![None; self.graph.vertex_count()];
        for &(vertex, price) in starts {
            frontier.offer_with(vertex.0, price, |cost| cost + bound(vertex));
        }
        let mut best: (f32, Option<VertexId>) = (f32::INFINITY, None);
        // Rounding may lift a lower bound slightly above the true cost.
        while let Some((vertex, so_far)) = frontier.settle(f32::min(best.0 * (1.0 + 1.0e-5), f32::MAX)) {
            let vertex = VertexId(vertex);
            for &(goal, exit) in goals {
                if goal == vertex && so_far + exit < best.0 {
                    best = (so_far + exit, Some(vertex));
                }
            }
            for (edge, to, careful) in self.adjacency.outgoing(vertex) {
                let next = so_far + self.price(search, edge, careful);
                if next < frontier.cost(to.0) && self.is_open(search, edge) {
                    frontier.offer_with(to.0, next, |cost| cost + bound(to));
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

    /// What an edge, which costs `careful` in careful searches, costs in this one; infinite if a zone bars it.
    pub(super) fn price(&self, search: &Search<'_>, edge: EdgeIdx, careful: f32) -> f32 {
        let caution = search.query.caution;
        let changed = if search.repriced.is_empty() { None } else { search.repriced.get(&self.adjacency.key(edge)) };
        let price = match changed {
            Some(cost) => cost.at(caution),
            None if caution == Caution::CAREFUL => careful,
            None => self.adjacency.cost(edge).at(caution),
        };
        let prices = &search.query.prices;
        let of_ability = if prices.is_empty() { 0.0 } else { prices.of(self.adjacency.ability(edge)) };
        price + of_ability + search.zoned().map_or(0.0, |zoned| zoned.on_edge(edge))
    }

    fn bound(&self, heuristic: &Heuristic<'_>, vertex: VertexId) -> f32 {
        match heuristic {
            Heuristic::Labels(bounds) => bounds.of(vertex),
            Heuristic::Straight(ends) => {
                let at = self.graph.position(vertex);
                let of_end = |(end, exit): &(Vec3, f32)| at.distance(*end) / self.metres_per_cost + exit;
                ends.iter().map(of_end).fold(f32::INFINITY, f32::min)
            }
        }
    }
}
