//! Rolls a policy out towards many goals at once, without a graph: what validation and evaluation share.

use rand::rngs::ChaCha8Rng;
use rand::{Rng, RngExt, SeedableRng};
use std::ops::Range;
use std::sync::Arc;
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World};

/// Share of the exploration noise that evaluation and workers act with unless told otherwise.
pub const DEFAULT_NOISE_SHARE: f32 = 0.5;
/// NPCs that share one batch.
const BATCH: usize = 256;

/// One start and goal, both navigable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Where the feet start, m.
    pub start: Vec3,
    /// Heading at the start, rad.
    pub yaw: f32,
    /// Where they should be, m.
    pub goal: Vec3,
}

impl Goal {
    /// Straight-line distance, m.
    pub fn distance(&self) -> f32 {
        self.start.distance(self.goal)
    }

    /// Draws up to `count` pairs of `points` whose distance lies in `band`.
    pub fn draw(points: &[Vec3], band: Range<f32>, count: usize, rng: &mut impl Rng) -> Vec<Goal> {
        let mut goals = Vec::with_capacity(count);
        for _ in 0..count * 2000 {
            if goals.len() == count {
                break;
            }
            let start = points[rng.random_range(0..points.len())];
            let goal = points[rng.random_range(0..points.len())];
            if band.contains(&start.distance(goal)) {
                let yaw = rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
                goals.push(Goal { start, yaw, goal });
            }
        }
        goals
    }
}

/// How one attempt went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attempt {
    /// How it ended.
    pub end: End,
    /// Decisions taken.
    pub decisions: u32,
}

/// Runs attempts on one map.
#[derive(Debug)]
pub struct Rollout {
    map: Arc<Map>,
    profile: CharacterProfile,
    task: TaskConfig,
    /// Decisions without progress after which an attempt is called [`End::NoProgress`] early.
    pub give_up_after: u32,
    /// Share of the policy's exploration noise to act with.
    pub noise_share: f32,
    /// Seed of that noise.
    pub seed: u64,
}

impl Rollout {
    /// Attempts on `map` under `task`.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig) -> Self {
        Self { map, profile, give_up_after: task.patience, task, noise_share: DEFAULT_NOISE_SHARE, seed: 0 }
    }

    /// One attempt for each goal, in the order of the goals.
    pub fn run(&self, policy: &Policy, goals: &[Goal]) -> Vec<Attempt> {
        goals.chunks(BATCH).flat_map(|chunk| self.run_batch(policy, chunk)).collect()
    }

    fn run_batch(&self, policy: &Policy, goals: &[Goal]) -> Vec<Attempt> {
        let mut world = World::new(self.map.clone(), self.profile.clone(), self.task.clone());
        for goal in goals {
            let slot = world.spawn(goal.start, goal.yaw);
            world.set_goal(slot, goal.goal);
        }
        let mut attempts: Vec<Option<Attempt>> = vec![None; goals.len()];
        let mut running: Vec<NpcSlot> = (0..goals.len()).map(|idx| NpcSlot(idx as u32)).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let (mut observations, mut actions) = (Vec::new(), Vec::new());
        while !running.is_empty() {
            observations.resize(running.len() * OBSERVATION_LEN, 0.0);
            for (slot, row) in running.iter().zip(observations.chunks_exact_mut(OBSERVATION_LEN)) {
                world.observe(*slot, row);
            }
            policy.act(&observations, self.noise_share, &mut rng, &mut actions);
            for (slot, action) in running.iter().zip(&actions) {
                world.decide(*slot, *action);
            }
            world.tick_decision();
            running.retain(|&slot| {
                let outcome = world.close_decision(slot).expect("an episode in every slot");
                let episode = world.npc(slot).and_then(|npc| npc.episode).expect("an episode in every slot");
                let gave_up = (episode.stalled_decisions >= self.give_up_after).then_some(End::NoProgress);
                let Some(end) = outcome.end.or(gave_up) else { return true };
                attempts[slot.0 as usize] = Some(Attempt { end, decisions: episode.decisions });
                world.despawn(slot);
                false
            });
        }
        attempts.into_iter().map(|attempt| attempt.expect("every attempt ends")).collect()
    }
}
