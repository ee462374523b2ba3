//! Figures of a graph in memory, as clients see them.

use surefoot_planner::edits::Layer;
use surefoot_planner::{BuildStats, NavGraph};

/// Figures of a graph and of its build.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Content hash of the map, 64 hexadecimal digits.
    pub map_hash: String,
    pub stats: BuildStats,
    pub cached: bool,
    /// Figures of the graph as it is now.
    pub summary: Summary,
}

/// Figures of a graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    pub vertices: usize,
    pub edges: usize,
    /// Number of edges that have not been tried, because the build is still running.
    pub expected_edges: usize,
    pub islands: u32,
    /// Share of ordered pairs of vertices with a path, in [0, 1].
    pub connected: f64,
    /// Number of NPCs' traversals that count towards the evidence.
    pub traversals: u64,
    /// Number of edits in all layers.
    pub edits: usize,
    /// Number of edits that could not be applied.
    pub unapplied_edits: usize,
}

impl Summary {
    /// Figures of a graph without edits.
    pub fn of(graph: &NavGraph, connected: f64, traversals: u64) -> Self {
        Self {
            vertices: graph.vertex_count(),
            edges: graph.edge_count(),
            expected_edges: graph.edges().filter(|edge| edge.evidence.is_expected()).count(),
            islands: graph.island_count(),
            connected,
            traversals,
            edits: 0,
            unapplied_edits: 0,
        }
    }

    /// Adds the edits of these layers.
    pub fn with_edits(self, layers: &[Layer], unapplied_edits: usize) -> Self {
        Self { edits: layers.iter().map(|layer| layer.edits.len()).sum(), unapplied_edits, ..self }
    }
}
