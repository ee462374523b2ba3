//! The fast recurrence compared with the one composed of tensor operations: values and gradients.

use burn::tensor::{Device, Distribution, Tensor};
use surefoot_train::networks::cpu;
use surefoot_train::networks::lstm::composed;
use surefoot_train::networks::state::HiddenState;

const MEMBERS: usize = 2;
const STEPS: usize = 5;
const BATCH: usize = 3;
const SIZE: usize = 7;

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().unwrap()
}

fn assert_close(name: &str, fast: &[f32], slow: &[f32]) {
    assert_eq!(fast.len(), slow.len());
    let worst = fast.iter().zip(slow).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 2.0e-5, "{name} differs by {worst}");
    assert!(slow.iter().any(|value| value.abs() > 1.0e-4), "{name} is not all zeros");
}

/// Gates, recurrent weights and a past state; large gates saturate the activations.
fn inputs(device: &Device) -> (Tensor<3>, Tensor<3>, HiddenState) {
    device.seed(7);
    let draw = |shape: [usize; 3], width: f64| Tensor::<3>::random(shape, Distribution::Uniform(-width, width), device);
    let gates = draw([MEMBERS, STEPS * BATCH, 4 * SIZE], 6.0);
    let recurrent = draw([MEMBERS, SIZE, 4 * SIZE], 1.0);
    let recall = HiddenState { hidden: draw([MEMBERS, BATCH, SIZE], 1.0), cell: draw([MEMBERS, BATCH, SIZE], 2.0) };
    (gates, recurrent, recall)
}

/// Memory is reset in the middle of one sequence and at the beginning of another.
fn keep() -> Vec<f32> {
    let mut keep = vec![1.0; STEPS * BATCH];
    keep[2 * BATCH + 1] = 0.0;
    keep[2] = 0.0;
    keep
}

#[test]
fn the_fast_recurrence_computes_what_the_composed_one_does() {
    let (gates, recurrent, recall) = inputs(&Device::flex());
    let (fast, fast_last) = sequence(gates.clone(), recurrent.clone(), &recall, &keep());
    let (slow, slow_last) = composed(gates, recurrent, &recall, &keep());
    assert_close("hidden states", &values(fast), &values(slow));
    assert_close("last hidden", &values(fast_last.hidden), &values(slow_last.hidden));
    assert_close("last cell", &values(fast_last.cell), &values(slow_last.cell));
}

#[test]
fn its_gradients_are_those_of_the_composed_one() {
    let device = Device::flex().autodiff();
    let (gates, recurrent, recall) = inputs(&Device::flex());
    let weights =
        values(Tensor::<3>::random([MEMBERS, STEPS * BATCH, SIZE], Distribution::Uniform(-1.0, 1.0), &Device::flex()));
    let gradients = |run: fn(Tensor<3>, Tensor<3>, &HiddenState, &[f32]) -> (Tensor<3>, HiddenState)| {
        let gates = Tensor::<3>::from_data(gates.to_data(), &device).require_grad();
        let recurrent = Tensor::<3>::from_data(recurrent.to_data(), &device).require_grad();
        let (hidden, _) = run(gates.clone(), recurrent.clone(), &recall, &keep());
        let weights = Tensor::<1>::from_floats(weights.as_slice(), &device).reshape([MEMBERS, STEPS * BATCH, SIZE]);
        let mut gradients = (hidden * weights).sum().backward();
        [gates, recurrent].map(|tensor| values(tensor.grad_remove(&mut gradients).expect("a gradient")))
    };
    let ([fast_gates, fast_recurrent], [slow_gates, slow_recurrent]) = (gradients(sequence), gradients(composed));
    assert_close("gradient of the gates", &fast_gates, &slow_gates);
    assert_close("gradient of the recurrent weights", &fast_recurrent, &slow_recurrent);
}

#[test]
fn a_sequence_in_one_call_equals_its_steps_one_by_one() {
    let (gates, recurrent, recall) = inputs(&Device::flex());
    let (whole, _) = sequence(gates.clone(), recurrent.clone(), &recall, &keep());
    let mut recall = recall;
    let mut steps = Vec::new();
    for step in 0..STEPS {
        let gates = gates.clone().narrow(1, step * BATCH, BATCH);
        let (hidden, next) = sequence(gates, recurrent.clone(), &recall, &keep()[step * BATCH..(step + 1) * BATCH]);
        steps.push(hidden);
        recall = next;
    }
    assert_close("hidden states", &values(whole), &values(Tensor::cat(steps, 1)));
}

/// Calls the fast path directly, so that the tests cannot compare the slow path with itself.
fn sequence(gates: Tensor<3>, recurrent: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
    cpu::lstm::sequence(&gates, &recurrent, past, keep).expect("tensors on the CPU")
}
