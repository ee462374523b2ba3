//! The trainer: exact resumption, configuration errors, early stopping and determinism.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::atomic::AtomicBool;
use surefoot_policy::{ActorConfig, Batch, Manifest, Policy, Scratch};
use surefoot_train::CollectorConfig;
use surefoot_train::SacConfig;
use surefoot_train::{Processor, Run, RunArgs, TrainConfig, TrainError, run};

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
        sac: SacConfig {
            network: ActorConfig { ray_features: 8, hidden: 16, memory: None, sees_others: false },
            ..SacConfig::default()
        },
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

fn tiny_recurrent() -> TrainConfig {
    let network =
        ActorConfig { ray_features: 8, hidden: 16, memory: std::num::NonZeroUsize::new(6), sees_others: false };
    TrainConfig { burn_in: 3, learn: 5, batch: 4, sac: SacConfig { network, ..SacConfig::default() }, ..tiny() }
}

/// A recurrent agent that sees others, who get in its way.
fn tiny_social() -> TrainConfig {
    let recurrent = tiny_recurrent();
    let network = ActorConfig { sees_others: true, ..recurrent.sac.network };
    let collector = CollectorConfig { solid_npcs: true, npcs_per_world: 16, ..recurrent.collector };
    TrainConfig { sac: SacConfig { network, ..SacConfig::default() }, collector, ..recurrent }
}

/// The bits of actions of the weights in a run's `last`.
fn decisions(folder: &tempfile::TempDir) -> Vec<u32> {
    let policy = Policy::load(&folder.path().join("last")).unwrap();
    let value = |idx: usize| (idx % policy.observation_len() % 17) as f32 / 17.0;
    let rows: Vec<f32> = (0..8 * policy.observation_len()).map(value).collect();
    let (mut memory, mut actions) = (vec![0.5; 8 * policy.memory_len()], Vec::new());
    let batch = Batch { observations: &rows, memory: &mut memory, noise: &[] };
    policy.act(batch, &mut Scratch::default(), &mut actions);
    actions.iter().flat_map(|action| action.to_array().map(f32::to_bits)).collect()
}

#[test]
fn a_resumed_run_continues_bit_for_bit() {
    for config in [tiny(), tiny_recurrent(), tiny_social()] {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let stop = AtomicBool::new(false);
        run(
            TrainConfig { total_updates: 24, ..config.clone() },
            RunArgs::here(folders[0].path(), false),
            &stop,
            |_| {},
        )
        .unwrap();

        // The same run, stopped half-way and resumed from its files.
        run(config, RunArgs::here(folders[1].path(), false), &stop, |_| {}).unwrap();
        let path = folders[1].path().join("config.json");
        let text = std::fs::read_to_string(&path).unwrap().replace("\"total_updates\": 12", "\"total_updates\": 24");
        std::fs::write(&path, text).unwrap();
        run(tiny(), RunArgs::here(folders[1].path(), true), &stop, |_| {}).unwrap();
        assert_eq!(decisions(&folders[0]), decisions(&folders[1]));
    }
}

#[test]
fn a_recurrent_run_may_start_from_a_reactive_one() {
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let stop = AtomicBool::new(false);
    run(tiny(), RunArgs::here(first.path(), false), &stop, |_| {}).unwrap();
    let start_from = Some(first.path().join("last"));
    let config = TrainConfig { start_from, total_updates: 0, ..tiny_recurrent() };
    run(config.clone(), RunArgs::here(second.path(), false), &stop, |_| {}).unwrap();
    for (before, after) in decisions(&first).into_iter().zip(decisions(&second)) {
        assert!((f32::from_bits(before) - f32::from_bits(after)).abs() < 1.0e-4, "the LSTM has no influence yet");
    }

    let network = ActorConfig { hidden: 24, ..config.sac.network };
    let wider = TrainConfig { sac: SacConfig { network, ..config.sac.clone() }, ..config };
    let refusal = Run::new(wider).err().expect("other shapes are an error").to_string();
    assert!(refusal.contains("16") && refusal.contains("24"), "{refusal}");
}

#[test]
fn a_run_that_starts_from_weights_copies_their_stages() {
    let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let stop = AtomicBool::new(false);
    let last = |idx: usize| folders[idx].path().join("last");
    let manifest = |idx: usize| Manifest::load(&last(idx)).unwrap();
    run(tiny(), RunArgs::here(folders[0].path(), false), &stop, |_| {}).unwrap();
    let from_first = TrainConfig { start_from: Some(last(0)), ..tiny() };
    let run_args = RunArgs { revision: Some("abc".to_owned()), ..RunArgs::here(folders[1].path(), false) };
    run(from_first, run_args, &stop, |_| {}).unwrap();
    let second = manifest(1);
    let from_second = TrainConfig { start_from: Some(last(1)), ..tiny() };
    run(from_second, RunArgs::here(folders[2].path(), false), &stop, |_| {}).unwrap();
    // What the run started from may be gone when it is continued.
    std::fs::remove_dir_all(last(1)).unwrap();
    run(tiny(), RunArgs::here(folders[2].path(), true), &stop, |_| {}).unwrap();

    let training = manifest(2).training;
    assert!(training["config"].get("start_from").is_none());
    assert_eq!((&training["revision"], training["revision_unknown"].is_string()), (&serde_json::Value::Null, true));
    let start = &training["started_from"];
    assert_eq!((&start["weights_hash"], &start["revision"]), (&second.weights_hash.into(), &"abc".into()));
    assert_eq!(start["started_from"]["weights_hash"], manifest(0).weights_hash);
    assert_eq!((&start["updates"], &training["total"]["updates"]), (&12.into(), &36.into()));
    let decisions = |stage: &serde_json::Value| stage["decisions"].as_u64().unwrap();
    let sum = decisions(&training) + decisions(start) + decisions(&start["started_from"]);
    assert_eq!(training["total"]["decisions"], sum);
}

#[test]
fn a_run_does_not_start_from_its_own_folder() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    run(tiny(), RunArgs::here(folder.path(), false), &stop, |_| {}).unwrap();
    let model = folder.path().join("last");
    for start in [model.clone(), folder.path().join("last/../last")] {
        let config = TrainConfig { start_from: Some(start), ..tiny() };
        let refusal = run(config, RunArgs::here(&model, false), &stop, |_| {}).unwrap_err().to_string();
        assert!(refusal.contains("start_from") && refusal.contains("own folder"), "{refusal}");
    }
}

#[test]
fn configurations_that_contradict_themselves_are_refused() {
    let refusal = |config: TrainConfig| Run::new(config).err().expect("a contradiction").to_string();
    let sequences = refusal(TrainConfig { burn_in: 20, learn: 20, ..tiny() });
    assert!(sequences.contains("burn_in and learn"), "{sequences}");
    let single = refusal(TrainConfig { learn: 1, ..tiny_recurrent() });
    assert!(single.contains("learn") && single.contains("memory above 0"), "{single}");
    let empty = refusal(TrainConfig { batch: 0, ..tiny() });
    assert!(empty.contains("batch: must be at least 1"), "{empty}");
    let nowhere = CollectorConfig { map_seeds: Vec::new(), ..tiny().collector };
    assert!(refusal(TrainConfig { collector: nowhere, ..tiny() }).contains("map_seeds: is empty"));
    let cuda = refusal(TrainConfig { processor: Processor::Cuda, ..tiny() });
    assert!(cfg!(feature = "cuda") || cuda.contains("--features cuda"), "{cuda}");
}

#[test]
fn a_run_ends_early_when_validation_no_longer_improves() {
    let folder = tempfile::tempdir().unwrap();
    let config =
        TrainConfig { total_updates: 10_000, stop_after: std::num::NonZeroU64::new(30), validate_every: 1, ..tiny() };
    let mut last = String::new();
    run(config, RunArgs::here(folder.path(), false), &AtomicBool::new(false), |line| last = line.to_owned()).unwrap();
    let updates: u64 = last.split_whitespace().nth(3).unwrap().parse().unwrap();
    assert!((30..10_000).contains(&updates), "{last}");
}

#[test]
fn a_run_is_not_overwritten_and_damaged_state_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(true);
    run(tiny(), RunArgs::here(folder.path(), false), &stop, |_| {}).unwrap();
    assert!(matches!(run(tiny(), RunArgs::here(folder.path(), false), &stop, |_| {}), Err(TrainError::Exists(_))));
    let state = folder.path().join("state.bin");
    let mut bytes = std::fs::read(&state).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&state, &bytes).unwrap();
    assert!(matches!(run(tiny(), RunArgs::here(folder.path(), true), &stop, |_| {}), Err(TrainError::Damaged { .. })));
    let events = std::fs::read_dir(folder.path().join("tensorboard")).unwrap().count();
    assert!(events >= 1, "an event file was written");
}

#[test]
fn equal_seeds_train_equal_networks() {
    let train = |seed| {
        let mut run = Run::new(TrainConfig { seed, ..tiny() }).unwrap();
        for _ in 0..100 {
            run.round().unwrap();
        }
        assert!(run.updates() > 0);
        run
    };
    let (one, same, other) = (train(1), train(1), train(2));
    let parameters = |run: &Run| {
        let (policy, mut actions) = (run.policy(), Vec::new());
        let observations = vec![0.3; policy.observation_len()];
        let batch = Batch { observations: &observations, memory: &mut [], noise: &[] };
        policy.act(batch, &mut Scratch::default(), &mut actions);
        actions[0].to_array().map(f32::to_bits)
    };
    assert_eq!(parameters(&one), parameters(&same));
    assert_ne!(parameters(&one), parameters(&other));
}

#[test]
fn a_state_that_was_made_up_is_refused_or_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(true);
    run(
        TrainConfig { total_updates: 4, ..tiny() },
        RunArgs::here(folder.path(), false),
        &AtomicBool::new(false),
        |_| {},
    )
    .unwrap();
    let path = folder.path().join("state.bin");
    let bytes = std::fs::read(&path).unwrap();
    let body = &bytes[..bytes.len() - 4];
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut refused, mut resumed) = (0, 0);
    for trial in 0..64 {
        let mut made_up = body.to_vec();
        // What is not the replay buffer or a network comes first, or between them.
        let end = if trial % 2 == 0 { 3000 } else { made_up.len() };
        for _ in 0..=trial % 4 {
            let at = rng.random_range(0..end);
            made_up[at] = rng.random();
        }
        if trial % 16 == 0 {
            made_up.truncate(end / 2);
        }
        let checksum = crc32c::crc32c(&made_up).to_le_bytes();
        std::fs::write(&path, [&made_up[..], &checksum].concat()).unwrap();
        match run(tiny(), RunArgs::here(folder.path(), true), &stop, |_| {}) {
            Ok(()) => resumed += 1,
            Err(error) => {
                assert!(error.to_string().len() > 10, "{error}");
                refused += 1;
            }
        }
    }
    assert!(refused > 10 && resumed > 10, "{refused} refused, {resumed} resumed");
}

#[test]
fn a_run_whose_configuration_was_changed_to_other_lanes_says_so() {
    let folder = tempfile::tempdir().unwrap();
    run(
        TrainConfig { total_updates: 4, ..tiny() },
        RunArgs::here(folder.path(), false),
        &AtomicBool::new(false),
        |_| {},
    )
    .unwrap();
    let path = folder.path().join("config.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("\"npcs_per_world\": 4", "\"npcs_per_world\": 5")).unwrap();
    let refusal = run(tiny(), RunArgs::here(folder.path(), true), &AtomicBool::new(true), |_| {}).unwrap_err();
    assert!(refusal.to_string().contains("does not fit the lanes"), "{refusal}");
}
