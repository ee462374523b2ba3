//! Collisions between NPCs: those that overlap are pushed apart, but never off a ledge, and go around each other.

use crate::Vec3;
use crate::character::{CharacterProfile, MoveScratch};
use crate::float::hypot;
use crate::map::{Liquid, Map};
use crate::navigable::DOWN;
use crate::npc::Npc;

/// Side of a cell of the grid that finds neighbours, m; bodies further apart than this never touch.
const CELL_M: f32 = 2.0;
/// Longest push of a body in one tick, m.
const MAX_PUSH_M: f32 = 0.15;
/// Speed at which a body goes around another, m/s, what it gains of it in a tick, and how far aside there must be ground, m.
const ASIDE_SPEED: f32 = 2.0;
const ASIDE_SPEED_PER_TICK: f32 = 0.5;
const ASIDE_M: f32 = 0.3;
/// Height above the feet from which the ground ahead of a push is looked for, m, and how far below the feet it may lie.
const KNEE_M: f32 = 0.5;
const MAX_DROP_M: f32 = 1.0;

/// Buffers of the neighbour search, reused from tick to tick.
#[derive(Debug, Default)]
pub(crate) struct CrowdScratch {
    /// (cell, slot), sorted.
    cells: Vec<((i32, i32), u32)>,
    /// Push of the NPC in each slot, m.
    pushes: Vec<Vec3>,
}

impl CrowdScratch {
    /// Pushes apart all bodies that overlap, each by half of the overlap, along the ground, and stops them from running on into each other.
    pub(crate) fn separate(
        &mut self,
        npcs: &mut [Option<Npc>],
        map: &Map,
        profiles: &[CharacterProfile],
        scratch: &mut [MoveScratch],
    ) {
        let cell_of = |feet: Vec3| ((feet.x / CELL_M) as i32, (feet.z / CELL_M) as i32);
        let is_solid = |npc: &Npc| npc.harm.is_none() && npc.body.ride.is_none();
        self.cells.clear();
        self.cells.extend(npcs.iter().zip(0..).filter_map(|(npc, slot)| {
            npc.as_ref().filter(|npc| is_solid(npc)).map(|npc| (cell_of(npc.body.feet), slot))
        }));
        self.cells.sort_unstable();
        self.pushes.clear();
        self.pushes.resize(npcs.len(), Vec3::ZERO);
        for &(cell, slot) in &self.cells {
            let npc = npcs[slot as usize].as_ref().expect("listed above");
            for dx in -1..=1 {
                for dz in -1..=1 {
                    let near = (cell.0.saturating_add(dx), cell.1.saturating_add(dz));
                    let start = self.cells.partition_point(|(other, _)| *other < near);
                    for &(_, other) in self.cells[start..].iter().take_while(|(other, _)| *other == near) {
                        if other != slot {
                            let other_npc = npcs[other as usize].as_ref().expect("listed above");
                            self.pushes[slot as usize] += push(npc, other_npc, slot < other, profiles);
                        }
                    }
                }
            }
        }
        for ((npc, push), scratch) in npcs.iter_mut().zip(&self.pushes).zip(scratch) {
            let length = push.length();
            if let Some(npc) = npc.as_mut().filter(|_| length > 0.0) {
                let profile = &profiles[usize::from(npc.profile.0)];
                let away = *push / length;
                let push = away * length.min(MAX_PUSH_M);
                if !npc.body.is_grounded() || is_safe(map, npc.body.feet, push, profile) {
                    npc.body.shove(map.mesh(), profile, push, scratch);
                }
                block(npc, map, profile, away);
            }
        }
    }
}

/// Stops a body from going on towards another that it has run into, and lets one that stands on the ground go around it: on the right, or
/// on the left where there is no ground, so that those that meet head-on pass each other.
fn block(npc: &mut Npc, map: &Map, profile: &CharacterProfile, away: Vec3) {
    let towards = -npc.body.velocity.dot(away);
    if towards <= 0.0 {
        return;
    }
    npc.body.velocity += away * towards;
    let right = Vec3::new(away.z, 0.0, -away.x);
    let is_open = |side: &Vec3| is_safe(map, npc.body.feet, *side * ASIDE_M, profile);
    if let Some(side) = [right, -right].into_iter().find(is_open).filter(|_| npc.body.is_grounded()) {
        let lacking = ASIDE_SPEED - npc.body.velocity.dot(side);
        npc.body.velocity += side * lacking.clamp(0.0, ASIDE_SPEED_PER_TICK);
    }
}

/// Whether a body that stands at `feet` still does after a push, so that nobody is pushed off a ledge or into lava.
fn is_safe(map: &Map, feet: Vec3, push: Vec3, profile: &CharacterProfile) -> bool {
    // The edge of the body may hang over.
    let length = push.length();
    let ahead = feet + push * ((length + profile.radius) / length);
    let from = ahead + Vec3::Y * KNEE_M;
    let below = map.mesh().cast_ray(from, DOWN, KNEE_M + MAX_DROP_M);
    below.is_some_and(|hit| hit.surface.is_solid() && map.liquid_at(ahead, 0.0) != Some(Liquid::Lava))
}

/// Push of `npc` by half of its overlap with `other`, m; bodies in the same place separate along x.
fn push(npc: &Npc, other: &Npc, is_first: bool, profiles: &[CharacterProfile]) -> Vec3 {
    let [own, others] = [npc, other].map(|npc| &profiles[usize::from(npc.profile.0)]);
    let offset = npc.body.feet - other.body.feet;
    let clear = if offset.y > 0.0 { others.height } else { own.height };
    let distance = hypot(offset.x, offset.z);
    let overlap = own.radius + others.radius - distance;
    if overlap <= 0.0 || offset.y.abs() >= clear {
        return Vec3::ZERO;
    }
    let away = if distance > 1.0e-4 {
        Vec3::new(offset.x, 0.0, offset.z) / distance
    } else if is_first {
        Vec3::X
    } else {
        -Vec3::X
    };
    away * (0.5 * overlap)
}
