//! The table of next hops: for every ordered pair of vertices the cost of the cheapest path and its first edge.

use crate::ids::VertexId;
use crate::search::adjacency::{Adjacency, EdgeIdx, IncomingEdges};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Hop that stands for "no path".
const NO_PATH: u8 = u8::MAX;

/// Costs and next hops, 5 bytes for each ordered pair of vertices.
#[derive(Debug)]
pub(crate) struct Table {
    vertex_count: usize,
    /// Column of each vertex in the rows, in spatial order: vertices that are queried together lie close in memory.
    ranks: Vec<u32>,
    /// Cost of the path in decisions, by goal, then by rank; infinite without a path.
    costs: Vec<f32>,
    /// Index of the path's first edge among the outgoing edges of the vertex, by goal, then by rank.
    hops: Vec<u8>,
}

impl Table {
    /// Fills the table by running Dijkstra's algorithm backwards from every vertex, on `thread_count` threads. `order` lists
    /// all vertices in spatial order.
    pub fn fill(adjacency: &Adjacency, order: &[u32], thread_count: usize) -> Self {
        let vertex_count = adjacency.vertex_count();
        let mut ranks = vec![0; vertex_count];
        (0..).zip(order).for_each(|(rank, &vertex)| ranks[vertex as usize] = rank);
        let mut table = Self {
            vertex_count,
            ranks,
            costs: vec![f32::INFINITY; vertex_count * vertex_count],
            hops: vec![NO_PATH; vertex_count * vertex_count],
        };
        let incoming = IncomingEdges::new(adjacency);
        let rows_each = vertex_count.div_ceil(thread_count.max(1)).max(1);
        let chunk_len = (rows_each * vertex_count).max(1);
        std::thread::scope(|scope| {
            let chunks = table.costs.chunks_mut(chunk_len).zip(table.hops.chunks_mut(chunk_len));
            for (chunk_idx, (costs, hops)) in chunks.enumerate() {
                let (incoming, ranks) = (&incoming, &table.ranks);
                scope.spawn(move || {
                    let rows = costs.chunks_exact_mut(vertex_count).zip(hops.chunks_exact_mut(vertex_count));
                    for (row_idx, (costs, hops)) in rows.enumerate() {
                        let goal = VertexId::at(chunk_idx * rows_each + row_idx);
                        Row { ranks, costs, hops }.fill(incoming, goal);
                    }
                });
            }
        });
        table
    }

    /// Returns the cost of the cheapest path in decisions; infinite if there is none.
    pub fn cost(&self, from: VertexId, to: VertexId) -> f32 {
        self.costs[to.idx() * self.vertex_count + self.ranks[from.idx()] as usize]
    }

    /// Returns the edges of the cheapest path in order; empty if there is no path.
    pub fn path(&self, adjacency: &Adjacency, from: VertexId, to: VertexId) -> Vec<EdgeIdx> {
        let row = &self.hops[to.idx() * self.vertex_count..][..self.vertex_count];
        let mut path = Vec::with_capacity(32);
        let mut at = from;
        while at != to {
            let hop = row[self.ranks[at.idx()] as usize];
            if hop == NO_PATH {
                break;
            }
            let edge = adjacency.nth_from(at, hop);
            path.push(edge);
            at = adjacency.hop(edge).to;
        }
        path
    }
}

/// The rows of the table for one goal.
struct Row<'a> {
    ranks: &'a [u32],
    costs: &'a mut [f32],
    hops: &'a mut [u8],
}

impl Row<'_> {
    fn fill(self, incoming: &IncomingEdges, goal: VertexId) {
        let Self { ranks, costs, hops } = self;
        let rank = |vertex: VertexId| ranks[vertex.idx()] as usize;
        // The bits of non-negative floats sort in the same order as the floats.
        let entry = |cost: f32, vertex: VertexId| Reverse(u64::from(cost.to_bits()) << 32 | u64::from(vertex.0));
        let mut open = BinaryHeap::with_capacity(costs.len());
        costs[rank(goal)] = 0.0;
        open.push(entry(0.0, goal));
        while let Some(Reverse(entry_bits)) = open.pop() {
            let (so_far, vertex) = (f32::from_bits((entry_bits >> 32) as u32), VertexId(entry_bits as u32));
            if so_far > costs[rank(vertex)] {
                continue;
            }
            for edge in incoming.at(vertex) {
                let next = so_far + edge.cost;
                if next < costs[rank(edge.from)] {
                    costs[rank(edge.from)] = next;
                    hops[rank(edge.from)] = edge.out_idx;
                    open.push(entry(next, edge.from));
                }
            }
        }
    }
}
