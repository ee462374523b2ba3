//! Inference: actor networks, checkpoints and batched policy evaluation.
//!
//! This crate turns observation rows (`surefoot_world::sense`) into actions. It knows nothing of training,
//! of sockets or of graphs. Start at [`Policy`].

pub mod actor;
pub mod checkpoint;

use actor::{ActionDistribution, gaussian};
pub use actor::{Actor, ActorConfig};
pub use checkpoint::{CheckpointError, Manifest};

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::{ACTION_LEN, Action};

/// A trained actor, ready to decide for many NPCs at once. Cheap to clone: clones share the weights.
#[derive(Debug, Clone)]
pub struct Policy {
    actor: Actor,
    manifest: Manifest,
    device: Device,
}

impl Policy {
    /// Wraps an actor for inference on the CPU.
    pub fn new(actor: &Actor, manifest: Manifest) -> Self {
        Self { actor: actor.valid(), manifest, device: Device::flex() }
    }

    /// What is known about these weights.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// An action for each observation: the policy's mean plus `noise_share` times its own exploration noise.
    ///
    /// Share 0 is the most likely action, 1 the policy as it was trained. Some noise frees characters from
    /// places where the mean alone runs in circles. `observations` holds rows of [`OBSERVATION_LEN`] values;
    /// `actions` is cleared and gets one entry a row.
    ///
    /// # Panics
    /// If `observations` is not a whole number of rows.
    pub fn act(&self, observations: &[f32], noise_share: f32, rng: &mut impl Rng, actions: &mut Vec<Action>) {
        assert_eq!(observations.len() % OBSERVATION_LEN, 0, "whole observation rows");
        actions.clear();
        let row_count = observations.len() / OBSERVATION_LEN;
        if row_count == 0 {
            return;
        }
        let rows =
            Tensor::<2>::from_data(TensorData::new(observations.to_vec(), [row_count, OBSERVATION_LEN]), &self.device);
        let ActionDistribution { mean, log_std } = self.actor.forward(rows);
        let raw = if noise_share > 0.0 {
            let noise = TensorData::new(gaussian(rng, row_count * ACTION_LEN), [row_count, ACTION_LEN]);
            mean + log_std.exp() * Tensor::<2>::from_data(noise, &self.device) * noise_share
        } else {
            mean
        };
        let data = raw.tanh().into_data();
        let values = data.as_slice::<f32>().expect("the flex backend computes in f32");
        actions.extend(
            values
                .chunks_exact(ACTION_LEN)
                .map(|row| Action::from_array([row[0], row[1], row[2], row[3]]).unwrap_or_default()),
        );
    }
}
