//! Batches, drawn at random from the buffers of a run.

use super::{MEMORY_STRIDE, Replay, RowKind};
use rand::{Rng, RngExt};
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{mirror_action, mirror_observation};

/// Most draws for a row to learn from. If all of them fail, the batch gets a boundary row with weight 0.
const DRAWS: usize = 64;

/// A batch of sequences as flat rows, all of step 0 first. A reactive agent's sequence is one transition: the step to
/// learn from, and the successor.
#[derive(Debug, Default)]
pub struct Batch {
    /// Number of sequences.
    pub size: usize,
    /// Burn-in steps at the beginning, which only warm up the LSTM.
    pub burn_in: usize,
    /// Steps to learn from, after the burn-in; the remaining steps are successors.
    pub learn: usize,
    /// Observations, `[steps * size, observation_len]`.
    pub observations: Vec<f32>,
    /// 0 where memory is reset, otherwise 1, `[steps * size]`.
    pub keep: Vec<f32>,
    /// The actor's hidden and cell state before step 0, `[size, memory]`.
    pub memory: Vec<f32>,
    /// Actions of the steps to learn from, `[learn * size, ACTION_LEN]`.
    pub actions: Vec<f32>,
    /// Discounted sum of up to n rewards from each step to learn from, `[learn * size]`.
    pub returns: Vec<f32>,
    /// Factor of the bootstrapped value: the discount to the power of the steps summed, or 0 after a terminal state,
    /// `[learn * size]`.
    pub bootstrap: Vec<f32>,
    /// 1 for rows to learn from, 0 for boundary rows, `[learn * size]`.
    pub weights: Vec<f32>,
    /// Row index of the bootstrapped state, `[learn * size]`; meaningless where `bootstrap` is 0.
    pub successors: Vec<usize>,
}

/// How batches are drawn.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Number of sequences per batch.
    pub batch: usize,
    /// Burn-in steps, which only warm up the LSTM; 0 for a reactive agent.
    pub burn_in: usize,
    /// Steps to learn from; 1 for a reactive agent.
    pub learn: usize,
    /// Number of rewards summed before bootstrapping.
    pub n_step: usize,
    /// Discount per decision.
    pub discount: f32,
    /// Whether to mirror half of the sequences left to right.
    pub mirror: bool,
}

impl Sampling {
    /// Whether sequences are single transitions, as for a reactive agent.
    fn is_single(self) -> bool {
        self.burn_in + self.learn == 1
    }

    /// Rows of a sequence in a batch. A reactive agent needs only the bootstrapped state, not the steps in between.
    fn steps(self) -> usize {
        if self.is_single() { 2 } else { self.burn_in + self.learn + self.n_step }
    }
}

/// The n-step target of one step.
struct Target {
    total: f32,
    bootstrap: f32,
    /// Step of the bootstrapped state; `None` after a terminal one.
    successor: Option<u64>,
}

impl Replay {
    /// Half-open range of steps at which a sequence may start.
    fn starts(&self, sampling: Sampling) -> (u64, u64) {
        let oldest = self.steps_written.saturating_sub(self.step_capacity as u64);
        let steps = (sampling.burn_in + sampling.learn + sampling.n_step) as u64;
        (oldest, (self.steps_written + 1).saturating_sub(steps))
    }

    /// Whether enough steps were written to draw sequences.
    fn is_usable(&self, sampling: Sampling) -> bool {
        let (first, end) = self.starts(sampling);
        first < end
    }

    /// Puts the observation of a row into row `idx` of a batch.
    fn put(&self, batch: &mut Batch, idx: usize, (step, lane): (u64, usize), mirrored: bool) {
        let row_idx = self.slot(step) * self.lane_count + lane;
        let (row, len) = (&self.rows[row_idx], self.others_len());
        let into = &mut batch.observations[idx * (OBSERVATION_LEN + len)..][..OBSERVATION_LEN + len];
        let (own, others) = into.split_at_mut(OBSERVATION_LEN);
        row.unpack(own);
        others.copy_from_slice(&self.others[row_idx * len..][..len]);
        if mirrored {
            mirror_observation(into);
        }
        batch.keep[idx] = if row.is_fresh { 0.0 } else { 1.0 };
    }

    /// Draws a sequence into `batch`.
    fn put_sequence(&self, batch: &mut Batch, sequence: usize, sampling: Sampling, rng: &mut impl Rng) {
        let Sampling { batch: size, burn_in, learn, .. } = sampling;
        let is_single = sampling.is_single();
        let mirrored = sampling.mirror && rng.random_bool(0.5);
        let (start, lane) = self.draw(sampling, rng);
        if !is_single {
            let memory = self.memory(start, lane);
            // The mirror image of a hidden state is unknown, so mirrored sequences start from zeros and rely on
            // burn-in.
            batch.memory.extend(memory.iter().map(|value| if mirrored { 0.0 } else { *value }));
            for step in 0..sampling.steps() {
                self.put(batch, step * size + sequence, (start + step as u64, lane), mirrored);
            }
        }
        for step in 0..learn {
            let at = start + (burn_in + step) as u64;
            let row = self.row(at, lane);
            let idx = step * size + sequence;
            let target = self.target(at, lane, sampling);
            batch.returns[idx] = target.total;
            batch.bootstrap[idx] = target.bootstrap;
            batch.weights[idx] = if row.kind == RowKind::Boundary { 0.0 } else { 1.0 };
            let action = &mut batch.actions[idx * ACTION_LEN..][..ACTION_LEN];
            action.copy_from_slice(&row.action);
            if mirrored {
                mirror_action(action);
            }
            if is_single {
                self.put(batch, sequence, (at, lane), mirrored);
                batch.successors[idx] = size + sequence;
                if let Some(successor) = target.successor {
                    self.put(batch, size + sequence, (successor, lane), mirrored);
                }
            } else if let Some(successor) = target.successor {
                batch.successors[idx] = (successor - start) as usize * size + sequence;
            }
        }
    }

    /// Draws the start and the lane of a sequence.
    fn draw(&self, sampling: Sampling, rng: &mut impl Rng) -> (u64, usize) {
        let (first, end) = self.starts(sampling);
        let is_single = sampling.is_single();
        let mut draw = || {
            let (lane, step) = (rng.random_range(0..self.lane_count), rng.random_range(first..end));
            (if is_single { step } else { step - step % MEMORY_STRIDE }, lane)
        };
        let is_usable = |&(start, lane): &(u64, usize)| {
            if is_single { self.row(start, lane).kind != RowKind::Boundary } else { start >= first }
        };
        (0..DRAWS).map(|_| draw()).find(is_usable).unwrap_or((first.next_multiple_of(MEMORY_STRIDE).min(end - 1), 0))
    }

    /// Sums up to n discounted rewards from `step` on.
    fn target(&self, step: u64, lane: usize, sampling: Sampling) -> Target {
        let (mut total, mut discount) = (0.0, 1.0);
        for at in step.. {
            let row = self.row(at, lane);
            if row.kind == RowKind::Boundary || at == step + sampling.n_step as u64 {
                return Target { total, bootstrap: discount, successor: Some(at) };
            }
            total += discount * row.reward;
            discount *= sampling.discount;
            if row.kind == RowKind::Terminated {
                break;
            }
        }
        Target { total, bootstrap: 0.0, successor: None }
    }
}

/// Whether one of these buffers has enough steps for [`sample`].
pub fn can_sample(buffers: &[Replay], sampling: Sampling) -> bool {
    buffers.iter().any(|buffer| buffer.is_usable(sampling))
}

/// Draws a batch uniformly at random from the rows of all buffers into `batch`, reusing its allocations.
///
/// # Panics
/// If [`can_sample`] is false.
pub fn sample(buffers: &[Replay], sampling: Sampling, rng: &mut impl Rng, batch: &mut Batch) {
    let usable: Vec<&Replay> = buffers.iter().filter(|buffer| buffer.is_usable(sampling)).collect();
    let first = *usable.first().expect("sample after enough steps were written");
    let row_count: usize = usable.iter().map(|buffer| buffer.len()).sum();
    let Sampling { batch: size, burn_in, learn, .. } = sampling;
    let steps = sampling.steps();
    *batch = Batch {
        size,
        burn_in,
        learn,
        observations: cleared(&mut batch.observations, steps * size * (OBSERVATION_LEN + first.others_len())),
        keep: cleared(&mut batch.keep, steps * size),
        memory: std::mem::take(&mut batch.memory),
        actions: cleared(&mut batch.actions, learn * size * ACTION_LEN),
        returns: cleared(&mut batch.returns, learn * size),
        bootstrap: cleared(&mut batch.bootstrap, learn * size),
        weights: cleared(&mut batch.weights, learn * size),
        successors: vec![0; learn * size],
    };
    batch.memory.clear();
    for sequence in 0..size {
        let mut buffer = first;
        if usable.len() > 1 {
            let mut row = rng.random_range(0..row_count);
            let holds = |buffer: &&&Replay| {
                let is_there = row < buffer.len();
                row = row.saturating_sub(buffer.len());
                is_there
            };
            buffer = usable.iter().find(holds).expect("rows are counted");
        }
        buffer.put_sequence(batch, sequence, sampling, rng);
    }
}

/// Takes the allocation and refills it with `len` zeros.
fn cleared(values: &mut Vec<f32>, len: usize) -> Vec<f32> {
    let mut values = std::mem::take(values);
    values.clear();
    values.resize(len, 0.0);
    values
}

impl Batch {
    /// Number of values of an observation.
    pub fn observation_len(&self) -> usize {
        self.observations.len() / self.keep.len().max(1)
    }
}
