//! Identifiers of vertices, edges, and the stops of a plan.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Index of a vertex of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct VertexId(pub u32);

impl VertexId {
    /// Creates the id of the vertex at index `idx`.
    ///
    /// # Panics
    /// If `idx` does not fit into 32 bits.
    pub fn at(idx: usize) -> Self {
        Self(u32::try_from(idx).expect("graphs have fewer than 2^32 vertices"))
    }

    /// Returns the id as an array index.
    pub fn idx(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for VertexId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// An ordered pair of vertices: a directed edge, or a candidate for one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct EdgeKey {
    /// Vertex that the edge leaves.
    pub from: VertexId,
    /// Vertex that the edge reaches.
    pub to: VertexId,
}

impl EdgeKey {
    /// Creates the key of the edge from vertex `from` to vertex `to`.
    pub fn new(from: u32, to: u32) -> Self {
        Self { from: VertexId(from), to: VertexId(to) }
    }

    /// Returns the key of the edge in the opposite direction.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self { from: self.to, to: self.from }
    }
}

/// Where a leg of a plan begins or ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stop {
    /// The start of the query.
    Start,
    /// A vertex of the graph.
    Vertex(VertexId),
    /// The goal of the query.
    Goal,
}

/// The two ends of a leg.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LegKey {
    /// Stop where the leg begins.
    pub from: Stop,
    /// Stop where the leg ends.
    pub to: Stop,
}

impl LegKey {
    /// The leg that leads straight from the start to the goal.
    pub const DIRECT: Self = Self { from: Stop::Start, to: Stop::Goal };

    /// Returns the edge that the leg runs along; `None` if it begins at the start or ends at the goal.
    pub fn edge(self) -> Option<EdgeKey> {
        match (self.from, self.to) {
            (Stop::Vertex(from), Stop::Vertex(to)) => Some(EdgeKey { from, to }),
            _ => None,
        }
    }
}

impl From<EdgeKey> for LegKey {
    fn from(EdgeKey { from, to }: EdgeKey) -> Self {
        Self { from: Stop::Vertex(from), to: Stop::Vertex(to) }
    }
}
