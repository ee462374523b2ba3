//! How fast an NPC goes where it can walk.

use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// How fast an NPC goes on legs that can be walked. Leaps and devices take what they need.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gait {
    /// Top speed, as a share of the body's.
    pub speed: f32,
    /// Acceleration, as a share of the body's on the ground.
    pub acceleration: f32,
}

impl Gait {
    /// Allowed values of `speed`.
    pub const SPEEDS: RangeInclusive<f32> = 0.05..=1.0;
    /// Allowed values of `acceleration`.
    pub const ACCELERATIONS: RangeInclusive<f32> = 0.05..=1.0;

    /// Whether both values are allowed.
    pub fn is_allowed(self) -> bool {
        Self::SPEEDS.contains(&self.speed) && Self::ACCELERATIONS.contains(&self.acceleration)
    }

    /// The same gait, at most so fast.
    #[must_use]
    pub fn at_most(self, speed: f32) -> Self {
        Self { speed: self.speed.min(speed), ..self }
    }
}

impl Default for Gait {
    fn default() -> Self {
        Self { speed: 1.0, acceleration: 0.3 }
    }
}
