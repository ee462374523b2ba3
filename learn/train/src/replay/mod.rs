//! The replay buffer: packed observations in lanes, one lane per NPC.
//!
//! Every collecting step appends one row for each lane, so the successor of a row is the lane's next row and no
//! observation is stored twice. A truncated episode is followed by a *boundary* row with only its last observation:
//! truncation is never mistaken for termination, and the value of the last state is still bootstrapped.
//!
//! A run has one buffer for each environment or actor, and draws batches from all of them.
//!
//! For recurrent agents the buffer also stores each NPC's hidden state at every [`MEMORY_STRIDE`]th step, and returns
//! sequences that start at these steps (Kapturowski et al. 2019, "Recurrent Experience Replay in Distributed
//! Reinforcement Learning": stored state with burn-in).

mod census;
mod row;
mod sample;
mod step;

pub use census::{Census, census};
pub use row::{RowError, rows_from_bytes, rows_to_bytes};
pub use sample::{Batch, Sampling, can_sample, sample};
pub use step::{RowKind, Step};

use row::Row;
use serde::{Deserialize, Serialize};
use surefoot_policy::ActorConfig;
use surefoot_world::OBSERVATION_LEN;

/// Steps between two stored hidden states. Sequences start at multiples of it.
pub const MEMORY_STRIDE: u64 = 20;

/// A ring buffer of transitions in lanes.
#[derive(Debug, Serialize, Deserialize)]
pub struct Replay {
    lane_count: usize,
    /// Capacity in steps, a multiple of [`MEMORY_STRIDE`]; the oldest are overwritten.
    step_capacity: usize,
    /// Number of steps written so far.
    steps_written: u64,
    rows: Vec<Row>,
    /// Version of the weights that chose the actions of each stored step: the number of updates behind them.
    versions: Vec<u64>,
    /// The part of each row's observation that shows others, `[rows, OTHERS_LEN]`; empty for agents that do not see
    /// them.
    others: Vec<f32>,
    /// The actor's hidden and cell states at each stored stride, `[strides, lanes, memory]`.
    memories: Vec<f32>,
}

impl Replay {
    /// An empty buffer for about `capacity` rows in `lane_count` lanes: whole strides, at least four.
    pub fn new(lane_count: usize, capacity: usize) -> Self {
        let strides = (capacity / lane_count / MEMORY_STRIDE as usize).max(4);
        let step_capacity = strides * MEMORY_STRIDE as usize;
        let (rows, versions, others, memories) = Default::default();
        Self { lane_count, step_capacity, steps_written: 0, rows, versions, others, memories }
    }

    /// Whether this is a valid buffer of `lane_count` lanes and about `capacity` rows, for agents of these sizes.
    pub fn fits(&self, lane_count: usize, capacity: usize, network: &ActorConfig) -> bool {
        let most = Self::new(lane_count, capacity).step_capacity;
        let steps = self.steps_written.min(self.step_capacity as u64) as usize;
        self.lane_count == lane_count
            && (1..=most).contains(&self.step_capacity)
            && self.step_capacity.is_multiple_of(MEMORY_STRIDE as usize)
            && self.rows.len() == steps * lane_count
            && self.versions.len() == steps
            && self.others.len() == self.rows.len() * (network.observation_len() - OBSERVATION_LEN)
            && self.memories.len() == steps.div_ceil(MEMORY_STRIDE as usize) * lane_count * network.hidden_len()
    }

    /// Number of lanes.
    pub fn lane_count(&self) -> usize {
        self.lane_count
    }

    /// Number of rows stored.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether the buffer has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Appends one row for each lane.
    ///
    /// # Panics
    /// If `step` does not have one entry per lane.
    pub fn push_step(&mut self, step: &Step) {
        assert_eq!(step.kinds.len(), self.lane_count);
        let slot = (self.steps_written % self.step_capacity as u64) as usize;
        let start = slot * self.lane_count;
        let observation_len = step.observations.len() / self.lane_count;
        let others_len = observation_len - OBSERVATION_LEN;
        for (lane, observation) in step.observations.chunks_exact(observation_len).enumerate() {
            let (own, others) = observation.split_at(OBSERVATION_LEN);
            let row = Row {
                action: step.actions[lane],
                reward: step.rewards[lane],
                kind: step.kinds[lane],
                is_fresh: step.is_fresh[lane],
                ..Row::pack(own)
            };
            match self.rows.get_mut(start + lane) {
                Some(slot) => {
                    *slot = row;
                    self.others[(start + lane) * others_len..][..others_len].copy_from_slice(others);
                }
                None => {
                    self.rows.push(row);
                    self.others.extend(others);
                }
            }
        }
        match self.versions.get_mut(slot) {
            Some(version) => *version = step.version,
            None => self.versions.push(step.version),
        }
        if self.steps_written.is_multiple_of(MEMORY_STRIDE) {
            let at = slot / MEMORY_STRIDE as usize * step.memory.len();
            self.memories.resize(self.memories.len().max(at + step.memory.len()), 0.0);
            self.memories[at..at + step.memory.len()].copy_from_slice(&step.memory);
        }
        self.steps_written += 1;
    }

    /// Ends the attempts of all lanes: the next rows do not continue them. The last rows have no successor, so they
    /// become boundaries.
    pub fn close(&mut self) {
        let Some(last) = self.steps_written.checked_sub(1) else { return };
        let start = self.slot(last) * self.lane_count;
        let rows = &mut self.rows[start..start + self.lane_count];
        rows.iter_mut().filter(|row| row.kind == RowKind::Continues).for_each(|row| row.kind = RowKind::Boundary);
    }

    fn slot(&self, step: u64) -> usize {
        (step % self.step_capacity as u64) as usize
    }

    fn row(&self, step: u64, lane: usize) -> &Row {
        &self.rows[self.slot(step) * self.lane_count + lane]
    }

    /// Number of values of an observation that show others.
    fn others_len(&self) -> usize {
        self.others.len() / self.rows.len().max(1)
    }

    /// The actor's hidden and cell state before `step`, a multiple of the stride.
    fn memory(&self, step: u64, lane: usize) -> &[f32] {
        let strides = self.rows.len().div_ceil(self.lane_count * MEMORY_STRIDE as usize);
        let len = self.memories.len() / strides / self.lane_count;
        let stride = self.slot(step) / MEMORY_STRIDE as usize;
        &self.memories[(stride * self.lane_count + lane) * len..][..len]
    }
}
