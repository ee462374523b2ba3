//! Vertices at a piece that was added to a map: on top of it, and beside it, where NPCs walk around it.

use surefoot_world::float::turned;
use surefoot_world::map::{Outline, Piece, PieceShape};
use surefoot_world::{CharacterProfile, Vec3};

/// Greatest spacing of vertices on and along a piece, m.
const SPACING_M: f32 = 8.0;
/// Most vertices along one side.
const MAX_ALONG: usize = 12;
/// Distance between a piece and a vertex beside it, in addition to the radius of the body, m.
const ROOM_M: f32 = 0.9;
/// Greatest height difference between a spot and its ground, m.
pub(crate) const RISE_M: f32 = 2.0;

/// Approximate positions for vertices; the map decides whether a body can stand there.
pub(crate) fn spots(piece: &Piece, profile: &CharacterProfile) -> Vec<Vec3> {
    let room = profile.radius + ROOM_M;
    match piece.shape {
        PieceShape::Block { foot, half, height, yaw } => {
            let turn = libm::sincosf(yaw);
            let place = |x: f32, y: f32, z: f32| foot + turned(Vec3::new(x, y, z), turn);
            let mut spots = Vec::new();
            for x in along(half[0]) {
                spots.extend(along(half[1]).map(|z| place(x, height, z)));
                spots.extend([-1.0, 1.0].map(|side| place(x, 0.0, side * (half[1] + room))));
            }
            for z in along(half[1]) {
                spots.extend([-1.0, 1.0].map(|side| place(side * (half[0] + room), 0.0, z)));
            }
            let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
            spots.extend(corners.map(|(x, z)| place(x * (half[0] + room), 0.0, z * (half[1] + room))));
            spots
        }
        PieceShape::Plank { from, to, .. } => {
            let (middle, way) = ((from + to) * 0.5, to - from);
            let half = 0.5 * libm::hypotf(way.x, way.z);
            let on = along(half).map(|at| middle + way * (at / (2.0 * half)));
            let ends = [-half - room, half + room]
                .map(|at| (middle + way * (at / (2.0 * half))).with_y(if at < 0.0 { from.y } else { to.y }));
            on.chain(ends).collect()
        }
        PieceShape::Pool(pool) => {
            let (half_x, half_z) = pool.outline.half_extents();
            let (x, z) = (half_x + room, half_z + room);
            let diagonal =
                if matches!(pool.outline, Outline::Round { .. }) { std::f32::consts::FRAC_1_SQRT_2 } else { 1.0 };
            let (dx, dz) = (x * diagonal, z * diagonal);
            let around = [(x, 0.0), (-x, 0.0), (0.0, z), (0.0, -z), (dx, dz), (dx, -dz), (-dx, dz), (-dx, -dz)];
            around.map(|(x, z)| pool.centre + Vec3::new(x, 0.0, z)).to_vec()
        }
    }
}

/// Positions along a side of length `2 * half`, a little inside its ends, m. A short side has only its middle.
fn along(half: f32) -> impl Iterator<Item = f32> {
    let count = ((2.0 * half / SPACING_M) as usize + 1).min(MAX_ALONG);
    (0..count).map(move |idx| half * ((2 * idx + 1) as f32 / count as f32 - 1.0))
}
