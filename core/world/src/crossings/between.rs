//! Crossings by which a body could get from one place to another.

use super::approach::{Approach, BEYOND_ANCHOR_M, LEAST_CLIMB_M, climbed_at, taken, tethered};
use super::walls;
use crate::character::{CharacterProfile, OwnMotion};
use crate::float::horizontal;
use crate::map::CollisionMap;
use crate::{Ability, Vec3};

/// How far from a crossing, on the plane and in height, a way by it begins and ends, m.
const BESIDE_M: f32 = 14.0;
const LEVEL_M: f32 = 2.0;
/// How far above the foot of a climb something may lie in the way, m.
const LOW_M: f32 = 0.5;
/// How far above an anchor a body may land, m.
const ABOVE_ANCHOR_M: f32 = 2.0;
/// Distance between two places of a way that are tried for water, m.
const SAMPLE_M: f32 = 0.5;

/// The approach by which a body could get from one place to another, m: the one with the shortest way. `by` is the
/// ability, if it is known. No body has gone there.
pub fn approach_between(
    map: &CollisionMap,
    profile: &CharacterProfile,
    [from, to]: [Vec3; 2],
    by: Option<Ability>,
) -> Option<Approach> {
    let metres = |it: &Approach| horizontal(it.at - from) + horizontal(it.to - to);
    let is_level = |one: Vec3, other: Vec3| (one.y - other.y).abs() <= LEVEL_M;
    let is_near = |one: Vec3, other: Vec3| is_level(one, other) && horizontal(one - other) <= BESIDE_M;
    let leads = |it: &Approach| is_near(it.at, from) && is_near(it.to, to);
    let is_wanted = |ability: Ability| by.is_none_or(|by| by == ability);
    let mut best: Option<Approach> = None;
    let mut consider = |it: Approach| {
        if best.is_none_or(|best| metres(&it) < metres(&best)) {
            best = Some(it);
        }
    };
    if profile.climb_speed > 0.0 && to.y - from.y >= LEAST_CLIMB_M && is_wanted(Ability::CLIMB) {
        let climbs = map.mesh().climb_spots().iter().map(|spot| climbed_at(*spot, profile.radius));
        // A ladder in a hatch has a side below the floor above.
        let is_open = |it: &Approach| {
            let free = it.to.y - it.at.y + 0.5 * profile.least_height() - LOW_M;
            let hit = map.mesh().cast_ray(it.at + Vec3::Y * LOW_M, Vec3::Y, free);
            hit.is_none_or(|hit| !hit.surface.is_solid())
        };
        climbs.filter(leads).filter(is_open).for_each(&mut consider);
    }
    for (ability, own) in profile.own_moves().filter(|(ability, _)| is_wanted(*ability)) {
        let spots = map.placed().spots.iter().filter(|spot| own.fits(spot));
        match own.motion {
            OwnMotion::Curve => {
                let ways = spots.flat_map(|spot| spot.ways());
                ways.map(|way| taken(way, ability)).filter(leads).for_each(&mut consider);
            }
            OwnMotion::Tether => {
                let leads_on = |anchor: &Vec3| {
                    let [way, rest] = [*anchor - from, to - *anchor].map(|it| it.with_y(0.0));
                    anchor.distance(from) <= own.range
                        && to.y <= anchor.y + ABOVE_ANCHOR_M
                        && rest.length() <= BEYOND_ANCHOR_M
                        && way.dot(to - from) >= 0.0
                };
                let anchors = spots.flat_map(|spot| spot.ends()).filter(leads_on);
                anchors.map(|anchor| tethered([from, anchor], to, ability)).for_each(&mut consider);
            }
        }
    }
    if best.is_none() && is_wanted(Ability::WALL_RUN) {
        best = walls::run_between(map, profile, [from, to]);
    }
    best
}

/// Whether a body would swim on the straight way from one place to another, m.
pub fn swims_between(map: &CollisionMap, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> bool {
    if profile.swim_speed <= 0.0 || map.placed().pools.is_empty() {
        return false;
    }
    let count = (from.distance(to) / SAMPLE_M).ceil().max(1.0);
    let low = from.y.min(to.y);
    let is_wet = |at: Vec3| [1.0, 2.0].into_iter().any(|down| map.is_open_water(at.with_y(low - down)));
    (1..count as u32).any(|idx| is_wet(from.lerp(to, idx as f32 / count)))
}
