//! Where a level lies on its map, and how large the map is.

use crate::load::is_allowed;
use surefoot_world::map::MapSize;
use surefoot_world::map::spec::{MAX_HEIGHT_M, MAX_SIDE_M};
use surefoot_world::{Aabb, Vec3};

/// Space left around a level, m.
const MARGIN_M: f32 = 2.0;
/// Height of a level's lowest point on the map, m: what falls below 0 has left the map.
const LOWEST_M: f32 = 1.0;
/// Space left above a level, m.
const HEADROOM_M: f32 = 20.0;
/// Excess of a level over a whole metre that counts as a rounding error, m.
const ROUNDING_M: f32 = 0.001;
/// Largest distance by which an exported map's triangles may stick out of its box if the map is to keep its size, m.
const STICK_OUT_M: f32 = 5.0;

/// Position of a level on its map.
pub(super) struct Place {
    /// Translation from the coordinates in which the level was read, m, to the map's.
    pub shift: Vec3,
    pub size: MapSize,
    /// Bounds of the level before the shift, m.
    pub low: Vec3,
    pub high: Vec3,
    /// Whether the level keeps the position that it was exported from.
    pub is_former: bool,
}

impl Place {
    /// Places a level with these bounds, or as the map of size `former` that it was exported from. `Err` is the extent
    /// of a level that is too large.
    pub fn new(bounds: Aabb, former: Option<MapSize>) -> Result<Self, Vec3> {
        let Aabb { low, high } = bounds;
        if let Some(size) = former.filter(|&size| is_allowed(size)) {
            let extent = size.extent();
            let slack = Vec3::splat(STICK_OUT_M);
            if low.cmpge(-slack).all() && high.cmple(extent + slack).all() {
                return Ok(Self { shift: Vec3::ZERO, size, low: Vec3::ZERO, high: extent, is_former: true });
            }
        }
        let span = high - low;
        let (most_wide, most_high) = (MAX_SIDE_M as f32, MAX_HEIGHT_M as f32);
        if span.x > most_wide || span.y + LOWEST_M > most_high || span.z > most_wide {
            return Err(span);
        }
        // The largest levels get smaller margins.
        let margin = |span: f32| (0.5 * (most_wide - span)).min(MARGIN_M);
        let (margin_x, margin_z) = (margin(span.x), margin(span.z));
        let whole = |metres: f32, most: f32| (metres - ROUNDING_M).ceil().clamp(1.0, most) as u32;
        let size = MapSize {
            width: whole(span.x + 2.0 * margin_x, most_wide),
            height: whole(LOWEST_M + span.y + HEADROOM_M, most_high),
            depth: whole(span.z + 2.0 * margin_z, most_wide),
        };
        let shift = Vec3::new(margin_x, LOWEST_M, margin_z) - low;
        Ok(Self { shift, size, low, high, is_former: false })
    }
}
