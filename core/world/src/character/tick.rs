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
/// Least speed along a wall, as a share of the top speed, at which a body runs along it, and greatest upward speed at
/// which the run begins, m/s.
const LEAST_ALONG: f32 = 0.4;
const LEAST_ALONG_RISE: f32 = 1.0;
/// Ticks in the air before a body runs along a wall: not at each step.
const LEAST_AIR_TICKS: u8 = 6;
/// Speed into the wall that keeps a body on it, m/s.
const STICK_SPEED: f32 = 0.5;
/// Speed away from a wall of a jump off it, as a share of the top speed.
const WALL_JUMP_SHARE: f32 = 0.5;
/// Least speed at which a body slides, as a share of its top speed.
const SLIDE_SHARE: f32 = 0.6;
/// How far below its feet a body that swims looks for a way under what is ahead, and the room that it keeps above its
/// head there, m.
const DIVE_LOOKS_M: [f32; 4] = [1.0, 2.0, 3.0, 4.0];
const DIVE_ROOM_M: f32 = 0.2;
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
        let is_under = profile.dive_seconds > 0.0 && depth.is_some_and(|depth| depth > profile.height);
        self.dive_ticks = if is_under { self.dive_ticks.saturating_add(1) } else { 0 };
        let depth = depth.filter(|depth| *depth > AFLOAT_SHARE * profile.height);
        self.swims = depth.is_some();
        self.turn(profile, action);
        if let Some(ride) = self.ride {
            self.ride_on(map, profile, ride);
            return used;
        }
        if self.follow_curve(profile, &mut used) {
            return used;
        }
        self.stoop(map.mesh(), profile, action, &mut used);
        match depth {
            _ if self.is_pulled(profile, &mut used) => self.jump_pending = false,
            Some(depth) => self.swim(map, profile, action, depth, &mut used),
            None if self.dash_ticks > 0 => self.dash(&mut used),
            None => self.accelerate(profile, action),
        }
        self.jump(map, profile, action, &mut used);
        self.thrust(profile, action, &mut used);
        self.scale(map.mesh(), profile, action, scratch, &mut used);
        self.run_along(profile, action, &mut used);
        self.enter_devices(map, profile, &mut used);
        self.enter_spots(map, profile, action);
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
        } else if self.crouches && self.slide_ticks == 0 {
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

    /// Crouches under what is low, or slides there.
    fn stoop(&mut self, mesh: &Mesh, profile: &CharacterProfile, action: &Action, used: &mut AbilitySet) {
        let crouches = profile.crouch_height > 0.0
            && !self.swims
            && self.is_under_ceiling(mesh, profile, self.wish(profile, action));
        let crouched = std::mem::replace(&mut self.crouches, crouches);
        if !self.crouches {
            self.slide_ticks = 0;
            return;
        }
        self.jump_pending = false;
        let is_fast = self.velocity.with_y(0.0).length() >= SLIDE_SHARE * profile.forward_speed;
        if !crouched && is_fast && self.is_grounded() {
            self.slide_ticks = (profile.slide_seconds / TICK_SECONDS) as u16;
        } else {
            self.slide_ticks = self.slide_ticks.saturating_sub(1);
        }
        used.insert(if self.slide_ticks > 0 { Ability::SLIDE } else { Ability::CROUCH });
    }

    /// Floats with the head above the water, dives under what reaches into it ahead, and moves as far as the action
    /// wants.
    fn swim(
        &mut self,
        map: &CollisionMap,
        profile: &CharacterProfile,
        action: &Action,
        depth: f32,
        used: &mut AbilitySet,
    ) {
        let wish = self.wish(profile, action);
        let float = (depth - FLOAT_SHARE * profile.height) * FLOAT_RATE;
        let ceiling = self.water_ceiling(map, profile, wish);
        // Whether what is above reaches down to where the body would float.
        let floor = ceiling.map(|ceiling| ceiling - profile.height - DIVE_ROOM_M);
        let sinks = floor.filter(|floor| *floor < float / FLOAT_RATE);
        self.dives = sinks.is_some() && profile.dive_seconds > 0.0;
        let rise = if self.dives { sinks.unwrap_or_default() * FLOAT_RATE } else { float };
        let wish = wish + Vec3::Y * rise.clamp(-FLOAT_SPEED, FLOAT_SPEED);
        self.velocity += (wish - self.velocity).clamp_length_max(SWIM_ACCELERATION * TICK_SECONDS);
        self.jump_pending = false;
        used.insert(if self.dives { Ability::DIVE } else { Ability::SWIM });
    }

    /// Height above its feet of what is above a body that dives, or ahead of it, m, as far as there is water below.
    fn water_ceiling(&self, map: &CollisionMap, profile: &CharacterProfile, wish: Vec3) -> Option<f32> {
        if profile.dive_seconds <= 0.0 {
            return None;
        }
        let near = self.ceiling(map.mesh(), profile, wish, profile.radius, profile.height + DIVE_ROOM_M);
        let is_blocked = || self.hold.is_some_and(|hold| wish.dot(hold.out) < 0.0);
        near.or_else(|| {
            let ahead = self.feet + wish.normalize_or_zero() * (profile.radius + DIVE_ROOM_M);
            let looks =
                DIVE_LOOKS_M.into_iter().filter(|look| is_blocked() && map.is_open_water(ahead - Vec3::Y * *look));
            looks.into_iter().find_map(|look| self.ceiling(map.mesh(), profile, wish, -look, profile.height))
        })
    }

    /// Runs along the wall that the body touches in the air, at the same height.
    fn run_along(&mut self, profile: &CharacterProfile, action: &Action, used: &mut AbilitySet) {
        let most = (profile.wall_run_seconds / TICK_SECONDS) as u16;
        let is_free = self.ticks_in_air >= LEAST_AIR_TICKS && !self.is_grounded() && used.is_empty();
        let Some(hold) = self.hold.filter(|hold| is_free && !hold.is_climbed && self.wall_ticks < most) else { return };
        let least = LEAST_ALONG * profile.forward_speed;
        let along = |vector: Vec3| (vector - hold.out * vector.dot(hold.out)).with_y(0.0);
        let wish = along(self.wish(profile, action));
        let speed = along(self.velocity);
        if self.velocity.y > LEAST_ALONG_RISE || wish.length() < least || speed.dot(wish.normalize()) < least {
            return;
        }
        self.velocity = speed - hold.out * STICK_SPEED;
        self.wall_ticks += 1;
        used.insert(Ability::WALL_RUN);
    }

    fn jump(&mut self, map: &CollisionMap, profile: &CharacterProfile, action: &Action, used: &mut AbilitySet) {
        if !self.jump_pending {
            return;
        }
        let wall = self.hold.filter(|_| self.wall_ticks > 0 && !self.is_grounded());
        if let Some(hold) = wall {
            self.velocity += hold.out * WALL_JUMP_SHARE * profile.forward_speed;
            self.wall_ticks = u16::MAX;
            used.insert(Ability::WALL_RUN);
        } else if self.is_grounded() || self.ticks_in_air <= profile.coyote_ticks {
            used.insert(Ability::JUMP);
        } else if self.air_jumps_left > 0 {
            self.air_jumps_left -= 1;
            used.insert(Ability::DOUBLE_JUMP);
        } else if self.catch_anchor(map, profile, self.wish(profile, action)) {
            self.jump_pending = false;
            return;
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
