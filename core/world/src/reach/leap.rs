//! Scripted leaps: the landing of a character that runs off a ledge, jumps, or is thrown.

use crate::character::{Action, Body, CharacterProfile, MoveScratch};
use crate::float::heading;
use crate::map::CollisionMap;
use crate::{Ability, TICK_SECONDS, Vec3};

/// The beginning of a leap and the controls in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leap {
    /// Runs towards the target and off the edge.
    Run,
    /// Jumps at once.
    Jump,
    /// Runs, and jumps where the ground ends.
    RunAndJump,
    /// Jumps at once, and again in the air.
    DoubleJump,
    /// Runs, jumps where the ground ends, and jumps again in the air.
    RunAndDoubleJump,
    /// Is thrown upwards by a pad of this speed, m/s.
    Pad(f32),
    /// Jumps and flies with a jetpack that has this much fuel, s.
    Jetpack(f32),
}

/// Ticks after which a leap has failed.
const MAX_TICKS: u32 = 200;
/// Ticks after which a run that has not left the ground has failed.
const MAX_RUN_TICKS: u32 = 24;
/// Deceleration in the air that the approach assumes, m/s2: less than the default character has.
const BRAKE: f32 = 18.0;

/// Simulates a leap from `from` towards `target` and returns the place where the body lands, m. `None` if it does not
/// land in time, lands in a liquid or outside the map, or triggers a device on the way.
pub fn land(
    map: &CollisionMap,
    profile: &CharacterProfile,
    from: Vec3,
    target: Vec3,
    leap: Leap,
    scratch: &mut MoveScratch,
) -> Option<Vec3> {
    let mut leaper = Leaper::new(profile, from, target, leap);
    for tick in 0..MAX_TICKS {
        let action = leaper.decide(profile, tick);
        let used = leaper.body.tick(map, profile, &action, scratch);
        let jumps = [Ability::JUMP, Ability::DOUBLE_JUMP, Ability::DASH];
        leaper.jumps_made += jumps.into_iter().filter(|jump| used.contains(*jump)).count() as u32;
        let feet = leaper.body.feet;
        if used.meets_device() || map.is_outside(feet) || map.liquid_at(feet, 0.0).is_some() {
            return None;
        }
        leaper.has_left_ground |= !leaper.body.is_grounded();
        if leaper.has_left_ground && leaper.body.is_grounded() {
            return Some(feet);
        }
        if !leaper.has_left_ground && tick >= MAX_RUN_TICKS {
            return None;
        }
    }
    None
}

/// A body that leaps.
struct Leaper {
    body: Body,
    target: Vec3,
    leap: Leap,
    jumps_made: u32,
    has_left_ground: bool,
}

impl Leaper {
    fn new(profile: &CharacterProfile, from: Vec3, target: Vec3, leap: Leap) -> Self {
        let mut body = Body::at(from, heading(target - from));
        body.support = crate::character::Support::Ground;
        body.air_jumps_left = profile.extra_jumps;
        match leap {
            Leap::Pad(speed) => {
                body.velocity.y = speed;
                body.leave_ground();
            }
            Leap::Jetpack(fuel) => body.fuel = fuel,
            _ => {}
        }
        Self { body, target, leap, jumps_made: 0, has_left_ground: matches!(leap, Leap::Pad(_)) }
    }

    /// The controls of a tick: approaches the target so that the body can stop there, and jumps as the leap requires.
    fn decide(&mut self, profile: &CharacterProfile, tick: u32) -> Action {
        let (feet, target) = (self.body.feet, self.target);
        let along = Vec3::new(target.x - feet.x, 0.0, target.z - feet.z).dot(self.body.facing());
        let runs = self.leap == Leap::Run && !self.has_left_ground;
        let speed = if runs { profile.forward_speed } else { approach_speed(profile, along) };
        self.body.jump_pending = self.wants_jump(profile, tick);
        let thrusts =
            matches!(self.leap, Leap::Jetpack(_)) && self.jumps_made > 0 && (feet.y < target.y + 1.2 || along > 3.0);
        let jump = if self.body.jump_pending || thrusts { 1.0 } else { 0.0 };
        Action { forward: (speed / profile.forward_speed).clamp(-1.0, 1.0), jump, ..Action::default() }
    }

    fn wants_jump(&self, profile: &CharacterProfile, tick: u32) -> bool {
        let body = &self.body;
        match self.leap {
            Leap::Run => false,
            Leap::Jump | Leap::DoubleJump | Leap::Jetpack(_) if self.jumps_made == 0 => tick == 0,
            Leap::RunAndJump | Leap::RunAndDoubleJump if self.jumps_made == 0 => !body.is_grounded(),
            Leap::Jump | Leap::RunAndJump => false,
            _ => {
                let falls = body.velocity.y < 0.5 && body.feet.y < self.target.y + 1.0;
                self.jumps_made < 2 && (body.air_jumps_left > 0 || body.can_dash(profile)) && falls
            }
        }
    }
}

/// Speed from which the body can still stop within `along` metres, m/s, with the sign of `along`.
fn approach_speed(profile: &CharacterProfile, along: f32) -> f32 {
    let usable = along.abs() - profile.forward_speed * TICK_SECONDS;
    (2.0 * BRAKE * usable.max(0.0)).sqrt().min(profile.forward_speed) * along.signum()
}
