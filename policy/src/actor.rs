//! The actor network.
//!
//! Rays pass through one linear layer of their own, are joined with the state vector (and, for recurrent agents, with what
//! an LSTM remembers of both), and go through two hidden layers into the mean and log standard deviation of a squashed
//! Gaussian (Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications", appendix C). Linear layers stand where
//! the paper has a small CNN: on this backend they learn several times faster (docs/adr/0003-linear-ray-encoder.md).

use crate::lstm::{GATES, Recall};
use crate::network::{Dense, Encoding, Past, RAY_LEN, Trunk};
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::STATE_LEN;

/// Bounds of the log standard deviation.
pub(crate) const LOG_STD_RANGE: (f32, f32) = (-5.0, 2.0);

/// Sizes of the layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActorConfig {
    /// Features of the ray encoder.
    pub ray_features: usize,
    /// Width of both hidden layers.
    pub hidden: usize,
    /// Length of the LSTM's state; 0 for a reactive agent.
    #[serde(default)]
    pub memory: usize,
}

impl Default for ActorConfig {
    fn default() -> Self {
        Self { ray_features: 128, hidden: 256, memory: 0 }
    }
}

/// Widest layer that a file may ask for.
const MAX_WIDTH: usize = 4096;

impl ActorConfig {
    /// Whether a network can have these sizes.
    pub fn is_sound(&self) -> bool {
        let widths = 1..=MAX_WIDTH;
        widths.contains(&self.ray_features) && widths.contains(&self.hidden) && self.memory <= MAX_WIDTH
    }

    /// Parameters of an actor of these sizes, which must be sound: what its weights' file must hold before room is made
    /// for them.
    pub fn parameter_count(&self) -> usize {
        let &Self { ray_features, hidden, memory } = self;
        let dense = |inputs: usize, outputs: usize| (inputs + 1) * outputs;
        let sensed = ray_features + STATE_LEN;
        let lstm = if memory > 0 { dense(sensed, GATES * memory) + memory * GATES * memory } else { 0 };
        dense(RAY_LEN, ray_features)
            + lstm
            + dense(sensed + memory, hidden)
            + dense(hidden, hidden)
            + dense(hidden, 2 * ACTION_LEN)
    }
}

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
    pub fn forward(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (ActionDistribution, Option<Recall>) {
        let (encoding, recall) = self.encode(observations, past);
        (self.decide(encoding), recall)
    }

    /// The first half of [`forward`](Self::forward): what is made of observations.
    ///
    /// # Panics
    /// If the actor has a memory and is given no past.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<Recall>) {
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
