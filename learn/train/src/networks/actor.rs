//! The actor network.
//!
//! Rays pass through one linear layer. Its output is concatenated with the state vector and, for recurrent agents, with
//! the output of an LSTM over both. Two hidden layers map the result to the mean and log standard deviation of a
//! squashed Gaussian (Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications", appendix C). The ray
//! encoder is a linear layer instead of the paper's small CNN: on this backend it learns several times faster
//! (docs/adr/0010-cpu-layers.md).

use super::dense::Dense;
use super::state::HiddenState;
use super::trunk::{Encoding, Past, Trunk};
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;
use surefoot_policy::ActorConfig;
use surefoot_policy::config::LOG_STD_RANGE;
use surefoot_world::character::ACTION_LEN;

/// The policy network.
#[derive(Module, Debug)]
pub struct ActorNetwork {
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

impl ActorNetwork {
    /// An actor with weights drawn from `rng`.
    pub fn new(config: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self {
            trunk: Trunk::new(1, config, 0, device, rng),
            head: Dense::new([1, config.hidden, 2 * ACTION_LEN], device, rng),
        }
    }

    /// Extends an actor of the sizes `from` to the sizes `to`: adds inputs for others and an LSTM. Both have weight 0,
    /// so decisions are unchanged until training continues.
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
