//! The proved graph: positions, directed edges with their evidence, islands.

use crate::candidates::Candidate;
use crate::evidence::Evidence;
use crate::ids::{EdgeKey, VertexId};
use crate::legs::LegModel;
use petgraph::Direction;
use petgraph::algo::kosaraju_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use serde::{Deserialize, Serialize};
use surefoot_world::Vec3;

/// A proved edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// The vertices it joins.
    pub key: EdgeKey,
    /// What probing showed.
    pub evidence: Evidence,
}

/// A checked graph: every edge joins two existing, different vertices.
#[derive(Debug, Clone)]
pub struct NavGraph {
    graph: DiGraph<Vec3, Edge>,
    legs: LegModel,
    islands: Vec<u32>,
    island_count: u32,
}

/// A graph as it is stored and sent, not yet checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GraphData {
    /// Positions, m.
    pub vertices: Vec<Vec3>,
    /// Edges between them.
    pub edges: Vec<Edge>,
    /// Prices of legs that nobody has proved.
    pub legs: LegModel,
}

/// A stored graph that makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GraphError {
    /// An edge names a vertex that does not exist, or itself.
    #[error("edge {} -> {} does not join two of the graph's vertices", .0.from, .0.to)]
    BadEdge(EdgeKey),
    /// A vertex has a position that is not finite.
    #[error("vertex {0} has no finite position")]
    BadVertex(usize),
    /// An edge's evidence contradicts itself.
    #[error("the evidence of edge {} -> {} makes no sense", .0.from, .0.to)]
    BadEvidence(EdgeKey),
    /// The model of unproved legs has a coefficient that is not finite.
    #[error("the model of unproved legs has a coefficient that is not finite")]
    BadLegs,
}

impl NavGraph {
    /// Keeps the candidates whose success rate reaches `threshold`.
    ///
    /// # Panics
    /// If there is not one evidence per candidate.
    pub fn prove(vertices: Vec<Vec3>, candidates: &[Candidate], evidence: &[Evidence], threshold: f64) -> Self {
        assert_eq!(candidates.len(), evidence.len());
        let edges = candidates
            .iter()
            .zip(evidence)
            .filter(|(_, evidence)| evidence.proves(threshold))
            .map(|(&key, &evidence)| Edge { key, evidence })
            .collect();
        let legs = LegModel::fit(&vertices, candidates, evidence);
        Self::check(GraphData { vertices, edges, legs }).expect("candidates join existing vertices")
    }

    /// Checks a stored graph.
    ///
    /// # Errors
    /// Names the first vertex or edge that makes no sense.
    pub fn check(data: GraphData) -> Result<Self, GraphError> {
        let mut graph = DiGraph::with_capacity(data.vertices.len(), data.edges.len());
        for (idx, vertex) in data.vertices.iter().enumerate() {
            if !vertex.is_finite() {
                return Err(GraphError::BadVertex(idx));
            }
            graph.add_node(*vertex);
        }
        for edge in data.edges {
            let EdgeKey { from, to } = edge.key;
            let inside = |vertex: VertexId| vertex.idx() < data.vertices.len();
            if !inside(from) || !inside(to) || from == to {
                return Err(GraphError::BadEdge(edge.key));
            }
            if !edge.evidence.is_sound() {
                return Err(GraphError::BadEvidence(edge.key));
            }
            graph.add_edge(node(from), node(to), edge);
        }
        if !data.legs.is_finite() {
            return Err(GraphError::BadLegs);
        }
        // Not Tarjan's: petgraph has it recursive, and a long row of vertices would exhaust the stack.
        let components = kosaraju_scc(&graph);
        let mut islands = vec![0; graph.node_count()];
        for (island, members) in components.iter().enumerate() {
            for member in members {
                islands[member.index()] = island as u32;
            }
        }
        Ok(Self { graph, legs: data.legs, islands, island_count: components.len() as u32 })
    }

    /// The graph as plain data.
    pub fn to_data(&self) -> GraphData {
        GraphData {
            vertices: self.graph.node_weights().copied().collect(),
            edges: self.graph.edge_weights().copied().collect(),
            legs: self.legs,
        }
    }

    /// Prices of legs that nobody has proved.
    pub fn legs(&self) -> &LegModel {
        &self.legs
    }

    /// The petgraph behind it.
    pub fn as_petgraph(&self) -> &DiGraph<Vec3, Edge> {
        &self.graph
    }

    /// Vertices.
    pub fn vertex_count(&self) -> usize {
        self.graph.node_count()
    }

    /// All vertices, in order.
    pub fn vertices(&self) -> impl Iterator<Item = VertexId> + use<> {
        (0..self.vertex_count()).map(VertexId::at)
    }

    /// Whether the graph has such a vertex.
    pub fn has_vertex(&self, vertex: VertexId) -> bool {
        vertex.idx() < self.vertex_count()
    }

    /// Proved edges.
    pub fn edge_count(&self) -> usize {
        self.graph.edge_count()
    }

    /// Position of a vertex, m.
    pub fn position(&self, vertex: VertexId) -> Vec3 {
        self.graph[node(vertex)]
    }

    /// Edges that leave a vertex.
    pub fn edges_from(&self, vertex: VertexId) -> impl Iterator<Item = &Edge> {
        self.graph.edges(node(vertex)).map(|edge| edge.weight())
    }

    /// The edge between two vertices, if there is one.
    pub fn edge(&self, EdgeKey { from, to }: EdgeKey) -> Option<&Edge> {
        let edge =
            (self.has_vertex(from) && self.has_vertex(to)).then(|| self.graph.find_edge(node(from), node(to)))??;
        self.graph.edge_weight(edge)
    }

    /// Whether any proved edge leaves a vertex.
    pub fn is_left(&self, vertex: VertexId) -> bool {
        self.edges_from(vertex).next().is_some()
    }

    /// Whether any proved edge reaches a vertex.
    pub fn is_reached(&self, vertex: VertexId) -> bool {
        self.graph.edges_directed(node(vertex), Direction::Incoming).next().is_some()
    }

    /// All edges.
    pub fn edges(&self) -> impl Iterator<Item = &Edge> {
        self.graph.edge_weights()
    }

    /// Strongly connected components.
    pub fn island_count(&self) -> u32 {
        self.island_count
    }

    /// Island of each vertex.
    pub fn islands(&self) -> &[u32] {
        &self.islands
    }

    /// Vertices that can be reached from `from`, itself included.
    pub fn reachable_from(&self, from: VertexId) -> Vec<bool> {
        let mut seen = vec![false; self.vertex_count()];
        let mut stack = vec![from];
        seen[from.idx()] = true;
        while let Some(vertex) = stack.pop() {
            for edge in self.edges_from(vertex) {
                if !std::mem::replace(&mut seen[edge.key.to.idx()], true) {
                    stack.push(edge.key.to);
                }
            }
        }
        seen
    }

    /// Share of ordered pairs of different vertices with a path, in [0, 1].
    pub fn connected_share(&self) -> f64 {
        let count = self.vertex_count();
        let pairs: usize =
            self.vertices().map(|from| self.reachable_from(from).iter().filter(|&&seen| seen).count() - 1).sum();
        pairs as f64 / (count * count.saturating_sub(1)).max(1) as f64
    }
}

fn node(vertex: VertexId) -> NodeIndex {
    NodeIndex::new(vertex.idx())
}
