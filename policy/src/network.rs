//! The trunk that actors and critics share in shape: rays and state, an optional memory, two hidden layers.
//!
//! Every layer holds several *members* of equal shape side by side: an actor is one, twin critics are two. One call then
//! serves all of them.

use crate::config::{ActorConfig, RAY_LEN};
use crate::dense::Dense;
use crate::lstm::Lstm;
use crate::state::HiddenState;
use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use rand::Rng;
use surefoot_world::sense::STATE_LEN;

/// What a sequence starts from, for networks with a memory.
#[derive(Debug, Clone, Copy)]
pub struct Past<'a> {
    /// The state before the first step.
    pub state: &'a HiddenState,
    /// See [`Lstm::forward`]: one value for each row.
    pub keep: &'a [f32],
}

/// What a trunk makes of observations before anything is added to them, each `[members, rows, features]`.
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
    pub fn select(self, rows: &Tensor<1, Int>) -> Self {
        let pick = |tensor: Tensor<3>| tensor.select(1, rows.clone());
        Self { sensed: pick(self.sensed), remembered: self.remembered.map(pick) }
    }
}

/// Observations to a hidden vector: the shape that actor and critics share, each with weights of its own.
#[derive(Module, Debug)]
pub struct Trunk {
    rays: Dense,
    memory: Option<Lstm>,
    first: Dense,
    second: Dense,
}

impl Trunk {
    /// A trunk whose hidden layers also take `extra_len` values beside what is sensed and remembered.
    pub fn new(members: usize, config: &ActorConfig, extra_len: usize, device: &Device, rng: &mut impl Rng) -> Self {
        let sensed = config.ray_features + STATE_LEN;
        Self {
            rays: Dense::new([members, RAY_LEN, config.ray_features], device, rng),
            memory: config.memory.map(|size| Lstm::new(members, sensed, size.get(), device, rng)),
            first: Dense::new([members, sensed + config.memory_len() + extra_len, config.hidden], device, rng),
            second: Dense::new([members, config.hidden, config.hidden], device, rng),
        }
    }

    /// The same trunk with a memory that as yet has no influence.
    ///
    /// # Panics
    /// If it has one already.
    #[must_use]
    pub fn with_memory(self, size: usize, device: &Device, rng: &mut impl Rng) -> Self {
        assert!(self.memory.is_none(), "one memory");
        let [members, _, ray_features] = self.rays.dims();
        let sensed = ray_features + STATE_LEN;
        let memory = Some(Lstm::new(members, sensed, size, device, rng));
        Self { memory, first: self.first.with_inputs(sensed, size, device), ..self }
    }

    /// Length of the hidden state, where there is a memory.
    pub fn memory_size(&self) -> Option<usize> {
        self.memory.as_ref().map(Lstm::size)
    }

    /// What is sensed and remembered of observations `[rows, OBSERVATION_LEN]`, and the memory after the last step.
    ///
    /// # Panics
    /// If there is a memory and no past.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<HiddenState>) {
        let sensed = self.sense(observations);
        let Some(memory) = &self.memory else { return (Encoding { sensed, remembered: None }, None) };
        let Past { state, keep } = past.expect("a network with a memory is given its past");
        let (remembered, state) = memory.forward(sensed.clone(), state, keep);
        (Encoding { sensed, remembered: Some(remembered) }, Some(state))
    }

    /// What is sensed: rays and state vector, `[members, rows, features]`.
    fn sense(&self, observations: Tensor<2>) -> Tensor<3> {
        let rays = self.rays.forward_rays(&observations);
        let state = observations.narrow(1, RAY_LEN, STATE_LEN).unsqueeze::<3>();
        let [members, ..] = rays.dims();
        let state = if members == 1 { state } else { state.repeat_dim(0, members) };
        Tensor::cat(vec![rays, state], 2)
    }

    /// An encoding, with what is added to it, to a hidden vector, `[members, rows, hidden]`.
    pub fn consider(&self, encoding: Encoding, added: Option<Tensor<3>>) -> Tensor<3> {
        let Encoding { sensed, remembered } = encoding;
        let inputs = [Some(sensed), remembered, added].into_iter().flatten().collect();
        self.second.forward_relu(self.first.forward_relu(Tensor::cat(inputs, 2)))
    }

    /// Moves every weight by `share` towards `source`'s.
    #[must_use]
    pub fn soft_update(self, source: &Self, share: f32) -> Self {
        Self {
            rays: self.rays.soft_update(&source.rays, share),
            memory: self.memory.zip(source.memory.as_ref()).map(|(target, source)| target.soft_update(source, share)),
            first: self.first.soft_update(&source.first, share),
            second: self.second.soft_update(&source.second, share),
        }
    }
}
