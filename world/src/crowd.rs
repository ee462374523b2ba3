//! Collisions between NPCs.

use crate::Vec3;
use crate::character::{CharacterProfile, MoveScratch};
use crate::float::hypot;
use crate::map::Map;
use crate::npc::Npc;

/// Side of a cell of the grid that finds neighbours, m; bodies further apart than this never touch.
const CELL_M: f32 = 2.0;
/// Longest push of a body in one tick, m.
const MAX_PUSH_M: f32 = 0.15;

/// Buffers of the neighbour search, reused from tick to tick.
#[derive(Debug, Default)]
pub(crate) struct CrowdScratch {
    /// (cell, slot), sorted.
    cells: Vec<((i32, i32), u32)>,
    /// Push of the NPC in each slot, m.
    pushes: Vec<Vec3>,
}

impl CrowdScratch {
    /// Pushes apart all bodies that overlap, each by half of the overlap, along the ground.
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
                npc.body.shove(map.mesh(), profile, *push * (length.min(MAX_PUSH_M) / length), scratch);
            }
        }
    }
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
