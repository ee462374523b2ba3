//! The proved graph: positions, directed edges with their evidence, islands.

use crate::build::candidates::Candidate;
use crate::evidence::Evidence;
use crate::ids::{EdgeKey, VertexId};
use crate::legs::LegModel;
use crate::search::connectivity::{Islands, flood};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use surefoot_world::character::{OwnMove, OwnMoveError};
use surefoot_world::csr::Csr;
use surefoot_world::map::mover::{MAX_MOVERS, MAX_STOPS};
use surefoot_world::{Ability, Vec3};

/// Greatest coordinate of a vertex, m: room for a hundred of the largest maps side by side.
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

/// A checked graph: every edge joins two existing, different vertices, and all numbers are in range.
#[derive(Debug, Clone)]
pub struct NavGraph {
    vertices: Vec<Vec3>,
    edges: Vec<Edge>,
    /// The vertices that the edges join, without their evidence: searches touch a fraction of the memory.
    keys: Vec<EdgeKey>,
    /// Indices of the edges that leave each vertex.
    leaving: Csr<u32>,
    /// Whether any edge leads to each vertex.
    has_entrance: Vec<bool>,
    legs: LegModel,
    moves: Arc<[OwnMove]>,
    islands: Islands,
}

/// A graph as plain data for storage and export, not yet checked.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct GraphData {
    /// Positions of the vertices, m.
    pub vertices: Vec<Vec3>,
    /// Proved edges; they refer to vertices by index.
    pub edges: Vec<Edge>,
    /// Cost model of unproved legs.
    pub legs: LegModel,
    /// Moves of the body's own, by which abilities have their names.
    #[serde(default)]
    pub moves: Arc<[OwnMove]>,
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
        "edge {} -> {} depends on a mover or stop that no map has: there are at most {MAX_MOVERS} movers with \
         {MAX_STOPS} stops each, and a ride leads from one stop where its mover must stand to another", .0.from, .0.to
    )]
    BadNeeds(EdgeKey),
    /// The cost model of unproved legs has a coefficient, range or share that is out of range.
    #[error("the cost model of unproved legs has a coefficient, range or share of deaths that is out of range")]
    BadLegs,
    /// A move is not valid.
    #[error(transparent)]
    BadMoves(#[from] OwnMoveError),
}

impl NavGraph {
    /// Builds the graph of the candidate edges whose success rate reaches `threshold`.
    ///
    /// # Panics
    /// If `candidates` and `evidence` differ in length.
    pub fn prove(vertices: Vec<Vec3>, candidates: &[Candidate], evidence: &[Evidence], threshold: f64) -> Self {
        Self::choose(vertices, candidates, evidence, |idx| evidence[idx].proves(threshold))
    }

    /// Builds the graph of the candidate edges that are chosen by their index.
    ///
    /// # Panics
    /// If `candidates` and `evidence` differ in length.
    pub(crate) fn choose(
        vertices: Vec<Vec3>,
        candidates: &[Candidate],
        evidence: &[Evidence],
        is_chosen: impl Fn(usize) -> bool,
    ) -> Self {
        assert_eq!(candidates.len(), evidence.len());
        let chosen = (0..candidates.len()).filter(|&idx| is_chosen(idx));
        let edges = chosen.map(|idx| Edge { key: candidates[idx], evidence: evidence[idx] }).collect();
        let legs = LegModel::fit(&vertices, candidates, evidence);
        let data = GraphData { vertices, edges, legs, ..GraphData::default() };
        Self::check(data).expect("candidates join existing vertices")
    }

    /// Checks `data` and computes its islands.
    ///
    /// # Errors
    /// Returns the first invalid vertex or edge, or an invalid cost model.
    pub fn check(GraphData { vertices, edges, legs, moves }: GraphData) -> Result<Self, GraphError> {
        if let Some(idx) = vertices.iter().position(|vertex| !is_place(*vertex)) {
            return Err(GraphError::BadVertex(idx));
        }
        for edge in &edges {
            let EdgeKey { from, to } = edge.key;
            let inside = |vertex: VertexId| vertex.idx() < vertices.len();
            if !inside(from) || !inside(to) || from == to {
                return Err(GraphError::BadEdge(edge.key));
            }
            if !edge.evidence.needs.are_possible() {
                return Err(GraphError::BadNeeds(edge.key));
            }
            if vertices[from.idx()].distance(vertices[to.idx()]) > MAX_EDGE_M {
                return Err(GraphError::LongEdge(edge.key));
            }
            if !edge.evidence.is_sound() {
                return Err(GraphError::BadEvidence(edge.key));
            }
        }
        if !legs.is_sound() {
            return Err(GraphError::BadLegs);
        }
        OwnMove::check(&moves)?;
        let keys: Vec<EdgeKey> = edges.iter().map(|edge| edge.key).collect();
        let leaving = Csr::group(vertices.len(), keys.iter().map(|key| key.from.idx()).zip(0..));
        let mut has_entrance = vec![false; vertices.len()];
        keys.iter().for_each(|key| has_entrance[key.to.idx()] = true);
        let islands = Islands::new(vertices.len(), &keys);
        Ok(Self { vertices, edges, keys, leaving, has_entrance, legs, moves, islands })
    }

    /// Returns this graph with edges that cost their mean decisions, whatever the risk:
    /// [`Evidence::priced_by_decisions`].
    #[must_use]
    pub fn priced_by_decisions(&self) -> Self {
        let mut copy = self.clone();
        copy.edges.iter_mut().for_each(|edge| edge.evidence = edge.evidence.priced_by_decisions());
        copy
    }

    /// Returns the graph as plain data.
    pub fn to_data(&self) -> GraphData {
        let (vertices, edges) = (self.vertices.clone(), self.edges.clone());
        GraphData { vertices, edges, legs: self.legs, moves: self.moves.clone() }
    }

    /// Returns this graph for a body with these moves of its own.
    #[must_use]
    pub fn with_moves(self, moves: Arc<[OwnMove]>) -> Self {
        Self { moves, ..self }
    }

    /// Returns the moves of the body's own.
    pub fn moves(&self) -> &Arc<[OwnMove]> {
        &self.moves
    }

    /// Returns the name of an ability of the body, in snake case.
    pub fn name_of(&self, ability: Ability) -> &str {
        OwnMove::name_in(&self.moves, ability)
    }

    /// Returns the ability of the body with this name.
    pub fn ability_named(&self, name: &str) -> Option<Ability> {
        OwnMove::named_in(&self.moves, name)
    }

    /// Iterates over all abilities that the body may have, with their names.
    pub fn abilities(&self) -> impl Iterator<Item = (Ability, &str)> {
        OwnMove::all_with(&self.moves)
    }

    /// Returns the cost model of unproved legs.
    pub fn legs(&self) -> &LegModel {
        &self.legs
    }

    /// Returns the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
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
        self.edges.len()
    }

    /// Returns the position of a vertex, m.
    ///
    /// # Panics
    /// If the graph has no such vertex.
    pub fn position(&self, vertex: VertexId) -> Vec3 {
        self.vertices[vertex.idx()]
    }

    /// Returns the positions of all vertices, m.
    pub fn positions(&self) -> &[Vec3] {
        &self.vertices
    }

    /// Iterates over the edges that leave a vertex, the last in the graph first.
    pub fn edges_from(&self, vertex: VertexId) -> impl Iterator<Item = &Edge> {
        self.leaving.row(vertex.idx()).iter().rev().map(|&edge| &self.edges[edge as usize])
    }

    /// Returns the edge between two vertices, if there is one.
    pub fn edge(&self, key: EdgeKey) -> Option<&Edge> {
        let leaving = if self.has_vertex(key.from) { self.leaving.row(key.from.idx()) } else { &[] };
        let found = leaving.iter().rev().find(|&&edge| self.keys[edge as usize] == key)?;
        Some(&self.edges[*found as usize])
    }

    /// Returns whether any edge leaves the vertex.
    pub fn has_exit(&self, vertex: VertexId) -> bool {
        !self.leaving.row(vertex.idx()).is_empty()
    }

    /// Returns whether any edge leads to the vertex.
    pub fn has_entrance(&self, vertex: VertexId) -> bool {
        self.has_entrance[vertex.idx()]
    }

    /// Iterates over all edges.
    pub fn edges(&self) -> impl Iterator<Item = &Edge> {
        self.edges.iter()
    }

    /// Returns the number of islands (strongly connected components).
    pub fn island_count(&self) -> u32 {
        self.islands.count() as u32
    }

    /// Returns the island of each vertex, from 0 to `island_count` - 1.
    pub fn islands(&self) -> &[u32] {
        &self.islands.of
    }

    /// The islands, and how edges join them.
    pub(crate) fn connectivity(&self) -> &Islands {
        &self.islands
    }

    /// Returns for each vertex whether it can be reached from `from`; `from` itself counts as reached.
    pub fn reachable_from(&self, from: VertexId) -> Vec<bool> {
        let next = |vertex: VertexId| self.leaving.row(vertex.idx()).iter().map(|&edge| self.keys[edge as usize].to);
        flood(self.vertex_count(), [from], next)
    }

    /// Returns for each vertex whether a path leads from it to `to`; `to` itself counts.
    pub fn reaching(&self, to: VertexId) -> Vec<bool> {
        let entering = Csr::group(self.vertex_count(), self.keys.iter().map(|key| (key.to.idx(), key.from)));
        flood(self.vertex_count(), [to], |vertex| entering.row(vertex.idx()).iter().copied())
    }

    /// Returns the share of ordered pairs of different vertices that a path joins, in [0, 1].
    pub fn connected_share(&self) -> f64 {
        share(&self.islands)
    }

    /// Like [`connected_share`](Self::connected_share), without the edges that `is_removed` accepts.
    pub fn connected_share_without(&self, is_removed: impl Fn(&Edge) -> bool) -> f64 {
        let keys: Vec<EdgeKey> = self.edges().filter(|edge| !is_removed(edge)).map(|edge| edge.key).collect();
        share(&Islands::new(self.vertex_count(), &keys))
    }
}

/// The share of ordered pairs of different vertices that a path joins.
fn share(islands: &Islands) -> f64 {
    let count = islands.of.len();
    islands.joined_pairs(&islands.sizes(|_| 1)) as f64 / (count * count.saturating_sub(1)).max(1) as f64
}

/// Whether a vertex can be at `place`, m.
pub(crate) fn is_place(place: Vec3) -> bool {
    place.is_finite() && place.abs().max_element() <= MAX_COORDINATE_M
}
