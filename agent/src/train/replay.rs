//! The replay buffer: packed observations in lanes, one lane per NPC.
//!
//! Every collecting step appends one row for each lane, so the successor of a row is the row one stride
//! later and no observation is stored twice. An episode that was cut off is followed by a *boundary* row
//! that holds only its last observation: truncated never reads as terminated, and the value of that last
//! state still counts.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
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
    /// No action: the last observation of an episode that was cut off.
    Boundary,
}

/// One observation with what was done there.
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
}

/// Arrays longer than 32 have no serde implementation of their own.
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

/// Lanes of transitions in one bounded ring.
#[derive(Debug, Serialize, Deserialize)]
pub struct Replay {
    lane_count: usize,
    /// Steps kept; older ones are overwritten.
    step_capacity: usize,
    /// Steps written since the beginning.
    steps_written: u64,
    rows: Vec<Row>,
}

/// A batch of n-step transitions as flat rows.
#[derive(Debug, Default)]
pub struct Batch {
    /// `[batch, OBSERVATION_LEN]`.
    pub observations: Vec<f32>,
    /// `[batch, ACTION_LEN]`.
    pub actions: Vec<f32>,
    /// Discounted sum of up to n rewards, `[batch]`.
    pub returns: Vec<f32>,
    /// Factor of the bootstrapped value: discount to the steps taken, 0 after a terminal state, `[batch]`.
    pub bootstrap: Vec<f32>,
    /// `[batch, OBSERVATION_LEN]`; meaningless where `bootstrap` is 0.
    pub next_observations: Vec<f32>,
}

/// How batches are drawn.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Transitions per batch.
    pub batch: usize,
    /// Rewards summed before bootstrapping.
    pub n_step: usize,
    /// Discount per decision.
    pub discount: f32,
    /// Whether half of the transitions are reflected left to right.
    pub mirror: bool,
}

impl Replay {
    /// An empty buffer for at most `capacity` rows over `lane_count` lanes.
    pub fn new(lane_count: usize, capacity: usize) -> Self {
        let step_capacity = (capacity / lane_count).max(2);
        Self { lane_count, step_capacity, steps_written: 0, rows: Vec::new() }
    }

    /// Rows held.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether nothing has been written.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Appends one row for each lane.
    ///
    /// # Panics
    /// If the steps do not hold one entry per lane.
    pub fn push_step(&mut self, step: &Step) {
        assert_eq!(step.kinds.len(), self.lane_count);
        let start = (self.steps_written % self.step_capacity as u64) as usize * self.lane_count;
        for lane in 0..self.lane_count {
            let row = Row::pack(
                &step.observations[lane * OBSERVATION_LEN..(lane + 1) * OBSERVATION_LEN],
                step.actions[lane],
                step.rewards[lane],
                step.kinds[lane],
            );
            match self.rows.get_mut(start + lane) {
                Some(slot) => *slot = row,
                None => self.rows.push(row),
            }
        }
        self.steps_written += 1;
    }

    fn row(&self, step: u64, lane: usize) -> &Row {
        &self.rows[(step % self.step_capacity as u64) as usize * self.lane_count + lane]
    }

    /// Draws a batch uniformly.
    ///
    /// # Panics
    /// If fewer than `n_step + 1` steps have been written.
    pub fn sample(&self, sampling: Sampling, rng: &mut impl Rng, batch: &mut Batch) {
        let Batch { observations, actions, returns, bootstrap, next_observations } = batch;
        observations.clear();
        actions.clear();
        returns.clear();
        bootstrap.clear();
        next_observations.clear();
        let oldest = self.steps_written.saturating_sub(self.step_capacity as u64);
        let newest = self.steps_written - sampling.n_step as u64;
        assert!(oldest < newest, "sample after enough steps were written");
        while returns.len() < sampling.batch {
            let step = rng.random_range(oldest..newest);
            let lane = rng.random_range(0..self.lane_count);
            let mirrored = sampling.mirror && rng.random_bool(0.5);
            let first = self.row(step, lane);
            if first.kind == RowKind::Boundary {
                continue;
            }
            let (mut total, mut discount, mut at) = (0.0, 1.0, step);
            let next = loop {
                let row = self.row(at, lane);
                if row.kind == RowKind::Boundary || at == step + sampling.n_step as u64 {
                    break Some(row);
                }
                total += discount * row.reward;
                discount *= sampling.discount;
                at += 1;
                if row.kind == RowKind::Terminated {
                    break None;
                }
            };
            first.unpack(observations, mirrored);
            let mut action = first.action;
            if mirrored {
                mirror_action(&mut action);
            }
            actions.extend(action);
            returns.push(total);
            match next {
                Some(row) => {
                    row.unpack(next_observations, mirrored);
                    bootstrap.push(discount);
                }
                None => {
                    next_observations.resize(next_observations.len() + OBSERVATION_LEN, 0.0);
                    bootstrap.push(0.0);
                }
            }
        }
    }
}

/// One collecting step over all lanes.
#[derive(Debug, Clone, Default)]
pub struct Step {
    /// `[lanes, OBSERVATION_LEN]`.
    pub observations: Vec<f32>,
    /// One action per lane.
    pub actions: Vec<[f32; ACTION_LEN]>,
    /// One reward per lane.
    pub rewards: Vec<f32>,
    /// One kind per lane.
    pub kinds: Vec<RowKind>,
}

impl Row {
    fn pack(observation: &[f32], action: [f32; ACTION_LEN], reward: f32, kind: RowKind) -> Self {
        let mut row =
            Row { proximity: [0; RAY_COUNT], surface: [0; RAY_COUNT], state: [0.0; STATE_LEN], action, reward, kind };
        for ray in 0..RAY_COUNT {
            row.proximity[ray] = (observation[ray] * f32::from(u16::MAX)).round() as u16;
            row.surface[ray] = sense::ray_surface(observation, ray) as u8;
        }
        row.state.copy_from_slice(&observation[RAY_COUNT * RAY_CHANNELS..]);
        row
    }

    fn unpack(&self, into: &mut Vec<f32>, mirrored: bool) {
        let start = into.len();
        into.resize(start + OBSERVATION_LEN, 0.0);
        let row = &mut into[start..];
        for ray in 0..RAY_COUNT {
            row[ray] = f32::from(self.proximity[ray]) / f32::from(u16::MAX);
            if let Some((channel, value)) = sense::surface_channel(Surface::ALL[usize::from(self.surface[ray])]) {
                row[channel * RAY_COUNT + ray] = value;
            }
        }
        row[RAY_COUNT * RAY_CHANNELS..].copy_from_slice(&self.state);
        if mirrored {
            mirror_observation(row);
        }
    }
}
