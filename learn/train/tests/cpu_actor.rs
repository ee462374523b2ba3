//! Inference without burn decides as burn's network does, on every shipped model.

use burn::tensor::Device;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::num::NonZeroUsize;
use std::path::Path;
use surefoot_policy::config::RAY_LEN;
use surefoot_policy::{ActorConfig, Batch, Manifest, Policy, Scratch};
use surefoot_train::networks::{module_bytes, with_burn};
use surefoot_train::{Learner, Processor, SacConfig};
use surefoot_world::Action;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{OTHERS_LEN, RAY_COUNT};

/// A learner with networks of odd sizes, which fill no vector.
fn odd(memory: usize, sees_others: bool) -> Learner {
    let network = ActorConfig { ray_features: 13, hidden: 21, memory: NonZeroUsize::new(memory), sees_others };
    Learner::new(SacConfig { network, ..SacConfig::default() }, ChaCha8Rng::seed_from_u64(9))
}

/// All models in the repository.
fn shipped() -> Vec<Policy> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let models = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let models: Vec<_> = models.filter(|path| path.join("weights.bpk").exists()).collect();
    assert!(models.len() >= 7, "{models:?}");
    models.iter().map(|path| Policy::load(path).unwrap()).collect()
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
fn it_decides_as_burn_does_step_after_step() {
    for policy in [odd(0, false), odd(7, false), odd(5, true)].map(|odd| odd.policy("odd")).into_iter().chain(shipped())
    {
        let burn = with_burn(policy.clone(), Processor::Cpu).unwrap();
        for rows in [1, 2, 3, 5, 17, 64, 200] {
            let mut scratch = Scratch::default();
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let mut ours = vec![0.0; rows * policy.memory_len()];
            let mut theirs = ours.clone();
            let (mut actions, mut expected) = (Vec::new(), Vec::new());
            for step in 0..4 {
                let observations = observations(&policy, rows, &mut rng);
                let count = if step == 0 { 0 } else { rows * ACTION_LEN };
                let noise: Vec<f32> = (0..count).map(|_| rng.random_range(-2.0..2.0)).collect();
                let batch = |memory| Batch { observations: &observations, memory, noise: &noise };
                policy.act(batch(&mut ours), &mut scratch, &mut actions);
                burn.act(batch(&mut theirs), &mut scratch, &mut expected);
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
fn sight_of_others_and_a_memory_grown_onto_an_actor_change_nothing_at_first() {
    const ROWS: usize = 6;
    let small = odd(0, false);
    let reactive = small.policy("reactive");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let own = reactive.manifest().actor;
    let config = ActorConfig { memory: NonZeroUsize::new(7), sees_others: true, ..own };
    let grown = module_bytes(&small.actor().clone().grown(&own, &config, &Device::flex(), &mut rng)).unwrap();
    let grown = Policy::from_bytes(Manifest::new("grown", config, &grown, serde_json::Value::Null), &grown).unwrap();
    let mut memory = vec![0.0; ROWS * grown.memory_len()];
    let (mut scratch, mut before, mut after) = (Scratch::default(), Vec::new(), Vec::new());
    for _ in 0..3 {
        let observations = observations(&reactive, ROWS, &mut rng);
        let with_others =
            observations.chunks_exact(OBSERVATION_LEN).flat_map(|row| row.iter().chain(&[0.5; OTHERS_LEN]));
        let with_others: Vec<f32> = with_others.copied().collect();
        let batch = Batch { observations: &observations, memory: &mut [], noise: &[] };
        reactive.act(batch, &mut scratch, &mut before);
        let batch = Batch { observations: &with_others, memory: &mut memory, noise: &[] };
        grown.act(batch, &mut scratch, &mut after);
        let values = |actions: &[Action]| actions.iter().flat_map(|action| action.to_array()).collect::<Vec<_>>();
        close(&values(&before), &values(&after));
    }
    assert!(memory.iter().any(|value| *value != 0.0), "its memory is in use nevertheless");
}
