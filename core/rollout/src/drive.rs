//! A plain controller that drives a body along a path, as an engine's character follows the path of a NavMesh: it turns to where it goes, slows
//! down at corners, and jumps where the path says so. It knows its own body and the path, and senses nothing.

use serde::{Deserialize, Serialize};
use surefoot_world::character::{Action, Body};
use surefoot_world::{Ability, CharacterProfile, TICK_SECONDS, TICKS_PER_SECOND, Vec3};

/// A point of a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathPoint {
    /// Position of the feet, m.
    pub at: [f32; 3],
    /// How the body gets there from the point before.
    #[serde(default)]
    pub by: Move,
}

/// How a body gets from one point of a path to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Move {
    /// Walks, slides or drops off an edge.
    #[default]
    Walk,
    /// Jumps.
    Jump,
    /// Jumps, and again in the air.
    DoubleJump,
    /// Walks on a pad that stands at the point before, and steers in the air.
    Pad,
    /// Walks into a zip line at the point before, and rides it.
    ZipLine,
    /// Walks into a teleporter at the point before.
    Teleporter,
    /// Takes a jetpack at the point before, and flies.
    Jetpack,
}

impl From<Ability> for Move {
    fn from(ability: Ability) -> Self {
        match ability {
            Ability::Walk => Self::Walk,
            Ability::Jump => Self::Jump,
            Ability::DoubleJump => Self::DoubleJump,
            Ability::Pad => Self::Pad,
            Ability::ZipLine => Self::ZipLine,
            Ability::Teleporter => Self::Teleporter,
            Ability::Jetpack => Self::Jetpack,
        }
    }
}

/// Distance on the plane within which a point that is walked to is passed, m.
const PASSED_M: f32 = 0.5;
/// The same of a point where a leap begins.
const TAKE_OFF_M: f32 = 0.35;
/// The same of a point where a leap ends.
const LANDED_M: f32 = 0.9;
/// Distance from the centre of a pad up to which it throws bodies, with what they cover in a few ticks, m.
const DEVICE_M: f32 = 2.5;
/// Difference in height up to which a point is passed, m.
const LEVEL_M: f32 = 1.2;
/// Angle up to which the body runs at full speed while it turns, rad.
const AHEAD_RAD: f32 = 1.0;
/// Angle up to which it faces a landing, rad.
const FACING_RAD: f32 = 0.1;
/// Deceleration that it counts on, on the ground and in the air, m/s2: less than the default body has.
const BRAKE: [f32; 2] = [40.0, 18.0];
/// Speed at which it gets to a point where it must stop or turn, m/s.
const SLOW: f32 = 1.5;
/// Share of the top speed that it reaches on average in a leap from rest.
const RELIABLE: f32 = 0.7;
/// Speed below which a body that runs is blocked, m/s, and for how long.
const BLOCKED: f32 = 1.5;
const BLOCKED_TICKS: u32 = 6;
/// Time without coming closer to the next point after which it gives up.
const STUCK_TICKS: u32 = 8 * TICKS_PER_SECOND;

/// The controller of one body on its path.
#[derive(Debug)]
pub struct Driver<'p> {
    points: &'p [PathPoint],
    /// Index of the point that it heads for.
    next: usize,
    /// Smallest distance to that point so far, m, and the ticks since it shrank.
    best: f32,
    stuck: u32,
    /// Ticks for which the body has run without getting anywhere.
    blocked: u32,
    /// Jumps since the last point.
    jumps: u32,
    /// Whether it has turned towards the landing.
    is_lined_up: bool,
}

impl<'p> Driver<'p> {
    /// A controller at the start of a path.
    pub fn new(points: &'p [PathPoint]) -> Self {
        Self { points, next: 0, best: f32::INFINITY, stuck: 0, blocked: 0, jumps: 0, is_lined_up: false }
    }

    /// What the body does in this tick; `None` once it is at the end of the path, or stuck.
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
        let leaps = point.by != Move::Walk;
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
        if point.by == Move::Jetpack && !body.is_grounded() && body.feet.y < target.y + LEVEL_M {
            action.jump = 1.0;
        }
        Some(action)
    }

    /// Whether the controller heads for the end of the path.
    pub fn is_on_last_point(&self) -> bool {
        self.next + 1 >= self.points.len()
    }

    /// Whether the body has got to the point that it heads for.
    fn has_passed(&self, body: &Body) -> bool {
        let Some(point) = self.points.get(self.next) else { return false };
        let to = Vec3::from_array(point.at) - body.feet;
        let after = self.points.get(self.next + 1).map_or(Move::Walk, |next| next.by);
        if was_taken(after, body, flat(to).length()) {
            return true;
        }
        let begins_leap = after != Move::Walk;
        let within = match point.by {
            _ if begins_leap => TAKE_OFF_M,
            Move::Walk => PASSED_M,
            _ => LANDED_M,
        };
        let stands = body.is_grounded() || (point.by == Move::Walk && !begins_leap);
        // The last point is held until the task says that it is reached.
        self.next + 1 < self.points.len() && stands && to.y.abs() < LEVEL_M && flat(to).length() < within
    }

    /// Speed at which the body should get to its next point, m/s: slow where it must stop, turn sharply or take off.
    fn final_speed(&self, body: &Body) -> f32 {
        let (Some(point), Some(after)) = (self.points.get(self.next), self.points.get(self.next + 1)) else {
            return SLOW;
        };
        if after.by != Move::Walk || point.by != Move::Walk {
            return SLOW;
        }
        let at = Vec3::from_array(point.at);
        let (here, there) = (flat(at - body.feet), flat(Vec3::from_array(after.at) - at));
        let cosine = here.dot(there) / (here.length() * there.length()).max(f32::EPSILON);
        SLOW + (cosine.max(0.0) * cosine.max(0.0)) * f32::from(u8::MAX)
    }

    /// A leap begins at once if it gets to its end from here; otherwise where the body is blocked, or where the ground ends. The second jump
    /// is made when the first one no longer rises.
    fn wants_jump(&mut self, body: &Body, profile: &CharacterProfile, by: Move, target: Vec3) -> bool {
        let most = match by {
            Move::Jump | Move::Jetpack => 1,
            Move::DoubleJump => 1 + u32::from(profile.extra_jumps),
            // A NavMesh takes steps that are higher than the body's own.
            Move::Walk => return body.is_grounded() && self.blocked >= BLOCKED_TICKS,
            // What a pad's throw lacks, a jump in the air may add.
            Move::Pad => 1 + u32::from(profile.extra_jumps),
            Move::ZipLine | Move::Teleporter => return false,
        };
        let to = target - body.feet;
        if by == Move::Pad {
            let is_falling = !body.is_grounded() && body.velocity.y < 0.5;
            return is_falling && self.jumps < most && body.air_jumps_left > 0 && to.y > -1.0;
        }
        if body.is_grounded() {
            let is_first = self.jumps == 0;
            // It may have landed on the way: what comes next needs a leap of its own.
            self.jumps = 0;
            return (is_first && arrives(profile, most, to)) || self.blocked >= BLOCKED_TICKS;
        }
        if self.jumps == 0 {
            return to.y > -LEVEL_M;
        }
        self.jumps < most && body.air_jumps_left > 0 && body.velocity.y < 0.5 && to.y > -1.0
    }
}

/// Whether a device has taken the body that was on its way to it and still is `distance` metres away on the plane: devices do so at their rims.
fn was_taken(by: Move, body: &Body, distance: f32) -> bool {
    match by {
        Move::Pad => !body.is_grounded() && body.velocity.y > SLOW && distance < DEVICE_M,
        Move::ZipLine => body.ride.is_some(),
        Move::Teleporter => body.teleport_locked,
        _ => false,
    }
}

/// Whether a leap of `jumps` jumps is high enough when it has covered the distance on the plane, each jump made where the one before no longer
/// rises.
fn arrives(profile: &CharacterProfile, jumps: u32, to: Vec3) -> bool {
    let seconds = flat(to).length() / (RELIABLE * profile.forward_speed);
    let rising = profile.jump_speed / profile.gravity;
    let before = (jumps - 1).min((seconds / rising) as u32);
    let left = seconds - before as f32 * rising;
    let height = before as f32 * 0.5 * profile.jump_speed * rising;
    height + profile.jump_speed * left - 0.5 * profile.gravity * left * left > to.y
}

/// Runs towards a point, to get there at `final_speed`, m/s, and turns towards it.
fn run(body: &Body, profile: &CharacterProfile, target: Vec3, final_speed: f32) -> Action {
    let to = flat(target - body.feet);
    let distance = to.length();
    let turn = turn_towards(body, target);
    if distance < 1.0e-3 {
        return Action::default();
    }
    let brake = BRAKE[usize::from(!body.is_grounded())];
    // One tick's way is covered before braking begins.
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

/// Angle from where the body faces to a point, rad, positive to the left.
fn turn_towards(body: &Body, target: Vec3) -> f32 {
    use std::f32::consts::{PI, TAU};
    let to = target - body.feet;
    let turn = libm::atan2f(to.x, to.z) - body.yaw;
    (turn + PI).rem_euclid(TAU) - PI
}

/// Turns by an angle, as far as one tick allows.
fn turn_action(turn: f32, profile: &CharacterProfile) -> f32 {
    (turn / (profile.turn_speed * TICK_SECONDS).max(f32::EPSILON)).clamp(-1.0, 1.0)
}

fn flat(vector: Vec3) -> Vec3 {
    Vec3::new(vector.x, 0.0, vector.z)
}
