//! Contraction of a graph, vertex by vertex (Geisberger et al. 2008, "Contraction Hierarchies"): shortcuts keep the
//! costs between the remaining vertices.
//!
//! The order follows RoutingKit's measure of importance: the level of a vertex, and the number and the length of the
//! edges that its contraction adds, relative to those that it removes.

use crate::ids::VertexId;
use crate::search::adjacency::{Adjacency, EdgeIdx};
use crate::search::frontier::Frontier;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Most vertices that a search for a detour settles before the shortcut is added: for an estimate of importance, and
/// for the contraction.
const SETTLED: [usize; 2] = [24, 160];
/// Bit of an origin that is the middle of a shortcut.
const SHORTCUT: u32 = 1 << 31;

/// What an arc stands for: an edge of the graph, or two arcs that meet in a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin(u32);

/// What an [`Origin`] stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// An edge of the graph.
    Edge(EdgeIdx),
    /// An arc to this vertex, and one from it.
    Via(u32),
}

impl Origin {
    pub fn meaning(self) -> Meaning {
        if self.0 & SHORTCUT == 0 { Meaning::Edge(self.0) } else { Meaning::Via(self.0 & !SHORTCUT) }
    }

    /// Returns this origin with the new numbers of the vertices.
    pub fn renumbered(self, numbers: &[u32]) -> Self {
        match self.meaning() {
            Meaning::Edge(_) => self,
            Meaning::Via(middle) => Self(SHORTCUT | numbers[middle as usize]),
        }
    }
}

/// An arc in the list of one of its ends.
#[derive(Debug, Clone, Copy)]
pub struct Arc {
    /// The other end.
    pub other: u32,
    /// Cost in decisions.
    pub cost: f32,
    pub origin: Origin,
    /// Number of edges that the arc stands for.
    pub hops: u32,
}

/// The result of a contraction.
pub struct Contracted {
    /// Vertices in the order in which they were contracted.
    pub order: Vec<u32>,
    /// For each vertex, the arcs that lead from it to later ones.
    pub leaving: Vec<Vec<Arc>>,
    /// For each vertex, the arcs that lead to it from later ones.
    pub entering: Vec<Vec<Arc>>,
}

/// Contracts all vertices of a graph, whose edges cost `surcharges` more, if there are any; infinite ones close edges.
pub fn contract(adjacency: &Adjacency, surcharges: &[f32]) -> Contracted {
    let count = adjacency.vertex_count();
    let mut rest = Uncontracted::new(count);
    for from in 0..count {
        for (edge, to, cost) in adjacency.outgoing(VertexId::at(from)) {
            let cost = cost + surcharges.get(edge as usize).copied().unwrap_or(0.0);
            if cost.is_finite() {
                rest.add(from as u32, to.0, cost, Origin(edge), 1);
            }
        }
    }
    let mut queue: BinaryHeap<Reverse<(u64, u32)>> =
        (0..count as u32).map(|vertex| Reverse((rest.importance(vertex), vertex))).collect();
    let mut order = Vec::with_capacity(count);
    while let Some(Reverse((_, vertex))) = queue.pop() {
        // Other vertices have been contracted since the estimate of its importance.
        let importance = rest.importance(vertex);
        if queue.peek().is_some_and(|Reverse((next, _))| importance > *next) {
            queue.push(Reverse((importance, vertex)));
            continue;
        }
        rest.contract(vertex);
        order.push(vertex);
    }
    Contracted { order, leaving: rest.leaving, entering: rest.entering }
}

/// The vertices that are not contracted yet. Contracted vertices keep their arcs, but no arcs lead to them any more.
struct Uncontracted {
    leaving: Vec<Vec<Arc>>,
    entering: Vec<Vec<Arc>>,
    /// One more than the level of any contracted neighbour.
    level: Vec<u32>,
    detours: Frontier<f32>,
}

impl Uncontracted {
    fn new(count: usize) -> Self {
        Self {
            leaving: vec![Vec::new(); count],
            entering: vec![Vec::new(); count],
            level: vec![0; count],
            detours: Frontier::new(count),
        }
    }

    /// Adds an arc, in place of one with the same ends, unless that costs no more.
    fn add(&mut self, from: u32, to: u32, cost: f32, origin: Origin, hops: u32) {
        for (list, other) in [(&mut self.leaving[from as usize], to), (&mut self.entering[to as usize], from)] {
            let arc = Arc { other, cost, origin, hops };
            match list.iter_mut().find(|arc| arc.other == other) {
                Some(known) if known.cost <= cost => return,
                Some(known) => *known = arc,
                None => list.push(arc),
            }
        }
    }

    /// How late a vertex should be contracted. There are up to as many shortcuts as the square of a vertex's arcs:
    /// their hops do not fit into 32 bits.
    fn importance(&mut self, vertex: u32) -> u64 {
        let (mut added, mut added_hops): (u64, u64) = (0, 0);
        self.for_each_shortcut(vertex, SETTLED[0], |_, _, _, hops| {
            added += 1;
            added_hops += u64::from(hops);
        });
        let arcs = || self.leaving[vertex as usize].iter().chain(&self.entering[vertex as usize]);
        let (removed, removed_hops) = (arcs().count() as u64, arcs().map(|arc| u64::from(arc.hops)).sum::<u64>());
        let level = u64::from(self.level[vertex as usize]);
        1000 * level + 1000 * added / removed.max(1) + 1000 * added_hops / removed_hops.max(1)
    }

    fn contract(&mut self, vertex: u32) {
        let mut shortcuts = Vec::new();
        self.for_each_shortcut(vertex, SETTLED[1], |from, to, cost, hops| shortcuts.push((from, to, cost, hops)));
        let next_level = self.level[vertex as usize] + 1;
        let mut detach = |arcs: &[Arc], opposite: &mut [Vec<Arc>]| {
            for other in arcs.iter().map(|arc| arc.other as usize) {
                opposite[other].retain(|arc| arc.other != vertex);
                self.level[other] = self.level[other].max(next_level);
            }
        };
        detach(&self.leaving[vertex as usize], &mut self.entering);
        detach(&self.entering[vertex as usize], &mut self.leaving);
        for (from, to, cost, hops) in shortcuts {
            self.add(from, to, cost, Origin(SHORTCUT | vertex), hops);
        }
    }

    /// Calls `note` with the ends, cost and hops of each shortcut that the contraction of `vertex` requires.
    fn for_each_shortcut(&mut self, vertex: u32, settled: usize, mut note: impl FnMut(u32, u32, f32, u32)) {
        let leaving = &self.leaving[vertex as usize];
        let farthest = leaving.iter().map(|arc| arc.cost).fold(0.0, f32::max);
        for inward in &self.entering[vertex as usize] {
            let from = inward.other;
            if leaving.iter().all(|arc| arc.other == from) {
                continue;
            }
            search_detours(&mut self.detours, &self.leaving, [from, vertex], inward.cost + farthest, settled);
            for outward in leaving.iter().filter(|arc| arc.other != from) {
                let cost = inward.cost + outward.cost;
                if self.detours.cost(outward.other) > cost {
                    note(from, outward.other, cost, inward.hops.saturating_add(outward.hops));
                }
            }
        }
    }
}

/// Finds upper bounds on the costs from `source` to other vertices up to `limit`, avoiding `excluded`. Settles at most
/// `settled` vertices.
fn search_detours(
    frontier: &mut Frontier<f32>,
    leaving: &[Vec<Arc>],
    [source, excluded]: [u32; 2],
    limit: f32,
    settled: usize,
) {
    frontier.clear();
    frontier.offer(source, 0.0);
    for _ in 0..settled {
        let Some((vertex, so_far)) = frontier.settle(limit) else { return };
        let arcs = leaving[vertex as usize].iter().filter(|arc| arc.other != excluded);
        for (to, cost) in arcs.map(|arc| (arc.other, so_far + arc.cost)).filter(|(_, cost)| *cost <= limit) {
            frontier.offer(to, cost);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_importance_of_a_vertex_with_many_long_shortcuts_is_exact() {
        const SIDE: u32 = 200;
        let middle = 2 * SIDE;
        let mut rest = Uncontracted::new(middle as usize + 1);
        for idx in 0..SIDE {
            rest.add(idx, middle, 1.0, Origin(idx), 150);
            rest.add(middle, SIDE + idx, 1.0, Origin(SIDE + idx), 150);
        }
        // 40,000 shortcuts of 300 hops each for 400 arcs of 150.
        assert_eq!(rest.importance(middle), 1000 * 40_000 / 400 + 1000 * (40_000 * 300) / (400 * 150));
        assert!(
            rest.importance(middle) > rest.importance(0),
            "an end of an arc is contracted before the middle of many"
        );
        rest.contract(middle);
        assert_eq!(rest.leaving[0].len(), SIDE as usize);
        assert!(rest.leaving[0].iter().all(|arc| (arc.cost, arc.hops) == (2.0, 300)));
    }
}
