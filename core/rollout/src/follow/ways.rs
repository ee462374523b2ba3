//! Ways around what bars a leg: where a body could walk to the end of a leg, but not straight, the corners of the walk
//! become waypoints of the plan.
//!
//! No proof covers them. Their rehearsals show whether the NPC arrives. Where it does not, its policy takes the leg.

use super::ground::Ground;
use std::ops::RangeInclusive;
use surefoot_planner::{Leg, LegKey, Plan};
use surefoot_world::{Ability, Chance, Seconds, Vec3};

/// Makes the corners of ways around what bars these legs of a plan from `feet`, m, its waypoints. The parts of a leg
/// keep its key. Where `may_look` is false, or there is no way, a leg becomes a leap.
pub(super) fn lead_around(plan: &mut Plan, feet: Vec3, barred: &[LegKey], may_look: bool, ground: &impl Ground) {
    let waypoints = std::mem::take(&mut plan.waypoints);
    let legs = std::mem::take(&mut plan.legs);
    let mut start = feet;
    for (end, leg) in waypoints.into_iter().zip(legs) {
        let is_barred = barred.contains(&leg.key);
        let way = if is_barred && may_look { ground.walk_around(start, end) } else { None };
        let ability = if is_barred && way.is_none() { Ability::Jump } else { leg.ability };
        let corners = way.as_deref().and_then(<[Vec3]>::split_last).map_or(&[][..], |(_, corners)| corners);
        let seconds = Seconds(leg.seconds.0 / (corners.len() + 1) as f32);
        let to_corner = Leg { seconds, chance: Chance::new(1.0), death_chance: 0.0, ..leg };
        plan.legs.extend(corners.iter().map(|_| to_corner).chain([Leg { seconds, ability, ..leg }]));
        plan.waypoints.extend(corners.iter().copied().chain([end]));
        start = end;
    }
}

/// The legs of the way that contains `leg`: those with its key.
pub(super) fn way_of(plan: &Plan, leg: usize) -> RangeInclusive<usize> {
    let is_same = |other: &Leg| other.key == plan.legs[leg].key;
    let before = plan.legs[..leg].iter().rev().take_while(|other| is_same(other)).count();
    let after = plan.legs[leg + 1..].iter().take_while(|other| is_same(other)).count();
    leg - before..=leg + after
}
