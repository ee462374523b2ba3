//! An environment: a world whose actions the caller chooses, such as a remote trainer, or somebody whose agent is scored.

use crate::decision::{DecisionLoop, Lane, Stage};
use crate::goals::{Goal, goal_in_band, random_point, random_yaw};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_world::character::{ACTION_LEN, Action, MoveScratch};
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::sense::observation_len;
use surefoot_world::{CharacterProfile, End, Map, NpcSlot, TaskConfig, Vec3, World, WorldConfig};

/// Number of places from which starts and goals are drawn.
const PLACES: usize = 1000;
/// Draws for a goal at the wanted distance before the nearest miss is used.
const GOAL_DRAWS: usize = 64;

/// The episodes of an environment.
#[derive(Debug, Clone, PartialEq)]
pub enum Episodes {
    /// Every NPC always has a goal, and a new episode begins as soon as one ends.
    Endless {
        /// Number of NPCs.
        npc_count: usize,
        /// Wanted distance of goals from their starts, m.
        band: (f32, f32),
        /// Seed of starts and goals.
        seed: u64,
    },
    /// One NPC for each of these, and one episode for each NPC, which rests when it has ended.
    Once(Vec<Goal>),
}

impl Episodes {
    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        match self {
            Self::Endless { npc_count, .. } => *npc_count,
            Self::Once(goals) => goals.len(),
        }
    }
}

/// A world that the caller steps, one decision of all NPCs at a time.
#[derive(Debug)]
pub struct Env {
    worlds: [World; 1],
    lanes: Vec<Lane>,
    decisions: DecisionLoop,
    draw: Option<Draw>,
    /// Whether each NPC rests, since its only episode has ended.
    rests: Vec<bool>,
    /// Number of values of an observation.
    observation_len: usize,
    observations: Vec<f32>,
    rewards: Vec<f32>,
}

/// Where endless episodes come from.
#[derive(Debug)]
struct Draw {
    places: Vec<Vec3>,
    /// Wanted distance of goals from their starts, m.
    band: (f32, f32),
    rng: ChaCha8Rng,
}

impl Draw {
    fn new(map: &Map, profile: &CharacterProfile, band: (f32, f32), seed: u64) -> Result<Self, NoGround> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut scratch = MoveScratch::default();
        let places = (0..PLACES).map(|_| navigable::sample(map, profile, &mut rng, &mut scratch));
        Ok(Self { places: places.collect::<Result<Vec<_>, _>>()?, band, rng })
    }

    fn goal(&mut self) -> Goal {
        let Self { places, band, rng } = self;
        let start = random_point(places, rng);
        let yaw = random_yaw(rng);
        Goal { start, yaw, goal: goal_in_band(places, start, *band, GOAL_DRAWS, rng) }
    }
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
    /// Spawns NPCs with the body `profile` on `map` for these episodes. Solid NPCs get in each other's way and see each other.
    ///
    /// # Errors
    /// If no place to stand is found on the map for endless episodes.
    pub fn new(
        map: Arc<Map>,
        profile: CharacterProfile,
        solid_npcs: bool,
        episodes: Episodes,
    ) -> Result<Self, NoGround> {
        let npc_count = episodes.npc_count();
        let (mut draw, goals) = match episodes {
            Episodes::Endless { band, seed, .. } => (Some(Draw::new(&map, &profile, band, seed)?), Vec::new()),
            Episodes::Once(goals) => (None, goals),
        };
        let observation_len = observation_len(solid_npcs);
        let config = WorldConfig::new(profile, TaskConfig::default(), solid_npcs);
        let mut worlds = [World::with_config(map, config)];
        let mut lanes = Vec::with_capacity(npc_count);
        for npc_idx in 0..npc_count {
            let slot = worlds[0].spawn(Vec3::ZERO, 0.0);
            lanes.push(Lane::of(slot));
            let goal = draw.as_mut().map_or_else(|| goals[npc_idx], Draw::goal);
            begin(&mut worlds[0], slot, &goal);
        }
        let mut env = Self {
            worlds,
            lanes,
            decisions: DecisionLoop::of_lens(observation_len, 0),
            draw,
            rests: vec![false; npc_count],
            observation_len,
            observations: vec![0.0; npc_count * observation_len],
            rewards: vec![0.0; npc_count],
        };
        (0..npc_count).for_each(|npc_idx| env.observe(npc_idx));
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

    /// Runs one decision of every NPC and returns the episodes that ended. With endless episodes their NPCs are at a new start; others rest
    /// from then on, whatever their actions are.
    ///
    /// # Panics
    /// If the numbers of actions and NPCs differ.
    pub fn step(&mut self, actions: &[Action]) -> Vec<Ended> {
        assert_eq!(actions.len(), self.lanes.len(), "one action for each NPC");
        let awake: Vec<usize> = (0..self.lanes.len()).filter(|npc_idx| !self.rests[*npc_idx]).collect();
        let lanes: Vec<Lane> = awake.iter().map(|npc_idx| self.lanes[*npc_idx]).collect();
        let actions: Vec<Action> = awake.iter().map(|npc_idx| actions[*npc_idx]).collect();
        let mut stage = Stage { worlds: &mut self.worlds, lanes: &lanes };
        let outcomes = self.decisions.advance(&mut stage, &actions).to_vec();
        let mut ended = Vec::new();
        self.rewards.fill(0.0);
        for (npc_idx, outcome) in awake.into_iter().zip(outcomes) {
            self.rewards[npc_idx] = outcome.reward;
            self.observe(npc_idx);
            let Some(end) = outcome.end else { continue };
            ended.push(Ended { npc_idx, end, final_observation: self.row(npc_idx).to_vec() });
            let (world, slot) = (&mut self.worlds[0], self.lanes[npc_idx].slot);
            match &mut self.draw {
                Some(draw) => {
                    begin(world, slot, &draw.goal());
                    self.observe(npc_idx);
                }
                None => {
                    world.clear_goal(slot);
                    self.rests[npc_idx] = true;
                }
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
}

/// Starts an episode of an NPC.
fn begin(world: &mut World, slot: NpcSlot, &Goal { start, yaw, goal }: &Goal) {
    world.teleport(slot, start, yaw);
    world.set_goal(slot, goal);
}

/// Converts values to actions, [`ACTION_LEN`] values each.
///
/// # Errors
/// The first action with a value that is not finite; `npc_of` maps the index of an action to the NPC in the message.
pub fn actions_of(values: &[f32], npc_of: impl Fn(usize) -> u64) -> Result<Vec<Action>, String> {
    let rows = values.as_chunks::<ACTION_LEN>().0.iter().enumerate();
    rows.map(|(idx, row)| Action::from_array(*row).map_err(|error| format!("npc {}: {error}", npc_of(idx)))).collect()
}
