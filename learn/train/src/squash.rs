//! Sampling from a squashed Gaussian, with log probabilities.

use super::networks::ActionDistribution;
use burn::tensor::Tensor;
use burn::tensor::activation::softplus;

/// Samples squashed actions with the reparameterisation trick from standard normal `noise`, `[batch, ACTION_LEN]`.
/// Returns actions `[batch, ACTION_LEN]` and their log probabilities `[batch, 1]`: eq. (21) of
/// [`losses`](super::losses)' paper, with the tanh correction in numerically stable form.
pub fn sample_squashed(distribution: ActionDistribution, noise: Tensor<2>) -> (Tensor<2>, Tensor<2>) {
    const HALF_LOG_TWO_PI: f32 = 0.918_938_5;
    const LOG_TWO: f32 = std::f32::consts::LN_2;
    let ActionDistribution { mean, log_std } = distribution;
    let raw = mean + log_std.clone().exp() * noise.clone();
    let gaussian = noise.square() * -0.5 - log_std - HALF_LOG_TWO_PI;
    // log(1 - tanh(u)^2) = 2 (log 2 - u - softplus(-2u))
    let correction = (-(raw.clone()) + LOG_TWO - softplus(raw.clone() * -2.0, 1.0)) * 2.0;
    (raw.tanh(), (gaussian - correction).sum_dim(1))
}
