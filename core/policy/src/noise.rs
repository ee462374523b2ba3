//! Exploration noise: standard normal values, in units of the policy's standard deviation.

use rand::{Rng, RngExt};
use surefoot_world::character::ACTION_LEN;

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

/// Noise for the actions of `row_count` rows: `share` of the exploration noise. Share 0 draws nothing and returns no values.
pub fn for_rows(rng: &mut impl Rng, share: f32, row_count: usize) -> Vec<f32> {
    let mut values = if share > 0.0 { gaussian(rng, row_count * ACTION_LEN) } else { Vec::new() };
    values.iter_mut().for_each(|value| *value *= share);
    values
}
