//! Lets a policy decide for NPCs of a game.

use super::link::{EnvState, GameEnv, GameError};
use surefoot_policy::{HiddenStates, Policy};
use surefoot_rollout::Style;
use surefoot_rollout::env::Route;
use surefoot_rollout::style::{angle, npc_of};
use surefoot_world::float::{heading, horizontal, turned};
use surefoot_world::sense::{FIELDS, OBSERVATION_LEN, STATE_BEGIN, field_idx, hide_transports};
use surefoot_world::{Action, Body, CharacterProfile, Npc, Vec3};

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
    /// The NPC on the map, for styles that steer along places; `None`: as its observation shows it.
    pub npc: Option<Npc>,
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

    /// The last action of an NPC.
    pub fn action(&self, npc_idx: usize) -> Action {
        self.actions[npc_idx]
    }

    /// The policy's memory of an NPC.
    pub fn memory(&self, npc_idx: usize) -> &[f32] {
        let len = self.policy.memory_len();
        &self.hidden.rows()[npc_idx * len..][..len]
    }

    /// The body of the NPCs.
    pub fn profile(&self) -> &'a CharacterProfile {
        self.profile
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
            let npc = deciding.npc.unwrap_or_else(|| npc_of(seen(self.env.state(), deciding.npc_idx)));
            self.actions[deciding.npc_idx] = deciding.style.shape(*action, &npc, self.profile);
        }
        self.env.step(&self.actions, routes)
    }
}

/// The observation of an NPC.
pub fn seen(state: &EnvState, npc_idx: usize) -> &[f32] {
    &state.observations[npc_idx * OBSERVATION_LEN..][..OBSERVATION_LEN]
}

/// Error of a distance or height in an observation, m.
const READING_ERROR_M: f32 = 0.05;
/// Smallest horizontal distance of a goal whose direction shows the heading of an NPC, m.
const BEARING_M: f32 = 0.3;

/// The body that an observation shows, with its feet at `feet`, m: it heads for one of `aims`, m, which shows its
/// heading. If none fits, or that is right above or below, the heading is `yaw`, rad.
pub fn body_at(
    row: &[f32],
    feet: Vec3,
    mut aims: impl Iterator<Item = Vec3>,
    yaw: f32,
    profile: &CharacterProfile,
) -> Body {
    const CAN_JUMP: usize = field_idx("can_jump");
    const FUEL: usize = field_idx("fuel");
    let seen = npc_of(row);
    let goal = seen.episode.map_or(Vec3::ZERO, |episode| episode.goal);
    let fits = |aim: &Vec3| {
        let to = *aim - feet;
        let is_same =
            (to.length() - goal.length()).abs() <= READING_ERROR_M && (to.y - goal.y).abs() <= READING_ERROR_M;
        is_same && horizontal(to) >= BEARING_M
    };
    let yaw = aims.find(fits).map_or(yaw, |aim| heading(aim - feet) - heading(goal));
    let is_grounded = seen.body.is_grounded();
    let mut body = seen.body;
    (body.feet, body.yaw) = (feet, angle(yaw));
    body.velocity = turned(seen.body.velocity, libm::sincosf(yaw));
    body.ticks_in_air = if is_grounded { 0 } else { u8::MAX };
    let can_jump = row[STATE_BEGIN + CAN_JUMP] > 0.5;
    body.air_jumps_left = if is_grounded { profile.extra_jumps } else { profile.extra_jumps.min(can_jump.into()) };
    body.fuel = row[STATE_BEGIN + FUEL] * FIELDS[FUEL].scale;
    body
}
