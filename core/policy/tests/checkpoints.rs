//! Weights on disk: whole, damaged, and of another shape.

use burn::tensor::Device;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::path::Path;
use surefoot_policy::checkpoint::{self, MANIFEST_FILE, WEIGHTS_FILE, module_bytes};
use surefoot_policy::{Actor, ActorConfig, CheckpointError, Manifest, Policy};
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::sense::OBSERVATION_VERSION;

fn save(folder: &Path) -> Policy {
    let config = ActorConfig { ray_features: 16, hidden: 32, memory: None, sees_others: false };
    let actor = Actor::new(&config, &Device::flex(), &mut ChaCha8Rng::seed_from_u64(3));
    let weights = module_bytes(&actor).unwrap();
    let manifest = Manifest::new("test", config, &weights, serde_json::Value::Null);
    checkpoint::save(folder, &manifest, &weights).unwrap();
    Policy::new(&actor, manifest)
}

fn observations(rows: usize) -> Vec<f32> {
    (0..rows * OBSERVATION_LEN).map(|idx| ((idx * 37 % 101) as f32) / 101.0 - 0.5).collect()
}

fn act(policy: &Policy, observations: &[f32]) -> Vec<[f32; 4]> {
    let mut actions = Vec::new();
    policy.act(observations, &mut [], 0.0, &mut ChaCha8Rng::seed_from_u64(0), &mut actions);
    actions.iter().map(|action| action.to_array()).collect()
}

#[test]
fn saved_weights_decide_as_before() {
    let folder = tempfile::tempdir().unwrap();
    let saved = save(folder.path());
    let loaded = Policy::load(folder.path()).unwrap();
    assert_eq!(act(&saved, &observations(5)), act(&loaded, &observations(5)));
    assert_eq!(loaded.manifest().name, "test");
}

#[test]
fn an_observation_gets_the_same_action_alone_and_in_a_batch() {
    let policy = Policy::shipped().unwrap();
    let all = observations(64);
    let together = act(&policy, &all);
    for (row, expected) in all.chunks_exact(OBSERVATION_LEN).zip(&together) {
        for (alone, batched) in act(&policy, row)[0].iter().zip(expected) {
            assert!((alone - batched).abs() < 1.0e-4);
        }
    }
    assert!(act(&policy, &[]).is_empty());
}

#[test]
fn noise_is_a_function_of_its_seed() {
    let policy = Policy::shipped().unwrap();
    let noisy = |seed| {
        let mut actions = Vec::new();
        policy.act(&observations(4), &mut [], 1.0, &mut ChaCha8Rng::seed_from_u64(seed), &mut actions);
        actions
    };
    assert_eq!(noisy(1), noisy(1));
    assert_ne!(noisy(1), noisy(2));
}

#[test]
fn damaged_missing_and_foreign_weights_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path());
    let (weights, manifest) = (folder.path().join(WEIGHTS_FILE), folder.path().join(MANIFEST_FILE));
    let (good_weights, good_manifest) = (std::fs::read(&weights).unwrap(), std::fs::read_to_string(&manifest).unwrap());

    std::fs::write(&weights, &good_weights[..good_weights.len() / 2]).unwrap();
    assert!(matches!(Policy::load(folder.path()), Err(CheckpointError::Damaged { .. })));
    std::fs::write(&weights, &good_weights).unwrap();

    let version = format!("\"observation_version\": {OBSERVATION_VERSION}");
    assert!(good_manifest.contains(&version));
    std::fs::write(&manifest, good_manifest.replace(&version, "\"observation_version\": 99")).unwrap();
    let refusal = Policy::load(folder.path()).unwrap_err().to_string();
    assert!(refusal.contains("observation_version is 99"), "{refusal}");

    std::fs::write(&manifest, good_manifest.replace("\"hidden\": 32", "\"hidden\": 64")).unwrap();
    assert!(matches!(Policy::load(folder.path()), Err(CheckpointError::Decode(_))));

    std::fs::write(&manifest, "{").unwrap();
    assert!(matches!(Policy::load(folder.path()), Err(CheckpointError::Manifest { .. })));

    std::fs::remove_file(&manifest).unwrap();
    let refusal = Policy::load(folder.path()).unwrap_err().to_string();
    assert!(refusal.contains("manifest.json"), "{refusal}");
}

#[test]
fn a_manifest_cannot_request_more_memory_than_its_weights_fill() {
    let config = ActorConfig { ray_features: 2, hidden: 3, memory: None, sees_others: false };
    let actor = Actor::new(&config, &Device::flex(), &mut ChaCha8Rng::seed_from_u64(3));
    let weights = module_bytes(&actor).unwrap();
    let refusal = |actor| {
        let manifest = Manifest::new("greedy", actor, &weights, serde_json::Value::Null);
        Policy::from_bytes(manifest, &weights).unwrap_err().to_string()
    };
    let sound = Manifest::new("sound", config, &weights, serde_json::Value::Null);
    assert!(Policy::from_bytes(sound, &weights).is_ok());
    // Each of these once allocated its memory, or crashed the program, before the weights were checked.
    for actor in [
        ActorConfig { hidden: 1 << 40, ..config },
        ActorConfig { ray_features: usize::MAX, ..config },
        ActorConfig { memory: std::num::NonZeroUsize::new(1 << 20), ..config },
        ActorConfig { hidden: 0, ..config },
        ActorConfig { ray_features: 0, ..config },
    ] {
        let message = refusal(actor);
        assert!(message.contains("sizes that are not allowed"), "{message}");
    }
    let message = refusal(ActorConfig {
        ray_features: 4096,
        hidden: 4096,
        memory: std::num::NonZeroUsize::new(4096),
        sees_others: false,
    });
    assert!(message.contains("bytes of weights"), "{message}");
}
