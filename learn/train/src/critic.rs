//! The action-value networks: twin critics, of which the smaller estimate is used.

use super::networks::dense::Dense;
use super::networks::state::HiddenState;
use super::networks::trunk::{Encoding, Past, Trunk};
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;
use surefoot_policy::ActorConfig;
use surefoot_world::character::ACTION_LEN;

/// Number of critics (Fujimoto et al. 2018, "Addressing Function Approximation Error in Actor-Critic Methods").
pub const CRITIC_COUNT: usize = 2;

/// Twin critics: each maps an observation and an action to a value.
#[derive(Module, Debug)]
pub struct Critics {
    trunk: Trunk,
    head: Dense,
}

impl Critics {
    /// Critics with weights drawn from `rng`.
    pub fn new(config: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self {
            trunk: Trunk::new(CRITIC_COUNT, config, ACTION_LEN, device, rng),
            head: Dense::new([CRITIC_COUNT, config.hidden, 1], device, rng),
        }
    }

    /// Extends critics of the sizes `from` to the sizes `to`, without influence on the values.
    #[must_use]
    pub fn grown(self, from: &ActorConfig, to: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self { trunk: self.trunk.grown(from, to, device, rng), head: self.head }
    }

    /// Encodes observations, independently of actions; also returns the hidden state after the last step.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<HiddenState>) {
        self.trunk.encode(observations, past)
    }

    /// Values of actions `[rows, ACTION_LEN]` by each critic, `[critics, rows, 1]`.
    pub fn value(&self, encoding: Encoding, actions: Tensor<2>) -> Tensor<3> {
        let actions = actions.unsqueeze::<3>().repeat_dim(0, CRITIC_COUNT);
        self.head.forward(self.trunk.consider(encoding, Some(actions)))
    }

    /// The smaller of the critics' values of each row, `[rows, 1]`.
    pub fn smaller_value(&self, encoding: Encoding, actions: Tensor<2>) -> Tensor<2> {
        self.value(encoding, actions).min_dim(0).squeeze_dim(0)
    }

    /// Moves every weight towards `source`'s by `share`, 0 to 1.
    #[must_use]
    pub fn soft_update(self, source: &Self, share: f32) -> Self {
        Self { trunk: self.trunk.soft_update(&source.trunk, share), head: self.head.soft_update(&source.head, share) }
    }
}
