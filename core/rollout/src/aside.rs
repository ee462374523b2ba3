//! NPCs that others have pushed off their way: a leg was proved, and rehearsed, from elsewhere, and a wall may lie before its end.

use crate::follow::Follower;
use surefoot_world::{Ability, CharacterProfile, Map, Vec3};

/// Least distance of a place that an NPC heads for to get back on its way, m: nearer ones count as reached.
const LEAST_M: f32 = 0.5;

impl Follower {
    /// What an NPC does that has been pushed off its way, with the feet at `feet`, m: where a wall lies between it and the end of a leg that
    /// is walked, it heads for the last place of the rehearsed way that it sees. Returns its waypoint, m, if that is another one now.
    pub fn regain(&mut self, map: &Map, body: &CharacterProfile, feet: Vec3) -> Option<Vec3> {
        let (ability, end) = self.pace()?;
        let former = self.waypoint();
        let is_lost = ability == Ability::Walk && !sees(map, body, feet, end);
        let aside = if is_lost {
            let way = self.rehearsed_way();
            let until = nearest(way, end);
            let seen = way[..until].iter().rposition(|place| sees(map, body, feet, *place));
            // Whoever is there already goes on to what comes next.
            seen.and_then(|seen| way[seen..until].iter().find(|place| place.distance(feet) > LEAST_M)).copied()
        } else {
            None
        };
        self.turn_aside(is_lost, aside);
        self.waypoint().filter(|waypoint| former != Some(*waypoint))
    }
}

/// Index after the place that is nearest to `end`, m.
fn nearest(way: &[Vec3], end: Vec3) -> usize {
    let distance = |place: &Vec3| place.distance_squared(end);
    (0..way.len()).min_by(|a, b| distance(&way[*a]).total_cmp(&distance(&way[*b]))).map_or(0, |at| at + 1)
}

/// Whether a body at `feet` could walk straight to `end`, m, as far as walls are concerned.
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
