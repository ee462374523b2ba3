//! The trunk of actors and critics: a ray encoder, an optional LSTM and two hidden layers.
//!
//! Every layer holds several *members*, networks of equal shape that one call evaluates together. An actor has one member,
//! twin critics have two.

use crate::config::{ActorConfig, RAY_LEN};
use crate::dense::Dense;
use crate::lstm::Lstm;
use crate::state::HiddenState;
use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use rand::Rng;
use surefoot_world::sense::STATE_LEN;

/// The start of a sequence, for networks with a memory.
#[derive(Debug, Clone, Copy)]
pub struct Past<'a> {
    /// The state before the first step.
    pub state: &'a HiddenState,
    /// One factor for each row; see [`Lstm::forward`].
    pub keep: &'a [f32],
}

/// Encoded observations: the output of the ray encoder with the state vector, and that of the LSTM. Both are
/// `[members, rows, features]`.
#[derive(Debug, Clone)]
pub struct Encoding {
    sensed: Tensor<3>,
    remembered: Option<Tensor<3>>,
}

impl Encoding {
    /// The same values, detached from the autodiff graph.
    #[must_use]
    pub fn detach(self) -> Self {
        Self { sensed: self.sensed.detach(), remembered: self.remembered.map(Tensor::detach) }
    }

    /// Selects rows by index.
    #[must_use]
    pub fn select(self, rows: &Tensor<1, Int>) -> Self {
        let pick = |tensor: Tensor<3>| tensor.select(1, rows.clone());
        Self { sensed: pick(self.sensed), remembered: self.remembered.map(pick) }
    }
}

/// Maps observations to a hidden vector. Actor and critics share this shape, each with their own weights.
#[derive(Module, Debug)]
pub struct Trunk {
    rays: Dense,
    memory: Option<Lstm>,
    first: Dense,
    second: Dense,
}

impl Trunk {
    /// A trunk whose hidden layers take `extra_len` values in addition to the encoding; weights are drawn from `rng`.
    pub fn new(members: usize, config: &ActorConfig, extra_len: usize, device: &Device, rng: &mut impl Rng) -> Self {
        let sensed = config.ray_features + STATE_LEN;
        Self {
            rays: Dense::new([members, RAY_LEN, config.ray_features], device, rng),
            memory: config.memory.map(|size| Lstm::new(members, sensed, size.get(), device, rng)),
            first: Dense::new([members, sensed + config.memory_len() + extra_len, config.hidden], device, rng),
            second: Dense::new([members, config.hidden, config.hidden], device, rng),
        }
    }

    /// Adds an LSTM of `size` units without influence on the output.
    ///
    /// # Panics
    /// If the trunk already has a memory.
    #[must_use]
    pub fn with_memory(self, size: usize, device: &Device, rng: &mut impl Rng) -> Self {
        assert!(self.memory.is_none(), "the trunk has no memory yet");
        let [members, _, ray_features] = self.rays.dims();
        let sensed = ray_features + STATE_LEN;
        let memory = Some(Lstm::new(members, sensed, size, device, rng));
        Self { memory, first: self.first.with_inputs(sensed, size, device), ..self }
    }

    /// Number of units of the LSTM; `None` without one.
    pub fn memory_size(&self) -> Option<usize> {
        self.memory.as_ref().map(Lstm::size)
    }

    /// Encodes observations `[rows, OBSERVATION_LEN]`; also returns the hidden state after the last step.
    ///
    /// # Panics
    /// If the trunk has a memory and `past` is `None`.
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<HiddenState>) {
        let sensed = self.sense(observations);
        let Some(memory) = &self.memory else { return (Encoding { sensed, remembered: None }, None) };
        let Past { state, keep } = past.expect("a network with a memory is given its past");
        let (remembered, state) = memory.forward(sensed.clone(), state, keep);
        (Encoding { sensed, remembered: Some(remembered) }, Some(state))
    }

    /// Encoded rays and the state vector, `[members, rows, features]`.
    fn sense(&self, observations: Tensor<2>) -> Tensor<3> {
        let rays = self.rays.forward_rays(&observations);
        let state = observations.narrow(1, RAY_LEN, STATE_LEN).unsqueeze::<3>();
        let [members, ..] = rays.dims();
        let state = if members == 1 { state } else { state.repeat_dim(0, members) };
        Tensor::cat(vec![rays, state], 2)
    }

    /// Maps an encoding, with the extra values `added`, to a hidden vector, `[members, rows, hidden]`.
    pub fn consider(&self, encoding: Encoding, added: Option<Tensor<3>>) -> Tensor<3> {
        let Encoding { sensed, remembered } = encoding;
        let inputs = [Some(sensed), remembered, added].into_iter().flatten().collect();
        self.second.forward_relu(self.first.forward_relu(Tensor::cat(inputs, 2)))
    }

    /// Moves every weight towards `source`'s by `share`, 0 to 1.
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
