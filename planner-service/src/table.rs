//! Edges in flat arrays, and the table of next hops over them.

use crate::graph::NavGraph;
use crate::search::{Leg, proved_leg};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Stands for "no way" in a [`Table`].
const NO_WAY: u8 = u8::MAX;

/// A graph's edges by the vertex they leave. A road is the index of one of them.
#[derive(Debug)]
pub(crate) struct Roads {
    /// First road of each vertex, and one more at the end.
    starts: Vec<u32>,
    legs: Vec<Leg>,
    costs: Vec<f32>,
}

impl Roads {
    pub fn new(graph: &NavGraph) -> Self {
        let mut roads = Self { starts: vec![0], legs: Vec::new(), costs: Vec::new() };
        for vertex in 0..graph.vertex_count() as u32 {
            for edge in graph.edges_from(vertex) {
                roads.legs.push(proved_leg(edge.from, edge.to, &edge.evidence));
                roads.costs.push(edge.evidence.cost() as f32);
            }
            roads.starts.push(roads.legs.len() as u32);
        }
        roads
    }

    /// Whether every vertex has few enough roads for a [`Table`].
    pub fn fits_table(&self) -> bool {
        self.starts.windows(2).all(|pair| pair[1] - pair[0] < u32::from(NO_WAY))
    }

    pub fn vertex_count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Vertices that a road leaves and reaches.
    pub fn ends(&self, road: u32) -> (u32, u32) {
        let leg = &self.legs[road as usize];
        (leg.from, leg.to)
    }

    pub fn leg(&self, road: u32) -> Leg {
        self.legs[road as usize]
    }

    /// Roads that leave a vertex, each with the vertex it reaches and its cost.
    pub fn leaving(&self, vertex: u32) -> impl Iterator<Item = (u32, u32, f32)> {
        let range = self.starts[vertex as usize]..self.starts[vertex as usize + 1];
        range.map(|road| (road, self.legs[road as usize].to, self.costs[road as usize]))
    }
}

/// For every pair of vertices what the cheapest way costs and which road it begins with: 5 bytes a pair.
#[derive(Debug)]
pub(crate) struct Table {
    vertex_count: usize,
    /// Place of each vertex in the rows: by where it stands, so that what is asked together lies together.
    ranks: Vec<u32>,
    /// By goal, then by rank: cost of the way.
    costs: Vec<f32>,
    /// By goal, then by rank: place of the first road among those that leave the vertex.
    hops: Vec<u8>,
}

/// Roads by the vertex they reach.
struct Arrivals {
    starts: Vec<u32>,
    /// Vertex that it leaves, place among those that leave it, cost.
    roads: Vec<(u32, u8, f32)>,
}

impl Arrivals {
    fn new(roads: &Roads) -> Self {
        let vertex_count = roads.vertex_count();
        let mut starts = vec![0u32; vertex_count + 1];
        roads.legs.iter().for_each(|leg| starts[leg.to as usize + 1] += 1);
        (1..starts.len()).for_each(|idx| starts[idx] += starts[idx - 1]);
        let mut next = starts.clone();
        let mut arrivals = vec![(0, 0, 0.0); roads.legs.len()];
        for vertex in 0..vertex_count as u32 {
            for (place, (_, to, cost)) in (0u8..).zip(roads.leaving(vertex)) {
                arrivals[next[to as usize] as usize] = (vertex, place, cost);
                next[to as usize] += 1;
            }
        }
        Self { starts, roads: arrivals }
    }

    fn at(&self, vertex: u32) -> &[(u32, u8, f32)] {
        &self.roads[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize]
    }
}

impl Table {
    /// Runs Dijkstra's algorithm backwards from every vertex; `order` lists all vertices by where they stand.
    pub fn fill(roads: &Roads, order: &[u32], thread_count: usize) -> Self {
        let vertex_count = roads.vertex_count();
        let mut ranks = vec![0; vertex_count];
        (0..).zip(order).for_each(|(rank, &vertex)| ranks[vertex as usize] = rank);
        let mut table = Self {
            vertex_count,
            ranks,
            costs: vec![f32::INFINITY; vertex_count * vertex_count],
            hops: vec![NO_WAY; vertex_count * vertex_count],
        };
        let arrivals = Arrivals::new(roads);
        let rows_each = vertex_count.div_ceil(thread_count.max(1)).max(1);
        let chunk_len = (rows_each * vertex_count).max(1);
        std::thread::scope(|scope| {
            let chunks = table.costs.chunks_mut(chunk_len).zip(table.hops.chunks_mut(chunk_len));
            for (chunk_idx, (costs, hops)) in chunks.enumerate() {
                let (arrivals, ranks) = (&arrivals, &table.ranks);
                scope.spawn(move || {
                    let rows = costs.chunks_exact_mut(vertex_count).zip(hops.chunks_exact_mut(vertex_count));
                    for (row, (costs, hops)) in rows.enumerate() {
                        fill_row(arrivals, ranks, (chunk_idx * rows_each + row) as u32, costs, hops);
                    }
                });
            }
        });
        table
    }

    /// Cost of the cheapest way, infinite if there is none.
    pub fn cost(&self, from: u32, to: u32) -> f32 {
        self.costs[to as usize * self.vertex_count + self.ranks[from as usize] as usize]
    }

    /// Roads of the cheapest way, in order; none if there is no way.
    pub fn way(&self, roads: &Roads, from: u32, to: u32) -> Vec<u32> {
        let row = &self.hops[to as usize * self.vertex_count..][..self.vertex_count];
        let mut way = Vec::with_capacity(32);
        let mut at = from;
        while at != to {
            let hop = row[self.ranks[at as usize] as usize];
            if hop == NO_WAY {
                break;
            }
            let road = roads.starts[at as usize] + u32::from(hop);
            way.push(road);
            at = roads.legs[road as usize].to;
        }
        way
    }
}

fn fill_row(arrivals: &Arrivals, ranks: &[u32], goal: u32, costs: &mut [f32], hops: &mut [u8]) {
    let rank = |vertex: u32| ranks[vertex as usize] as usize;
    // Costs are not negative, so their bits sort like they do.
    let key = |cost: f32, vertex: u32| Reverse(u64::from(cost.to_bits()) << 32 | u64::from(vertex));
    let mut open = BinaryHeap::with_capacity(costs.len());
    costs[rank(goal)] = 0.0;
    open.push(key(0.0, goal));
    while let Some(Reverse(entry)) = open.pop() {
        let (so_far, vertex) = (f32::from_bits((entry >> 32) as u32), entry as u32);
        if so_far > costs[rank(vertex)] {
            continue;
        }
        for &(from, place, cost) in arrivals.at(vertex) {
            let next = so_far + cost;
            if next < costs[rank(from)] {
                costs[rank(from)] = next;
                hops[rank(from)] = place;
                open.push(key(next, from));
            }
        }
    }
}
