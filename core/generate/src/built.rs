//! Maps that are built of blocks instead of shaped as terrain: islands, towers, arenas, interiors, and those that need
//! moves. Beyond and between the blocks there is nothing: what falls there is lost.

mod courses;
mod tiles;

use noise::{NoiseFn, Perlin};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::{FRAC_PI_2, TAU};
use surefoot_world::Vec3;
use surefoot_world::float::hypot;
use surefoot_world::map::{Block, MapKind, MapSpec, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use tiles::Tiles;

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

/// The solid triangles of a built map, and what is placed on it; `None` for kinds that are terrain.
pub(crate) fn triangles(spec: &MapSpec) -> Option<(Vec<Triangle>, Placed)> {
    let mut builder = Builder::new(spec);
    if MapKind::COURSES.contains(&spec.kind) {
        // Their gaps and heights are those of one body.
        builder.scale = 1.0;
    }
    match spec.kind {
        MapKind::Terrain | MapKind::Open => return None,
        MapKind::Islands => builder.islands(),
        MapKind::Interior => builder.interior(),
        MapKind::Arena => builder.arena(),
        MapKind::Tower => builder.towers(),
        MapKind::Keep => builder.keeps(),
        MapKind::Flooded => builder.flooded_caves(),
        MapKind::Vents => builder.vents(),
        MapKind::Rooftops => builder.rooftops(),
        MapKind::Canyon => builder.canyons(),
    }
    Some((builder.triangles, builder.placed))
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
    placed: Placed,
}

impl Builder {
    fn new(spec: &MapSpec) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(3);
        let scale = SCALES[rng.random_range(0..SCALES.len())];
        let relief = Perlin::new(rng.random());
        Self { rng, size: spec.size.extent(), scale, relief, triangles: Vec::new(), placed: Placed::default() }
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

    /// Adds a block with a surface that is moved to `at`.
    fn add_as(&mut self, block: Block, at: Vec3, surface: Surface) {
        self.triangles.extend(block.placed(at, 0.0).filter_map(|corners| Triangle::new(corners, surface)));
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

    /// The tiles of `pitch` metres that fit into the map, at most `most` along each side.
    fn tiles(&self, pitch: f32, most: usize) -> Tiles {
        let sides = [self.size.x, self.size.z];
        let counts = sides.map(|side| (((side - 2.0 * RIM_M) / pitch) as usize).clamp(1, most));
        Tiles { pitch, counts, corner: [0, 1].map(|axis| 0.5 * (sides[axis] - counts[axis] as f32 * pitch)) }
    }

    // --- islands ---

    /// Platforms over a void, joined by bridges, beams, stepping stones, or jumps.
    fn islands(&mut self) {
        let tiles = self.tiles(15.0 * self.scale, 64);
        let islands: Vec<_> = tiles.all().map(|tile| self.island(tiles.middle(tile), tiles.pitch)).collect();
        for (tile, island) in tiles.all().zip(&islands) {
            let Some(here) = island else { continue };
            let neighbours = [[1, 0], [0, 1]].into_iter().filter_map(|steps| tiles.beside(tile, steps));
            neighbours.filter_map(|there| islands[there]).for_each(|there| self.join(here, &there));
        }
    }

    /// Adds a platform near the middle of a tile, or leaves the tile empty.
    fn island(&mut self, middle: Vec3, pitch: f32) -> Option<Platform> {
        let mut jitter = || self.rng.random_range(-0.18..0.18f32) * pitch;
        let (x, z) = (middle.x + jitter(), middle.z + jitter());
        if self.chance(0.08) {
            return None;
        }
        let range = (0.3 * self.size.y).min(MAX_RELIEF_M);
        let y = self.base() + self.relief(x, z, range) + self.rng.random_range(-1.5..1.5f32);
        let half = [self.length(1.5, 4.6), self.length(1.5, 4.6)];
        let platform = Platform { top: Vec3::new(x, y, z), half, yaw: self.rng.random_range(0.0..TAU) };
        let thickness = self.length(0.5, 4.0);
        self.add_platform(platform, thickness);
        if self.chance(0.2) {
            let (side, height) = (self.length(0.4, 1.2), self.length(0.5, 2.5));
            self.add_box(platform.top - Vec3::Y * 0.1, [side, side], height);
        }
        Some(platform)
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
        let tiles = self.tiles(30.0 * self.scale.max(1.0), 12);
        let mut ledges: Vec<Vec<Platform>> = Vec::new();
        for tile in tiles.all() {
            let tower = self.tower(tiles.middle(tile));
            let neighbours = [[-1, 0], [0, -1]].into_iter().filter_map(|steps| tiles.beside(tile, steps));
            neighbours.for_each(|other| self.span(&tower, &ledges[other]));
            ledges.push(tower);
        }
    }

    /// Adds one tower and returns its ledges, its foot first.
    fn tower(&mut self, middle: Vec3) -> Vec<Platform> {
        let foot = middle.with_y(self.base() + self.rng.random_range(-4.0..4.0f32));
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
        let tiles = self.tiles(9.0 * self.scale, 30);
        let tops: Vec<_> = tiles.all().map(|tile| self.arena_tile(tiles.middle(tile), tiles.pitch)).collect();
        for (tile, top) in tiles.all().zip(&tops) {
            let Some(here) = *top else { continue };
            for [columns, rows] in [[1, 0], [0, 1], [-1, 0], [0, -1]] {
                let at = |far: isize| tiles.beside(tile, [far * columns, far * rows]).map(|idx| tops[idx]);
                self.arena_side(here, [at(1), at(2)], Vec3::new(columns as f32, 0.0, rows as f32), tiles.pitch);
            }
        }
    }

    /// Adds a tile of an arena and returns the middle of its top, or leaves a pit.
    fn arena_tile(&mut self, middle: Vec3, pitch: f32) -> Option<Vec3> {
        if self.chance(0.09) {
            return None;
        }
        let rise = self.relief(1.6 * middle.x, 1.6 * middle.z, 3.9).floor() * (2.2 * self.scale.min(1.6));
        let top = middle.with_y(self.base() + rise);
        // A hair of overlap, so that tiles of one level are joined.
        let half = 0.5 * pitch + 0.01;
        self.add_box(top - Vec3::Y * (3.0 + rise), [half, half], 3.0 + rise);
        self.furnish(top, 0.35 * pitch);
        Some(top)
    }

    /// Adds a ramp, a bridge over a pit, or a wall at the border to one side of a tile, now and then. `ahead` are the
    /// tops of the next two tiles on that side: `None` beyond the border, and `Some(None)` for a pit.
    fn arena_side(&mut self, here: Vec3, ahead: [Option<Option<Vec3>>; 2], way: Vec3, pitch: f32) {
        match ahead {
            [Some(Some(there)), _] => self.ramp_up(here, there, way, pitch),
            [Some(None), beyond] if self.chance(0.25) => {
                if let Some(beyond) = beyond.flatten() {
                    let width = self.length(0.7, 2.5);
                    self.add_plank(here + way * 0.49 * pitch, beyond - way * 0.49 * pitch, width, 0.4);
                }
            }
            [None, _] if self.chance(0.5) => {
                let half = if way.x == 0.0 { [0.5 * pitch, 0.15] } else { [0.15, 0.5 * pitch] };
                let height = self.length(0.5, 3.0);
                self.add_box(here + way * (0.5 * pitch - 0.15) - Vec3::Y * 0.1, half, height);
            }
            _ => {}
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
        let (tiles, storey, slab) = (self.tiles(7.0 * self.scale, 16), 3.2 * self.scale, 0.25 * self.scale);
        let pitch = tiles.pitch;
        let most = ((0.6 * self.size.y / storey) as usize).clamp(1, 4);
        let storeys = self.rng.random_range(1..=most);
        // Whether stairs lead up from each room, of the storey below and of this one.
        let mut wells = vec![false; tiles.all().count()];
        for level in 0..=storeys {
            let below = std::mem::take(&mut wells);
            wells.resize(below.len(), false);
            for (tile, (is_open, well)) in tiles.all().zip(below.into_iter().zip(&mut wells)) {
                let middle = tiles.middle(tile).with_y(self.base() + level as f32 * storey);
                let is_shaft = level > 0 && self.chance(0.03);
                if !is_open && !is_shaft {
                    self.add_box(middle - Vec3::Y * slab, [0.5 * pitch + 0.01; 2], slab);
                }
                if level == storeys {
                    continue;
                }
                if !is_open && !is_shaft && self.chance(0.12) {
                    *well = true;
                    self.add_stairs(middle, pitch, storey);
                } else if !is_open && self.chance(0.4) {
                    self.furnish(middle, 0.3 * pitch);
                }
                self.add_walls(middle, storey - slab, tiles, tile);
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
    fn add_walls(&mut self, middle: Vec3, height: f32, tiles: Tiles, tile: [usize; 2]) {
        let (side, wall) = (0.5 * tiles.pitch, 0.15 * self.scale);
        let outer = |axis: usize| tile[axis] + 1 == tiles.counts[axis];
        // One way on from every room makes all of a storey's rooms one maze (a binary tree maze).
        let way_on = usize::from(outer(0) || !outer(1) && self.chance(0.5));
        for (axis, sign, is_outer) in [(0, 1.0, outer(0)), (1, 1.0, outer(1)), (0, -1.0, true), (1, -1.0, true)] {
            if sign < 0.0 && tile[axis] > 0 {
                continue;
            }
            let kind: u32 = self.rng.random_range(0..20);
            // Outside, most walls are closed; inside, most have a doorway, and some rooms are one.
            let (closed, with_door) = if is_outer { (12, 17) } else { (5, 16) };
            if kind >= with_door {
                continue;
            }
            let way = if axis == 0 { Vec3::X } else { Vec3::Z };
            let centre = middle + way * (sign * 0.5 * tiles.pitch);
            let yaw = if axis == 0 { FRAC_PI_2 } else { 0.0 };
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
