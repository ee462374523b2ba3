//! The decision loop: observe, act, ten ticks, close. All code that steps NPCs by a policy or by given actions uses
//! this loop.

use crate::style::Style;
use rand::rngs::ChaCha8Rng;
use surefoot_policy::{HiddenStates, Policy, noise};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense;
use surefoot_world::{Action, DecisionOutcome, NpcSlot, TICKS_PER_DECISION, World};

/// Default share of the exploration noise with which evaluation, probes and workers act;
/// docs/adr/0026-composed-motion.md says why it is not 0.
pub const DEFAULT_NOISE_SHARE: f32 = 0.5;

/// An NPC that decides, and the row of its hidden state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecidingNpc {
    /// Index of the world in [`DecisionBatch::worlds`].
    pub world_idx: usize,
    /// Slot of the NPC in that world.
    pub slot: NpcSlot,
    /// Row of the NPC's hidden state.
    pub row_idx: usize,
    /// How the NPC carries out the policy's action.
    pub style: Style,
}

impl DecidingNpc {
    /// An NPC of the only world; its row is its slot.
    pub fn of(slot: NpcSlot) -> Self {
        Self { world_idx: 0, slot, row_idx: slot.0 as usize, style: Style::Free }
    }

    /// The same NPC in another style.
    pub fn in_style(self, style: Style) -> Self {
        Self { style, ..self }
    }
}

/// Worlds, and the NPCs in them that decide together.
#[derive(Debug)]
pub struct DecisionBatch<'a> {
    /// Worlds, all of which are stepped.
    pub worlds: &'a mut [World],
    /// NPCs that decide; all others keep their action.
    pub npcs: &'a [DecidingNpc],
}

/// Noise that is added to the policy's mean actions, in units of the policy's standard deviation.
#[derive(Debug)]
pub enum Noise<'a> {
    /// This share of the policy's exploration noise, drawn from one generator for all NPCs in order.
    Shared(f32, &'a mut ChaCha8Rng),
    /// One row of [`ACTION_LEN`](surefoot_world::character::ACTION_LEN) values for each NPC.
    Rows(Vec<f32>),
}

/// The decision loop: buffers that are reused from decision to decision, and the hidden states of all NPCs.
#[derive(Debug)]
pub struct DecisionLoop {
    /// Number of values of an observation.
    observation_len: usize,
    senses_transports: bool,
    observations: Vec<f32>,
    actions: Vec<Action>,
    outcomes: Vec<DecisionOutcome>,
    hidden: HiddenStates,
}

impl DecisionLoop {
    /// Creates a loop for policies whose observations and hidden state have the same lengths as those of `policy`.
    pub fn new(policy: &Policy) -> Self {
        let senses_transports = policy.senses_transports();
        Self { senses_transports, ..Self::of_lens(policy.observation_len(), policy.memory_len()) }
    }

    /// Creates a loop for observations of `observation_len` values and hidden states of `hidden_len`; 0 for policies
    /// without a hidden state.
    pub fn of_lens(observation_len: usize, hidden_len: usize) -> Self {
        let hidden = HiddenStates::of_len(hidden_len);
        let (observations, actions, outcomes) = Default::default();
        Self { observation_len, senses_transports: true, observations, actions, outcomes, hidden }
    }

    /// Clears the hidden state in a row, as at the start of an episode.
    pub fn begin(&mut self, row_idx: usize) {
        self.hidden.forget(row_idx);
    }

    /// All hidden states, row by row.
    pub fn hidden(&self) -> &[f32] {
        self.hidden.rows()
    }

    /// Restores hidden states that [`hidden`](Self::hidden) returned.
    pub fn set_hidden(&mut self, rows: Vec<f32>) {
        self.hidden.set_rows(rows);
    }

    /// Last observations of the NPCs, one after another.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Last actions of the NPCs, in their order.
    pub fn actions(&self) -> &[Action] {
        &self.actions
    }

    /// Runs one whole decision of all NPCs and returns the outcome of each NPC, in order.
    pub fn decide(&mut self, batch: &mut DecisionBatch<'_>, policy: &Policy, noise: Noise<'_>) -> &[DecisionOutcome] {
        self.choose(batch, policy, noise);
        let actions = std::mem::take(&mut self.actions);
        self.advance(batch, &actions);
        self.actions = actions;
        &self.outcomes
    }

    /// Same as [`decide`](Self::decide), but calls `each_tick` with the worlds after each tick.
    pub fn decide_watched(
        &mut self,
        batch: &mut DecisionBatch<'_>,
        policy: &Policy,
        noise: Noise<'_>,
        mut each_tick: impl FnMut(&[World]),
    ) -> &[DecisionOutcome] {
        self.choose(batch, policy, noise);
        let actions = std::mem::take(&mut self.actions);
        begin(batch, &actions);
        for _ in 0..TICKS_PER_DECISION {
            batch.worlds.iter_mut().for_each(World::tick);
            each_tick(batch.worlds);
        }
        self.actions = actions;
        self.close(batch)
    }

    /// The first two phases, and the style of each NPC.
    fn choose(&mut self, batch: &DecisionBatch<'_>, policy: &Policy, noise: Noise<'_>) {
        let needs_policy = |npc: &DecidingNpc| npc.style.needs(policy);
        if batch.npcs.iter().all(needs_policy) {
            self.observe(batch.worlds, batch.npcs);
            self.act(batch.npcs, policy, noise);
        } else {
            self.act_where(needs_policy, batch, policy, noise);
        }
        for (deciding, action) in batch.npcs.iter().zip(&mut self.actions) {
            let world = &batch.worlds[deciding.world_idx];
            let npc = world.npc(deciding.slot).expect("an NPC that decides");
            *action = deciding.style.shape(*action, npc, world.profile_of(npc));
        }
    }

    /// The first two phases for some of the NPCs; the actions of the others stay at rest.
    fn act_where(
        &mut self,
        needs_policy: impl Fn(&DecidingNpc) -> bool,
        batch: &DecisionBatch<'_>,
        policy: &Policy,
        noise: Noise<'_>,
    ) {
        let some: Vec<DecidingNpc> = batch.npcs.iter().copied().filter(&needs_policy).collect();
        let noise = match noise {
            Noise::Shared(share, rng) => Noise::Shared(share, rng),
            Noise::Rows(rows) => {
                let rows = batch.npcs.iter().zip(rows.chunks_exact(ACTION_LEN));
                Noise::Rows(rows.filter(|(npc, _)| needs_policy(npc)).flat_map(|(_, row)| row).copied().collect())
            }
        };
        self.observe(batch.worlds, &some);
        self.act(&some, policy, noise);
        let mut chosen = std::mem::take(&mut self.actions).into_iter();
        let action = |npc| if needs_policy(npc) { chosen.next() } else { None };
        self.actions = batch.npcs.iter().map(action).map(Option::unwrap_or_default).collect();
    }

    /// The first phase: writes the observation of every NPC.
    pub fn observe(&mut self, worlds: &[World], npcs: &[DecidingNpc]) {
        self.observations.resize(npcs.len() * self.observation_len, 0.0);
        for (npc, row) in npcs.iter().zip(self.observations.chunks_exact_mut(self.observation_len)) {
            worlds[npc.world_idx].observe(npc.slot, row);
            if !self.senses_transports {
                sense::hide_transports(row);
            }
        }
    }

    /// The second phase: computes the action of every NPC from its observation.
    pub fn act(&mut self, npcs: &[DecidingNpc], policy: &Policy, noise: Noise<'_>) {
        let rows = npcs.iter().map(|npc| npc.row_idx);
        let noise = match noise {
            Noise::Shared(share, rng) => noise::for_rows(rng, share, npcs.len()),
            Noise::Rows(values) => values,
        };
        let Self { observations, actions, hidden, .. } = self;
        hidden.act(policy, rows, observations, &noise, actions);
    }

    /// The third phase: holds one action for each NPC during ten ticks of all worlds, then closes the decision.
    ///
    /// # Panics
    /// If an NPC has no episode, or the numbers of actions and NPCs differ.
    pub fn advance(&mut self, batch: &mut DecisionBatch<'_>, actions: &[Action]) -> &[DecisionOutcome] {
        begin(batch, actions);
        batch.worlds.iter_mut().for_each(World::tick_decision);
        self.close(batch)
    }

    fn close(&mut self, DecisionBatch { worlds, npcs }: &mut DecisionBatch<'_>) -> &[DecisionOutcome] {
        self.outcomes.clear();
        self.outcomes
            .extend(npcs.iter().map(|npc| {
                worlds[npc.world_idx].close_decision(npc.slot).expect("an NPC that decides has an episode")
            }));
        &self.outcomes
    }
}

/// Starts the decision of every NPC.
fn begin(DecisionBatch { worlds, npcs }: &mut DecisionBatch<'_>, actions: &[Action]) {
    assert_eq!(actions.len(), npcs.len(), "one action for each NPC");
    for (npc, action) in npcs.iter().zip(actions) {
        worlds[npc.world_idx].decide(npc.slot, *action);
    }
}
