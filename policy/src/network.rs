//! What actors and critics are made of: fully connected layers, an optional memory, and the trunk that both share in shape.
//!
//! Every layer holds several *members* of equal shape side by side: an actor is one, twin critics are two. One call then
//! serves all of them.

use crate::ActorConfig;
use crate::cpu;
use crate::lstm::{Lstm, Recall};
use burn::module::{Module, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};
use rand::{Rng, RngExt};
use std::ops::Range;
use surefoot_world::sense::{RAY_CHANNELS, RAY_COUNT, STATE_LEN};

/// Values of an observation that come from rays.
pub const RAY_LEN: usize = RAY_COUNT * RAY_CHANNELS;

/// A fully connected layer of several members.
#[derive(Module, Debug)]
pub struct Dense {
    /// `[members, input, output]`.
    weight: Param<Tensor<3>>,
    /// `[members, 1, output]`.
    bias: Param<Tensor<3>>,
}

impl Dense {
    /// Weights drawn like PyTorch's, U(-1/sqrt(input), 1/sqrt(input)), from a seeded generator.
    pub fn new([members, input, output]: [usize; 3], device: &Device, rng: &mut impl Rng) -> Self {
        Self::biased([members, input, output], 0..0, device, rng)
    }

    /// The same, with 1 added to the biases of some outputs.
    pub(crate) fn biased(
        [members, input, output]: [usize; 3],
        raised: Range<usize>,
        device: &Device,
        rng: &mut impl Rng,
    ) -> Self {
        let bound = 1.0 / (input as f32).sqrt();
        let mut draw = |count: usize| (0..count).map(|_| rng.random_range(-bound..bound)).collect::<Vec<f32>>();
        let weight = TensorData::new(draw(members * input * output), [members, input, output]);
        let mut bias = draw(members * output);
        for biases in bias.chunks_exact_mut(output) {
            biases[raised.clone()].iter_mut().for_each(|bias| *bias += 1.0);
        }
        let bias = TensorData::new(bias, [members, 1, output]);
        Self { weight: Param::from_data(weight, device), bias: Param::from_data(bias, device) }
    }

    /// `[members or 1, batch, input]` to `[members, batch, output]`.
    pub fn forward(&self, input: Tensor<3>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        cpu::dense::layer(&input, &weight, &bias, false).unwrap_or_else(|| input.matmul(weight) + bias)
    }

    /// The same, cut off below 0.
    pub fn forward_relu(&self, input: Tensor<3>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        cpu::dense::layer(&input, &weight, &bias, true).unwrap_or_else(|| relu(input.matmul(weight) + bias))
    }

    /// The rays of observations `[rows, OBSERVATION_LEN]`, cut off below 0: `[members, rows, output]`.
    fn forward_rays(&self, observations: &Tensor<2>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        cpu::rays::layer(observations, &weight, &bias).unwrap_or_else(|| {
            let rays = observations.clone().narrow(1, 0, RAY_LEN).unsqueeze::<3>();
            relu(rays.matmul(weight) + bias)
        })
    }

    /// The same layer with `count` more inputs before input `at`, which as yet have no influence.
    fn with_inputs(self, at: usize, count: usize, device: &Device) -> Self {
        let [members, input, output] = self.weight.dims();
        let old = self.weight.val().into_data().try_into_vec::<f32>().expect("f32 weights");
        let mut weight = Vec::with_capacity(members * (input + count) * output);
        for rows in old.chunks_exact(input * output) {
            let (before, after) = rows.split_at(at * output);
            weight.extend(before);
            weight.resize(weight.len() + count * output, 0.0);
            weight.extend(after);
        }
        let weight = TensorData::new(weight, [members, input + count, output]);
        Self { weight: Param::from_data(weight, device), bias: self.bias }
    }

    /// Moves every weight by `share` towards `source`'s (Polyak averaging of target networks).
    #[must_use]
    pub fn follow(self, source: &Self, share: f32) -> Self {
        Self { weight: blend(self.weight, &source.weight, share), bias: blend(self.bias, &source.bias, share) }
    }
}

/// A parameter moved by `share` towards `source`.
pub(crate) fn blend(target: Param<Tensor<3>>, source: &Param<Tensor<3>>, share: f32) -> Param<Tensor<3>> {
    let source = source.val();
    target.map(|tensor| tensor * (1.0 - share) + source * share)
}

/// What a sequence starts from, for networks with a memory.
#[derive(Debug, Clone, Copy)]
pub struct Past<'a> {
    /// The state before the first step.
    pub recall: &'a Recall,
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
            memory: (config.memory > 0).then(|| Lstm::new(members, sensed, config.memory, device, rng)),
            first: Dense::new([members, sensed + config.memory + extra_len, config.hidden], device, rng),
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
        let [members, _, ray_features] = self.rays.weight.dims();
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
    pub fn encode(&self, observations: Tensor<2>, past: Option<Past<'_>>) -> (Encoding, Option<Recall>) {
        let sensed = self.sense(observations);
        let Some(memory) = &self.memory else { return (Encoding { sensed, remembered: None }, None) };
        let Past { recall, keep } = past.expect("a network with a memory is given its past");
        let (remembered, recall) = memory.forward(sensed.clone(), recall, keep);
        (Encoding { sensed, remembered: Some(remembered) }, Some(recall))
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
    pub fn follow(self, source: &Self, share: f32) -> Self {
        Self {
            rays: self.rays.follow(&source.rays, share),
            memory: self.memory.zip(source.memory.as_ref()).map(|(target, source)| target.follow(source, share)),
            first: self.first.follow(&source.first, share),
            second: self.second.follow(&source.second, share),
        }
    }
}
