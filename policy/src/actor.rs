//! The actor network.
//!
//! Rays pass through one linear layer of their own, are joined with the state vector (and, for recurrent agents, with what
//! an LSTM remembers of both), and go through two hidden layers into the mean and log standard deviation of a squashed
//! Gaussian (Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications", appendix C). Linear layers stand where
//! the paper has a small CNN: on this backend they learn several times faster (docs/adr/0003-linear-ray-encoder.md).

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

/// A diagonal Gaussian before squashing, each `[rows, ACTION_LEN]`.
#[derive(Debug, Clone)]
pub struct ActionDistribution {
    /// Means.
    pub mean: Tensor<2>,
    /// Logarithms of the standard deviations.
    pub log_std: Tensor<2>,
}

impl Actor {
    /// Fresh weights drawn from `rng`.
    pub fn new(config: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self {
            trunk: Trunk::new(1, config, 0, device, rng),
            head: Dense::new([1, config.hidden, 2 * ACTION_LEN], device, rng),
        }
    }

    /// The same actor with a memory that as yet tells nothing: its decisions are unchanged until it learns.
    #[must_use]
    pub fn with_memory(self, size: usize, device: &Device, rng: &mut impl Rng) -> Self {
        Self { trunk: self.trunk.with_memory(size, device, rng), head: self.head }
    }

    /// Length of the hidden state, where there is a memory.
    pub fn memory_size(&self) -> Option<usize> {
        self.trunk.memory_size()
    }

    /// `[rows, OBSERVATION_LEN]` to the distribution of actions, and what is remembered after the last step.
    ///
    /// # Panics
    /// If the actor has a memory and is given no past.
    pub fn forward(
        &self,
        observations: Tensor<2>,
        past: Option<Past<'_>>,
    ) -> (ActionDistribution, Option<HiddenState>) {
        let (encoding, state) = self.encode(observations, past);
        (self.decide(encoding), state)
    }

    /// The first half of [`forward`](Self::forward): what is made of observations.
    ///
    /// # Panics
    /// If the actor has a memory and is given no past.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<HiddenState>) {
        self.trunk.encode(observations, past)
    }

    /// The second half: what to do then.
    pub fn decide(&self, encoding: Encoding) -> ActionDistribution {
        let output = self.head.forward(self.trunk.consider(encoding, None)).squeeze_dim::<2>(0);
        let mean = output.clone().narrow(1, 0, ACTION_LEN);
        let log_std = output.narrow(1, ACTION_LEN, ACTION_LEN).clamp(LOG_STD_RANGE.0, LOG_STD_RANGE.1);
        ActionDistribution { mean, log_std }
    }
}

/// Standard normal values by Box-Muller.
pub fn gaussian(rng: &mut impl Rng, count: usize) -> Vec<f32> {
    let mut values = Vec::with_capacity(count + 1);
    while values.len() < count {
        let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
        let (sin, cos) = (std::f32::consts::TAU * rng.random::<f32>()).sin_cos();
        values.extend([radius * cos, radius * sin]);
    }
    values.truncate(count);
    values
}
