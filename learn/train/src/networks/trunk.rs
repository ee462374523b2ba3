//! The trunk of actors and critics: a ray encoder, an optional LSTM and two hidden layers.
//!
//! Every layer holds several *members*, networks of equal shape that one call evaluates together. An actor has one
//! member, twin critics have two.

use super::dense::Dense;
use super::lstm::Lstm;
use super::state::HiddenState;
use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use rand::Rng;
use surefoot_policy::config::{ActorConfig, RAY_LEN};
use surefoot_world::sense::OTHERS_LEN;

/// The start of a sequence, for networks with a memory.
#[derive(Debug, Clone, Copy)]
pub struct Past<'a> {
    /// The state before the first step.
    pub state: &'a HiddenState,
    /// One factor for each row; see [`Lstm::forward`].
    pub keep: &'a [f32],
}

/// Encoded observations: the ray encoder's output with the state vector, and the LSTM's output. Both are
/// `[members, rows, features]`.
#[derive(Debug, Clone)]
pub struct Encoding {
    sensed: Tensor<3>,
    remembered: Option<Tensor<3>>,
}

impl Encoding {
    /// Detaches the values from the autodiff graph.
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
        let sensed = config.sensed_len();
        Self {
            rays: Dense::new([members, RAY_LEN, config.ray_features], device, rng),
            memory: config.memory.map(|size| Lstm::new(members, sensed, size.get(), device, rng)),
            first: Dense::new([members, sensed + config.memory_len() + extra_len, config.hidden], device, rng),
            second: Dense::new([members, config.hidden, config.hidden], device, rng),
        }
    }

    /// Extends a trunk of the sizes `from` to the sizes `to`: adds inputs for others and an LSTM, both with weight 0.
    #[must_use]
    pub fn grown(mut self, from: &ActorConfig, to: &ActorConfig, device: &Device, rng: &mut impl Rng) -> Self {
        if to.sees_others && !from.sees_others {
            let at = from.sensed_len();
            self.memory = self.memory.map(|memory| memory.with_inputs(at, OTHERS_LEN, device));
            self.first = self.first.with_inputs(at, OTHERS_LEN, device);
        }
        if let (None, Some(size)) = (from.memory, to.memory) {
            let [members, ..] = self.rays.dims();
            let sensed = to.sensed_len();
            self.memory = Some(Lstm::new(members, sensed, size.get(), device, rng));
            self.first = self.first.with_inputs(sensed, size.get(), device);
        }
        self
    }

    /// Number of units of the LSTM; `None` without one.
    pub fn memory_size(&self) -> Option<usize> {
        self.memory.as_ref().map(Lstm::size)
    }

    /// Encodes observations, one in each row; also returns the hidden state after the last step.
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
        let [_, len] = observations.dims();
        let state = observations.narrow(1, RAY_LEN, len - RAY_LEN).unsqueeze::<3>();
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
