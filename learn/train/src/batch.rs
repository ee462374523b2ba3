//! Batches of the replay buffer as tensors.

use super::networks::state::HiddenState;
use super::networks::trunk::Past;
use super::replay::Batch;
use burn::tensor::{Device, Int, Tensor, TensorData};
use surefoot_world::character::ACTION_LEN;

/// A batch as tensors.
pub(super) struct Rows<'a> {
    batch: &'a Batch,
    /// The device of tensors without gradients.
    pub device: Device,
    /// Observations to learn from, `[learned, observation_len]`; `learned` is the number of such rows.
    pub learned: Tensor<2>,
    /// Actions taken, `[learned, ACTION_LEN]`.
    pub actions: Tensor<2>,
    /// N-step returns, `[learned, 1]`.
    pub returns: Tensor<2>,
    /// Factors of the bootstrapped values, `[learned, 1]`.
    pub bootstrap: Tensor<2>,
    /// Weight of each row in the losses' means, `[learned, 1]`; weights add up to 1.
    pub weights: Tensor<2>,
    /// Index of each successor among all rows, `[learned]`.
    pub successors: Tensor<1, Int>,
}

impl<'a> Rows<'a> {
    pub fn new(batch: &'a Batch, device: &Device) -> Self {
        let count = batch.returns.len();
        let column = |values: Vec<f32>| Tensor::from_data(TensorData::new(values, [count, 1]), device);
        let total: f32 = batch.weights.iter().sum();
        let len = batch.observation_len();
        let skip = batch.burn_in * batch.size * len;
        let learned = batch.observations[skip..skip + count * len].to_vec();
        let successors = batch.successors.iter().map(|&row| row as i64).collect::<Vec<_>>();
        Self {
            batch,
            device: device.clone(),
            learned: Tensor::from_data(TensorData::new(learned, [count, len]), device),
            actions: Tensor::from_data(TensorData::new(batch.actions.clone(), [count, ACTION_LEN]), device),
            returns: column(batch.returns.clone()),
            bootstrap: column(batch.bootstrap.clone()),
            weights: column(batch.weights.iter().map(|weight| weight / total.max(1.0)).collect()),
            successors: Tensor::from_data(TensorData::new(successors, [count]), device),
        }
    }

    pub fn learned_count(&self) -> usize {
        self.batch.returns.len()
    }

    /// Observations of all steps, one in each row.
    pub fn all(&self) -> Tensor<2> {
        let rows = self.batch.keep.len();
        let len = self.batch.observation_len();
        Tensor::from_data(TensorData::new(self.batch.observations.clone(), [rows, len]), &self.device)
    }

    /// Observations of the burn-in steps; `None` without burn-in.
    pub fn burn_in(&self) -> Option<Tensor<2>> {
        let rows = self.batch.burn_in * self.batch.size;
        let len = self.batch.observation_len();
        let values = self.batch.observations[..rows * len].to_vec();
        (rows > 0).then(|| Tensor::from_data(TensorData::new(values, [rows, len]), &self.device))
    }

    /// Number of LSTM units.
    pub fn memory_size(&self) -> usize {
        self.batch.memory.len() / self.batch.size / 2
    }

    /// The actor's stored state before the first step.
    pub fn actor_memory(&self) -> HiddenState {
        HiddenState::from_rows(&self.batch.memory, self.memory_size(), &self.device)
    }

    /// The initial state of networks with `members` members and the actor's number of units.
    pub fn empty_memory(&self, members: usize) -> HiddenState {
        HiddenState::empty([members, self.batch.size, self.memory_size()], &self.device)
    }

    pub fn whole_past<'r>(&'r self, state: &'r HiddenState) -> Past<'r> {
        Past { state, keep: &self.batch.keep }
    }

    pub fn burn_in_past<'r>(&'r self, state: &'r HiddenState) -> Past<'r> {
        Past { state, keep: &self.batch.keep[..self.batch.burn_in * self.batch.size] }
    }

    /// The past of the steps to learn from.
    pub fn past<'r>(&'r self, state: &'r HiddenState) -> Past<'r> {
        Past { state, keep: &self.batch.keep[self.batch.burn_in * self.batch.size..][..self.learned_count()] }
    }
}
