//! The losses, against values computed by hand.

use burn::tensor::{Device, Tensor, TensorData};
use surefoot_train::losses::{actor_loss, critic_loss, soft_targets, temperature_loss};

fn column(values: &[f32]) -> Tensor<2> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len(), 1]), &Device::flex())
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().unwrap()
}

fn assert_close(found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1.0e-6, "{found} instead of {expected}");
    }
}

#[test]
fn a_target_is_the_return_and_the_discounted_soft_value_of_the_successor() {
    // Terminated, truncated, and continuing: 1; 0.5 + 0.9 (2 - 0.1 x -3); 0.2 + 0.81 (-1 - 0.1 x 1).
    let targets = soft_targets(
        column(&[1.0, 0.5, 0.2]),
        column(&[0.0, 0.9, 0.81]),
        column(&[7.0, 2.0, -1.0]),
        column(&[5.0, -3.0, 1.0]),
        0.1,
    );
    assert_close(&values(targets), &[1.0, 2.57, -0.691]);
}

#[test]
fn the_critics_loss_is_the_weighted_sum_of_squared_errors() {
    let critics = TensorData::new(vec![1.0f32, 2.0, 0.0, 4.0], [2, 2, 1]);
    let critics = Tensor::<3>::from_data(critics, &Device::flex());
    // 0.25 (1 - 2)^2 + 0.75 (2 - 3)^2 + 0.25 (0 - 2)^2 + 0.75 (4 - 3)^2
    let loss = critic_loss(critics, column(&[2.0, 3.0]), column(&[0.25, 0.75]));
    assert_close(&values(loss), &[2.75]);
}

#[test]
fn the_actor_trades_entropy_for_value() {
    // 0.5 (0.2 x -1 - 3) + 0.5 (0.2 x 2 - 1)
    let loss = actor_loss(column(&[-1.0, 2.0]), column(&[3.0, 1.0]), column(&[0.5, 0.5]), 0.2);
    assert_close(&values(loss), &[-1.9]);
}

#[test]
fn the_temperature_falls_where_there_is_more_entropy_than_wanted() {
    let device = Device::flex().autodiff();
    let log_alpha = Tensor::<1>::from_data([-2.0f32], &device).require_grad();
    // Entropy 3 (log pi -3) where 1 is wanted: loss -(-2) (-3 + 1) = -4, slope 2, so a step lowers log alpha.
    let loss = temperature_loss(log_alpha.clone(), -3.0, 1.0);
    assert_close(&values(loss.clone()), &[-4.0]);
    let gradient = log_alpha.grad(&loss.backward()).unwrap();
    assert_close(&values(gradient), &[2.0]);
}
