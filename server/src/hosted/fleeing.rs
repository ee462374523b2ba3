//! NPCs that get away from a body or a place.

use super::itinerary::{LOOK_TICKS, Route, Threat};
use super::pursuit::Pursuit;
use super::world::HostedWorld;
use crate::ids::NpcId;
use surefoot_world::fleeing::Danger;
use surefoot_world::{NpcSlot, Vec3};

impl HostedWorld {
    /// Where an NPC flees to, m, if it has to.
    pub(super) fn refuge(&self, id: NpcId, slot: NpcSlot, threat: Threat) -> Option<(Vec3, Pursuit)> {
        let danger = self.danger(id, threat)?;
        let feet = self.world.npc(slot)?.body.feet;
        if danger.spares(self.world.map(), feet) {
            return None;
        }
        let place = danger.refuge(&self.world, slot, &mut self.draws_of(id))?;
        Some((place, Pursuit { is_of_route: true, ..Pursuit::default() }))
    }

    /// Lets NPCs that flee change their minds while the threat moves.
    pub(super) fn look_at_threats(&mut self) {
        let tick = self.tick();
        let fleeing = self.records.iter().filter_map(|(&id, record)| {
            let is_due = (tick + u64::from(record.slot.0)).0.is_multiple_of(LOOK_TICKS);
            let goal = record.goal.filter(|_| is_due && record.pursuit.is_of_route)?;
            match record.itinerary.as_ref()?.route {
                Route::Flee(threat) => Some((id, record.slot, goal, threat)),
                _ => None,
            }
        });
        for (id, slot, goal, threat) in fleeing.collect::<Vec<_>>() {
            let Some(danger) = self.danger(id, threat) else { continue };
            if !danger.spares(self.world.map(), goal)
                && let Some((place, _)) = self.refuge(id, slot, threat)
            {
                self.move_goal(id, place);
            }
        }
    }

    /// The threat where it is now; `None` if it is gone.
    fn danger(&self, id: NpcId, threat: Threat) -> Option<Danger> {
        let Threat { from, distance, hides } = threat;
        self.place_of(id, from).ok().map(|at| Danger { at, distance, hides })
    }
}
