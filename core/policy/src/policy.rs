//! Inference with a trained actor.

use crate::actor::{ActionDistribution, Actor, gaussian};
use crate::manifest::Manifest;
use crate::network::Past;
use crate::state::HiddenState;
use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;
use std::sync::Arc;
use surefoot_world::character::{ACTION_LEN, Action};

/// A trained actor that decides for many NPCs at once. Cheap to clone: clones share the weights.
#[derive(Debug, Clone)]
pub struct Policy {
    actor: Actor,
    manifest: Arc<Manifest>,
    device: Device,
    senses_transports: bool,
}

impl Policy {
    /// Wraps an actor for inference on the CPU.
    pub fn new(actor: &Actor, manifest: Manifest) -> Self {
        let device = Device::flex();
        Self { actor: actor.valid().to_device(&device), manifest: Arc::new(manifest), device, senses_transports: true }
    }

    /// The same policy for NPCs that are not told where zip lines and teleporters are: the paper's agents are not.
    #[must_use]
    pub fn without_transports(self) -> Self {
        Self { senses_transports: false, ..self }
    }

    /// Whether NPCs of this policy are told where zip lines and teleporters are.
    pub fn senses_transports(&self) -> bool {
        self.senses_transports
    }

    /// The manifest of the weights.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Name and shortened hash of the weights for display, such as `general-reactive (1a2b3c4d5e6f)`: ASCII, at most 64 bytes.
    pub fn label(&self) -> String {
        let short = |text: &str, most: usize| text.chars().filter(char::is_ascii).take(most).collect::<String>();
        format!("{} ({})", short(&self.manifest.name, 40), short(&self.manifest.weights_hash, 12))
    }

    /// The policy network.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// Number of values of an observation: [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN), or
    /// [`OBSERVATION_WITH_OTHERS_LEN`](surefoot_world::OBSERVATION_WITH_OTHERS_LEN) for a policy that sees others.
    pub fn observation_len(&self) -> usize {
        self.manifest.actor.observation_len()
    }

    /// Number of values in an NPC's memory row, which must be passed on to its next decision; 0 for a reactive policy.
    pub fn memory_len(&self) -> usize {
        self.manifest.actor.hidden_len()
    }

    /// Computes an action for each observation: the policy's mean plus `noise_share` times its exploration noise.
    ///
    /// Share 0 gives the most likely action, 1 the policy as it was trained. Some noise frees characters from
    /// places where the mean alone runs in circles. The other arguments are those of [`act_with_noise`](Self::act_with_noise).
    ///
    /// # Panics
    /// As [`act_with_noise`](Self::act_with_noise).
    pub fn act(
        &self,
        observations: &[f32],
        memory: &mut [f32],
        noise_share: f32,
        rng: &mut impl Rng,
        actions: &mut Vec<Action>,
    ) {
        let row_count = observations.len() / self.observation_len();
        let count = if noise_share > 0.0 { row_count * ACTION_LEN } else { 0 };
        let noise = gaussian(rng, count).into_iter().map(|value| value * noise_share).collect();
        self.act_with_noise(observations, memory, noise, actions);
    }

    /// Computes an action for each observation: the policy's mean plus `noise` in units of its standard deviation.
    ///
    /// `observations` has rows of [`observation_len`](Self::observation_len) values. `memory` has one row of [`memory_len`](Self::memory_len) values for
    /// each, zeros at the start of an attempt, and is overwritten for the next decision. `noise` is empty for none, or has one
    /// row of [`ACTION_LEN`] values for each observation. `actions` is cleared and gets one entry per row.
    ///
    /// # Panics
    /// If `observations` is not a whole number of rows, or the numbers of rows differ.
    pub fn act_with_noise(&self, observations: &[f32], memory: &mut [f32], noise: Vec<f32>, actions: &mut Vec<Action>) {
        assert_eq!(observations.len() % self.observation_len(), 0, "whole observation rows");
        actions.clear();
        let row_count = observations.len() / self.observation_len();
        assert_eq!(memory.len(), row_count * self.memory_len(), "a row of memory for each observation");
        if row_count == 0 {
            return;
        }
        let rows = TensorData::new(observations.to_vec(), [row_count, self.observation_len()]);
        let ActionDistribution { mean, log_std } = self.distribution(Tensor::from_data(rows, &self.device), memory);
        let raw = if noise.is_empty() {
            mean
        } else {
            let noise = TensorData::new(noise, [row_count, ACTION_LEN]);
            mean + log_std.exp() * Tensor::<2>::from_data(noise, &self.device)
        };
        let data = raw.tanh().into_data();
        let values = data.as_slice::<f32>().expect("the flex backend computes in f32");
        actions.extend(
            values
                .chunks_exact(ACTION_LEN)
                .map(|row| Action::from_array([row[0], row[1], row[2], row[3]]).unwrap_or_default()),
        );
    }

    /// The distribution of each row's action; overwrites `memory`.
    fn distribution(&self, observations: Tensor<2>, memory: &mut [f32]) -> ActionDistribution {
        let [row_count, _] = observations.dims();
        let Some(size) = self.actor.memory_size() else { return self.actor.forward(observations, None).0 };
        let state = HiddenState::from_rows(memory, size, &self.device);
        let keep = vec![1.0; row_count];
        let (distribution, next) = self.actor.forward(observations, Some(Past { state: &state, keep: &keep }));
        next.expect("an actor with a memory returns a state").write_rows(memory);
        distribution
    }
}
