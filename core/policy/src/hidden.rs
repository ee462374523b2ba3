//! The LSTM state of many NPCs, for recurrent policies.

use crate::actor::{Batch, Scratch};
use crate::policy::Policy;
use surefoot_world::character::Action;

/// One row of hidden state for each NPC, by index. Rows of a reactive policy are empty.
#[derive(Debug, Clone, Default)]
pub struct HiddenStates {
    len: usize,
    rows: Vec<f32>,
    /// Rows of the NPCs that decide together.
    gathered: Vec<f32>,
    scratch: Scratch,
}

impl HiddenStates {
    /// An empty store for `policy`.
    pub fn new(policy: &Policy) -> Self {
        Self::of_len(policy.memory_len())
    }

    /// An empty store with rows of `len` values.
    pub fn of_len(len: usize) -> Self {
        Self { len, ..Self::default() }
    }

    /// All rows, concatenated.
    pub fn rows(&self) -> &[f32] {
        &self.rows
    }

    /// Restores rows that [`rows`](Self::rows) returned.
    ///
    /// # Panics
    /// If `rows` is not a whole number of rows.
    pub fn set_rows(&mut self, rows: Vec<f32>) {
        assert!(rows.len().is_multiple_of(self.len.max(1)), "whole rows");
        self.rows = rows;
    }

    /// Resets the memory of NPC `idx` to zeros, adding rows as needed.
    pub fn forget(&mut self, idx: usize) {
        let end = (idx + 1) * self.len;
        if self.rows.len() < end {
            self.rows.resize(end, 0.0);
        }
        self.rows[end - self.len..end].fill(0.0);
    }

    /// Calls [`Policy::act`] for the NPCs `npcs` and updates their memories. `observations` has a row for each of them,
    /// in their order; so has `noise`, unless it is empty.
    ///
    /// # Panics
    /// As [`Policy::act`], or if [`forget`](Self::forget) was never called for one of the NPCs.
    pub fn act(
        &mut self,
        policy: &Policy,
        npcs: impl Iterator<Item = usize> + Clone,
        observations: &[f32],
        noise: &[f32],
        actions: &mut Vec<Action>,
    ) {
        let mut gathered = std::mem::take(&mut self.gathered);
        gathered.clear();
        npcs.clone().for_each(|idx| gathered.extend_from_slice(&self.rows[idx * self.len..(idx + 1) * self.len]));
        policy.act(Batch { observations, memory: &mut gathered, noise }, &mut self.scratch, actions);
        for (idx, row) in npcs.zip(gathered.chunks_exact(self.len.max(1))) {
            self.rows[idx * self.len..(idx + 1) * self.len].copy_from_slice(row);
        }
        self.gathered = gathered;
    }
}
