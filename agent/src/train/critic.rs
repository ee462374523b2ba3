//! The action-value networks: twin critics side by side, of which the smaller estimate is believed.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::Rng;
use surefoot_policy::ActorConfig;
use surefoot_policy::lstm::Recall;
use surefoot_policy::network::{Dense, Past, Trunk};
use surefoot_world::character::ACTION_LEN;

/// Critics in all (Fujimoto et al. 2018, "Addressing Function Approximation Error in Actor-Critic Methods").
pub const CRITIC_COUNT: usize = 2;

/// Twin critics: observation and action to one number each.
#[derive(Module, Debug)]
pub struct Critics {
    trunk: Trunk,
    head: Dense,
}

impl Critics {
    /// Fresh weights drawn from `rng`.
    pub fn new(config: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        Self {
            trunk: Trunk::new(CRITIC_COUNT, config, ACTION_LEN, device, rng),
            head: Dense::new([CRITIC_COUNT, config.hidden, 1], device, rng),
        }
    }

    /// The same critics with a memory that as yet tells nothing.
    #[must_use]
    pub fn with_memory(self, size: usize, device: &Device, rng: &mut impl Rng) -> Self {
        Self { trunk: self.trunk.with_memory(size, device, rng), head: self.head }
    }

    /// Everything that does not depend on the action: `[rows, OBSERVATION_LEN]` to `[critics, rows, features]`, one tensor
    /// of what is sensed and one of what is remembered, and the memory after the last step.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<Recall>) {
        let sensed = self.trunk.sense(observations);
        match self.trunk.remember(&sensed, past) {
            Some((remembered, recall)) => (Encoding { sensed, remembered: Some(remembered) }, Some(recall)),
            None => (Encoding { sensed, remembered: None }, None),
        }
    }

    /// Values of actions `[rows, ACTION_LEN]`, `[critics, rows, 1]`.
    pub fn value(&self, encoding: Encoding, actions: Tensor<2>) -> Tensor<3> {
        let Encoding { sensed, remembered } = encoding;
        let actions = actions.unsqueeze::<3>().repeat_dim(0, CRITIC_COUNT);
        let inputs = [Some(sensed), remembered, Some(actions)].into_iter().flatten().collect();
        self.head.forward(self.trunk.consider(inputs))
    }

    /// The smaller value of each row, `[rows, 1]`.
    pub fn smaller_value(&self, encoding: Encoding, actions: Tensor<2>) -> Tensor<2> {
        self.value(encoding, actions).min_dim(0).squeeze_dim(0)
    }

    /// Moves every weight by `share` towards `source`'s.
    #[must_use]
    pub fn follow(self, source: &Self, share: f32) -> Self {
        Self { trunk: self.trunk.follow(&source.trunk, share), head: self.head.follow(&source.head, share) }
    }
}

/// What critics make of observations before they see an action.
#[derive(Debug, Clone)]
pub struct Encoding {
    sensed: Tensor<3>,
    remembered: Option<Tensor<3>>,
}

impl Encoding {
    /// The same values without the graph that led to them.
    #[must_use]
    pub fn detach(self) -> Self {
        Self { sensed: self.sensed.detach(), remembered: self.remembered.map(Tensor::detach) }
    }

    /// Some of the rows.
    #[must_use]
    pub fn select(self, rows: &Tensor<1, burn::tensor::Int>) -> Self {
        let pick = |tensor: Tensor<3>| tensor.select(1, rows.clone());
        Self { sensed: pick(self.sensed), remembered: self.remembered.map(pick) }
    }
}
