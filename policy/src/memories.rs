//! What each NPC remembers, for policies with a memory.

use crate::Policy;

/// One row of memory for each of many NPCs, by index; rows of a reactive policy are empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Memories {
    len: usize,
    rows: Vec<f32>,
}

impl Memories {
    /// No NPCs yet.
    pub fn new(policy: &Policy) -> Self {
        Self { len: policy.memory_len(), rows: Vec::new() }
    }

    /// Lets NPC `idx` start from nothing.
    pub fn forget(&mut self, idx: usize) {
        let end = (idx + 1) * self.len;
        if self.rows.len() < end {
            self.rows.resize(end, 0.0);
        }
        self.rows[end - self.len..end].fill(0.0);
    }

    /// The rows of some NPCs, one after the other.
    ///
    /// # Panics
    /// If one of them was never [forgotten](Self::forget).
    pub fn gather(&self, who: impl Iterator<Item = usize>) -> Vec<f32> {
        let mut rows = Vec::new();
        who.for_each(|idx| rows.extend_from_slice(&self.rows[idx * self.len..(idx + 1) * self.len]));
        rows
    }

    /// Puts rows back where [`gather`](Self::gather) found them.
    pub fn scatter(&mut self, who: impl Iterator<Item = usize>, rows: &[f32]) {
        for (idx, row) in who.zip(rows.chunks_exact(self.len.max(1))) {
            self.rows[idx * self.len..(idx + 1) * self.len].copy_from_slice(row);
        }
    }
}
