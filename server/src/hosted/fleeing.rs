//! NPCs that get away from a body or a place.

use super::itinerary::{LOOK_TICKS, Route, Threat};
use super::pursuit::Pursuit;
use super::world::HostedWorld;
use crate::ids::NpcId;
use rand::RngExt;
use std::f32::consts::TAU;
use surefoot_world::float::distance_to_segment;
use surefoot_world::{Body, NpcSlot, Vec3};

/// Places that are drawn at each look.
const DRAWS: u8 = 64;
/// Nearest place that is drawn, m, and how much farther the others are, in distances that the NPC keeps: out of a
/// corner, only a long way along the walls leads away.
const NEAREST_M: f32 = 3.0;
const REACH: f32 = 2.0;
/// Heights above and below the NPC at which the ground of a place is searched, m.
const HEIGHTS_M: [f32; 5] = [0.0, 3.0, -3.0, 6.0, -6.0];
/// Height of the eyes of a threat, and of the middle of a body that it looks for, m.
const EYES_M: f32 = 1.6;
const MIDDLE_M: f32 = 0.9;
/// How much a place must be farther from the threat than where the NPC is, m.
const GAIN_M: f32 = 1.0;
/// Least distance of the way from the threat, as a share of the distance at its begin, and of a place from the threat
/// as a share of the way: most NPCs are faster than what they flee from.
const CLEARANCE: f32 = 0.6;
const LEAD: f32 = 0.5;
/// Worth of a metre nearer to the NPC, and of being out of sight, in metres from the threat.
const NEARNESS: f32 = 0.25;
const COVER_M: f32 = 30.0;

impl HostedWorld {
    /// Where an NPC flees to, m, if it has to.
    pub(super) fn refuge(&self, id: NpcId, slot: NpcSlot, threat: Threat) -> Option<(Vec3, Pursuit)> {
        let from = self.place_of(id, threat.from).ok()?;
        let feet = self.world.npc(slot)?.body.feet;
        if self.is_safe(feet, from, threat) {
            return None;
        }
        let mut rng = self.draws_of(id);
        let apart = feet.distance(from);
        let draws = (0..DRAWS).filter_map(|draw| {
            let angle = (f32::from(draw) + rng.random::<f32>()) / f32::from(DRAWS) * TAU;
            let way = Body::at(feet, angle).facing();
            let beside = feet + way * rng.random_range(NEAREST_M..NEAREST_M + REACH * threat.distance);
            let place = HEIGHTS_M.iter().find_map(|y| self.world.footing_below(slot, beside + Vec3::Y * y))?;
            let place = self.world.place_beside(slot, place, Vec3::ZERO)?;
            let (gap, way) = (place.distance(from), place.distance(feet));
            let passes = distance_to_segment(from, feet, place) < CLEARANCE * apart;
            let is_open = !passes && gap > LEAD * way && gap >= apart + GAIN_M && self.within_map(place).is_ok();
            let cover = if threat.hides && !self.sees(from, place) { COVER_M } else { 0.0 };
            is_open.then_some((gap.min(1.5 * threat.distance) + cover - NEARNESS * way, place))
        });
        let (_, place) = draws.max_by(|(worth, _), (other, _)| worth.total_cmp(other))?;
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
            let Ok(from) = self.place_of(id, threat.from) else { continue };
            if !self.is_safe(goal, from, threat)
                && let Some((place, _)) = self.refuge(id, slot, threat)
            {
                self.move_goal(id, place);
            }
        }
    }

    /// Whether a body is far enough from a threat, m, and out of its sight if it hides.
    fn is_safe(&self, feet: Vec3, from: Vec3, threat: Threat) -> bool {
        feet.distance(from) >= threat.distance && !(threat.hides && self.sees(from, feet))
    }

    /// Whether a threat sees a body, both with their feet at these places, m.
    fn sees(&self, from: Vec3, feet: Vec3) -> bool {
        self.world.map().mesh().is_in_sight(from + Vec3::Y * EYES_M, feet + Vec3::Y * MIDDLE_M)
    }
}
