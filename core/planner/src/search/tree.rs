//! The cheapest paths between attachments and the vertices, in either direction: a search that goes on as far as its
//! caller asks.

use super::{Path, Router};
use crate::ids::VertexId;
use crate::search::adjacency::EdgeIdx;
use crate::search::attach::Attachment;
use crate::search::frontier::Frontier;
use crate::search::zoned::Search;

/// Where the paths of a tree lead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Growth {
    /// From the attachments to the vertices.
    Forwards,
    /// From the vertices to the attachments.
    Backwards,
}

/// What the paths of a tree may use, and what it costs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Terms<'a> {
    pub router: &'a Router,
    pub search: &'a Search<'a>,
}

/// The cheapest paths found so far.
#[derive(Debug)]
pub(super) struct Tree {
    growth: Growth,
    /// The attachments that it grows from.
    roots: Vec<Attachment>,
    frontier: Frontier<f32>,
    /// The edge between each vertex and the one before it, seen from the attachments.
    edges: Vec<Option<EdgeIdx>>,
}

impl Tree {
    /// A tree of the attachments alone.
    pub fn new(roots: &[Attachment], growth: Growth, router: &Router) -> Self {
        let count = router.adjacency.vertex_count();
        let mut frontier = Frontier::new(count);
        roots.iter().for_each(|&(vertex, price)| _ = frontier.offer(vertex.0, price));
        Self { growth, roots: roots.to_vec(), frontier, edges: vec![None; count] }
    }

    /// The attachments that it grows from.
    pub fn roots(&self) -> &[Attachment] {
        &self.roots
    }

    /// The cost of the cheapest path found so far, in decisions; infinite without one.
    pub fn cost(&self, vertex: VertexId) -> f32 {
        self.frontier.cost(vertex.0)
    }

    /// Grows by the vertex that costs least, if it costs at most `limit`. Calls `offer` with each edge that improves
    /// on the paths before, and the vertex at its other end.
    pub fn grow(
        &mut self,
        Terms { router, search }: Terms<'_>,
        limit: f32,
        mut offer: impl FnMut(EdgeIdx, VertexId),
    ) -> Option<VertexId> {
        let (vertex, so_far) = self.frontier.settle(limit)?;
        let vertex = VertexId(vertex);
        let mut visit = |(edge, other, careful): (EdgeIdx, VertexId, f32)| {
            let next = so_far + router.price(search, edge, careful);
            if next < self.frontier.cost(other.0) && router.is_open(search, edge) {
                self.frontier.offer(other.0, next);
                self.edges[other.idx()] = Some(edge);
                offer(edge, other);
            }
        };
        match self.growth {
            Growth::Forwards => router.adjacency.outgoing(vertex).for_each(&mut visit),
            Growth::Backwards => router.adjacency.incoming(vertex).for_each(&mut visit),
        }
        Some(vertex)
    }

    /// Finds the cheapest path between the attachments of the tree and `others`, and grows as far as that takes.
    pub fn path(&mut self, others: &[Attachment], terms: Terms<'_>) -> Option<Path> {
        let (cost, vertex) = loop {
            let joined = others.iter().map(|&(vertex, price)| (self.cost(vertex) + price, vertex));
            let best = joined.min_by(|(one, _), (other, _)| one.total_cmp(other))?;
            if self.grow(terms, best.0, |_, _| {}).is_none() {
                break best;
            }
        };
        (cost < f32::INFINITY).then(|| self.path_between(vertex, cost, terms.router))
    }

    /// The path between `vertex` and the attachments.
    fn path_between(&self, vertex: VertexId, cost: f32, router: &Router) -> Path {
        let (mut edges, mut at) = (Vec::new(), vertex);
        while let Some(edge) = self.edges[at.idx()] {
            edges.push(edge);
            let key = router.adjacency.key(edge);
            at = if self.growth == Growth::Forwards { key.from } else { key.to };
        }
        match self.growth {
            Growth::Forwards => {
                edges.reverse();
                Path { cost, first: at, edges }
            }
            Growth::Backwards => Path { cost, first: vertex, edges },
        }
    }
}
