//! A graph's edges in flat arrays, by the vertex that they leave.

use crate::graph::NavGraph;
use crate::ids::{EdgeKey, VertexId};
use crate::plan::Leg;
use crate::price::EdgeCost;
use std::sync::OnceLock;
use surefoot_world::csr::Csr;
use surefoot_world::{Ability, Vec3};

/// Index of an edge in the arrays; edges that leave the same vertex are contiguous.
pub(crate) type EdgeIdx = u32;

/// A graph's edges by source vertex.
#[derive(Debug, Default)]
pub(crate) struct Adjacency {
    /// The edges that leave each vertex.
    keys: Csr<EdgeKey>,
    hops: Vec<Hop>,
    /// The most demanding ability that each edge needs, which is also in its hop: searches visit most edges.
    abilities: Vec<Ability>,
    /// Cost of each edge, in decisions, for careful plans.
    costs: Vec<f32>,
    /// The part of each cost that the risk of death makes up.
    death_costs: Vec<f32>,
    /// The edges that enter each vertex, computed for the first search against their direction.
    entering: OnceLock<Csr<EdgeIdx>>,
}

/// The part of an edge that a plan needs, in one cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Hop {
    /// Position of the vertex to which the edge leads, m.
    pub end: Vec3,
    /// The vertex to which the edge leads.
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

    pub fn vertex_count(&self) -> usize {
        self.keys.row_count()
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

    /// Iterates over the incoming edges of a vertex: index, source vertex, cost in decisions.
    pub fn incoming(&self, vertex: VertexId) -> impl Iterator<Item = (EdgeIdx, VertexId, f32)> {
        let entering = self.entering.get_or_init(|| {
            let ends = self.keys.items().iter().map(|key| key.to.idx());
            Csr::group(self.vertex_count(), ends.zip(0..))
        });
        let edges = entering.row(vertex.idx()).iter();
        edges.map(|&edge| (edge, self.key(edge).from, self.costs[edge as usize]))
    }
}
