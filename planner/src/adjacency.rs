//! A graph's edges in flat arrays, by the vertex they leave and by the vertex they reach.

use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::plan::Leg;
use std::ops::Range;

/// Edges that may leave one vertex of a graph with a table of next hops: its entries are bytes, of which the highest stands for
/// "no path".
const MAX_OUT_DEGREE: u32 = u8::MAX as u32;

/// Place of an edge in the arrays: edges that leave one vertex stand together.
pub(crate) type EdgeIdx = u32;

/// A graph's edges by the vertex they leave.
#[derive(Debug)]
pub(crate) struct Adjacency {
    /// First edge of each vertex, and one more at the end.
    starts: Vec<EdgeIdx>,
    keys: Vec<EdgeKey>,
    legs: Vec<Leg>,
    costs: Vec<f32>,
}

impl Adjacency {
    pub fn new(graph: &NavGraph) -> Self {
        let mut adjacency = Self { starts: vec![0], keys: Vec::new(), legs: Vec::new(), costs: Vec::new() };
        for vertex in graph.vertices() {
            for edge in graph.edges_from(vertex) {
                adjacency.keys.push(edge.key);
                adjacency.legs.push(Leg::proved(edge.key, &edge.evidence));
                adjacency.costs.push(edge.evidence.cost() as f32);
            }
            adjacency.starts.push(adjacency.legs.len() as EdgeIdx);
        }
        adjacency
    }

    /// Whether every vertex has few enough edges for a table of next hops.
    pub fn fits_table(&self) -> bool {
        self.starts.windows(2).all(|pair| pair[1] - pair[0] < MAX_OUT_DEGREE)
    }

    pub fn vertex_count(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn edge_count(&self) -> usize {
        self.keys.len()
    }

    pub fn key(&self, edge: EdgeIdx) -> EdgeKey {
        self.keys[edge as usize]
    }

    pub fn leg(&self, edge: EdgeIdx) -> Leg {
        self.legs[edge as usize]
    }

    /// The edge at a place among those that leave a vertex.
    pub fn nth_from(&self, vertex: VertexId, place: u8) -> EdgeIdx {
        self.starts[vertex.idx()] + EdgeIdx::from(place)
    }

    /// Edges that leave a vertex, each with the vertex it reaches and its cost.
    pub fn leaving(&self, vertex: VertexId) -> impl Iterator<Item = (EdgeIdx, VertexId, f32)> {
        let Range { start, end } = self.starts[vertex.idx()]..self.starts[vertex.idx() + 1];
        (start..end).map(|edge| (edge, self.keys[edge as usize].to, self.costs[edge as usize]))
    }
}

/// An edge as the vertex that it reaches sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arrival {
    /// The vertex it leaves.
    pub from: VertexId,
    /// Its place among those that leave that vertex.
    pub place: u8,
    pub cost: f32,
}

/// A graph's edges by the vertex they reach.
pub(crate) struct Arrivals {
    starts: Vec<u32>,
    edges: Vec<Arrival>,
}

impl Arrivals {
    /// Of a graph that fits a table.
    pub fn new(adjacency: &Adjacency) -> Self {
        let vertex_count = adjacency.vertex_count();
        let mut starts = vec![0u32; vertex_count + 1];
        adjacency.keys.iter().for_each(|key| starts[key.to.idx() + 1] += 1);
        (1..starts.len()).for_each(|idx| starts[idx] += starts[idx - 1]);
        let mut next = starts.clone();
        let mut edges = vec![Arrival { from: VertexId(0), place: 0, cost: 0.0 }; adjacency.edge_count()];
        for from in (0..vertex_count).map(VertexId::at) {
            for (place, (_, to, cost)) in (0u8..).zip(adjacency.leaving(from)) {
                edges[next[to.idx()] as usize] = Arrival { from, place, cost };
                next[to.idx()] += 1;
            }
        }
        Self { starts, edges }
    }

    pub fn at(&self, vertex: VertexId) -> &[Arrival] {
        &self.edges[self.starts[vertex.idx()] as usize..self.starts[vertex.idx() + 1] as usize]
    }
}
