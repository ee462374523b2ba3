//! A training map with its navigable points and failed attempts.

use super::config::CollectorConfig;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::PI;
use std::sync::Arc;
use surefoot_rollout::goals::{goal_at_random_distance, random_point};
use surefoot_world::{CharacterProfile, Map, TaskConfig, Vec3, World, navigable};

/// Most failed attempts stored per map; further ones overwrite stored ones at random.
const MAX_FAILURES: usize = 400;
/// Number of navigable points drawn on each map.
const POINTS_PER_MAP: usize = 1500;
/// Most draws for a goal within the distance band; then the nearest miss is used.
const GOAL_DRAWS: usize = 400;

/// One training map.
#[derive(Debug)]
pub(super) struct Arena {
    pub seed: u64,
    points: Vec<Vec3>,
    /// Starts and goals of attempts that failed.
    pub failures: Vec<(Vec3, Vec3)>,
}

impl Arena {
    /// Generates the map of `seed` and an empty world on it.
    pub fn new(seed: u64, config: &CollectorConfig) -> (Self, World) {
        let map = Arc::new(Map::generate(&config.spec(seed).expect("a valid training spec")));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let sample = |profile: &CharacterProfile, rng: &mut ChaCha8Rng| {
            navigable::sample_many(&map, profile, POINTS_PER_MAP, rng)
        };
        let drawn = rng.random_bool(config.random_bodies).then(|| random_body(&mut rng));
        // A large body may have no place to stand.
        let fits = drawn.and_then(|body| sample(&body, &mut rng).ok().map(|points| (body, points)));
        let (profile, points) = fits.unwrap_or_else(|| {
            let profile = CharacterProfile::default();
            let points = sample(&profile, &mut rng).expect("generated maps have ground");
            (profile, points)
        });
        (Self { seed, points, failures: Vec::new() }, World::new(map, profile, TaskConfig::default()))
    }

    /// A random navigable point.
    pub fn random_point(&self, rng: &mut ChaCha8Rng) -> Vec3 {
        random_point(&self.points, rng)
    }

    /// A navigable goal whose distance from `from`, m, is within `band`, or the nearest miss.
    pub fn goal(&self, from: Vec3, band: (f32, f32), rng: &mut ChaCha8Rng) -> Vec3 {
        goal_at_random_distance(&self.points, from, band, GOAL_DRAWS, rng)
    }

    /// Stores the start and goal of a failed attempt, to be retried.
    pub fn note_failure(&mut self, failure: (Vec3, Vec3), rng: &mut ChaCha8Rng) {
        if self.failures.len() < MAX_FAILURES {
            self.failures.push(failure);
        } else {
            self.failures[rng.random_range(0..MAX_FAILURES)] = failure;
        }
    }

    /// Removes and returns a random failed attempt.
    ///
    /// # Panics
    /// If there is none.
    pub fn take_failure(&mut self, rng: &mut ChaCha8Rng) -> (Vec3, Vec3) {
        self.failures.swap_remove(rng.random_range(0..self.failures.len()))
    }
}

/// Draws a body: half of them resemble the default one, the others come from the whole range that policies are trained for.
fn random_body(rng: &mut ChaCha8Rng) -> CharacterProfile {
    /// Half extents, as logarithms, of what resembles the default body.
    const LIKENESS: f32 = 0.35;
    let is_alike = rng.random_bool(0.5);
    let mut around = |usual: f32, low: f32, high: f32| {
        let [usual, low, high] = [usual, low, high].map(f32::ln);
        let (low, high) = if is_alike { (low.max(usual - LIKENESS), high.min(usual + LIKENESS)) } else { (low, high) };
        rng.random_range(low..high).exp()
    };
    let (height, gravity) = (around(1.8, 0.5, 3.0), around(20.0, 5.0, 30.0));
    let radius = around(0.3, 0.15, 0.8).min(0.45 * height);
    let jump_m = around(2.5, 0.3, 4.0);
    let speed = around(11.0, 1.5, 15.0);
    let turn_speed = around(PI, 1.5, 12.0);
    let (ground_acceleration, air_acceleration) = (around(60.0, 10.0, 100.0), around(25.0, 2.0, 50.0));
    let step_height = around(0.1, 0.05, 0.6).min(0.9 * radius);
    let max_slope = around(35.0, 20.0, 60.0).to_radians();
    let (can_jump, extra_jumps) = (rng.random_bool(0.95), rng.random_range(0..=2));
    let (uses_zip_lines, uses_jetpacks) = (rng.random_bool(0.85), rng.random_bool(0.85));
    let side_speed_share = if is_alike { 0.6 } else { rng.random_range(0.3..1.0) };
    let changed = CharacterProfile::default().with(|it| {
        (it.height, it.radius, it.gravity) = (height, radius, gravity);
        it.jump_speed = if can_jump { (2.0 * gravity * jump_m).sqrt() } else { 0.0 };
        it.extra_jumps = if is_alike { 1 } else { extra_jumps };
        (it.forward_speed, it.side_speed_share, it.turn_speed) = (speed, side_speed_share, turn_speed);
        (it.ground_acceleration, it.air_acceleration) = (ground_acceleration, air_acceleration);
        (it.step_height, it.max_slope) = (step_height, max_slope);
        (it.uses_zip_lines, it.uses_jetpacks) = (uses_zip_lines, uses_jetpacks);
    });
    changed.expect("drawn values are in range")
}
