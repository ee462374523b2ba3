//! Which islands of a graph lead to which.

use crate::graph::NavGraph;
use crate::ids::VertexId;

/// Most islands of which it is known; the bits take 8 MB.
const MAX_ISLANDS: usize = 8192;

/// For each island the islands that paths lead to, itself included.
#[derive(Debug)]
pub(crate) struct Closure {
    islands: Vec<u32>,
    /// Number of words in a row.
    width: usize,
    /// A row of bits for each island.
    bits: Vec<u64>,
}

impl Closure {
    /// The closure of a graph; `None` if it lies in crumbs.
    pub fn new(graph: &NavGraph) -> Option<Self> {
        let count = graph.island_count() as usize;
        let width = count.div_ceil(64);
        if count > MAX_ISLANDS {
            return None;
        }
        let mut next: Vec<Vec<u32>> = vec![Vec::new(); count];
        let islands = graph.islands();
        for edge in graph.edges() {
            let [from, to] = [edge.key.from, edge.key.to].map(|vertex| islands[vertex.idx()]);
            if from != to && next[from as usize].last() != Some(&to) {
                next[from as usize].push(to);
            }
        }
        let mut bits = vec![0_u64; count * width];
        // Islands are numbered in reverse topological order: paths lead to lower numbers.
        for (island, next) in next.into_iter().enumerate() {
            let (known, rest) = bits.split_at_mut(island * width);
            let row = &mut rest[..width];
            row[island / 64] |= 1 << (island % 64);
            for other in next {
                let other = other as usize;
                row.iter_mut().zip(&known[other * width..][..width]).for_each(|(word, more)| *word |= more);
            }
        }
        Some(Self { islands: islands.to_vec(), width, bits })
    }

    /// Whether a path leads from `from` to `to`.
    pub fn joins(&self, from: VertexId, to: VertexId) -> bool {
        let [from, to] = [from, to].map(|vertex| self.islands[vertex.idx()] as usize);
        self.bits[from * self.width + to / 64] & 1 << (to % 64) != 0
    }
}
