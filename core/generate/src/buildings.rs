//! Triangles of buildings: houses with storeys, and solid blocks.

use surefoot_world::map::{Block, Building};
use surefoot_world::mesh::{Surface, Triangle};

/// Thickness of walls, m.
const WALL_M: f32 = 0.35;
/// Depth to which walls reach into floors, m.
const OVERLAP_M: f32 = 0.1;
/// Thickness of floors and stairs, m.
const SLAB_M: f32 = 0.3;
/// Height from floor to floor, m.
pub(crate) const STOREY_M: f32 = 3.6;
/// Width of a flight of stairs, m.
const STAIR_WIDTH_M: f32 = 1.8;
/// Length of the landing at either end of a flight of stairs, m.
const LANDING_M: f32 = 1.7;
/// Horizontal length of a flight of stairs, m; with [`STOREY_M`] it rises at 31 degrees.
const STAIR_RUN_M: f32 = 6.0;
/// Half width and height of an outside opening at ground level, and of one above it or between rooms, m.
const DOOR: (f32, f32) = (1.1, 2.6);
const WINDOW: (f32, f32) = (0.9, 2.4);
/// Smallest half extents of a house, m, so that a flight of stairs and its landings fit.
pub(crate) const MIN_HOUSE_HALF: [f32; 2] =
    [WALL_M + LANDING_M + 0.5 * STAIR_RUN_M, WALL_M + STAIR_WIDTH_M + DOOR.0 + 0.3];
/// Depth of foundations below the ground floor, m.
const FOUNDATION_M: f32 = 4.0;

/// Adds all solid geometry of `buildings`.
pub(crate) fn add(buildings: &[Building], triangles: &mut Vec<Triangle>) {
    for building in buildings {
        for block in building_blocks(building) {
            for corners in block.triangles() {
                triangles.extend(Triangle::new(corners.map(|corner| building.to_map(corner)), Surface::Ground));
            }
        }
    }
}

/// The blocks of a building in the building's frame.
fn building_blocks(building: &Building) -> Vec<Block> {
    let [hx, hz] = building.half;
    if building.storeys == 0 {
        return vec![Block::new([-hx, -FOUNDATION_M, -hz], [hx, building.height, hz])];
    }
    let mut blocks = vec![Block::new([-hx, -FOUNDATION_M, -hz], [hx, 0.0, hz])];
    for storey in 0..building.storeys {
        let floor = f32::from(storey) * STOREY_M;
        let ceiling = floor + STOREY_M - SLAB_M;
        // Walls reach into the slabs above and below, so that no two faces coincide.
        let wall = [floor - OVERLAP_M, ceiling + OVERLAP_M];
        // Flights alternate between the two long walls and between the two directions.
        let side = if storey.is_multiple_of(2) { -1.0 } else { 1.0 };
        let has_stairs = storey + 1 < building.storeys || building.roof_stairs;
        add_long_walls(&mut blocks, [hx, hz], wall);
        let opening = if storey == 0 { DOOR } else { WINDOW };
        add_wall_across(&mut blocks, [-hx, -hx + WALL_M], [-hz, hz], wall, (opening.0, opening.1 + OVERLAP_M));
        if storey == 0 {
            add_wall_across(&mut blocks, [hx - WALL_M, hx], [-hz, hz], wall, (opening.0, opening.1 + OVERLAP_M));
        } else {
            blocks.push(Block::new([hx - WALL_M, wall[0], -hz], [hx, wall[1], hz]));
        }
        let room = hz - WALL_M - STAIR_WIDTH_M;
        if room > WINDOW.0 + 0.8 {
            add_wall_across(
                &mut blocks,
                [-0.5 * WALL_M, 0.5 * WALL_M],
                [-room, room],
                wall,
                (WINDOW.0, WINDOW.1 + OVERLAP_M),
            );
        }
        if has_stairs {
            add_stairs(&mut blocks, [hx, hz], floor, side);
        } else {
            blocks.push(Block::new([-hx, ceiling, -hz], [hx, ceiling + SLAB_M, hz]));
        }
    }
    blocks
}

/// Adds the two closed walls along x.
fn add_long_walls(blocks: &mut Vec<Block>, [hx, hz]: [f32; 2], [floor, ceiling]: [f32; 2]) {
    blocks.push(Block::new([-hx, floor, -hz], [hx, ceiling, -hz + WALL_M]));
    blocks.push(Block::new([-hx, floor, hz - WALL_M], [hx, ceiling, hz]));
}

/// Adds a wall along z with an opening (half width, height) in the middle.
fn add_wall_across(
    blocks: &mut Vec<Block>,
    [x0, x1]: [f32; 2],
    [z0, z1]: [f32; 2],
    [floor, ceiling]: [f32; 2],
    (half_width, height): (f32, f32),
) {
    blocks.push(Block::new([x0, floor, z0], [x1, ceiling, -half_width]));
    blocks.push(Block::new([x0, floor, half_width], [x1, ceiling, z1]));
    blocks.push(Block::new([x0, floor + height, -half_width], [x1, ceiling, half_width]));
}

/// Adds a flight of stairs (a ramp) along the wall on `side`, and the ceiling around the stairwell.
fn add_stairs(blocks: &mut Vec<Block>, [hx, hz]: [f32; 2], floor: f32, side: f32) {
    let (bottom, top) = (floor + STOREY_M - SLAB_M, floor + STOREY_M);
    let half_run = 0.5 * STAIR_RUN_M;
    let (near, far) = (hz - WALL_M - STAIR_WIDTH_M, hz);
    let z = |a: f32, b: f32| if side < 0.0 { (-b, -a) } else { (a, b) };
    let (z0, z1) = z(near, far);
    // Stairs rise towards +x on one side and towards -x on the other.
    let (low, rise) = if side < 0.0 { (floor, STOREY_M) } else { (floor + STOREY_M, -STOREY_M) };
    blocks.push(Block::new([-half_run, low - SLAB_M, z0], [half_run, low, z1]).rising(rise));
    blocks.push(Block::new([-hx, bottom, z0], [-half_run, top, z1]));
    blocks.push(Block::new([half_run, bottom, z0], [hx, top, z1]));
    let (rest0, rest1) = z(-hz, near);
    blocks.push(Block::new([-hx, bottom, rest0], [hx, top, rest1]));
}
