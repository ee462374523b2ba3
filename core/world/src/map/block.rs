//! [`Block`]: the box of which buildings, built maps and pieces consist.

use crate::Vec3;
use crate::float::{hypot, turned};

/// A box whose top and bottom may slant along x.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    min: Vec3,
    max: Vec3,
    /// Height added to top and bottom at `max.x`, m.
    rise: f32,
}

impl Block {
    /// A level box between two corners, m.
    pub fn new(min: [f32; 3], max: [f32; 3]) -> Self {
        Self { min: min.into(), max: max.into(), rise: 0.0 }
    }

    /// The block with a top and bottom that rise by `rise` metres along x.
    pub fn rising(self, rise: f32) -> Self {
        Self { rise, ..self }
    }

    /// A plank whose top leads from one point to the other, and where it is placed, with its turn.
    pub fn plank(from: Vec3, to: Vec3, width: f32, thickness: f32) -> (Self, Vec3, f32) {
        let (dx, dz) = (to.x - from.x, to.z - from.z);
        let half = [0.5 * hypot(dx, dz), 0.5 * width];
        let block = Self::new([-half[0], -thickness, -half[1]], [half[0], 0.0, half[1]]).rising(to.y - from.y);
        let middle = Vec3::new(0.5 * (from.x + to.x), from.y, 0.5 * (from.z + to.z));
        // A turn by `yaw` takes the x axis to (cos, -sin).
        (block, middle, libm::atan2f(-dz, dx))
    }

    /// The triangles of the block, turned by `yaw` and then moved to `at`.
    pub fn placed(&self, at: Vec3, yaw: f32) -> impl Iterator<Item = [Vec3; 3]> + use<> {
        let turn = libm::sincosf(yaw);
        self.triangles().map(move |corners| corners.map(|corner| at + turned(corner, turn)))
    }

    /// The twelve triangles of the box, facing outwards.
    pub fn triangles(&self) -> impl Iterator<Item = [Vec3; 3]> + use<> {
        let corner = |x: usize, y: usize, z: usize| {
            let pick = |bit: usize, min: f32, max: f32| if bit == 1 { max } else { min };
            let lift = if x == 1 { self.rise } else { 0.0 };
            Vec3::new(
                pick(x, self.min.x, self.max.x),
                pick(y, self.min.y, self.max.y) + lift,
                pick(z, self.min.z, self.max.z),
            )
        };
        // Each face is counter-clockwise seen from outside; corners are x, y, z bits.
        const FACES: [[[usize; 3]; 4]; 6] = [
            [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]],
            [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
            [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
            [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]],
            [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]],
            [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
        ];
        let quads = FACES.map(|face| face.map(|[x, y, z]| corner(x, y, z)));
        quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
    }
}
