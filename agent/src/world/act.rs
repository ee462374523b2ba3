//! The policy's actions for a batch of NPCs.

use super::batch::Batch;
use super::{WorldError, WorldTask};
use crate::inference::{Decided, Rows};
use surefoot_rollout::Style;
use surefoot_world::{Action, MoverState, Npc as State};

impl WorldTask {
    /// The observations of these NPCs of a batch, by index, which see their new waypoints. The task observes them if
    /// the server did not.
    fn observations(&mut self, batch: &Batch, movers: &[MoverState], deciding: &[usize]) -> Vec<f32> {
        let len = self.policy.observation_len();
        let mut rows = if batch.observations.is_empty() {
            let states = deciding.iter().filter_map(|idx| batch.sightings[*idx].state).collect::<Vec<_>>();
            self.ground.observe(&states, movers)
        } else {
            deciding.iter().flat_map(|idx| &batch.observations[idx * len..][..len]).copied().collect()
        };
        for (idx, row) in deciding.iter().zip(rows.chunks_exact_mut(len)) {
            let seen = &batch.sightings[*idx];
            let waypoint = self.npcs.get(&seen.id).and_then(|npc| npc.news.waypoint);
            if let Some((state, waypoint)) = seen.state.as_ref().zip(waypoint) {
                self.ground.aim_at(state, waypoint, row);
            }
        }
        rows
    }

    /// Evaluates the policy for the NPCs of a batch on another thread, and returns their actions. NPCs that neither the
    /// server nor the task can observe stand still.
    pub(super) async fn act(&mut self, batch: &Batch, movers: &[MoverState]) -> Result<Vec<Action>, WorldError> {
        let (mut memory, mut noise, mut styles, mut deciding) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (idx, seen) in batch.sightings.iter().enumerate() {
            let npc = self.npcs.get_mut(&seen.id).expect("seen in this batch");
            // An NPC whose state is unknown moves freely.
            let known = seen.state.as_ref().zip(self.ground.map().zip(self.ground.body()));
            let style = known.map_or(Style::Free, |(state, (map, body))| npc.attempt.style(map, body, &state.body));
            let draw = npc.noise.draw(style);
            let is_seen = known.is_some() || !batch.observations.is_empty();
            npc.hold.holds |= !is_seen;
            let is_idle = npc.hold.holds && self.policy.memory_len() == 0;
            if style.needs(&self.policy) && is_seen && !is_idle {
                deciding.push(idx);
                memory.extend_from_slice(&npc.memory);
                noise.extend(draw);
            }
            styles.push(style);
        }
        let observations = self.observations(batch, movers, &deciding);
        let Decided { actions, memory } = if observations.is_empty() {
            Decided::default()
        } else {
            self.inference.decide(Rows { observations, memory, noise }).await.ok_or(WorldError::Inference)?
        };
        let chosen = actions;
        let mut actions = vec![Action::default(); styles.len()];
        deciding.iter().zip(chosen).for_each(|(idx, action)| actions[*idx] = action);
        let body = self.ground.body().cloned().unwrap_or_default();
        let shape = |action: Action, style: Style, state: &Option<State>| {
            state.as_ref().map_or(action, |state| style.shape(action, state, &body))
        };
        for ((seen, style), action) in batch.sightings.iter().zip(styles).zip(&mut actions) {
            let holds = self.npcs.get(&seen.id).is_some_and(|npc| npc.hold.holds);
            *action = if holds { Action::default() } else { shape(*action, style, &seen.state) };
        }
        for (idx, row) in deciding.iter().zip(memory.chunks_exact(self.policy.memory_len().max(1))) {
            let npc = self.npcs.get_mut(&batch.sightings[*idx].id).expect("seen in this batch");
            npc.memory.copy_from_slice(row);
        }
        Ok(actions)
    }
}
