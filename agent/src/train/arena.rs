//! A training map: places to stand on it, and attempts that failed there.

use super::config::CollectorConfig;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_rollout::goals::{goal_at_random_distance, random_point};
use surefoot_world::{CharacterProfile, Map, TaskConfig, Vec3, World, navigable};

/// Failed attempts remembered per map; beyond them an old one is overwritten.
const MAX_FAILURES: usize = 400;
/// Navigable points drawn on each map.
const POINTS_PER_MAP: usize = 1500;
/// Draws for a goal in the wanted band of distances before the nearest miss is taken.
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
    /// The map of `seed`, with an empty world on it.
    pub fn new(seed: u64, config: &CollectorConfig) -> (Self, World) {
        let map = Arc::new(Map::generate(&config.spec(seed).expect("a valid training spec")));
        let profile = CharacterProfile::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let points =
            navigable::sample_many(&map, &profile, POINTS_PER_MAP, &mut rng).expect("generated maps have ground");
        (Self { seed, points, failures: Vec::new() }, World::new(map, profile, TaskConfig::default()))
    }

    /// Somewhere to stand.
    pub fn random_point(&self, rng: &mut ChaCha8Rng) -> Vec3 {
        random_point(&self.points, rng)
    }

    /// A navigable goal at a distance from `from` inside the band, m, or the closest miss.
    pub fn goal(&self, from: Vec3, band: (f32, f32), rng: &mut ChaCha8Rng) -> Vec3 {
        goal_at_random_distance(&self.points, from, band, GOAL_DRAWS, rng)
    }

    /// Remembers an attempt as one to be tried again.
    pub fn note_failure(&mut self, failure: (Vec3, Vec3), rng: &mut ChaCha8Rng) {
        if self.failures.len() < MAX_FAILURES {
            self.failures.push(failure);
        } else {
            self.failures[rng.random_range(0..MAX_FAILURES)] = failure;
        }
    }

    /// Takes one of the failed attempts.
    pub fn take_failure(&mut self, rng: &mut ChaCha8Rng) -> (Vec3, Vec3) {
        self.failures.swap_remove(rng.random_range(0..self.failures.len()))
    }
}
