//! Fast paths for the CPU backend: fused operations with handwritten backward passes. Each returns `None` if its
//! tensors are on another device. Tests compare each with the equivalent tensor operations.

pub mod dense;
pub mod lstm;
pub mod rays;

use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::flex::FlexTensor;
use burn::backend::{Autodiff, Flex};
use burn::tensor::TensorData;

/// The CPU backend with automatic differentiation.
type Tracked = Autodiff<Flex, NoCheckpointing>;

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

/// Copies a tensor's values in row-major order.
fn contiguous(tensor: &FlexTensor) -> Vec<f32> {
    tensor.clone().into_data().try_into_vec().expect("f32 tensors")
}

/// The same tensor in row-major order from the beginning of its storage, so that the storage can be read as its values.
fn packed(tensor: FlexTensor) -> FlexTensor {
    if tensor.is_contiguous() && tensor.layout().start_offset() == 0 { tensor } else { tensor.to_contiguous() }
}

/// Shape of a three-dimensional tensor.
fn dims(tensor: &FlexTensor) -> [usize; 3] {
    let shape = tensor.layout().shape();
    [shape[0], shape[1], shape[2]]
}

/// Adds biases `[members, 1, width]` to outputs `[members, rows, width]` and, if `relu`, applies ReLU.
fn add_bias(mut outputs: FlexTensor, bias: &FlexTensor, relu: bool) -> FlexTensor {
    let [_, rows, width] = dims(&outputs);
    let bias = packed(bias.clone());
    let floor = if relu { 0.0 } else { f32::NEG_INFINITY };
    let blocks = outputs.storage_mut::<f32>().chunks_exact_mut(rows * width);
    for (block, bias) in blocks.zip(bias.storage::<f32>().chunks_exact(width)) {
        for row in block.chunks_exact_mut(width) {
            for (value, bias) in row.iter_mut().zip(bias) {
                *value = (*value + bias).max(floor);
            }
        }
    }
    outputs
}

/// Gradient of a ReLU's input: 0 where the output is 0.
fn relu_gradient(gradient: FlexTensor, output: &FlexTensor) -> FlexTensor {
    let mut gradient = packed(gradient);
    let output: &[f32] = output.storage();
    for (value, output) in gradient.storage_mut::<f32>().iter_mut().zip(output) {
        // A select instead of a branch, so that the loop is vectorised.
        *value = if *output > 0.0 { *value } else { 0.0 };
    }
    gradient
}

/// Sums over rows: `[members, rows, width]` to `[members, 1, width]`.
fn sum_rows(gradient: &FlexTensor) -> FlexTensor {
    let [members, rows, width] = dims(gradient);
    let values: &[f32] = gradient.storage();
    let mut sums = vec![0.0; members * width];
    for (sums, block) in sums.chunks_exact_mut(width).zip(values.chunks_exact(rows * width)) {
        for row in block.chunks_exact(width) {
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum += value;
            }
        }
    }
    tensor(sums, [members, 1, width])
}
