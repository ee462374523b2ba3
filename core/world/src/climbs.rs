//! Climbs: from which spots a body gets up what it climbs, and which of them leads from one place to another.

use crate::character::{Action, Body, CharacterProfile, MoveScratch};
use crate::float::{heading, horizontal};
use crate::map::CollisionMap;
use crate::mesh::ClimbSpot;
use crate::navigable::stand_near;
use crate::{TICKS_PER_SECOND, Vec3};

/// How far in front of a face, besides its radius, and how far below its lower edge a body stands, m.
const BEFORE_M: f32 = 0.1;
const BELOW_M: f32 = 1.0;
/// Least height of a climb, m: jumps and steps do what is lower.
const LEAST_M: f32 = 1.0;
/// Time besides that for the height, s, after which a climb has failed.
const PATIENCE_S: f32 = 4.0;
/// How far from a climb, on the plane and in height, a way by it begins and ends, m.
const BESIDE_M: f32 = 14.0;
const LEVEL_M: f32 = 2.0;

/// A climb that a body has made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Climb {
    /// Where it begins, m: a place to stand in front of the face.
    pub foot: Vec3,
    /// Where a body stands after it, m.
    pub top: Vec3,
}

/// The climbs of a map, in a fixed order.
pub fn climbs(map: &CollisionMap, profile: &CharacterProfile) -> Vec<Climb> {
    if profile.climb_speed <= 0.0 {
        return Vec::new();
    }
    let mut scratch = MoveScratch::default();
    map.mesh().climb_spots().iter().filter_map(|spot| climb_at(*spot, map, profile, &mut scratch)).collect()
}

/// The spot at which a body climbs on its way from one place up to another, m: the one with the shortest way to it and
/// from its top. No body has climbed there.
pub fn climb_between(map: &CollisionMap, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> Option<ClimbSpot> {
    if profile.climb_speed <= 0.0 || to.y - from.y < LEAST_M {
        return None;
    }
    let metres = |spot: &ClimbSpot| horizontal(spot.at - from) + horizontal(spot.at - to);
    let leads = |spot: &&ClimbSpot| {
        let is_level = |at: Vec3, height: f32| (at.y - height).abs() <= LEVEL_M;
        let is_near = |at: Vec3| horizontal(at - spot.at) <= BESIDE_M;
        is_level(from, spot.at.y) && is_level(to, spot.at.y + spot.height) && is_near(from) && is_near(to)
    };
    let spots = map.mesh().climb_spots().iter().filter(leads);
    spots.min_by(|a, b| metres(a).total_cmp(&metres(b))).copied()
}

/// Where a body with this radius, m, stands in front of a spot.
pub fn before(spot: ClimbSpot, radius: f32) -> Vec3 {
    spot.at + spot.out * (radius + BEFORE_M)
}

/// Lets a body climb at a spot; `None` if it does not get up.
fn climb_at(
    spot: ClimbSpot,
    map: &CollisionMap,
    profile: &CharacterProfile,
    scratch: &mut MoveScratch,
) -> Option<Climb> {
    let foot = stand_near(map, profile, before(spot, profile.radius), profile.radius, BELOW_M, scratch)?;
    let mut body = Body::at(foot, heading(-spot.out));
    let ahead = Action { forward: 1.0, ..Action::default() };
    let seconds = (spot.height + BELOW_M) / profile.climb_speed + PATIENCE_S;
    for _ in 0..(seconds * TICKS_PER_SECOND as f32) as u32 {
        body.tick(map, profile, &ahead, scratch);
        if map.is_outside(body.feet) || map.liquid_at(body.feet, 0.0).is_some() {
            return None;
        }
        let is_up = body.feet.y - foot.y >= LEAST_M;
        if is_up && body.is_grounded() && horizontal(body.feet - spot.at) > profile.radius {
            return Some(Climb { foot, top: body.feet });
        }
    }
    None
}
