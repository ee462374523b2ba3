//! The axes and units of engines. Ours are right-handed, y up, metres.

use surefoot_world::{DVec3, Vec3};

/// Axes and unit of length of a format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axes {
    /// Right-handed, y up, metres: ours, and those of glTF, Godot, Recast and Bevy.
    Ours,
    /// Left-handed, y up, metres: Unity. x is mirrored, as in importers of glTF.
    Unity,
    /// Left-handed, z up, centimetres: Unreal Engine. y and z change places, as in importers of glTF.
    Unreal,
}

impl Axes {
    /// A point on our axes, m, on these axes.
    pub fn point(self, Vec3 { x, y, z }: Vec3) -> [f32; 3] {
        match self {
            Self::Ours => [x, y, z],
            Self::Unity => [-x, y, z],
            Self::Unreal => [x, z, y].map(|value| value * self.units_per_metre()),
        }
    }

    /// A point on our axes in double precision, m, on these axes.
    pub(super) fn far_point(self, DVec3 { x, y, z }: DVec3) -> [f64; 3] {
        match self {
            Self::Ours => [x, y, z],
            Self::Unity => [-x, y, z],
            Self::Unreal => [x, z, y].map(|value| value * f64::from(self.units_per_metre())),
        }
    }

    /// Units of length per metre.
    pub fn units_per_metre(self) -> f32 {
        if self == Self::Unreal { 100.0 } else { 1.0 }
    }

    /// The description of the axes in files.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Ours => "right-handed, y up, metres",
            Self::Unity => "left-handed, y up, metres; x is mirrored",
            Self::Unreal => "left-handed, z up, centimetres; y and z change places",
        }
    }
}
