//! The proved graph: positions, directed edges with their evidence, islands.

use crate::candidates::Candidate;
use crate::closure::reached_sizes;
use crate::evidence::Evidence;
use crate::ids::{EdgeKey, VertexId};
use crate::legs::LegModel;
use petgraph::Direction;
use petgraph::algo::kosaraju_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use serde::{Deserialize, Serialize};
use surefoot_world::Vec3;
use surefoot_world::map::mover::{MAX_MOVERS, MAX_STOPS};

/// Greatest coordinate of a vertex, m: that of a hundred of the largest maps side by side.
pub const MAX_COORDINATE_M: f32 = 1.0e5;
/// Greatest length of an edge, m: ten times the side of the largest map.
pub const MAX_EDGE_M: f32 = 10_000.0;

/// A proved edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// The vertices that the edge joins.
    pub key: EdgeKey,
    /// Evidence from probes and traversals.
    pub evidence: Evidence,
}

/// A checked graph: every edge joins two existing, different vertices, and all numbers are valid.
#[derive(Debug, Clone)]
pub struct NavGraph {
    graph: DiGraph<Vec3, Edge>,
    /// The ends of the edges, once more without their evidence: what is connected is found out in a fraction of the memory.
    ends: Vec<EdgeKey>,
    legs: LegModel,
    islands: Vec<u32>,
    island_count: u32,
}

/// A graph as plain data for storage and export, not yet checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GraphData {
    /// Positions of the vertices, m.
    pub vertices: Vec<Vec3>,
    /// Proved edges; they refer to vertices by index.
    pub edges: Vec<Edge>,
    /// Cost model of unproved legs.
    pub legs: LegModel,
}

/// Why a graph is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GraphError {
    /// An edge names a vertex that does not exist, or joins a vertex to itself.
    #[error("edge {} -> {} does not join two different vertices of the graph", .0.from, .0.to)]
    BadEdge(EdgeKey),
    /// The position of a vertex is not finite, or farther from the origin than any map extends.
    #[error("a coordinate of vertex {0} is not finite or exceeds {MAX_COORDINATE_M} m")]
    BadVertex(usize),
    /// An edge is too long.
    #[error("edge {} -> {} is longer than {MAX_EDGE_M} m", .0.from, .0.to)]
    LongEdge(EdgeKey),
    /// The evidence of an edge is inconsistent.
    #[error("the evidence of edge {} -> {} is inconsistent", .0.from, .0.to)]
    BadEvidence(EdgeKey),
    /// An edge depends on a mover or a stop that no map can have.
    #[error(
        "edge {} -> {} depends on a mover or stop that no map has: there are at most {MAX_MOVERS} movers with {MAX_STOPS} stops each, \
         and a ride leads from one stop where its mover must stand to another", .0.from, .0.to
    )]
    BadNeeds(EdgeKey),
    /// The cost model of unproved legs has a coefficient, range or share that is out of range.
    #[error("the cost model of unproved legs has a coefficient, range or share of deaths that is out of range")]
    BadLegs,
}

impl NavGraph {
    /// Builds the graph of the candidate edges whose success rate reaches `threshold`.
    ///
    /// # Panics
    /// If `candidates` and `evidence` differ in length.
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

    /// Checks `data` and computes its islands.
    ///
    /// # Errors
    /// Returns the first invalid vertex or edge, or an invalid cost model.
    pub fn check(data: GraphData) -> Result<Self, GraphError> {
        let mut graph = DiGraph::with_capacity(data.vertices.len(), data.edges.len());
        let ends: Vec<EdgeKey> = data.edges.iter().map(|edge| edge.key).collect();
        for (idx, vertex) in data.vertices.iter().enumerate() {
            if !is_place(*vertex) {
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
            if !edge.evidence.needs.are_possible() {
                return Err(GraphError::BadNeeds(edge.key));
            }
            if data.vertices[from.idx()].distance(data.vertices[to.idx()]) > MAX_EDGE_M {
                return Err(GraphError::LongEdge(edge.key));
            }
            if !edge.evidence.is_sound() {
                return Err(GraphError::BadEvidence(edge.key));
            }
            graph.add_edge(node(from), node(to), edge);
        }
        if !data.legs.is_sound() {
            return Err(GraphError::BadLegs);
        }
        let (islands, island_count) = islands(graph.node_count(), &ends);
        Ok(Self { graph, ends, legs: data.legs, islands, island_count })
    }

    /// Returns this graph with edges that cost their mean decisions, whatever the risk: see [`Evidence::of_steps`].
    #[must_use]
    pub fn priced_by_steps(&self) -> Self {
        let mut copy = self.clone();
        copy.graph.edge_weights_mut().for_each(|edge| edge.evidence = edge.evidence.of_steps());
        copy
    }

    /// Returns the graph as plain data.
    pub fn to_data(&self) -> GraphData {
        GraphData {
            vertices: self.graph.node_weights().copied().collect(),
            edges: self.graph.edge_weights().copied().collect(),
            legs: self.legs,
        }
    }

    /// Returns the cost model of unproved legs.
    pub fn legs(&self) -> &LegModel {
        &self.legs
    }

    /// Returns the underlying petgraph graph.
    pub fn as_petgraph(&self) -> &DiGraph<Vec3, Edge> {
        &self.graph
    }

    /// Returns the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.graph.node_count()
    }

    /// Iterates over all vertices by index.
    pub fn vertices(&self) -> impl Iterator<Item = VertexId> + use<> {
        (0..self.vertex_count()).map(VertexId::at)
    }

    /// Returns whether the graph has this vertex.
    pub fn has_vertex(&self, vertex: VertexId) -> bool {
        vertex.idx() < self.vertex_count()
    }

    /// Returns the number of edges.
    pub fn edge_count(&self) -> usize {
        self.graph.edge_count()
    }

    /// Returns the position of a vertex, m.
    ///
    /// # Panics
    /// If the graph has no such vertex.
    pub fn position(&self, vertex: VertexId) -> Vec3 {
        self.graph[node(vertex)]
    }

    /// Iterates over the edges that leave a vertex.
    pub fn edges_from(&self, vertex: VertexId) -> impl Iterator<Item = &Edge> {
        self.graph.edges(node(vertex)).map(|edge| edge.weight())
    }

    /// Returns the edge between two vertices, if there is one.
    pub fn edge(&self, EdgeKey { from, to }: EdgeKey) -> Option<&Edge> {
        let edge =
            (self.has_vertex(from) && self.has_vertex(to)).then(|| self.graph.find_edge(node(from), node(to)))??;
        self.graph.edge_weight(edge)
    }

    /// Returns whether any edge leaves the vertex.
    pub fn is_left(&self, vertex: VertexId) -> bool {
        self.edges_from(vertex).next().is_some()
    }

    /// Returns whether any edge reaches the vertex.
    pub fn is_reached(&self, vertex: VertexId) -> bool {
        self.graph.edges_directed(node(vertex), Direction::Incoming).next().is_some()
    }

    /// Iterates over all edges.
    pub fn edges(&self) -> impl Iterator<Item = &Edge> {
        self.graph.edge_weights()
    }

    /// Returns the number of islands (strongly connected components).
    pub fn island_count(&self) -> u32 {
        self.island_count
    }

    /// Returns the island of each vertex, from 0 to `island_count` - 1.
    pub fn islands(&self) -> &[u32] {
        &self.islands
    }

    /// For each island the islands that edges lead to, each once. Islands are numbered in reverse topological order: all of these numbers
    /// are lower.
    pub(crate) fn exits(&self) -> Vec<Vec<u32>> {
        exits(&self.islands, self.island_count, &self.ends)
    }

    /// Returns for each vertex whether it can be reached from `from`; `from` itself counts as reached.
    pub fn reachable_from(&self, from: VertexId) -> Vec<bool> {
        flood(self.vertex_count(), from, self.ends.iter().map(|key| (key.from, key.to)))
    }

    /// Returns for each vertex whether a path leads from it to `to`; `to` itself counts.
    pub fn reaching(&self, to: VertexId) -> Vec<bool> {
        flood(self.vertex_count(), to, self.ends.iter().map(|key| (key.to, key.from)))
    }

    /// Returns the share of ordered pairs of different vertices that a path joins, in [0, 1].
    pub fn connected_share(&self) -> f64 {
        share(&self.islands, self.island_count, &self.ends)
    }

    /// Returns the same share without the edges that `is_removed` accepts.
    pub fn connected_share_without(&self, is_removed: impl Fn(&Edge) -> bool) -> f64 {
        let ends: Vec<EdgeKey> = self.edges().filter(|edge| !is_removed(edge)).map(|edge| edge.key).collect();
        let (islands, island_count) = islands(self.vertex_count(), &ends);
        share(&islands, island_count, &ends)
    }
}

/// The island of each of `count` vertices that edges with these ends join, and the number of islands.
fn islands(count: usize, ends: &[EdgeKey]) -> (Vec<u32>, u32) {
    let mut graph: DiGraph<(), ()> = DiGraph::with_capacity(count, ends.len());
    (0..count).for_each(|_| _ = graph.add_node(()));
    ends.iter().for_each(|key| _ = graph.add_edge(node(key.from), node(key.to), ()));
    // petgraph's Tarjan is recursive: a long chain of vertices would overflow the stack.
    let components = kosaraju_scc(&graph);
    let mut islands = vec![0; count];
    for (island, members) in (0..).zip(&components) {
        members.iter().for_each(|member| islands[member.index()] = island);
    }
    (islands, components.len() as u32)
}

/// For each island the others that edges lead to, each once.
fn exits(islands: &[u32], island_count: u32, ends: &[EdgeKey]) -> Vec<Vec<u32>> {
    let mut exits: Vec<Vec<u32>> = vec![Vec::new(); island_count as usize];
    for key in ends {
        let [from, to] = [key.from, key.to].map(|vertex| islands[vertex.idx()]);
        if from != to && exits[from as usize].last() != Some(&to) {
            exits[from as usize].push(to);
        }
    }
    for exits in &mut exits {
        exits.sort_unstable();
        exits.dedup();
    }
    exits
}

/// The share of ordered pairs of different vertices that a path joins.
fn share(islands: &[u32], island_count: u32, ends: &[EdgeKey]) -> f64 {
    let count = islands.len();
    let mut sizes = vec![0_u64; island_count as usize];
    islands.iter().for_each(|&island| sizes[island as usize] += 1);
    // What one vertex of an island reaches, all do.
    let reached = reached_sizes(&exits(islands, island_count, ends), &sizes);
    let pairs: u64 = sizes.iter().zip(reached).map(|(size, reached)| size * (reached - 1)).sum();
    pairs as f64 / (count * count.saturating_sub(1)).max(1) as f64
}

/// For each of `count` vertices whether it can be reached from `from` along these steps; `from` itself counts.
fn flood(count: usize, from: VertexId, steps: impl Iterator<Item = (VertexId, VertexId)> + Clone) -> Vec<bool> {
    // The ends of all steps by their beginnings.
    let mut starts = vec![0_usize; count + 1];
    steps.clone().for_each(|(from, _)| starts[from.idx() + 1] += 1);
    (0..count).for_each(|idx| starts[idx + 1] += starts[idx]);
    let (mut next, mut ends) = (starts.clone(), vec![VertexId(0); starts[count]]);
    for (from, to) in steps {
        ends[next[from.idx()]] = to;
        next[from.idx()] += 1;
    }
    let mut seen = vec![false; count];
    let mut open = vec![from];
    seen[from.idx()] = true;
    while let Some(vertex) = open.pop() {
        for &to in &ends[starts[vertex.idx()]..starts[vertex.idx() + 1]] {
            if !std::mem::replace(&mut seen[to.idx()], true) {
                open.push(to);
            }
        }
    }
    seen
}

/// Whether a vertex can be at `place`, m.
pub(crate) fn is_place(place: Vec3) -> bool {
    place.is_finite() && place.abs().max_element() <= MAX_COORDINATE_M
}

fn node(vertex: VertexId) -> NodeIndex {
    NodeIndex::new(vertex.idx())
}
