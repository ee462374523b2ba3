//! The part of a kinematic character controller that every physics shares: the motion a body wants in a tick, and its
//! velocity afterwards.

use crate::agent::{AgentAction, AgentState, SurefootAgent};
use bevy_ecs::prelude::*;
use bevy_math::{Quat, Vec3};
use bevy_transform::components::Transform;
use surefoot_world::CharacterProfile;

/// Terminal speed of a fall, m/s.
const MAX_FALL_SPEED: f32 = 45.0;

/// Lets the back end move an agent as a kinematic capsule. Its centre is the entity's [`Transform`], and it faces -z as
/// Bevy's cameras do.
#[derive(Component, Debug, Clone, Default)]
#[require(SurefootAgent, Transform)]
pub struct SurefootCharacter {
    /// Velocity, m/s. An app may change it, as a jump pad does.
    pub velocity: Vec3,
    /// Heading, rad: at 0 the body faces +z, at pi/2 it faces +x.
    pub yaw: f32,
    /// Whether the back end leaves the character where it is.
    pub is_halted: bool,
    /// Whether it stands on ground on which it can walk.
    pub is_grounded: bool,
    /// The jump that it made in the last tick.
    pub jump: Option<Jump>,
    air_jumps_left: u8,
    ticks_in_air: u8,
    is_jump_pending: bool,
}

/// A jump.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Jump {
    /// From the ground.
    Ground,
    /// In the air.
    Air,
}

impl SurefootCharacter {
    /// A character at rest.
    pub fn facing(yaw: f32) -> Self {
        Self { yaw, ..Self::default() }
    }

    /// The same character, which the back end leaves where it is.
    #[must_use]
    pub fn halted(self) -> Self {
        Self { is_halted: true, ..self }
    }

    /// The place of its feet, m.
    pub fn feet(transform: &Transform, body: &CharacterProfile) -> Vec3 {
        transform.translation - Vec3::Y * (0.5 * body.height)
    }

    /// Where a character stands whose feet are there, m.
    pub fn standing_at(feet: Vec3, body: &CharacterProfile) -> Transform {
        Transform::from_translation(feet + Vec3::Y * (0.5 * body.height))
    }

    /// What the agent feels of its body.
    pub(crate) fn state(&self, transform: &Transform, body: &CharacterProfile) -> AgentState {
        AgentState {
            feet: Self::feet(transform, body),
            velocity: self.velocity,
            yaw: self.yaw,
            is_grounded: self.is_grounded,
            can_jump: self.is_grounded || self.ticks_in_air <= body.coyote_ticks || self.air_jumps_left > 0,
            ..AgentState::default()
        }
    }

    /// Turns the body, and changes its velocity as the action wants and gravity does.
    pub(crate) fn steer(&mut self, body: &CharacterProfile, wanted: &AgentAction, seconds: f32) {
        let action = &wanted.action;
        self.jump = None;
        if wanted.is_first {
            self.is_jump_pending = action.jump > 0.0;
        }
        self.yaw += action.turn * body.turn_speed * seconds;
        let (sin, cos) = self.yaw.sin_cos();
        let (forward, right) = (action.forward.max(-body.side_speed_share), action.strafe * body.side_speed_share);
        let wish = Vec3::new(sin * forward - cos * right, 0.0, cos * forward + sin * right).clamp_length_max(1.0);
        let limit = if self.is_grounded { body.ground_acceleration } else { body.air_acceleration };
        let change = wish * body.forward_speed - self.velocity.with_y(0.0);
        self.velocity += change.clamp_length_max(limit * seconds);
        self.velocity.y = (self.velocity.y - body.gravity * seconds).max(-MAX_FALL_SPEED);
        if self.is_jump_pending && body.jump_speed > 0.0 {
            self.try_jump(body);
        }
    }

    fn try_jump(&mut self, body: &CharacterProfile) {
        self.jump = if self.is_grounded || self.ticks_in_air <= body.coyote_ticks {
            Some(Jump::Ground)
        } else if self.air_jumps_left > 0 {
            self.air_jumps_left -= 1;
            Some(Jump::Air)
        } else {
            return;
        };
        self.velocity.y = body.jump_speed;
        self.is_grounded = false;
        (self.ticks_in_air, self.is_jump_pending) = (u8::MAX, false);
    }

    /// Records the move, m, that the physics made of a wish, m: walls and ceilings stop a body; steps do not make it
    /// faster.
    pub(crate) fn note_move(
        &mut self,
        body: &CharacterProfile,
        (wish, moved): (Vec3, Vec3),
        touches_ground: bool,
        seconds: f32,
    ) {
        self.is_grounded = touches_ground && self.velocity.y <= 0.0;
        let run = moved.with_y(0.0).clamp_length_max(wish.with_y(0.0).length()) / seconds;
        let is_stopped = self.is_grounded || wish.y > 0.0 && moved.y < 0.5 * wish.y;
        self.velocity = run.with_y(if is_stopped { 0.0 } else { self.velocity.y });
        if self.is_grounded {
            (self.air_jumps_left, self.ticks_in_air) = (body.extra_jumps, 0);
        } else {
            self.ticks_in_air = self.ticks_in_air.saturating_add(1);
        }
    }

    /// Turns an entity as its body is turned.
    pub(crate) fn rotation(&self) -> Quat {
        Quat::from_rotation_y(self.yaw + std::f32::consts::PI)
    }
}
