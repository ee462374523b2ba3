//! Pieces: blocks, ramps, bridges and pools that are put onto a map while worlds run on it, and taken away again.

use super::block::Block;
use super::features::{Liquid, Outline, Pool};
use crate::Vec3;
use crate::float::hypot;
use crate::mesh::{Surface, Triangle};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Most pieces of a map.
pub const MAX_PIECES: usize = 1024;
/// Longest name of a piece, bytes.
pub const MAX_NAME_LEN: usize = 64;
/// Allowed lengths of a side, m.
pub const SIDES_M: std::ops::RangeInclusive<f32> = 0.05..=1000.0;
/// Most ground that the pieces of a map cover together, m2, each counted by its bounds: their index stays small.
pub const MAX_COVERED_M2: f64 = 2.0e7;
/// How far a block reaches below its foot, m: no two faces may coincide where it stands on the ground.
const SINK_M: f32 = 0.05;
/// How far a piece may reach out of the map, m, and below it.
const RIM_M: f32 = 1.0;
const CELLAR_M: f32 = 1000.0;

/// What was added to a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Piece {
    /// Name, unique on the map.
    pub name: String,
    /// What it is, and where.
    pub shape: PieceShape,
}

/// What a piece is, and where.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum PieceShape {
    /// An upright box.
    Block {
        /// Middle of its bottom, m.
        foot: Vec3,
        /// Half of its extents along x and z before it is turned, m.
        half: [f32; 2],
        /// Height, m.
        height: f32,
        /// Turn about the upright axis, rad, counter-clockwise seen from above.
        yaw: f32,
    },
    /// A plank whose top leads from one point to another: a ramp or a bridge.
    Plank {
        /// Where the middle of its top begins, m.
        from: Vec3,
        /// Where it ends, m.
        to: Vec3,
        /// Width, m.
        width: f32,
        /// Thickness, m.
        thickness: f32,
    },
    /// Water or lava with a level surface, which lies above the ground that it is to cover.
    Pool(Pool),
}

/// Why pieces cannot be put onto a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PieceError {
    /// There are too many.
    #[error("the map would have {0} pieces, but at most {MAX_PIECES} fit: remove some, or import the level again")]
    TooMany(usize),
    /// Together they cover too much.
    #[error("the pieces cover {0:.0} m2 together, but at most {MAX_COVERED_M2:.0} are possible: make them smaller")]
    TooLarge(f64),
    /// A name is empty or too long.
    #[error("the name of a piece has 1 to {MAX_NAME_LEN} bytes, not {0}")]
    Name(usize),
    /// Two pieces have the same name.
    #[error("there are two pieces `{0}`: give each a name of its own")]
    Twice(String),
    /// A number is not finite or out of range.
    #[error("the {field} of the piece `{name}` is {value}, but must be {} to {} m", SIDES_M.start(), SIDES_M.end())]
    Side {
        /// Name of the piece.
        name: String,
        /// Name of the number.
        field: &'static str,
        /// Its value, m.
        value: f32,
    },
    /// A piece reaches out of the map.
    #[error("the piece `{name}` reaches out of the map, which spans 0 to {extent:?} m")]
    Outside {
        /// Name of the piece.
        name: String,
        /// Extent of the map, m.
        extent: [f32; 3],
    },
    /// It has a position or a turn that is not finite.
    #[error("the piece `{0}` has a position or a yaw that is not a finite number")]
    NotFinite(String),
}

impl Piece {
    /// The solid triangles of the piece; none of a pool.
    pub fn triangles(&self) -> Vec<Triangle> {
        let solid = |(block, at, yaw): (Block, Vec3, f32)| {
            let turned = block.placed(at, yaw);
            turned.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
        };
        match self.shape {
            PieceShape::Block { foot, half: [x, z], height, yaw } => {
                solid((Block::new([-x, -SINK_M, -z], [x, height, z]), foot, yaw))
            }
            PieceShape::Plank { from, to, width, thickness } => solid(Block::plank(from, to, width, thickness)),
            PieceShape::Pool(_) => Vec::new(),
        }
    }

    /// The pool that the piece is, if it is one.
    pub fn pool(&self) -> Option<Pool> {
        match self.shape {
            PieceShape::Pool(pool) => Some(pool),
            PieceShape::Block { .. } | PieceShape::Plank { .. } => None,
        }
    }

    /// Least and greatest coordinates, m.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        if let PieceShape::Pool(pool) = self.shape {
            let (half_x, half_z) = pool.outline.half_extents();
            let reach = Vec3::new(half_x, 0.0, half_z);
            return (pool.centre - reach - Vec3::Y * pool.depth, pool.centre + reach);
        }
        let corners = self.triangles().into_iter().flat_map(|triangle| triangle.corners());
        corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), corner| (low.min(corner), high.max(corner)))
    }

    fn check(&self, extent: Vec3) -> Result<(), PieceError> {
        let name = || self.name.clone();
        if !(1..=MAX_NAME_LEN).contains(&self.name.len()) {
            return Err(PieceError::Name(self.name.len()));
        }
        let (places, sides, yaw): (Vec<Vec3>, Vec<(&'static str, f32)>, f32) = match self.shape {
            PieceShape::Block { foot, half: [x, z], height, yaw } => {
                (vec![foot], vec![("width", 2.0 * x), ("depth", 2.0 * z), ("height", height)], yaw)
            }
            PieceShape::Plank { from, to, width, thickness } => {
                let run = hypot(to.x - from.x, to.z - from.z);
                (vec![from, to], vec![("width", width), ("thickness", thickness), ("horizontal length", run)], 0.0)
            }
            PieceShape::Pool(Pool { centre, outline, depth, liquid: Liquid::Water | Liquid::Lava }) => {
                let sides = match outline {
                    Outline::Round { radius } => vec![("radius", radius), ("depth", depth)],
                    Outline::Rectangle { half_x, half_z } => {
                        vec![("width", 2.0 * half_x), ("length", 2.0 * half_z), ("depth", depth)]
                    }
                };
                (vec![centre], sides, 0.0)
            }
        };
        if !yaw.is_finite() || places.iter().any(|place| !place.is_finite()) {
            return Err(PieceError::NotFinite(name()));
        }
        // False for NaN.
        if let Some(&(field, value)) = sides.iter().find(|(_, value)| !SIDES_M.contains(value)) {
            return Err(PieceError::Side { name: name(), field, value });
        }
        let (low, high) = self.bounds();
        let rim = Vec3::splat(RIM_M);
        // Below the map there is nothing that a pool could cover. NaN, of corners beyond all numbers, is not within.
        let least = Vec3::new(-RIM_M, -CELLAR_M - RIM_M, -RIM_M);
        let is_within = high.cmple(extent + rim).all() && low.cmpge(least).all() && high.y >= 0.0;
        if is_within { Ok(()) } else { Err(PieceError::Outside { name: name(), extent: extent.to_array() }) }
    }
}

/// Sorts the pieces of a map of this extent, m, by name, and checks them.
///
/// # Errors
/// If one of them is not valid, or they are too many.
pub fn arrange(pieces: &mut [Piece], extent: Vec3) -> Result<(), PieceError> {
    pieces.sort_by(|one, other| one.name.cmp(&other.name));
    if pieces.len() > MAX_PIECES {
        return Err(PieceError::TooMany(pieces.len()));
    }
    let mut names = BTreeSet::new();
    let mut covered = 0.0;
    for piece in &*pieces {
        piece.check(extent)?;
        let (low, high) = piece.bounds();
        covered += f64::from(high.x - low.x) * f64::from(high.z - low.z);
        if !names.insert(&piece.name) {
            return Err(PieceError::Twice(piece.name.clone()));
        }
    }
    if covered > MAX_COVERED_M2 { Err(PieceError::TooLarge(covered)) } else { Ok(()) }
}
