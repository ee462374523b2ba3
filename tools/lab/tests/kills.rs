//! A training run that is killed at any moment, again and again, ends as one that was not.

use crate::learner::start;
use std::path::Path;
use std::time::{Duration, Instant};
use surefoot_policy::{ActorConfig, Batch, Policy, Scratch};
use surefoot_processes::LIMIT;
use surefoot_train::{CollectorConfig, SacConfig, TrainConfig};
use surefoot_world::OBSERVATION_LEN;

const KILLS: u64 = 40;

/// Moments of a kill: none is far from any other's time, and some are at once.
fn moment(kill: u64) -> Duration {
    Duration::from_micros((kill * 7_919) % 60_000)
}

/// A run of a small network that writes a checkpoint after every round, and validates after every third.
fn small_run() -> TrainConfig {
    TrainConfig {
        total_updates: 600,
        steps_per_round: 4,
        updates_per_round: 2,
        batch: 16,
        replay_capacity: 4000,
        validate_every: 3,
        checkpoint_every: 1,
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
            near_goals: (2.0, 20.0),
            far_goals: (20.0, 30.0),
            give_up_after: 6,
            random_decisions: 200,
            ..CollectorConfig::default()
        },
        ..TrainConfig::default()
    }
}

/// The bits of what a model decides.
fn decisions(model: &Path) -> Vec<u32> {
    let policy = Policy::load(model).unwrap();
    let rows: Vec<f32> = (0..8 * OBSERVATION_LEN).map(|idx| (idx % 17) as f32 / 17.0).collect();
    let mut actions = Vec::new();
    policy.act(Batch { observations: &rows, memory: &mut [], noise: &[] }, &mut Scratch::default(), &mut actions);
    actions.iter().flat_map(|action| action.to_array().map(f32::to_bits)).collect()
}

#[test]
fn a_training_run_that_is_killed_again_and_again_ends_with_the_weights_of_one_that_was_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let config = path("config.json");
    std::fs::write(&config, serde_json::to_vec(&small_run()).unwrap()).unwrap();
    let to_the_end = |args: &[&str]| assert!(start(args).wait().success(), "{args:?}");
    let (whole, killed) = (path("whole"), path("killed"));
    to_the_end(&["train", &whole, "--config", &config]);

    let state = folder.path().join("killed/state.bin");
    let stamp = || std::fs::metadata(&state).and_then(|metadata| metadata.modified()).ok();
    for kill in 0..KILLS {
        let has_begun = folder.path().join("killed/config.json").exists();
        let how: &[&str] = if has_begun { &["--resume"] } else { &["--config", &config] };
        let (before, since) = (stamp(), Instant::now());
        let mut run = start(&[&["train", &killed], how].concat());
        // Most are killed after a checkpoint of theirs, some before.
        while kill % 4 > 0 && stamp() == before {
            assert!(since.elapsed() < LIMIT, "no checkpoint");
            assert!(run.is_running(), "it ended after {kill} kills");
            std::thread::yield_now();
        }
        std::thread::sleep(moment(kill));
        drop(run);
        for model in ["best", "last"] {
            let model = folder.path().join("killed").join(model);
            if model.join("manifest.json").exists() {
                Policy::load(&model).unwrap_or_else(|error| panic!("after kill {kill}: {error}"));
            }
        }
    }
    to_the_end(&["train", &killed, "--resume"]);
    for model in ["last", "best"] {
        let [whole, killed] = ["whole", "killed"].map(|run| decisions(&folder.path().join(run).join(model)));
        assert_eq!(whole, killed, "{model}");
    }
}
