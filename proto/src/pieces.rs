//! Conversions of pieces between the wire and the world. The map checks the ranges of their numbers.

use crate::convert::{FieldError, point, to_wire};
use crate::world::v1 as wire;
use surefoot_world::Vec3;
use surefoot_world::map::piece::MAX_PIECES;
use surefoot_world::map::{Liquid, Outline, Piece, PieceShape, Pool};

/// Default thickness of a plank, and default depth of a pool, m.
const THICKNESS_M: f32 = 0.3;
const DEPTH_M: f32 = 1.0;

/// Reads pieces.
pub fn pieces(list: &[wire::Piece], field: &'static str) -> Result<Vec<Piece>, FieldError> {
    if list.len() > MAX_PIECES {
        return Err(FieldError::Count { field, what: "pieces", found: list.len(), limit: MAX_PIECES });
    }
    list.iter().map(piece).collect()
}

fn piece(piece: &wire::Piece) -> Result<Piece, FieldError> {
    use wire::piece::Shape;
    let or = |value: f32, usual: f32| if value == 0.0 { usual } else { value };
    let shape = match piece.shape.as_ref().ok_or(FieldError::Missing("piece.shape"))? {
        Shape::Block(block) => PieceShape::Block {
            foot: point(block.foot.as_ref(), "piece.block.foot")?,
            half: [0.5 * block.width, 0.5 * block.depth],
            height: block.height,
            yaw: block.yaw,
        },
        Shape::Plank(plank) => PieceShape::Plank {
            from: point(plank.from.as_ref(), "piece.plank.from")?,
            to: point(plank.to.as_ref(), "piece.plank.to")?,
            width: plank.width,
            thickness: or(plank.thickness, THICKNESS_M),
        },
        Shape::Pool(pool) => PieceShape::Pool(Pool {
            centre: point(pool.centre.as_ref(), "piece.pool.centre")?,
            outline: if pool.round {
                Outline::Round { radius: pool.half_x }
            } else {
                Outline::Rectangle { half_x: pool.half_x, half_z: pool.half_z }
            },
            depth: or(pool.depth, DEPTH_M),
            liquid: if pool.lava { Liquid::Lava } else { Liquid::Water },
        }),
    };
    Ok(Piece { name: piece.name.clone(), shape })
}

/// Converts a piece to the wire.
pub fn piece_to_wire(piece: &Piece) -> wire::Piece {
    use wire::piece::Shape;
    let place = |place: Vec3| Some(to_wire(place));
    let shape = match piece.shape {
        PieceShape::Block { foot, half: [x, z], height, yaw } => {
            Shape::Block(wire::BlockPiece { foot: place(foot), width: 2.0 * x, depth: 2.0 * z, height, yaw })
        }
        PieceShape::Plank { from, to, width, thickness } => {
            Shape::Plank(wire::PlankPiece { from: place(from), to: place(to), width, thickness })
        }
        PieceShape::Pool(pool) => {
            let (half_x, half_z) = pool.outline.half_extents();
            let (round, lava) = (matches!(pool.outline, Outline::Round { .. }), pool.liquid == Liquid::Lava);
            let centre = place(pool.centre);
            Shape::Pool(wire::PoolPiece { centre, half_x, half_z, round, depth: pool.depth, lava })
        }
    };
    wire::Piece { name: piece.name.clone(), shape: Some(shape) }
}
