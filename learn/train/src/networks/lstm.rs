//! A long short-term memory (Hochreiter & Schmidhuber 1997) over whole sequences.
//!
//! One matrix computes all four gates. On the CPU a sequence is one operation with its own backward pass
//! ([`super::cpu::lstm`]). On other devices it is composed of tensor operations, which are also the reference for tests
//! of the fast path.

use super::cpu;
use super::dense::{Dense, blend};
use super::state::HiddenState;
use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, RngExt};
use surefoot_policy::config::GATES;

/// An LSTM layer for several members side by side.
#[derive(Module, Debug)]
pub struct Lstm {
    /// Maps inputs to the gates before activation, in the order input, forget, output, candidate.
    input: Dense,
    /// Maps the previous hidden state to the same gates, `[members, size, 4 size]`.
    recurrent: Param<Tensor<3>>,
}

impl Lstm {
    /// An LSTM of `size` units for `input` features. Recurrent weights are from U(-1/sqrt(size), 1/sqrt(size)) as in
    /// PyTorch; 1 is added to the forget biases.
    pub fn new(members: usize, input: usize, size: usize, device: &Device, rng: &mut impl Rng) -> Self {
        let bound = 1.0 / (size as f32).sqrt();
        let recurrent = (0..members * size * GATES * size).map(|_| rng.random_range(-bound..bound)).collect();
        let recurrent = TensorData::new::<f32, _>(recurrent, [members, size, GATES * size]);
        let input = Dense::biased([members, input, GATES * size], size..2 * size, device, rng);
        Self { input, recurrent: Param::from_data(recurrent, device) }
    }

    /// Inserts `count` inputs with weight 0 before input `at`.
    pub(crate) fn with_inputs(self, at: usize, count: usize, device: &Device) -> Self {
        Self { input: self.input.with_inputs(at, count, device), ..self }
    }

    /// Number of units: the length of the hidden state.
    pub fn size(&self) -> usize {
        self.recurrent.dims()[1]
    }

    /// Processes a sequence.
    ///
    /// `inputs` are `[members, steps * batch, features]`, all rows of step 0 first. `keep` has one factor for each of
    /// these rows, by which the state before the row's step is multiplied: 0 where memory is reset, otherwise 1.
    /// Returns the hidden states, `[members, steps * batch, size]`, and the state after the last step, which has no
    /// gradient.
    pub fn forward(&self, inputs: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
        let gates = self.input.forward(inputs);
        sequence(gates, self.recurrent.val(), past, keep)
    }

    /// Moves every weight towards `source`'s by `share`, 0 to 1.
    #[must_use]
    pub fn soft_update(self, source: &Self, share: f32) -> Self {
        Self {
            input: self.input.soft_update(&source.input, share),
            recurrent: blend(self.recurrent, &source.recurrent, share),
        }
    }
}

/// Runs the recurrence on gates before activation, `[members, steps * batch, 4 size]`. `past`, `keep` and the results
/// are those of [`Lstm::forward`].
pub fn sequence(gates: Tensor<3>, recurrent: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
    cpu::lstm::sequence(&gates, &recurrent, past, keep).unwrap_or_else(|| composed(gates, recurrent, past, keep))
}

/// Like [`sequence`], composed of tensor operations, for any device.
pub fn composed(gates: Tensor<3>, recurrent: Tensor<3>, past: &HiddenState, keep: &[f32]) -> (Tensor<3>, HiddenState) {
    let [members, batch, size] = past.hidden.dims();
    let device = gates.device();
    // The past state has no gradient, but must be on the autodiff device.
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
