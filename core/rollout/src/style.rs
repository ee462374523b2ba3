//! Styles of motion: how an NPC carries out what its policy wants.
//!
//! A policy that learned to arrive turns to and fro, runs sideways and jumps where walking would do. A composed NPC
//! moves as the policy wants on the whole: it faces where it goes, keeps to the straight way where the policy does so
//! roughly, acts without noise, and jumps only on legs that need it. Whether it still arrives is seen in the
//! [rehearsal](crate::rehearse) of the leg; where it does not, it is free to move as the policy does.
//! docs/adr/0026-composed-motion.md says what that changes.

use std::f32::consts::{PI, TAU};
use surefoot_world::character::{Body, Ride, Support};
use surefoot_world::float::hypot;
use surefoot_world::sense::{FIELDS, LastDecision, STATE_BEGIN, field_idx};
use surefoot_world::{Ability, AbilitySet, Action, CharacterProfile, DECISION_SECONDS, Episode, Npc, ProfileIdx, Vec3};

/// Angle between facing and motion up to which a composed body does not turn, rad, and what is left of it after a turn.
const SLACK: f32 = 0.15;
const SETTLE: f32 = 0.05;
/// Share of the top speed below which the policy does not want to move.
const REST: f32 = 0.1;
/// Cosine of the greatest angle between what the policy wants and the straight way that the body takes instead.
const STRAIGHT: f32 = 0.8;
/// Distance to the waypoint on the plane below which its direction says nothing, m.
const CLOSE_M: f32 = 0.5;
/// Share of sideways motion that is left on the ground.
const SIDEWAYS: f32 = 0.4;
/// How much of the change of velocity that the policy wants counts for where a body goes.
const LOOK_AHEAD: f32 = 0.7;

/// How an NPC carries out what its policy wants.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Style {
    /// Exactly as the policy wants.
    #[default]
    Free,
    /// Facing where it goes.
    Composed {
        /// Whether it jumps when the policy wants to.
        jumps: bool,
    },
    /// Standing still at a place, whatever the policy wants: while the NPC waits for a mover, or rides on it.
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
        Self::Composed { jumps: ability != Ability::Walk }
    }

    /// Share of an NPC's noise that is left, 0 or 1.
    pub fn noise_share(self) -> f32 {
        if self == Self::Free { 1.0 } else { 0.0 }
    }

    /// The action by which `npc` does in this style what the policy wants with `action`.
    pub fn shape(self, action: Action, npc: &Npc, profile: &CharacterProfile) -> Action {
        let jumps = match self {
            Self::Free => return action,
            Self::Stay { at, within } => return stay(at, within, &npc.body, profile),
            Self::Composed { jumps } => jumps,
        };
        let body = &npc.body;
        let jump = if jumps { action.jump } else { action.jump.min(0.0) };
        let (x, z) = wish(action, body, profile);
        if hypot(x, z) < REST || body.ride.is_some() {
            return Action { jump, ..action };
        }
        let way = npc.episode.map_or(Vec3::ZERO, |episode| episode.goal - body.feet);
        let (x, z) = straighten(way, x, z);
        let (ahead_x, ahead_z) = ahead(body, profile, x, z);
        let off = angle(libm::atan2f(ahead_x, ahead_z) - body.yaw);
        let most = most_turn(profile);
        let turn = if off.abs() <= SLACK { 0.0 } else { (off - SETTLE * off.signum()).clamp(-most, most) };
        let (sin, cos) = libm::sincosf(body.yaw + 0.5 * turn);
        let (forward, right) = (x * sin + z * cos, z * sin - x * cos);
        let right = if body.is_grounded() { right * SIDEWAYS } else { right };
        let strafe = if profile.side_speed_share > 0.0 { right / profile.side_speed_share } else { 0.0 };
        Action { forward: forward.clamp(-1.0, 1.0), strafe: strafe.clamp(-1.0, 1.0), turn: turn / most, jump }
    }
}

/// An NPC of which only the observation is known, as if it stood at the origin with the heading 0: all of it that
/// [`Style::shape`] needs.
///
/// # Panics
/// If `row` is no observation.
pub fn npc_of(row: &[f32]) -> Npc {
    const DISTANCE: usize = field_idx("goal_distance");
    const DIRECTION: usize = field_idx("goal_x");
    const VELOCITY: usize = field_idx("velocity_x");
    const GROUNDED: usize = field_idx("is_grounded");
    const ON_ZIP_LINE: usize = field_idx("is_on_zip_line");
    let state = &row[STATE_BEGIN..];
    // Observations have x to the right, which is -x at the heading 0.
    let vector = |at: usize, scale: f32| Vec3::new(-state[at], state[at + 1], state[at + 2]) * scale;
    let mut body = Body::at(Vec3::ZERO, 0.0);
    body.velocity = vector(VELOCITY, FIELDS[VELOCITY].scale);
    body.support = if state[GROUNDED] > 0.5 { Support::Ground } else { Support::Air };
    body.ride = (state[ON_ZIP_LINE] > 0.5).then_some(Ride { line_idx: 0, distance: 0.0 });
    let goal = vector(DIRECTION, FIELDS[DISTANCE].scale * state[DISTANCE]);
    Npc {
        profile: ProfileIdx::default(),
        body,
        action: Action::default(),
        episode: Some(Episode::new(goal, body.feet)),
        last: LastDecision::default(),
        used_abilities: AbilitySet::default(),
        harm: None,
    }
}

/// Speed at which a body goes back to where it stays, in m/s for each metre, and at most.
const RETURN_RATE: f32 = 2.5;
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

/// Where the policy wants to move, on the map's axes, at most 1 long, as it is in the middle of the decision.
fn wish(action: Action, body: &Body, profile: &CharacterProfile) -> (f32, f32) {
    let (sin, cos) = libm::sincosf(body.yaw + 0.5 * action.turn * most_turn(profile));
    let side = profile.side_speed_share;
    let (forward, right) = (action.forward.max(-side), action.strafe * side);
    let (x, z) = (sin * forward - cos * right, cos * forward + sin * right);
    let length = hypot(x, z).max(1.0);
    (x / length, z / length)
}

/// The direction of `way` on the plane with the length of the wish along `x` and `z`, if that leads about there; the
/// wish itself otherwise.
fn straighten(way: Vec3, x: f32, z: f32) -> (f32, f32) {
    let (distance, length) = (hypot(way.x, way.z), hypot(x, z));
    if distance < CLOSE_M || way.x * x + way.z * z < STRAIGHT * distance * length {
        return (x, z);
    }
    (way.x / distance * length, way.z / distance * length)
}

/// Where `body` goes next, on the plane: its velocity, and part of what becomes of it as the policy wants to move along
/// `x` and `z`.
fn ahead(body: &Body, profile: &CharacterProfile, x: f32, z: f32) -> (f32, f32) {
    let (now_x, now_z) = (body.velocity.x, body.velocity.z);
    let (change_x, change_z) = (x * profile.forward_speed - now_x, z * profile.forward_speed - now_z);
    let acceleration = if body.is_grounded() { profile.ground_acceleration } else { profile.air_acceleration };
    let possible = (acceleration * DECISION_SECONDS / hypot(change_x, change_z).max(f32::MIN_POSITIVE)).min(1.0);
    let share = LOOK_AHEAD * possible;
    (now_x + share * change_x, now_z + share * change_z)
}

/// The angle in (-pi, pi] that equals `value`, rad, which is within two turns of it.
pub(crate) fn angle(value: f32) -> f32 {
    let mut value = value;
    while value > PI {
        value -= TAU;
    }
    while value <= -PI {
        value += TAU;
    }
    value
}
