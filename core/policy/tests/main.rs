//! Policies: their files, and what they decide.

mod checkpoints;
mod decisions;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use surefoot_policy::{ActorConfig, Batch, Manifest, Parameter, Policy, Scratch, Weights};

/// The manifest and the weights file of a model with random parameters.
fn model(config: ActorConfig) -> (Manifest, Vec<u8>) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let parameters = config.parameter_shapes().into_iter().map(|(name, shape)| {
        let values = (0..shape.iter().product()).map(|_| rng.random_range(-0.3..0.3)).collect();
        (name, Parameter { shape, values })
    });
    let weights = Weights::new(&config, parameters.collect()).unwrap().to_burnpack();
    (Manifest::new("test", config, &weights, serde_json::Value::Null), weights)
}

fn observations(policy: &Policy, rows: usize) -> Vec<f32> {
    (0..rows * policy.observation_len()).map(|idx| ((idx * 37 % 101) as f32) / 101.0 - 0.5).collect()
}

/// The actions of rows, which remember nothing before.
fn act(policy: &Policy, observations: &[f32], noise: &[f32]) -> Vec<[f32; 4]> {
    let mut memory = vec![0.0; observations.len() / policy.observation_len() * policy.memory_len()];
    let mut actions = Vec::new();
    policy.act(Batch { observations, memory: &mut memory, noise }, &mut Scratch::default(), &mut actions);
    actions.iter().map(|action| action.to_array()).collect()
}
