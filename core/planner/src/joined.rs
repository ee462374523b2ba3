//! Which of many pairs of vertices are joined by a path, in memory that grows with the graph and the pairs alone.

use crate::graph::NavGraph;
use crate::ids::EdgeKey;

/// Islands from which paths are followed at a time: a bit each.
const LANES: usize = 64;

/// Returns whether a path leads from the first to the second vertex of each pair, in order.
pub(crate) fn are_joined(graph: &NavGraph, pairs: &[EdgeKey]) -> Vec<bool> {
    let islands = graph.islands();
    let ends = |key: &EdgeKey| [key.from, key.to].map(|vertex| islands[vertex.idx()] as usize);
    let mut are_joined: Vec<bool> = pairs.iter().map(|key| islands[key.from.idx()] == islands[key.to.idx()]).collect();
    // Islands are numbered in reverse topological order: paths lead to lower numbers.
    let mut open: Vec<(usize, usize, usize)> = Vec::new();
    for (idx, [from, to]) in pairs.iter().map(ends).enumerate().filter(|(_, [from, to])| from > to) {
        open.push((from, to, idx));
    }
    open.sort_unstable();
    let mut next: Vec<Vec<u32>> = vec![Vec::new(); graph.island_count() as usize];
    for [from, to] in graph.edges().map(|edge| ends(&edge.key)).filter(|[from, to]| from != to) {
        next[from].push(to as u32);
    }
    // For each island the lanes that reach it.
    let mut reached = vec![0_u64; next.len()];
    let mut rest = open.as_slice();
    while let Some(&(lowest_source, ..)) = rest.first() {
        let mut lanes = vec![lowest_source];
        let mut count = 0;
        while let Some(&(from, ..)) = rest.get(count) {
            if lanes.last() != Some(&from) {
                if lanes.len() == LANES {
                    break;
                }
                lanes.push(from);
            }
            count += 1;
        }
        let (chunk, others) = rest.split_at(count);
        rest = others;
        let lowest = chunk.iter().map(|(_, to, _)| *to).min().unwrap_or(lowest_source);
        let highest = lanes[lanes.len() - 1];
        lanes.iter().enumerate().for_each(|(lane, &source)| reached[source] |= 1 << lane);
        for island in (lowest..=highest).rev().filter(|&island| !next[island].is_empty()) {
            let lanes = reached[island];
            if lanes != 0 {
                next[island].iter().filter(|&&to| to as usize >= lowest).for_each(|&to| reached[to as usize] |= lanes);
            }
        }
        let mut lane = 0;
        for &(from, to, idx) in chunk {
            lane += usize::from(lanes[lane] != from);
            are_joined[idx] = reached[to] & 1 << lane != 0;
        }
        reached[lowest..=highest].fill(0);
    }
    are_joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Evidence;
    use crate::ids::VertexId;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use surefoot_world::{Decisions, Vec3};

    #[test]
    fn pairs_are_joined_as_searches_from_each_vertex_say() {
        for (seed, edges_per_vertex) in (0..40).flat_map(|seed| [0.3, 0.8, 1.2, 3.0].map(|edges| (seed, edges))) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let count = rng.random_range(2..300_u32);
            let mut pairs = |count_of: u32| {
                let pair = |_| EdgeKey::new(rng.random_range(0..count), rng.random_range(0..count));
                (0..count_of).map(pair).filter(|key| key.from != key.to).collect::<Vec<EdgeKey>>()
            };
            let candidates = pairs((count as f32 * edges_per_vertex) as u32);
            let evidence = vec![Evidence::vouched(Decisions(1.0)); candidates.len()];
            let graph = NavGraph::prove(vec![Vec3::ZERO; count as usize], &candidates, &evidence, 0.5);
            let asked = pairs(2000);
            let reached: Vec<Vec<bool>> = (0..count).map(|from| graph.reachable_from(VertexId(from))).collect();
            let expected: Vec<bool> = asked.iter().map(|key| reached[key.from.idx()][key.to.idx()]).collect();
            assert_eq!(are_joined(&graph, &asked), expected, "seed {seed}, {count} vertices");
        }
    }
}
