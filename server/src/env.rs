//! A world that a remote trainer steps itself: every NPC always has a goal, and a new episode begins where one ends.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_world::character::{ACTION_LEN, Action, MoveScratch};
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World};

/// Places that starts and goals are drawn from.
const PLACES: usize = 1000;
/// Draws for a goal in the wanted band until the nearest miss is taken.
const GOAL_DRAWS: usize = 64;

/// An environment.
#[derive(Debug)]
pub struct Env {
    world: World,
    slots: Vec<NpcSlot>,
    places: Vec<Vec3>,
    /// Wanted distances of goals, m.
    band: (f32, f32),
    rng: ChaCha8Rng,
    observations: Vec<f32>,
    rewards: Vec<f32>,
}

/// An episode that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Ended {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// How.
    pub end: End,
    /// What it observed last.
    pub final_observation: Vec<f32>,
}

impl Env {
    /// Puts `npc_count` NPCs on `map`, with goals `band` metres away.
    ///
    /// # Errors
    /// If the map has nowhere to stand.
    pub fn new(map: Arc<Map>, npc_count: usize, band: (f32, f32), seed: u64) -> Result<Self, NoGround> {
        let profile = CharacterProfile::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut scratch = MoveScratch::default();
        let places = (0..PLACES).map(|_| navigable::sample(&map, &profile, &mut rng, &mut scratch));
        let places = places.collect::<Result<Vec<_>, _>>()?;
        let mut env = Self {
            world: World::new(map, profile, TaskConfig::default()),
            slots: Vec::with_capacity(npc_count),
            places,
            band,
            rng,
            observations: vec![0.0; npc_count * OBSERVATION_LEN],
            rewards: vec![0.0; npc_count],
        };
        for npc_idx in 0..npc_count {
            let slot = env.world.spawn(Vec3::ZERO, 0.0);
            env.slots.push(slot);
            env.begin(npc_idx);
            env.observe(npc_idx);
        }
        Ok(env)
    }

    /// NPCs in it.
    pub fn npc_count(&self) -> usize {
        self.slots.len()
    }

    /// What the NPCs observe, [`OBSERVATION_LEN`] values each.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Rewards of the last step.
    pub fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    /// One decision of every NPC; returns the episodes that ended. NPCs whose episode ended stand at a new start.
    ///
    /// # Panics
    /// If there is not one action for each NPC.
    pub fn step(&mut self, actions: &[Action]) -> Vec<Ended> {
        assert_eq!(actions.len(), self.slots.len(), "one action for each NPC");
        for (&slot, &action) in self.slots.iter().zip(actions) {
            self.world.decide(slot, action);
        }
        self.world.tick_decision();
        let mut ended = Vec::new();
        for npc_idx in 0..self.slots.len() {
            let outcome = self.world.close_decision(self.slots[npc_idx]).expect("every NPC has an episode");
            self.rewards[npc_idx] = outcome.reward;
            self.observe(npc_idx);
            if let Some(end) = outcome.end {
                let final_observation = self.row(npc_idx).to_vec();
                ended.push(Ended { npc_idx, end, final_observation });
                self.begin(npc_idx);
                self.observe(npc_idx);
            }
        }
        ended
    }

    fn row(&self, npc_idx: usize) -> &[f32] {
        &self.observations[npc_idx * OBSERVATION_LEN..][..OBSERVATION_LEN]
    }

    fn observe(&mut self, npc_idx: usize) {
        let row = &mut self.observations[npc_idx * OBSERVATION_LEN..][..OBSERVATION_LEN];
        self.world.observe(self.slots[npc_idx], row);
    }

    /// Starts an episode: a new place, a new goal.
    fn begin(&mut self, npc_idx: usize) {
        let place = |rng: &mut ChaCha8Rng, places: &[Vec3]| places[rng.random_range(0..places.len())];
        let start = place(&mut self.rng, &self.places);
        let yaw = self.rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
        let miss = |goal: Vec3| {
            let distance = start.distance(goal);
            (self.band.0 - distance).max(distance - self.band.1).max(0.0)
        };
        let mut goal = place(&mut self.rng, &self.places);
        for _ in 1..GOAL_DRAWS {
            if miss(goal) == 0.0 {
                break;
            }
            let other = place(&mut self.rng, &self.places);
            goal = if miss(other) < miss(goal) { other } else { goal };
        }
        self.world.teleport(self.slots[npc_idx], start, yaw);
        self.world.set_goal(self.slots[npc_idx], goal);
    }
}

/// Actions from values, [`ACTION_LEN`] each.
///
/// # Errors
/// What is wrong with an action, and whose it is: `npc_of` names the NPC of each.
pub fn actions_of(values: &[f32], npc_of: impl Fn(usize) -> u64) -> Result<Vec<Action>, String> {
    let rows = values.as_chunks::<ACTION_LEN>().0.iter().enumerate();
    rows.map(|(idx, row)| Action::from_array(*row).map_err(|error| format!("npc {}: {error}", npc_of(idx)))).collect()
}
