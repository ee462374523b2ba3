//! Where an NPC gets away from a danger.

use crate::float::distance_to_segment;
use crate::map::Map;
use crate::{Body, NpcSlot, Vec3, World};
use rand::{Rng, RngExt};
use std::f32::consts::TAU;

/// Places that are drawn at each look.
const DRAWS: u8 = 64;
/// Nearest place that is drawn, m, and how much farther the others are, in distances that the NPC keeps: out of a
/// corner, only a long way along the walls leads away.
const NEAREST_M: f32 = 3.0;
const REACH: f32 = 2.0;
/// Heights above and below the NPC at which the ground of a place is searched, m.
const HEIGHTS_M: [f32; 5] = [0.0, 3.0, -3.0, 6.0, -6.0];
/// Height of the eyes of a danger, and of the middle of a body that it looks for, m.
const EYES_M: f32 = 1.6;
const MIDDLE_M: f32 = 0.9;
/// How much a place must be farther from the danger than where the NPC is, m.
const GAIN_M: f32 = 1.0;
/// Least distance of the way from the danger, as a share of the distance at its begin, and of a place from the danger
/// as a share of the way: most NPCs are faster than what they flee from.
const CLEARANCE: f32 = 0.6;
const LEAD: f32 = 0.5;
/// Worth of a metre nearer to the NPC, and of being out of sight, in metres from the danger.
const NEARNESS: f32 = 0.25;
const COVER_M: f32 = 30.0;

/// What an NPC flees from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Danger {
    /// Where it is, m.
    pub at: Vec3,
    /// Distance that the NPC keeps, m.
    pub distance: f32,
    /// Whether the NPC also gets out of sight.
    pub hides: bool,
}

impl Danger {
    /// Whether a body is far enough away, and out of sight if it hides.
    pub fn spares(&self, map: &Map, feet: Vec3) -> bool {
        feet.distance(self.at) >= self.distance && !(self.hides && self.sees(map, feet))
    }

    /// The best of some places that are drawn around an NPC, m; `None` if none of them is better than where it is.
    pub fn refuge(&self, world: &World, slot: NpcSlot, rng: &mut impl Rng) -> Option<Vec3> {
        let (map, feet) = (world.map(), world.npc(slot)?.body.feet);
        let apart = feet.distance(self.at);
        let draws = (0..DRAWS).filter_map(|draw| {
            let angle = (f32::from(draw) + rng.random::<f32>()) / f32::from(DRAWS) * TAU;
            let way = Body::at(feet, angle).facing();
            let beside = feet + way * rng.random_range(NEAREST_M..NEAREST_M + REACH * self.distance);
            let place = HEIGHTS_M.iter().find_map(|y| world.footing_below(slot, beside + Vec3::Y * y))?;
            let place = world.place_beside(slot, place, Vec3::ZERO)?;
            let (gap, way) = (place.distance(self.at), place.distance(feet));
            let passes = distance_to_segment(self.at, feet, place) < CLEARANCE * apart;
            let is_inside = !map.is_outside(place) && place.y <= map.extent().y;
            let is_open = !passes && gap > LEAD * way && gap >= apart + GAIN_M && is_inside;
            let cover = if self.hides && !self.sees(map, place) { COVER_M } else { 0.0 };
            is_open.then_some((gap.min(1.5 * self.distance) + cover - NEARNESS * way, place))
        });
        draws.max_by(|(worth, _), (other, _)| worth.total_cmp(other)).map(|(_, place)| place)
    }

    /// Whether the danger sees a body with its feet at a place, m.
    fn sees(&self, map: &Map, feet: Vec3) -> bool {
        map.mesh().is_in_sight(self.at + Vec3::Y * EYES_M, feet + Vec3::Y * MIDDLE_M)
    }
}
