//! Styles of motion: how an NPC carries out the actions of its policy.
//!
//! A policy that learned to arrive turns to and fro, runs sideways and jumps where walking would do. A composed NPC
//! faces its direction of motion, straightens its way where the policy roughly does, acts without noise, and jumps only
//! on legs that need it. In the air it keeps its heading as far as its motion allows. The
//! [rehearsal](crate::rehearse) of a leg shows whether a composed NPC still arrives; otherwise it moves freely.
//! docs/adr/0026-composed-motion.md and docs/adr/0061-taut-ways-and-leaps.md have measurements.

use crate::cross::Cross;
use crate::leap::Leap;
use crate::steer::Course;
use std::f32::consts::{PI, TAU};
use surefoot_policy::Policy;
use surefoot_world::character::{Body, Ride, Support};
use surefoot_world::float::hypot;
use surefoot_world::sense::{FIELDS, STATE_BEGIN, field_idx};
use surefoot_world::{Ability, Action, CharacterProfile, DECISION_SECONDS, Episode, Npc, Vec3};

/// Angle between facing and motion up to which a composed body does not turn, rad.
const SLACK: f32 = 0.15;
/// The same in the air: a leap keeps the heading of its take-off.
const SLACK_IN_AIR: f32 = 0.45;
/// Angle between facing and motion after a turn, rad.
const SETTLE: f32 = 0.05;
/// Share of the top speed below which an action counts as standing still.
const REST: f32 = 0.1;
/// Cosine of the greatest angle between the policy's direction and the straight way that replaces it.
const STRAIGHT: f32 = 0.8;
/// Horizontal distance to the waypoint below which its direction is ignored, m.
const CLOSE_M: f32 = 0.5;
/// Share of sideways motion kept on the ground.
const SIDEWAYS: f32 = 0.4;
/// Weight of the wanted change of velocity in the predicted direction of a body.
const LOOK_AHEAD: f32 = 0.7;

/// How an NPC carries out the actions of its policy.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Style {
    /// Unchanged.
    #[default]
    Free,
    /// Facing its direction of motion.
    Composed {
        /// Whether the NPC jumps when the policy does.
        jumps: bool,
    },
    /// Steered along a course, without the policy.
    Walk(Course),
    /// Steered over a gap, without the policy.
    Leap(Leap),
    /// Steered along a crossing, without the policy.
    Cross(Cross),
    /// Standing still at a place and ignoring the policy, while the NPC waits for a mover or rides on it.
    Stay {
        /// The place, m.
        at: Vec3,
        /// How far from there the NPC may stand, m.
        within: f32,
    },
}

impl Style {
    /// The composed style for a leg that needs `ability`.
    pub fn for_leg(ability: Ability) -> Self {
        Self::Composed { jumps: ability != Ability::WALK }
    }

    /// Whether an NPC that moves so must observe, and evaluate its policy: one with a memory always, since what it has
    /// seen counts later.
    pub fn needs(self, policy: &Policy) -> bool {
        policy.memory_len() > 0 || !(self.is_steered() || matches!(self, Self::Stay { .. }))
    }

    /// Whether the NPC is steered.
    pub fn is_steered(self) -> bool {
        matches!(self, Self::Walk(_) | Self::Leap(_) | Self::Cross(_))
    }

    /// Share of the noise that an NPC keeps, 0 or 1.
    pub fn noise_share(self) -> f32 {
        if self == Self::Free { 1.0 } else { 0.0 }
    }

    /// The action of `npc` in this style when its policy chooses `action`.
    pub fn shape(self, action: Action, npc: &Npc, profile: &CharacterProfile) -> Action {
        let jumps = match self {
            Self::Free => return action,
            Self::Walk(course) => return course.action(&npc.body, profile),
            Self::Leap(leap) => return leap.action(&npc.body, profile),
            Self::Cross(cross) => return cross.action(&npc.body, profile),
            Self::Stay { at, within } => return stay(at, within, &npc.body, profile),
            Self::Composed { jumps } => jumps,
        };
        let body = &npc.body;
        let jump = if jumps { action.jump } else { action.jump.min(0.0) };
        let (x, z) = wish(action, body, profile);
        if body.is_grounded() && hypot(x, z) < REST || body.is_carried() {
            return Action { jump, ..action };
        }
        let way = npc.episode.map_or(Vec3::ZERO, |episode| episode.goal - body.feet);
        let (x, z) = straighten(way, x, z);
        let (ahead_x, ahead_z) = ahead(body, profile, x, z);
        let off = angle(libm::atan2f(ahead_x, ahead_z) - body.yaw);
        let most = most_turn(profile);
        let slack = if body.is_grounded() { SLACK } else { SLACK_IN_AIR };
        let turn = if off.abs() <= slack { 0.0 } else { (off - SETTLE * off.signum()).clamp(-most, most) };
        let (sin, cos) = libm::sincosf(body.yaw + 0.5 * turn);
        let (forward, right) = (x * sin + z * cos, z * sin - x * cos);
        let right = if body.is_grounded() { right * SIDEWAYS } else { right };
        let strafe = if profile.side_speed_share > 0.0 { right / profile.side_speed_share } else { 0.0 };
        Action { forward: forward.clamp(-1.0, 1.0), strafe: strafe.clamp(-1.0, 1.0), turn: turn / most, jump }
    }
}

/// The NPC of an observation, at the origin with heading 0, with the values that [`Style::shape`] needs.
///
/// # Panics
/// If `row` is not an observation.
pub fn npc_of(row: &[f32]) -> Npc {
    const DISTANCE: usize = field_idx("goal_distance");
    const DIRECTION: usize = field_idx("goal_x");
    const VELOCITY: usize = field_idx("velocity_x");
    const GROUNDED: usize = field_idx("is_grounded");
    const ON_ZIP_LINE: usize = field_idx("is_on_zip_line");
    let state = &row[STATE_BEGIN..];
    // In observations x is to the right, which is -x at heading 0.
    let vector = |at: usize, scale: f32| Vec3::new(-state[at], state[at + 1], state[at + 2]) * scale;
    let mut body = Body::at(Vec3::ZERO, 0.0);
    body.velocity = vector(VELOCITY, FIELDS[VELOCITY].scale);
    body.support = if state[GROUNDED] > 0.5 { Support::Ground } else { Support::Air };
    body.ride = (state[ON_ZIP_LINE] > 0.5).then_some(Ride { line_idx: 0, distance: 0.0 });
    let goal = vector(DIRECTION, FIELDS[DISTANCE].scale * state[DISTANCE]);
    Npc::outside(body, Episode::new(goal, body.feet))
}

/// Speed of the return to the place to stay, in m/s for each metre of distance.
const RETURN_RATE: f32 = 2.5;
/// Top speed of that return, m/s.
const RETURN_SPEED: f32 = 3.0;

/// The action by which a body stays at a place.
fn stay(at: Vec3, within: f32, body: &Body, profile: &CharacterProfile) -> Action {
    let (x, z) = (at.x - body.feet.x, at.z - body.feet.z);
    let distance = hypot(x, z);
    if distance <= within {
        return Action::default();
    }
    let speed = (RETURN_RATE * distance).min(RETURN_SPEED).min(profile.forward_speed) / distance;
    let (sin, cos) = libm::sincosf(body.yaw);
    let share = speed / profile.forward_speed;
    let (forward, right) = ((x * sin + z * cos) * share, (z * sin - x * cos) * share);
    let side = profile.side_speed_share;
    let strafe = if side > 0.0 { right / side } else { 0.0 };
    Action { forward: forward.clamp(-1.0, 1.0), strafe: strafe.clamp(-1.0, 1.0), turn: 0.0, jump: -1.0 }
}

/// The greatest turn in one decision, rad.
fn most_turn(profile: &CharacterProfile) -> f32 {
    profile.turn_speed * DECISION_SECONDS
}

/// The wanted horizontal velocity on the map's axes, as a share of the top speed, in the middle of the decision.
fn wish(action: Action, body: &Body, profile: &CharacterProfile) -> (f32, f32) {
    let (sin, cos) = libm::sincosf(body.yaw + 0.5 * action.turn * most_turn(profile));
    let side = profile.side_speed_share;
    let (forward, right) = (action.forward.max(-side), action.strafe * side);
    let (x, z) = (sin * forward - cos * right, cos * forward + sin * right);
    let length = hypot(x, z).max(1.0);
    (x / length, z / length)
}

/// The wish along `x` and `z`, turned into the direction of `way` if it roughly leads there already.
fn straighten(way: Vec3, x: f32, z: f32) -> (f32, f32) {
    let (distance, length) = (hypot(way.x, way.z), hypot(x, z));
    if distance < CLOSE_M || way.x * x + way.z * z < STRAIGHT * distance * length {
        return (x, z);
    }
    (way.x / distance * length, way.z / distance * length)
}

/// The predicted horizontal direction of `body`: its velocity plus part of the change towards the wish along `x` and
/// `z`.
fn ahead(body: &Body, profile: &CharacterProfile, x: f32, z: f32) -> (f32, f32) {
    let (now_x, now_z) = (body.velocity.x, body.velocity.z);
    let (change_x, change_z) = (x * profile.forward_speed - now_x, z * profile.forward_speed - now_z);
    let acceleration = if body.is_grounded() { profile.ground_acceleration } else { profile.air_acceleration };
    let possible = (acceleration * DECISION_SECONDS / hypot(change_x, change_z).max(f32::MIN_POSITIVE)).min(1.0);
    let share = LOOK_AHEAD * possible;
    (now_x + share * change_x, now_z + share * change_z)
}

/// The angle in (-pi, pi] that equals `value`, rad, which is within two turns of it.
pub fn angle(value: f32) -> f32 {
    let mut value = value;
    while value > PI {
        value -= TAU;
    }
    while value <= -PI {
        value += TAU;
    }
    value
}
