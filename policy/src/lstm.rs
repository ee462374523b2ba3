//! A long short-term memory (Hochreiter & Schmidhuber 1997) over whole sequences.
//!
//! Gates are computed by one matrix for all four. On the CPU a sequence is one operation with a backward pass of its own
//! ([`crate::cpu::lstm`]); elsewhere it is composed of tensor operations, which is also what the fast path is tested against.

use crate::config::GATES;
use crate::cpu;
use crate::dense::{Dense, blend};
use crate::state::HiddenState;
use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, RngExt};

/// An LSTM layer for several members side by side.
#[derive(Module, Debug)]
pub struct Lstm {
    /// From inputs to the gates before activation: input, forget, output, candidate.
    input: Dense,
    /// From the previous hidden state to the same gates, `[members, size, 4 size]`.
    recurrent: Param<Tensor<3>>,
}

impl Lstm {
    /// Weights drawn like PyTorch's, U(-1/sqrt(size), 1/sqrt(size)), with a forget bias of 1.
    pub fn new(members: usize, input: usize, size: usize, device: &Device, rng: &mut impl Rng) -> Self {
        let bound = 1.0 / (size as f32).sqrt();
        let recurrent = (0..members * size * GATES * size).map(|_| rng.random_range(-bound..bound)).collect();
        let recurrent = TensorData::new::<f32, _>(recurrent, [members, size, GATES * size]);
        let input = Dense::biased([members, input, GATES * size], size..2 * size, device, rng);
        Self { input, recurrent: Param::from_data(recurrent, device) }
    }

    /// Length of the hidden state.
    pub fn size(&self) -> usize {
        self.recurrent.dims()[1]
    }

    /// Runs over a sequence.
    ///
    /// `inputs` are `[members, steps * batch, features]`, all of step 0 first. `keep`, one value for each of those rows, is
    /// multiplied onto the state that the row starts from: 0 where memory starts anew. Returns the hidden states,
    /// `[members, steps * batch, size]`, and the state after the last step, which carries no gradient.
    pub fn forward(&self, inputs: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
        let gates = self.input.forward(inputs);
        sequence(gates, self.recurrent.val(), past, keep)
    }

    /// Moves every weight by `share` towards `source`'s.
    #[must_use]
    pub fn soft_update(self, source: &Self, share: f32) -> Self {
        Self {
            input: self.input.soft_update(&source.input, share),
            recurrent: blend(self.recurrent, &source.recurrent, share),
        }
    }
}

/// The recurrence itself, from gates before activation `[members, steps * batch, 4 size]`; see [`Lstm::forward`].
pub fn sequence(gates: Tensor<3>, recurrent: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
    cpu::lstm::sequence(&gates, &recurrent, past, keep).unwrap_or_else(|| composed(gates, recurrent, past, keep))
}

/// The recurrence as tensor operations, for any device.
pub fn composed(gates: Tensor<3>, recurrent: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
    let [members, batch, size] = past.hidden.dims();
    let device = gates.device();
    // The state carries no gradient, whatever it comes from.
    let onto_device = |tensor: &Tensor<3>| {
        let is_plain = device.is_autodiff() && !tensor.device().is_autodiff();
        if is_plain { tensor.clone().autodiff() } else { tensor.clone() }
    };
    let (mut hidden, mut cell) = (onto_device(&past.hidden), onto_device(&past.cell));
    let mut outputs = Vec::with_capacity(keep.len() / batch);
    for (step, keep) in keep.chunks_exact(batch).enumerate() {
        let keep = Tensor::<3>::from_data(TensorData::new(keep.to_vec(), [1, batch, 1]), &device);
        let gates = gates.clone().narrow(1, step * batch, batch) + (hidden * keep.clone()).matmul(recurrent.clone());
        let [input, forget, output] = [0, 1, 2].map(|gate| sigmoid(gates.clone().narrow(2, gate * size, size)));
        let candidate = gates.narrow(2, 3 * size, size).tanh();
        cell = forget * (cell * keep) + input * candidate;
        hidden = output * cell.clone().tanh();
        outputs.push(hidden.clone());
    }
    debug_assert_eq!(outputs[0].dims(), [members, batch, size]);
    let last = HiddenState { hidden: hidden.detach(), cell: cell.detach() };
    (Tensor::cat(outputs, 1), last)
}
