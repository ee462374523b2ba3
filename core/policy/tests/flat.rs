//! The actor in flat arrays decides as the policy does, and allocates nothing.

use burn::tensor::Device;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::num::NonZeroUsize;
use surefoot_policy::checkpoint::module_bytes;
use surefoot_policy::config::RAY_LEN;
use surefoot_policy::{Actor, ActorConfig, FlatActor, Manifest, Policy};
use surefoot_world::Action;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::RAY_COUNT;

/// A policy of odd sizes, which fill no vector.
fn odd(memory: usize, sees_others: bool) -> Policy {
    let config = ActorConfig { ray_features: 13, hidden: 21, memory: NonZeroUsize::new(memory), sees_others };
    let actor = Actor::new(&config, &Device::flex(), &mut ChaCha8Rng::seed_from_u64(9));
    let weights = module_bytes(&actor).unwrap();
    Policy::new(&actor, Manifest::new("odd", config, &weights, serde_json::Value::Null))
}

fn shipped(name: &str) -> Policy {
    Policy::shipped_named(name).unwrap().unwrap()
}

/// Observations in which most hazards and devices are zeros.
fn observations(policy: &Policy, rows: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
    let mut values = Vec::new();
    for _ in 0..rows {
        values.extend((0..policy.observation_len()).map(|idx| {
            let is_hazard = (RAY_COUNT..RAY_LEN).contains(&idx);
            if is_hazard && rng.random::<f32>() < 0.95 { 0.0 } else { rng.random_range(-1.0..1.0) }
        }));
    }
    values
}

#[test]
fn it_decides_as_the_policy_does_step_after_step() {
    let policies = [odd(0, false), odd(7, false), odd(5, true), shipped("general-reactive"), shipped("general-lstm")];
    for policy in policies {
        let flat = FlatActor::new(&policy);
        for rows in [1, 2, 3, 5, 17, 64] {
            let mut scratch = flat.scratch(rows);
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let mut ours = vec![0.0; rows * flat.memory_len()];
            let mut theirs = ours.clone();
            let (mut actions, mut expected) = (vec![Action::default(); rows], Vec::new());
            for step in 0..4 {
                let observations = observations(&policy, rows, &mut rng);
                let count = if step == 0 { 0 } else { rows * ACTION_LEN };
                let noise: Vec<f32> = (0..count).map(|_| rng.random_range(-2.0..2.0)).collect();
                flat.act(&observations, &mut ours, &noise, &mut scratch, &mut actions);
                policy.act_with_noise(&observations, &mut theirs, noise, &mut expected);
                let values =
                    |actions: &[Action]| actions.iter().flat_map(|action| action.to_array()).collect::<Vec<_>>();
                close(&values(&actions), &values(&expected));
                close(&ours, &theirs);
            }
        }
    }
}

fn close(ours: &[f32], theirs: &[f32]) {
    assert_eq!(ours.len(), theirs.len());
    let worst = ours.iter().zip(theirs).map(|(one, other)| (one - other).abs()).fold(0.0, f32::max);
    assert!(worst < 1.0e-5, "differs by {worst}");
}

#[test]
fn deciding_allocates_nothing() {
    for policy in [shipped("general-reactive"), shipped("general-lstm")] {
        let flat = FlatActor::new(&policy);
        let mut scratch = flat.scratch(64);
        let observations = observations(&policy, 64, &mut ChaCha8Rng::seed_from_u64(5));
        let mut memory = vec![0.0; 64 * flat.memory_len()];
        let (noise, mut actions) = (vec![0.5; 64 * ACTION_LEN], vec![Action::default(); 64]);
        let counted = allocation_counter::measure(|| {
            flat.act(&observations, &mut memory, &noise, &mut scratch, &mut actions);
        });
        assert_eq!(counted.count_total, 0);
    }
}
