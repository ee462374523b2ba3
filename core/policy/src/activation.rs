//! Activation functions as polynomials, which the compiler vectorises, and the step of an LSTM that consists of them.

/// e^x with a relative error below 2e-7, `x` clamped to [-80, 80]: 2^n times a polynomial for 2^f, f in [-1/2, 1/2].
#[inline]
pub fn exp(x: f32) -> f32 {
    /// Adding and then subtracting 1.5 * 2^23 rounds to an integer.
    const ROUND: f32 = 12_582_912.0;
    /// Coefficients of the Taylor series of 2^f from degree 1 on: powers of ln 2 over factorials.
    const TAYLOR: [f32; 7] = {
        let mut terms = [std::f32::consts::LN_2; 7];
        let mut idx = 1;
        while idx < terms.len() {
            terms[idx] = terms[idx - 1] * std::f32::consts::LN_2 / (idx + 1) as f32;
            idx += 1;
        }
        terms
    };
    let scaled = x.clamp(-80.0, 80.0) * std::f32::consts::LOG2_E;
    let rounded = scaled + ROUND;
    let rest = scaled - (rounded - ROUND);
    let power = TAYLOR.iter().rev().fold(0.0, |sum, term| (sum + term) * rest) + 1.0;
    // The integer is in the lowest bits. Neither a conversion nor a checked sum would be vectorised.
    let exponent = (rounded.to_bits() << 23).wrapping_add(127 << 23);
    power * f32::from_bits(exponent)
}

#[inline]
fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// The hyperbolic tangent, from [`exp`].
#[inline]
pub fn tanh(x: f32) -> f32 {
    2.0 / (1.0 + exp(-2.0 * x)) - 1.0
}

/// Activates one row of an LSTM's gates in place and computes the states after the step. `cell` holds the cell state
/// before it.
#[inline(always)]
pub fn lstm_step(gates: &mut [f32], cell: &mut [f32], hidden: &mut [f32]) {
    let size = cell.len();
    let (open, candidate) = gates.split_at_mut(3 * size);
    for gate in open.iter_mut() {
        *gate = sigmoid(*gate);
    }
    for value in candidate.iter_mut() {
        *value = tanh(*value);
    }
    let (input, rest) = open.split_at(size);
    let (forget, output) = rest.split_at(size);
    // Slices of one known length need no checks within the loop.
    let (output, candidate, hidden) = (&output[..size], &candidate[..size], &mut hidden[..size]);
    for idx in 0..size {
        cell[idx] = forget[idx] * cell[idx] + input[idx] * candidate[idx];
        hidden[idx] = output[idx] * tanh(cell[idx]);
    }
}
