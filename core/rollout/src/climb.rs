//! Climbs without the policy: to the foot of what is climbed, into it up to its top, and straight on from there.
//!
//! Like [leaps](crate::leap), climbs are steered without sensing, and their rehearsals show whether the NPC arrives so.

use crate::steer::Course;
use surefoot_world::character::Body;
use surefoot_world::crossings::before;
use surefoot_world::mesh::ClimbSpot;
use surefoot_world::{Action, CharacterProfile};

/// How far beside the spot a body begins its climb, at most, m.
const ASIDE_M: f32 = 0.15;
/// Distance in front of the face from which a body walks into it, besides its radius, m.
const NEAR_M: f32 = 0.5;
/// Height above the foot from which a body is on the face, and below the top up to which it is, m.
const ON_M: f32 = 0.3;
/// How far behind the face the place is to which a body climbs, m.
const BEHIND_M: f32 = 3.0;

/// A climb, and the leg that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Climb {
    /// Where it begins.
    pub spot: ClimbSpot,
    /// The course of the leg, from the top on.
    pub course: Course,
}

impl Climb {
    /// The action of a body on this climb.
    pub fn action(&self, body: &Body, profile: &CharacterProfile) -> Action {
        let ClimbSpot { at, out, height } = self.spot;
        let offset = body.feet - at;
        if body.is_grounded() && offset.y > height - ON_M {
            return self.course.action(body, profile);
        }
        let in_front = offset.dot(out);
        let aside = (offset - out * in_front).with_y(0.0).length();
        let is_before = aside <= ASIDE_M && (0.0..=profile.radius + NEAR_M).contains(&in_front);
        let behind = at - out * BEHIND_M;
        let straight = Course::straight(behind);
        if is_before || !body.is_grounded() && offset.y > ON_M {
            return straight.action(body, profile);
        }
        let course = Course { to: before(self.spot, profile.radius), then: Some(behind), ..straight };
        course.action(body, profile)
    }
}
