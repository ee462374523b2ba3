//! Maps that need moves: keeps with ladders and hatches, flooded caves, vents, rooftops with walls to run along, and
//! canyons with anchors. They are made for the body `acrobat`.

use super::Builder;
use super::tiles::Tiles;
use rand::RngExt;
use std::f32::consts::FRAC_PI_2;
use surefoot_world::Vec3;
use surefoot_world::map::spot::ANCHOR;
use surefoot_world::map::{Block, Liquid, Outline, Pool, Spot};
use surefoot_world::mesh::Surface;

/// Height of a storey of a keep, m: no jump reaches the next one.
const STOREY_M: f32 = 6.0;
const SLAB_M: f32 = 0.4;
/// Width and depth of a ladder, m.
const LADDER_M: [f32; 2] = [0.8, 0.1];
/// Width of the water around a keep, m, its depth, and how far its surface lies below the banks.
const MOAT_M: f32 = 7.0;
const MOAT_DEPTH_M: f32 = 3.5;
const BANK_M: f32 = 0.4;
/// Height of the rock between two caves above the bed of the water that joins them, m.
const SUMP_M: f32 = 2.4;
/// Height of a vent, m.
const VENT_M: f32 = 1.1;
/// Height of walls that nothing climbs, m, and the grade of their tops.
const HIGH_M: f32 = 5.0;
const STEEP: f32 = 2.0;
/// Height of an anchor above the higher one of two cliffs, m.
const ANCHOR_M: f32 = 5.5;

/// A side of a tile: the direction across it, and its half width to both sides.
const SIDES: [(Vec3, [isize; 2]); 2] = [(Vec3::X, [1, 0]), (Vec3::Z, [0, 1])];

impl Builder {
    /// A ladder whose foot is at `foot`, on a face that looks against `way`.
    fn add_ladder(&mut self, foot: Vec3, way: Vec3, height: f32) {
        let [width, depth] = LADDER_M.map(|it| 0.5 * it);
        let half = if way.x == 0.0 { [width, depth] } else { [depth, width] };
        let block = Block::new([-half[0], 0.0, -half[1]], [half[0], height, half[1]]);
        self.add_as(block, foot - way * depth, Surface::Climb);
    }

    /// Adds crates within `reach` metres of a place, now and then.
    fn add_crates(&mut self, top: Vec3, reach: f32) {
        while self.chance(0.4) {
            let mut aside = || self.rng.random_range(-1.0..1.0f32) * reach;
            let foot = top + Vec3::new(aside(), -0.1, aside());
            let half = self.rng.random_range(0.3..0.8);
            let height = self.rng.random_range(0.3..1.1);
            self.add_box(foot, [half, half], height);
        }
    }

    /// A wall across an axis, so thick and long on both sides of its foot. Its top is too steep to stand on.
    fn add_wall(&mut self, foot: Vec3, axis: usize, [thick, long]: [f32; 2], height: f32) {
        let half = if axis == 0 { [thick, long] } else { [long, thick] };
        self.add_box(foot, half, height);
        let rise = STEEP * 2.0 * thick;
        let ridge = Block::new([-thick, -rise - 0.1, -long], [thick, 0.01, long]).rising(rise);
        self.add(ridge, foot + Vec3::Y * height, if axis == 0 { 0.0 } else { FRAC_PI_2 });
    }

    /// Whether a tile is joined to the next one along each axis. Each has a way on, so all tiles are joined (a binary
    /// tree maze). Some have two.
    fn joins(&mut self, tiles: Tiles, tile: [usize; 2]) -> [bool; 2] {
        let is_last = |axis: usize| tile[axis] + 1 == tiles.counts[axis];
        let first = self.chance(0.5);
        let second = self.chance(0.35);
        match [is_last(0), is_last(1)] {
            [true, true] => [false, false],
            [true, false] => [false, true],
            [false, true] => [true, false],
            [false, false] => [first || second, !first || second],
        }
    }

    // --- keeps ---

    /// Towers in a moat, whose storeys are joined by ladders through hatches.
    pub(super) fn keeps(&mut self) {
        let tiles = self.tiles(44.0, 6);
        let (base, pitch) = (self.base(), tiles.pitch);
        for tile in tiles.all() {
            let middle = tiles.middle(tile).with_y(base);
            self.keep(middle, pitch);
        }
    }

    /// A keep around the middle of a square of `pitch` metres.
    fn keep(&mut self, middle: Vec3, pitch: f32) {
        /// Rooms along each side, and the side of one, m.
        const ROOMS: usize = 4;
        const ROOM_M: f32 = 4.0;
        let side = 0.5 * ROOMS as f32 * ROOM_M;
        let bank = side + 1.5;
        // Banks around the moat, its bed, and the rock that the keep stands on.
        let (outer, inner) = (0.5 * pitch, bank + MOAT_M);
        let width = 0.5 * (outer - inner);
        for sign in [-1.0, 1.0] {
            let along = sign * (inner + width);
            self.add_box(middle + Vec3::new(along, -8.0, 0.0), [width + 0.01, outer + 0.01], 8.0);
            self.add_box(middle + Vec3::new(0.0, -8.0, along), [outer + 0.01, width + 0.01], 8.0);
        }
        self.add_box(middle - Vec3::Y * 8.0, [inner + 0.1; 2], 8.0 - MOAT_DEPTH_M);
        self.add_box(middle - Vec3::Y * 8.0, [bank; 2], 8.0);
        let outline = Outline::Rectangle { half_x: inner, half_z: inner };
        let centre = middle - Vec3::Y * BANK_M;
        let depth = MOAT_DEPTH_M - BANK_M;
        self.placed.pools.push(Pool { centre, outline, depth, liquid: Liquid::Water });

        let room = |tile: [usize; 2], level: usize| {
            let [x, z] = tile.map(|it| (it as f32 + 0.5) * ROOM_M - side);
            middle + Vec3::new(x, level as f32 * STOREY_M, z)
        };
        let most = ((self.size.y - middle.y - 6.0) / STOREY_M) as usize;
        let storeys = self.rng.random_range(2..=4).min(most.max(1));
        let mut below = [usize::MAX; 2];
        for level in 1..=storeys {
            // A hatch beside a room with a floor, and not above the last one.
            let hatch = loop {
                let hatch = [self.rng.random_range(0..ROOMS - 1), self.rng.random_range(0..ROOMS)];
                if hatch != below && [hatch[0] + 1, hatch[1]] != below {
                    break hatch;
                }
            };
            for (column, row) in (0..ROOMS).flat_map(|row| (0..ROOMS).map(move |column| (column, row))) {
                if [column, row] != hatch {
                    let floor = room([column, row], level) - Vec3::Y * SLAB_M;
                    self.add_box(floor, [0.5 * ROOM_M + 0.01; 2], SLAB_M);
                }
            }
            let foot = room(hatch, level - 1) + Vec3::X * (0.5 * ROOM_M - 0.01);
            self.add_ladder(foot, Vec3::X, STOREY_M);
            self.add_keep_walls(middle + Vec3::Y * ((level - 1) as f32 * STOREY_M), side, level == 1);
            below = hatch;
        }
    }

    /// The outer walls of a storey; the lowest one has a gate.
    fn add_keep_walls(&mut self, middle: Vec3, side: f32, has_gate: bool) {
        let gate = if has_gate { self.rng.random_range(0..4) } else { 4 };
        for (idx, (way, sign)) in [(Vec3::X, 1.0), (Vec3::X, -1.0), (Vec3::Z, 1.0), (Vec3::Z, -1.0)].iter().enumerate()
        {
            let parts: &[(f32, f32)] = if idx == gate { &[(-1.0, -0.2), (0.2, 1.0)] } else { &[(-1.0, 1.0)] };
            for (from, to) in parts {
                let across = Vec3::new(way.z, 0.0, way.x);
                let centre = middle + *way * (sign * (side - 0.2)) + across * (0.5 * (from + to) * side);
                let (thin, long) = (0.2, 0.5 * (to - from) * side);
                let half = if way.x == 0.0 { [long, thin] } else { [thin, long] };
                self.add_box(centre - Vec3::Y * 0.05, half, STOREY_M - SLAB_M + 0.1);
            }
        }
    }

    // --- flooded caves ---

    /// Caves whose passages lie under water.
    pub(super) fn flooded_caves(&mut self) {
        /// Half of a cave's floor, and of a passage's width, m.
        const FLOOR_M: f32 = 5.0;
        const PASSAGE_M: f32 = 1.6;
        let tiles = self.tiles(18.0, 24);
        let (base, pitch) = (self.base(), tiles.pitch);
        let bed = base - MOAT_DEPTH_M;
        let reach = 0.5 * pitch - FLOOR_M;
        let joined: Vec<[bool; 2]> = tiles.all().map(|tile| self.joins(tiles, tile)).collect();
        for (idx, tile) in tiles.all().enumerate() {
            let middle = tiles.middle(tile).with_y(base);
            self.add_box(middle.with_y(bed - 2.0), [FLOOR_M; 2], base - bed + 2.0);
            self.add_crates(middle, 0.5 * FLOOR_M);
            for (axis, (way, [column, row])) in SIDES.into_iter().enumerate() {
                let across = Vec3::new(way.z, 0.0, way.x);
                let turned = |along: f32, aside: f32| if axis == 0 { [along, aside] } else { [aside, along] };
                let before = tiles.beside(tile, [-column, -row]);
                for (sign, is_open) in [(1.0, joined[idx][axis]), (-1.0, before.is_some_and(|it| joined[it][axis]))] {
                    let least = if is_open { PASSAGE_M } else { 0.0 };
                    for side in [-1.0, 1.0] {
                        let aside = side * 0.5 * (FLOOR_M + least);
                        let wall = middle + way * (sign * (FLOOR_M - 0.25)) + across * aside;
                        self.add_wall(wall - Vec3::Y * 0.05, axis, [0.25, 0.5 * (FLOOR_M - least)], HIGH_M);
                    }
                }
                if !joined[idx][axis] {
                    continue;
                }
                // The bed, the walls on both sides, and the rock that reaches down into the water.
                let centre = middle + way * (0.5 * pitch);
                self.add_box(centre.with_y(bed - 2.0), turned(reach, PASSAGE_M + 0.5), 2.0);
                for side in [-1.0, 1.0] {
                    let wall = centre + across * (side * (PASSAGE_M + 0.25));
                    self.add_wall(wall.with_y(bed - 0.1), 1 - axis, [0.25, reach], base - bed + HIGH_M);
                }
                let thick = self.rng.random_range(0.8..0.4 * reach);
                let above = base - bed + HIGH_M - SUMP_M;
                self.add_wall(centre.with_y(bed + SUMP_M), axis, [thick, PASSAGE_M + 0.1], above);
                let [half_x, half_z] = turned(reach, PASSAGE_M);
                let outline = Outline::Rectangle { half_x, half_z };
                let depth = base - BANK_M - bed;
                let centre = centre - Vec3::Y * BANK_M;
                self.placed.pools.push(Pool { centre, outline, depth, liquid: Liquid::Water });
            }
        }
    }

    // --- vents ---

    /// Rooms joined by vents that are lower than a person.
    pub(super) fn vents(&mut self) {
        let tiles = self.tiles(8.0, 24);
        let (base, pitch) = (self.base(), tiles.pitch);
        for tile in tiles.all() {
            let middle = tiles.middle(tile).with_y(base);
            self.add_box(middle - Vec3::Y * 2.0, [0.5 * pitch + 0.01; 2], 2.0);
            self.add_crates(middle, 0.25 * pitch);
            let joined = self.joins(tiles, tile);
            for (axis, (way, steps)) in SIDES.into_iter().enumerate() {
                if tiles.beside(tile, steps).is_none() {
                    continue;
                }
                let across = Vec3::new(way.z, 0.0, way.x);
                let centre = middle + way * (0.5 * pitch);
                let thick = self.rng.random_range(0.2..1.0);
                if !joined[axis] {
                    self.add_wall(centre - Vec3::Y * 0.05, axis, [thick, 0.5 * pitch], HIGH_M);
                    continue;
                }
                let at = self.rng.random_range(-0.25..0.25f32) * pitch;
                let half = self.rng.random_range(0.9..1.4);
                let (low, high) = (-0.5 * pitch, 0.5 * pitch);
                for (from, to) in [(low, at - half), (at + half, high)] {
                    let part = centre + across * (0.5 * (from + to)) - Vec3::Y * 0.05;
                    self.add_wall(part, axis, [thick, 0.5 * (to - from)], HIGH_M);
                }
                let lintel = centre + across * at + Vec3::Y * VENT_M;
                self.add_wall(lintel, axis, [thick, half + 0.01], HIGH_M - VENT_M - 0.05);
            }
        }
    }

    // --- rooftops ---

    /// Roofs with gaps that are too wide to jump, and walls along some of them.
    pub(super) fn rooftops(&mut self) {
        let tiles = self.tiles(22.0, 24);
        let pitch = tiles.pitch;
        let gap = |it: &mut Self| it.rng.random_range(8.6..9.2f32);
        let tops: Vec<(Vec3, f32)> = tiles
            .all()
            .map(|tile| {
                let rise = self.rng.random_range(-0.4..0.4f32);
                let top = tiles.middle(tile).with_y(self.base() + rise);
                (top, 0.5 * (pitch - gap(self)))
            })
            .collect();
        for (tile, &(top, half)) in tiles.all().zip(&tops) {
            self.add_box(top - Vec3::Y * 4.0, [half; 2], 4.0);
            let joined = self.joins(tiles, tile);
            for (axis, (way, steps)) in SIDES.into_iter().enumerate() {
                let Some(next) = tiles.beside(tile, steps).filter(|_| joined[axis]) else { continue };
                let across = Vec3::new(way.z, 0.0, way.x);
                let centre = top.midpoint(tops[next].0);
                let least = half.min(tops[next].1);
                let aside = (if self.chance(0.5) { 1.0 } else { -1.0 }) * self.rng.random_range(0.1..0.4f32) * least;
                let low = top.y.min(tops[next].0.y) - 1.0;
                self.add_wall((centre + across * aside).with_y(low), 1 - axis, [0.2, 0.36 * pitch], HIGH_M + 1.0);
            }
        }
    }

    // --- canyons ---

    /// Rocks that are too far from one another to jump, with anchors between them.
    pub(super) fn canyons(&mut self) {
        let tiles = self.tiles(24.0, 20);
        let pitch = tiles.pitch;
        let tops: Vec<(Vec3, f32)> = tiles
            .all()
            .map(|tile| {
                let rise = self.rng.random_range(-1.5..1.5f32);
                (tiles.middle(tile).with_y(self.base() + rise), 0.5 * (pitch - self.rng.random_range(9.0..12.0f32)))
            })
            .collect();
        for (tile, &(top, half)) in tiles.all().zip(&tops) {
            self.add_box(top - Vec3::Y * 6.0, [half; 2], 6.0);
            let joined = self.joins(tiles, tile);
            for (axis, (_, steps)) in SIDES.into_iter().enumerate() {
                let Some(next) = tiles.beside(tile, steps).filter(|_| joined[axis]) else { continue };
                let other = tops[next].0;
                let from = top.midpoint(other).with_y(top.y.max(other.y) + ANCHOR_M);
                self.placed.spots.push(Spot { tag: ANCHOR.to_owned(), from, to: None, two_way: false });
            }
        }
    }
}
