//! The fast layers compared with tensor operations: values and gradients.

use burn::tensor::activation::relu;
use burn::tensor::{Device, Distribution, Tensor};
use surefoot_policy::config::RAY_LEN;
use surefoot_train::networks::cpu::{dense, rays};
use surefoot_world::OBSERVATION_LEN;

const MEMBERS: usize = 2;
const ROWS: usize = 5;
const WIDTH: usize = 6;

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().unwrap()
}

fn assert_close(name: &str, fast: Vec<f32>, slow: Vec<f32>) {
    assert_eq!(fast.len(), slow.len(), "{name}");
    let worst = fast.iter().zip(&slow).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 2.0e-5, "{name} differs by {worst}");
    assert!(slow.iter().any(|value| value.abs() > 1.0e-4), "{name} is not all zeros");
}

fn draw(shape: [usize; 3], device: &Device) -> Tensor<3> {
    Tensor::random(shape, Distribution::Uniform(-1.0, 1.0), device)
}

/// Observations in which most hazard and device values are zero.
fn observations(device: &Device) -> Tensor<2> {
    let values: Vec<f32> = (0..ROWS * OBSERVATION_LEN)
        .map(|idx| {
            let (column, noise) = (idx % OBSERVATION_LEN, (idx * 37 % 101) as f32 / 101.0);
            if (64..RAY_LEN).contains(&column) && !(idx * 13).is_multiple_of(17) { 0.0 } else { noise }
        })
        .collect();
    Tensor::<1>::from_floats(values.as_slice(), device).reshape([ROWS, OBSERVATION_LEN])
}

#[test]
fn dense_layers_equal_their_tensor_operations() {
    let (plain, device) = (Device::flex(), Device::flex().autodiff());
    plain.seed(3);
    for (members, cut) in [(1, true), (MEMBERS, true), (MEMBERS, false)] {
        let input = draw([members, ROWS, 9], &plain);
        let (weight, bias) = (draw([MEMBERS, 9, WIDTH], &plain), draw([MEMBERS, 1, WIDTH], &plain));
        let seen = draw([MEMBERS, ROWS, WIDTH], &plain);
        let slow = |input: &Tensor<3>, weight: &Tensor<3>, bias: &Tensor<3>| {
            let output = input.clone().matmul(weight.clone()) + bias.clone();
            if cut { relu(output) } else { output }
        };
        let fast = |input: &Tensor<3>, weight: &Tensor<3>, bias: &Tensor<3>| {
            dense::layer(input, weight, bias, cut).expect("tensors on the CPU")
        };
        assert_close("output", values(fast(&input, &weight, &bias)), values(slow(&input, &weight, &bias)));
        let gradients = |run: &dyn Fn(&Tensor<3>, &Tensor<3>, &Tensor<3>) -> Tensor<3>| {
            let track = |tensor: &Tensor<3>| Tensor::<3>::from_data(tensor.to_data(), &device).require_grad();
            let inputs = [track(&input), track(&weight), track(&bias)];
            let output = run(&inputs[0], &inputs[1], &inputs[2]);
            let mut gradients = (output * seen.clone().autodiff()).sum().backward();
            inputs.map(|tensor| values(tensor.grad_remove(&mut gradients).expect("a gradient")))
        };
        for ((name, fast), slow) in ["input", "weight", "bias"].iter().zip(gradients(&fast)).zip(gradients(&slow)) {
            assert_close(name, fast, slow);
        }
    }
}

#[test]
fn the_ray_encoder_equals_its_tensor_operations() {
    let (plain, device) = (Device::flex(), Device::flex().autodiff());
    plain.seed(4);
    let (weight, bias) = (draw([MEMBERS, RAY_LEN, WIDTH], &plain), draw([MEMBERS, 1, WIDTH], &plain));
    let seen = draw([MEMBERS, ROWS, WIDTH], &plain);
    let slow = |observations: &Tensor<2>, weight: &Tensor<3>, bias: &Tensor<3>| {
        let rays = observations.clone().narrow(1, 0, RAY_LEN).unsqueeze::<3>();
        relu(rays.matmul(weight.clone()) + bias.clone())
    };
    let fast = |observations: &Tensor<2>, weight: &Tensor<3>, bias: &Tensor<3>| {
        rays::layer(observations, weight, bias).expect("tensors on the CPU")
    };
    let rows = observations(&plain);
    assert_close("output", values(fast(&rows, &weight, &bias)), values(slow(&rows, &weight, &bias)));
    let gradients = |run: &dyn Fn(&Tensor<2>, &Tensor<3>, &Tensor<3>) -> Tensor<3>| {
        let track = |tensor: &Tensor<3>| Tensor::<3>::from_data(tensor.to_data(), &device).require_grad();
        let inputs = [track(&weight), track(&bias)];
        let output = run(&observations(&device), &inputs[0], &inputs[1]);
        let mut gradients = (output * seen.clone().autodiff()).sum().backward();
        inputs.map(|tensor| values(tensor.grad_remove(&mut gradients).expect("a gradient")))
    };
    for ((name, fast), slow) in ["weight", "bias"].iter().zip(gradients(&fast)).zip(gradients(&slow)) {
        assert_close(name, fast, slow);
    }
}
