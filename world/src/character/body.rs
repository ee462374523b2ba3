//! Where a body is, how it moves, and what happened to it.

use super::action::Action;
use super::profile::CharacterProfile;
use crate::Vec3;
use crate::map::Liquid;
use serde::{Deserialize, Serialize};

/// No body is further from the origin, m, or faster, m/s: even pads cannot throw it so.
const FARTHEST_M: f32 = 1.0e6;
const FASTEST: f32 = 2.0e4;

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
    pub(super) steep_out: Vec3,
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

    pub(crate) fn leave_ground(&mut self) {
        self.support = Support::Air;
        self.ticks_in_air = u8::MAX;
    }
}
