//! What a policy decides does not depend on the batch, and deciding allocates nothing.

use crate::{act, model, observations};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::num::NonZeroUsize;
use surefoot_policy::{ActorConfig, Batch, Policy, noise};
use surefoot_world::character::ACTION_LEN;

fn shipped() -> [Policy; 2] {
    ["general-reactive", "general-lstm"].map(|name| Policy::shipped_named(name).unwrap().unwrap())
}

#[test]
fn a_row_gets_the_same_bits_alone_and_in_any_batch() {
    // Of odd sizes, which fill no vector.
    let config = ActorConfig { ray_features: 13, hidden: 21, memory: NonZeroUsize::new(5), sees_others: true };
    let (manifest, weights) = model(config);
    let odd = Policy::from_bytes(manifest, &weights).unwrap();
    for policy in shipped().into_iter().chain([odd]) {
        let all = observations(&policy, 203);
        let alone: Vec<_> = all.chunks_exact(policy.observation_len()).map(|row| act(&policy, row, &[])[0]).collect();
        for rows in [2, 3, 7, 64, 97, 203] {
            assert_eq!(act(&policy, &all[..rows * policy.observation_len()], &[]), alone[..rows], "{rows} rows");
        }
    }
    assert!(act(&shipped()[0], &[], &[]).is_empty());
}

#[test]
fn noise_is_a_function_of_its_seed() {
    let [policy, _] = shipped();
    let noisy = |seed| {
        let noise = noise::for_rows(&mut ChaCha8Rng::seed_from_u64(seed), 1.0, 4);
        act(&policy, &observations(&policy, 4), &noise)
    };
    assert_eq!(noisy(1), noisy(1));
    assert_ne!(noisy(1), noisy(2));
}

#[test]
fn deciding_allocates_nothing() {
    for policy in shipped() {
        let mut scratch = policy.scratch(64);
        let observations = observations(&policy, 64);
        let mut memory = vec![0.0; 64 * policy.memory_len()];
        let (noise, mut actions) = (vec![0.5; 64 * ACTION_LEN], Vec::with_capacity(64));
        let counted = allocation_counter::measure(|| {
            let batch = Batch { observations: &observations, memory: &mut memory, noise: &noise };
            policy.act(batch, &mut scratch, &mut actions);
        });
        assert_eq!(counted.count_total, 0);
    }
}
