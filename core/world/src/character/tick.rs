//! One tick of a body: turn, accelerate, jump, thrust, enter devices, move.

use super::action::Action;
use super::body::{Body, Hold, Support};
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
        self.turn(profile, action);
        if let Some(ride) = self.ride {
            self.ride_on(map, profile, ride);
            return used;
        }
        self.accelerate(profile, action);
        self.jump(profile, &mut used);
        self.thrust(profile, action, &mut used);
        self.scale(map.mesh(), profile, action, scratch, &mut used);
        self.enter_devices(map, profile, &mut used);
        if self.ride.is_none() {
            self.move_and_collide(map.mesh(), profile, scratch);
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
        if self.liquid.is_some() {
            wish *= WADING_SPEED;
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

    fn jump(&mut self, profile: &CharacterProfile, used: &mut AbilitySet) {
        if !self.jump_pending {
            return;
        }
        if self.is_grounded() || self.ticks_in_air <= profile.coyote_ticks {
            used.insert(Ability::JUMP);
        } else if self.air_jumps_left > 0 {
            self.air_jumps_left -= 1;
            used.insert(Ability::DOUBLE_JUMP);
        } else {
            return;
        }
        self.velocity.y = profile.jump_speed;
        self.leave_ground();
        self.jump_pending = false;
    }

    /// Climbs the face that the body touches, or pulls it up to the ledge above, as long as it wants to move into the
    /// face and does not jump.
    fn scale(
        &mut self,
        mesh: &Mesh,
        profile: &CharacterProfile,
        action: &Action,
        scratch: &mut MoveScratch,
        used: &mut AbilitySet,
    ) {
        let Some(Hold { out, is_climbed }) = self.hold.filter(|_| used.is_empty()) else { return };
        let (ability, speed) =
            if is_climbed { (Ability::CLIMB, profile.climb_speed) } else { (Ability::MANTLE, PULL_SPEED) };
        let wants = -self.wish(profile, action).dot(out) >= LEAST_INTO * profile.forward_speed;
        if !wants || self.velocity.y > speed || !is_climbed && !self.finds_ledge(mesh, profile, out, scratch) {
            return;
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
