//! One tick of a body: turn, accelerate, jump, thrust, enter devices, move.

use super::action::Action;
use super::body::{Body, Hold, Support};
use super::contact::FLOAT_SHARE;
use super::profile::CharacterProfile;
use super::surroundings::MoveScratch;
use crate::float::wrapped;
use crate::map::CollisionMap;
use crate::mesh::Mesh;
use crate::{Ability, AbilitySet, TICK_SECONDS, Vec3};

/// Terminal speed of a fall, m/s.
const MAX_FALL_SPEED: f32 = 45.0;
/// Least share of the top speed at which a body that climbs wants to move into the face.
const LEAST_INTO: f32 = 0.2;
/// Speed at which a body pulls itself up to a ledge, m/s.
const PULL_SPEED: f32 = 3.0;
/// Share of its height to which a body is under water when it begins to float; it must be less than that at which it
/// floats.
const AFLOAT_SHARE: f32 = 0.6;
/// Speed at which a body that floats rises or sinks for each metre that it floats too deep or too high, 1/s, and its
/// limit, m/s.
const FLOAT_RATE: f32 = 3.0;
const FLOAT_SPEED: f32 = 2.0;
/// Ticks that a dash takes.
pub const DASH_TICKS: u8 = 12;
/// Speed of a body that crouches, as a share.
const CROUCH_SPEED: f32 = 0.5;
/// Acceleration of a body that swims, m/s2.
const SWIM_ACCELERATION: f32 = 12.0;
/// Air control on a steep face, as a share.
const SLIDE_CONTROL: f32 = 0.2;
/// Depth of liquid above the feet that slows a body down, m.
const WADING_DEPTH_M: f32 = 0.25;
/// Speed in water as a share of the walking speed.
const WADING_SPEED: f32 = 0.5;

impl Body {
    /// Advances the body by one tick under `action`. Returns the abilities that it used.
    pub fn tick(
        &mut self,
        map: &CollisionMap,
        profile: &CharacterProfile,
        action: &Action,
        scratch: &mut MoveScratch,
    ) -> AbilitySet {
        let mut used = AbilitySet::default();
        self.liquid = map.liquid_at(self.feet, WADING_DEPTH_M);
        let depth = if profile.swim_speed > 0.0 { map.water_above(self.feet) } else { None };
        let depth = depth.filter(|depth| *depth > AFLOAT_SHARE * profile.height);
        self.swims = depth.is_some();
        self.turn(profile, action);
        if let Some(ride) = self.ride {
            self.ride_on(map, profile, ride);
            return used;
        }
        self.crouches = self.is_under_ceiling(map.mesh(), profile, self.wish(profile, action));
        if self.crouches {
            self.jump_pending = false;
            used.insert(Ability::CROUCH);
        }
        match depth {
            Some(depth) => self.swim(profile, action, depth, &mut used),
            None if self.dash_ticks > 0 => self.dash(&mut used),
            None => self.accelerate(profile, action),
        }
        self.jump(profile, action, &mut used);
        self.thrust(profile, action, &mut used);
        self.scale(map.mesh(), profile, action, scratch, &mut used);
        self.enter_devices(map, profile, &mut used);
        if self.ride.is_none() {
            let crouched = self.crouches.then(|| profile.crouched());
            self.move_and_collide(map.mesh(), crouched.as_ref().unwrap_or(profile), scratch);
        }
        used
    }

    fn turn(&mut self, profile: &CharacterProfile, action: &Action) {
        self.yaw = wrapped(self.yaw + action.turn * profile.turn_speed * TICK_SECONDS);
    }

    /// The horizontal velocity that an action requests, m/s.
    pub(crate) fn wish(&self, profile: &CharacterProfile, action: &Action) -> Vec3 {
        let (sin, cos) = libm::sincosf(self.yaw);
        let forward = action.forward.max(-profile.side_speed_share);
        let right = action.strafe * profile.side_speed_share;
        let mut wish = Vec3::new(sin * forward - cos * right, 0.0, cos * forward + sin * right);
        let length = wish.length();
        if length > 1.0 {
            wish /= length;
        }
        wish *= profile.forward_speed;
        if self.swims {
            wish *= profile.swim_speed / profile.forward_speed;
        } else if self.liquid.is_some() {
            wish *= WADING_SPEED;
        } else if self.crouches {
            wish *= CROUCH_SPEED;
        }
        wish
    }

    fn accelerate(&mut self, profile: &CharacterProfile, action: &Action) {
        let wish = self.wish(profile, action);
        let limit = match self.support {
            Support::Ground => profile.ground_acceleration,
            Support::Air => profile.air_acceleration,
            // While the body slides, the slope dominates its motion.
            Support::Steep => profile.air_acceleration * SLIDE_CONTROL,
        };
        let mut change = Vec3::new(wish.x - self.velocity.x, 0.0, wish.z - self.velocity.z);
        let change_length = change.length();
        let most = limit * TICK_SECONDS;
        if change_length > most {
            change *= most / change_length;
        }
        self.velocity += change;
        if self.support == Support::Steep {
            // A body cannot run up faces that are too steep to stand on.
            let into = self.velocity.dot(self.steep_out);
            if into < 0.0 {
                self.velocity -= self.steep_out * into;
            }
        }
        self.velocity.y = (self.velocity.y - profile.gravity * TICK_SECONDS).max(-MAX_FALL_SPEED);
    }

    /// Flies on at the same height.
    fn dash(&mut self, used: &mut AbilitySet) {
        self.dash_ticks -= 1;
        self.velocity.y = 0.0;
        used.insert(Ability::DASH);
    }

    /// Floats with the head above the water, and moves as far as the action wants.
    fn swim(&mut self, profile: &CharacterProfile, action: &Action, depth: f32, used: &mut AbilitySet) {
        let rise = ((depth - FLOAT_SHARE * profile.height) * FLOAT_RATE).clamp(-FLOAT_SPEED, FLOAT_SPEED);
        let wish = self.wish(profile, action) + Vec3::Y * rise;
        self.velocity += (wish - self.velocity).clamp_length_max(SWIM_ACCELERATION * TICK_SECONDS);
        self.jump_pending = false;
        used.insert(Ability::SWIM);
    }

    fn jump(&mut self, profile: &CharacterProfile, action: &Action, used: &mut AbilitySet) {
        if !self.jump_pending {
            return;
        }
        if self.is_grounded() || self.ticks_in_air <= profile.coyote_ticks {
            used.insert(Ability::JUMP);
        } else if self.air_jumps_left > 0 {
            self.air_jumps_left -= 1;
            used.insert(Ability::DOUBLE_JUMP);
        } else if self.can_dash(profile) {
            let way = self.wish(profile, action).try_normalize().unwrap_or(self.facing());
            self.velocity = way * profile.dash_speed;
            (self.dash_ticks, self.has_dashed, self.jump_pending) = (DASH_TICKS, true, false);
            used.insert(Ability::DASH);
            return;
        } else {
            return;
        }
        self.velocity.y = profile.jump_speed;
        self.leave_ground();
        self.jump_pending = false;
    }

    /// Climbs the face that the body touches, or pulls itself up to the ledge above, also out of water, as long as it
    /// wants to move into the face and does not jump.
    fn scale(
        &mut self,
        mesh: &Mesh,
        profile: &CharacterProfile,
        action: &Action,
        scratch: &mut MoveScratch,
        used: &mut AbilitySet,
    ) {
        let pulls_to = self.pulls_to.take();
        let is_idle = used.iter().all(|ability| [Ability::SWIM, Ability::CROUCH].contains(&ability));
        let Some(Hold { out, is_climbed }) = self.hold.filter(|_| is_idle) else { return };
        let (ability, speed) = match is_climbed {
            true => (Ability::CLIMB, profile.climb_speed),
            false if self.swims || profile.mantle_height <= 0.0 => (Ability::SWIM, PULL_SPEED),
            false => (Ability::MANTLE, PULL_SPEED),
        };
        let wish = self.wish(profile, action);
        let wants = -wish.dot(out) >= LEAST_INTO * if self.swims { profile.swim_speed } else { profile.forward_speed };
        if !wants || self.velocity.y > speed {
            return;
        }
        if !is_climbed {
            let Some(ledge) = pulls_to.or_else(|| self.ledge(mesh, profile, out, scratch)) else { return };
            self.pulls_to = Some(ledge).filter(|ledge| self.feet.y < *ledge);
        }
        let inward = out * self.velocity.dot(out);
        let sideways = (self.velocity - inward).with_y(0.0).clamp_length_max(speed);
        self.velocity = inward + sideways + Vec3::Y * speed;
        self.leave_ground();
        used.insert(ability);
    }

    /// Applies jetpack thrust in the air while the jump is held, unless the body jumps in this tick.
    fn thrust(&mut self, profile: &CharacterProfile, action: &Action, used: &mut AbilitySet) {
        let jumps = used.contains(Ability::JUMP) || used.contains(Ability::DOUBLE_JUMP);
        let wanted = action.jump > 0.0 && !jumps && !self.is_grounded();
        if !wanted || self.fuel <= 0.0 || self.velocity.y >= profile.jetpack_climb_speed {
            return;
        }
        let pushed = self.velocity.y + profile.jetpack_acceleration * TICK_SECONDS;
        self.velocity.y = pushed.min(profile.jetpack_climb_speed);
        self.fuel = (self.fuel - TICK_SECONDS).max(0.0);
        self.leave_ground();
        used.insert(Ability::JETPACK);
    }
}
