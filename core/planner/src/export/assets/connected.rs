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
