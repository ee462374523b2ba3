//! The decision loop: observe, act, ten ticks, close. All code that steps NPCs by a policy or by given actions uses this loop.

use crate::style::Style;
use rand::rngs::ChaCha8Rng;
use surefoot_policy::{HiddenStates, Policy};
use surefoot_world::sense;
use surefoot_world::{Action, DecisionOutcome, NpcSlot, TICKS_PER_DECISION, World};

/// Default share of the exploration noise with which evaluation, probes and workers act;
/// docs/adr/0004-acting-with-half-the-noise.md says why it is not 0.
pub const DEFAULT_NOISE_SHARE: f32 = 0.5;

/// An NPC that decides, and the row of its hidden state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lane {
    /// Index of the world in [`Stage::worlds`].
    pub world_idx: usize,
    /// Slot of the NPC in that world.
    pub slot: NpcSlot,
    /// Row of the NPC's hidden state.
    pub row_idx: usize,
    /// How the NPC carries out what the policy wants.
    pub style: Style,
}

impl Lane {
    /// The lane of an NPC if there is only one world; the row is the slot.
    pub fn of(slot: NpcSlot) -> Self {
        Self { world_idx: 0, slot, row_idx: slot.0 as usize, style: Style::Free }
    }

    /// The same lane in another style.
    pub fn in_style(self, style: Style) -> Self {
        Self { style, ..self }
    }
}

/// Worlds, and the NPCs in them that decide together.
#[derive(Debug)]
pub struct Stage<'a> {
    /// Worlds; every one is stepped.
    pub worlds: &'a mut [World],
    /// NPCs that decide; all others keep their action.
    pub lanes: &'a [Lane],
}

/// Noise that is added to the policy's mean actions, in units of the policy's standard deviation.
#[derive(Debug)]
pub enum Noise<'a> {
    /// This share of the policy's exploration noise, drawn from one generator for all lanes in order.
    Shared(f32, &'a mut ChaCha8Rng),
    /// One row of [`ACTION_LEN`](surefoot_world::character::ACTION_LEN) values for each lane.
    Rows(Vec<f32>),
}

/// The decision loop: buffers that are reused from decision to decision, and the hidden states of all lanes.
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

    /// Creates a loop for observations of `observation_len` values and hidden states of `hidden_len`; 0 for policies without a hidden state.
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

    /// Last observations of the lanes, one after another.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Last actions of the lanes, in their order.
    pub fn actions(&self) -> &[Action] {
        &self.actions
    }

    /// Runs one whole decision of all lanes and returns the outcome of each lane, in order.
    pub fn decide(&mut self, stage: &mut Stage<'_>, policy: &Policy, noise: Noise<'_>) -> &[DecisionOutcome] {
        self.choose(stage, policy, noise);
        let actions = std::mem::take(&mut self.actions);
        self.advance(stage, &actions);
        self.actions = actions;
        &self.outcomes
    }

    /// Same as [`decide`](Self::decide), but calls `each_tick` with the worlds after each tick.
    pub fn decide_watched(
        &mut self,
        stage: &mut Stage<'_>,
        policy: &Policy,
        noise: Noise<'_>,
        mut each_tick: impl FnMut(&[World]),
    ) -> &[DecisionOutcome] {
        self.choose(stage, policy, noise);
        let actions = std::mem::take(&mut self.actions);
        begin(stage, &actions);
        for _ in 0..TICKS_PER_DECISION {
            stage.worlds.iter_mut().for_each(World::tick);
            each_tick(stage.worlds);
        }
        self.actions = actions;
        self.close(stage)
    }

    /// The first two phases, and the style of each lane.
    fn choose(&mut self, stage: &Stage<'_>, policy: &Policy, noise: Noise<'_>) {
        self.observe(stage.worlds, stage.lanes);
        self.act(stage.lanes, policy, noise);
        for (lane, action) in stage.lanes.iter().zip(&mut self.actions) {
            let world = &stage.worlds[lane.world_idx];
            let npc = world.npc(lane.slot).expect("an NPC that decides");
            *action = lane.style.shape(*action, npc, world.profile_of(npc));
        }
    }

    /// The first phase: writes the observation of every lane.
    pub fn observe(&mut self, worlds: &[World], lanes: &[Lane]) {
        self.observations.resize(lanes.len() * self.observation_len, 0.0);
        for (lane, row) in lanes.iter().zip(self.observations.chunks_exact_mut(self.observation_len)) {
            worlds[lane.world_idx].observe(lane.slot, row);
            if !self.senses_transports {
                sense::hide_transports(row);
            }
        }
    }

    /// The second phase: computes the action of every lane from its observation.
    pub fn act(&mut self, lanes: &[Lane], policy: &Policy, noise: Noise<'_>) {
        let rows = lanes.iter().map(|lane| lane.row_idx);
        let Self { observations, actions, hidden, .. } = self;
        match noise {
            Noise::Shared(share, rng) => hidden.act(policy, rows, observations, share, rng, actions),
            Noise::Rows(values) => hidden.act_with_noise(policy, rows, observations, values, actions),
        }
    }

    /// The third phase: holds one action for each lane during ten ticks of all worlds, then closes the decision.
    ///
    /// # Panics
    /// If the NPC of a lane has no episode, or the numbers of actions and lanes differ.
    pub fn advance(&mut self, stage: &mut Stage<'_>, actions: &[Action]) -> &[DecisionOutcome] {
        begin(stage, actions);
        stage.worlds.iter_mut().for_each(World::tick_decision);
        self.close(stage)
    }

    fn close(&mut self, Stage { worlds, lanes }: &mut Stage<'_>) -> &[DecisionOutcome] {
        self.outcomes.clear();
        self.outcomes.extend(
            lanes.iter().map(|lane| {
                worlds[lane.world_idx].close_decision(lane.slot).expect("an NPC that decides has an episode")
            }),
        );
        &self.outcomes
    }
}

/// Starts the decision of every lane.
fn begin(Stage { worlds, lanes }: &mut Stage<'_>, actions: &[Action]) {
    assert_eq!(actions.len(), lanes.len(), "one action for each lane");
    for (lane, action) in lanes.iter().zip(actions) {
        worlds[lane.world_idx].decide(lane.slot, *action);
    }
}
