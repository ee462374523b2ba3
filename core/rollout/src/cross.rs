//! Crossings without the policy: to where a move begins, on through it, and straight on from where it ends.
//!
//! Like [leaps](crate::leap), crossings are steered without sensing, and their rehearsals show whether the NPC arrives
//! so.

use crate::steer::Course;
use surefoot_world::character::Body;
use surefoot_world::crossings::Approach;
use surefoot_world::{Ability, Action, CharacterProfile, DECISION_SECONDS, Vec3};

/// How far beside its way a body begins a crossing, at most, m: climbs begin in the middle of ladders. One that drifts
/// farther than `DRIFT_M` aside in a decision begins nearer.
const ASIDE_M: f32 = 0.35;
const DRIFT_M: f32 = 0.15;
/// How far before a crossing begins a body heads through it, m, and how far behind.
const NEAR_M: f32 = 0.5;
/// How far from the middle of a ladder a body walks around it, m.
const AROUND_M: f32 = 1.5;
/// Least cosine of the angle between the ways to and from the beginning at which a body does not stop there.
const ALIGNED: f32 = 0.9;
/// Height above the beginning from which a body is on its way, m.
const ON_M: f32 = 0.3;

/// A crossing, and the leg that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cross {
    /// The crossing.
    pub approach: Approach,
    /// The course of the leg, from where the crossing ends.
    pub course: Course,
}

impl Cross {
    /// The action of a body on this crossing.
    pub fn action(&self, body: &Body, profile: &CharacterProfile) -> Action {
        let it = self.approach;
        let stands = body.is_grounded() && !body.is_carried();
        let has_crossed = stands && body.feet.distance(it.to) < body.feet.distance(it.at);
        if has_crossed || it.is_past_anchor(body, profile) {
            return self.course.action(body, profile);
        }
        let start = it.start();
        let beyond = it.beyond(body.feet);
        let is_on = !stands && (body.feet.y > it.at.y + ON_M || beyond > 0.0);
        // It also passes the beginning at speed, if it does not drift aside.
        let drifts = it.aside(it.at + body.velocity * DECISION_SECONDS) > DRIFT_M;
        let most = if drifts { DRIFT_M } else { ASIDE_M };
        let is_before = it.aside(body.feet) <= most && (it.beyond(start) - NEAR_M..NEAR_M).contains(&beyond);
        let straight = Course::straight(it.toward);
        if !is_on && it.by == Ability::CLIMB && beyond > NEAR_M {
            return self.around(body).action(body, profile);
        }
        if !is_on && !is_before {
            // From the side, a body would slide past a ladder.
            let way = |from: Vec3, to: Vec3| (to - from).with_y(0.0).normalize_or_zero();
            let is_aligned = way(body.feet, start).dot(way(start, it.toward)) > ALIGNED;
            let course = Course { to: start, then: Some(it.toward).filter(|_| is_aligned), ..straight };
            return course.action(body, profile);
        }
        let jump = if it.wants_jump(body, profile) { 1.0 } else { -1.0 };
        Action { jump, ..straight.action(body, profile) }
    }

    /// The course of a body that is behind what it is to climb: around it, on the side where it is.
    fn around(&self, body: &Body) -> Course {
        let it = self.approach;
        let way = it.way();
        let across = Vec3::new(-way.z, 0.0, way.x);
        let side = if (body.feet - it.at).dot(across) < 0.0 { -AROUND_M } else { AROUND_M };
        Course { then: Some(it.at), ..Course::straight(it.at + across * side) }
    }
}
