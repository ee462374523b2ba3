//! The share of pairs of places that links connect.

use crate::ids::{EdgeKey, VertexId};
use crate::search::connectivity::Islands;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Shares of the ordered pairs of different vertices on the NavMesh between which a path leads, in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Connected {
    /// On the NavMesh alone.
    pub without: f64,
    /// With the links.
    pub with: f64,
}

impl Connected {
    /// Counts pairs of vertices; each vertex is on an island or off the NavMesh. Each of `joins` leads from one
    /// island to another; a join that begins or ends on none does not count.
    pub fn of(islands: &[Option<u32>], joins: impl Iterator<Item = (Option<u32>, Option<u32>)>) -> Self {
        // Nodes are islands of the NavMesh, weighted by the number of their vertices.
        let mut nodes: BTreeMap<u32, VertexId> = BTreeMap::new();
        let mut node = |island: u32| {
            let next = VertexId::at(nodes.len());
            *nodes.entry(island).or_insert(next)
        };
        let vertices: Vec<VertexId> = islands.iter().flatten().map(|&island| node(island)).collect();
        let joins = joins.filter_map(|(from, to)| from.zip(to));
        let joins: Vec<EdgeKey> = joins.map(|(from, to)| EdgeKey { from: node(from), to: node(to) }).collect();
        let mut weights = vec![0_u64; nodes.len()];
        vertices.iter().for_each(|vertex| weights[vertex.idx()] += 1);
        let alone: u64 = weights.iter().map(|size| size * size.saturating_sub(1)).sum();
        let groups = Islands::new(nodes.len(), &joins);
        let joined = groups.joined_pairs(&groups.sizes(|node| weights[node]));
        let count = vertices.len() as u64;
        let pairs = (count * count.saturating_sub(1)).max(1) as f64;
        Self { without: alone as f64 / pairs, with: joined as f64 / pairs }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn pairs_are_ordered_and_links_lead_one_way() {
        let islands = [Some(0), Some(0), Some(7), None];
        let alone = Connected::of(&islands, std::iter::empty());
        assert!((alone.without - 2.0 / 6.0).abs() < 1.0e-12 && alone.with == alone.without);
        let down = Connected::of(&islands, [(Some(0), Some(7)), (None, Some(0))].into_iter());
        assert!((down.with - 4.0 / 6.0).abs() < 1.0e-12);
        let both = Connected::of(&islands, [(Some(0), Some(5)), (Some(5), Some(7)), (Some(7), Some(0))].into_iter());
        assert_eq!(both.with, 1.0, "an island without vertices may lie between");
        assert_eq!(Connected::of(&[None], std::iter::empty()), Connected::default());
    }

    proptest! {
        #![proptest_config(crate::properties::cases(200))]

        #[test]
        fn shares_are_those_of_a_walk_from_every_vertex(
            islands in prop::collection::vec(prop::option::weighted(0.9, 0..12u32), 0..40),
            joins in prop::collection::vec(prop::array::uniform2(prop::option::weighted(0.9, 0..15u32)), 0..25),
        ) {
            let joins: Vec<(Option<u32>, Option<u32>)> = joins.into_iter().map(|[from, to]| (from, to)).collect();
            let connected = Connected::of(&islands, joins.iter().copied());
            let vertices: Vec<u32> = islands.iter().copied().flatten().collect();
            let share = |joins: &[(Option<u32>, Option<u32>)]| {
                let joined = vertices.iter().map(|from| {
                    let mut reached = BTreeSet::from([*from]);
                    let joins = || joins.iter().filter_map(|(from, to)| from.zip(*to));
                    while joins().any(|(from, to)| reached.contains(&from) && reached.insert(to)) {}
                    vertices.iter().filter(|to| reached.contains(to)).count() - 1
                });
                joined.sum::<usize>() as f64 / (vertices.len() * vertices.len().saturating_sub(1)).max(1) as f64
            };
            prop_assert_eq!(connected, Connected { without: share(&[]), with: share(&joins) });
        }
    }
}
