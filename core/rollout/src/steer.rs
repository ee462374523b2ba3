//! Steering along legs that can be walked: straight to the waypoint, without the policy.
//!
//! A body turns to its way while it sets out, slows down at corners and before its goal, and starts gently. It
//! senses nothing: the [rehearsal](crate::rehearse) of a leg shows whether it arrives so, and where it does not, the
//! policy walks.

use std::f32::consts::FRAC_PI_2;
use surefoot_world::character::Body;
use surefoot_world::float::{heading, horizontal, hypot, share_along, wrapped};
use surefoot_world::{Action, CharacterProfile, DECISION_SECONDS, Gait, Vec3};

/// Share of the acceleration on the ground with which a body brakes.
pub(crate) const BRAKE: f32 = 0.6;
/// Angle to the side at which a body moves, at most, rad.
const ASIDE: f32 = 0.35;
/// Distance over which a body turns to its way on an arc, and that over which it takes a corner, m.
const ARC_M: f32 = 2.0;
const BEND_M: f32 = 1.2;
/// Distance before its goal at which a body stands, m.
const STOP_M: f32 = 0.3;
/// Distance from a waypoint, which is passed within 1 m, up to which a body cuts the corner, m.
const CUT_M: f32 = 0.6;
/// Distance before a waypoint at which its corner begins, m.
const CORNER_M: f32 = 0.8;
/// Least speed at corners, m/s.
const CREEP: f32 = 1.0;
/// Angle between facing and motion up to which a body does not turn, rad.
const SLACK: f32 = 0.05;

/// Where a body walks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    /// The waypoint, m.
    pub to: Vec3,
    /// The waypoint after it, m, if the body walks there too.
    pub then: Option<Vec3>,
    /// Whether the body cuts the corner at the waypoint.
    pub cuts: bool,
    /// How the body goes.
    pub gait: Gait,
    /// The corner that the body takes before it walks to `to`, and the waypoint before that, m; `None`: the body turns
    /// as soon as it has passed the corner within 1 m.
    pub around: Option<[Vec3; 2]>,
}

impl Course {
    /// A course that ends at `to`, m, without a corner, in the default gait.
    pub fn straight(to: Vec3) -> Self {
        Self { to, then: None, cuts: false, gait: Gait::DEFAULT, around: None }
    }

    /// The action of a body on this course.
    pub fn action(&self, body: &Body, profile: &CharacterProfile) -> Action {
        if let Some(course) = self.before_corner(body.feet) {
            return course.action(body, profile);
        }
        let rest = Action { jump: -1.0, ..Action::default() };
        let aim = self.aim(body.feet);
        let left = horizontal(aim - body.feet);
        let Some(way) = (aim - body.feet).with_y(0.0).try_normalize() else { return rest };
        let towards = heading(way);
        let off = wrapped(towards - body.yaw);
        let most = profile.turn_speed * DECISION_SECONDS;
        let most_here = self.gait.turn_rate * most;
        let turn = turn_by(off, most_here);
        // The body goes where it faces in the middle of the decision, or a little to the side.
        let off = wrapped(off - 0.5 * turn);
        let aside = off.clamp(-ASIDE, ASIDE);
        let corner = self.then.map(|then| heading(then - aim) - towards);
        let speed = speed(body, profile, self.gait, left, (off - aside, corner)) / profile.forward_speed;
        Action { turn: turn / most, ..moving(aside, speed, profile) }
    }

    /// Where the body walks to from `feet`: the waypoint, or past it on the inner side of its corner.
    fn aim(&self, feet: Vec3) -> Vec3 {
        let Some(then) = self.then.filter(|_| self.cuts) else { return self.to };
        let (along, offset) = ((then - feet).with_y(0.0), (self.to - feet).with_y(0.0));
        self.to
            + (along * share_along(along, offset) - offset).clamp_length_max((CUT_M - self.gait.wall_distance).max(0.0))
    }

    /// The course of a body that has not taken its corner yet: up to the line that halves the angle there.
    fn before_corner(&self, feet: Vec3) -> Option<Self> {
        let [corner, before] = self.around?;
        let way = |from: Vec3, to: Vec3| (to - from).with_y(0.0).normalize_or_zero();
        let is_ahead = (feet - corner).dot(way(before, corner) + way(corner, self.to)) < 0.0;
        is_ahead.then_some(Self { to: corner, then: Some(self.to), cuts: false, around: None, ..*self })
    }
}

/// The turn of a body whose way leads `off` its facing, rad, by at most `most`, rad.
pub(crate) fn turn_by(off: f32, most: f32) -> f32 {
    if off.abs() <= SLACK { 0.0 } else { off.clamp(-most, most) }
}

/// The action of a body that moves at a share of its top speed, `aside` to the left of where it faces, rad, and does
/// not jump.
pub(crate) fn moving(aside: f32, share: f32, profile: &CharacterProfile) -> Action {
    let (sin, cos) = libm::sincosf(aside);
    let side = profile.side_speed_share;
    let strafe = if side > 0.0 { -sin * share / side } else { 0.0 };
    Action { forward: (cos * share).clamp(-1.0, 1.0), strafe: strafe.clamp(-1.0, 1.0), turn: 0.0, jump: -1.0 }
}

/// The speed of a body, `left` metres from where it walks to. Its way leads `off` its motion, rad, and turns there by
/// the angle `corner`, rad; without a further way the body stops there.
fn speed(body: &Body, profile: &CharacterProfile, gait: Gait, left: f32, (off, corner): (f32, Option<f32>)) -> f32 {
    let top = gait.speed * profile.forward_speed;
    // On an arc that turns by `angle` over a distance, a body turns at its turning speed.
    let arc = |angle: f32, over_m: f32| {
        let (sin, cos) = libm::sincosf(angle.abs().min(FRAC_PI_2));
        (gait.turn_rate * profile.turn_speed * over_m * cos.max(0.0) / sin.max(f32::EPSILON)).min(top)
    };
    let (brake, change) = (BRAKE * profile.ground_acceleration, gait.acceleration * profile.ground_acceleration);
    let (there, room) = match corner {
        Some(turn) => (arc(0.5 * wrapped(turn), BEND_M).max(CREEP), (left - CORNER_M).max(0.0)),
        None => (0.0, (left - STOP_M).max(0.0)),
    };
    // A decision passes before the next one can brake.
    let delay = brake * DECISION_SECONDS;
    let before = (delay * delay + there * there + 2.0 * brake * room).sqrt() - delay;
    let now = hypot(body.velocity.x, body.velocity.z);
    arc(off, 0.5 * left.min(ARC_M)).min(before.max(there)).min(now + change * DECISION_SECONDS)
}
