//! Hub labels, in which plans look up the cheapest path.
//!
//! A contraction orders the vertices. Each vertex has two labels. They list later vertices, its hubs, with the cost
//! of the path to each hub and from each hub. The cheapest path between any two vertices passes a hub of both
//! (Abraham et al. 2011, "A Hub-Based Labeling Algorithm for Shortest Paths on Road Networks"). A query compares the
//! labels of its starts and goals.

mod contraction;

use crate::ids::VertexId;
use crate::search::adjacency::{Adjacency, EdgeIdx};
use contraction::{Arc, Contracted, Meaning, Origin, contract};
use rayon::prelude::*;
use std::cell::RefCell;
use surefoot_world::csr::Csr;
use surefoot_world::parallel::with_threads;

/// Share of a cost within which two costs count as equal, since sums of floats depend on their order.
const ROUNDING: f32 = 1.0e-6;
/// Stands for the entry of a vertex in its own label.
const ITSELF: u16 = u16::MAX;

/// Labels of all vertices. Internally, vertices are numbered in the order of the contraction.
#[derive(Debug)]
pub(crate) struct Labels {
    /// The number of each vertex.
    numbers: Vec<u32>,
    /// From each vertex to its hubs.
    leaving: Half,
    /// To each vertex from its hubs.
    entering: Half,
}

/// Arcs and labels of one direction.
#[derive(Debug, Default)]
struct Half {
    arcs: Csr<Arc>,
    /// Hubs of each vertex in ascending order, and their costs in the same order.
    hubs: Csr<u32>,
    costs: Vec<f32>,
    /// For each hub, the index of the first arc of the path among those of the vertex.
    vias: Vec<u16>,
}

/// An entry of a label.
#[derive(Debug, Clone, Copy)]
struct Entry {
    hub: u32,
    cost: f32,
    via: u16,
}

impl Labels {
    /// Prepares the labels of a graph on `thread_count` threads; `None` if a vertex gets too many arcs. `surcharges`
    /// are what the edges cost in addition, in decisions, infinite for closed edges; they are empty if there are none.
    pub fn new(adjacency: &Adjacency, surcharges: &[f32], thread_count: usize) -> Option<Self> {
        let Contracted { order, leaving, entering } = contract(adjacency, surcharges);
        let mut numbers = vec![0; order.len()];
        (0..).zip(&order).for_each(|(number, &vertex)| numbers[vertex as usize] = number);
        let renumber = |lists: Vec<Vec<Arc>>| -> Option<Vec<Vec<Arc>>> {
            order.iter().map(|&vertex| renumbered(&lists[vertex as usize], &numbers)).collect()
        };
        let (leaving, entering) = (renumber(leaving)?, renumber(entering)?);
        let [leaving_labels, entering_labels] = with_threads(thread_count, || label([&leaving, &entering]));
        Some(Self {
            numbers,
            leaving: Half::new(&leaving, &leaving_labels),
            entering: Half::new(&entering, &entering_labels),
        })
    }

    /// Size in memory, bytes.
    pub fn memory_bytes(&self) -> usize {
        let half = |half: &Half| {
            let entries = size_of_val(&half.costs[..]) + size_of_val(&half.vias[..]);
            half.arcs.memory_bytes() + half.hubs.memory_bytes() + entries
        };
        size_of_val(&self.numbers[..]) + half(&self.leaving) + half(&self.entering)
    }

    /// Finds the cheapest path from one of `starts` to one of `goals`, including their costs. Returns its cost in
    /// decisions, its first vertex, and its edges in order.
    pub fn path(&self, starts: &[(VertexId, f32)], goals: &[(VertexId, f32)]) -> Option<(f32, VertexId, Vec<EdgeIdx>)> {
        let number = |vertex: VertexId| self.numbers[vertex.idx()];
        let best = SCRATCH.with_borrow_mut(|scratch| {
            scratch.resize(self.numbers.len());
            for (idx, &(start, price)) in (0..).zip(starts) {
                let (hubs, costs) = self.leaving.label(number(start));
                hubs.iter().zip(costs).for_each(|(&hub, &cost)| scratch.offer(hub, price + cost, idx));
            }
            let (mut least, mut best) = (f32::INFINITY, None);
            for (idx, &(goal, price)) in goals.iter().enumerate() {
                let (hubs, costs) = self.entering.label(number(goal));
                for (&hub, &cost) in hubs.iter().zip(costs) {
                    let (so_far, start) = scratch.best[hub as usize];
                    let whole = so_far + cost + price;
                    if whole < least {
                        (least, best) = (whole, Some((whole, hub, start, idx)));
                    }
                }
            }
            scratch.clear();
            best
        });
        let (cost, hub, start, goal) = best?;
        let (first, _) = starts[start as usize];
        let (mut edges, mut stack) = (Vec::with_capacity(64), Vec::new());
        let mut at = number(first);
        while at != hub {
            let arc = self.leaving.arc_towards(at, hub);
            self.unpack((at, arc.other, arc.origin), &mut stack, &mut edges);
            at = arc.other;
        }
        let mut arcs = Vec::new();
        at = number(goals[goal].0);
        while at != hub {
            let arc = self.entering.arc_towards(at, hub);
            arcs.push((arc, at));
            at = arc.other;
        }
        for (arc, to) in arcs.into_iter().rev() {
            self.unpack((arc.other, to, arc.origin), &mut stack, &mut edges);
        }
        Some((cost, first, edges))
    }

    /// Prepares lower bounds on the costs from all vertices to the best of `goals`, whose own costs count.
    pub fn bounds_to(&self, goals: &[(VertexId, f32)]) -> Bounds<'_> {
        let mut from_hubs = vec![f32::INFINITY; self.numbers.len()];
        for &(goal, price) in goals {
            let (hubs, costs) = self.entering.label(self.numbers[goal.idx()]);
            for (&hub, cost) in hubs.iter().zip(costs) {
                let known = &mut from_hubs[hub as usize];
                *known = known.min(cost + price);
            }
        }
        Bounds { labels: self, from_hubs }
    }

    /// Appends the edges that an arc stands for. `stack` is empty before and after.
    fn unpack(&self, arc: (u32, u32, Origin), stack: &mut Vec<(u32, u32, Origin)>, edges: &mut Vec<EdgeIdx>) {
        stack.push(arc);
        while let Some((from, to, origin)) = stack.pop() {
            match origin.meaning() {
                Meaning::Edge(edge) => edges.push(edge),
                Meaning::Via(middle) => {
                    stack.push((middle, to, self.leaving.arc_with(middle, to).origin));
                    stack.push((from, middle, self.entering.arc_with(middle, from).origin));
                }
            }
        }
    }
}

/// The costs from all vertices to the best of some goals: bounds for a search in which edges cost no less than in the
/// labels (Strasser and Zeitz 2021, "A Fast and Tight Heuristic for A* in Road Networks").
pub(crate) struct Bounds<'a> {
    labels: &'a Labels,
    /// The least cost from each hub to any goal.
    from_hubs: Vec<f32>,
}

impl Bounds<'_> {
    /// The cost from `vertex`, in decisions; infinite without a path.
    pub fn of(&self, vertex: VertexId) -> f32 {
        let (hubs, costs) = self.labels.leaving.label(self.labels.numbers[vertex.idx()]);
        let by_hub = hubs.iter().zip(costs).map(|(&hub, cost)| cost + self.from_hubs[hub as usize]);
        by_hub.fold(f32::INFINITY, f32::min)
    }
}

/// Arcs with the new numbers of their vertices, by their other ends; `None` if there are too many.
fn renumbered(arcs: &[Arc], numbers: &[u32]) -> Option<Vec<Arc>> {
    let renumber =
        |arc: &Arc| Arc { other: numbers[arc.other as usize], origin: arc.origin.renumbered(numbers), ..*arc };
    let mut arcs: Vec<Arc> = arcs.iter().map(renumber).collect();
    arcs.sort_by_key(|arc| arc.other);
    (arcs.len() < usize::from(ITSELF)).then_some(arcs)
}

/// Computes the labels of all vertices for the arcs of both directions. The labels of a vertex follow from those of the
/// later vertices that its arcs lead to, so that all labels of one depth are computed in parallel.
fn label(arcs: [&[Vec<Arc>]; 2]) -> [Vec<Vec<Entry>>; 2] {
    let count = arcs[0].len();
    let mut depth = vec![0; count];
    let mut by_depth: Vec<Vec<u32>> = Vec::new();
    for vertex in (0..count).rev() {
        let later = arcs.iter().flat_map(|arcs| &arcs[vertex]);
        let own = later.map(|arc| depth[arc.other as usize] + 1).max().unwrap_or(0);
        depth[vertex] = own;
        by_depth.resize_with(by_depth.len().max(own + 1), Vec::new);
        by_depth[own].push(vertex as u32);
    }
    let mut labels = [vec![Vec::new(); count], vec![Vec::new(); count]];
    for vertices in by_depth {
        let one = |vertex: u32, way: usize| {
            SCRATCH.with_borrow_mut(|scratch| {
                scratch.resize(count);
                label_one(vertex, &arcs[way][vertex as usize], &labels[way], &labels[1 - way], scratch)
            })
        };
        let made: Vec<(u32, [Vec<Entry>; 2])> =
            vertices.into_par_iter().map(|vertex| (vertex, [one(vertex, 0), one(vertex, 1)])).collect();
        for (vertex, [leaving, entering]) in made {
            labels[0][vertex as usize] = leaving;
            labels[1][vertex as usize] = entering;
        }
    }
    labels
}

/// Computes the label of a vertex from its arcs and the labels of their ends. Hubs that the labels of the opposite
/// direction reach for less are left out.
fn label_one(
    vertex: u32,
    arcs: &[Arc],
    labels: &[Vec<Entry>],
    opposite: &[Vec<Entry>],
    scratch: &mut Scratch,
) -> Vec<Entry> {
    scratch.offer(vertex, 0.0, u32::from(ITSELF));
    for (via, arc) in (0..).zip(arcs) {
        labels[arc.other as usize].iter().for_each(|entry| scratch.offer(entry.hub, arc.cost + entry.cost, via));
    }
    let is_needed = |&hub: &u32| {
        let (cost, _) = scratch.best[hub as usize];
        let beaten = cost * (1.0 - ROUNDING);
        opposite[hub as usize].iter().all(|entry| scratch.best[entry.hub as usize].0 + entry.cost >= beaten)
    };
    let mut hubs: Vec<u32> = scratch.touched.iter().copied().filter(|hub| *hub == vertex || is_needed(hub)).collect();
    hubs.sort_unstable();
    let entry = |hub: u32| {
        let (cost, via) = scratch.best[hub as usize];
        Entry { hub, cost, via: via as u16 }
    };
    let label = hubs.into_iter().map(entry).collect();
    scratch.clear();
    label
}

impl Half {
    fn new(arcs: &[Vec<Arc>], labels: &[Vec<Entry>]) -> Self {
        let mut half = Self::default();
        for (arcs, label) in arcs.iter().zip(labels) {
            half.arcs.push_row(arcs.iter().copied());
            half.hubs.push_row(label.iter().map(|entry| entry.hub));
            half.costs.extend(label.iter().map(|entry| entry.cost));
            half.vias.extend(label.iter().map(|entry| entry.via));
        }
        half
    }

    /// Hubs of a vertex in ascending order, and their costs.
    fn label(&self, vertex: u32) -> (&[u32], &[f32]) {
        (self.hubs.row(vertex as usize), &self.costs[self.hubs.range(vertex as usize)])
    }

    /// The first arc of the path between a vertex and one of its hubs.
    fn arc_towards(&self, vertex: u32, hub: u32) -> Arc {
        let at = self.hubs.row(vertex as usize).binary_search(&hub);
        let at = at.expect("all vertices on the path to a hub have that hub");
        let via = self.vias[self.hubs.range(vertex as usize).start + at];
        self.arcs.row(vertex as usize)[usize::from(via)]
    }

    /// The arc between a vertex and a later one.
    fn arc_with(&self, vertex: u32, other: u32) -> Arc {
        let arcs = self.arcs.row(vertex as usize);
        arcs[arcs.binary_search_by_key(&other, |arc| arc.other).expect("both halves of a shortcut are kept")]
    }
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// The least cost to each hub, with a note of its origin. Costs are infinite except for the touched hubs.
#[derive(Debug, Default)]
struct Scratch {
    best: Vec<(f32, u32)>,
    touched: Vec<u32>,
}

impl Scratch {
    fn resize(&mut self, count: usize) {
        if self.best.len() < count {
            self.best.resize(count, (f32::INFINITY, 0));
        }
    }

    fn offer(&mut self, hub: u32, cost: f32, note: u32) {
        let best = &mut self.best[hub as usize];
        if cost < best.0 {
            if best.0 == f32::INFINITY {
                self.touched.push(hub);
            }
            *best = (cost, note);
        }
    }

    fn clear(&mut self) {
        self.touched.drain(..).for_each(|hub| self.best[hub as usize] = (f32::INFINITY, 0));
    }
}
