//! Waypoints between two walk legs move: where a gait keeps a distance from walls and rims, to where there is room;
//! otherwise towards the straight way between their neighbours, since vertices lie beside the shortest way.
//!
//! No proof covers the moved waypoints. Where the rehearsal of a leg fails, its NPC takes the legs of the plan.

use super::ground::Ground;
use super::shortcuts::Shortcuts;
use std::ops::RangeInclusive;
use surefoot_planner::Plan;
use surefoot_world::float::share_along;
use surefoot_world::{Ability, Vec3};

/// Distance between two places of a leg at which the room is measured, m.
const SAMPLE_M: f32 = 1.0;
/// Least distance by which waypoints move for the room between them, and towards the straight way, m.
const LEAST_M: f32 = 0.1;
/// Shares of the distance to the straight way by which a waypoint may move, and how often all move.
const PULLS: [f32; 4] = [0.8, 0.6, 0.4, 0.2];
const PASSES: usize = 2;

/// What a plan keeps from walls, and which of its waypoints have moved.
#[derive(Debug, Clone, Default)]
pub(super) struct Clearance {
    /// Where the plan begins, m; `None` if it keeps no distance.
    start: Option<Vec3>,
    /// Waypoints that have moved, by index, and where they were, m.
    moved: Vec<(usize, Vec3)>,
}

impl Clearance {
    /// Moves waypoints of a plan from `feet`, m, to where a body has `margin` metres of room besides its radius.
    pub fn make(plan: &mut Plan, feet: Vec3, margin: f32, ground: &impl Ground) -> Self {
        if margin <= 0.0 {
            return Self::default();
        }
        let mut clearance = Self { start: Some(feet), moved: Vec::new() };
        let legs = 0..plan.legs.len();
        for idx in legs.clone().filter(|idx| moves(plan, *idx)).collect::<Vec<_>>() {
            let place = ground.with_room(plan.waypoints[idx], margin);
            clearance.shift(plan, idx, place - plan.waypoints[idx], ground);
        }
        for leg in legs {
            let from = leg.checked_sub(1).map_or(feet, |before| plan.waypoints[before]);
            let Some((share, offset)) = narrowest(plan, leg, from, margin, ground) else { continue };
            // Of the straight line between both waypoints, the narrowest place moves by the whole offset.
            let weight = 1.0 / (share * share + (1.0 - share) * (1.0 - share));
            if let Some(before) = leg.checked_sub(1) {
                clearance.shift(plan, before, offset * ((1.0 - share) * weight), ground);
            }
            clearance.shift(plan, leg, offset * (share * weight), ground);
        }
        clearance
    }

    /// Moves a waypoint by `offset`, m, if the body can walk straight there and on.
    fn shift(&mut self, plan: &mut Plan, idx: usize, offset: Vec3, ground: &impl Ground) {
        if offset == Vec3::ZERO || !moves(plan, idx) {
            return;
        }
        let Some(before) = idx.checked_sub(1).map_or(self.start, |before| Some(plan.waypoints[before])) else { return };
        let (former, after) = (plan.waypoints[idx], plan.waypoints[idx + 1]);
        let place = former + offset;
        if ground.is_way(before, place) && ground.is_way(place, after) {
            self.place(plan, idx, place);
        }
    }

    fn place(&mut self, plan: &mut Plan, idx: usize, place: Vec3) {
        let former = std::mem::replace(&mut plan.waypoints[idx], place);
        if self.moved.iter().all(|(moved, _)| *moved != idx) {
            self.moved.push((idx, former));
        }
    }

    /// Whether an end of the leg `leg` has moved.
    pub fn changes(&self, leg: usize) -> bool {
        self.moved.iter().any(|(idx, _)| *idx == leg || idx + 1 == leg)
    }

    /// Moves waypoints of a plan from `feet`, m, towards the straight way between their neighbours, as far as the body
    /// has lanes to and from there. The ways between them are shortcuts, or legs.
    pub fn tighten(
        &mut self,
        plan: &mut Plan,
        feet: Vec3,
        shortcuts: &Shortcuts,
        is_lane: impl Fn(Vec3, Vec3) -> bool,
    ) {
        for _ in 0..PASSES {
            let (mut from, mut leg) = (feet, shortcuts.end(0));
            while leg + 1 < plan.legs.len() {
                let next = shortcuts.end(leg + 1);
                let (at, to) = (plan.waypoints[leg], plan.waypoints[next]);
                let offset = from + (to - from) * share_along(to - from, at - from) - at;
                if moves(plan, leg) && offset.length() >= LEAST_M {
                    let mut places = PULLS.into_iter().map(|share| at + offset * share);
                    let place = places.find(|place| is_lane(from, *place) && is_lane(*place, to));
                    place.into_iter().for_each(|place| self.place(plan, leg, place));
                }
                (from, leg) = (plan.waypoints[leg], next);
            }
        }
    }

    /// Moves the waypoints of a plan with these indices back to where the plan had them; returns whether any had moved.
    pub fn undo(&mut self, plan: &mut Plan, legs: RangeInclusive<usize>) -> bool {
        let (back, kept): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.moved).into_iter().partition(|(idx, _)| legs.contains(idx));
        back.iter().for_each(|(idx, place)| plan.waypoints[*idx] = *place);
        self.moved = kept;
        !back.is_empty()
    }

    /// Undoes what has moved at the ends of these legs of a plan, which become the last of them.
    pub fn merge(&mut self, plan: &mut Plan, legs: &RangeInclusive<usize>) {
        let fewer = legs.end() - legs.start();
        self.undo(plan, legs.start().saturating_sub(1)..=*legs.end());
        self.moved.iter_mut().filter(|(idx, _)| idx > legs.end()).for_each(|(idx, _)| *idx -= fewer);
    }

    /// The corner at which the walk leg `leg` of a plan begins, or the shortcut that contains it, and the waypoint
    /// before, m; `None` if the body keeps no distance from walls, or did not walk there.
    pub fn corner(&self, plan: &Plan, leg: usize, shortcuts: &Shortcuts) -> Option<[Vec3; 2]> {
        let start = self.start?;
        let last = shortcuts.begin(leg).checked_sub(1).filter(|last| plan.legs[*last].ability == Ability::WALK)?;
        let before = shortcuts.begin(last).checked_sub(1).map_or(start, |before| plan.waypoints[before]);
        Some([plan.waypoints[last], before])
    }
}

/// Whether a waypoint of a plan is between two walk legs.
fn moves(plan: &Plan, idx: usize) -> bool {
    let is_walk = |leg: usize| plan.legs.get(leg).is_some_and(|leg| leg.ability == Ability::WALK);
    is_walk(idx) && is_walk(idx + 1)
}

/// The place on a leg from `from`, m, that has the least room, as a share of the leg, and the offset from it to where
/// there is `margin`, m; `None` if the leg is not walked, or has that room.
fn narrowest(plan: &Plan, leg: usize, from: Vec3, margin: f32, ground: &impl Ground) -> Option<(f32, Vec3)> {
    let to = plan.waypoints[leg];
    if plan.legs[leg].ability != Ability::WALK || ground.is_lane(from, to, margin) {
        return None;
    }
    let count = (from.distance(to) / SAMPLE_M).ceil() as u32;
    let offset = |idx: u32| {
        let share = idx as f32 / count as f32;
        let place = from.lerp(to, share);
        (share, (ground.with_room(place, margin) - place).with_y(0.0))
    };
    let offsets = (1..count).map(offset);
    let (share, most) = offsets.max_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared()))?;
    (most.length() >= LEAST_M).then_some((share, most))
}
