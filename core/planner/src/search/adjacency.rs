//! A graph's edges in flat arrays: outgoing edges by source vertex, incoming edges by target vertex.

use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::plan::Leg;
use crate::price::EdgeCost;
use crate::search::csr::Csr;
use surefoot_world::{Ability, Vec3};

/// Exclusive limit on the edges that leave a vertex in a graph with a table of next hops. The table stores an index into them
/// as a byte, whose highest value stands for "no path".
const MAX_OUT_DEGREE: u32 = u8::MAX as u32;

/// Index of an edge in the arrays; edges that leave the same vertex are contiguous.
pub(crate) type EdgeIdx = u32;

/// A graph's edges by source vertex.
#[derive(Debug, Default)]
pub(crate) struct Adjacency {
    /// The edges that leave each vertex.
    keys: Csr<EdgeKey>,
    hops: Vec<Hop>,
    /// The most demanding ability that each edge needs, once more without the rest of its hop: searches look at most edges.
    abilities: Vec<Ability>,
    /// Cost of each edge, in decisions, for careful plans.
    costs: Vec<f32>,
    /// The part of it that the risk of death makes up.
    death_costs: Vec<f32>,
}

/// What a plan needs of an edge, in one line of the cache.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Hop {
    /// Position of the vertex to which the edge leads, m.
    pub end: Vec3,
    /// That vertex.
    pub to: VertexId,
    /// The leg along the edge.
    pub leg: Leg,
}

impl Adjacency {
    pub fn new(graph: &NavGraph) -> Self {
        let mut adjacency = Self::default();
        for vertex in graph.vertices() {
            for edge in graph.edges_from(vertex) {
                let (end, leg) = (graph.position(edge.key.to), Leg::proved(edge.key, &edge.evidence));
                adjacency.hops.push(Hop { end, to: edge.key.to, leg });
                adjacency.abilities.push(leg.ability);
                let EdgeCost { careful, by_death } = edge.evidence.edge_cost();
                adjacency.costs.push(careful);
                adjacency.death_costs.push(by_death);
            }
            adjacency.keys.push_row(graph.edges_from(vertex).map(|edge| edge.key));
        }
        adjacency
    }

    /// Returns whether every vertex has few enough outgoing edges for a table of next hops.
    pub fn fits_table(&self) -> bool {
        self.keys.rows().all(|row| row.len() < MAX_OUT_DEGREE as usize)
    }

    pub fn vertex_count(&self) -> usize {
        self.keys.row_count()
    }

    pub fn edge_count(&self) -> usize {
        self.keys.items().len()
    }

    pub fn key(&self, edge: EdgeIdx) -> EdgeKey {
        self.keys.items()[edge as usize]
    }

    pub fn hop(&self, edge: EdgeIdx) -> &Hop {
        &self.hops[edge as usize]
    }

    pub fn ability(&self, edge: EdgeIdx) -> Ability {
        self.abilities[edge as usize]
    }

    /// Returns the outgoing edge of a vertex by its index among the vertex's outgoing edges.
    pub fn nth_from(&self, vertex: VertexId, out_idx: u8) -> EdgeIdx {
        self.keys.range(vertex.idx()).start as EdgeIdx + EdgeIdx::from(out_idx)
    }

    /// Returns the cost of an edge.
    pub fn cost(&self, edge: EdgeIdx) -> EdgeCost {
        EdgeCost { careful: self.costs[edge as usize], by_death: self.death_costs[edge as usize] }
    }

    /// Iterates over the outgoing edges of a vertex: index, target vertex, cost in decisions.
    pub fn outgoing(&self, vertex: VertexId) -> impl Iterator<Item = (EdgeIdx, VertexId, f32)> {
        let range = self.keys.range(vertex.idx());
        let edges = range.start as EdgeIdx..;
        let costs = &self.costs[range];
        edges.zip(self.keys.row(vertex.idx())).zip(costs).map(|((edge, key), &cost)| (edge, key.to, cost))
    }
}

/// An edge in the list of its target vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct IncomingEdge {
    /// Source vertex.
    pub from: VertexId,
    /// Index among the outgoing edges of the source vertex.
    pub out_idx: u8,
    /// Cost in decisions.
    pub cost: f32,
}

/// A graph's edges by target vertex.
pub(crate) struct IncomingEdges {
    starts: Vec<u32>,
    edges: Vec<IncomingEdge>,
}

impl IncomingEdges {
    /// Lists the incoming edges of a graph that [fits a table](Adjacency::fits_table).
    pub fn new(adjacency: &Adjacency) -> Self {
        let vertex_count = adjacency.vertex_count();
        let mut starts = vec![0u32; vertex_count + 1];
        adjacency.keys.items().iter().for_each(|key| starts[key.to.idx() + 1] += 1);
        (1..starts.len()).for_each(|idx| starts[idx] += starts[idx - 1]);
        let mut next = starts.clone();
        let mut edges = vec![IncomingEdge { from: VertexId(0), out_idx: 0, cost: 0.0 }; adjacency.edge_count()];
        for from in (0..vertex_count).map(VertexId::at) {
            for (out_idx, (_, to, cost)) in (0u8..).zip(adjacency.outgoing(from)) {
                edges[next[to.idx()] as usize] = IncomingEdge { from, out_idx, cost };
                next[to.idx()] += 1;
            }
        }
        Self { starts, edges }
    }

    pub fn at(&self, vertex: VertexId) -> &[IncomingEdge] {
        &self.edges[self.starts[vertex.idx()] as usize..self.starts[vertex.idx() + 1] as usize]
    }
}
