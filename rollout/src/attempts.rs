//! Runs whole episodes towards many goals at once, straight or by plan, for validation, evaluation and pictures.

use crate::decision::{DEFAULT_NOISE_SHARE, DecisionLoop, Lane, Noise, Stage};
use crate::follow::{Fault, FollowConfig, Follower, Step};
use crate::goals::Goal;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;
use surefoot_planner::Router;
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, DecisionOutcome, End, Map, NpcSlot, TaskConfig, Vec3, World};

/// Most NPCs of one batch.
const BATCH: usize = 256;

/// Result of one attempt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// How the attempt ended.
    pub end: End,
    /// Number of decisions.
    pub decisions: u32,
    /// Number of re-plans.
    pub replans: u32,
    /// Length of the path from decision to decision, m.
    pub length: f32,
    /// Chance of arriving that the first plan gave; `None` without a plan that leads to the goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub promised: Option<f32>,
    /// Why the attempt failed; `None` if it succeeded or did not follow a plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<Fault>,
}

/// Runs attempts on one map.
#[derive(Debug)]
pub struct Rollout {
    map: Arc<Map>,
    profile: CharacterProfile,
    task: TaskConfig,
    /// Decisions without progress after which an attempt ends early with [`End::NoProgress`].
    pub give_up_after: u32,
    /// Share of the policy's exploration noise with which NPCs act, 0 or more.
    pub noise_share: f32,
    /// Seed of the noise.
    pub seed: u64,
}

/// Positions of the feet of one NPC, m: the start, then the position after each decision.
pub type Track = Vec<Vec3>;

impl Rollout {
    /// Prepares attempts on `map` with the default noise; attempts end early at the patience of `task`.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig) -> Self {
        Self { map, profile, give_up_after: task.patience, task, noise_share: DEFAULT_NOISE_SHARE, seed: 0 }
    }

    /// Runs one attempt for each goal, heading straight for the goal, and returns the attempts in the order of the goals.
    pub fn run(&self, policy: &Policy, goals: &[Goal]) -> Vec<Attempt> {
        goals.chunks(BATCH).flat_map(|chunk| self.run_batch(policy, None, chunk, &mut Vec::new()).0).collect()
    }

    /// Runs one attempt for each goal, following plans of `router`, and appends the duration of every search, us, to
    /// `search_us`.
    pub fn run_by_plan(
        &self,
        policy: &Policy,
        router: &Router,
        goals: &[Goal],
        search_us: &mut Vec<f64>,
    ) -> Vec<Attempt> {
        goals.chunks(BATCH).flat_map(|chunk| self.run_batch(policy, Some(router), chunk, search_us).0).collect()
    }

    /// Same as [`run_by_plan`](Self::run_by_plan), but returns the track of each attempt and no durations.
    pub fn track_by_plan(&self, policy: &Policy, router: &Router, goals: &[Goal]) -> Vec<(Attempt, Track)> {
        let run = |chunk| {
            let (attempts, tracks) = self.run_batch(policy, Some(router), chunk, &mut Vec::new());
            attempts.into_iter().zip(tracks)
        };
        goals.chunks(BATCH).flat_map(run).collect()
    }

    fn run_batch(
        &self,
        policy: &Policy,
        router: Option<&Router>,
        goals: &[Goal],
        search_us: &mut Vec<f64>,
    ) -> (Vec<Attempt>, Vec<Track>) {
        let mut worlds = [World::new(self.map.clone(), self.profile.clone(), self.task.clone())];
        let mut decisions = DecisionLoop::new(policy);
        let mut walkers: Vec<Walker> = goals
            .iter()
            .map(|goal| Walker::start(&mut worlds[0], goal, router.map(|_| self.follow_config())))
            .collect();
        for walker in &mut walkers {
            decisions.begin(walker.lane.row_idx);
            if let (Some(follower), Some(router)) = (&mut walker.follower, router) {
                let waypoint = plan(follower, router, walker.track[0], search_us);
                worlds[0].set_goal(walker.lane.slot, waypoint);
                walker.promised = follower.promised();
            }
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut lanes: Vec<Lane> = walkers.iter().map(|walker| walker.lane).collect();
        while !lanes.is_empty() {
            let mut stage = Stage { worlds: &mut worlds, lanes: &lanes };
            let closed = decisions.decide(&mut stage, policy, Noise::Shared(self.noise_share, &mut rng));
            let mut closed = closed.iter();
            let [world] = &mut worlds;
            lanes.retain(|lane| {
                let outcome = *closed.next().expect("an outcome for each lane");
                let walker = &mut walkers[lane.slot.0 as usize];
                let Some(end) = self.settle(world, walker, router, outcome, search_us) else { return true };
                walker.end = Some(end);
                world.despawn(lane.slot);
                false
            });
        }
        walkers.into_iter().map(Walker::finish).unzip()
    }

    fn follow_config(&self) -> FollowConfig {
        FollowConfig { patience: self.give_up_after, ..FollowConfig::default() }
    }

    /// Processes one decision of one NPC and returns how the attempt ended, if it did.
    fn settle(
        &self,
        world: &mut World,
        walker: &mut Walker,
        router: Option<&Router>,
        outcome: DecisionOutcome,
        search_us: &mut Vec<f64>,
    ) -> Option<End> {
        let npc = world.npc(walker.lane.slot).expect("an NPC in every slot");
        let stalled = npc.episode.expect("an episode in every slot").stalled_decisions;
        walker.track.push(npc.body.feet);
        match (&mut walker.follower, router) {
            (Some(follower), Some(router)) => follow(world, walker.lane.slot, follower, router, outcome.end, search_us),
            _ => outcome.end.or((stalled >= self.give_up_after).then_some(End::NoProgress)),
        }
    }
}

/// One NPC with its running attempt.
struct Walker {
    lane: Lane,
    follower: Option<Follower>,
    promised: Option<f32>,
    track: Track,
    end: Option<End>,
}

impl Walker {
    /// Spawns an NPC that follows plans with the configuration `by_plan`, or heads straight for the goal without one.
    fn start(world: &mut World, goal: &Goal, by_plan: Option<FollowConfig>) -> Self {
        let slot = world.spawn(goal.start, goal.yaw);
        world.set_goal(slot, goal.goal);
        let follower = by_plan.map(|config| Follower::new(goal.goal, config));
        Self { lane: Lane::of(slot), follower, promised: None, track: vec![goal.start], end: None }
    }

    fn finish(self) -> (Attempt, Track) {
        let end = self.end.expect("every attempt ends");
        let failed = self.follower.as_ref().filter(|_| end != End::Reached);
        let attempt = Attempt {
            end,
            decisions: self.track.len() as u32 - 1,
            promised: self.promised,
            replans: self.follower.as_ref().map_or(0, Follower::replans),
            length: self.track.windows(2).fold(0.0, |length, step| length + step[0].distance(step[1])),
            fault: failed.map(|follower| follower.fault(end.is_harm())),
        };
        (attempt, self.track)
    }
}

/// Processes one decision of an NPC that follows a plan and returns how the attempt ended, if it did.
///
/// `leg_end` is the end of the episode towards the current waypoint, if the episode ended.
fn follow(
    world: &mut World,
    slot: NpcSlot,
    follower: &mut Follower,
    router: &Router,
    leg_end: Option<End>,
    search_us: &mut Vec<f64>,
) -> Option<End> {
    let feet = world.npc(slot).expect("a running NPC").body.feet;
    let waypoint_reached = leg_end == Some(End::Reached);
    if waypoint_reached && follower.is_last_leg() && !follower.is_second_best() {
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
        Step::Unreachable => return Some(End::Unreachable),
    }
    None
}

/// Plans from `feet` and returns the first waypoint; appends the duration of the search, us, to `search_us`.
fn plan(follower: &mut Follower, router: &Router, feet: Vec3, search_us: &mut Vec<f64>) -> Vec3 {
    let query = follower.query(feet);
    let started = Instant::now();
    let plan = router.find_path(&query);
    search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
    follower.take_plan(plan)
}
