//! Detects events in an NPC's movement: jumps, landings, rides, deaths.

use super::events::EventKind;
use surefoot_world::{Ability, AbilitySet, Npc, TICKS_PER_SECOND};

/// Least time in the air, in ticks (0.1 s), that counts as a landing if the NPC neither jumped nor used a device; bumps
/// are shorter.
const MIN_AIRBORNE_TICKS: u32 = TICKS_PER_SECOND / 10;

/// An NPC's movement up to the last tick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    airborne_ticks: u32,
    /// Whether the NPC left the ground by a jump or a device.
    was_thrown: bool,
    /// Downward speed at the last tick, m/s.
    falling_speed: f32,
    is_thrusting: bool,
    is_down: bool,
}

impl Motion {
    /// Compares an NPC with its previous state, and emits the events of the tick; `attempt` is the current attempt.
    pub fn note(&mut self, npc: &Npc, used: AbilitySet, attempt: Option<u32>, mut emit: impl FnMut(EventKind)) {
        let position = npc.body.feet;
        for ability in used.iter() {
            match ability {
                Ability::Jump | Ability::DoubleJump => emit(EventKind::Jumped { ability, position }),
                Ability::Jetpack if self.is_thrusting => {}
                _ => emit(EventKind::Rode { ability, position }),
            }
        }
        if npc.body.is_grounded() {
            if self.was_thrown || self.airborne_ticks >= MIN_AIRBORNE_TICKS {
                emit(EventKind::Landed { position, impact_speed: self.falling_speed.max(0.0) });
            }
            (self.airborne_ticks, self.was_thrown) = (0, false);
        } else {
            self.airborne_ticks = self.airborne_ticks.saturating_add(1);
            self.was_thrown |= used.iter().any(|ability| ability != Ability::Teleporter);
        }
        if let (Some(cause), false) = (npc.harm, self.is_down) {
            emit(EventKind::Died { cause, attempt, position });
        }
        self.falling_speed = -npc.body.velocity.y;
        self.is_thrusting = used.contains(Ability::Jetpack);
        self.is_down = npc.harm.is_some();
    }
}
