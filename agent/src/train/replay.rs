//! The replay buffer: packed observations in lanes, one lane per NPC.
//!
//! Every collecting step appends one row for each lane, so the successor of a row is the lane's next row and no
//! observation is stored twice. A truncated episode is followed by a *boundary* row with only its last observation:
//! truncation is never mistaken for termination, and the value of the last state is still bootstrapped.
//!
//! For recurrent agents the buffer also stores each NPC's hidden state at every [`MEMORY_STRIDE`]th step, and returns
//! sequences that start at these steps (Kapturowski et al. 2019, "Recurrent Experience Replay in Distributed Reinforcement
//! Learning": stored state with burn-in).

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use surefoot_policy::ActorConfig;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::mesh::Surface;
use surefoot_world::sense::{self, RAY_CHANNELS, RAY_COUNT, STATE_LEN, mirror_action, mirror_observation};

/// How a row continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum RowKind {
    /// The next row of the lane is its successor.
    Continues,
    /// The episode ended in a terminal state after this row's action: no successor.
    Terminated,
    /// No action: the last observation of a truncated episode.
    Boundary,
}

/// One observation with the action taken and its result.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Row {
    #[serde(with = "long_array")]
    proximity: [u16; RAY_COUNT],
    #[serde(with = "long_array")]
    surface: [u8; RAY_COUNT],
    #[serde(with = "long_array")]
    state: [f32; STATE_LEN],
    action: [f32; ACTION_LEN],
    reward: f32,
    kind: RowKind,
    /// Whether the NPC's hidden state was the initial one before this row.
    is_fresh: bool,
}

/// Serializes arrays longer than 32 values, for which serde has no implementation.
mod long_array {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<T: Serialize, S: Serializer, const N: usize>(
        array: &[T; N],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        array.as_slice().serialize(serializer)
    }

    pub fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>, const N: usize>(
        deserializer: D,
    ) -> Result<[T; N], D::Error> {
        let values = Vec::<T>::deserialize(deserializer)?;
        let count = values.len();
        values.try_into().map_err(|_| D::Error::custom(format!("{count} values, expected {N}")))
    }
}

/// Steps between two stored hidden states. Sequences start at multiples of it.
pub const MEMORY_STRIDE: u64 = 20;

/// A ring buffer of transitions in lanes.
#[derive(Debug, Serialize, Deserialize)]
pub struct Replay {
    lane_count: usize,
    /// Capacity in steps, a multiple of [`MEMORY_STRIDE`]; the oldest are overwritten.
    step_capacity: usize,
    /// Number of steps written since the beginning.
    steps_written: u64,
    rows: Vec<Row>,
    /// What the observation of each row tells of others, `[rows, OTHERS_LEN]`; empty for agents that do not see them.
    others: Vec<f32>,
    /// The actor's hidden and cell states at each stored stride, `[strides, lanes, memory]`.
    memories: Vec<f32>,
}

/// A batch of sequences as flat rows, all of step 0 first. A reactive agent's sequence is one transition: the step to learn
/// from, and the successor.
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
}

/// The n-step target of one step.
struct Target {
    total: f32,
    bootstrap: f32,
    /// Step of the bootstrapped state; `None` after a terminal one.
    successor: Option<u64>,
}

impl Replay {
    /// An empty buffer for about `capacity` rows in `lane_count` lanes: whole strides, at least four.
    pub fn new(lane_count: usize, capacity: usize) -> Self {
        let strides = (capacity / lane_count / MEMORY_STRIDE as usize).max(4);
        let step_capacity = strides * MEMORY_STRIDE as usize;
        Self { lane_count, step_capacity, steps_written: 0, rows: Vec::new(), others: Vec::new(), memories: Vec::new() }
    }

    /// Whether this can be the buffer of `lane_count` lanes for about `capacity` rows, for agents of these sizes.
    pub fn fits(&self, lane_count: usize, capacity: usize, network: &ActorConfig) -> bool {
        let empty = Self::new(lane_count, capacity);
        let steps = self.steps_written.min(empty.step_capacity as u64) as usize;
        self.lane_count == lane_count
            && self.step_capacity == empty.step_capacity
            && self.rows.len() == steps * lane_count
            && self.others.len() == self.rows.len() * (network.observation_len() - OBSERVATION_LEN)
            && self.memories.len() == steps.div_ceil(MEMORY_STRIDE as usize) * lane_count * network.hidden_len()
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
        if self.steps_written.is_multiple_of(MEMORY_STRIDE) {
            let at = slot / MEMORY_STRIDE as usize * step.memory.len();
            self.memories.resize(self.memories.len().max(at + step.memory.len()), 0.0);
            self.memories[at..at + step.memory.len()].copy_from_slice(&step.memory);
        }
        self.steps_written += 1;
    }

    fn slot(&self, step: u64) -> usize {
        (step % self.step_capacity as u64) as usize
    }

    fn row(&self, step: u64, lane: usize) -> &Row {
        &self.rows[self.slot(step) * self.lane_count + lane]
    }

    /// Number of values of an observation that tell of others.
    fn others_len(&self) -> usize {
        self.others.len() / self.rows.len().max(1)
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

    /// The actor's hidden and cell state before `step`, a multiple of the stride.
    fn memory(&self, step: u64, lane: usize) -> &[f32] {
        let strides = self.rows.len().div_ceil(self.lane_count * MEMORY_STRIDE as usize);
        let len = self.memories.len() / strides / self.lane_count;
        let stride = self.slot(step) / MEMORY_STRIDE as usize;
        &self.memories[(stride * self.lane_count + lane) * len..][..len]
    }

    /// Whether enough steps were written for [`sample`](Self::sample).
    pub fn can_sample(&self, sampling: Sampling) -> bool {
        let (first, end) = self.starts(sampling);
        first < end
    }

    /// Half-open range of steps at which a sequence may start.
    fn starts(&self, sampling: Sampling) -> (u64, u64) {
        let oldest = self.steps_written.saturating_sub(self.step_capacity as u64);
        let steps = (sampling.burn_in + sampling.learn + sampling.n_step) as u64;
        (oldest, (self.steps_written + 1).saturating_sub(steps))
    }

    /// Draws a batch uniformly at random into `batch`, reusing its allocations.
    ///
    /// # Panics
    /// If [`can_sample`](Self::can_sample) is false.
    pub fn sample(&self, sampling: Sampling, rng: &mut impl Rng, batch: &mut Batch) {
        assert!(self.can_sample(sampling), "sample after enough steps were written");
        let Sampling { batch: size, burn_in, learn, n_step, .. } = sampling;
        // A reactive agent needs only the bootstrapped state, not the steps in between.
        let is_single = sampling.is_single();
        let steps = if is_single { 2 } else { burn_in + learn + n_step };
        *batch = Batch {
            size,
            burn_in,
            learn,
            observations: cleared(&mut batch.observations, steps * size * (OBSERVATION_LEN + self.others_len())),
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
            let mirrored = sampling.mirror && rng.random_bool(0.5);
            let (start, lane) = self.draw(sampling, rng);
            if !is_single {
                let memory = self.memory(start, lane);
                // The mirror image of a hidden state is unknown, so mirrored sequences start from zeros and rely on burn-in.
                batch.memory.extend(memory.iter().map(|value| if mirrored { 0.0 } else { *value }));
                for step in 0..steps {
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
    }

    /// Draws the start and the lane of a sequence.
    fn draw(&self, sampling: Sampling, rng: &mut impl Rng) -> (u64, usize) {
        let (first, end) = self.starts(sampling);
        let is_single = sampling.is_single();
        loop {
            let lane = rng.random_range(0..self.lane_count);
            let step = rng.random_range(first..end);
            let start = if is_single { step } else { step - step % MEMORY_STRIDE };
            let is_usable = if is_single { self.row(start, lane).kind != RowKind::Boundary } else { start >= first };
            if is_usable {
                return (start, lane);
            }
        }
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

/// One collecting step over all lanes.
#[derive(Debug, Clone, Default)]
pub struct Step {
    /// Observations, `[lanes, observation_len]`.
    pub observations: Vec<f32>,
    /// The actor's hidden and cell states before the step, `[lanes, memory]`.
    pub memory: Vec<f32>,
    /// Whether each lane's hidden state is the initial one.
    pub is_fresh: Vec<bool>,
    /// One action per lane.
    pub actions: Vec<[f32; ACTION_LEN]>,
    /// One reward per lane.
    pub rewards: Vec<f32>,
    /// One kind per lane.
    pub kinds: Vec<RowKind>,
}

impl Row {
    /// Packs an observation without others; action, reward and kind are placeholders.
    fn pack(observation: &[f32]) -> Self {
        let mut row = Row {
            proximity: [0; RAY_COUNT],
            surface: [0; RAY_COUNT],
            state: [0.0; STATE_LEN],
            action: [0.0; ACTION_LEN],
            reward: 0.0,
            kind: RowKind::Boundary,
            is_fresh: false,
        };
        for ray in 0..RAY_COUNT {
            row.proximity[ray] = (observation[ray] * f32::from(u16::MAX)).round() as u16;
            row.surface[ray] = sense::ray_surface(observation, ray) as u8;
        }
        row.state.copy_from_slice(&observation[RAY_COUNT * RAY_CHANNELS..]);
        row
    }

    /// Unpacks the observation without others into `into`, which must contain zeros.
    fn unpack(&self, into: &mut [f32]) {
        for ray in 0..RAY_COUNT {
            into[ray] = f32::from(self.proximity[ray]) / f32::from(u16::MAX);
            if let Some((channel, value)) = sense::surface_channel(Surface::ALL[usize::from(self.surface[ray])]) {
                into[channel * RAY_COUNT + ray] = value;
            }
        }
        into[RAY_COUNT * RAY_CHANNELS..].copy_from_slice(&self.state);
    }
}
