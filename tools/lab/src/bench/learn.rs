//! Learning: SAC updates and inference.

use super::world::Crowd;
use super::{Figure, median, timed};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::hint::black_box;
use std::sync::Arc;
use surefoot_cli::commands::load_policy;
use surefoot_policy::{Batch as Rows, Policy, Scratch};
use surefoot_rollout::env::{Env, Episodes};
use surefoot_train::networks::with_burn;
use surefoot_train::replay::Batch;
use surefoot_train::{Learner, Processor, Run, TrainConfig};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::{CharacterProfile, MapSpec, NpcSlot, OBSERVATION_LEN};

/// Batch sizes at which inference is timed.
const INFERENCE: [usize; 5] = [1, 64, 192, 256, 512];

/// All figures of `bench learn`.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let (reactive, recurrent) = (TrainConfig::default(), TrainConfig::recurrent());
    let mut figures = vec![
        Figure::new("sac_updates_s", updates_per_second(&reactive, 80), "1/s, batch 256"),
        Figure::new("sac_recurrent_updates_s", updates_per_second(&recurrent, 24), "1/s, 32 sequences of 20 + 20"),
        Figure::new("train_decisions_s", train_decisions_per_second()?, "1/s, reactive, collecting and learning"),
    ];
    let shipped = load_policy(None)?;
    figures.push(Figure::new("env_steps_s", env_steps_per_second(&shipped)?, "1/s on one thread, with inference"));
    let lstm = untrained(&recurrent);
    for rows in INFERENCE {
        for (agent, policy) in [("", &shipped), ("lstm_", &lstm)] {
            let burn = with_burn(policy.clone(), Processor::Cpu)?;
            let figure = Figure::new(format!("infer_{agent}{rows}_us"), inference_us(policy, rows), "us");
            figures.push(figure.with_reference("burn", inference_us(&burn, rows), false));
        }
    }
    Ok(figures)
}

/// A policy with random weights: speed does not depend on training.
fn untrained(config: &TrainConfig) -> Policy {
    let learner = Learner::new(config.sac.clone(), ChaCha8Rng::seed_from_u64(0));
    learner.policy("untrained")
}

fn inference_us(policy: &Policy, rows: usize) -> f64 {
    let observations = observations(rows);
    let (mut memory, mut scratch) = (vec![0.0; rows * policy.memory_len()], Scratch::default());
    let mut actions = Vec::new();
    let mut act = || {
        let rows = Rows { observations: &observations, memory: &mut memory, noise: &[] };
        policy.act(rows, &mut scratch, &mut actions);
    };
    let times = (0..200).map(|_| timed(&mut act));
    median(times.collect()) * 1.0e6
}

/// Decisions per second of the whole training pipeline, after its warm-up.
fn train_decisions_per_second() -> anyhow::Result<f64> {
    let mut run = Run::new(TrainConfig::default())?;
    while run.updates() == 0 {
        run.round()?;
    }
    let before = run.decisions();
    let mut rounds = Ok(());
    let seconds = timed(|| rounds = (0..20).try_for_each(|_| run.round().map(drop)));
    rounds?;
    Ok((run.decisions() - before) as f64 / seconds)
}

/// Steps per second of 256 NPCs of one environment, in one batch.
fn env_steps_per_second(policy: &Policy) -> anyhow::Result<f64> {
    const NPCS: usize = 256;
    const STEPS: usize = 100;
    let map = Arc::new(surefoot_generate::generate(&MapSpec::new(0)));
    let episodes = Episodes::Endless { npc_count: NPCS, band: (0.0, 25.0), seed: 0 };
    let mut env = Env::new(map, CharacterProfile::default(), false, episodes)?;
    let (mut memory, mut scratch) = (vec![0.0; NPCS * policy.memory_len()], Scratch::default());
    let mut actions = Vec::new();
    let mut step = || {
        let rows = Rows { observations: env.observations(), memory: &mut memory, noise: &[] };
        policy.act(rows, &mut scratch, &mut actions);
        black_box(env.step(&actions));
    };
    let times = (0..STEPS).map(|_| timed(&mut step));
    Ok(NPCS as f64 / median(times.collect()))
}

/// SAC updates per second on random batches of the shape that `config` gives.
fn updates_per_second(config: &TrainConfig, count: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (size, learned) = (config.batch, config.batch * config.learn);
    let steps = config.burn_in + config.learn + if config.learn == 1 { 1 } else { config.n_step };
    let batch = Batch {
        size,
        burn_in: config.burn_in,
        learn: config.learn,
        observations: observations(steps * size),
        keep: vec![1.0; steps * size],
        memory: noise(size * 2 * config.sac.network.memory_len(), &mut rng),
        actions: noise(learned * ACTION_LEN, &mut rng),
        returns: noise(learned, &mut rng),
        bootstrap: vec![0.98; learned],
        weights: vec![1.0; learned],
        successors: (0..learned).map(|idx| config.burn_in * size + size + idx).collect(),
    };
    let mut learner = Learner::new(config.sac.clone(), ChaCha8Rng::seed_from_u64(0));
    let updates: Vec<f64> = (0..count).map(|_| timed(|| _ = black_box(learner.update(&batch)))).collect();
    // Actor and temperature are updated at every second update, so pairs of updates are timed.
    let pairs = updates.chunks_exact(2).skip(2).map(|pair| pair[0] + pair[1]).collect();
    2.0 / median(pairs)
}

/// Observation rows of NPCs on a generated map: the speed of the ray encoder depends on the share of zeros.
fn observations(rows: usize) -> Vec<f32> {
    let map = Arc::new(surefoot_generate::generate(&MapSpec::new(0)));
    let crowd = Crowd::of(rows, &map, 0, false).expect("generated maps have ground");
    let mut values = vec![0.0; rows * OBSERVATION_LEN];
    for (idx, row) in (0..).zip(values.chunks_exact_mut(OBSERVATION_LEN)) {
        crowd.world.observe(NpcSlot(idx), row);
    }
    values
}

fn noise(count: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}
