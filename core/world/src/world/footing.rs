//! Where the NPCs of a world can stand, and whether they have arrived.

use super::World;
use crate::Vec3;
use crate::arrival::{Arrival, NoFooting, Place, SNAP_M};
use crate::character::MoveScratch;
use crate::npc::NpcSlot;

impl World {
    /// The place to stand at a horizontal offset from another, m, to which an NPC could walk straight; `None` at
    /// devices, in liquids, and where it would stand over a rim.
    pub fn place_beside(&self, slot: NpcSlot, from: Vec3, offset: Vec3) -> Option<Vec3> {
        self.surroundings(slot).beside(from, offset, &mut MoveScratch::default())
    }

    /// The place where an NPC can stand that is nearest to `goal`, m, at most `snap` metres away.
    ///
    /// # Errors
    /// If there is none.
    pub fn footing(&self, slot: NpcSlot, goal: Vec3, snap: f32) -> Result<Vec3, NoFooting> {
        self.surroundings(slot).footing(goal, snap, &mut MoveScratch::default())
    }

    /// The place where an NPC can stand right below `place`, m, at most [`SNAP_M`] below it, or a little above it.
    pub fn footing_below(&self, slot: NpcSlot, place: Vec3) -> Option<Vec3> {
        self.surroundings(slot).footing_at(place, SNAP_M, &mut MoveScratch::default())
    }

    /// Whether an NPC has arrived within `radius` metres of `place`, m.
    pub fn has_arrived(&self, slot: NpcSlot, place: Vec3, radius: f32, arrival: Arrival) -> bool {
        let npc = self.npc(slot).expect("an occupied slot");
        arrival.is_met(self.surroundings(slot), &npc.body, place, radius)
    }

    fn surroundings(&self, slot: NpcSlot) -> Place<'_> {
        let profile = self.profile_of(self.npc(slot).expect("an occupied slot"));
        Place { map: &self.map, movers: &self.movers, profile }
    }
}
