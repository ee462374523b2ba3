//! Crossings: ways up what a body climbs, and across water that it swims in.
//!
//! A scripted body has made the crossings of a map. Those between two places are only guessed; their trials and
//! rehearsals show whether a body gets there.

use crate::character::{Action, Body, CharacterProfile, MoveScratch};
use crate::float::{heading, horizontal};
use crate::map::{CollisionMap, Liquid, Pool};
use crate::mesh::ClimbSpot;
use crate::navigable::stand_near;
use crate::{Ability, TICKS_PER_SECOND, Vec3};

/// How far in front of a face, besides its radius, and how far below its lower edge a body stands, m.
const BEFORE_M: f32 = 0.1;
const BELOW_M: f32 = 1.0;
/// Least height of a climb, m: jumps and steps do what is lower.
const LEAST_M: f32 = 1.0;
/// Time besides that for the distance, s, after which a crossing has failed.
const PATIENCE_S: f32 = 4.0;
/// How far from a climb, on the plane and in height, a way by it begins and ends, m.
const BESIDE_M: f32 = 14.0;
const LEVEL_M: f32 = 2.0;
/// Places along each side of a pool and beyond it from which bodies swim, and how far beyond, m.
const SHORE_PLACES: u32 = 8;
const SHORE_M: f32 = 1.5;
/// Height above or below the water of such places, m.
const SHORE_RISE_M: f32 = 3.0;
/// Other shores to which a body swims from each.
const SHORES: usize = 4;
/// Distance from a shore at which a body has reached it, m.
const ASHORE_M: f32 = 1.0;
/// Distance between two places of a way that are tried for water, m.
const SAMPLE_M: f32 = 0.5;

/// A crossing that a body has made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Where it begins, m.
    pub from: Vec3,
    /// Where a body stands after it, m.
    pub to: Vec3,
    /// How the body got there.
    pub by: Ability,
}

/// The crossings of a map, in a fixed order.
pub fn crossings(map: &CollisionMap, profile: &CharacterProfile) -> Vec<Crossing> {
    let mut scratch = MoveScratch::default();
    let spots = if profile.climb_speed > 0.0 { map.mesh().climb_spots() } else { &[] };
    let climbs: Vec<Crossing> = spots.iter().filter_map(|spot| climb_at(*spot, map, profile, &mut scratch)).collect();
    let is_water = |pool: &&Pool| pool.liquid == Liquid::Water && profile.swim_speed > 0.0;
    let pools = map.placed().pools.iter().filter(is_water);
    climbs.into_iter().chain(pools.flat_map(|pool| swims_in(pool, map, profile, &mut scratch))).collect()
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

/// Whether a body would swim on the straight way from one place to another, m.
pub fn swims_between(map: &CollisionMap, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> bool {
    if profile.swim_speed <= 0.0 || map.placed().pools.is_empty() {
        return false;
    }
    let count = (from.distance(to) / SAMPLE_M).ceil().max(1.0);
    let low = from.y.min(to.y);
    let is_wet = |at: Vec3| [1.0, 2.0].into_iter().any(|down| map.water_above(at.with_y(low - down)).is_some());
    (1..count as u32).any(|idx| is_wet(from.lerp(to, idx as f32 / count)))
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
) -> Option<Crossing> {
    let from = stand_near(map, profile, before(spot, profile.radius), profile.radius, BELOW_M, scratch)?;
    let seconds = (spot.height + BELOW_M) / profile.climb_speed;
    let is_up = |body: &Body| body.feet.y - from.y >= LEAST_M && horizontal(body.feet - spot.at) > profile.radius;
    let body = Body::at(from, heading(-spot.out));
    let to = walk_on(body, seconds, (map, profile), scratch, is_up)?;
    map.liquid_at(to, 0.0).is_none().then_some(Crossing { from, to, by: Ability::CLIMB })
}

/// Lets bodies swim in a pool, from each place to stand around it and on islands in it to the nearest others.
fn swims_in(pool: &Pool, map: &CollisionMap, profile: &CharacterProfile, scratch: &mut MoveScratch) -> Vec<Crossing> {
    let (half_x, half_z) = pool.outline.half_extents();
    let share = |idx: u32| 2.0 * idx as f32 / (SHORE_PLACES - 1) as f32 - 1.0;
    let grid = (0..SHORE_PLACES).flat_map(|x| (0..SHORE_PLACES).map(move |z| (share(x), share(z))));
    let shores = grid.filter_map(|(x, z)| {
        let at = pool.centre + Vec3::new(x * (half_x + SHORE_M), 0.0, z * (half_z + SHORE_M));
        stand_near(map, profile, at, profile.radius, SHORE_RISE_M, scratch)
    });
    let shores: Vec<Vec3> = shores.collect();
    let mut found = Vec::new();
    for &from in &shores {
        let mut others: Vec<Vec3> =
            shores.iter().copied().filter(|to| swims_between(map, profile, [from, *to])).collect();
        others.sort_by(|a, b| from.distance(*a).total_cmp(&from.distance(*b)));
        for &to in others.iter().take(SHORES) {
            let body = Body::at(from, heading(to - from));
            let seconds = 1.5 * from.distance(to) / profile.swim_speed;
            let is_there = |body: &Body| horizontal(body.feet - to) <= ASHORE_M;
            let reached = walk_on(body, seconds, (map, profile), scratch, is_there);
            found.extend(reached.map(|to| Crossing { from, to, by: Ability::SWIM }));
        }
    }
    found
}

/// Lets a body walk straight on for so many seconds and some more, until it stands and `is_there`. Returns where.
fn walk_on(
    mut body: Body,
    seconds: f32,
    (map, profile): (&CollisionMap, &CharacterProfile),
    scratch: &mut MoveScratch,
    is_there: impl Fn(&Body) -> bool,
) -> Option<Vec3> {
    let ahead = Action { forward: 1.0, ..Action::default() };
    for _ in 0..((seconds + PATIENCE_S) * TICKS_PER_SECOND as f32) as u32 {
        body.tick(map, profile, &ahead, scratch);
        let is_harmed = map.liquid_at(body.feet, 0.0).is_some_and(|liquid| profile.is_harmed_by(liquid));
        if map.is_outside(body.feet) || is_harmed {
            return None;
        }
        if body.is_grounded() && is_there(&body) {
            return Some(body.feet);
        }
    }
    None
}
