//! Ways around what bars a leg: where a body could walk to the end of a leg, but not straight, the corners of the walk
//! become waypoints of the plan.
//!
//! No proof covers them. Their rehearsals show whether the NPC arrives. Where it does not, its policy takes the leg.

use super::ground::Ground;
use std::ops::RangeInclusive;
use surefoot_planner::{Leg, LegKey, Plan};
use surefoot_world::{Ability, Chance, Seconds, Vec3};

/// If `may_look`, makes the corners of ways around what bars the walks of a plan from `feet`, m, its waypoints. The
/// parts of a leg keep its key. The `leaps` become legs that jump.
pub(super) fn lead_around(plan: &mut Plan, feet: Vec3, leaps: &[LegKey], may_look: bool, ground: &impl Ground) {
    let waypoints = std::mem::take(&mut plan.waypoints);
    let legs = std::mem::take(&mut plan.legs);
    let mut start = feet;
    for (end, leg) in waypoints.into_iter().zip(legs) {
        let is_leap = leaps.contains(&leg.key);
        // A proof covers leaps on the straight way, but walls stand in the way of every walk.
        let may_walk =
            leg.ability == Ability::WALK && !is_leap && (leg.key.edge().is_none() || ground.is_walled(start, end));
        let is_barred = may_look && may_walk && !ground.is_walk(start, end);
        let way = if is_barred { ground.walk_around(start, end) } else { None };
        let ability = if is_leap { Ability::JUMP } else { leg.ability };
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
