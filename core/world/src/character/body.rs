//! The state of a body: its position and its motion.

use super::action::Action;
use super::profile::CharacterProfile;
use crate::map::Liquid;
use crate::{TICK_SECONDS, Vec3};
use serde::{Deserialize, Serialize};

/// Limits on the position, m, and the speed, m/s, of a stored body. No pad can throw a body beyond them.
const FARTHEST_M: f32 = 1.0e6;
const FASTEST: f32 = 2.0e4;

/// How a body is supported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Support {
    /// The body is in the air.
    #[default]
    Air,
    /// The body stands on walkable ground.
    Ground,
    /// The body touches only ground that is too steep to stand on.
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
    /// What supports the body.
    pub support: Support,
    /// Liquid that the body wades in; `None` if it is dry.
    pub liquid: Option<Liquid>,
    /// Remaining jumps in the air until the body lands.
    pub air_jumps_left: u8,
    /// Ticks since the body last stood on ground, saturating.
    pub ticks_in_air: u8,
    /// Whether the jump of the current decision is still to be made.
    pub jump_pending: bool,
    /// Ride on a zip line, while the body rides one.
    pub ride: Option<Ride>,
    /// Remaining jetpack thrust, s.
    pub fuel: f32,
    /// Whether the body must step off the disc of a teleporter before it can be teleported again.
    pub teleport_locked: bool,
    /// Horizontal unit vector away from the steep face touched in the last tick.
    pub(super) steep_out: Vec3,
    /// Ticks that are left of a dash.
    pub dash_ticks: u8,
    /// Whether the body has dashed since it last stood.
    pub has_dashed: bool,
    /// Whether the body floats in water.
    pub swims: bool,
    /// Whether the body crouches.
    pub crouches: bool,
    /// Ticks that the body has run along walls since it last stood.
    pub wall_ticks: u16,
    /// Ticks that are left of a slide.
    pub slide_ticks: u16,
    /// Whether the body swims below what reaches into the water.
    pub dives: bool,
    /// Ticks that the body has been under water.
    pub dive_ticks: u16,
    /// A move of its own that the body is making.
    pub own: Option<OwnRun>,
    /// What the body touched in the last tick and can move up along.
    pub(super) hold: Option<Hold>,
    /// Height of the ledge to which the body is pulling itself up, m.
    pub(super) pulls_to: Option<f32>,
}

/// An upright face that a body touches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Hold {
    /// Horizontal unit vector away from the face.
    pub out: Vec3,
    /// Whether the body can climb it.
    pub is_climbed: bool,
}

/// A ride on a zip line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ride {
    /// Index of the zip line on the map.
    pub line_idx: u32,
    /// Distance travelled, m.
    pub distance: f32,
}

/// A move of the body's own, under way.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OwnRun {
    /// Its place in the profile.
    pub idx: u8,
    /// Where it began, m.
    pub from: Vec3,
    /// Where it leads, m.
    pub to: Vec3,
    /// Ticks since it began.
    pub ticks: u16,
    /// Ticks in which something has held the body up.
    pub held_ticks: u8,
}

impl Body {
    /// A body at rest; `feet` is in m, `yaw` in rad.
    pub fn at(feet: Vec3, yaw: f32) -> Self {
        Self { feet, yaw, ..Self::default() }
    }

    /// Whether a stored body satisfies the assumptions of a tick on a map with `zip_line_count` zip lines.
    pub(crate) fn is_sound(&self, zip_line_count: usize) -> bool {
        let is_within = |vector: Vec3, most: f32| vector.abs().max_element() <= most && vector.is_finite();
        is_within(self.feet, FARTHEST_M)
            && is_within(self.velocity, FASTEST)
            && is_within(self.steep_out, 1.0)
            && self.hold.is_none_or(|hold| is_within(hold.out, 1.0))
            && self.pulls_to.is_none_or(f32::is_finite)
            && self.own.is_none_or(|run| is_within(run.from, FARTHEST_M) && is_within(run.to, FARTHEST_M))
            && self.yaw.is_finite()
            && self.ride.is_none_or(|ride| (ride.line_idx as usize) < zip_line_count && ride.distance.is_finite())
    }

    /// Whether the body stands on walkable ground.
    pub fn is_grounded(&self) -> bool {
        self.support == Support::Ground
    }

    /// Whether a zip line or a move of its own takes the body along.
    pub fn is_carried(&self) -> bool {
        self.ride.is_some() || self.own.is_some()
    }

    /// Whether the body has been under water for longer than it can.
    pub fn is_out_of_breath(&self, profile: &CharacterProfile) -> bool {
        profile.dive_seconds > 0.0 && f32::from(self.dive_ticks) * TICK_SECONDS > profile.dive_seconds
    }

    /// Whether the body stands on walkable ground and hardly moves.
    pub fn is_at_rest(&self) -> bool {
        /// m/s.
        const REST_SPEED: f32 = 0.5;
        self.is_grounded() && self.velocity.length_squared() < REST_SPEED * REST_SPEED
    }

    /// Whether the body could jump now.
    pub fn can_jump(&self, profile: &CharacterProfile) -> bool {
        self.is_grounded()
            || self.ticks_in_air <= profile.coyote_ticks
            || self.air_jumps_left > 0
            || self.can_dash(profile)
            || self.wall_ticks > 0 && self.hold.is_some()
    }

    /// Whether a jump in the air would be a dash.
    pub fn can_dash(&self, profile: &CharacterProfile) -> bool {
        profile.dash_speed > 0.0 && !self.has_dashed && self.air_jumps_left == 0
    }

    /// Horizontal unit vector that the body faces.
    pub fn facing(&self) -> Vec3 {
        let (sin, cos) = libm::sincosf(self.yaw);
        Vec3::new(sin, 0.0, cos)
    }

    /// Rotates a vector from the map's frame into the body's frame: x right, y up, z forward.
    pub fn to_local(&self, vector: Vec3) -> Vec3 {
        let (sin, cos) = libm::sincosf(self.yaw);
        Vec3::new(vector.z * sin - vector.x * cos, vector.y, vector.x * sin + vector.z * cos)
    }

    /// Begins a decision. Its jump, if any, is pending until the body has jumped once.
    pub fn begin_decision(&mut self, action: &Action) {
        self.jump_pending = action.jump > 0.0;
    }

    pub(crate) fn leave_ground(&mut self) {
        self.support = Support::Air;
        self.ticks_in_air = u8::MAX;
    }
}
