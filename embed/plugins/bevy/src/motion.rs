//! How agents move, for their animation.

use crate::agent::{AgentAction, AgentState, SurefootAgent};
use crate::character::{Jump, SurefootCharacter};
use crate::mind::body_of;
use bevy_ecs::prelude::*;
use bevy_time::{Fixed, Time};
use bevy_transform::components::Transform;
use surefoot_world::{Ability, AbilitySet, Locomotion, TICKS_PER_SECOND};

/// Share of a tick by which a fixed step may be shorter than 1/60 s and still count as a tick: steps are whole
/// nanoseconds.
const ROUNDING: f32 = 1.0e-3;

/// How an agent moves. It follows the body at the end of each fixed step, after physics.
#[derive(Component, Debug, Clone, Default)]
pub struct AgentLocomotion {
    /// Pace, phase of a leap, stride, and the height to add to what is drawn over steps.
    pub now: Locomotion,
    /// Abilities that the agent has used since the last step. A [`SurefootCharacter`] adds its jumps. What an app does
    /// to a body itself, such as the throw of a pad, it adds here; the plugin takes it.
    pub used: AbilitySet,
    /// Time since the last tick of 1/60 s, in ticks.
    ticks: f32,
}

type Agents<'w, 's> = Query<
    'w,
    's,
    (
        &'static SurefootAgent,
        &'static AgentState,
        &'static AgentAction,
        Option<(&'static SurefootCharacter, &'static Transform)>,
        &'static mut AgentLocomotion,
    ),
>;

/// Follows all agents by one fixed step.
pub(crate) fn follow(mut agents: Agents<'_, '_>, time: Res<'_, Time<Fixed>>) {
    let ticks = time.timestep().as_secs_f32() * TICKS_PER_SECOND as f32;
    for (settings, sensed, action, character, mut moving) in &mut agents {
        let state = character.map_or(*sensed, |(character, transform)| character.state(transform, &settings.body));
        if state.is_finite() {
            let moved = character.filter(|(character, _)| !character.is_halted);
            let jump = moved.and_then(|(character, _)| character.jump);
            if let Some(jump) = jump {
                moving.used.insert(if jump == Jump::Ground { Ability::JUMP } else { Ability::DOUBLE_JUMP });
            }
            moving.follow(settings, &state, action, ticks);
        }
    }
}

impl AgentLocomotion {
    /// Follows a body for `ticks` of 1/60 s. What is left of a tick counts with the next step.
    fn follow(&mut self, settings: &SurefootAgent, state: &AgentState, action: &AgentAction, ticks: f32) {
        self.ticks += ticks;
        while self.ticks >= 1.0 - ROUNDING {
            self.ticks -= 1.0;
            let used = std::mem::take(&mut self.used);
            self.now.advance(&body_of(state), &settings.body, &action.action, used);
        }
    }
}
