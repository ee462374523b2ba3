//! The trainer: what the replay hands out, exact resumption, and that it learns at all.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::atomic::AtomicBool;
use surefoot_agent::train::collector::CollectorConfig;
use surefoot_agent::train::replay::{Batch, Replay, RowKind, Sampling, Step};
use surefoot_agent::train::run::Run;
use surefoot_agent::train::sac::{Learner, SacConfig};
use surefoot_agent::train::{TrainConfig, TrainError, run};
use surefoot_policy::ActorConfig;
use surefoot_policy::actor::RAY_LEN;
use surefoot_policy::checkpoint::module_bytes;
use surefoot_world::OBSERVATION_LEN;

const DISCOUNT: f32 = 0.5;

/// One lane whose observations carry the step's number in the goal distance.
fn replay(kinds: &[(RowKind, f32)]) -> Replay {
    let mut replay = Replay::new(1, 64);
    for (number, &(kind, reward)) in kinds.iter().enumerate() {
        let mut observation = vec![0.0; OBSERVATION_LEN];
        observation[RAY_LEN] = number as f32;
        replay.push_step(&Step {
            observations: observation,
            actions: vec![[0.5, 0.25, -0.25, 1.0]],
            rewards: vec![reward],
            kinds: vec![kind],
        });
    }
    replay
}

/// (step, return, bootstrap factor, step of the next observation) of many samples.
fn samples(replay: &Replay, n_step: usize) -> Vec<(u32, f32, f32, u32)> {
    let sampling = Sampling { batch: 200, n_step, discount: DISCOUNT, mirror: false };
    let mut batch = Batch::default();
    replay.sample(sampling, &mut ChaCha8Rng::seed_from_u64(0), &mut batch);
    (0..200)
        .map(|idx| {
            let step = |rows: &[f32]| rows[idx * OBSERVATION_LEN + RAY_LEN] as u32;
            (step(&batch.observations), batch.returns[idx], batch.bootstrap[idx], step(&batch.next_observations))
        })
        .collect()
}

#[test]
fn a_terminal_step_has_no_successor_and_a_cut_off_one_keeps_its_value() {
    use RowKind::{Boundary, Continues, Terminated};
    let replay = replay(&[
        (Continues, 1.0),
        (Terminated, 10.0),
        (Continues, 1.0),
        (Continues, 2.0),
        (Boundary, 0.0),
        (Continues, 4.0),
        (Continues, 8.0),
        (Continues, 16.0),
        (Continues, 0.0),
        (Continues, 0.0),
    ]);
    for (step, total, bootstrap, next) in samples(&replay, 2) {
        match step {
            0 => assert_eq!((total, bootstrap), (1.0 + DISCOUNT * 10.0, 0.0), "ends in a terminal state"),
            1 => assert_eq!((total, bootstrap), (10.0, 0.0), "is terminal"),
            2 => assert_eq!(
                (total, bootstrap, next),
                (1.0 + DISCOUNT * 2.0, DISCOUNT * DISCOUNT, 4),
                "two steps to the boundary"
            ),
            3 => assert_eq!((total, bootstrap, next), (2.0, DISCOUNT, 4), "cut off: the last observation still counts"),
            4 => panic!("a boundary row has no action"),
            5 => assert_eq!((total, bootstrap, next), (4.0 + DISCOUNT * 8.0, DISCOUNT * DISCOUNT, 7)),
            6 => assert_eq!((total, next), (8.0 + DISCOUNT * 16.0, 8)),
            7 => assert_eq!((total, next), (16.0, 9)),
            other => panic!("step {other} has no full successor yet"),
        }
    }
}

#[test]
fn packed_observations_come_back_to_within_their_resolution() {
    let mut observation = vec![0.0; OBSERVATION_LEN];
    for (idx, value) in observation.iter_mut().enumerate().take(64) {
        *value = idx as f32 / 64.0;
    }
    // A ray on water, one on a pad, one on a teleporter, and a value of the state.
    observation[64 + 5] = 1.0;
    observation[192 + 9] = 1.0;
    observation[256 + 11] = 0.7;
    observation[RAY_LEN + 10] = -0.75;
    let mut replay = Replay::new(1, 8);
    for _ in 0..4 {
        replay.push_step(&Step {
            observations: observation.clone(),
            actions: vec![[0.0; 4]],
            rewards: vec![0.0],
            kinds: vec![RowKind::Continues],
        });
    }
    let mut batch = Batch::default();
    let sampling = Sampling { batch: 1, n_step: 1, discount: 0.9, mirror: false };
    replay.sample(sampling, &mut ChaCha8Rng::seed_from_u64(0), &mut batch);
    for (packed, original) in batch.observations.iter().zip(&observation) {
        assert!((packed - original).abs() < 2.0e-5);
    }
}

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
        sac: SacConfig { network: ActorConfig { ray_features: 8, hidden: 16 }, ..SacConfig::default() },
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
        policy.act(&rows, 0.0, &mut ChaCha8Rng::seed_from_u64(0), &mut actions);
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
        let mut run = Run::new(TrainConfig { seed, ..tiny() });
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
        policy.act(&vec![0.3; OBSERVATION_LEN], 0.0, &mut ChaCha8Rng::seed_from_u64(0), &mut actions);
        actions[0].to_array().map(f32::to_bits)
    };
    assert_eq!(parameters(&one), parameters(&same));
    assert_ne!(parameters(&one), parameters(&other));
    assert!(!module_bytes(one.actor()).unwrap().is_empty());
}

#[test]
fn the_learner_finds_the_better_action_of_a_bandit() {
    let config = SacConfig {
        network: ActorConfig { ray_features: 8, hidden: 32 },
        learning_rate: 1.0e-3,
        ..SacConfig::default()
    };
    let mut learner = Learner::new(config, ChaCha8Rng::seed_from_u64(1));
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    // Reward is highest where `forward` is -0.3, and every step is terminal.
    for _ in 0..1500 {
        let actions: Vec<f32> = (0..64 * 4).map(|_| rand::RngExt::random_range(&mut rng, -1.0..1.0)).collect();
        let returns = actions.chunks_exact(4).map(|action| 2.0 - 4.0 * (action[0] + 0.3).powi(2)).collect();
        let batch = Batch {
            observations: vec![0.1; 64 * OBSERVATION_LEN],
            next_observations: vec![0.0; 64 * OBSERVATION_LEN],
            bootstrap: vec![0.0; 64],
            actions,
            returns,
        };
        learner.update(&batch);
    }
    let manifest = surefoot_policy::Manifest::new(
        "bandit",
        ActorConfig { ray_features: 8, hidden: 32 },
        &[],
        serde_json::Value::Null,
    );
    let mut actions = Vec::new();
    surefoot_policy::Policy::new(learner.actor(), manifest).act(
        &vec![0.1; OBSERVATION_LEN],
        0.0,
        &mut rng,
        &mut actions,
    );
    assert!((actions[0].forward + 0.3).abs() < 0.15, "{}", actions[0].forward);
}
