//! An environment: a world whose actions the caller chooses, such as a remote trainer. Every NPC always has a goal, and a new
//! episode begins as soon as one ends.

use crate::decision::{DecisionLoop, Lane, Stage};
use crate::goals::{goal_in_band, random_point, random_yaw};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_world::character::{ACTION_LEN, Action, MoveScratch};
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::sense::observation_len;
use surefoot_world::{CharacterProfile, End, Map, TaskConfig, Vec3, World, WorldConfig};

/// Number of places from which starts and goals are drawn.
const PLACES: usize = 1000;
/// Draws for a goal at the wanted distance before the nearest miss is used.
const GOAL_DRAWS: usize = 64;

/// A world that the caller steps, one decision of all NPCs at a time.
#[derive(Debug)]
pub struct Env {
    worlds: [World; 1],
    lanes: Vec<Lane>,
    decisions: DecisionLoop,
    places: Vec<Vec3>,
    /// Wanted distance of goals from their starts, m.
    band: (f32, f32),
    rng: ChaCha8Rng,
    /// Number of values of an observation.
    observation_len: usize,
    observations: Vec<f32>,
    rewards: Vec<f32>,
}

/// An episode that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Ended {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// How the episode ended.
    pub end: End,
    /// Last observation of the episode.
    pub final_observation: Vec<f32>,
}

impl Env {
    /// Spawns `npc_count` NPCs with the body `profile` on `map`, with goals at distances in `band`, m. Solid NPCs get in each other's way and
    /// see each other.
    ///
    /// # Errors
    /// If no place to stand is found on the map.
    pub fn new(
        map: Arc<Map>,
        profile: CharacterProfile,
        (npc_count, solid_npcs): (usize, bool),
        band: (f32, f32),
        seed: u64,
    ) -> Result<Self, NoGround> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut scratch = MoveScratch::default();
        let places = (0..PLACES).map(|_| navigable::sample(&map, &profile, &mut rng, &mut scratch));
        let places = places.collect::<Result<Vec<_>, _>>()?;
        let observation_len = observation_len(solid_npcs);
        let config = WorldConfig::new(profile, TaskConfig::default(), solid_npcs);
        let mut env = Self {
            worlds: [World::with_config(map, config)],
            lanes: Vec::with_capacity(npc_count),
            decisions: DecisionLoop::of_lens(observation_len, 0),
            places,
            band,
            rng,
            observation_len,
            observations: vec![0.0; npc_count * observation_len],
            rewards: vec![0.0; npc_count],
        };
        for npc_idx in 0..npc_count {
            let slot = env.worlds[0].spawn(Vec3::ZERO, 0.0);
            env.lanes.push(Lane::of(slot));
            env.begin(npc_idx);
            env.observe(npc_idx);
        }
        Ok(env)
    }

    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        self.lanes.len()
    }

    /// Current observations of the NPCs, one after another: [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN) values each, or
    /// [`OBSERVATION_WITH_OTHERS_LEN`](surefoot_world::OBSERVATION_WITH_OTHERS_LEN) if NPCs are solid.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Rewards of the last step, one for each NPC.
    pub fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    /// Runs one decision of every NPC and returns the episodes that ended; their NPCs are at a new start.
    ///
    /// # Panics
    /// If the numbers of actions and NPCs differ.
    pub fn step(&mut self, actions: &[Action]) -> Vec<Ended> {
        let Self { worlds, lanes, decisions, .. } = self;
        let outcomes = decisions.advance(&mut Stage { worlds, lanes }, actions).to_vec();
        let mut ended = Vec::new();
        for (npc_idx, outcome) in outcomes.into_iter().enumerate() {
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
        &self.observations[npc_idx * self.observation_len..][..self.observation_len]
    }

    fn observe(&mut self, npc_idx: usize) {
        let row = &mut self.observations[npc_idx * self.observation_len..][..self.observation_len];
        self.worlds[0].observe(self.lanes[npc_idx].slot, row);
    }

    /// Starts an episode of an NPC at a new place with a new goal.
    fn begin(&mut self, npc_idx: usize) {
        let start = random_point(&self.places, &mut self.rng);
        let yaw = random_yaw(&mut self.rng);
        let goal = goal_in_band(&self.places, start, self.band, GOAL_DRAWS, &mut self.rng);
        let (world, slot) = (&mut self.worlds[0], self.lanes[npc_idx].slot);
        world.teleport(slot, start, yaw);
        world.set_goal(slot, goal);
    }
}

/// Converts values to actions, [`ACTION_LEN`] values each.
///
/// # Errors
/// The first action with a value that is not finite; `npc_of` maps the index of an action to the NPC in the message.
pub fn actions_of(values: &[f32], npc_of: impl Fn(usize) -> u64) -> Result<Vec<Action>, String> {
    let rows = values.as_chunks::<ACTION_LEN>().0.iter().enumerate();
    rows.map(|(idx, row)| Action::from_array(*row).map_err(|error| format!("npc {}: {error}", npc_of(idx)))).collect()
}
