//! The decision loop: observe, act, ten ticks, close. Whoever steps an NPC by a policy, or by somebody else's actions, steps it
//! here.

use rand::rngs::ChaCha8Rng;
use surefoot_policy::{Memories, Policy};
use surefoot_world::{Action, DecisionOutcome, NpcSlot, OBSERVATION_LEN, TICKS_PER_DECISION, World};

/// Share of the exploration noise that evaluation, probes and workers act with unless told otherwise; why it is not 0 is in
/// docs/adr/0004-acting-with-half-the-noise.md.
pub const DEFAULT_NOISE_SHARE: f32 = 0.5;

/// An NPC that decides, and where its hidden state is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lane {
    /// Index of its world.
    pub world_idx: usize,
    /// Its place in that world.
    pub slot: NpcSlot,
    /// Row of its hidden state.
    pub row_idx: usize,
}

impl Lane {
    /// An NPC of the only world.
    pub fn of(slot: NpcSlot) -> Self {
        Self { world_idx: 0, slot, row_idx: slot.0 as usize }
    }
}

/// Worlds, and the NPCs of them that decide together.
#[derive(Debug)]
pub struct Stage<'a> {
    /// All of them are stepped.
    pub worlds: &'a mut [World],
    /// Who decides; every other NPC keeps its action.
    pub lanes: &'a [Lane],
}

/// What is added to the policy's mean actions, in units of its own standard deviation.
#[derive(Debug)]
pub enum Noise<'a> {
    /// This share of the policy's exploration noise, drawn for all lanes from one generator in their order.
    Shared(f32, &'a mut ChaCha8Rng),
    /// One row of [`ACTION_LEN`](surefoot_world::character::ACTION_LEN) values for each lane.
    Rows(Vec<f32>),
}

/// The loop's buffers, reused from decision to decision, and the hidden states of all lanes.
#[derive(Debug)]
pub struct DecisionLoop {
    observations: Vec<f32>,
    actions: Vec<Action>,
    outcomes: Vec<DecisionOutcome>,
    hidden: Memories,
}

impl DecisionLoop {
    /// A loop for NPCs that act by policies with as long a hidden state as `policy`'s.
    pub fn new(policy: &Policy) -> Self {
        Self::with_hidden_len(policy.memory_len())
    }

    /// A loop for hidden states of so many values; 0 for policies without one.
    pub fn with_hidden_len(hidden_len: usize) -> Self {
        let hidden = Memories::of_len(hidden_len);
        Self { observations: Vec::new(), actions: Vec::new(), outcomes: Vec::new(), hidden }
    }

    /// Lets a lane start from an empty hidden state, as at the start of an episode.
    pub fn begin(&mut self, row_idx: usize) {
        self.hidden.forget(row_idx);
    }

    /// All hidden states, row by row.
    pub fn hidden(&self) -> &[f32] {
        self.hidden.rows()
    }

    /// Puts back hidden states that [`hidden`](Self::hidden) gave.
    pub fn set_hidden(&mut self, rows: Vec<f32>) {
        self.hidden.set_rows(rows);
    }

    /// What the lanes observed last, [`OBSERVATION_LEN`] values each.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// What the lanes chose last.
    pub fn actions(&self) -> &[Action] {
        &self.actions
    }

    /// One whole decision of all lanes; what it came to for each, in their order.
    pub fn decide(&mut self, stage: &mut Stage<'_>, policy: &Policy, noise: Noise<'_>) -> &[DecisionOutcome] {
        self.decide_watched(stage, policy, noise, |_| {})
    }

    /// The same, with a look at the worlds after each tick.
    pub fn decide_watched(
        &mut self,
        stage: &mut Stage<'_>,
        policy: &Policy,
        noise: Noise<'_>,
        each_tick: impl FnMut(&[World]),
    ) -> &[DecisionOutcome] {
        self.observe(stage.worlds, stage.lanes);
        self.act(stage.lanes, policy, noise);
        let actions = std::mem::take(&mut self.actions);
        self.advance(stage, &actions, each_tick);
        self.actions = actions;
        &self.outcomes
    }

    /// The first phase: every lane's observation.
    pub fn observe(&mut self, worlds: &[World], lanes: &[Lane]) {
        self.observations.resize(lanes.len() * OBSERVATION_LEN, 0.0);
        for (lane, row) in lanes.iter().zip(self.observations.chunks_exact_mut(OBSERVATION_LEN)) {
            worlds[lane.world_idx].observe(lane.slot, row);
        }
    }

    /// The second phase: every lane's action on what it has just observed.
    pub fn act(&mut self, lanes: &[Lane], policy: &Policy, noise: Noise<'_>) {
        let rows = lanes.iter().map(|lane| lane.row_idx);
        let Self { observations, actions, hidden, .. } = self;
        match noise {
            Noise::Shared(share, rng) => hidden.act(policy, rows, observations, share, rng, actions),
            Noise::Rows(values) => hidden.act_with_noise(policy, rows, observations, values, actions),
        }
    }

    /// The third phase: one action for each lane is taken and held for ten ticks of all worlds, then the decision is closed.
    ///
    /// # Panics
    /// If a lane's NPC has no episode, or there is not one action for each lane.
    pub fn advance(
        &mut self,
        stage: &mut Stage<'_>,
        actions: &[Action],
        mut each_tick: impl FnMut(&[World]),
    ) -> &[DecisionOutcome] {
        let Stage { worlds, lanes } = stage;
        assert_eq!(actions.len(), lanes.len(), "one action for each lane");
        for (lane, action) in lanes.iter().zip(actions) {
            worlds[lane.world_idx].decide(lane.slot, *action);
        }
        for _ in 0..TICKS_PER_DECISION {
            worlds.iter_mut().for_each(World::tick);
            each_tick(worlds);
        }
        self.outcomes.clear();
        self.outcomes.extend(
            lanes.iter().map(|lane| {
                worlds[lane.world_idx].close_decision(lane.slot).expect("an NPC that decides has an episode")
            }),
        );
        &self.outcomes
    }
}
