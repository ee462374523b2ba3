//! Crossings: ways by what a body climbs, across water, along walls, and by its own moves.
//!
//! A scripted body has made the crossings of a map. An [`Approach`] between two places is only guessed; trials and
//! rehearsals show whether a body gets there.

mod approach;
mod between;
mod walls;

pub use approach::Approach;
pub use between::{approach_between, swims_between};

use crate::character::{Action, Body, CharacterProfile, MoveScratch, OwnMotion};
use crate::float::{heading, horizontal};
use crate::map::{CollisionMap, Liquid, Pool};
use crate::navigable::stand_near;
use crate::{Ability, AbilitySet, TICKS_PER_DECISION, TICKS_PER_SECOND, Vec3};
use approach::{LEAST_CLIMB_M, climbed_at, taken, tethered};

/// How far below the lower edge of a face a body stands, m.
const BELOW_M: f32 = 1.0;
/// Time besides that for the distance, s, after which a crossing has failed.
const PATIENCE_S: f32 = 4.0;
/// Distance between places on the shores of a pool and of islands in it from which bodies swim, m, most of them along a
/// side, and how far beyond the pool they lie, m.
const SPACING_M: f32 = 2.5;
const MOST_PLACES: u32 = 20;
const SHORE_M: f32 = 1.5;
/// Height above or below the water of such places, m.
const SHORE_RISE_M: f32 = 3.0;
/// Other shores to which a body swims from each.
const SHORES: usize = 4;
/// Distance from a shore at which a body has reached it, m.
const ASHORE_M: f32 = 1.0;
/// How near the end of a way of its own a body stands before it, m.
const NEAR_M: f32 = 0.5;
/// Directions around an anchor from which bodies are pulled to it, and their distances, as shares of the range.
const SIDES: u32 = 8;
const SHARES: [f32; 2] = [0.45, 0.75];

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

/// A map with a body, and the memory of its moves.
struct Scripted<'a> {
    map: &'a CollisionMap,
    profile: &'a CharacterProfile,
    scratch: MoveScratch,
}

/// The crossings of a map, in a fixed order.
pub fn crossings(map: &CollisionMap, profile: &CharacterProfile) -> Vec<Crossing> {
    let mut scripted = Scripted { map, profile, scratch: MoveScratch::default() };
    let mut found = Vec::new();
    if profile.climb_speed > 0.0 {
        found.extend(map.mesh().climb_spots().iter().filter_map(|spot| {
            let approach = climbed_at(*spot, profile.radius);
            let crossing = scripted.cross(approach, BELOW_M, spot.height / profile.climb_speed)?;
            (crossing.to.y - crossing.from.y >= LEAST_CLIMB_M).then_some(crossing)
        }));
    }
    let is_water = |pool: &&Pool| pool.liquid == Liquid::Water && profile.swim_speed > 0.0;
    map.placed().pools.iter().filter(is_water).for_each(|pool| found.extend(scripted.swims_in(pool)));
    for spot in &map.placed().spots {
        let fitting = profile.own_moves().filter(|(_, own)| own.fits(spot));
        for (by, own) in fitting {
            match own.motion {
                OwnMotion::Curve => found.extend(
                    spot.ways()
                        .filter_map(|way| scripted.cross(taken(way, by), NEAR_M, way[0].distance(way[1]) / own.speed)),
                ),
                OwnMotion::Tether => {
                    for at in spot.ends() {
                        found.extend(scripted.pulls_to(at, own.range, by));
                    }
                }
            }
        }
    }
    if profile.wall_run_seconds > 0.0 {
        let runs = walls::runs(map, profile);
        found.extend(
            runs.into_iter()
                .filter_map(|run| scripted.cross(run, NEAR_M, horizontal(run.to - run.at) / profile.forward_speed)),
        );
    }
    found
}

impl Scripted<'_> {
    /// Lets the body go by an approach; `None` if it does not get there. `below` is how far from the approach's height
    /// the body may stand before, m, and `seconds` what the crossing takes.
    fn cross(&mut self, approach: Approach, below: f32, seconds: f32) -> Option<Crossing> {
        let Approach { at, to, by, .. } = approach;
        let mut stand = |at| stand_near(self.map, self.profile, at, self.profile.radius, below, &mut self.scratch);
        let from = stand(approach.start()).or_else(|| stand(at))?;
        let body = Body::at(from, heading(approach.toward - from));
        let beyond = 0.5 * from.distance(to);
        let is_there = |body: &Body, used: AbilitySet| {
            used.contains(by) && body.feet.distance(from) > beyond && approach.is_past(body.feet)
        };
        let profile = self.profile;
        let act = |body: &Body| approach.ahead(body, profile);
        let (to, _) = self.act(body, seconds, act, is_there)?;
        self.map.liquid_at(to, 0.0).is_none().then_some(Crossing { from, to, by })
    }

    /// Lets bodies be pulled to an anchor from places around it.
    fn pulls_to(&mut self, anchor: Vec3, range: f32, by: Ability) -> Vec<Crossing> {
        let angles = (0..SIDES).map(|side| std::f32::consts::TAU * side as f32 / SIDES as f32);
        let places = angles.flat_map(|angle| SHARES.map(|share| (angle, share * range)));
        let crossings = places.filter_map(|(angle, metres)| {
            let (sin, cos) = libm::sincosf(angle);
            let at = anchor + Vec3::new(sin, 0.0, cos) * metres;
            let near = stand_near(self.map, self.profile, at, self.profile.radius, range, &mut self.scratch)?;
            self.cross(tethered([near, anchor], anchor, by), NEAR_M, 2.0 * range / self.profile.forward_speed)
        });
        crossings.collect()
    }

    /// Lets bodies swim in a pool, from each place to stand around it and on islands in it to the nearest others.
    fn swims_in(&mut self, pool: &Pool) -> Vec<Crossing> {
        let (map, profile) = (self.map, self.profile);
        let (half_x, half_z) = pool.outline.half_extents();
        let places = |half: f32| {
            let count = ((2.0 * (half + SHORE_M) / SPACING_M).ceil() as u32).clamp(2, MOST_PLACES);
            (0..=count).map(move |idx| (2.0 * idx as f32 / count as f32 - 1.0) * (half + SHORE_M))
        };
        let is_ashore = |at: Vec3| {
            let around = (0..8).map(|side| libm::sincosf(side as f32 * std::f32::consts::FRAC_PI_4));
            let low = pool.centre.y - BELOW_M;
            around
                .into_iter()
                .any(|(sin, cos)| map.is_open_water((at + Vec3::new(sin, 0.0, cos) * SPACING_M).with_y(low)))
        };
        let grid = places(half_x).flat_map(|x| places(half_z).map(move |z| pool.centre + Vec3::new(x, 0.0, z)));
        let shores = grid
            .filter(|at| is_ashore(*at))
            .filter_map(|at| stand_near(map, profile, at, profile.radius, SHORE_RISE_M, &mut self.scratch));
        let shores: Vec<Vec3> = shores.collect();
        let mut found = Vec::new();
        for &from in &shores {
            let mut others: Vec<Vec3> = shores.iter().copied().filter(|to| *to != from).collect();
            others.sort_by(|a, b| from.distance(*a).total_cmp(&from.distance(*b)));
            let others = others.into_iter().filter(|to| swims_between(map, profile, [from, *to]));
            let others: Vec<Vec3> = others.take(SHORES).collect();
            for to in others {
                let body = Body::at(from, heading(to - from));
                let seconds = 1.5 * from.distance(to) / profile.swim_speed;
                let is_there = |body: &Body, _| horizontal(body.feet - to) <= ASHORE_M;
                let act = |_: &Body| Action { forward: 1.0, ..Action::default() };
                let reached = self.act(body, seconds, act, is_there);
                found.extend(reached.map(|(to, used)| {
                    let by = if used.contains(Ability::DIVE) { Ability::DIVE } else { Ability::SWIM };
                    Crossing { from, to, by }
                }));
            }
        }
        found
    }

    /// Lets a body act for so many seconds and some more, until it stands and `is_there`. Returns where, and the
    /// abilities that it has used.
    fn act(
        &mut self,
        mut body: Body,
        seconds: f32,
        action: impl Fn(&Body) -> Action,
        is_there: impl Fn(&Body, AbilitySet) -> bool,
    ) -> Option<(Vec3, AbilitySet)> {
        let (map, profile) = (self.map, self.profile);
        let mut used = AbilitySet::default();
        let mut current = Action::default();
        for tick in 0..((seconds + PATIENCE_S) * TICKS_PER_SECOND as f32) as u32 {
            if tick % TICKS_PER_DECISION == 0 {
                current = action(&body);
                body.begin_decision(&current);
            }
            used = used.union(body.tick(map, profile, &current, &mut self.scratch));
            let is_harmed = map.liquid_at(body.feet, 0.0).is_some_and(|liquid| profile.is_harmed_by(liquid));
            if map.is_outside(body.feet) || is_harmed || body.is_out_of_breath(profile) {
                return None;
            }
            if body.is_grounded() && is_there(&body, used) {
                return Some((body.feet, used));
            }
        }
        None
    }
}
