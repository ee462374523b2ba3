//! Adam (Kingma & Ba 2015, algorithm 1) in one pass over memory for parameters on the CPU; burn's own on other devices.

use burn::backend::Flex;
use burn::optim::{Adam, AdamConfig, AdamState, AdaptiveMomentumState, LearningRate, ModuleOptimizer, Optimizer};
use burn::tensor::{Device, Tensor, TensorData};

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1.0e-8;

/// Creates an Adam optimizer for a module, with beta 0.9 and 0.999 and epsilon 1e-8.
pub fn adam() -> ModuleOptimizer {
    let config = AdamConfig::new().with_beta_1(BETA_1).with_beta_2(BETA_2).with_epsilon(EPSILON);
    FusedAdam { fallback: config.build() }.into()
}

#[derive(Clone)]
struct FusedAdam {
    fallback: Adam,
}

impl Optimizer for FusedAdam {
    type State<const D: usize> = AdamState<D>;

    fn step<const D: usize>(
        &self,
        lr: LearningRate,
        tensor: Tensor<D>,
        grad: Tensor<D>,
        state: Option<AdamState<D>>,
    ) -> (Tensor<D>, Option<AdamState<D>>) {
        if tensor.clone().try_into_primitive::<Flex>().is_err() {
            return self.fallback.step(lr, tensor, grad, state);
        }
        let (shape, device) = (tensor.dims(), tensor.device());
        let values = |tensor: Tensor<D>| tensor.into_data().try_into_vec::<f32>().expect("f32 tensors");
        let (time, mut mean, mut variance) = match state {
            Some(AdamState { momentum }) => (momentum.time + 1, values(momentum.moment_1), values(momentum.moment_2)),
            None => (1, vec![0.0; shape.iter().product()], vec![0.0; shape.iter().product()]),
        };
        // The bias corrections of both moments are folded into step size and epsilon.
        let correction = (1.0 - BETA_2.powi(time as i32)).sqrt();
        let rate = lr as f32 * correction / (1.0 - BETA_1.powi(time as i32));
        let epsilon = EPSILON * correction;
        let mut parameters = values(tensor);
        let moments = mean.iter_mut().zip(&mut variance);
        for ((parameter, gradient), (mean, variance)) in parameters.iter_mut().zip(values(grad)).zip(moments) {
            *mean = BETA_1 * *mean + (1.0 - BETA_1) * gradient;
            *variance = BETA_2 * *variance + (1.0 - BETA_2) * gradient * gradient;
            *parameter -= rate * *mean / (variance.sqrt() + epsilon);
        }
        let tensor = |values: Vec<f32>| Tensor::<D>::from_data(TensorData::new(values, shape), &device);
        let momentum = AdaptiveMomentumState::new(time, tensor(mean), tensor(variance));
        (tensor(parameters), Some(AdamState { momentum }))
    }

    fn to_device<const D: usize>(state: AdamState<D>, device: &Device) -> AdamState<D> {
        Adam::to_device(state, device)
    }
}

#[cfg(test)]
mod tests {
    use super::{EPSILON, FusedAdam};
    use burn::optim::{AdamConfig, Optimizer};
    use burn::tensor::{Device, Tensor};

    #[test]
    fn one_pass_equals_burns_adam() {
        let reference = AdamConfig::new().with_epsilon(EPSILON).build();
        let fused = FusedAdam { fallback: reference.clone() };
        let device = Device::flex();
        let start = Tensor::<2>::from_floats([[0.5, -1.0], [2.0, 0.0]], &device);
        let (mut ours, mut theirs) = ((start.clone(), None), (start, None));
        for step in 1..20 {
            let gradient = Tensor::<2>::from_floats([[0.1, -2.0], [1.0e-4, 3.0]], &device) * (7 - step) as f32;
            ours = fused.step(0.01, ours.0, gradient.clone(), ours.1);
            theirs = reference.step(0.01, theirs.0, gradient, theirs.1);
        }
        let gap = (ours.0 - theirs.0).abs().max().into_data().try_into_vec::<f32>().expect("f32")[0];
        assert!(gap < 1.0e-5, "{gap}");
    }
}
