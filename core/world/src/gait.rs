//! How an NPC goes where it can walk: how fast, how it turns, how far from walls, and whether it jumps.

use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// How an NPC goes on legs that can be walked. Leaps and devices take what they need.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Gait {
    /// Top speed, as a share of the body's.
    pub speed: f32,
    /// Acceleration, as a share of the body's on the ground.
    pub acceleration: f32,
    /// Turning speed, as a share of the body's.
    pub turn_rate: f32,
    /// Distance from walls and rims that the NPC keeps besides its radius where the ground has room, m.
    pub wall_distance: f32,
    /// Whether plans use jumps only where no other way leads to the goal.
    pub avoids_jumps: bool,
}

/// A gait with a name.
#[derive(Debug, Clone, Copy)]
pub struct NamedGait {
    /// Lower-case name, as in requests and commands.
    pub name: &'static str,
    /// The gait.
    pub gait: Gait,
}

/// All named gaits. Speeds in the comments are those of the default body, whose top speed is 11 m/s, whose acceleration
/// is 60 m/s2, and which turns by 180 degrees a second.
pub const GAITS: [NamedGait; 5] = [
    // 1.4 m/s, as people walk. 3 m/s2 takes 0.5 s to that speed, and an about-turn takes 2 s. People pass walls at
    // 0.3 m.
    NamedGait { name: "walk", gait: Gait::new(0.13, 0.05, 0.5, 0.3, false) },
    // 2.75 m/s, reached in 0.5 s; an about-turn takes 1.3 s.
    NamedGait { name: "jog", gait: Gait::new(0.25, 0.1, 0.75, 0.2, false) },
    // The default: the body's top speed, since games choose it as that of a run, within 0.6 s.
    NamedGait { name: "run", gait: Gait::DEFAULT },
    // 0.9 m/s, with room for a missed step at rims. An about-turn takes 2.5 s.
    NamedGait { name: "careful", gait: Gait::new(0.08, 0.05, 0.4, 0.6, true) },
    // The body's top speed within 0.25 s: faster than a run where the way has corners.
    NamedGait { name: "hurried", gait: Gait::new(1.0, 0.7, 1.0, 0.0, false) },
];

impl NamedGait {
    /// The named gait with this name.
    pub fn find(name: &str) -> Option<&'static Self> {
        GAITS.iter().find(|gait| gait.name == name)
    }
}

impl Gait {
    /// As fast as the body can, with 0.3 of its acceleration.
    pub const DEFAULT: Self = Self::new(1.0, 0.3, 1.0, 0.0, false);
    /// Allowed values of `speed`.
    pub const SPEEDS: RangeInclusive<f32> = 0.05..=1.0;
    /// Allowed values of `acceleration`.
    pub const ACCELERATIONS: RangeInclusive<f32> = 0.05..=1.0;
    /// Allowed values of `turn_rate`.
    pub const TURN_RATES: RangeInclusive<f32> = 0.05..=1.0;
    /// Allowed values of `wall_distance`, m.
    pub const WALL_DISTANCES: RangeInclusive<f32> = 0.0..=2.0;

    const fn new(speed: f32, acceleration: f32, turn_rate: f32, wall_distance: f32, avoids_jumps: bool) -> Self {
        Self { speed, acceleration, turn_rate, wall_distance, avoids_jumps }
    }

    /// Whether all values are allowed.
    pub fn is_allowed(self) -> bool {
        Self::SPEEDS.contains(&self.speed)
            && Self::ACCELERATIONS.contains(&self.acceleration)
            && Self::TURN_RATES.contains(&self.turn_rate)
            && Self::WALL_DISTANCES.contains(&self.wall_distance)
    }

    /// The same gait, at most so fast.
    #[must_use]
    pub fn at_most(self, speed: f32) -> Self {
        Self { speed: self.speed.min(speed), ..self }
    }

    /// Whether an NPC with this gait takes the same ways as with another.
    pub fn goes_like(self, other: Self) -> bool {
        (self.wall_distance, self.avoids_jumps) == (other.wall_distance, other.avoids_jumps)
    }
}

impl Default for Gait {
    fn default() -> Self {
        Self::DEFAULT
    }
}
