//! Exploration noise: standard normal values, in units of the policy's standard deviation.

use rand::rngs::ChaCha8Rng;
use rand::{Rng, RngExt, SeedableRng};
use surefoot_world::character::ACTION_LEN;

/// Words of a random stream for one action: a block.
const WORDS_PER_ACTION: u128 = 16;

/// Draws `count` standard normal values by the Box-Muller transform.
pub fn gaussian(rng: &mut impl Rng, count: usize) -> Vec<f32> {
    let mut values = vec![0.0; count];
    fill_gaussian(rng, &mut values);
    values
}

/// Fills `values` with the same values that [`gaussian`] draws, without allocating.
pub fn fill_gaussian(rng: &mut impl Rng, values: &mut [f32]) {
    for pair in values.chunks_mut(2) {
        let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
        let (sin, cos) = (std::f32::consts::TAU * rng.random::<f32>()).sin_cos();
        pair.iter_mut().zip([radius * cos, radius * sin]).for_each(|(value, drawn)| *value = drawn);
    }
}

/// Noise for the actions of `row_count` rows: `share` of the exploration noise. Share 0 draws nothing and returns no
/// values.
pub fn for_rows(rng: &mut impl Rng, share: f32, row_count: usize) -> Vec<f32> {
    let mut values = if share > 0.0 { gaussian(rng, row_count * ACTION_LEN) } else { Vec::new() };
    values.iter_mut().for_each(|value| *value *= share);
    values
}

/// Noise of action `number` in a random stream under `seed`: `share` of the exploration noise.
pub fn of_action((seed, stream): (u64, u64), number: u64, share: f32) -> [f32; ACTION_LEN] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng.set_word_pos(u128::from(number) * WORDS_PER_ACTION);
    let mut values = [0.0; ACTION_LEN];
    fill_gaussian(&mut rng, &mut values);
    values.map(|value| value * share)
}
