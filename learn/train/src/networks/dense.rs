//! Fully connected layers.

use super::cpu;
use burn::module::{Module, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, RngExt};
use std::ops::Range;
use surefoot_policy::config::RAY_LEN;

/// Fully connected layers of equal shape for several members.
#[derive(Module, Debug)]
pub struct Dense {
    /// `[members, input, output]`.
    weight: Param<Tensor<3>>,
    /// `[members, 1, output]`.
    bias: Param<Tensor<3>>,
}

impl Dense {
    /// Numbers of members, inputs and outputs.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.weight.dims()
    }

    /// Layers of shape `[members, input, output]`, with weights and biases from U(-1/sqrt(input), 1/sqrt(input)) as in
    /// PyTorch.
    pub fn new([members, input, output]: [usize; 3], device: &Device, rng: &mut impl Rng) -> Self {
        Self::biased([members, input, output], 0..0, device, rng)
    }

    /// Like [`new`](Self::new), with 1 added to the biases of the outputs `raised`.
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

    /// Maps `[members or 1, batch, input]` to `[members, batch, output]`.
    pub fn forward(&self, input: Tensor<3>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        cpu::dense::layer(&input, &weight, &bias, false).unwrap_or_else(|| input.matmul(weight) + bias)
    }

    /// Like [`forward`](Self::forward), followed by ReLU.
    pub fn forward_relu(&self, input: Tensor<3>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        cpu::dense::layer(&input, &weight, &bias, true).unwrap_or_else(|| relu(input.matmul(weight) + bias))
    }

    /// Maps the rays of observations, one in each row, to `[members, rows, output]`, followed by ReLU.
    pub(crate) fn forward_rays(&self, observations: &Tensor<2>) -> Tensor<3> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        cpu::rays::layer(observations, &weight, &bias).unwrap_or_else(|| {
            let rays = observations.clone().narrow(1, 0, RAY_LEN).unsqueeze::<3>();
            relu(rays.matmul(weight) + bias)
        })
    }

    /// Inserts `count` inputs with weight 0 before input `at`.
    pub(crate) fn with_inputs(self, at: usize, count: usize, device: &Device) -> Self {
        let [members, input, output] = self.dims();
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

    /// Moves every weight towards `source`'s by `share`, 0 to 1 (Polyak averaging of target networks).
    #[must_use]
    pub fn soft_update(self, source: &Self, share: f32) -> Self {
        Self { weight: blend(self.weight, &source.weight, share), bias: blend(self.bias, &source.bias, share) }
    }
}

/// Moves a parameter towards `source` by `share`, 0 to 1.
pub(crate) fn blend(target: Param<Tensor<3>>, source: &Param<Tensor<3>>, share: f32) -> Param<Tensor<3>> {
    let source = source.val();
    target.map(|tensor| tensor * (1.0 - share) + source * share)
}
