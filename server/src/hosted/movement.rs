//! How NPCs move and what is predicted of them, for animation.

use super::snapshot::Movement;
use super::world::NpcRecord;
use surefoot_world::{Npc, TICKS_PER_DECISION, Tick, Trajectory};

/// Ticks after which a prediction is replaced, or is too old.
pub(super) const PREDICTION_TICKS: u64 = TICKS_PER_DECISION as u64;

impl NpcRecord {
    /// How `npc` moves at `tick`.
    pub fn movement(&self, npc: &Npc, tick: Tick) -> Movement {
        let predicted = self.prediction.filter(|(made, _)| tick.since(*made) <= PREDICTION_TICKS);
        let prediction = predicted.or_else(|| self.rest_at(npc, tick));
        let winds_up = prediction.and_then(|(made, trajectory)| trajectory.winds_up_for(tick.since(made)));
        let locomotion = self.motion.locomotion;
        Movement { locomotion: winds_up.map_or(locomotion, |ability| locomotion.winding_up(ability)), prediction }
    }

    /// The prediction for an NPC that rests until something happens.
    fn rest_at(&self, npc: &Npc, tick: Tick) -> Option<(Tick, Trajectory)> {
        let decides = self.goal.is_some() && !self.is_at_target && !self.awaits_group;
        let rests = !decides && self.turns_to.is_none() && (npc.harm.is_some() || npc.body.is_at_rest());
        // Readers of changes need not hear of it at every tick.
        let made = Tick(tick.0 - tick.0 % PREDICTION_TICKS);
        rests.then(|| (made, Trajectory::at_rest(&npc.body)))
    }
}
