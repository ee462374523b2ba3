//! The LSTM recurrence on the CPU: the backend computes matrix products, everything else takes one pass over the gates.
//!
//! Composed of tensor operations, a step of a small LSTM spends most of its time in scalar `exp` and `tanh` calls and
//! in temporaries. Here activations are polynomials that the compiler vectorises, and the backward pass (the chain rule
//! through Hochreiter & Schmidhuber's equations) is written by hand.

use super::super::state::HiddenState;
use super::{Tracked, contiguous, tensor};
use burn::backend::Flex;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::ops::FloatTensorOps;
use burn::tensor::{Tensor, TensorData};
use surefoot_policy::activation::{lstm_step, tanh};
use surefoot_policy::config::GATES;

/// Runs the recurrence; `None` if the tensors are not on the CPU. For the arguments see
/// [`super::super::lstm::sequence`].
pub fn sequence(
    gates: &Tensor<3>,
    recurrent: &Tensor<3>,
    past: &HiddenState,
    keep: &[f32],
) -> Option<(Tensor<3>, HiddenState)> {
    let [members, batch, size] = past.hidden.dims();
    let shape = Shape { members, steps: keep.len() / batch, batch, size };
    let values = |tensor: &Tensor<3>| tensor.clone().into_data().try_into_vec::<f32>().ok();
    let start = Start { hidden: values(&past.hidden)?, cell: values(&past.cell)?, keep: keep.to_vec() };
    let device = past.hidden.device();
    let state = |values| Tensor::from_data(TensorData::new::<f32, _>(values, [members, batch, size]), &device);
    let last = |run: &Run| HiddenState { hidden: state(run.last(&run.hiddens)), cell: state(run.last(&run.cells)) };
    if let Ok(primitive) = gates.clone().try_into_primitive::<Flex>() {
        let recurrent = recurrent.clone().try_into_primitive::<Flex>().ok()?;
        let run = forward(&primitive, &recurrent, shape, start);
        return Some((Tensor::from_primitive::<Flex>(run.output()), last(&run)));
    }
    let gates = gates.clone().try_into_primitive::<Tracked>().ok()?;
    let recurrent = recurrent.clone().try_into_primitive::<Tracked>().ok()?;
    let guards = [gates.node(), recurrent.node()];
    let recurrent_values = recurrent.into_primitive();
    let run = forward(gates.primitive(), &recurrent_values, shape, start);
    let (output, state) = (run.output(), last(&run));
    let output = match Recurrence.prepare::<NoCheckpointing>(guards).compute_bound().stateful() {
        OpsKind::Tracked(preparation) => preparation.finish((run, recurrent_values), output),
        OpsKind::UnTracked(preparation) => preparation.finish(output),
    };
    Some((Tensor::from_primitive::<Tracked>(output), state))
}

/// The operation with its backward pass.
#[derive(Debug)]
struct Recurrence;

impl Backward<Flex, 2> for Recurrence {
    type State = (Run, FlexTensor);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let [gates_node, recurrent_node] = ops.parents;
        let (run, recurrent) = ops.state;
        let output_gradient = grads.consume::<Flex>(&ops.node);
        let gate_gradient = backward(&run, &recurrent, &output_gradient);
        if let Some(node) = recurrent_node {
            grads.register::<Flex>(node.id, recurrent_gradient(&run, &gate_gradient));
        }
        if let Some(node) = gates_node {
            grads.register::<Flex>(node.id, gate_gradient);
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Shape {
    members: usize,
    steps: usize,
    batch: usize,
    size: usize,
}

impl Shape {
    /// Number of values of one member's hidden or cell states at one step.
    fn state(self) -> usize {
        self.batch * self.size
    }

    /// Index at which `member`'s states begin at `step`.
    fn at(self, member: usize, step: usize) -> usize {
        (member * self.steps + step) * self.state()
    }
}

/// State before the first step, and the `keep` factors of all steps.
#[derive(Debug, Clone)]
struct Start {
    hidden: Vec<f32>,
    cell: Vec<f32>,
    keep: Vec<f32>,
}

/// A finished forward pass with the values that its backward pass needs.
#[derive(Debug, Clone)]
struct Run {
    shape: Shape,
    start: Start,
    /// Gates after activation, `[members, steps * batch, 4 size]`.
    gates: Vec<f32>,
    /// Cell states, `[members, steps * batch, size]`.
    cells: Vec<f32>,
    /// Hidden states, `[members, steps * batch, size]`.
    hiddens: Vec<f32>,
}

impl Run {
    fn output(&self) -> FlexTensor {
        let Shape { members, steps, batch, size } = self.shape;
        tensor(self.hiddens.clone(), [members, steps * batch, size])
    }

    /// Hidden or cell states after the last step.
    fn last(&self, states: &[f32]) -> Vec<f32> {
        let Shape { members, steps, .. } = self.shape;
        let last = |member| &states[self.shape.at(member, steps - 1)..][..self.shape.state()];
        (0..members).map(last).collect::<Vec<_>>().concat()
    }

    /// Hidden or cell states before `step`, not yet multiplied by `keep`.
    fn before<'a>(&'a self, states: &'a [f32], start: &'a [f32], member: usize, step: usize) -> &'a [f32] {
        match step.checked_sub(1) {
            Some(previous) => &states[self.shape.at(member, previous)..][..self.shape.state()],
            None => &start[member * self.shape.state()..][..self.shape.state()],
        }
    }

    /// The hidden states before `step` times `keep`: the factor of the recurrent weights.
    fn kept_hidden(&self, member: usize, step: usize) -> Vec<f32> {
        let keep = &self.start.keep[step * self.shape.batch..][..self.shape.batch];
        let mut kept = self.before(&self.hiddens, &self.start.hidden, member, step).to_vec();
        for (row, keep) in kept.chunks_exact_mut(self.shape.size).zip(keep) {
            row.iter_mut().for_each(|value| *value *= keep);
        }
        kept
    }
}

/// One member's recurrent weights, `[size, 4 size]`.
fn member_weights(recurrent: &FlexTensor, member: usize, size: usize) -> FlexTensor {
    recurrent.narrow(0, member, 1).reshape([size, GATES * size].into())
}

fn forward(gates: &FlexTensor, recurrent: &FlexTensor, shape: Shape, start: Start) -> Run {
    let Shape { members, steps, batch, size } = shape;
    let len = members * steps * batch * size;
    let mut run = Run { shape, start, gates: contiguous(gates), cells: vec![0.0; len], hiddens: vec![0.0; len] };
    for member in 0..members {
        let weights = member_weights(recurrent, member, size);
        for step in 0..steps {
            let kept = tensor(run.kept_hidden(member, step), [batch, size]);
            let products = Flex::float_matmul(kept, weights.clone());
            let products: &[f32] = products.storage();
            let before = run.before(&run.cells, &run.start.cell, member, step).to_vec();
            let at = shape.at(member, step);
            let rows = run.gates[at * GATES..][..shape.state() * GATES]
                .chunks_exact_mut(GATES * size)
                .zip(products.chunks_exact(GATES * size))
                .zip(before.chunks_exact(size))
                .zip(&run.start.keep[step * batch..])
                .zip(run.cells[at..].chunks_exact_mut(size).zip(run.hiddens[at..].chunks_exact_mut(size)));
            for ((((gates, products), before), &keep), (cell, hidden)) in rows {
                step_row(gates, products, before, keep, cell, hidden);
            }
        }
    }
    run
}

/// Computes one row of one step: activates its gates in place and writes its new states.
fn step_row(gates: &mut [f32], products: &[f32], before: &[f32], keep: f32, cell: &mut [f32], hidden: &mut [f32]) {
    for (gate, product) in gates.iter_mut().zip(products) {
        *gate += product;
    }
    for (cell, before) in cell.iter_mut().zip(before) {
        *cell = before * keep;
    }
    let size = before.len();
    lstm_step(gates, &mut cell[..size], &mut hidden[..size]);
}

/// Gradient of the gates before activation, `[members, steps * batch, 4 size]`.
fn backward(run: &Run, recurrent: &FlexTensor, output_gradient: &FlexTensor) -> FlexTensor {
    let shape @ Shape { members, steps, batch, size } = run.shape;
    let output_gradient = contiguous(output_gradient);
    let mut gate_gradient = vec![0.0; run.gates.len()];
    for member in 0..members {
        let weights = member_weights(recurrent, member, size).transpose(0, 1);
        let mut hidden_gradient = vec![0.0; shape.state()];
        let mut cell_gradient = vec![0.0; shape.state()];
        for step in (0..steps).rev() {
            let at = shape.at(member, step);
            for (sum, value) in hidden_gradient.iter_mut().zip(&output_gradient[at..]) {
                *sum += value;
            }
            let before = run.before(&run.cells, &run.start.cell, member, step);
            let keep = &run.start.keep[step * batch..][..batch];
            let rows = run.gates[at * GATES..][..shape.state() * GATES]
                .chunks_exact(GATES * size)
                .zip(gate_gradient[at * GATES..].chunks_exact_mut(GATES * size))
                .zip(before.chunks_exact(size).zip(run.cells[at..].chunks_exact(size)))
                .zip(hidden_gradient.chunks_exact(size).zip(cell_gradient.chunks_exact_mut(size)))
                .zip(keep);
            for ((((gates, into), (before, cell)), (hidden_gradient, cell_gradient)), &keep) in rows {
                backward_row(gates, before, cell, keep, hidden_gradient, cell_gradient, into);
            }
            if step > 0 {
                let gradient = gate_gradient[at * GATES..][..shape.state() * GATES].to_vec();
                let product = Flex::float_matmul(tensor(gradient, [batch, GATES * size]), weights.clone());
                hidden_gradient = contiguous(&product);
                for (row, keep) in hidden_gradient.chunks_exact_mut(size).zip(keep) {
                    row.iter_mut().for_each(|value| *value *= keep);
                }
            }
        }
    }
    tensor(gate_gradient, [members, steps * batch, GATES * size])
}

/// Applies the chain rule to one row of one step and replaces `cell_gradient` by the gradient of the previous cell
/// state.
fn backward_row(
    gates: &[f32],
    before: &[f32],
    cell: &[f32],
    keep: f32,
    hidden_gradient: &[f32],
    cell_gradient: &mut [f32],
    into: &mut [f32],
) {
    let size = before.len();
    let [input, forget, output, candidate] = [0, 1, 2, 3].map(|gate| &gates[gate * size..][..size]);
    let (into_input, rest) = into.split_at_mut(size);
    let (into_forget, rest) = rest.split_at_mut(size);
    let (into_output, into_candidate) = rest.split_at_mut(size);
    for idx in 0..size {
        let (i, f, o, g) = (input[idx], forget[idx], output[idx], candidate[idx]);
        let (before, squashed) = (before[idx] * keep, tanh(cell[idx]));
        let through_hidden = hidden_gradient[idx];
        let through_cell = cell_gradient[idx] + through_hidden * o * (1.0 - squashed * squashed);
        into_input[idx] = through_cell * g * i * (1.0 - i);
        into_forget[idx] = through_cell * before * f * (1.0 - f);
        into_output[idx] = through_hidden * squashed * o * (1.0 - o);
        into_candidate[idx] = through_cell * i * (1.0 - g * g);
        cell_gradient[idx] = through_cell * f * keep;
    }
}

/// Gradient of the recurrent weights, `[members, size, 4 size]`: hidden states before each step times the step's gate
/// gradients.
fn recurrent_gradient(run: &Run, gate_gradient: &FlexTensor) -> FlexTensor {
    let Shape { members, steps, batch, size } = run.shape;
    let mut kept = Vec::with_capacity(members * steps * run.shape.state());
    for member in 0..members {
        for step in 0..steps {
            kept.extend(run.kept_hidden(member, step));
        }
    }
    let kept = tensor(kept, [members, steps * batch, size]).transpose(1, 2);
    Flex::float_matmul(kept, gate_gradient.clone())
}
