//! What NPCs on their way have learned of edges since they were proved.

use crate::evidence::Evidence;
use crate::graph::NavGraph;
use crate::ids::EdgeKey;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Tries of one edge beyond which older ones count half, so that an edge can get better again, and worse.
const MEMORY: u32 = 64;

/// One traversal along an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traversal {
    /// The edge.
    pub edge: EdgeKey,
    /// Whether it arrived.
    pub reached: bool,
    /// Decisions taken.
    pub decisions: u32,
}

/// Traversals by edge.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveEvidence {
    edges: BTreeMap<EdgeKey, Evidence>,
}

impl LiveEvidence {
    /// Whether nothing has been reported.
    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// Adds a traversal along an edge of `graph`; what the edge costs from now on. `None` if there is no such edge.
    pub fn note(&mut self, graph: &NavGraph, traversal: &Traversal) -> Option<f64> {
        let edge = graph.edge(traversal.edge)?;
        let live = self.edges.entry(traversal.edge).or_default();
        live.note(traversal.reached, traversal.decisions, edge.evidence.ability);
        if live.tries >= MEMORY {
            live.halve();
        }
        Some(edge.evidence.and(live).cost())
    }

    /// The graph with what was reported added to what was proved. Edges that it does not have are passed over.
    pub fn apply_to(&self, graph: &NavGraph) -> NavGraph {
        let mut data = graph.to_data();
        for edge in &mut data.edges {
            if let Some(live) = self.edges.get(&edge.key) {
                // Only sums beyond all numbers make no sense; the proof alone stands then.
                let both = edge.evidence.and(live);
                edge.evidence = if both.is_sound() { both } else { edge.evidence };
            }
        }
        NavGraph::check(data).expect("sound evidence was added to a checked graph")
    }

    /// Whether its numbers can have come from traversals.
    pub fn is_sound(&self) -> bool {
        self.edges.values().all(|evidence| evidence.tries < MEMORY && evidence.is_consistent())
    }

    /// Forgets edges that touch vertices from number `count` on.
    pub fn keep_below(&mut self, count: usize) {
        self.edges.retain(|key, _| key.from.idx() < count && key.to.idx() < count);
    }

    /// Traversals that are remembered.
    pub fn traversals(&self) -> u64 {
        self.edges.values().map(|evidence| u64::from(evidence.tries)).sum()
    }
}
