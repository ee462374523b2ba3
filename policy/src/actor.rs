//! The actor network of the reactive agent.
//!
//! Rays pass through one linear layer of their own, are joined with the state vector, and go through two
//! hidden layers into the mean and log standard deviation of a squashed Gaussian (Haarnoja et al. 2018,
//! "Soft Actor-Critic Algorithms and Applications", appendix C). Linear layers stand where the paper has a
//! small CNN: on this backend they learn several times faster (docs/adr/0003-linear-ray-encoder.md).

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{RAY_CHANNELS, RAY_COUNT, STATE_LEN};

/// Values of an observation that come from rays.
pub const RAY_LEN: usize = RAY_COUNT * RAY_CHANNELS;
/// Bounds of the log standard deviation.
const LOG_STD_RANGE: (f32, f32) = (-5.0, 2.0);

/// Sizes of the layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActorConfig {
    /// Features of the ray encoder.
    pub ray_features: usize,
    /// Width of both hidden layers.
    pub hidden: usize,
}

impl Default for ActorConfig {
    fn default() -> Self {
        Self { ray_features: 128, hidden: 256 }
    }
}

/// Rays and state to a hidden vector: the shape that actor and critics share, each with weights of its own.
#[derive(Module, Debug)]
pub struct Trunk {
    rays: Linear,
    first: Linear,
    second: Linear,
}

impl Trunk {
    /// A trunk that also takes `extra_len` values beside the observation.
    pub fn new(config: &ActorConfig, extra_len: usize, device: &Device, rng: &mut impl Rng) -> Self {
        Self {
            rays: linear(RAY_LEN, config.ray_features, device, rng),
            first: linear(config.ray_features + STATE_LEN + extra_len, config.hidden, device, rng),
            second: linear(config.hidden, config.hidden, device, rng),
        }
    }

    /// `[batch, OBSERVATION_LEN]` and `[batch, extra]` to `[batch, hidden]`.
    pub fn forward(&self, observations: Tensor<2>, extra: Option<Tensor<2>>) -> Tensor<2> {
        let [batch, _] = observations.dims();
        let rays = observations.clone().slice([0..batch, 0..RAY_LEN]);
        let state = observations.slice([0..batch, RAY_LEN..OBSERVATION_LEN]);
        let mut parts = vec![relu(self.rays.forward(rays)), state];
        parts.extend(extra);
        let joined = Tensor::cat(parts, 1);
        relu(self.second.forward(relu(self.first.forward(joined))))
    }
}

/// The policy network.
#[derive(Module, Debug)]
pub struct Actor {
    trunk: Trunk,
    head: Linear,
}

/// A diagonal Gaussian before squashing, each `[batch, ACTION_LEN]`.
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
        Self { trunk: Trunk::new(config, 0, device, rng), head: linear(config.hidden, 2 * ACTION_LEN, device, rng) }
    }

    /// `[batch, OBSERVATION_LEN]` to the distribution of actions.
    pub fn forward(&self, observations: Tensor<2>) -> ActionDistribution {
        let [batch, _] = observations.dims();
        let output = self.head.forward(self.trunk.forward(observations, None));
        let mean = output.clone().slice([0..batch, 0..ACTION_LEN]);
        let log_std = output.slice([0..batch, ACTION_LEN..2 * ACTION_LEN]);
        ActionDistribution { mean, log_std: log_std.clamp(LOG_STD_RANGE.0, LOG_STD_RANGE.1) }
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

/// A linear layer initialised like PyTorch's, U(-1/sqrt(in), 1/sqrt(in)), from a seeded generator.
pub fn linear(input: usize, output: usize, device: &Device, rng: &mut impl Rng) -> Linear {
    let bound = 1.0 / (input as f32).sqrt();
    let mut draw = |count: usize| (0..count).map(|_| rng.random_range(-bound..bound)).collect::<Vec<f32>>();
    let weight = TensorData::new(draw(input * output), [input, output]);
    let bias = TensorData::new(draw(output), [output]);
    Linear { weight: Param::from_data(weight, device), bias: Some(Param::from_data(bias, device)) }
}

impl Trunk {
    /// Moves every weight by `share` towards `source`'s (Polyak averaging of target networks).
    #[must_use]
    pub fn follow(self, source: &Self, share: f32) -> Self {
        Self {
            rays: follow(self.rays, &source.rays, share),
            first: follow(self.first, &source.first, share),
            second: follow(self.second, &source.second, share),
        }
    }
}

/// Moves a layer's weights by `share` towards `source`'s.
#[must_use]
pub fn follow(layer: Linear, source: &Linear, share: f32) -> Linear {
    fn blend<const D: usize>(target: Param<Tensor<D>>, source: &Param<Tensor<D>>, share: f32) -> Param<Tensor<D>> {
        let source = source.val();
        target.map(|tensor| tensor * (1.0 - share) + source * share)
    }
    Linear {
        weight: blend(layer.weight, &source.weight, share),
        bias: layer.bias.zip(source.bias.as_ref()).map(|(target, source)| blend(target, source, share)),
    }
}
