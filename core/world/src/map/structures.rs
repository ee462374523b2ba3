//! Triangles of structures: houses, blocks, the surfaces of pools and the discs of devices.

use super::features::{Building, DISC_RADIUS_M, Outline, Placed, Pool};
use crate::Vec3;
use crate::float::{hypot, turned};
use crate::mesh::{Surface, Triangle};
use std::f32::consts::TAU;

/// Thickness of walls, m.
const WALL_M: f32 = 0.35;
/// Depth to which walls reach into floors, m.
const OVERLAP_M: f32 = 0.1;
/// Thickness of floors and stairs, m.
const SLAB_M: f32 = 0.3;
/// Height from floor to floor, m.
pub(super) const STOREY_M: f32 = 3.6;
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
pub(super) const MIN_HOUSE_HALF: [f32; 2] =
    [WALL_M + LANDING_M + 0.5 * STAIR_RUN_M, WALL_M + STAIR_WIDTH_M + DOOR.0 + 0.3];
/// Depth of foundations below the ground floor, m.
const FOUNDATION_M: f32 = 4.0;
/// Height of a device's disc above the device's centre, m.
const DISC_LIFT_M: f32 = 0.12;
/// Number of triangles of a disc.
const DISC_SIDES: usize = 16;

/// Adds all solid geometry of `buildings`.
pub(super) fn add_buildings(buildings: &[Building], triangles: &mut Vec<Triangle>) {
    for building in buildings {
        for block in building_blocks(building) {
            for corners in block.triangles() {
                triangles.extend(Triangle::new(corners.map(|corner| building.to_map(corner)), Surface::Ground));
            }
        }
    }
}

/// Adds what rays hit and bodies pass through: surfaces of pools and discs of devices.
pub(super) fn add_surfaces(placed: &Placed, triangles: &mut Vec<Triangle>) {
    add_pools(&placed.pools, triangles);
    let lift = Vec3::new(0.0, DISC_LIFT_M, 0.0);
    let mut device = |centre: Vec3, surface| add_disc(triangles, centre + lift, DISC_RADIUS_M, surface);
    placed.pads.iter().for_each(|pad| device(pad.centre, Surface::Pad));
    placed.zip_lines.iter().for_each(|line| device(line.from, Surface::ZipLine));
    for teleporter in &placed.teleporters {
        device(teleporter.from, Surface::Teleporter);
        if teleporter.two_way {
            device(teleporter.to, Surface::Teleporter);
        }
    }
    placed.jetpacks.iter().for_each(|jetpack| device(jetpack.centre, Surface::Jetpack));
}

/// Adds the surfaces of pools.
pub(super) fn add_pools(pools: &[Pool], triangles: &mut Vec<Triangle>) {
    for pool in pools {
        let surface = pool.liquid.into();
        match pool.outline {
            Outline::Round { radius } => add_disc(triangles, pool.centre, radius, surface),
            Outline::Rectangle { half_x, half_z } => {
                let corner = |x: f32, z: f32| pool.centre + Vec3::new(x * half_x, 0.0, z * half_z);
                let [a, b, c, d] = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
                triangles.extend([[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, surface)));
            }
        }
    }
}

/// Adds a horizontal disc as a triangle fan that faces up.
fn add_disc(triangles: &mut Vec<Triangle>, centre: Vec3, radius: f32, surface: Surface) {
    let rim = |i: usize| {
        let (sin, cos) = libm::sincosf(i as f32 * TAU / DISC_SIDES as f32);
        centre + Vec3::new(sin * radius, 0.0, cos * radius)
    };
    triangles.extend((0..DISC_SIDES).filter_map(|i| Triangle::new([centre, rim(i), rim(i + 1)], surface)));
}

/// A box whose top and bottom may slant along x.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    min: Vec3,
    max: Vec3,
    /// Height added to top and bottom at `max.x`, m.
    rise: f32,
}

impl Block {
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
