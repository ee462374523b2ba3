//! Boxes in double precision: levels may lie far from their origin.

use glam::DVec3;

/// An axis-aligned box in double precision, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Bounds {
    /// The box without points.
    pub(super) const NONE: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The smallest box around `points`; a box without points is at an infinite distance from everything.
    pub(super) fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        let point = |bounds: Self, point| bounds.union(Self { low: point, high: point });
        points.into_iter().fold(Self::NONE, point)
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    pub(super) fn centre(self) -> DVec3 {
        (self.low + self.high) * 0.5
    }

    /// Length of the diagonal, m; 0 for a box without points.
    pub(super) fn size(self) -> f64 {
        (self.high - self.low).max(DVec3::ZERO).length()
    }

    /// The longer side along the ground, m.
    pub(super) fn side(self) -> f64 {
        (self.high.x - self.low.x).max(self.high.z - self.low.z)
    }

    /// Distance between two boxes, m; 0 if they share a point.
    pub(super) fn distance(self, other: Self) -> f64 {
        (other.low - self.high).max(self.low - other.high).max(DVec3::ZERO).length()
    }

    pub(super) fn widened(self, margin_m: f64) -> Self {
        Self { low: self.low - margin_m, high: self.high + margin_m }
    }
}

/// For each box, the box around all others.
pub(super) fn without_each(boxes: &[Bounds]) -> Vec<Bounds> {
    let mut others = vec![Bounds::NONE; boxes.len()];
    for order in [Vec::from_iter(0..boxes.len()), Vec::from_iter((0..boxes.len()).rev())] {
        let mut passed = Bounds::NONE;
        for idx in order {
            others[idx] = others[idx].union(passed);
            passed = passed.union(boxes[idx]);
        }
    }
    others
}
