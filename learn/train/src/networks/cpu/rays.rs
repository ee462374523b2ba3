//! The ray encoder, optimized for inputs that are mostly zeros.
//!
//! A ray's first value, its proximity, is rarely zero; the values that show hazards or devices nearly always are. The
//! proximities go through a matrix product, the other values are added one by one. That saves four fifths of the
//! layer's work.

use super::{Tracked, add_bias, dims, packed, relu_gradient, sum_rows, tensor};
use burn::backend::Flex;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::ops::FloatTensorOps;
use burn::tensor::Tensor;
use surefoot_policy::config::RAY_LEN;
use surefoot_world::sense::RAY_COUNT;

/// Encodes the rays of observations with ReLU; `None` if the tensors are not on the CPU. Observations get no gradient.
///
/// `observations` are `[rows, values]` and begin with the rays, `weight` is `[members, RAY_LEN, out]`, `bias`
/// `[members, 1, out]`, the result `[members, rows, out]`.
pub fn layer(observations: &Tensor<2>, weight: &Tensor<3>, bias: &Tensor<3>) -> Option<Tensor<3>> {
    if let Ok(observations) = observations.clone().try_into_primitive::<Flex>() {
        let weight = weight.clone().try_into_primitive::<Flex>().ok()?;
        let bias = bias.clone().try_into_primitive::<Flex>().ok()?;
        return Some(Tensor::from_primitive::<Flex>(forward(&packed(observations), &weight, &bias)));
    }
    let observations = observations.clone().try_into_primitive::<Tracked>().ok()?;
    let weight = weight.clone().try_into_primitive::<Tracked>().ok()?;
    let bias = bias.clone().try_into_primitive::<Tracked>().ok()?;
    let observations = packed(observations.into_primitive());
    let guards = [weight.node(), bias.node()];
    let output = forward(&observations, weight.primitive(), bias.primitive());
    let output = match Rays.prepare::<NoCheckpointing>(guards).compute_bound().stateful() {
        OpsKind::Tracked(preparation) => preparation.finish((observations, output.clone()), output),
        OpsKind::UnTracked(preparation) => preparation.finish(output),
    };
    Some(Tensor::from_primitive::<Tracked>(output))
}

/// The proximities of all rays, `[1, rows, RAY_COUNT]`.
fn proximities(observations: &FlexTensor) -> FlexTensor {
    let rows = observations.layout().shape()[0];
    observations.narrow(1, 0, RAY_COUNT).to_contiguous().reshape([1, rows, RAY_COUNT].into())
}

/// Row, input index and value of every nonzero ray value other than proximities.
fn nonzero_others(observations: &FlexTensor) -> Vec<(usize, usize, f32)> {
    let mut found = Vec::new();
    let len = observations.layout().shape()[1];
    for (row, values) in observations.storage::<f32>().chunks_exact(len).enumerate() {
        let others = values[..RAY_LEN].iter().enumerate().skip(RAY_COUNT);
        found.extend(others.filter(|(_, value)| **value != 0.0).map(|(input, &value)| (row, input, value)));
    }
    found
}

fn forward(observations: &FlexTensor, weight: &FlexTensor, bias: &FlexTensor) -> FlexTensor {
    let mut outputs = Flex::float_matmul(proximities(observations), weight.narrow(1, 0, RAY_COUNT));
    let [_, rows, width] = dims(&outputs);
    let weight = packed(weight.clone());
    let others = nonzero_others(observations);
    let blocks = outputs.storage_mut::<f32>().chunks_exact_mut(rows * width);
    for (block, weight) in blocks.zip(weight.storage::<f32>().chunks_exact(RAY_LEN * width)) {
        for &(row, input, value) in &others {
            let weights = &weight[input * width..][..width];
            for (output, weight) in block[row * width..][..width].iter_mut().zip(weights) {
                *output += value * weight;
            }
        }
    }
    add_bias(outputs, bias, true)
}

/// The operation with its backward pass.
#[derive(Debug)]
struct Rays;

impl Backward<Flex, 2> for Rays {
    type State = (FlexTensor, FlexTensor);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let [weight_node, bias_node] = ops.parents;
        let (observations, output) = ops.state;
        let gradient = relu_gradient(grads.consume::<Flex>(&ops.node), &output);
        if let Some(node) = weight_node {
            grads.register::<Flex>(node.id, weight_gradient(&observations, &gradient));
        }
        if let Some(node) = bias_node {
            grads.register::<Flex>(node.id, sum_rows(&gradient));
        }
    }
}

/// Gradient of the weights, `[members, RAY_LEN, out]`: inputs times output gradients.
fn weight_gradient(observations: &FlexTensor, gradient: &FlexTensor) -> FlexTensor {
    let [members, rows, width] = dims(gradient);
    let dense = Flex::float_matmul(proximities(observations).transpose(1, 2), gradient.clone());
    let (dense, gradient): (&[f32], &[f32]) = (dense.storage(), gradient.storage());
    let others = nonzero_others(observations);
    let mut sums = vec![0.0; members * RAY_LEN * width];
    for (member, sums) in sums.chunks_exact_mut(RAY_LEN * width).enumerate() {
        let block = RAY_COUNT * width;
        sums[..block].copy_from_slice(&dense[member * block..][..block]);
        let gradient = &gradient[member * rows * width..][..rows * width];
        for &(row, input, value) in &others {
            for (sum, gradient) in sums[input * width..][..width].iter_mut().zip(&gradient[row * width..]) {
                *sum += value * gradient;
            }
        }
    }
    tensor(sums, [members, RAY_LEN, width])
}
