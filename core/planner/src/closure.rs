//! Which islands lead to which. Islands are numbered in reverse topological order: paths lead to lower numbers. They are given by their
//! exits, the islands that edges lead to, each once.

use crate::ids::VertexId;
use std::ops::Range;

/// Most islands of which it is known; the bits take 8 MB.
const MAX_ISLANDS: usize = 8192;
/// Number of islands whose predecessors are counted at a time; a row of bits for each island takes 128 bytes.
const BLOCK: usize = 1024;

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
    /// The closure of a graph whose vertices lie on these islands; `None` if there are too many.
    pub fn new(islands: &[u32], exits: &[Vec<u32>]) -> Option<Self> {
        let count = exits.len();
        (count <= MAX_ISLANDS).then(|| Self {
            islands: islands.to_vec(),
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
            join(&mut bits, &self.bits[start as usize * self.width..][..self.width]);
        }
        Reached { islands: &self.islands, bits }
    }
}

/// The vertices that paths lead to from some.
#[derive(Debug)]
pub(crate) struct Reached<'a> {
    islands: &'a [u32],
    /// A bit for each island.
    bits: Vec<u64>,
}

impl Reached<'_> {
    /// Whether a path leads to `vertex`.
    pub fn contains(&self, vertex: VertexId) -> bool {
        let island = self.islands[vertex.idx()] as usize;
        self.bits[island / 64] & 1 << (island % 64) != 0
    }
}

/// For each island the sum of the sizes of all islands that paths lead to, itself included.
pub(crate) fn reached_sizes(exits: &[Vec<u32>], sizes: &[u64]) -> Vec<u64> {
    let count = exits.len();
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
fn reached_among(exits: &[Vec<u32>], block: Range<usize>) -> Vec<u64> {
    let width = block.len().div_ceil(64);
    let mut bits = vec![0_u64; (exits.len() - block.start) * width];
    // No path leads from islands before the block into it.
    for (idx, exits) in exits[block.start..].iter().enumerate() {
        let (known, rest) = bits.split_at_mut(idx * width);
        let row = &mut rest[..width];
        if idx < block.len() {
            row[idx / 64] |= 1 << (idx % 64);
        }
        for other in exits.iter().filter_map(|other| (*other as usize).checked_sub(block.start)) {
            join(row, &known[other * width..][..width]);
        }
    }
    bits
}

fn join(row: &mut [u64], more: &[u64]) {
    row.iter_mut().zip(more).for_each(|(word, more)| *word |= more);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Which islands paths lead to from one, by walking all of them.
    fn walked(exits: &[Vec<u32>], from: u32) -> Vec<bool> {
        let mut seen = vec![false; exits.len()];
        let mut open = vec![from];
        while let Some(island) = open.pop() {
            if !std::mem::replace(&mut seen[island as usize], true) {
                open.extend(&exits[island as usize]);
            }
        }
        seen
    }

    /// Islands with up to three exits each, all to lower numbers, and sizes.
    fn islands(most: usize) -> impl Strategy<Value = (Vec<Vec<u32>>, Vec<u64>)> {
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
        #![proptest_config(ProptestConfig { cases: 64, rng_seed: proptest::test_runner::RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn what_is_reached_is_what_a_walk_reaches((exits, sizes) in islands(200), from in prop::collection::vec(any::<prop::sample::Index>(), 1..5)) {
            let of_vertices: Vec<u32> = (0..exits.len() as u32).collect();
            let closure = Closure::new(&of_vertices, &exits).unwrap();
            let from: Vec<u32> = from.iter().map(|from| from.index(exits.len()) as u32).collect();
            let reached = closure.reached_from(from.iter().copied().map(VertexId));
            let walks: Vec<Vec<bool>> = from.iter().map(|&from| walked(&exits, from)).collect();
            for island in 0..exits.len() {
                prop_assert_eq!(reached.contains(VertexId::at(island)), walks.iter().any(|walk| walk[island]));
            }
            for (island, sum) in (0..).zip(reached_sizes(&exits, &sizes)) {
                let walk = walked(&exits, island);
                prop_assert_eq!(sum, sizes.iter().zip(walk).filter(|(_, reached)| *reached).map(|(size, _)| size).sum::<u64>());
            }
        }
    }

    #[test]
    fn sizes_add_up_over_several_blocks() {
        // A chain: each island leads to the one below it.
        let count = 2 * BLOCK + 70;
        let exits: Vec<Vec<u32>> =
            (0..count as u32).map(|island| island.checked_sub(1).into_iter().collect()).collect();
        let sizes: Vec<u64> = (0..count as u64).map(|island| island % 3).collect();
        let mut sum = 0;
        for (size, reached) in sizes.iter().zip(reached_sizes(&exits, &sizes)) {
            sum += size;
            assert_eq!(reached, sum);
        }
    }

    #[test]
    fn islands_beyond_the_limit_have_no_closure() {
        let of = |count: usize| Closure::new(&[], &vec![Vec::new(); count]);
        assert!(of(MAX_ISLANDS).is_some() && of(MAX_ISLANDS + 1).is_none());
    }
}
