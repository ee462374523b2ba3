//! A plain controller that drives a body along a path, as an engine's character follows the path of a NavMesh. It turns
//! to where it goes, slows down at corners, and jumps where the path says so. It knows its own body and the path, and
//! senses nothing.

use serde::{Deserialize, Serialize};
use surefoot_world::character::{Action, Body};
use surefoot_world::float::heading;
use surefoot_world::{Ability, CharacterProfile, Motion, TICK_SECONDS, TICKS_PER_SECOND, Vec3};

/// A point of a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathPoint {
    /// Position of the feet, m.
    pub at: [f32; 3],
    /// The ability that leads there from the point before.
    #[serde(default, with = "by_name")]
    pub by: Ability,
}

/// Abilities by name in snake case, such as `double_jump`.
mod by_name {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};
    use surefoot_world::Ability;

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
    pub fn serialize<S: Serializer>(ability: &Ability, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(ability.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Ability, D::Error> {
        let name = String::deserialize(deserializer)?;
        Ability::named(&name).ok_or_else(|| D::Error::custom(format!("`{name}` is no ability")))
    }
}

/// Horizontal distance within which a walked point is passed, m.
const PASSED_M: f32 = 0.5;
/// Horizontal distance within which the start of a leap is passed, m.
const TAKE_OFF_M: f32 = 0.35;
/// Horizontal distance within which the end of a leap is passed, m.
const LANDED_M: f32 = 0.9;
/// Distance from the centre of a pad within which it throws bodies, plus the distance of a few ticks, m.
const DEVICE_M: f32 = 2.5;
/// Difference in height up to which a point is passed, m.
const LEVEL_M: f32 = 1.2;
/// Angle to the target up to which the body runs at full speed, rad.
const AHEAD_RAD: f32 = 1.0;
/// Angle up to which the body faces a landing, rad.
const FACING_RAD: f32 = 0.1;
/// Deceleration that the controller assumes on the ground and in the air, m/s2: less than the default body has.
const BRAKE: [f32; 2] = [40.0, 18.0];
/// Speed at a point where the body must stop or turn, m/s.
const SLOW: f32 = 1.5;
/// Average share of the top speed in a leap from rest.
const RELIABLE: f32 = 0.7;
/// Speed below which a running body is blocked, m/s.
const BLOCKED: f32 = 1.5;
/// Ticks below that speed after which the body jumps.
const BLOCKED_TICKS: u32 = 6;
/// Time without coming closer to the next point after which the controller gives up.
const STUCK_TICKS: u32 = 8 * TICKS_PER_SECOND;

/// The controller of one body on its path.
#[derive(Debug)]
pub struct Driver<'p> {
    points: &'p [PathPoint],
    /// Index of the next point.
    next: usize,
    /// Smallest distance to that point so far, m.
    best: f32,
    /// Ticks since `best` shrank.
    stuck: u32,
    /// Ticks for which the body has been blocked.
    blocked: u32,
    /// Jumps since the last point.
    jumps: u32,
    /// Whether the body has turned towards the landing.
    is_lined_up: bool,
}

impl<'p> Driver<'p> {
    /// A controller at the start of a path.
    pub fn new(points: &'p [PathPoint]) -> Self {
        Self { points, next: 0, best: f32::INFINITY, stuck: 0, blocked: 0, jumps: 0, is_lined_up: false }
    }

    /// The action of this tick; `None` at the end of the path, or when the body is stuck.
    pub fn steer(&mut self, body: &Body, profile: &CharacterProfile) -> Option<Action> {
        while self.has_passed(body) {
            *self = Self { next: self.next + 1, ..Self::new(self.points) };
        }
        let point = *self.points.get(self.next)?;
        let target = Vec3::from_array(point.at);
        let distance = target.distance(body.feet);
        self.stuck = if distance < self.best - 0.05 { 0 } else { self.stuck + 1 };
        self.best = self.best.min(distance);
        if self.stuck > STUCK_TICKS {
            return None;
        }
        if body.ride.is_some() {
            return Some(Action::default());
        }
        let leaps = point.by != Ability::WALK;
        let turn = turn_towards(body, target);
        self.is_lined_up |= turn.abs() < FACING_RAD;
        if leaps && body.is_grounded() && !self.is_lined_up && self.jumps == 0 {
            return Some(Action { turn: turn_action(turn, profile), ..Action::default() });
        }
        let mut action = run(body, profile, target, self.final_speed(body));
        let moved = Vec3::new(body.velocity.x, 0.0, body.velocity.z).length();
        self.blocked = if moved < BLOCKED && body.is_grounded() { self.blocked + 1 } else { 0 };
        if self.wants_jump(body, profile, point.by, target) {
            action.jump = 1.0;
            self.jumps += 1;
            self.blocked = 0;
        }
        if point.by == Ability::JETPACK && !body.is_grounded() && body.feet.y < target.y + LEVEL_M {
            action.jump = 1.0;
        }
        Some(action)
    }

    /// Whether the controller heads for the end of the path.
    pub fn is_on_last_point(&self) -> bool {
        self.next + 1 >= self.points.len()
    }

    /// Whether the body has reached the next point.
    fn has_passed(&self, body: &Body) -> bool {
        let Some(point) = self.points.get(self.next) else { return false };
        let to = Vec3::from_array(point.at) - body.feet;
        let after = self.points.get(self.next + 1).map_or(Ability::WALK, |next| next.by);
        if was_taken(after, body, flat(to).length()) {
            return true;
        }
        let begins_leap = after != Ability::WALK;
        let within = match point.by {
            _ if begins_leap => TAKE_OFF_M,
            Ability::WALK => PASSED_M,
            _ => LANDED_M,
        };
        let stands = body.is_grounded() || (point.by == Ability::WALK && !begins_leap);
        // The task decides when the last point is reached.
        self.next + 1 < self.points.len() && stands && to.y.abs() < LEVEL_M && flat(to).length() < within
    }

    /// Wanted speed at the next point, m/s: slow where the body must stop, turn sharply or take off.
    fn final_speed(&self, body: &Body) -> f32 {
        let (Some(point), Some(after)) = (self.points.get(self.next), self.points.get(self.next + 1)) else {
            return SLOW;
        };
        if after.by != Ability::WALK || point.by != Ability::WALK {
            return SLOW;
        }
        let at = Vec3::from_array(point.at);
        let (here, there) = (flat(at - body.feet), flat(Vec3::from_array(after.at) - at));
        let cosine = here.dot(there) / (here.length() * there.length()).max(f32::EPSILON);
        SLOW + (cosine.max(0.0) * cosine.max(0.0)) * f32::from(u8::MAX)
    }

    /// Whether the body jumps. A leap begins as soon as it would arrive; otherwise where the body is blocked, or where
    /// the ground ends. The second jump follows when the first one no longer rises.
    fn wants_jump(&mut self, body: &Body, profile: &CharacterProfile, by: Ability, target: Vec3) -> bool {
        let most = match by.motion() {
            Motion::Jump | Motion::Thrust => 1,
            Motion::AirJump => 1 + u32::from(profile.extra_jumps),
            Motion::Dash => 2,
            // A NavMesh may contain steps that are too high for the body.
            Motion::Walk => return body.is_grounded() && self.blocked >= BLOCKED_TICKS,
            // Jumps in the air may add height to a pad's throw.
            Motion::Throw => 1 + u32::from(profile.extra_jumps),
            Motion::WallRun => 1,
            Motion::Ride
            | Motion::Teleport
            | Motion::Surface
            | Motion::Pull
            | Motion::Swim
            | Motion::Dive
            | Motion::Crouch
            | Motion::Slide
            | Motion::Own => return false,
        };
        let to = target - body.feet;
        if by.motion() == Motion::Throw {
            let is_falling = !body.is_grounded() && body.velocity.y < 0.5;
            return is_falling && self.jumps < most && body.air_jumps_left > 0 && to.y > -1.0;
        }
        if body.is_grounded() {
            let is_first = self.jumps == 0;
            // The body may have landed on the way; the rest needs another leap.
            self.jumps = 0;
            return (is_first && arrives(profile, most, to)) || self.blocked >= BLOCKED_TICKS;
        }
        if self.jumps == 0 {
            return to.y > -LEVEL_M;
        }
        let may_jump = body.air_jumps_left > 0 || body.can_dash(profile);
        self.jumps < most && may_jump && body.velocity.y < 0.5 && to.y > -1.0
    }
}

/// Whether a device has taken the body, whose horizontal distance to it is still `distance`, m: devices act at their
/// rims.
fn was_taken(by: Ability, body: &Body, distance: f32) -> bool {
    match by.motion() {
        Motion::Throw => !body.is_grounded() && body.velocity.y > SLOW && distance < DEVICE_M,
        Motion::Ride => body.ride.is_some(),
        Motion::Teleport => body.teleport_locked,
        _ => false,
    }
}

/// Whether a leap of `jumps` jumps is high enough when it has covered the horizontal distance. Each jump follows when
/// the last one no longer rises.
fn arrives(profile: &CharacterProfile, jumps: u32, to: Vec3) -> bool {
    let seconds = flat(to).length() / (RELIABLE * profile.forward_speed);
    let rising = profile.jump_speed / profile.gravity;
    let before = (jumps - 1).min((seconds / rising) as u32);
    let left = seconds - before as f32 * rising;
    let height = before as f32 * 0.5 * profile.jump_speed * rising;
    height + profile.jump_speed * left - 0.5 * profile.gravity * left * left > to.y
}

/// Runs towards a point, with `final_speed`, m/s, on arrival, and turns towards it.
fn run(body: &Body, profile: &CharacterProfile, target: Vec3, final_speed: f32) -> Action {
    let to = flat(target - body.feet);
    let distance = to.length();
    let turn = turn_towards(body, target);
    if distance < 1.0e-3 {
        return Action::default();
    }
    let brake = BRAKE[usize::from(!body.is_grounded())];
    // Braking begins one tick late.
    let usable = (distance - profile.forward_speed * TICK_SECONDS).max(0.0);
    let mut speed = (final_speed * final_speed + 2.0 * brake * usable).sqrt().min(profile.forward_speed);
    if turn.abs() > AHEAD_RAD && body.is_grounded() {
        speed = speed.min(SLOW);
    }
    let wish = to / distance * (speed / profile.forward_speed);
    let facing = body.facing();
    let right = Vec3::new(-facing.z, 0.0, facing.x);
    Action {
        forward: wish.dot(facing).clamp(-1.0, 1.0),
        strafe: (wish.dot(right) / profile.side_speed_share.max(0.1)).clamp(-1.0, 1.0),
        turn: turn_action(turn, profile),
        jump: 0.0,
    }
}

/// Angle from the body's heading to a point, rad, positive to the left.
fn turn_towards(body: &Body, target: Vec3) -> f32 {
    use std::f32::consts::{PI, TAU};
    let to = target - body.feet;
    let turn = heading(to) - body.yaw;
    (turn + PI).rem_euclid(TAU) - PI
}

/// The turn by an angle, as far as one tick allows.
fn turn_action(turn: f32, profile: &CharacterProfile) -> f32 {
    (turn / (profile.turn_speed * TICK_SECONDS).max(f32::EPSILON)).clamp(-1.0, 1.0)
}

fn flat(vector: Vec3) -> Vec3 {
    Vec3::new(vector.x, 0.0, vector.z)
}
