//! Steering along legs that can be walked: straight to the waypoint, without the policy.
//!
//! A body turns to its way while it sets out, slows down at corners and before its goal, and starts gently. It
//! senses nothing: the [rehearsal](crate::rehearse) of a leg shows whether it arrives so, and where it does not, the
//! policy walks.

use surefoot_world::character::Body;
use surefoot_world::float::{horizontal, hypot, wrapped};
use surefoot_world::{Action, CharacterProfile, DECISION_SECONDS, Gait, Vec3};

/// Share of the acceleration on the ground with which a body brakes.
const BRAKE: f32 = 0.6;
/// Shares of the top speed of a body that turns back where it is, and at a corner.
const TURNING: f32 = 0.5;
const AT_CORNER: f32 = 0.6;
/// Distance before its goal at which a body stands, m.
const STOP_M: f32 = 0.3;
/// Distance from a waypoint, which is passed within 1 m, up to which a body cuts the corner, m.
const CUT_M: f32 = 0.6;
/// Distance before a waypoint at which its corner begins, m.
const CORNER_M: f32 = 0.8;
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
    /// How fast the body goes.
    pub gait: Gait,
}

impl Course {
    /// The action of a body on this course.
    pub fn action(&self, body: &Body, profile: &CharacterProfile) -> Action {
        let rest = Action { jump: -1.0, ..Action::default() };
        let aim = self.aim(body.feet);
        let left = horizontal(aim - body.feet);
        let Some(way) = (aim - body.feet).with_y(0.0).try_normalize() else { return rest };
        let heading = libm::atan2f(way.x, way.z);
        let top = profile.forward_speed;
        let off = wrapped(heading - body.yaw);
        let corner = self.then.map(|then| libm::atan2f(then.x - aim.x, then.z - aim.z) - heading);
        let speed = speed(body, profile, self.gait, left, (off, corner));
        let most = profile.turn_speed * DECISION_SECONDS;
        let turn = if off.abs() <= SLACK { 0.0 } else { off.clamp(-most, most) };
        // The body moves along the way while it turns.
        let (sin, cos) = libm::sincosf(body.yaw + 0.5 * turn);
        let (x, z) = (way.x * speed / top, way.z * speed / top);
        let (forward, right) = (x * sin + z * cos, z * sin - x * cos);
        let side = profile.side_speed_share;
        let strafe = if side > 0.0 { right / side } else { 0.0 };
        Action { forward: forward.clamp(-side, 1.0), strafe: strafe.clamp(-1.0, 1.0), turn: turn / most, ..rest }
    }

    /// Where the body walks to from `feet`: the waypoint, or past it on the inner side of its corner.
    fn aim(&self, feet: Vec3) -> Vec3 {
        let Some(then) = self.then.filter(|_| self.cuts) else { return self.to };
        let (along, offset) = ((then - feet).with_y(0.0), (self.to - feet).with_y(0.0));
        let share = (offset.dot(along) / along.length_squared().max(f32::EPSILON)).clamp(0.0, 1.0);
        self.to + (along * share - offset).clamp_length_max(CUT_M)
    }
}

/// The speed of a body, `left` metres from where it walks to. Its way leads `off` its heading, rad, and turns there by
/// the angle `corner`, rad; without a further way the body stops there.
fn speed(body: &Body, profile: &CharacterProfile, gait: Gait, left: f32, (off, corner): (f32, Option<f32>)) -> f32 {
    let top = gait.speed * profile.forward_speed;
    let around = |turn: f32, back: f32| top * (1.0 - 0.5 * (1.0 - back) * (1.0 - libm::cosf(turn)));
    let (brake, change) = (BRAKE * profile.ground_acceleration, gait.acceleration * profile.ground_acceleration);
    let (there, room) = match corner {
        Some(turn) => (around(turn, AT_CORNER), (left - CORNER_M).max(0.0)),
        None => (0.0, (left - STOP_M).max(0.0)),
    };
    // A decision passes before the next one can brake.
    let delay = brake * DECISION_SECONDS;
    let before = (delay * delay + there * there + 2.0 * brake * room).sqrt() - delay;
    let now = hypot(body.velocity.x, body.velocity.z);
    around(off, TURNING).min(before.max(there)).min(now + change * DECISION_SECONDS)
}
