//! Counts of the rows in a run's replay buffers, for checks of the bookkeeping.

use super::{Replay, RowKind};
use serde::Serialize;
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Counts of rows, over all buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Census {
    /// Number of buffers.
    pub buffers: usize,
    /// Stored rows.
    pub rows: usize,
    /// Transitions within episodes.
    pub continues: usize,
    /// Transitions that ended an episode in a terminal state.
    pub terminated: usize,
    /// Boundary rows: last observations of truncated attempts, and rows of waiting NPCs.
    pub boundaries: usize,
    /// Transitions that are stored more than once, with the same bits of observation, action and reward.
    pub twins: usize,
    /// Oldest and newest version of weights that chose an action, in updates.
    pub versions: (u64, u64),
}

/// Counts the rows of these buffers.
pub fn census(buffers: &[Replay]) -> Census {
    let mut census = Census { buffers: buffers.len(), ..Census::default() };
    let mut seen = HashSet::new();
    for row in buffers.iter().flat_map(|buffer| &buffer.rows) {
        census.rows += 1;
        match row.kind {
            RowKind::Continues => census.continues += 1,
            RowKind::Terminated => census.terminated += 1,
            RowKind::Boundary => {
                census.boundaries += 1;
                continue;
            }
        }
        let mut hasher = DefaultHasher::new();
        (row.proximity, row.surface, row.state.map(f32::to_bits)).hash(&mut hasher);
        (row.action.map(f32::to_bits), row.reward.to_bits()).hash(&mut hasher);
        census.twins += usize::from(!seen.insert(hasher.finish()));
    }
    let versions = || buffers.iter().flat_map(|buffer| buffer.versions.iter().copied());
    census.versions = (versions().min().unwrap_or(0), versions().max().unwrap_or(0));
    census
}
