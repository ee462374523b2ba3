//! The one search for shortest paths: Dijkstra's algorithm, or A* if the caller adds a lower bound on the rest of the
//! path.
//!
//! A [`Frontier`] keeps the least cost of each node and the order in which nodes are settled. The caller supplies the
//! edges, so that one search serves graphs of any form:
//!
//! ```ignore
//! frontier.offer(start, 0.0);
//! while let Some((node, cost)) = frontier.settle(limit) {
//!     exits(node).for_each(|(to, length)| _ = frontier.offer(to, cost + length));
//! }
//! ```

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A number that adds up along a path.
pub(crate) trait Cost: Copy + PartialOrd {
    /// The cost of a node that no path has reached.
    const UNREACHED: Self;

    fn order(self, other: Self) -> Ordering;
}

impl Cost for f32 {
    const UNREACHED: Self = Self::INFINITY;

    fn order(self, other: Self) -> Ordering {
        self.total_cmp(&other)
    }
}

impl Cost for f64 {
    const UNREACHED: Self = Self::INFINITY;

    fn order(self, other: Self) -> Ordering {
        self.total_cmp(&other)
    }
}

/// The least costs found so far, and the nodes that wait to be settled.
#[derive(Debug)]
pub(crate) struct Frontier<C> {
    /// By node.
    costs: Vec<C>,
    /// The nodes that have a cost.
    touched: Vec<u32>,
    open: BinaryHeap<Entry<C>>,
}

/// A node that waits to be settled at this cost.
#[derive(Debug, Clone, Copy)]
struct Entry<C> {
    /// Lower bound on the cost of any path through the node.
    bound: C,
    node: u32,
    cost: C,
}

impl<C: Cost> Frontier<C> {
    /// A search among nodes that count from 0.
    pub fn new(node_count: usize) -> Self {
        Self { costs: vec![C::UNREACHED; node_count], touched: Vec::new(), open: BinaryHeap::new() }
    }

    /// Prepares another search, in time that grows with the part that the last one has seen.
    pub fn clear(&mut self) {
        self.touched.drain(..).for_each(|node| self.costs[node as usize] = C::UNREACHED);
        self.open.clear();
    }

    /// Offers a path to `node`. Returns whether it costs less than all paths before.
    pub fn offer(&mut self, node: u32, cost: C) -> bool {
        self.offer_with(node, cost, |cost| cost)
    }

    /// Like [`offer`](Self::offer), with a lower bound on the cost of any path that goes on from there.
    pub fn offer_with(&mut self, node: u32, cost: C, bound: impl FnOnce(C) -> C) -> bool {
        let known = &mut self.costs[node as usize];
        let is_less = cost < *known;
        if is_less {
            if *known == C::UNREACHED {
                self.touched.push(node);
            }
            *known = cost;
            self.open.push(Entry { bound: bound(cost), node, cost });
        }
        is_less
    }

    /// Settles the node with the lowest bound, the highest of several, and returns it with its cost. `None` if there
    /// is no node left whose bound is at most `limit`; a search with a higher limit goes on from there.
    pub fn settle(&mut self, limit: C) -> Option<(u32, C)> {
        while let Some(&Entry { bound, node, cost }) = self.open.peek() {
            if bound > limit {
                return None;
            }
            self.open.pop();
            if cost <= self.costs[node as usize] {
                return Some((node, cost));
            }
        }
        None
    }

    /// The least cost of a path to `node`, infinite if there is none so far.
    pub fn cost(&self, node: u32) -> C {
        self.costs[node as usize]
    }
}

impl<C: Cost> Ord for Entry<C> {
    /// The greatest entry is settled first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.order(self.bound).then(self.node.cmp(&other.node))
    }
}

impl<C: Cost> PartialOrd for Entry<C> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<C: Cost> Eq for Entry<C> {}

impl<C: Cost> PartialEq for Entry<C> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use petgraph::algo::dijkstra;
    use petgraph::graph::{DiGraph, NodeIndex};
    use proptest::prelude::*;

    const COUNT: u32 = 20;

    proptest! {
        #![proptest_config(crate::properties::cases(300))]

        #[test]
        fn costs_are_those_of_petgraph(
            edges in prop::collection::vec((0..COUNT, 0..COUNT, 0..9u32), 0..80),
            starts in prop::collection::vec(0..COUNT, 1..4),
            limit in prop_oneof![Just(f64::INFINITY), 0.0..20.0f64],
        ) {
            let mut graph: DiGraph<(), f64> = DiGraph::new();
            (0..COUNT).for_each(|_| _ = graph.add_node(()));
            for &(from, to, cost) in &edges {
                graph.add_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize), f64::from(cost));
            }
            let mut frontier = Frontier::new(COUNT as usize);
            for start in starts {
                frontier.clear();
                frontier.offer(start, 0.0);
                let mut settled = Vec::new();
                while let Some((node, cost)) = frontier.settle(limit) {
                    settled.push((node, cost));
                    for &(_, to, length) in edges.iter().filter(|(from, ..)| *from == node) {
                        frontier.offer(to, cost + f64::from(length));
                    }
                }
                prop_assert!(settled.is_sorted_by(|a, b| a.1 <= b.1));
                settled.sort_by_key(|(node, _)| *node);
                let theirs = dijkstra(&graph, NodeIndex::new(start as usize), None, |edge| *edge.weight());
                let mut theirs: Vec<(u32, f64)> =
                    theirs.into_iter().map(|(node, cost)| (node.index() as u32, cost)).collect();
                theirs.retain(|(_, cost)| *cost <= limit);
                theirs.sort_by_key(|(node, _)| *node);
                prop_assert_eq!(settled, theirs);
            }
        }
    }
}
