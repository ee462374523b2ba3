//! What each NPC remembers, for policies with a memory.

use crate::policy::Policy;
use rand::Rng;
use surefoot_world::character::Action;

/// One row of memory for each of many NPCs, by index; rows of a reactive policy are empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Memories {
    len: usize,
    rows: Vec<f32>,
}

impl Memories {
    /// No NPCs yet.
    pub fn new(policy: &Policy) -> Self {
        Self::of_len(policy.memory_len())
    }

    /// No NPCs yet, each to have so many values.
    pub fn of_len(len: usize) -> Self {
        Self { len, rows: Vec::new() }
    }

    /// All rows, one after the other.
    pub fn rows(&self) -> &[f32] {
        &self.rows
    }

    /// Puts back rows that [`rows`](Self::rows) gave.
    ///
    /// # Panics
    /// If they are not a whole number of rows.
    pub fn set_rows(&mut self, rows: Vec<f32>) {
        assert!(rows.len().is_multiple_of(self.len.max(1)), "whole rows");
        self.rows = rows;
    }

    /// Lets NPC `idx` start from nothing.
    pub fn forget(&mut self, idx: usize) {
        let end = (idx + 1) * self.len;
        if self.rows.len() < end {
            self.rows.resize(end, 0.0);
        }
        self.rows[end - self.len..end].fill(0.0);
    }

    /// [`Policy::act`] for some NPCs, whose memories are used and replaced; the first observation is that of the first of
    /// `who`.
    ///
    /// # Panics
    /// If one of them was never [forgotten](Self::forget).
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

    /// The same with [`Policy::act_with_noise`].
    ///
    /// # Panics
    /// As [`act`](Self::act), or if there is not a row of noise for each observation.
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
