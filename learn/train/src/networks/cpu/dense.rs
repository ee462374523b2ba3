//! A fully connected layer with bias and optional ReLU, fused.

use super::{Tracked, add_bias, dims, packed, relu_gradient, sum_rows};
use burn::backend::Flex;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::ops::FloatTensorOps;
use burn::tensor::Tensor;

/// Computes `input * weight + bias`, with ReLU if `relu`; `None` if the tensors are not on the CPU.
///
/// `input` is `[members or 1, rows, in]`, `weight` `[members, in, out]`, `bias` `[members, 1, out]`, the result
/// `[members, rows, out]`.
pub fn layer(input: &Tensor<3>, weight: &Tensor<3>, bias: &Tensor<3>, relu: bool) -> Option<Tensor<3>> {
    if let Ok(input) = input.clone().try_into_primitive::<Flex>() {
        let weight = weight.clone().try_into_primitive::<Flex>().ok()?;
        let bias = bias.clone().try_into_primitive::<Flex>().ok()?;
        return Some(Tensor::from_primitive::<Flex>(forward(input, weight, &bias, relu)));
    }
    let input = input.clone().try_into_primitive::<Tracked>().ok()?;
    let weight = weight.clone().try_into_primitive::<Tracked>().ok()?;
    let bias = bias.clone().try_into_primitive::<Tracked>().ok()?;
    let guards = [input.node(), weight.node(), bias.node()];
    let (input, weight) = (input.into_primitive(), weight.into_primitive());
    let output = forward(input.clone(), weight.clone(), bias.primitive(), relu);
    let output = match Layer.prepare::<NoCheckpointing>(guards).compute_bound().stateful() {
        OpsKind::Tracked(preparation) => {
            let saved = Saved { input, weight, output: relu.then(|| output.clone()) };
            preparation.finish(saved, output)
        }
        OpsKind::UnTracked(preparation) => preparation.finish(output),
    };
    Some(Tensor::from_primitive::<Tracked>(output))
}

fn forward(input: FlexTensor, weight: FlexTensor, bias: &FlexTensor, relu: bool) -> FlexTensor {
    add_bias(Flex::float_matmul(input, weight), bias, relu)
}

/// The operation with its backward pass.
#[derive(Debug)]
struct Layer;

/// Tensors that the backward pass needs; `output` only with ReLU.
#[derive(Debug, Clone)]
struct Saved {
    input: FlexTensor,
    weight: FlexTensor,
    output: Option<FlexTensor>,
}

impl Backward<Flex, 3> for Layer {
    type State = Saved;

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let [input_node, weight_node, bias_node] = ops.parents;
        let Saved { input, weight, output } = ops.state;
        let gradient = grads.consume::<Flex>(&ops.node);
        let gradient = match &output {
            Some(output) => relu_gradient(gradient, output),
            None => packed(gradient),
        };
        if let Some(node) = bias_node {
            grads.register::<Flex>(node.id, sum_rows(&gradient));
        }
        if let Some(node) = weight_node {
            let product = Flex::float_matmul(input.transpose(1, 2), gradient.clone());
            grads.register::<Flex>(node.id, product);
        }
        if let Some(node) = input_node {
            let product = Flex::float_matmul(gradient, weight.transpose(1, 2));
            let is_shared = dims(&input)[0] < dims(&product)[0];
            grads.register::<Flex>(node.id, if is_shared { Flex::float_sum_dim(product, 0) } else { product });
        }
    }
}
