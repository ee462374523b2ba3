//! The trainer: what the replay hands out, exact resumption, and that it learns at all.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::atomic::AtomicBool;
use surefoot_agent::train::collector::CollectorConfig;
use surefoot_agent::train::run::Run;
use surefoot_agent::train::sac::SacConfig;
use surefoot_agent::train::{TrainConfig, TrainError, run};
use surefoot_policy::ActorConfig;
use surefoot_policy::checkpoint::module_bytes;
use surefoot_world::OBSERVATION_LEN;

fn tiny() -> TrainConfig {
    TrainConfig {
        total_updates: 12,
        steps_per_round: 4,
        updates_per_round: 2,
        batch: 16,
        replay_capacity: 4000,
        validate_every: 1000,
        checkpoint_every: 1000,
        validation_goals: 1,
        validation_seeds: vec![1000],
        sac: SacConfig { network: ActorConfig { ray_features: 8, hidden: 16, memory: 0 }, ..SacConfig::default() },
        collector: CollectorConfig {
            map_side: 60,
            world_count: 2,
            npcs_per_world: 4,
            rounds_per_map: 9,
            near_goals: (2.0, 20.0),
            far_goals: (20.0, 30.0),
            give_up_after: 6,
            random_decisions: 200,
            ..CollectorConfig::default()
        },
        ..TrainConfig::default()
    }
}

#[test]
fn a_resumed_run_continues_bit_for_bit() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let stop = AtomicBool::new(false);
    let weights = |folder: &tempfile::TempDir| std::fs::read(folder.path().join("last/weights.bpk")).unwrap();
    run(TrainConfig { total_updates: 24, ..tiny() }, folders[0].path(), false, &stop, |_| {}).unwrap();

    // The same run, stopped half-way and resumed from its files.
    run(tiny(), folders[1].path(), false, &stop, |_| {}).unwrap();
    let config = folders[1].path().join("config.json");
    let text = std::fs::read_to_string(&config).unwrap().replace("\"total_updates\": 12", "\"total_updates\": 24");
    std::fs::write(&config, text).unwrap();
    run(tiny(), folders[1].path(), true, &stop, |_| {}).unwrap();

    let actor = |folder: &tempfile::TempDir| {
        let policy = surefoot_policy::Policy::load(&folder.path().join("last")).unwrap();
        let mut actions = Vec::new();
        let rows: Vec<f32> = (0..8 * OBSERVATION_LEN).map(|idx| (idx % 17) as f32 / 17.0).collect();
        policy.act(&rows, &mut [], 0.0, &mut ChaCha8Rng::seed_from_u64(0), &mut actions);
        actions.iter().flat_map(|action| action.to_array().map(f32::to_bits)).collect::<Vec<u32>>()
    };
    assert_eq!(actor(&folders[0]), actor(&folders[1]));
    assert_eq!(weights(&folders[0]).len(), weights(&folders[1]).len());
}

#[test]
fn a_run_is_not_overwritten_and_damaged_state_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(true);
    run(tiny(), folder.path(), false, &stop, |_| {}).unwrap();
    assert!(matches!(run(tiny(), folder.path(), false, &stop, |_| {}), Err(TrainError::Exists(_))));
    let state = folder.path().join("state.bin");
    let mut bytes = std::fs::read(&state).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&state, &bytes).unwrap();
    assert!(matches!(run(tiny(), folder.path(), true, &stop, |_| {}), Err(TrainError::Damaged { .. })));
    let events = std::fs::read_dir(folder.path().join("tensorboard")).unwrap().count();
    assert!(events >= 1, "an event file was written");
}

#[test]
fn equal_seeds_train_equal_networks() {
    let train = |seed| {
        let mut run = Run::new(TrainConfig { seed, ..tiny() }).unwrap();
        for _ in 0..100 {
            run.round();
        }
        assert!(run.updates() > 0);
        run
    };
    let (one, same, other) = (train(1), train(1), train(2));
    let parameters = |run: &Run| {
        let policy = surefoot_policy::Policy::new(
            run.actor(),
            surefoot_policy::Manifest::new("t", tiny().sac.network, &[], serde_json::Value::Null),
        );
        let mut actions = Vec::new();
        policy.act(&vec![0.3; OBSERVATION_LEN], &mut [], 0.0, &mut ChaCha8Rng::seed_from_u64(0), &mut actions);
        actions[0].to_array().map(f32::to_bits)
    };
    assert_eq!(parameters(&one), parameters(&same));
    assert_ne!(parameters(&one), parameters(&other));
    assert!(!module_bytes(one.actor()).unwrap().is_empty());
}
