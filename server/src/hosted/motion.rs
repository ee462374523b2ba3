//! Detects events in an NPC's movement: jumps, landings, rides, deaths.

use super::events::EventKind;
use surefoot_world::{Ability, AbilitySet, CharacterProfile, Locomotion, Npc};

/// An NPC's movement up to the last tick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    /// How it moves, for animation.
    pub locomotion: Locomotion,
    /// Downward speed at the last tick, m/s.
    falling_speed: f32,
    is_thrusting: bool,
    is_down: bool,
}

impl Motion {
    /// Compares an NPC with its previous state, and emits the events of the tick; `attempt` is the current attempt.
    pub fn note(
        &mut self,
        (npc, profile): (&Npc, &CharacterProfile),
        used: AbilitySet,
        attempt: Option<u32>,
        mut emit: impl FnMut(EventKind),
    ) {
        let position = npc.body.feet;
        for ability in used.iter() {
            match ability {
                Ability::JUMP | Ability::DOUBLE_JUMP => emit(EventKind::Jumped { ability, position }),
                Ability::JETPACK if self.is_thrusting => {}
                _ => emit(EventKind::Rode { ability, position }),
            }
        }
        self.locomotion.advance(&npc.body, profile, &npc.action, used);
        if self.locomotion.has_landed() {
            emit(EventKind::Landed { position, impact_speed: self.falling_speed.max(0.0) });
        }
        if let (Some(cause), false) = (npc.harm, self.is_down) {
            emit(EventKind::Died { cause, attempt, position });
        }
        self.falling_speed = -npc.body.velocity.y;
        self.is_thrusting = used.contains(Ability::JETPACK);
        self.is_down = npc.harm.is_some();
        if self.is_down {
            self.locomotion = Locomotion::default();
        }
    }
}
