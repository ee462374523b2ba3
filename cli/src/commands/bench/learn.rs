//! Learning: SAC updates and inference.

use super::{Figure, median, timed};
use crate::commands::load_policy;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::hint::black_box;
use surefoot_agent::train::TrainConfig;
use surefoot_agent::train::replay::Batch;
use surefoot_agent::train::sac::Learner;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;

/// All figures of learning.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let reactive = TrainConfig::default();
    let recurrent = TrainConfig::recurrent();
    let policy = load_policy(None)?;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let observations = noise(256 * OBSERVATION_LEN, &mut rng);
    let mut actions = Vec::new();
    let inference =
        (0..60).map(|_| timed(|| policy.act(&observations, &mut [], 0.0, &mut rng, &mut actions))).collect();
    Ok(vec![
        Figure::new("sac_updates_s", updates_per_second(&reactive, 60), "1/s, one thread, batch 256"),
        Figure::new(
            "sac_recurrent_updates_s",
            updates_per_second(&recurrent, 24),
            "1/s, one thread, 32 sequences of 20 + 20",
        ),
        Figure::new("infer_256_us", median(inference) * 1.0e6, "us, one thread"),
    ])
}

/// SAC updates a second on random batches of the shape that `config` draws.
fn updates_per_second(config: &TrainConfig, count: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (size, learned) = (config.batch, config.batch * config.learn);
    let steps = config.burn_in + config.learn + if config.learn == 1 { 1 } else { config.n_step };
    let batch = Batch {
        size,
        burn_in: config.burn_in,
        learn: config.learn,
        observations: noise(steps * size * OBSERVATION_LEN, &mut rng),
        keep: vec![1.0; steps * size],
        memory: noise(size * 2 * config.sac.network.memory, &mut rng),
        actions: noise(learned * ACTION_LEN, &mut rng),
        returns: noise(learned, &mut rng),
        bootstrap: vec![0.98; learned],
        weights: vec![1.0; learned],
        successors: (0..learned).map(|idx| config.burn_in * size + size + idx).collect(),
    };
    let mut learner = Learner::new(config.sac.clone(), ChaCha8Rng::seed_from_u64(0));
    let updates: Vec<f64> = (0..count).map(|_| timed(|| _ = black_box(learner.update(&batch)))).collect();
    // Actor and temperature learn at every second update: pairs of updates are the unit.
    let pairs = updates.chunks_exact(2).skip(2).map(|pair| pair[0] + pair[1]).collect();
    2.0 / median(pairs)
}

fn noise(count: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}
