//! Axis-aligned boxes.

use crate::Vec3;
use serde::{Deserialize, Serialize};

/// An axis-aligned box, corners included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Corner with the least coordinates, m.
    pub low: Vec3,
    /// Corner with the greatest coordinates, m.
    pub high: Vec3,
}

impl Aabb {
    /// The box that contains only `point`.
    pub fn at(point: Vec3) -> Self {
        Self { low: point, high: point }
    }

    /// The smallest box around `points`; `None` without points.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Option<Self> {
        points.into_iter().map(Self::at).reduce(Self::union)
    }

    /// The middle of its bottom.
    pub fn bottom(self) -> Vec3 {
        let middle = (self.low + self.high) * 0.5;
        Vec3::new(middle.x, self.low.y, middle.z)
    }

    /// The smallest box that contains both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// This box, larger by `margin_m` metres on each side.
    #[must_use]
    pub fn widened(self, margin_m: f32) -> Self {
        Self { low: self.low - margin_m, high: self.high + margin_m }
    }

    /// Returns whether the two boxes share a point.
    pub fn touches(self, other: Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }
}

impl From<(Vec3, Vec3)> for Aabb {
    fn from((low, high): (Vec3, Vec3)) -> Self {
        Self { low, high }
    }
}
