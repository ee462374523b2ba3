//! A training map with its navigable points and failed attempts.

use super::config::CollectorConfig;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::HashMap;
use std::sync::Arc;
use surefoot_rollout::goals::{goal_at_random_distance, random_point};
use surefoot_world::character::bodies::BODIES;
use surefoot_world::reach::{IslandGraph, Reach, reached};
use surefoot_world::{CharacterProfile, Map, TaskConfig, Vec3, World, WorldConfig, navigable};

/// Most failed attempts stored per map; further ones overwrite stored ones at random.
const MAX_FAILURES: usize = 400;
/// Number of navigable points drawn on each map.
const POINTS_PER_MAP: usize = 1500;
/// Seeds tried until a map has ground.
const SEEDS_TRIED: u64 = 64;
/// Most draws for a goal within the distance band; then the nearest miss is used.
const GOAL_DRAWS: usize = 400;

/// One training map.
#[derive(Debug)]
pub(super) struct Arena {
    pub seed: u64,
    points: Vec<Vec3>,
    /// Starts and goals of attempts that failed.
    pub failures: Vec<(Vec3, Vec3)>,
    /// `None` if goals are drawn from all points.
    surveyed: Option<Surveyed>,
}

impl Arena {
    /// Creates the arena of `seed` and an empty world on its map.
    ///
    /// # Panics
    /// As [`on_some_map`](Self::on_some_map).
    pub fn new(seed: u64, config: &CollectorConfig) -> (Self, World) {
        let (arena, map, body) = Self::on_some_map(seed, config);
        let world = WorldConfig::new(body, TaskConfig::default(), config.solid_npcs);
        (arena, World::with_config(map, world))
    }

    /// Makes the map of `seed`, and chooses the body of its NPCs. A few small maps have no ground; the map of the next
    /// seed then takes their place.
    ///
    /// # Panics
    /// If there is no map with ground, which the configuration's check rules out unless a file has changed since.
    pub fn on_some_map(seed: u64, config: &CollectorConfig) -> (Self, Arc<Map>, CharacterProfile) {
        let tried = (seed..seed.saturating_add(SEEDS_TRIED)).find_map(|tried| Self::on_map_of(tried, config));
        let (arena, map, body) = tried.expect("training maps have ground");
        (Self { seed, ..arena }, map, body)
    }

    /// The arena on the map of exactly this seed; `None` if it has no ground.
    fn on_map_of(seed: u64, config: &CollectorConfig) -> Option<(Self, Arc<Map>, CharacterProfile)> {
        let map = Arc::new(config.map(seed).expect("checked before training"));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let sample = |profile: &CharacterProfile, rng: &mut ChaCha8Rng| {
            navigable::sample_many(&map, profile, POINTS_PER_MAP, rng)
        };
        let drawn = rng.random_bool(config.random_bodies).then(|| random_body(&mut rng));
        // A large body may have no place to stand.
        let fits = drawn.and_then(|body| sample(&body, &mut rng).ok().map(|points| (body, points)));
        let usual = || sample(&config.body, &mut rng).ok().map(|points| (config.body.clone(), points));
        let (profile, points) = fits.or_else(usual)?;
        let surveyed = (config.reachable_share > 0.0).then(|| Surveyed::new(&map, &profile, config.reachable_share));
        Some((Self { seed, points, failures: Vec::new(), surveyed }, map, profile))
    }

    /// A random navigable point.
    pub fn random_point(&self, rng: &mut ChaCha8Rng) -> Vec3 {
        random_point(&self.points, rng)
    }

    /// Draws a navigable goal whose distance from `from`, m, is within the band of near or of far goals, or the nearest
    /// miss.
    pub fn goal(&mut self, from: Vec3, config: &CollectorConfig, rng: &mut ChaCha8Rng) -> Vec3 {
        let band = if rng.random_bool(config.near_share) { config.near_goals } else { config.far_goals };
        let reachable = self.surveyed.as_mut().and_then(|surveyed| surveyed.draw_points(from, &self.points, rng));
        goal_at_random_distance(reachable.unwrap_or(&self.points), from, band, GOAL_DRAWS, rng)
    }

    /// Stores the start and goal of a failed attempt, to be retried.
    pub fn note_failure(&mut self, failure: (Vec3, Vec3), rng: &mut ChaCha8Rng) {
        if self.failures.len() < MAX_FAILURES {
            self.failures.push(failure);
        } else {
            self.failures[rng.random_range(0..MAX_FAILURES)] = failure;
        }
    }

    /// Removes and returns a random failed attempt, for the share of spawns that retry one.
    pub fn draw_retry(&mut self, config: &CollectorConfig, rng: &mut ChaCha8Rng) -> Option<(Vec3, Vec3)> {
        let does_retry = !self.failures.is_empty() && rng.random_bool(config.retry_share);
        does_retry.then(|| self.failures.swap_remove(rng.random_range(0..self.failures.len())))
    }
}

/// The survey of a map.
#[derive(Debug)]
struct Surveyed {
    reach: Reach,
    islands: IslandGraph,
    /// Share of goals that must be reachable.
    share: f64,
    /// For each island from which goals were drawn, the points that are reachable.
    points: HashMap<u32, Vec<Vec3>>,
}

impl Surveyed {
    fn new(map: &Map, profile: &CharacterProfile, share: f64) -> Self {
        let reach = Reach::survey(map, profile, 1);
        let islands = reach.graph(|_| true);
        Self { reach, islands, share, points: HashMap::new() }
    }

    /// For the share of goals that must be reachable, those of `points` that are reachable from `from`; otherwise, and
    /// where none is known to be, `None`.
    fn draw_points(&mut self, from: Vec3, points: &[Vec3], rng: &mut ChaCha8Rng) -> Option<&[Vec3]> {
        if !rng.random_bool(self.share) {
            return None;
        }
        let ground = &self.reach.ground;
        let island = ground.at(from)?.island;
        let known = self.points.entry(island).or_insert_with(|| {
            let reached = reached(&self.islands, island);
            let is_reached = |point: &Vec3| ground.at(*point).is_some_and(|cell| reached[cell.island as usize]);
            points.iter().copied().filter(is_reached).collect()
        });
        (known.len() > 1).then_some(known.as_slice())
    }
}

/// Draws a body: half of them resemble a named one, the others come from the whole range that policies are trained for.
fn random_body(rng: &mut ChaCha8Rng) -> CharacterProfile {
    /// Largest difference from a named body, as a logarithm.
    const LIKENESS: f32 = 0.3;
    let named = rng.random_bool(0.5).then(|| BODIES[rng.random_range(0..BODIES.len())].profile());
    let mut draw = |usual: fn(&CharacterProfile) -> f32, low: f32, high: f32| {
        let (low, high) = (low.ln(), high.ln());
        let around = named.as_ref().map(|body| usual(body).max(1e-6).ln().clamp(low, high));
        let from = around.map_or(low, |usual| low.max(usual - LIKENESS));
        let to = around.map_or(high, |usual| high.min(usual + LIKENESS));
        rng.random_range(from..=to).exp()
    };
    let (height, gravity) = (draw(|it| it.height, 0.5, 3.0), draw(|it| it.gravity, 5.0, 30.0));
    let radius = draw(|it| it.radius, 0.15, 0.8).min(0.45 * height);
    let jump_m = draw(|it| it.jump_speed * it.jump_speed / (2.0 * it.gravity), 0.3, 4.0);
    let speed = draw(|it| it.forward_speed, 1.5, 15.0);
    let turn_speed = draw(|it| it.turn_speed, 1.5, 12.0);
    let ground_acceleration = draw(|it| it.ground_acceleration, 10.0, 100.0);
    let air_acceleration = draw(|it| it.air_acceleration, 0.5, 50.0);
    let step_height = draw(|it| it.step_height, 0.03, 0.6).min(0.9 * radius);
    let max_slope = draw(|it| it.max_slope.to_degrees(), 20.0, 60.0).to_radians();
    let (can_jump, extra_jumps) = (rng.random_bool(0.95), rng.random_range(0..=2));
    let (uses_zip_lines, uses_jetpacks) = (rng.random_bool(0.85), rng.random_bool(0.85));
    let side_speed_share = rng.random_range(0.3..1.0);
    let base = named.clone().unwrap_or_default();
    let changed = base.with(|it| {
        (it.height, it.radius, it.gravity) = (height, radius, gravity);
        it.jump_speed = if can_jump { (2.0 * gravity * jump_m).sqrt() } else { 0.0 };
        (it.forward_speed, it.turn_speed) = (speed, turn_speed);
        (it.ground_acceleration, it.air_acceleration) = (ground_acceleration, air_acceleration);
        (it.step_height, it.max_slope) = (step_height, max_slope);
        if named.is_none() {
            (it.extra_jumps, it.side_speed_share) = (extra_jumps, side_speed_share);
            (it.uses_zip_lines, it.uses_jetpacks) = (uses_zip_lines, uses_jetpacks);
        }
    });
    changed.expect("drawn values are in range")
}
