//! Ways around what bars a leg: where a body could walk to the end of a leg, but not straight, the corners of the walk
//! become waypoints of the plan.
//!
//! No proof covers them. Their rehearsals show whether the NPC arrives, and where it does not, its policy takes the leg.

use super::ground::Ground;
use std::ops::RangeInclusive;
use surefoot_planner::{Leg, LegKey, Plan};
use surefoot_world::{Ability, Chance, Seconds, Vec3};

/// The ways that were looked for, by leg: the corners of each way and its end, m; `None` if there is none.
#[derive(Debug, Clone, Default)]
pub(super) struct Ways(Vec<(LegKey, Option<Vec<Vec3>>)>);

impl Ways {
    /// Looks for ways along the legs of a plan from `feet`, m, that need no ability and cannot be walked straight.
    /// Returns those that no proof covers and that cannot be walked at all, and the time that the ways cost, s.
    /// Where the NPC keeps `margin` metres from walls, there are no ways, since they lead along walls.
    pub fn find(&mut self, plan: &Plan, feet: Vec3, margin: f32, ground: &impl Ground) -> (Vec<LegKey>, f32) {
        let (mut leaps, mut cost) = (Vec::new(), 0.0);
        let starts = std::iter::once(&feet).chain(&plan.waypoints);
        for (leg, (start, end)) in plan.legs.iter().zip(starts.zip(&plan.waypoints)) {
            if leg.ability != Ability::Walk || ground.is_walk(*start, *end) {
                continue;
            }
            if margin == 0.0 && !self.0.iter().any(|(key, _)| *key == leg.key) {
                self.0.push((leg.key, ground.walk_around(*start, *end)));
            }
            match self.of(leg.key) {
                Some(way) => cost += leg.seconds.0 * (length(*start, way) / start.distance(*end) - 1.0),
                None if leg.key.edge().is_none() => leaps.push(leg.key),
                None => {}
            }
        }
        (leaps, cost)
    }

    fn of(&self, leg: LegKey) -> Option<&[Vec3]> {
        self.0.iter().find(|(key, _)| *key == leg).and_then(|(_, way)| way.as_deref())
    }

    /// Makes the corners of the ways waypoints of a plan. Their legs keep the key of the leg that they replace.
    pub fn insert(&self, plan: &mut Plan) {
        let waypoints = std::mem::take(&mut plan.waypoints);
        let legs = std::mem::take(&mut plan.legs);
        for (waypoint, leg) in waypoints.into_iter().zip(legs) {
            let corners = self.of(leg.key).and_then(|way| way.split_last()).map_or(&[][..], |(_, corners)| corners);
            let seconds = Seconds(leg.seconds.0 / (corners.len() + 1) as f32);
            let to_corner = Leg { seconds, chance: Chance::new(1.0), death_chance: 0.0, ..leg };
            plan.legs.extend(corners.iter().map(|_| to_corner).chain([Leg { seconds, ..leg }]));
            plan.waypoints.extend(corners.iter().copied().chain([waypoint]));
        }
    }
}

/// Length of the way from `start`, m.
fn length(start: Vec3, way: &[Vec3]) -> f32 {
    std::iter::once(&start).chain(way).zip(way).map(|(from, to)| from.distance(*to)).sum()
}

/// The legs of the way that contains `leg`: those with its key.
pub(super) fn way_of(plan: &Plan, leg: usize) -> RangeInclusive<usize> {
    let is_same = |other: &Leg| other.key == plan.legs[leg].key;
    let before = plan.legs[..leg].iter().rev().take_while(|other| is_same(other)).count();
    let after = plan.legs[leg + 1..].iter().take_while(|other| is_same(other)).count();
    leg - before..=leg + after
}
