//! Scripted leaps: where a character lands when it runs off a ledge, jumps, or is thrown.

use crate::character::{Action, Body, CharacterProfile, MoveScratch};
use crate::map::Map;
use crate::{Ability, TICK_SECONDS, Vec3};

/// How a leap begins and what the body does in the air.
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

/// Simulates a leap from `from` towards `target` and returns where the body lands, m; `None` if it lands nowhere in time,
/// in a liquid or outside the map, or triggers a device on the way.
pub fn land(
    map: &Map,
    profile: &CharacterProfile,
    from: Vec3,
    target: Vec3,
    leap: Leap,
    scratch: &mut MoveScratch,
) -> Option<Vec3> {
    let heading = target - from;
    let mut body = Body::at(from, libm::atan2f(heading.x, heading.z));
    body.support = crate::character::Support::Ground;
    body.air_jumps_left = profile.extra_jumps;
    let mut has_left_ground = false;
    match leap {
        Leap::Pad(speed) => {
            body.velocity.y = speed;
            body.leave_ground();
            has_left_ground = true;
        }
        Leap::Jetpack(fuel) => body.fuel = fuel,
        _ => {}
    }
    let mut jumps_made = 0;
    for tick in 0..MAX_TICKS {
        let remaining = Vec3::new(target.x - body.feet.x, 0.0, target.z - body.feet.z);
        let along = remaining.dot(body.facing());
        let speed = if matches!(leap, Leap::Run) && !has_left_ground {
            profile.forward_speed
        } else {
            approach_speed(profile, along)
        };
        let mut action = Action { forward: (speed / profile.forward_speed).clamp(-1.0, 1.0), ..Action::default() };
        let grounded = body.is_grounded();
        let wants_jump = match leap {
            Leap::Run => false,
            Leap::Jump | Leap::DoubleJump | Leap::Jetpack(_) if jumps_made == 0 => tick == 0,
            Leap::RunAndJump | Leap::RunAndDoubleJump if jumps_made == 0 => !grounded,
            Leap::Jump | Leap::RunAndJump => false,
            _ => jumps_made < 2 && body.air_jumps_left > 0 && body.velocity.y < 0.5 && body.feet.y < target.y + 1.0,
        };
        body.jump_pending = wants_jump;
        let wants_thrust =
            matches!(leap, Leap::Jetpack(_)) && jumps_made > 0 && (body.feet.y < target.y + 1.2 || along > 3.0);
        if wants_jump || wants_thrust {
            action.jump = 1.0;
        }
        let used = body.tick(map, profile, &action, scratch);
        jumps_made += u32::from(used.contains(Ability::Jump)) + u32::from(used.contains(Ability::DoubleJump));
        if [Ability::Pad, Ability::ZipLine, Ability::Teleporter].into_iter().any(|device| used.contains(device)) {
            return None;
        }
        if map.is_outside(body.feet) || map.liquid_at(body.feet, 0.0).is_some() {
            return None;
        }
        has_left_ground |= !body.is_grounded();
        if has_left_ground && body.is_grounded() {
            return Some(body.feet);
        }
        if !has_left_ground && tick >= MAX_RUN_TICKS {
            return None;
        }
    }
    None
}

/// Speed from which the body can still stop within `along` metres, m/s, with the sign of `along`.
fn approach_speed(profile: &CharacterProfile, along: f32) -> f32 {
    let usable = along.abs() - profile.forward_speed * TICK_SECONDS;
    (2.0 * BRAKE * usable.max(0.0)).sqrt().min(profile.forward_speed) * along.signum()
}
