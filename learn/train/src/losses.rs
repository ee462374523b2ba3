//! The losses of soft actor-critic, as pure functions of the networks' outputs.
//!
//! Equation numbers are those of Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications" (arXiv
//! 1812.05905). docs/guides/training.md lists where we differ from it, and why. `rows` are the rows of a batch.
//! Each has a weight, its share in the mean; the weights of a batch add up to 1.

use super::networks::ActionDistribution;
use burn::tensor::Tensor;
use burn::tensor::activation::softplus;

/// Targets of the critics, eq. (3) within (6): `returns + bootstrap (min Q(s', a') - alpha log pi(a'|s'))`, all `[rows,
/// 1]`.
///
/// `bootstrap` is the discount up to the successor: 0 if the episode terminated, but not if it was truncated.
pub fn soft_targets(
    returns: Tensor<2>,
    bootstrap: Tensor<2>,
    next_value: Tensor<2>,
    next_log_prob: Tensor<2>,
    alpha: f32,
) -> Tensor<2> {
    returns + bootstrap * (next_value - next_log_prob * alpha)
}

/// Loss of the critics, eq. (5) without its factor 1/2: squared Bellman errors, summed over the critics.
///
/// `values` are `[critics, rows, 1]`, `targets` and `weights` `[rows, 1]`; the result is `[1]`.
pub fn critic_loss(values: Tensor<3>, targets: Tensor<2>, weights: Tensor<2>) -> Tensor<1> {
    let errors = (values - targets.unsqueeze::<3>()).square();
    (errors * weights.unsqueeze::<3>()).sum()
}

/// Loss of the actor, eq. (9): the mean of `alpha log pi - Q`. Gradients pass through the critics' values but not to
/// their weights.
///
/// `log_prob`, `value` and `weights` are `[rows, 1]`; the result is `[1]`.
pub fn actor_loss(log_prob: Tensor<2>, value: Tensor<2>, weights: Tensor<2>, alpha: f32) -> Tensor<1> {
    ((log_prob * alpha - value) * weights).sum()
}

/// Loss of the temperature, eq. (18) in its usual form on `log alpha`: `-log alpha (mean log pi + target entropy)`,
/// `[1]`.
///
/// The policy gets no gradient, because `mean_log_prob` is a number.
pub fn temperature_loss(log_alpha: Tensor<1>, mean_log_prob: f32, target_entropy: f32) -> Tensor<1> {
    (log_alpha * -(mean_log_prob + target_entropy)).sum()
}

/// Samples squashed actions with the reparameterisation trick from standard normal `noise`, `[batch, ACTION_LEN]`.
/// Returns actions `[batch, ACTION_LEN]` and their log probabilities `[batch, 1]`: eq. (21), with the tanh correction
/// in numerically stable form.
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
