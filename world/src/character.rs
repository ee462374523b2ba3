//! One character: its profile, its body and one tick of its motion.
//!
//! The body is an upright capsule moved by our own controller: integrate, then push out of the deepest
//! contact until none is left, then snap to the ground when walking down. Tick by tick it touches only the
//! few triangles around it (see `docs/adr/0001-own-capsule-controller.md` for why it is not rapier's).

use crate::map::features::ZIP_LIFT_M;
use crate::map::{Liquid, Map, Zone};
use crate::mesh::{Contact, Mesh};
use crate::{TICK_SECONDS, Vec3};
use serde::{Deserialize, Serialize};

/// Longest move between two contact passes, in metres: below the capsule's radius, so nothing is tunnelled.
const SUBSTEP_M: f32 = 0.22;
/// Contact passes after each move.
const MAX_PUSHES: usize = 6;
/// Contacts shallower than this are left alone, in metres.
const CONTACT_SLOP_M: f32 = 1.0e-4;
/// Terminal speed of a fall, m/s.
const MAX_FALL_SPEED: f32 = 45.0;
/// Speed below which a body wedged between steep faces counts as standing, m/s.
const WEDGED_SPEED: f32 = 0.6;
/// Share of the control in the air that is left while sliding down a steep face.
const SLIDE_CONTROL: f32 = 0.2;
/// Depth of liquid over the feet from which it acts, in metres.
const WADING_DEPTH_M: f32 = 0.25;
/// Share of the walking speed that is left in water.
const WADING_SPEED: f32 = 0.5;

/// No body is further from the origin, m, or faster, m/s: even pads cannot throw it so.
const FARTHEST_M: f32 = 1.0e6;
const FASTEST: f32 = 2.0e4;

/// Share of the speed that is kept when a zip line is let go.
const ZIP_RELEASE_SHARE: f32 = 0.4;

/// Everything that makes one kind of character move differently from another.
///
/// Defaults follow the figures of the environment that the paper's authors released.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CharacterProfile {
    /// Height from soles to crown, m.
    pub height: f32,
    /// Radius of the capsule, m.
    pub radius: f32,
    /// Top speed forward, m/s.
    pub forward_speed: f32,
    /// Top speed backwards and sideways as a share of `forward_speed`.
    pub side_speed_share: f32,
    /// Top turning speed, rad/s.
    pub turn_speed: f32,
    /// Upward speed given by a jump, m/s.
    pub jump_speed: f32,
    /// Gravity, m/s2.
    pub gravity: f32,
    /// Jumps that can be made in the air before landing.
    pub extra_jumps: u8,
    /// Steepest slope that can be walked, rad.
    pub max_slope: f32,
    /// Highest step that is walked over without a jump, m.
    pub step_height: f32,
    /// Horizontal acceleration on the ground, m/s2.
    pub ground_acceleration: f32,
    /// Horizontal acceleration in the air, m/s2.
    pub air_acceleration: f32,
    /// Time after leaving the ground in which a jump still counts as one from the ground, in ticks.
    pub coyote_ticks: u8,
    /// Whether it can use zip lines.
    pub uses_zip_lines: bool,
    /// Speed along a zip line, m/s.
    pub zip_line_speed: f32,
    /// Whether it can put on jetpacks.
    pub uses_jetpacks: bool,
    /// Upward acceleration of a jetpack, gravity not subtracted, m/s2.
    pub jetpack_acceleration: f32,
    /// Upward speed from which a jetpack pushes no more, m/s.
    pub jetpack_climb_speed: f32,
}

impl Default for CharacterProfile {
    fn default() -> Self {
        Self {
            height: 1.8,
            radius: 0.3,
            forward_speed: 11.0,
            side_speed_share: 0.6,
            turn_speed: std::f32::consts::PI,
            jump_speed: 10.0,
            gravity: 20.0,
            extra_jumps: 1,
            max_slope: 35.0f32.to_radians(),
            step_height: 0.1,
            ground_acceleration: 60.0,
            air_acceleration: 25.0,
            coyote_ticks: 6,
            uses_zip_lines: true,
            zip_line_speed: 14.0,
            uses_jetpacks: true,
            jetpack_acceleration: 38.0,
            jetpack_climb_speed: 8.0,
        }
    }
}

/// A field of a [`CharacterProfile`] outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("profile.{field} is {value}, allowed are {min} to {max}")]
pub struct ProfileError {
    /// Which field.
    pub field: &'static str,
    /// What was asked for.
    pub value: f32,
    /// Smallest allowed value.
    pub min: f32,
    /// Largest allowed value.
    pub max: f32,
}

impl CharacterProfile {
    /// Checks every number.
    ///
    /// # Errors
    /// Names the first field outside its range.
    pub fn validate(&self) -> Result<(), ProfileError> {
        let ranges = [
            ("radius", self.radius, 0.25, 1.0),
            ("height", self.height, 2.0 * self.radius, 4.0),
            ("forward_speed", self.forward_speed, 0.1, 20.0),
            ("side_speed_share", self.side_speed_share, 0.0, 1.0),
            ("turn_speed", self.turn_speed, 0.1, 20.0),
            ("jump_speed", self.jump_speed, 0.0, 30.0),
            ("gravity", self.gravity, 1.0, 100.0),
            ("max_slope", self.max_slope, 0.0, 1.4),
            ("step_height", self.step_height, 0.0, self.radius),
            ("ground_acceleration", self.ground_acceleration, 1.0, 1000.0),
            ("air_acceleration", self.air_acceleration, 0.0, 1000.0),
            ("zip_line_speed", self.zip_line_speed, 1.0, 40.0),
            ("jetpack_acceleration", self.jetpack_acceleration, 0.0, 200.0),
            ("jetpack_climb_speed", self.jetpack_climb_speed, 0.0, 40.0),
        ];
        for (field, value, min, max) in ranges {
            if !(min..=max).contains(&value) {
                return Err(ProfileError { field, value, min, max });
            }
        }
        Ok(())
    }
}

/// What the policy controls, each in [-1, 1].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Action {
    /// Forward (positive) or backwards.
    pub forward: f32,
    /// To the right (positive) or left.
    pub strafe: f32,
    /// Turn left (positive) or right.
    pub turn: f32,
    /// Jump, or jump again in the air, when positive.
    pub jump: f32,
}

/// Number of values in an [`Action`].
pub const ACTION_LEN: usize = 4;

/// An action with a value that is not a finite number.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("action[{index}] is {value}, allowed are finite numbers (values beyond -1 to 1 are clamped)")]
pub struct ActionError {
    /// Position in the order forward, strafe, turn, jump.
    pub index: usize,
    /// The offending value.
    pub value: f32,
}

impl Action {
    /// Takes forward, strafe, turn, jump and clamps each to [-1, 1].
    ///
    /// # Errors
    /// Names the first value that is NaN or infinite.
    pub fn from_array(values: [f32; ACTION_LEN]) -> Result<Self, ActionError> {
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            return Err(ActionError { index, value: values[index] });
        }
        let [forward, strafe, turn, jump] = values.map(|value| value.clamp(-1.0, 1.0));
        Ok(Self { forward, strafe, turn, jump })
    }

    /// Forward, strafe, turn, jump.
    pub fn to_array(self) -> [f32; ACTION_LEN] {
        [self.forward, self.strafe, self.turn, self.jump]
    }
}

/// How a body is supported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Support {
    /// Nothing underneath.
    #[default]
    Air,
    /// On ground that can be walked.
    Ground,
    /// Touching only ground too steep to stand on.
    Steep,
}

/// Position and motion of one character.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Body {
    /// Lowest point of the capsule, m.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Heading, rad, in (-pi, pi].
    pub yaw: f32,
    /// What it stands on.
    pub support: Support,
    /// The liquid it wades in.
    pub liquid: Option<Liquid>,
    /// Jumps left before it must land.
    pub air_jumps_left: u8,
    /// Ticks since it last stood on ground, saturating.
    pub ticks_in_air: u8,
    /// The jump asked for by the running decision has not been made yet.
    pub jump_pending: bool,
    /// The zip line it hangs on.
    pub ride: Option<Ride>,
    /// Seconds of jetpack thrust left.
    pub fuel: f32,
    /// It has just been teleported and must step off the disc before the next time.
    pub teleport_locked: bool,
    /// Horizontal direction out of the steep face touched last tick.
    steep_out: Vec3,
}

/// A ride on a zip line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ride {
    /// Index of the zip line on the map.
    pub line_idx: u32,
    /// Metres travelled.
    pub distance: f32,
}

/// What happened to a body in one tick, besides moving.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TickEvents {
    /// It jumped from the ground.
    pub jumped: bool,
    /// It jumped in the air.
    pub double_jumped: bool,
    /// A pad threw it upwards.
    pub padded: bool,
    /// It began to ride a zip line.
    pub zipped: bool,
    /// It was teleported.
    pub teleported: bool,
    /// Its jetpack pushed.
    pub thrust: bool,
}

impl TickEvents {
    /// Adds what happened in another tick.
    pub fn merge(&mut self, other: TickEvents) {
        self.jumped |= other.jumped;
        self.double_jumped |= other.double_jumped;
        self.padded |= other.padded;
        self.zipped |= other.zipped;
        self.teleported |= other.teleported;
        self.thrust |= other.thrust;
    }
}

/// Scratch memory of the controller, reused from tick to tick so that none is allocated.
#[derive(Debug, Default)]
pub struct MoveScratch {
    triangles: Vec<u32>,
}

impl Body {
    /// A resting body.
    pub fn at(feet: Vec3, yaw: f32) -> Self {
        Self { feet, yaw, ..Self::default() }
    }

    /// Whether a stored body can have moved on a map with so many zip lines: what a tick takes for granted.
    pub(crate) fn is_sound(&self, zip_line_count: usize) -> bool {
        let lies_within = |vector: Vec3, most: f32| vector.abs().max_element() <= most && vector.is_finite();
        lies_within(self.feet, FARTHEST_M)
            && lies_within(self.velocity, FASTEST)
            && lies_within(self.steep_out, 1.0)
            && self.yaw.is_finite()
            && self.ride.is_none_or(|ride| (ride.line_idx as usize) < zip_line_count && ride.distance.is_finite())
    }

    /// Whether it stands on ground that can be walked.
    pub fn is_grounded(&self) -> bool {
        self.support == Support::Ground
    }

    /// Whether a jump asked for now would be made.
    pub fn can_jump(&self, profile: &CharacterProfile) -> bool {
        self.is_grounded() || self.ticks_in_air <= profile.coyote_ticks || self.air_jumps_left > 0
    }

    /// Unit vector that it faces.
    pub fn facing(&self) -> Vec3 {
        let (sin, cos) = libm::sincosf(self.yaw);
        Vec3::new(sin, 0.0, cos)
    }

    /// Turns a world vector into this body's frame: x right, y up, z forward.
    pub fn to_local(&self, vector: Vec3) -> Vec3 {
        let (sin, cos) = libm::sincosf(self.yaw);
        Vec3::new(vector.z * sin - vector.x * cos, vector.y, vector.x * sin + vector.z * cos)
    }

    /// Notes that a new decision has begun: its jump, if any, is due once.
    pub fn begin_decision(&mut self, action: &Action) {
        self.jump_pending = action.jump > 0.0;
    }

    /// Advances the body by one tick under `action`.
    pub fn tick(
        &mut self,
        map: &Map,
        profile: &CharacterProfile,
        action: &Action,
        scratch: &mut MoveScratch,
    ) -> TickEvents {
        let mut events = TickEvents::default();
        self.liquid = map.liquid_at(self.feet, WADING_DEPTH_M);
        self.turn(profile, action);
        if let Some(ride) = self.ride {
            self.ride_on(map, profile, ride);
            return events;
        }
        self.accelerate(profile, action);
        self.jump(profile, &mut events);
        self.thrust(profile, action, &mut events);
        self.enter_devices(map, profile, &mut events);
        if self.ride.is_none() {
            self.move_and_collide(map.mesh(), profile, scratch);
        }
        events
    }

    fn turn(&mut self, profile: &CharacterProfile, action: &Action) {
        use std::f32::consts::{PI, TAU};
        self.yaw += action.turn * profile.turn_speed * TICK_SECONDS;
        if self.yaw > PI {
            self.yaw -= TAU;
        } else if self.yaw <= -PI {
            self.yaw += TAU;
        }
    }

    fn accelerate(&mut self, profile: &CharacterProfile, action: &Action) {
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
        let limit = match self.support {
            Support::Ground => profile.ground_acceleration,
            Support::Air => profile.air_acceleration,
            // Sliding: the slope has the say, not the legs.
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
            // No running up faces that are too steep to stand on.
            let into = self.velocity.dot(self.steep_out);
            if into < 0.0 {
                self.velocity -= self.steep_out * into;
            }
        }
        self.velocity.y = (self.velocity.y - profile.gravity * TICK_SECONDS).max(-MAX_FALL_SPEED);
    }

    fn jump(&mut self, profile: &CharacterProfile, events: &mut TickEvents) {
        if !self.jump_pending {
            return;
        }
        if self.is_grounded() || self.ticks_in_air <= profile.coyote_ticks {
            events.jumped = true;
        } else if self.air_jumps_left > 0 {
            self.air_jumps_left -= 1;
            events.double_jumped = true;
        } else {
            return;
        }
        self.velocity.y = profile.jump_speed;
        self.leave_ground();
        self.jump_pending = false;
    }

    pub(crate) fn leave_ground(&mut self) {
        self.support = Support::Air;
        self.ticks_in_air = u8::MAX;
    }

    /// A jetpack pushes in the air while the jump is held and no jump was made of it in this tick.
    fn thrust(&mut self, profile: &CharacterProfile, action: &Action, events: &mut TickEvents) {
        let jumps = events.jumped || events.double_jumped;
        let wanted = action.jump > 0.0 && !jumps && !self.is_grounded();
        if !wanted || self.fuel <= 0.0 || self.velocity.y >= profile.jetpack_climb_speed {
            return;
        }
        let pushed = self.velocity.y + profile.jetpack_acceleration * TICK_SECONDS;
        self.velocity.y = pushed.min(profile.jetpack_climb_speed);
        self.fuel = (self.fuel - TICK_SECONDS).max(0.0);
        self.leave_ground();
        events.thrust = true;
    }

    fn enter_devices(&mut self, map: &Map, profile: &CharacterProfile, events: &mut TickEvents) {
        let device = map.device_at(self.feet);
        if !matches!(device, Some(Zone::Teleporter(_) | Zone::TeleporterBack(_))) {
            self.teleport_locked = false;
        }
        match device {
            Some(Zone::Pad(idx)) if self.velocity.y <= 0.0 => {
                self.velocity.y = map.placed().pads[idx as usize].speed;
                self.leave_ground();
                events.padded = true;
            }
            Some(Zone::ZipLine(line_idx)) if profile.uses_zip_lines => {
                self.ride = Some(Ride { line_idx, distance: 0.0 });
                self.leave_ground();
                self.jump_pending = false;
                events.zipped = true;
            }
            Some(Zone::Teleporter(idx)) if !self.teleport_locked => {
                self.teleport_to(map.placed().teleporters[idx as usize].to, events);
            }
            Some(Zone::TeleporterBack(idx)) if !self.teleport_locked => {
                self.teleport_to(map.placed().teleporters[idx as usize].from, events);
            }
            Some(Zone::Jetpack(idx)) if profile.uses_jetpacks => {
                self.fuel = self.fuel.max(map.placed().jetpacks[idx as usize].fuel);
            }
            _ => {}
        }
    }

    fn teleport_to(&mut self, place: Vec3, events: &mut TickEvents) {
        self.feet = place + Vec3::new(0.0, 0.1, 0.0);
        self.teleport_locked = true;
        events.teleported = true;
    }

    /// One tick along a zip line: the cable has the say until its end, or until a jump lets go.
    fn ride_on(&mut self, map: &Map, profile: &CharacterProfile, ride: Ride) {
        let line = &map.placed().zip_lines[ride.line_idx as usize];
        let distance = ride.distance + profile.zip_line_speed * TICK_SECONDS;
        let (feet, direction) = line.at(distance.min(line.length()));
        self.feet = feet;
        self.velocity = direction * profile.zip_line_speed;
        self.support = Support::Air;
        let has_left_station = distance > 2.0 * ZIP_LIFT_M;
        let lets_go = self.jump_pending && has_left_station;
        if distance < line.length() && !lets_go {
            self.ride = Some(Ride { distance, ..ride });
            return;
        }
        self.ride = None;
        self.jump_pending = false;
        self.velocity *= ZIP_RELEASE_SHARE;
        self.air_jumps_left = profile.extra_jumps;
    }

    fn move_and_collide(&mut self, mesh: &Mesh, profile: &CharacterProfile, scratch: &mut MoveScratch) {
        let was_grounded = self.is_grounded();
        let start = self.feet;
        let delta = self.velocity * TICK_SECONDS;
        let snap = if was_grounded {
            profile.step_height + Vec3::new(delta.x, 0.0, delta.z).length() * libm::tanf(profile.max_slope)
        } else {
            0.0
        };
        let reach = Vec3::new(profile.radius + 0.05, 0.05, profile.radius + 0.05);
        let ahead = start + delta;
        let low = start.min(ahead) - reach - Vec3::new(0.0, snap, 0.0);
        let high = start.max(ahead) + reach + Vec3::new(0.0, profile.height + profile.step_height, 0.0);
        mesh.gather_solids(low, high, &mut scratch.triangles);

        self.support = Support::Air;
        let substep_count = (delta.length() / SUBSTEP_M).ceil().max(1.0);
        for _ in 0..substep_count as u32 {
            self.feet += self.velocity * (TICK_SECONDS / substep_count);
            self.push_out(mesh, profile, &scratch.triangles, was_grounded);
        }
        if was_grounded && self.support != Support::Ground && self.velocity.y <= 0.0 {
            self.snap_down(mesh, profile, &scratch.triangles, snap);
        }
        if self.support == Support::Steep && (self.feet - start).length() < WEDGED_SPEED * TICK_SECONDS {
            self.support = Support::Ground;
        }
        if self.is_grounded() {
            self.ticks_in_air = 0;
            self.air_jumps_left = profile.extra_jumps;
        } else {
            self.ticks_in_air = self.ticks_in_air.saturating_add(1);
        }
    }

    /// Moves the body out of what it penetrates, deepest contact first, and takes the blocked part of its
    /// velocity away.
    fn push_out(&mut self, mesh: &Mesh, profile: &CharacterProfile, triangles: &[u32], was_grounded: bool) {
        for _ in 0..MAX_PUSHES {
            let Some(contact) = deepest_contact(mesh, profile, triangles, self.feet) else { return };
            let n = contact.normal;
            if is_walkable(profile, &contact, self.feet) {
                self.feet.y += contact.depth / n.y;
                self.velocity.y = self.velocity.y.max(0.0);
                self.support = Support::Ground;
                continue;
            }
            let sideways = Vec3::new(n.x, 0.0, n.z);
            let sideways_length = sideways.length();
            if n.y > 0.0 && sideways_length > 1.0e-3 {
                let out = sideways / sideways_length;
                if self.support == Support::Air {
                    self.support = Support::Steep;
                    self.steep_out = out;
                }
                if was_grounded || self.support == Support::Ground {
                    // Someone who walks meets a steep face as a wall, not as a ramp.
                    self.feet += out * (contact.depth / sideways_length.max(0.2));
                    self.velocity -= out * self.velocity.dot(out).min(0.0);
                    continue;
                }
            }
            self.feet += n * contact.depth;
            let rise = self.velocity.y.max(0.0);
            self.velocity -= n * self.velocity.dot(n).min(0.0);
            self.velocity.y = self.velocity.y.min(rise);
        }
    }

    /// Moves the body aside by `offset` metres, as far as the geometry lets it.
    pub(crate) fn shove(&mut self, mesh: &Mesh, profile: &CharacterProfile, offset: Vec3, scratch: &mut MoveScratch) {
        let support = self.support;
        let reach = Vec3::splat(profile.radius + 0.05);
        let (low, high) = (self.feet.min(self.feet + offset) - reach, self.feet.max(self.feet + offset) + reach);
        mesh.gather_solids(low, high + Vec3::new(0.0, profile.height, 0.0), &mut scratch.triangles);
        self.feet += offset;
        self.push_out(mesh, profile, &scratch.triangles, support == Support::Ground);
        self.support = support;
    }

    /// Keeps a walker on the ground that falls away under it; leaves it in the air over a ledge.
    fn snap_down(&mut self, mesh: &Mesh, profile: &CharacterProfile, triangles: &[u32], snap: f32) {
        let before = *self;
        self.feet.y -= snap;
        self.push_out(mesh, profile, triangles, true);
        let moved_sideways = Vec3::new(self.feet.x - before.feet.x, 0.0, self.feet.z - before.feet.z).length();
        if self.support != Support::Ground || self.feet.y > before.feet.y || moved_sideways > 0.5 * profile.radius {
            *self = before;
        }
    }
}

fn is_walkable(profile: &CharacterProfile, contact: &Contact, feet: Vec3) -> bool {
    let limit = libm::cosf(profile.max_slope);
    contact.normal.y >= limit
        || (contact.face_normal.y >= limit && contact.normal.y > 0.5 && contact.point.y - feet.y <= profile.step_height)
}

fn deepest_contact(mesh: &Mesh, profile: &CharacterProfile, triangles: &[u32], feet: Vec3) -> Option<Contact> {
    let low = feet + Vec3::new(0.0, profile.radius, 0.0);
    let segment = profile.height - 2.0 * profile.radius;
    let mut deepest: Option<Contact> = None;
    for &idx in triangles {
        if let Some(contact) = mesh.triangles()[idx as usize].capsule_contact(low, segment, profile.radius)
            && contact.depth > deepest.map_or(CONTACT_SLOP_M, |best| best.depth)
        {
            deepest = Some(contact);
        }
    }
    deepest
}

/// Whether a body with its feet at `feet` is free of solid geometry (down to `slop` metres of penetration).
///
/// Contacts are one-sided, so the axis is checked besides: no face may cross it between sole and crown.
pub fn is_clear(mesh: &Mesh, profile: &CharacterProfile, feet: Vec3, slop: f32, scratch: &mut MoveScratch) -> bool {
    let up = Vec3::new(0.000_31, 0.999_999_9, 0.000_23);
    let mut from = feet - Vec3::new(0.0, slop, 0.0);
    let crown = feet.y + profile.height;
    while let Some(hit) = mesh.cast_ray(from, up, crown - from.y) {
        let enters = mesh.triangles()[hit.triangle_idx as usize].normal().dot(up) < 0.0;
        if hit.surface.is_solid() && enters && from.y + hit.distance > feet.y - 1.0e-3 {
            return false;
        }
        // The ground itself, something within it, or something to walk through.
        from += up * (hit.distance + 1.0e-3);
        if from.y >= crown {
            break;
        }
    }
    let reach = Vec3::new(profile.radius, 0.0, profile.radius);
    mesh.gather_solids(feet - reach, feet + reach + Vec3::new(0.0, profile.height, 0.0), &mut scratch.triangles);
    deepest_contact(mesh, profile, &scratch.triangles, feet).is_none_or(|contact| contact.depth <= slop)
}
