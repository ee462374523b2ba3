//! How bodies move, for animation.

use crate::abi;
use crate::agents::Sensed;
use crate::checks;
use crate::error::Fault;
use surefoot_world::{Ability, AbilitySet, Action, CharacterProfile, Locomotion, MovePhase, Pace, Steps};

/// Follows a body by one tick, in which it carried out `action` and used the ability with this number.
pub fn advance(
    locomotion: &abi::Locomotion,
    profile: &CharacterProfile,
    sensed: &Sensed<'_>,
    action: Action,
    ability: i32,
) -> Result<abi::Locomotion, Fault> {
    let mut moving = Locomotion::try_from(locomotion)?;
    let ability = checks::ability(ability)?;
    let used: AbilitySet = Some(ability).filter(|ability| *ability != Ability::WALK).into_iter().collect();
    moving.advance(sensed.body(), profile, &action, used);
    Ok(moving.into())
}

impl TryFrom<&abi::Locomotion> for Locomotion {
    type Error = Fault;

    fn try_from(from: &abi::Locomotion) -> Result<Self, Fault> {
        let unknown = |name: &str, value: i32| Fault::argument(format!("locomotion.{name} is {value}: begin with 0"));
        let pace = match from.pace {
            0 => Pace::Idle,
            1 => Pace::Turn,
            2 => Pace::Walk,
            3 => Pace::Run,
            4 => Pace::Stop,
            other => return Err(unknown("pace", other)),
        };
        let phase = match from.phase {
            0 => None,
            1 => Some(MovePhase::Flight),
            2 => Some(MovePhase::Landing),
            other => return Err(unknown("phase", other)),
        };
        let numbers = [from.stride, from.stride_phase, from.step_offset, from.feet_height, from.rise];
        if !numbers.into_iter().all(f32::is_finite) {
            return Err(Fault::argument("a number of locomotion is not finite: begin with 0"));
        }
        Ok(Self {
            pace,
            phase,
            ability: checks::ability(from.ability)?,
            stride_m: from.stride,
            stride_phase: from.stride_phase,
            ticks: from.ticks.min(u8::MAX.into()) as u8,
            was_thrown: from.was_thrown != 0,
            steps: Steps {
                offset_m: from.step_offset,
                feet_m: from.feet_height,
                rise_m: from.rise,
                was_grounded: from.was_grounded != 0,
            },
        })
    }
}

impl From<Locomotion> for abi::Locomotion {
    fn from(from: Locomotion) -> Self {
        let phase = match from.phase {
            // The caller's characters are not rehearsed, so that nothing is known of what they will do.
            None | Some(MovePhase::WindUp) => 0,
            Some(MovePhase::Flight) => 1,
            Some(MovePhase::Landing) => 2,
        };
        Self {
            struct_size: 0,
            pace: from.pace as i32,
            phase,
            ability: u8::from(from.ability).into(),
            stride: from.stride_m,
            stride_phase: from.stride_phase,
            ticks: from.ticks.into(),
            was_thrown: from.was_thrown.into(),
            step_offset: from.steps.offset_m,
            feet_height: from.steps.feet_m,
            rise: from.steps.rise_m,
            was_grounded: from.steps.was_grounded.into(),
        }
    }
}
