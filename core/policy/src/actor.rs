//! The actor network.
//!
//! Rays pass through one linear layer. Its output is concatenated with the state vector and, for recurrent agents, with the
//! output of an LSTM over both. Two hidden layers map the result to the mean and log standard deviation of a squashed Gaussian
//! (Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications", appendix C). The ray encoder is a linear layer
//! instead of the paper's small CNN: on this backend it learns several times faster (docs/adr/0003-linear-ray-encoder.md).

use crate::config::ActorConfig;
use crate::dense::Dense;
use crate::network::{Encoding, Past, Trunk};
use crate::state::HiddenState;
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::{Rng, RngExt};
use surefoot_world::character::ACTION_LEN;

/// Bounds of the log standard deviation.
pub(crate) const LOG_STD_RANGE: (f32, f32) = (-5.0, 2.0);

/// The policy network.
#[derive(Module, Debug)]
pub struct Actor {
    trunk: Trunk,
    head: Dense,
}

/// A diagonal Gaussian before squashing; both tensors are `[rows, ACTION_LEN]`.
#[derive(Debug, Clone)]
pub struct ActionDistribution {
    /// Means of the action values before tanh.
    pub mean: Tensor<2>,
    /// Natural logarithms of the standard deviations, -5 to 2.
    pub log_std: Tensor<2>,
}

impl Actor {
    /// An actor with weights drawn from `rng`.
    pub fn new(config: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self {
            trunk: Trunk::new(1, config, 0, device, rng),
            head: Dense::new([1, config.hidden, 2 * ACTION_LEN], device, rng),
        }
    }

    /// Adds what an actor of the sizes `to` has and one of its own, `from`, lacks: sight of others and an LSTM. Neither has influence:
    /// decisions are unchanged until training continues.
    #[must_use]
    pub fn grown(self, from: &ActorConfig, to: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self { trunk: self.trunk.grown(from, to, device, rng), head: self.head }
    }

    /// Number of units of the LSTM; `None` for a reactive actor.
    pub fn memory_size(&self) -> Option<usize> {
        self.trunk.memory_size()
    }

    /// Maps observations, one in each row, to the distribution of actions and the hidden state after the last step.
    ///
    /// # Panics
    /// If the actor has a memory and `past` is `None`.
    pub fn forward(
        &self,
        observations: Tensor<2>,
        past: Option<Past<'_>>,
    ) -> (ActionDistribution, Option<HiddenState>) {
        let (encoding, state) = self.encode(observations, past);
        (self.decide(encoding), state)
    }

    /// The first half of [`forward`](Self::forward): encodes observations.
    ///
    /// # Panics
    /// If the actor has a memory and `past` is `None`.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<HiddenState>) {
        self.trunk.encode(observations, past)
    }

    /// The second half of [`forward`](Self::forward): maps an encoding to the distribution of actions.
    pub fn decide(&self, encoding: Encoding) -> ActionDistribution {
        let output = self.head.forward(self.trunk.consider(encoding, None)).squeeze_dim::<2>(0);
        let mean = output.clone().narrow(1, 0, ACTION_LEN);
        let log_std = output.narrow(1, ACTION_LEN, ACTION_LEN).clamp(LOG_STD_RANGE.0, LOG_STD_RANGE.1);
        ActionDistribution { mean, log_std }
    }
}

/// Draws `count` standard normal values by the Box-Muller transform.
pub fn gaussian(rng: &mut impl Rng, count: usize) -> Vec<f32> {
    let mut values = vec![0.0; count];
    fill_gaussian(rng, &mut values);
    values
}

/// Fills `values` with the same values that [`gaussian`] draws, without allocating.
pub fn fill_gaussian(rng: &mut impl Rng, values: &mut [f32]) {
    for pair in values.chunks_mut(2) {
        let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
        let (sin, cos) = (std::f32::consts::TAU * rng.random::<f32>()).sin_cos();
        pair.iter_mut().zip([radius * cos, radius * sin]).for_each(|(value, drawn)| *value = drawn);
    }
}
