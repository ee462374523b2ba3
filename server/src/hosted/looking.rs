//! NPCs at rest that turn: to the headings of their goals, and to what they look at.

use super::commands::NpcError;
use super::pursuit::Target;
use super::world::{HostedWorld, NpcRecord};
use crate::ids::NpcId;
use surefoot_world::float::{heading, horizontal, wrapped};
use surefoot_world::{Action, Npc, TICKS_PER_SECOND, Vec3, World};

/// Angle within which a body has turned to the heading of its goal, rad.
const FACING_TOLERANCE: f32 = 0.001;
/// Angle between a body's heading and its target above which it begins to turn, and within which it stops, rad (20 and
/// 2 degrees).
const LOOK_SLACK: f32 = 0.35;
const LOOK_TOLERANCE: f32 = 0.035;
/// Horizontal distance from its target below which a body does not turn, m.
const TOO_NEAR_M: f32 = 0.1;

impl HostedWorld {
    /// Gives an NPC something to look at while it rests, or nothing.
    pub fn look_at(&mut self, id: NpcId, target: Option<Target>) -> Result<(), NpcError> {
        if !self.records.contains_key(&id) {
            return Err(NpcError::Unknown(id));
        }
        target.map(|target| self.place_seen(id, target)).transpose()?;
        self.records.get_mut(&id).expect("an NPC that exists").looks_at = target;
        Ok(())
    }

    /// Where the target of an NPC's look is, m. Unlike a goal, it may be down.
    fn place_seen(&self, id: NpcId, target: Target) -> Result<Vec3, NpcError> {
        match target {
            Target::Npc(other) if other != id => {
                let slot = self.records.get(&other).ok_or(NpcError::Unknown(other))?.slot;
                Ok(self.world.npc(slot).expect("every record has an NPC").body.feet)
            }
            target => self.place_of(id, target),
        }
    }

    /// Aims the bodies of NPCs at rest at what they look at. Targets that are gone are forgotten.
    pub(super) fn look_around(&mut self) {
        let looking = self.records.iter().filter_map(|(&id, record)| Some((id, record.looks_at?)));
        let places: Vec<_> = looking.map(|(id, target)| (id, self.place_seen(id, target).ok())).collect();
        for (id, place) in places {
            let record = self.records.get_mut(&id).expect("an NPC that looks");
            match place {
                Some(place) => record.aim(self.world.npc(record.slot).expect("every record has an NPC"), place),
                None => record.looks_at = None,
            }
        }
    }

    /// Turns bodies at rest to their headings.
    pub(super) fn turn_bodies(&mut self) {
        let Self { records, world, .. } = self;
        for record in records.values_mut() {
            let Some(heading) = record.turns_to else { continue };
            let npc = world.npc(record.slot).expect("every record has an NPC");
            let left = wrapped(heading - npc.body.yaw);
            let in_tick = world.profile_of(npc).turn_speed / TICKS_PER_SECOND as f32;
            let tolerance = if record.pursuit.facing.is_some() { FACING_TOLERANCE } else { LOOK_TOLERANCE };
            if left.abs() <= tolerance || npc.harm.is_some() {
                record.stop_turning(world);
            } else {
                let turn = (left / in_tick).clamp(-1.0, 1.0);
                world.decide(record.slot, Action { turn, ..Action::default() });
            }
        }
    }
}

impl NpcRecord {
    /// Lets the body of `npc` turn to a place, m, if the NPC rests and no goal has given it a heading.
    fn aim(&mut self, npc: &Npc, place: Vec3) {
        let rests = (self.goal.is_none() || self.is_at_target) && npc.harm.is_none() && npc.body.is_at_rest();
        let offset = place - npc.body.feet;
        if !rests || self.pursuit.facing.is_some() || horizontal(offset) < TOO_NEAR_M {
            return;
        }
        let heading = heading(offset);
        if self.turns_to.is_some() || wrapped(heading - npc.body.yaw).abs() > LOOK_SLACK {
            self.turns_to = Some(heading);
        }
    }

    /// Ends the turn of a body at rest, if it turns.
    pub fn stop_turning(&mut self, world: &mut World) {
        if self.turns_to.take().is_some() {
            world.decide(self.slot, Action::default());
        }
    }
}
