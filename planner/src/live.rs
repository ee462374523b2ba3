//! Live evidence: traversals that NPCs have reported since edges were proved.

use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::ids::EdgeKey;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Number of tries of an edge at which all its tries are halved in weight, so that recent tries can change the estimate.
const MEMORY: u32 = 64;

/// A traversal of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traversal {
    /// The edge.
    pub edge: EdgeKey,
    /// Whether the NPC arrived.
    pub reached: bool,
    /// Number of decisions.
    pub decisions: u32,
}

/// Evidence from traversals, by edge.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveEvidence {
    edges: BTreeMap<EdgeKey, Evidence>,
}

impl LiveEvidence {
    /// Returns whether there are no traversals.
    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// Adds a traversal of an edge of `graph`. Returns the new cost of the edge in decisions; `None` if `graph` has no such edge.
    pub fn note(&mut self, graph: &NavGraph, traversal: &Traversal) -> Option<f64> {
        let edge = graph.edge(traversal.edge)?;
        let live = self.edges.entry(traversal.edge).or_default();
        live.note(traversal.reached, traversal.decisions, edge.evidence.ability);
        if live.tries >= MEMORY {
            live.halve();
        }
        Some(edge.evidence.and(live).cost())
    }

    /// Returns `graph` with the live evidence added to its edges. Evidence of edges that `graph` does not have is ignored.
    pub fn apply_to(&self, graph: &NavGraph) -> NavGraph {
        let mut data = graph.to_data();
        for edge in &mut data.edges {
            if let Some(live) = self.edges.get(&edge.key) {
                // A sum is unsound only if it overflows; the edge then keeps the evidence of its probes.
                let both = edge.evidence.and(live);
                edge.evidence = if both.is_sound() { both } else { edge.evidence };
            }
        }
        NavGraph::check(data).expect("sound evidence was added to a checked graph")
    }

    /// Returns whether the values can have come from traversals.
    pub fn is_sound(&self) -> bool {
        self.edges.values().all(|evidence| evidence.tries < MEMORY && evidence.is_consistent())
    }

    /// Removes the evidence of edges with a vertex whose index is `count` or higher.
    pub fn keep_below(&mut self, count: usize) {
        self.edges.retain(|key, _| key.from.idx() < count && key.to.idx() < count);
    }

    /// Returns the number of traversals that count; halving reduces it.
    pub fn traversals(&self) -> u64 {
        self.edges.values().map(|evidence| u64::from(evidence.tries)).sum()
    }
}
