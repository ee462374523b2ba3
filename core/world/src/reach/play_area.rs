//! Where play takes place: around the spawn points of a map, or on its largest region.

use super::{Reach, Regions};
use crate::character::{CharacterProfile, MoveScratch};
use crate::map::CollisionMap;
use crate::map::spot::SPAWN;
use crate::navigable::stand_at;
use std::collections::BTreeSet;

/// Greatest height of a spawn point above or below its floor, m: engines put it at the body's centre, or above that.
const SPAWN_RISE_M: f32 = 3.0;

/// The part of a map where a body plays.
#[derive(Debug)]
pub struct PlayArea {
    regions: Regions,
    /// Regions in which play begins: those of the spawn points, or without any on ground the largest one.
    begins: BTreeSet<u32>,
    /// For each region, whether it can be reached from where play begins.
    reached: Vec<bool>,
}

impl PlayArea {
    /// The play area of a map by its survey for a body.
    pub fn of(map: &CollisionMap, profile: &CharacterProfile, survey: &Reach) -> Self {
        let regions = survey.regions(|_| true);
        let mut scratch = MoveScratch::default();
        let spawns = map.placed().spots.iter().filter(|spot| spot.tag == SPAWN);
        let cells = spawns.filter_map(|spawn| {
            let feet = stand_at(map, profile, spawn.from, SPAWN_RISE_M, &mut scratch)?;
            survey.ground.walk_from(map, profile, feet, &mut scratch)
        });
        let islands = cells.map(|cell| survey.ground.cells()[cell].island);
        let mut begins: BTreeSet<u32> = islands.map(|island| regions.of_island[island as usize]).collect();
        if begins.is_empty() && !regions.cell_counts.is_empty() {
            begins.insert(regions.largest());
        }
        let mut reached = vec![false; regions.cell_counts.len()];
        for &region in &begins {
            reached.iter_mut().zip(regions.reachable_from(region)).for_each(|(it, other)| *it |= other);
        }
        Self { regions, begins, reached }
    }

    /// Whether an island belongs to a region in which play begins: a body can leave it and come back.
    pub fn holds(&self, island: u32) -> bool {
        self.begins.contains(&self.region_of(island))
    }

    /// Whether an island can be reached from where play begins.
    pub fn reaches(&self, island: u32) -> bool {
        self.reached[self.region_of(island) as usize]
    }

    /// The region of an island: those of a region can reach one another.
    pub fn region_of(&self, island: u32) -> u32 {
        self.regions.of_island[island as usize]
    }
}
