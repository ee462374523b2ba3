//! What is reachable from where: islands (strongly connected components), the islands that paths lead to, and one
//! flood.

use crate::ids::{EdgeKey, VertexId};
use petgraph::algo::kosaraju_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use std::ops::Range;
use surefoot_world::csr::Csr;

/// Greatest number of islands that a [`Closure`] has; the bits take 8 MB.
const MAX_ISLANDS: usize = 8192;
/// Number of islands for which it is computed at a time from where they are reached; a row of bits takes 128 bytes.
const BLOCK: usize = 1024;

/// The islands of a directed graph: sets of vertices that all reach each other. Islands are numbered in reverse
/// topological order, so that paths lead to lower numbers.
#[derive(Debug, Clone)]
pub(crate) struct Islands {
    /// The island of each vertex.
    pub of: Vec<u32>,
    /// The other islands that the edges of each island lead to, in ascending order.
    pub exits: Csr<u32>,
}

impl Islands {
    /// The islands of `vertex_count` vertices with these edges.
    pub fn new(vertex_count: usize, edges: &[EdgeKey]) -> Self {
        let node = |vertex: VertexId| NodeIndex::new(vertex.idx());
        let mut graph: DiGraph<(), ()> = DiGraph::with_capacity(vertex_count, edges.len());
        (0..vertex_count).for_each(|_| _ = graph.add_node(()));
        edges.iter().for_each(|key| _ = graph.add_edge(node(key.from), node(key.to), ()));
        // petgraph's Tarjan is recursive: a long chain of vertices would overflow the stack.
        let components = kosaraju_scc(&graph);
        let mut of = vec![0; vertex_count];
        for (island, members) in (0..).zip(&components) {
            members.iter().for_each(|member| of[member.index()] = island);
        }
        let ends = edges.iter().map(|key| [key.from, key.to].map(|vertex| of[vertex.idx()]));
        let exits = ends.filter(|[from, to]| from != to).map(|[from, to]| (from as usize, to));
        let exits = Csr::group(components.len(), exits);
        let sorted = exits.rows().map(|row| {
            let mut row = row.to_vec();
            row.sort_unstable();
            row.dedup();
            row
        });
        let exits = sorted.collect();
        Self { of, exits }
    }

    /// Number of islands.
    pub fn count(&self) -> usize {
        self.exits.row_count()
    }

    /// The sum of the weights of the vertices of each island.
    pub fn sizes(&self, weight: impl Fn(usize) -> u64) -> Vec<u64> {
        let mut sizes = vec![0; self.count()];
        self.of.iter().enumerate().for_each(|(vertex, &island)| sizes[island as usize] += weight(vertex));
        sizes
    }

    /// Number of ordered pairs of different items that a path joins, if the islands have so many items.
    pub fn joined_pairs(&self, sizes: &[u64]) -> u64 {
        let reached = reached_sizes(&self.exits, sizes);
        sizes.iter().zip(reached).map(|(size, reached)| size * reached.saturating_sub(1)).sum()
    }

    /// Returns whether a path leads from the first to the second vertex of each pair, in order. Takes memory that grows
    /// with the islands and the pairs only.
    pub fn are_joined(&self, pairs: &[EdgeKey]) -> Vec<bool> {
        let island = |vertex: VertexId| self.of[vertex.idx()] as usize;
        let mut by_target: Vec<(usize, usize)> = pairs.iter().map(|key| island(key.to)).zip(0..).collect();
        by_target.sort_unstable();
        let mut are_joined = vec![false; pairs.len()];
        for chunk in by_target.chunk_by(|(one, _), (other, _)| one / BLOCK == other / BLOCK) {
            let first = chunk[0].0 / BLOCK * BLOCK;
            let block = first..self.count().min(first + BLOCK);
            let width = block.len().div_ceil(64);
            let reached = reached_among(&self.exits, block);
            for &(to, pair) in chunk {
                let row = island(pairs[pair].from).checked_sub(first);
                are_joined[pair] = row.is_some_and(|row| has_bit(&reached[row * width..], to - first));
            }
        }
        are_joined
    }
}

/// The nodes of a graph that paths lead to from any of `from`, these included; `next` lists where a node's edges lead.
pub(crate) fn flood<I: Iterator<Item = VertexId>>(
    node_count: usize,
    from: impl IntoIterator<Item = VertexId>,
    next: impl Fn(VertexId) -> I,
) -> Vec<bool> {
    let mut is_reached = vec![false; node_count];
    let mut open: Vec<VertexId> = from.into_iter().collect();
    open.iter().for_each(|node| is_reached[node.idx()] = true);
    while let Some(node) = open.pop() {
        for to in next(node) {
            if !std::mem::replace(&mut is_reached[to.idx()], true) {
                open.push(to);
            }
        }
    }
    is_reached
}

/// For each island the islands that paths lead to, itself included.
#[derive(Debug)]
pub(crate) struct Closure {
    /// The island of each vertex.
    islands: Vec<u32>,
    /// Number of words in a row.
    width: usize,
    /// A row of bits for each island.
    bits: Vec<u64>,
}

impl Closure {
    /// The closure of a graph with these islands; `None` above 8,192 islands.
    pub fn new(Islands { of, exits }: &Islands) -> Option<Self> {
        let count = exits.row_count();
        (count <= MAX_ISLANDS).then(|| Self {
            islands: of.clone(),
            width: count.div_ceil(64),
            bits: reached_among(exits, 0..count),
        })
    }

    /// The vertices that paths lead to from any of `from`, these included.
    pub fn reached_from(&self, from: impl IntoIterator<Item = VertexId>) -> Reached<'_> {
        let mut starts: Vec<u32> = from.into_iter().map(|vertex| self.islands[vertex.idx()]).collect();
        starts.sort_unstable();
        starts.dedup();
        let mut bits = vec![0; self.width];
        for start in starts {
            add_bits(&mut bits, &self.bits[start as usize * self.width..][..self.width]);
        }
        Reached { islands: &self.islands, bits }
    }
}

/// The vertices that paths lead to from some others.
#[derive(Debug)]
pub(crate) struct Reached<'a> {
    islands: &'a [u32],
    /// A bit for each island.
    bits: Vec<u64>,
}

impl Reached<'_> {
    /// Whether a path leads to `vertex`.
    pub fn contains(&self, vertex: VertexId) -> bool {
        has_bit(&self.bits, self.islands[vertex.idx()] as usize)
    }
}

/// For each island the sum of the sizes of all islands that paths lead to, itself included.
fn reached_sizes(exits: &Csr<u32>, sizes: &[u64]) -> Vec<u64> {
    let count = exits.row_count();
    let mut reached = vec![0; count];
    for first in (0..count).step_by(BLOCK) {
        let block = first..count.min(first + BLOCK);
        let width = block.len().div_ceil(64);
        // Most islands are single vertices: their bits are counted by the word.
        let mut large = vec![0_u64; width];
        for (bit, _) in sizes[block.clone()].iter().enumerate().filter(|(_, size)| **size != 1) {
            large[bit / 64] |= 1 << (bit % 64);
        }
        let rows = reached_among(exits, block);
        for (sum, row) in reached[first..].iter_mut().zip(rows.chunks_exact(width)) {
            for (word, (&bits, &large)) in row.iter().zip(&large).enumerate() {
                *sum += u64::from((bits & !large).count_ones());
                let mut left = bits & large;
                while left != 0 {
                    *sum += sizes[first + 64 * word + left.trailing_zeros() as usize];
                    left &= left - 1;
                }
            }
        }
    }
    reached
}

/// For each island from the first of `block` on, which islands of `block` paths lead to: a row of bits.
fn reached_among(exits: &Csr<u32>, block: Range<usize>) -> Vec<u64> {
    let width = block.len().div_ceil(64);
    let mut bits = vec![0_u64; (exits.row_count() - block.start) * width];
    // No path leads from islands before the block into it.
    for (idx, exits) in exits.rows().skip(block.start).enumerate() {
        let (known, rest) = bits.split_at_mut(idx * width);
        let row = &mut rest[..width];
        if idx < block.len() {
            row[idx / 64] |= 1 << (idx % 64);
        }
        for other in exits.iter().filter_map(|other| (*other as usize).checked_sub(block.start)) {
            add_bits(row, &known[other * width..][..width]);
        }
    }
    bits
}

fn add_bits(row: &mut [u64], more: &[u64]) {
    row.iter_mut().zip(more).for_each(|(word, more)| *word |= more);
}

fn has_bit(row: &[u64], bit: usize) -> bool {
    row[bit / 64] & 1 << (bit % 64) != 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// Which islands paths lead to from one.
    fn walked(exits: &Csr<u32>, from: u32) -> Vec<bool> {
        flood(exits.row_count(), [VertexId(from)], |island| exits.row(island.idx()).iter().copied().map(VertexId))
    }

    /// Islands with up to three exits each, all to lower numbers, and sizes.
    fn islands(most: usize) -> impl Strategy<Value = (Csr<u32>, Vec<u64>)> {
        let island =
            (prop::collection::vec(any::<prop::sample::Index>(), 0..4), prop_oneof![4 => Just(1_u64), 1 => 0..9_u64]);
        prop::collection::vec(island, 1..most).prop_map(|islands| {
            let exits = |(number, (exits, _)): (usize, &(Vec<prop::sample::Index>, u64))| {
                let exits = exits.iter().filter(|_| number > 0).map(|exit| exit.index(number) as u32);
                exits.collect::<std::collections::BTreeSet<u32>>().into_iter().collect()
            };
            (islands.iter().enumerate().map(exits).collect(), islands.iter().map(|(_, size)| *size).collect())
        })
    }

    proptest! {
        #![proptest_config(crate::properties::cases(64))]

        #[test]
        fn what_is_reached_is_what_a_walk_reaches(
            (exits, sizes) in islands(200),
            from in prop::collection::vec(any::<prop::sample::Index>(), 1..5),
        ) {
            let count = exits.row_count();
            let from: Vec<u32> = from.iter().map(|from| from.index(count) as u32).collect();
            let closure = Closure::new(&Islands { of: (0..count as u32).collect(), exits: exits.clone() }).unwrap();
            let reached = closure.reached_from(from.iter().copied().map(VertexId));
            let walks: Vec<Vec<bool>> = from.iter().map(|&from| walked(&exits, from)).collect();
            for island in 0..count {
                prop_assert_eq!(reached.contains(VertexId::at(island)), walks.iter().any(|walk| walk[island]));
            }
            for (island, sum) in (0..).zip(reached_sizes(&exits, &sizes)) {
                let walk = walked(&exits, island);
                let reached = sizes.iter().zip(walk).filter(|(_, reached)| *reached);
                prop_assert_eq!(sum, reached.map(|(size, _)| size).sum::<u64>());
            }
        }
    }

    #[test]
    fn sizes_add_up_over_several_blocks() {
        // A chain: each island leads to the one below it.
        let count = 2 * BLOCK + 70;
        let exits = (0..count as u32).map(|island| island.checked_sub(1).into_iter().collect()).collect();
        let sizes: Vec<u64> = (0..count as u64).map(|island| island % 3).collect();
        let mut sum = 0;
        for (size, reached) in sizes.iter().zip(reached_sizes(&exits, &sizes)) {
            sum += size;
            assert_eq!(reached, sum);
        }
    }

    #[test]
    fn islands_beyond_the_limit_have_no_closure() {
        let of = |count: usize| {
            Closure::new(&Islands { of: Vec::new(), exits: vec![Vec::new(); count].into_iter().collect() })
        };
        assert!(of(MAX_ISLANDS).is_some() && of(MAX_ISLANDS + 1).is_none());
    }

    #[test]
    fn pairs_are_joined_as_searches_from_each_vertex_say() {
        for (seed, edges_per_vertex) in (0..40).flat_map(|seed| [0.3, 0.8, 1.2, 3.0].map(|edges| (seed, edges))) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let count = rng.random_range(2..if seed == 0 { 3000 } else { 300_u32 });
            let mut pairs = |count_of: u32| {
                let pair = |_| EdgeKey::new(rng.random_range(0..count), rng.random_range(0..count));
                (0..count_of).map(pair).filter(|key| key.from != key.to).collect::<Vec<EdgeKey>>()
            };
            let edges = pairs((count as f32 * edges_per_vertex) as u32);
            let asked = pairs(2000);
            let leaving = Csr::group(count as usize, edges.iter().map(|key| (key.from.idx(), key.to)));
            let search = |from| flood(count as usize, [from], |vertex| leaving.row(vertex.idx()).iter().copied());
            let reached: Vec<Vec<bool>> = (0..count).map(|from| search(VertexId(from))).collect();
            let expected: Vec<bool> = asked.iter().map(|key| reached[key.from.idx()][key.to.idx()]).collect();
            let islands = Islands::new(count as usize, &edges);
            assert_eq!(islands.are_joined(&asked), expected, "seed {seed}, {count} vertices");
        }
    }
}
