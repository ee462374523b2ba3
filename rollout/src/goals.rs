//! Starts and goals: where they are drawn from, and how far apart they are.

use rand::{Rng, RngExt};
use std::f32::consts::PI;
use std::ops::Range;
use surefoot_world::Vec3;

/// Draws for a pair of points in the wanted band of distances, for each pair that is wanted.
const PAIR_DRAWS: usize = 2000;

/// One start and goal, both navigable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Where the feet start, m.
    pub start: Vec3,
    /// Heading at the start, rad.
    pub yaw: f32,
    /// Where they should be, m.
    pub goal: Vec3,
}

impl Goal {
    /// Straight-line distance, m.
    pub fn distance(&self) -> f32 {
        self.start.distance(self.goal)
    }

    /// Draws up to `count` pairs of `points` whose distance lies in `band`, m.
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

/// One of `points`.
pub fn random_point(points: &[Vec3], rng: &mut impl Rng) -> Vec3 {
    points[rng.random_range(0..points.len())]
}

/// A heading, rad, in [-pi, pi).
pub fn random_yaw(rng: &mut impl Rng) -> f32 {
    rng.random_range(-PI..PI)
}

/// One of `points` at a distance from `from` that is drawn uniformly from `band`, m, or the closest miss of so many draws: every
/// distance is as likely as any other, however many points lie there.
pub fn goal_at_random_distance(
    points: &[Vec3],
    from: Vec3,
    band: (f32, f32),
    draw_count: usize,
    rng: &mut impl Rng,
) -> Vec3 {
    /// Misses below this are none, m.
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

/// One of `points` whose distance from `from` lies in `band`, m, or the nearest miss of so many draws: distances are as frequent
/// as points are.
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
