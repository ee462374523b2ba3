//! A training map with its navigable points and failed attempts.

use super::config::CollectorConfig;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
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
        let profile = CharacterProfile::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let points =
            navigable::sample_many(&map, &profile, POINTS_PER_MAP, &mut rng).expect("generated maps have ground");
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
