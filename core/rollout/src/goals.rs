//! Draws starts and goals at given distances.

use rand::{Rng, RngExt};
use std::f32::consts::PI;
use std::ops::Range;
use surefoot_world::Vec3;

/// Most draws for each requested pair.
const PAIR_DRAWS: usize = 2000;

/// A start and a goal, both navigable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Position of the feet at the start, m.
    pub start: Vec3,
    /// Heading at the start, rad.
    pub yaw: f32,
    /// Position that the feet must reach, m.
    pub goal: Vec3,
}

impl Goal {
    /// Straight-line distance from start to goal, m.
    pub fn distance(&self) -> f32 {
        self.start.distance(self.goal)
    }

    /// Draws up to `count` pairs of `points` whose distance is in `band`, m; fewer if such pairs are too rare.
    pub fn draw(points: &[Vec3], band: Range<f32>, count: usize, rng: &mut impl Rng) -> Vec<Goal> {
        let mut goals = Vec::with_capacity(count);
        for _ in 0..count * PAIR_DRAWS {
            if goals.len() == count {
                break;
            }
            let (start, goal) = (random_point(points, rng), random_point(points, rng));
            if band.contains(&start.distance(goal)) {
                goals.push(Goal { start, yaw: random_yaw(rng), goal });
            }
        }
        goals
    }
}

/// Draws one of `points` uniformly.
pub fn random_point(points: &[Vec3], rng: &mut impl Rng) -> Vec3 {
    points[rng.random_range(0..points.len())]
}

/// Draws a heading, rad, uniformly from [-pi, pi).
pub fn random_yaw(rng: &mut impl Rng) -> f32 {
    rng.random_range(-PI..PI)
}

/// Draws a distance uniformly from `band`, m, and returns the random point, of `draw_count`, with the closest distance
/// from `from`. All distances are equally likely, regardless of the density of points.
pub fn goal_at_random_distance(
    points: &[Vec3],
    from: Vec3,
    band: (f32, f32),
    draw_count: usize,
    rng: &mut impl Rng,
) -> Vec3 {
    /// A point this close to the distance ends the search, m.
    const CLOSE_M: f32 = 1.0;
    let wanted = rng.random_range(band.0..band.1);
    let mut best = (f32::INFINITY, points[0]);
    for _ in 0..draw_count {
        let point = random_point(points, rng);
        let miss = (point.distance(from) - wanted).abs();
        if miss < best.0 {
            best = (miss, point);
        }
        if miss < CLOSE_M {
            break;
        }
    }
    best.1
}

/// Draws a point whose distance from `from` is in `band`, m, or the nearest miss of `draw_count` draws. Distances are
/// as frequent as points at that distance.
pub fn goal_in_band(points: &[Vec3], from: Vec3, band: (f32, f32), draw_count: usize, rng: &mut impl Rng) -> Vec3 {
    let miss = |goal: Vec3| {
        let distance = from.distance(goal);
        (band.0 - distance).max(distance - band.1).max(0.0)
    };
    let mut goal = random_point(points, rng);
    for _ in 1..draw_count {
        if miss(goal) == 0.0 {
            break;
        }
        let other = random_point(points, rng);
        goal = if miss(other) < miss(goal) { other } else { goal };
    }
    goal
}
