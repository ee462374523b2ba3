//! Lets a policy decide for NPCs of a game.

use super::link::{EnvState, GameEnv, GameError};
use surefoot_policy::{HiddenStates, Policy};
use surefoot_rollout::Style;
use surefoot_rollout::env::Route;
use surefoot_rollout::style::npc_of;
use surefoot_world::sense::{OBSERVATION_LEN, hide_transports};
use surefoot_world::{Action, CharacterProfile};

/// An environment of a game, whose NPCs a policy moves.
#[derive(Debug)]
pub struct Drive<'a> {
    env: GameEnv,
    policy: &'a Policy,
    profile: &'a CharacterProfile,
    hidden: HiddenStates,
    observations: Vec<f32>,
    decided: Vec<Action>,
    actions: Vec<Action>,
}

/// An NPC that decides.
#[derive(Debug, Clone, Copy)]
pub struct Deciding {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// How it carries out the actions of the policy.
    pub style: Style,
}

impl<'a> Drive<'a> {
    /// Takes over the NPCs of `env`, whose body is `profile`.
    pub fn new(env: GameEnv, policy: &'a Policy, profile: &'a CharacterProfile) -> Self {
        let mut hidden = HiddenStates::new(policy);
        (0..env.npc_count()).for_each(|npc_idx| hidden.forget(npc_idx));
        let actions = vec![Action::default(); env.npc_count()];
        Self { env, policy, profile, hidden, observations: Vec::new(), decided: Vec::new(), actions }
    }

    /// The last state of the environment.
    pub fn state(&self) -> &EnvState {
        self.env.state()
    }

    /// Clears the policy's memory of an NPC.
    pub fn forget(&mut self, npc_idx: usize) {
        self.hidden.forget(npc_idx);
    }

    /// Runs one decision: these NPCs carry out the policy's actions, with `noise` in units of its standard deviation;
    /// all others rest. The routes begin after it.
    ///
    /// # Errors
    /// Same as [`GameEnv::step`].
    ///
    /// # Panics
    /// If the numbers of NPCs and rows of `noise` differ.
    pub fn decide(&mut self, npcs: &[Deciding], noise: Vec<f32>, routes: &[Route]) -> Result<&EnvState, GameError> {
        let len = self.policy.observation_len();
        self.observations.clear();
        self.observations.resize(npcs.len() * len, 0.0);
        for (deciding, row) in npcs.iter().zip(self.observations.chunks_exact_mut(len)) {
            // Values about other NPCs stay zeros: NPCs do not meet.
            row[..OBSERVATION_LEN].copy_from_slice(seen(self.env.state(), deciding.npc_idx));
            if !self.policy.senses_transports() {
                hide_transports(row);
            }
        }
        let rows = npcs.iter().map(|deciding| deciding.npc_idx);
        self.hidden.act(self.policy, rows, &self.observations, &noise, &mut self.decided);
        self.actions.fill(Action::default());
        for (deciding, action) in npcs.iter().zip(&self.decided) {
            let npc = npc_of(seen(self.env.state(), deciding.npc_idx));
            self.actions[deciding.npc_idx] = deciding.style.shape(*action, &npc, self.profile);
        }
        self.env.step(&self.actions, routes)
    }
}

/// The observation of an NPC.
pub fn seen(state: &EnvState, npc_idx: usize) -> &[f32] {
    &state.observations[npc_idx * OBSERVATION_LEN..][..OBSERVATION_LEN]
}
