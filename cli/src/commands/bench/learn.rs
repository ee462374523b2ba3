//! Learning: SAC updates and inference.

use super::{Figure, median, timed};
use crate::commands::load_policy;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::hint::black_box;
use surefoot_agent::train::replay::Batch;
use surefoot_agent::train::sac::{Learner, SacConfig};
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;

/// All figures of learning.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    const BATCH: usize = 256;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut draw = |count: usize| (0..count).map(|_| rng.random_range(-1.0..1.0f32)).collect::<Vec<f32>>();
    let batch = Batch {
        observations: draw(BATCH * OBSERVATION_LEN),
        actions: draw(BATCH * ACTION_LEN),
        returns: draw(BATCH),
        bootstrap: vec![0.98; BATCH],
        next_observations: draw(BATCH * OBSERVATION_LEN),
    };
    let mut learner = Learner::new(SacConfig::default(), ChaCha8Rng::seed_from_u64(0));
    let updates: Vec<f64> = (0..60).map(|_| timed(|| _ = black_box(learner.update(&batch)))).collect();
    // Actor and temperature learn at every second update: pairs of updates are the unit.
    let pairs = updates.chunks_exact(2).skip(5).map(|pair| pair[0] + pair[1]).collect();
    let policy = load_policy(None)?;
    let mut actions = Vec::new();
    let inference = (0..60).map(|_| timed(|| policy.act(&batch.observations, 0.0, &mut rng, &mut actions))).collect();
    Ok(vec![
        Figure::new("sac_updates_s", 2.0 / median(pairs), "1/s, one thread, batch 256"),
        Figure::new("infer_256_us", median(inference) * 1.0e6, "us, one thread"),
    ])
}
