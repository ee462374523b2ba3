//! The policy's actions for a batch of NPCs.

use super::batch::Batch;
use super::{WorldError, WorldTask};
use crate::inference::{Decided, Rows};
use surefoot_rollout::Style;
use surefoot_world::{Action, Npc as State};

impl WorldTask {
    /// Lets NPCs that have a new waypoint see it in this decision.
    pub(super) fn show_new_waypoints(&self, batch: &mut Batch) {
        let rows = batch.observations.chunks_exact_mut(self.policy.observation_len());
        for (seen, row) in batch.sightings.iter().zip(rows) {
            let waypoint = self.npcs.get(&seen.id).and_then(|npc| npc.news.waypoint);
            if let Some((state, waypoint)) = seen.state.as_ref().zip(waypoint) {
                self.ground.aim_at(state, waypoint, row);
            }
        }
    }

    /// Evaluates the policy for the NPCs of a batch on another thread, and returns their actions.
    pub(super) async fn act(&mut self, batch: &Batch) -> Result<Vec<Action>, WorldError> {
        let (mut memory, mut noise, mut styles) = (Vec::new(), Vec::new(), Vec::new());
        let mut observations = Vec::with_capacity(batch.observations.len());
        let rows = batch.observations.chunks_exact(self.policy.observation_len());
        for (seen, row) in batch.sightings.iter().zip(rows) {
            let npc = self.npcs.get_mut(&seen.id).expect("seen in this batch");
            // An NPC whose state is unknown moves freely.
            let known = seen.state.as_ref().zip(self.ground.map().zip(self.ground.body()));
            let style = known.map_or(Style::Free, |(state, (map, body))| npc.attempt.style(map, body, &state.body));
            let draw = npc.noise.draw(style);
            if style.needs(&self.policy) {
                observations.extend_from_slice(row);
                memory.extend_from_slice(&npc.memory);
                noise.extend(draw);
            }
            styles.push(style);
        }
        let Decided { actions, memory } = if observations.is_empty() {
            Decided::default()
        } else {
            self.inference.decide(Rows { observations, memory, noise }).await.ok_or(WorldError::Inference)?
        };
        let mut chosen = actions.into_iter();
        let action = |style: &Style| if style.needs(&self.policy) { chosen.next() } else { None };
        let mut actions: Vec<Action> = styles.iter().map(action).map(Option::unwrap_or_default).collect();
        let body = self.ground.body().cloned().unwrap_or_default();
        let shape = |action: Action, style: Style, state: &Option<State>| {
            state.as_ref().map_or(action, |state| style.shape(action, state, &body))
        };
        for ((seen, style), action) in batch.sightings.iter().zip(styles).zip(&mut actions) {
            let holds = self.npcs.get(&seen.id).is_some_and(|npc| npc.hold.holds);
            *action = if holds { Action::default() } else { shape(*action, style, &seen.state) };
        }
        for (seen, row) in batch.sightings.iter().zip(memory.chunks_exact(self.policy.memory_len().max(1))) {
            self.npcs.get_mut(&seen.id).expect("seen in this batch").memory.copy_from_slice(row);
        }
        Ok(actions)
    }
}
