//! Finds links between islands by simulating leaps at their borders and rides on the map's devices.

use super::ground::{Cell, Ground, NEIGHBOURS, Obstacles, SPACING_M};
use super::leap::{self, Leap};
use super::limits::JumpLimits;
use super::{Link, Means};
use crate::ability::Motion;
use crate::character::{Action, Body, CharacterProfile, MoveScratch};
use crate::crossings::crossings;
use crate::float::horizontal;
use crate::map::{CollisionMap, Device, DeviceKind};
use crate::{Vec3, navigable};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Longest throw of a pad or flight of a jetpack that a survey tries, m.
pub(crate) const THROW_REACH_M: f32 = 17.0;
/// Highest fall that a survey tries, m.
const MAX_DROP_M: f32 = 60.0;

/// Finds all links of `ground`, sorted.
pub(super) fn find(map: &CollisionMap, profile: &CharacterProfile, ground: &Ground, limits: &JumpLimits) -> Vec<Link> {
    let of_island = |scratch: &mut MoveScratch, (island, cells): (usize, &Vec<u32>)| {
        let (island, known) = (island as u32, BTreeMap::new());
        let mut search = IslandSearch { map, profile, ground, limits, island, known, scratch };
        for &cell_idx in cells {
            search.drops(cell_idx as usize);
            search.jumps(cell_idx as usize);
        }
        search.links().collect::<Vec<Link>>()
    };
    let borders = borders_by_island(ground);
    let found: Vec<Vec<Link>> =
        borders.par_iter().enumerate().with_max_len(1).map_init(MoveScratch::default, of_island).collect();
    let mut links = found.concat();
    device_links(map, profile, (ground, limits), &mut links);
    crossing_links(map, profile, ground, &mut links);
    links.sort_unstable();
    links.dedup_by_key(|link| (link.from, link.to, link.means));
    links
}

/// For each island, its cells with a neighbour that they cannot walk to.
fn borders_by_island(ground: &Ground) -> Vec<Vec<u32>> {
    let mut borders = vec![Vec::new(); ground.islands().len()];
    for (idx, cell) in ground.cells().iter().enumerate() {
        if (0..NEIGHBOURS.len()).any(|neighbour| !ground.walks_to(idx, neighbour)) {
            borders[cell.island as usize].push(idx as u32);
        }
    }
    borders
}

/// Findings about links to another island.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    /// The least demanding means, and the cells of take-off and landing.
    best: Option<(Means, u32, u32)>,
    failures: u32,
}

/// The search for links out of one island.
struct IslandSearch<'a> {
    map: &'a CollisionMap,
    profile: &'a CharacterProfile,
    ground: &'a Ground,
    limits: &'a JumpLimits,
    island: u32,
    known: BTreeMap<u32, Known>,
    scratch: &'a mut MoveScratch,
}

impl IslandSearch<'_> {
    fn links(&self) -> impl Iterator<Item = Link> {
        self.known.iter().filter_map(|(&to, known)| {
            known.best.map(|(means, takeoff, landing)| Link { from: self.island, to, means, takeoff, landing })
        })
    }

    fn is_settled(&self, island: u32, means: Means) -> bool {
        island == self.island
            || self.known.get(&island).is_some_and(|known| {
                known.best.is_some_and(|(best, ..)| best <= means) || known.failures >= self.limits.max_failures
            })
    }

    /// Simulates a leap and links the island on which the body lands; true if that is the island of `target`.
    fn attempt(&mut self, from: usize, target: &Cell, leap: Leap, means: Means) -> bool {
        let start = self.ground.cells()[from].feet;
        let landed = leap::land(self.map, self.profile, start, target.feet, leap, self.scratch);
        let landing = landed.and_then(|feet| self.place_at(feet));
        let island = landing.map(|idx| self.ground.cells()[idx].island);
        if let Some((landing, island)) = landing.zip(island).filter(|&(_, island)| island != self.island) {
            let known = self.known.entry(island).or_default();
            if known.best.is_none_or(|(best, ..)| means < best) {
                known.best = Some((means, from as u32, landing as u32));
            }
        }
        if island != Some(target.island) {
            self.known.entry(target.island).or_default().failures += 1;
        }
        island == Some(target.island)
    }

    fn place_at(&mut self, feet: Vec3) -> Option<usize> {
        place_at(self.map, self.profile, (self.ground, self.limits), feet, self.scratch)
    }

    /// Tries to run off each edge of a cell that has ground below it.
    fn drops(&mut self, cell_idx: usize) {
        let feet = self.ground.cells()[cell_idx].feet;
        for (neighbour, (dx, dz)) in NEIGHBOURS.into_iter().enumerate() {
            if self.ground.walks_to(cell_idx, neighbour) {
                continue;
            }
            let out = Vec3::new(dx as f32, 0.0, dz as f32).normalize();
            for distance in [1.6, 3.0] {
                let above = feet + out * distance + Vec3::new(0.0, 0.9, 0.0);
                let Some(hit) = self.map.mesh().cast_ray(above, navigable::DOWN, MAX_DROP_M) else { continue };
                let below = above + navigable::DOWN * hit.distance;
                if below.y > feet.y - 0.2 {
                    continue;
                }
                let Some(&target) = self.ground.at(below) else { continue };
                if !self.is_settled(target.island, Means::Drop) {
                    self.attempt(cell_idx, &target, Leap::Run, Means::Drop);
                }
            }
        }
    }

    /// Tries to jump to ground beyond each edge of a cell.
    fn jumps(&mut self, cell_idx: usize) {
        let feet = self.ground.cells()[cell_idx].feet;
        let (column, row) = self.ground.column_of(feet);
        for (neighbour, (dx, dz)) in NEIGHBOURS.into_iter().enumerate() {
            if self.ground.walks_to(cell_idx, neighbour) {
                continue;
            }
            for reach in 1..=self.limits.jump_reach {
                for target_idx in self.ground.column(column + dx * reach, row + dz * reach) {
                    let target = self.ground.cells()[target_idx];
                    let rise = target.feet.y - feet.y;
                    if !(-20.0..=self.limits.max_rise_m).contains(&rise) {
                        continue;
                    }
                    self.jump_to(cell_idx, &target, rise, reach as f32 * SPACING_M);
                }
            }
        }
    }

    fn jump_to(&mut self, from: usize, target: &Cell, rise: f32, run: f32) {
        let (most_rise, most_run) = self.limits.single_m;
        let single = rise < most_rise && run < most_run;
        if single && !self.is_settled(target.island, Means::Jump) {
            let leaps = if rise > 0.3 { [Leap::Jump, Leap::RunAndJump] } else { [Leap::RunAndJump, Leap::Jump] };
            if leaps.into_iter().any(|leap| self.attempt(from, target, leap, Means::Jump)) {
                return;
            }
        }
        let (again, means) = match self.profile.extra_jumps {
            0 => (self.profile.dash_speed > 0.0, Means::Dash),
            _ => (true, Means::DoubleJump),
        };
        if again && !self.is_settled(target.island, means) {
            let leaps = if rise > 0.3 {
                [Leap::DoubleJump, Leap::RunAndDoubleJump]
            } else {
                [Leap::RunAndDoubleJump, Leap::DoubleJump]
            };
            let _ = leaps.into_iter().any(|leap| self.attempt(from, target, leap, means));
        }
    }
}

/// For each island from which a character can step onto a device at `centre`, the nearest cell, by island.
pub fn cells_beside(ground: &Ground, centre: Vec3) -> Vec<u32> {
    let mut nearest: BTreeMap<u32, (f32, u32)> = BTreeMap::new();
    for idx in ground.around(centre, 2) {
        let Cell { feet, island } = ground.cells()[idx];
        let offset = feet - centre;
        let distance = horizontal(offset);
        let is_nearer = nearest.get(&island).is_none_or(|&(least, _)| distance < least);
        if offset.y.abs() < 0.8 && distance < 2.4 && is_nearer {
            nearest.insert(island, (distance, idx as u32));
        }
    }
    nearest.into_values().map(|(_, idx)| idx).collect()
}

/// Links by `means` from the cells `takeoffs` to the cell `landing`, except from its own island.
pub fn between<'a>(
    ground: &'a Ground,
    takeoffs: &'a [u32],
    landing: u32,
    means: Means,
) -> impl Iterator<Item = Link> + 'a {
    let island = |cell: u32| ground.cells()[cell as usize].island;
    let link = move |&takeoff: &u32| Link { from: island(takeoff), to: island(landing), means, takeoff, landing };
    takeoffs.iter().map(link).filter(|link| link.from != link.to)
}

/// Links by a teleporter between the ground beside its ends.
pub fn by_teleporter(ground: &Ground, teleporter: Device) -> impl Iterator<Item = Link> {
    teleporter.entrances().flat_map(|way| {
        let (near, far) = (cells_beside(ground, way.from), cells_beside(ground, way.exit()));
        let links = far.iter().flat_map(|&cell| between(ground, &near, cell, Means::Teleporter));
        links.collect::<Vec<_>>()
    })
}

/// Up to six cells of each island within `reach` metres of `centre` and below `rise` metres above it, from near to far.
pub(crate) fn targets_around(ground: &Ground, centre: Vec3, reach: f32, rise: f32) -> Vec<Cell> {
    let mut by_island: BTreeMap<u32, Vec<(f32, Cell)>> = BTreeMap::new();
    for cell in ground.around(centre, (reach / SPACING_M) as i32).map(|idx| ground.cells()[idx]) {
        let distance = horizontal(cell.feet - centre);
        if distance <= reach && cell.feet.y - centre.y < rise {
            by_island.entry(cell.island).or_default().push((distance, cell));
        }
    }
    by_island
        .into_values()
        .flat_map(|mut cells| {
            cells.sort_by(|a, b| a.0.total_cmp(&b.0));
            // The nearest cell is often right above; a cell farther from the edge is easier to land on.
            let picks = [0, 1, 2, 3, 4, 6].map(|eighths| cells.len() * eighths / 8);
            let mut cells: Vec<Cell> = picks.into_iter().map(|idx| cells[idx].1).collect();
            cells.dedup_by_key(|cell| cell.feet.to_array().map(f32::to_bits));
            cells
        })
        .collect()
}

/// The place where a body has come to rest.
fn place_at(
    map: &CollisionMap,
    profile: &CharacterProfile,
    (ground, limits): (&Ground, &JumpLimits),
    feet: Vec3,
    scratch: &mut MoveScratch,
) -> Option<usize> {
    match limits.obstacles {
        Obstacles::OnLine => ground.index_at(feet),
        Obstacles::OfBody => ground.walk_from(map, profile, feet, scratch),
    }
}

fn device_links(
    map: &CollisionMap,
    profile: &CharacterProfile,
    (ground, limits): (&Ground, &JumpLimits),
    links: &mut Vec<Link>,
) {
    let mut scratch = MoveScratch::default();
    let place_at = |feet, scratch: &mut _| place_at(map, profile, (ground, limits), feet, scratch);
    let island = |cell: u32| ground.cells()[cell as usize].island;
    for device in map.placed().devices().filter(|device| profile.uses(device.kind)) {
        let takeoffs = cells_beside(ground, device.from);
        let (leap, means) = match device.kind {
            DeviceKind::Pad => (Leap::Pad(device.power), Means::Pad),
            DeviceKind::Jetpack => (Leap::Jetpack(device.power), Means::Jetpack),
            DeviceKind::Teleporter => {
                links.extend(by_teleporter(ground, device));
                continue;
            }
            DeviceKind::ZipLine => {
                let landed = ride(map, profile, device.from, &mut scratch);
                let landing = landed.and_then(|feet| place_at(feet, &mut scratch));
                links.extend(landing.iter().flat_map(|&to| between(ground, &takeoffs, to as u32, Means::ZipLine)));
                continue;
            }
        };
        let rise = profile.rise_by(device).unwrap_or_default();
        let mut reached: Vec<u32> = Vec::new();
        for target in targets_around(ground, device.from, THROW_REACH_M, rise) {
            if reached.contains(&target.island) || takeoffs.iter().any(|&cell| island(cell) == target.island) {
                continue;
            }
            let landed = leap::land(map, profile, device.from, target.feet, leap, &mut scratch);
            if let Some(landing) = landed.and_then(|feet| place_at(feet, &mut scratch)) {
                reached.push(ground.cells()[landing].island);
                links.extend(between(ground, &takeoffs, landing as u32, means));
            }
        }
    }
}

/// Links by crossings, which a body has made.
fn crossing_links(map: &CollisionMap, profile: &CharacterProfile, ground: &Ground, links: &mut Vec<Link>) {
    for crossing in crossings(map, profile) {
        let means = match crossing.by.motion() {
            Motion::Swim | Motion::Dive => Means::Swim,
            Motion::WallRun => Means::WallRun,
            Motion::Own => Means::OwnMove,
            _ => Means::Climb,
        };
        let takeoffs = cells_beside(ground, crossing.from);
        let landings = cells_beside(ground, crossing.to);
        links.extend(landings.iter().flat_map(|&to| between(ground, &takeoffs, to, means)));
    }
}

/// Simulates a ride on the zip line with a station at `from`. Returns the place where the body lands, m.
fn ride(map: &CollisionMap, profile: &CharacterProfile, from: Vec3, scratch: &mut MoveScratch) -> Option<Vec3> {
    const MAX_RIDE_TICKS: u32 = 1800;
    let mut body = Body::at(from, 0.0);
    for tick in 0..MAX_RIDE_TICKS {
        body.tick(map, profile, &Action::default(), scratch);
        if map.is_outside(body.feet) || map.liquid_at(body.feet, 0.0).is_some() {
            return None;
        }
        if tick > 0 && body.is_grounded() {
            return Some(body.feet);
        }
    }
    None
}
