//! The way back after a push: where a wall lies between the NPC and its waypoint, it returns to a place that it has
//! rehearsed.

use surefoot_world::{Ability, CharacterProfile, Map, Vec3};

/// Distance within which a place on the rehearsed way counts as reached, m.
const REACHED_M: f32 = 0.5;

/// How a follower gets back to its leg.
#[derive(Debug, Clone, Default)]
pub(super) struct Detour {
    /// Places along the legs that were rehearsed, m.
    rehearsed_way: Vec<Vec3>,
    /// Where the NPC heads before the end of its leg, m.
    pub via: Option<Vec3>,
    /// Whether a wall lies between the NPC and the end of its leg.
    is_lost: bool,
}

impl Detour {
    /// Keeps the way of a rehearsal. A way that begins where the NPC is lost is of no use to get back.
    pub fn set_rehearsed_way(&mut self, way: impl Iterator<Item = Vec3>) {
        if !self.is_lost || self.rehearsed_way.is_empty() {
            self.rehearsed_way.clear();
            self.rehearsed_way.extend(way);
        }
    }

    /// Begins, changes or ends the detour of a body at `feet` on its leg to `end`, m.
    pub fn update(&mut self, map: &Map, body: &CharacterProfile, feet: Vec3, (ability, end): (Ability, Vec3)) {
        self.is_lost = ability == Ability::WALK && !sees(map, body, feet, end);
        self.via = if self.is_lost { self.way_back(map, body, feet, end) } else { None };
    }

    pub fn end(&mut self) {
        (self.is_lost, self.via) = (false, None);
    }

    /// The place to which a body at `feet` returns that is on its way to `end`, m: behind the last rehearsed place that
    /// it sees.
    fn way_back(&self, map: &Map, body: &CharacterProfile, feet: Vec3, end: Vec3) -> Option<Vec3> {
        let until = after_nearest(&self.rehearsed_way, end);
        let seen = self.rehearsed_way[..until].iter().rposition(|place| sees(map, body, feet, *place))?;
        self.rehearsed_way[seen..until].iter().find(|place| place.distance(feet) > REACHED_M).copied()
    }
}

/// Index after the place that is nearest to `end`, m.
fn after_nearest(way: &[Vec3], end: Vec3) -> usize {
    let distance = |idx: &usize| way[*idx].distance_squared(end);
    (0..way.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(0, |idx| idx + 1)
}

/// Whether no wall lies between a body at `feet` and `end`, m.
fn sees(map: &Map, body: &CharacterProfile, feet: Vec3, end: Vec3) -> bool {
    let way = end - feet;
    let flat = Vec3::new(way.x, 0.0, way.z);
    if flat.length() < body.radius {
        return true;
    }
    let aside = Vec3::new(-flat.z, 0.0, flat.x) * (0.8 * body.radius / flat.length());
    let chest = Vec3::Y * (0.6 * body.height);
    let length = way.length();
    [-1.0, 1.0].iter().all(|side| {
        let hit = map.mesh().cast_ray(feet + chest + aside * *side, way / length, length);
        hit.is_none_or(|hit| !hit.surface.is_solid())
    })
}
