//! The axes and units of engines. Ours are right-handed, y up, metres.

use surefoot_world::Vec3;

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

    /// The point on our axes, m, that is at `point` on these axes.
    pub fn ours(self, [x, y, z]: [f32; 3]) -> Vec3 {
        match self {
            Self::Ours => Vec3::new(x, y, z),
            Self::Unity => Vec3::new(-x, y, z),
            Self::Unreal => Vec3::new(x, z, y) / self.units_per_metre(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_come_back_from_every_engine(x in -1.0e3f32..1.0e3, y in -1.0e3f32..1.0e3, z in -1.0e3f32..1.0e3) {
            let point = Vec3::new(x, y, z);
            for axes in [Axes::Ours, Axes::Unity, Axes::Unreal] {
                prop_assert!(axes.ours(axes.point(point)).distance(point) < 1.0e-3, "{axes:?}");
            }
        }
    }

    #[test]
    fn up_stays_up_and_hands_change() {
        let determinant = |axes: Axes| {
            let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| Vec3::from_array(axes.point(axis)));
            x.cross(y).dot(z)
        };
        assert!(determinant(Axes::Ours) > 0.0 && determinant(Axes::Unity) < 0.0 && determinant(Axes::Unreal) < 0.0);
        assert_eq!(Axes::Unity.point(Vec3::Y), [0.0, 1.0, 0.0]);
        assert_eq!(Axes::Unreal.point(Vec3::Y), [0.0, 0.0, 100.0]);
    }
}
