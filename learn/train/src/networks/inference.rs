//! Inference by burn, in place of the CPU form of the same network.

use super::actor::{ActionDistribution, ActorNetwork};
use super::record::load_module;
use super::state::HiddenState;
use super::trunk::Past;
use crate::config::Processor;
use crate::error::TrainError;
use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_policy::{Actor, Batch, Policy, Scratch};
use surefoot_world::Action;
use surefoot_world::character::ACTION_LEN;

/// The network of a policy in burn.
#[derive(Debug)]
struct BurnActor {
    network: ActorNetwork,
    device: Device,
}

/// The same policy, whose network is evaluated by burn. The last bits of its actions depend on the batch.
///
/// # Errors
/// If the weights do not fit the network, or this program was built without support for the processor.
pub fn with_burn(policy: Policy, processor: Processor) -> Result<Policy, TrainError> {
    let device = processor.device()?;
    let network = ActorNetwork::new(&policy.manifest().actor, &device, &mut ChaCha8Rng::seed_from_u64(0));
    let network = load_module(network, policy.weights())?;
    Ok(policy.with_actor(Arc::new(BurnActor { network, device })))
}

impl Actor for BurnActor {
    fn act(&self, batch: Batch<'_>, _: &mut Scratch, actions: &mut [Action]) {
        let rows = actions.len();
        if rows == 0 {
            return;
        }
        let tensor = |values: &[f32]| {
            Tensor::<2>::from_data(TensorData::new(values.to_vec(), [rows, values.len() / rows]), &self.device)
        };
        let ActionDistribution { mean, log_std } = self.distribution(tensor(batch.observations), batch.memory);
        let raw = if batch.noise.is_empty() { mean } else { mean + log_std.exp() * tensor(batch.noise) };
        let data = raw.tanh().into_data();
        let values = data.as_slice::<f32>().expect("f32 tensors").as_chunks::<ACTION_LEN>().0;
        for (action, values) in actions.iter_mut().zip(values) {
            *action = Action::from_array(*values).unwrap_or_default();
        }
    }
}

impl BurnActor {
    /// The distribution of each row's action; overwrites `memory`.
    fn distribution(&self, observations: Tensor<2>, memory: &mut [f32]) -> ActionDistribution {
        let [row_count, _] = observations.dims();
        let Some(size) = self.network.memory_size() else { return self.network.forward(observations, None).0 };
        let state = HiddenState::from_rows(memory, size, &self.device);
        let keep = vec![1.0; row_count];
        let (distribution, next) = self.network.forward(observations, Some(Past { state: &state, keep: &keep }));
        next.expect("an actor with a memory returns a state").write_rows(memory);
        distribution
    }
}
