//! Maps that are built of blocks instead of shaped as terrain: islands, towers, arenas and interiors. Beyond and
//! between the blocks there is nothing: what falls there is lost.

use noise::{NoiseFn, Perlin};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::{FRAC_PI_2, TAU};
use surefoot_world::Vec3;
use surefoot_world::float::hypot;
use surefoot_world::map::{Block, MapKind, MapSpec};
use surefoot_world::mesh::{Surface, Triangle};

/// Scales of built maps, one of which is drawn for each: 1 is made for people, larger ones for giants.
const SCALES: [f32; 5] = [0.8, 1.0, 1.0, 1.6, 2.5];
/// Free space between what is built and the limits of the map, m.
const RIM_M: f32 = 6.0;
/// Steepest ramp, as rise over run.
const MAX_GRADE: f32 = 0.55;
/// Height that a double jump climbs with some to spare, m.
const CLIMB_M: f32 = 4.0;
/// Greatest difference in height of rolling ground, m.
const MAX_RELIEF_M: f32 = 24.0;
/// Height of the lowest ground as a share of the map's.
const BASE_SHARE: f32 = 0.3;

/// The solid triangles of a built map; `None` for kinds that are terrain.
pub(crate) fn triangles(spec: &MapSpec) -> Option<Vec<Triangle>> {
    let mut builder = Builder::new(spec);
    match spec.kind {
        MapKind::Terrain | MapKind::Open => return None,
        MapKind::Islands => builder.islands(),
        MapKind::Interior => builder.interior(),
        MapKind::Arena => builder.arena(),
        MapKind::Tower => builder.towers(),
    }
    Some(builder.triangles)
}

/// A level platform.
#[derive(Debug, Clone, Copy)]
struct Platform {
    /// Middle of the top, m.
    top: Vec3,
    /// Half extents along x and z before it is turned, m.
    half: [f32; 2],
    yaw: f32,
}

impl Platform {
    /// The point of the top farthest towards `other`, a little inside the edge.
    fn edge_towards(&self, other: Vec3) -> Vec3 {
        let (sin, cos) = libm::sincosf(self.yaw);
        let (dx, dz) = (other.x - self.top.x, other.z - self.top.z);
        let (u, v) = (dx * cos - dz * sin, dx * sin + dz * cos);
        let share = (self.half[0] / u.abs().max(1.0e-3)).min(self.half[1] / v.abs().max(1.0e-3)).min(1.0) * 0.97;
        self.top + Vec3::new(dx * share, 0.0, dz * share)
    }
}

struct Builder {
    rng: ChaCha8Rng,
    size: Vec3,
    scale: f32,
    relief: Perlin,
    triangles: Vec<Triangle>,
}

impl Builder {
    fn new(spec: &MapSpec) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(3);
        let scale = SCALES[rng.random_range(0..SCALES.len())];
        let relief = Perlin::new(rng.random());
        Self { rng, size: spec.size.extent(), scale, relief, triangles: Vec::new() }
    }

    fn chance(&mut self, probability: f64) -> bool {
        self.rng.random_bool(probability)
    }

    /// A length between two lengths at scale 1, m.
    fn length(&mut self, low: f32, high: f32) -> f32 {
        self.scale * self.rng.random_range(low..high)
    }

    /// Height of rolling ground above its lowest, m, up to `range`.
    fn relief(&self, x: f32, z: f32, range: f32) -> f32 {
        const WAVELENGTH_M: f64 = 70.0;
        let noise = self.relief.get([f64::from(x) / WAVELENGTH_M, f64::from(z) / WAVELENGTH_M]) as f32;
        (0.5 + 0.7 * noise).clamp(0.0, 1.0) * range
    }

    fn base(&self) -> f32 {
        BASE_SHARE * self.size.y
    }

    /// Adds a block that is turned by `yaw` and then moved to `at`.
    fn add(&mut self, block: Block, at: Vec3, yaw: f32) {
        let placed = block.placed(at, yaw);
        self.triangles.extend(placed.filter_map(|corners| Triangle::new(corners, Surface::Ground)));
    }

    /// Adds an upright block whose top has its middle at `top`.
    fn add_platform(&mut self, platform: Platform, thickness: f32) {
        let [x, z] = platform.half;
        self.add(Block::new([-x, -thickness, -z], [x, 0.0, z]), platform.top, platform.yaw);
    }

    /// Adds an upright block without a turn, given the middle of its bottom.
    fn add_box(&mut self, foot: Vec3, half: [f32; 2], height: f32) {
        self.add(Block::new([-half[0], 0.0, -half[1]], [half[0], height, half[1]]), foot, 0.0);
    }

    /// Adds a plank whose top leads from one point to the other.
    fn add_plank(&mut self, from: Vec3, to: Vec3, width: f32, thickness: f32) {
        let (block, middle, yaw) = Block::plank(from, to, width, thickness);
        self.add(block, middle, yaw);
    }

    /// Cells of `pitch` metres that fit into the map, as the number along x and z and the corner of the first.
    fn cells(&self, pitch: f32, most: usize) -> ([usize; 2], [f32; 2]) {
        let count = |side: f32| (((side - 2.0 * RIM_M) / pitch) as usize).clamp(1, most);
        let counts = [count(self.size.x), count(self.size.z)];
        let corner = |side: f32, count: usize| 0.5 * (side - count as f32 * pitch);
        (counts, [corner(self.size.x, counts[0]), corner(self.size.z, counts[1])])
    }

    // --- islands ---

    /// Platforms over a void, joined by bridges, beams, stepping stones, or jumps.
    fn islands(&mut self) {
        let pitch = 15.0 * self.scale;
        let ([columns, rows], [x0, z0]) = self.cells(pitch, 64);
        let range = (0.3 * self.size.y).min(MAX_RELIEF_M);
        let mut platforms = vec![None; columns * rows];
        for row in 0..rows {
            for column in 0..columns {
                let mut jitter = || self.rng.random_range(-0.18..0.18f32) * pitch;
                let x = x0 + (column as f32 + 0.5) * pitch + jitter();
                let z = z0 + (row as f32 + 0.5) * pitch + jitter();
                if self.chance(0.08) {
                    continue;
                }
                let y = self.base() + self.relief(x, z, range) + self.rng.random_range(-1.5..1.5f32);
                let half = [self.length(1.5, 4.6), self.length(1.5, 4.6)];
                let platform = Platform { top: Vec3::new(x, y, z), half, yaw: self.rng.random_range(0.0..TAU) };
                let thickness = self.length(0.5, 4.0);
                self.add_platform(platform, thickness);
                if self.chance(0.2) {
                    let (side, height) = (self.length(0.4, 1.2), self.length(0.5, 2.5));
                    self.add_box(platform.top - Vec3::Y * 0.1, [side, side], height);
                }
                platforms[row * columns + column] = Some(platform);
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let at = |column: usize, row: usize| {
                    (column < columns && row < rows).then(|| platforms[row * columns + column]).flatten()
                };
                let Some(here) = at(column, row) else { continue };
                for there in [at(column + 1, row), at(column, row + 1)].into_iter().flatten() {
                    self.join(&here, &there);
                }
            }
        }
    }

    /// Joins two platforms by something, or leaves the gap.
    fn join(&mut self, here: &Platform, there: &Platform) {
        let (from, to) = (here.edge_towards(there.top), there.edge_towards(here.top));
        let run = hypot(to.x - from.x, to.z - from.z);
        if run < 0.3 {
            return;
        }
        let is_gentle = (to.y - from.y).abs() < MAX_GRADE * run;
        match self.rng.random_range(0..10) {
            0..4 if is_gentle => {
                let width = self.length(1.2, 3.0);
                self.add_plank(from, to, width, 0.4);
            }
            4 if is_gentle => self.add_plank(from, to, 0.7 * self.scale, 0.5),
            5..8 => self.add_stones(from, to, run),
            _ => {}
        }
    }

    /// Adds stepping stones between two points, at heights between theirs.
    fn add_stones(&mut self, from: Vec3, to: Vec3, run: f32) {
        let count = (run / self.length(2.0, 5.0)) as usize;
        for stone in 1..=count {
            let top = from.lerp(to, stone as f32 / (count + 1) as f32) + Vec3::Y * self.rng.random_range(-0.6..0.6);
            let half = self.length(0.5, 1.1);
            let yaw = self.rng.random_range(0.0..TAU);
            self.add_platform(Platform { top, half: [half, half], yaw }, 1.0);
        }
    }

    // --- towers ---

    /// Towers with ledges that wind up around them, joined by planks high up.
    fn towers(&mut self) {
        let pitch = 30.0 * self.scale.max(1.0);
        let ([columns, rows], [x0, z0]) = self.cells(pitch, 12);
        let mut ledges: Vec<Vec<Platform>> = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let foot = Vec3::new(
                    x0 + (column as f32 + 0.5) * pitch,
                    self.base() + self.rng.random_range(-4.0..4.0f32),
                    z0 + (row as f32 + 0.5) * pitch,
                );
                let tower = self.tower(foot);
                let neighbours = [(column > 0).then(|| ledges.len() - 1), ledges.len().checked_sub(columns)];
                neighbours.into_iter().flatten().for_each(|other| self.span(&tower, &ledges[other]));
                ledges.push(tower);
            }
        }
    }

    /// Adds one tower and returns its ledges, its foot first.
    fn tower(&mut self, foot: Vec3) -> Vec<Platform> {
        let core = self.length(1.6, 3.6);
        let ground = Platform { top: foot, half: [core + self.length(2.0, 5.0); 2], yaw: 0.0 };
        let thickness = self.length(1.0, 4.0);
        self.add_platform(ground, thickness);
        let top = (foot.y + self.rng.random_range(8.0..40.0f32)).min(self.size.y - 8.0);
        self.add_box(foot - Vec3::Y * 0.5, [core, core], top - foot.y + 0.5);
        let mut ledges = vec![ground];
        let (mut height, mut angle) = (foot.y, self.rng.random_range(0.0..TAU));
        let turn = if self.chance(0.5) { 1.0 } else { -1.0 };
        loop {
            height +=
                if self.chance(0.8) { self.rng.random_range(0.5..2.2) } else { self.rng.random_range(2.2..CLIMB_M) };
            if height > top - 0.3 {
                break;
            }
            let (depth, half_width) = (self.length(0.9, 2.2), self.length(0.8, 2.2));
            let gap = self.rng.random_range(0.0..3.5f32);
            angle += turn * (2.0 * half_width + gap) / (core + 0.5 * depth) * 0.8;
            // Ledges stand out from the side that the angle faces.
            let side = (angle / FRAC_PI_2).round() * FRAC_PI_2;
            let (sin, cos) = libm::sincosf(side);
            let along = (libm::tanf(angle - side)).clamp(-1.0, 1.0) * core;
            let out = core + 0.5 * depth - 0.1;
            let offset = Vec3::new(out * cos + along * sin, 0.0, along * cos - out * sin);
            let ledge = Platform { top: foot.with_y(height) + offset, half: [0.5 * depth, half_width], yaw: side };
            self.add_platform(ledge, 0.4);
            if let Some(last) = ledges.last().filter(|_| ledges.len() > 1)
                && self.rng.random_bool(0.25)
            {
                let (from, to) = (last.edge_towards(ledge.top), ledge.edge_towards(last.top));
                if hypot(to.x - from.x, to.z - from.z) * MAX_GRADE > (to.y - from.y).abs() {
                    self.add_plank(from, to, 0.9 * self.scale, 0.3);
                }
            }
            ledges.push(ledge);
        }
        ledges.push(Platform { top: foot.with_y(top), half: [core; 2], yaw: 0.0 });
        ledges
    }

    /// Lays planks between ledges of two towers at nearly the same height.
    fn span(&mut self, one: &[Platform], other: &[Platform]) {
        for (nth, ledge) in one.iter().enumerate() {
            if nth > 0 && self.chance(0.7) {
                continue;
            }
            let far = |to: &&Platform| {
                (to.top.y - ledge.top.y).abs() < 0.3 * hypot(to.top.x - ledge.top.x, to.top.z - ledge.top.z)
            };
            let distance = |to: &Platform| to.top.distance_squared(ledge.top);
            let nearest = other.iter().filter(far).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(to) = nearest {
                let width = self.length(0.7, 2.2);
                self.add_plank(ledge.edge_towards(to.top), to.edge_towards(ledge.top), width, 0.4);
            }
        }
    }

    // --- arenas ---

    /// Tiles at a few levels with ramps between them, pits, crates and pillars, partly walled.
    fn arena(&mut self) {
        let pitch = 9.0 * self.scale;
        let ([columns, rows], [x0, z0]) = self.cells(pitch, 30);
        let storey = 2.2 * self.scale.min(1.6);
        let mut levels = vec![None; columns * rows];
        for row in 0..rows {
            for column in 0..columns {
                let (x, z) = (x0 + (column as f32 + 0.5) * pitch, z0 + (row as f32 + 0.5) * pitch);
                if self.chance(0.09) {
                    continue;
                }
                let level = (self.relief(1.6 * x, 1.6 * z, 3.9)).floor();
                let top = Vec3::new(x, self.base() + level * storey, z);
                levels[row * columns + column] = Some(top);
                // A hair of overlap, so that tiles of one level are joined.
                let half = 0.5 * pitch + 0.01;
                self.add_box(top - Vec3::Y * (3.0 + level * storey), [half, half], 3.0 + level * storey);
                self.furnish(top, 0.35 * pitch);
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let Some(here) = levels[row * columns + column] else { continue };
                for (dx, dz) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
                    let (x, z) = (column as i32 + dx, row as i32 + dz);
                    let is_inside = (0..columns as i32).contains(&x) && (0..rows as i32).contains(&z);
                    let there = is_inside.then(|| levels[z as usize * columns + x as usize]);
                    let way = Vec3::new(dx as f32, 0.0, dz as f32);
                    match there {
                        Some(Some(there)) => self.ramp_up(here, there, way, pitch),
                        Some(None) if self.chance(0.25) => {
                            // A bridge over the pit, if there is ground beyond.
                            let (x, z) = (column as i32 + 2 * dx, row as i32 + 2 * dz);
                            let is_inside = (0..columns as i32).contains(&x) && (0..rows as i32).contains(&z);
                            let beyond = is_inside.then(|| levels[z as usize * columns + x as usize]).flatten();
                            if let Some(beyond) = beyond {
                                let width = self.length(0.7, 2.5);
                                self.add_plank(here + way * 0.49 * pitch, beyond - way * 0.49 * pitch, width, 0.4);
                            }
                        }
                        None if self.chance(0.5) => {
                            let half = if dx == 0 { [0.5 * pitch, 0.15] } else { [0.15, 0.5 * pitch] };
                            let height = self.length(0.5, 3.0);
                            self.add_box(here + way * (0.5 * pitch - 0.15) - Vec3::Y * 0.1, half, height);
                        }
                        _ => {}
                    }
                }
            }
        }
    }

    /// Adds a ramp from a tile up to its neighbour, now and then.
    fn ramp_up(&mut self, here: Vec3, there: Vec3, way: Vec3, pitch: f32) {
        let rise = there.y - here.y;
        let run = rise / MAX_GRADE;
        if rise > 0.1 && run < 0.9 * pitch && self.chance(0.4) {
            let edge = here + way * 0.5 * pitch;
            let width = self.length(1.2, 3.5);
            let aside = Vec3::new(way.z, 0.0, way.x) * self.rng.random_range(-0.25..0.25f32) * pitch;
            self.add_plank(edge - way * run + aside, edge + Vec3::Y * rise + way * 0.05 + aside, width, 0.3);
        }
    }

    /// Adds crates and pillars within `reach` metres of a place, now and then.
    fn furnish(&mut self, top: Vec3, reach: f32) {
        while self.chance(0.3) {
            let mut aside = || self.rng.random_range(-1.0..1.0f32) * reach;
            let foot = top + Vec3::new(aside(), -0.1, aside());
            let half = self.length(0.3, 1.1);
            let height = if self.chance(0.2) { self.length(3.0, 6.0) } else { self.length(0.4, 2.4) };
            self.add_box(foot, [half, half], height);
        }
    }

    // --- interiors ---

    /// Rooms on several storeys with doorways, ramps and shafts.
    fn interior(&mut self) {
        let (pitch, storey) = (7.0 * self.scale, 3.2 * self.scale);
        let ([columns, rows], [x0, z0]) = self.cells(pitch, 16);
        let most = ((0.6 * self.size.y / storey) as usize).clamp(1, 4);
        let storeys = self.rng.random_range(1..=most);
        let (slab, wall) = (0.25 * self.scale, 0.15 * self.scale);
        // Flights of stairs by cell, of the storey below and of this one.
        let mut wells = vec![false; columns * rows];
        for level in 0..=storeys {
            let floor = self.base() + level as f32 * storey;
            let is_roof = level == storeys;
            let below = std::mem::replace(&mut wells, vec![false; columns * rows]);
            for row in 0..rows {
                for column in 0..columns {
                    let cell = row * columns + column;
                    let middle = Vec3::new(x0 + (column as f32 + 0.5) * pitch, floor, z0 + (row as f32 + 0.5) * pitch);
                    let is_shaft = level > 0 && self.chance(0.03);
                    if !below[cell] && !is_shaft {
                        self.add_box(middle - Vec3::Y * slab, [0.5 * pitch + 0.01; 2], slab);
                    }
                    if is_roof {
                        continue;
                    }
                    if !below[cell] && !is_shaft && self.chance(0.12) {
                        wells[cell] = true;
                        self.add_stairs(middle, pitch, storey);
                    } else if !below[cell] && self.chance(0.4) {
                        self.furnish(middle, 0.3 * pitch);
                    }
                    self.add_walls(middle, pitch, storey - slab, wall, [column, row], [columns, rows]);
                }
            }
        }
    }

    /// Adds a ramp or steps from a room's floor to the next storey, along a drawn direction.
    fn add_stairs(&mut self, middle: Vec3, pitch: f32, storey: f32) {
        let way = if self.chance(0.5) { Vec3::X } else { Vec3::Z } * if self.chance(0.5) { 1.0 } else { -1.0 };
        let half = 0.47 * pitch;
        let width = self.length(1.1, 2.5);
        let (from, to) = (middle - way * half, middle + way * half + Vec3::Y * storey);
        if self.chance(0.6) {
            self.add_plank(from, to, width, 0.25);
            return;
        }
        let count = (storey / self.rng.random_range(0.3..1.0f32)).ceil();
        for step in 1..=count as usize {
            let top = from.lerp(to, (step as f32 - 0.5) / count).with_y(from.y + storey * step as f32 / count);
            let (along, across) = (half / count + 0.01, 0.5 * width);
            let half = if way.x == 0.0 { [across, along] } else { [along, across] };
            self.add_platform(Platform { top, half, yaw: 0.0 }, storey / count + 0.2);
        }
    }

    /// Adds the walls on two sides of a room, and on the others where the house ends.
    fn add_walls(&mut self, middle: Vec3, pitch: f32, height: f32, wall: f32, cell: [usize; 2], counts: [usize; 2]) {
        let outer = |axis: usize| cell[axis] + 1 == counts[axis];
        // One way on from every room makes all of a storey's rooms one maze (a binary tree maze).
        let way_on = usize::from(outer(0) || !outer(1) && self.chance(0.5));
        for (axis, sign, is_outer) in [(0, 1.0, outer(0)), (1, 1.0, outer(1)), (0, -1.0, true), (1, -1.0, true)] {
            if sign < 0.0 && cell[axis] > 0 {
                continue;
            }
            let kind: u32 = self.rng.random_range(0..20);
            // Outside, most walls are closed; inside, most have a doorway, and some rooms are one.
            let (closed, with_door) = if is_outer { (12, 17) } else { (5, 16) };
            if kind >= with_door {
                continue;
            }
            let way = if axis == 0 { Vec3::X } else { Vec3::Z };
            let centre = middle + way * (sign * 0.5 * pitch);
            let yaw = if axis == 0 { FRAC_PI_2 } else { 0.0 };
            let side = 0.5 * pitch;
            let mut blocks = Vec::with_capacity(3);
            if kind < closed && (is_outer || axis != way_on) {
                blocks.push((-side, side, -0.05));
            } else {
                let half_door = self.length(0.5, 1.3);
                let free = (side - half_door - 0.3).max(0.01);
                let at = self.rng.random_range(-free..free);
                let lintel = self.length(2.0, 2.7).min(height - 0.1);
                blocks.extend([(-side, at - half_door, -0.05), (at + half_door, side, -0.05)]);
                blocks.push((at - half_door, at + half_door, lintel));
            }
            for (from, to, low) in blocks {
                self.add(Block::new([from, low, -wall], [to, height + 0.05, wall]), centre, yaw);
            }
        }
    }
}
