//! The LSTM state of many NPCs, for recurrent policies.

use crate::policy::Policy;
use rand::Rng;
use surefoot_world::character::Action;

/// One row of hidden state for each NPC, by index. Rows of a reactive policy are empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HiddenStates {
    len: usize,
    rows: Vec<f32>,
}

impl HiddenStates {
    /// An empty store for `policy`.
    pub fn new(policy: &Policy) -> Self {
        Self::of_len(policy.memory_len())
    }

    /// An empty store with rows of `len` values.
    pub fn of_len(len: usize) -> Self {
        Self { len, rows: Vec::new() }
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

    /// Calls [`Policy::act`] for the NPCs `who` and updates their memories. `observations` has a row for each, in the order of
    /// `who`.
    ///
    /// # Panics
    /// If [`forget`](Self::forget) was never called for one of the NPCs.
    pub fn act(
        &mut self,
        policy: &Policy,
        who: impl Iterator<Item = usize> + Clone,
        observations: &[f32],
        noise_share: f32,
        rng: &mut impl Rng,
        actions: &mut Vec<Action>,
    ) {
        let mut rows = self.gather(who.clone());
        policy.act(observations, &mut rows, noise_share, rng, actions);
        self.scatter(who, &rows);
    }

    /// Like [`act`](Self::act), with [`Policy::act_with_noise`].
    ///
    /// # Panics
    /// As [`act`](Self::act), or if `noise` is neither empty nor has one row for each observation.
    pub fn act_with_noise(
        &mut self,
        policy: &Policy,
        who: impl Iterator<Item = usize> + Clone,
        observations: &[f32],
        noise: Vec<f32>,
        actions: &mut Vec<Action>,
    ) {
        let mut rows = self.gather(who.clone());
        policy.act_with_noise(observations, &mut rows, noise, actions);
        self.scatter(who, &rows);
    }

    fn gather(&self, who: impl Iterator<Item = usize>) -> Vec<f32> {
        let mut rows = Vec::new();
        who.for_each(|idx| rows.extend_from_slice(&self.rows[idx * self.len..(idx + 1) * self.len]));
        rows
    }

    fn scatter(&mut self, who: impl Iterator<Item = usize>, rows: &[f32]) {
        for (idx, row) in who.zip(rows.chunks_exact(self.len.max(1))) {
            self.rows[idx * self.len..(idx + 1) * self.len].copy_from_slice(row);
        }
    }
}
