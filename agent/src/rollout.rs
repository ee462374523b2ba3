//! Rolls a policy out towards many goals at once, straight or by plan: what validation and evaluation share.

use crate::follow::{Fault, FollowConfig, Follower, Step};
use rand::rngs::ChaCha8Rng;
use rand::{Rng, RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;
use surefoot_planner::Router;
use surefoot_policy::{Memories, Policy};
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// How it ended.
    pub end: End,
    /// Decisions taken.
    pub decisions: u32,
    /// Plans asked for beyond the first.
    pub replans: u32,
    /// Distance covered, from decision to decision, m.
    pub length: f32,
    /// What it was doing when it failed, by plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<Fault>,
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

    /// One attempt for each goal, in the order of the goals, each heading straight for it.
    pub fn run(&self, policy: &Policy, goals: &[Goal]) -> Vec<Attempt> {
        goals.chunks(BATCH).flat_map(|chunk| self.run_batch(policy, None, chunk, &mut Vec::new())).collect()
    }

    /// One attempt for each goal, each following plans of `router`; the duration of every search is noted in
    /// `search_us`.
    pub fn run_by_plan(
        &self,
        policy: &Policy,
        router: &Router,
        goals: &[Goal],
        search_us: &mut Vec<f64>,
    ) -> Vec<Attempt> {
        goals.chunks(BATCH).flat_map(|chunk| self.run_batch(policy, Some(router), chunk, search_us)).collect()
    }

    fn run_batch(
        &self,
        policy: &Policy,
        router: Option<&Router>,
        goals: &[Goal],
        search_us: &mut Vec<f64>,
    ) -> Vec<Attempt> {
        let mut world = World::new(self.map.clone(), self.profile.clone(), self.task.clone());
        for goal in goals {
            let slot = world.spawn(goal.start, goal.yaw);
            world.set_goal(slot, goal.goal);
        }
        let mut decisions = vec![0; goals.len()];
        let mut lengths = vec![0.0; goals.len()];
        let mut places: Vec<Vec3> = goals.iter().map(|goal| goal.start).collect();
        let mut followers: Vec<Option<Follower>> = goals
            .iter()
            .map(|goal| {
                let router = router?;
                let mut follower =
                    Follower::new(goal.goal, FollowConfig { patience: self.give_up_after, ..FollowConfig::default() });
                plan(&mut follower, router, goal.start, search_us);
                Some(follower)
            })
            .collect();
        for (idx, follower) in followers.iter().enumerate() {
            if let Some(waypoint) = follower.as_ref().and_then(Follower::waypoint) {
                world.set_goal(NpcSlot(idx as u32), waypoint);
            }
        }
        let mut attempts: Vec<Option<Attempt>> = vec![None; goals.len()];
        let mut running: Vec<NpcSlot> = (0..goals.len()).map(|idx| NpcSlot(idx as u32)).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let (mut observations, mut actions) = (Vec::new(), Vec::new());
        let mut memories = Memories::new(policy);
        (0..goals.len()).for_each(|idx| memories.forget(idx));
        while !running.is_empty() {
            observations.resize(running.len() * OBSERVATION_LEN, 0.0);
            for (slot, row) in running.iter().zip(observations.chunks_exact_mut(OBSERVATION_LEN)) {
                world.observe(*slot, row);
            }
            let who = running.iter().map(|slot| slot.0 as usize);
            memories.act(policy, who, &observations, self.noise_share, &mut rng, &mut actions);
            for (slot, action) in running.iter().zip(&actions) {
                world.decide(*slot, *action);
            }
            world.tick_decision();
            running.retain(|&slot| {
                let outcome = world.close_decision(slot).expect("an episode in every slot");
                let npc = world.npc(slot).expect("an NPC in every slot");
                let (feet, episode) = (npc.body.feet, npc.episode.expect("an episode in every slot"));
                let idx = slot.0 as usize;
                decisions[idx] += 1;
                lengths[idx] += std::mem::replace(&mut places[idx], feet).distance(feet);
                let end = match (&mut followers[idx], router) {
                    (Some(follower), Some(router)) => {
                        follow(&mut world, slot, follower, router, outcome.end, search_us)
                    }
                    _ => outcome.end.or((episode.stalled_decisions >= self.give_up_after).then_some(End::NoProgress)),
                };
                let Some(end) = end else { return true };
                let follower = followers[idx].as_ref();
                attempts[idx] = Some(Attempt {
                    end,
                    decisions: decisions[idx],
                    replans: follower.map_or(0, Follower::replans),
                    length: lengths[idx],
                    fault: follower.filter(|_| end != End::Reached).map(|f| f.fault(!end.is_truncation())),
                });
                world.despawn(slot);
                false
            });
        }
        attempts.into_iter().map(|attempt| attempt.expect("every attempt ends")).collect()
    }
}

/// Settles one decision of an NPC that follows a plan: how its attempt ended, if it did.
///
/// `leg_end` is how the decision ended the episode towards the current waypoint, if it did.
///
/// # Panics
/// If the slot is empty.
pub fn follow(
    world: &mut World,
    slot: NpcSlot,
    follower: &mut Follower,
    router: &Router,
    leg_end: Option<End>,
    search_us: &mut Vec<f64>,
) -> Option<End> {
    let feet = world.npc(slot).expect("a running NPC").body.feet;
    let waypoint_reached = leg_end == Some(End::Reached);
    if waypoint_reached && follower.is_last_leg() {
        return leg_end;
    }
    if let Some(end) = leg_end.filter(|end| !end.is_truncation() && *end != End::Reached) {
        return Some(end);
    }
    match follower.note(feet, waypoint_reached) {
        Step::Keep => {}
        Step::Head(waypoint) => world.set_goal(slot, waypoint),
        Step::Plan => {
            let waypoint = plan(follower, router, feet, search_us);
            world.set_goal(slot, waypoint);
        }
        Step::GiveUp => return Some(End::NoProgress),
    }
    None
}

/// Plans from `feet`: the first waypoint. The duration of the search is noted in `search_us`.
pub fn plan(follower: &mut Follower, router: &Router, feet: Vec3, search_us: &mut Vec<f64>) -> Vec3 {
    let query = follower.query(feet);
    let started = Instant::now();
    let plan = router.find_path(&query);
    search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
    follower.take_plan(plan)
}
