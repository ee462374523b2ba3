//! Runs many attempts at once in this process, straight or by plan, for validation, evaluation and pictures.

mod chase;
mod guide;

pub use chase::{Chase, Chased};

use self::guide::Guide;
use crate::attempt::Attempt;
use crate::decision::{DEFAULT_NOISE_SHARE, DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use crate::follow::{Fault, FollowConfig, Follower};
use crate::goals::Goal;
use crate::motion::{Motion, Trace};
use crate::rehearse::{NoiseStream, Rehearsal};
use crate::style::Style;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use surefoot_planner::{Router, Traffic};
use surefoot_policy::Policy;
use surefoot_world::{Action, CharacterProfile, DecisionOutcome, End, Map, TaskConfig, Vec3, World, WorldConfig};

/// Most NPCs of one batch.
const BATCH: usize = 256;

/// Result of one attempt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AttemptResult {
    /// How the attempt ended.
    pub end: End,
    /// Number of decisions.
    pub decisions: u32,
    /// Number of re-plans.
    pub replans: u32,
    /// Length of the path from decision to decision, m.
    pub length: f32,
    /// Number of plans that were taken: 1 if the first plan went through.
    #[serde(default)]
    pub plans: u32,
    /// Chance of arriving as planned that the first plan gave; `None` without a plan that leads to the goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub promised: Option<f32>,
    /// Chance of arriving, re-plans included, that the first plan gave.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub promised_arrival: Option<f32>,
    /// Why the attempt failed; `None` if it succeeded or did not follow a plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<Fault>,
}

impl AttemptResult {
    /// An attempt without plans.
    pub fn without_plans(end: End, decisions: u32, length: f32) -> Self {
        let (promised, promised_arrival, fault) = Default::default();
        Self { end, decisions, replans: 0, length, plans: 0, promised, promised_arrival, fault }
    }
}

/// Measures one attempt while it runs.
#[derive(Debug)]
pub struct Measured {
    /// Position of the feet at the last decision, m.
    pub feet: Vec3,
    /// How the attempt ended, once it has.
    pub end: Option<End>,
    decisions: u32,
    length: f32,
    /// Chances of arriving as planned, and with re-plans, that the first plan gave.
    promised: Option<(f32, f32)>,
}

impl Measured {
    /// Begins at `start`, m.
    pub fn begin(start: Vec3) -> Self {
        Self { feet: start, end: None, decisions: 0, length: 0.0, promised: None }
    }

    /// Records the chances that the first plan gives.
    pub fn record_first_plan(&mut self, follower: &Follower) {
        self.promised = follower.promised();
    }

    /// Records where a decision led, m.
    pub fn record_decision(&mut self, feet: Vec3) {
        self.decisions += 1;
        self.length += self.feet.distance(feet);
        self.feet = feet;
    }

    /// The result of an attempt that has ended.
    ///
    /// # Panics
    /// If it has not.
    pub fn result(&self, follower: Option<&Follower>) -> AttemptResult {
        let end = self.end.expect("every attempt ends");
        let failed = follower.filter(|_| end != End::Reached);
        AttemptResult {
            replans: follower.map_or(0, Follower::replans),
            plans: follower.map_or(0, Follower::plans),
            promised: self.promised.map(|it| it.0),
            promised_arrival: self.promised.map(|it| it.1),
            fault: failed.map(|follower| follower.fault(end.is_harm())),
            ..AttemptResult::without_plans(end, self.decisions, self.length)
        }
    }
}

/// Runs attempts on one map.
#[derive(Debug)]
pub struct Rollout {
    map: Arc<Map>,
    profile: CharacterProfile,
    task: TaskConfig,
    /// Rules of following plans; their patience holds for NPCs that head straight for goals as well.
    pub follow: FollowConfig,
    /// Share of the policy's exploration noise with which NPCs act, 0 or more.
    pub noise_share: f32,
    /// Seed of the noise.
    pub seed: u64,
    /// Whether NPCs that follow plans rehearse their next legs.
    pub rehearses: bool,
    /// Whether NPCs get in each other's way; those that have arrived then stay where they are.
    pub solid: bool,
}

/// What was measured while attempts ran.
#[derive(Debug, Default)]
pub struct Figures {
    /// Duration of every search, us.
    pub search_us: Vec<f64>,
    /// How the NPCs moved.
    pub motion: Motion,
}

/// Positions of the feet of one NPC, m: the start, then the position after each decision.
pub type Track = Vec<Vec3>;

/// An attempt with its track and actions.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    /// Result of the attempt.
    pub attempt: AttemptResult,
    /// Where the NPC was.
    pub track: Track,
    /// Its action in each decision.
    pub actions: Vec<Action>,
}

impl Rollout {
    /// Prepares attempts on `map` with the default noise; attempts end early at the patience of `task`.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, task: TaskConfig) -> Self {
        Self {
            map,
            profile,
            follow: FollowConfig { patience: task.patience, ..FollowConfig::default() },
            task,
            noise_share: DEFAULT_NOISE_SHARE,
            seed: 0,
            rehearses: true,
            solid: false,
        }
    }

    /// Runs one attempt for each goal, heading straight for the goal, and returns the results in the order of the
    /// goals.
    pub fn run(&self, policy: &Policy, goals: &[Goal]) -> Vec<AttemptResult> {
        self.measure(policy, None, goals, &mut Figures::default())
    }

    /// Like [`run`](Self::run), but follows plans of `router`, if there is one, and adds what was measured to
    /// `figures`.
    pub fn measure(
        &self,
        policy: &Policy,
        router: Option<&Router>,
        goals: &[Goal],
        figures: &mut Figures,
    ) -> Vec<AttemptResult> {
        let run = |chunk| self.run_batch((policy, router), chunk, figures, &mut |_, _| {});
        goals.chunks(BATCH).flat_map(run).map(|played| played.attempt).collect()
    }

    /// Runs all attempts together, following plans of `router`. `before_each_decision` gets the world and the number of
    /// the decision, and may change the world. Returns the results in the order of the goals.
    pub fn live(
        &self,
        policy: &Policy,
        router: &Router,
        goals: &[Goal],
        mut before_each_decision: impl FnMut(&mut World, u32),
    ) -> Vec<AttemptResult> {
        let figures = &mut Figures::default();
        let played = self.run_batch((policy, Some(router)), goals, figures, &mut before_each_decision);
        played.into_iter().map(|played| played.attempt).collect()
    }

    /// Like [`measure`](Self::measure), but also returns the tracks and actions of the NPCs.
    pub fn play(&self, policy: &Policy, router: Option<&Router>, goals: &[Goal]) -> Vec<Played> {
        let run = |chunk| self.run_batch((policy, router), chunk, &mut Figures::default(), &mut |_, _| {});
        goals.chunks(BATCH).flat_map(run).collect()
    }

    fn run_batch(
        &self,
        (policy, router): (&Policy, Option<&Router>),
        goals: &[Goal],
        Figures { search_us, motion }: &mut Figures,
        before_each_decision: &mut dyn FnMut(&mut World, u32),
    ) -> Vec<Played> {
        let mut run = Run::prepare(self, policy);
        before_each_decision(&mut run.worlds[0], 0);
        run.begin(router, goals, search_us);
        let mut npcs: Vec<DecidingNpc> = run.walkers.iter().map(|walker| walker.deciding).collect();
        for decision in 1.. {
            before_each_decision(&mut run.worlds[0], decision);
            run.guide();
            npcs.retain(|npc| run.walkers[npc.slot.0 as usize].is_running(&mut run.worlds[0], self.solid));
            if npcs.is_empty() {
                break;
            }
            run.decide(&mut npcs, motion);
        }
        run.walkers.into_iter().map(Walker::finish).collect()
    }

    /// How the attempt of an NPC that heads straight for its goal has ended, if it has.
    fn end_of_straight(&self, world: &World, walker: &Walker, outcome: DecisionOutcome) -> Option<End> {
        let episode = world.npc(walker.deciding.slot).and_then(|npc| npc.episode).expect("an episode in every slot");
        let is_out_of_patience = episode.stalled_decisions >= self.follow.patience;
        outcome.end.or(is_out_of_patience.then_some(End::NoProgress))
    }
}

/// Attempts that run together in one world.
struct Run<'a> {
    rollout: &'a Rollout,
    policy: &'a Policy,
    worlds: [World; 1],
    decisions: DecisionLoop,
    walkers: Vec<Walker>,
    /// `None` if NPCs head straight for their goals.
    guide: Option<Guide<'a>>,
}

impl<'a> Run<'a> {
    /// A world without NPCs.
    fn prepare(rollout: &'a Rollout, policy: &'a Policy) -> Self {
        let config = WorldConfig::new(rollout.profile.clone(), rollout.task.clone(), rollout.solid);
        let worlds = [World::with_config(rollout.map.clone(), config)];
        Self { rollout, policy, worlds, decisions: DecisionLoop::new(policy), walkers: Vec::new(), guide: None }
    }

    /// Begins an attempt for each goal, with its first plan if there is a router.
    fn begin(&mut self, router: Option<&'a Router>, goals: &[Goal], search_us: &'a mut Vec<f64>) {
        let Self { rollout, policy, .. } = *self;
        let world = &mut self.worlds[0];
        let walkers = (0..).zip(goals).map(|(idx, goal)| {
            let noise = NoiseStream::new(rollout.noise_share, rollout.seed, idx);
            Walker::start(world, goal, noise, (rollout.follow, router.is_some()))
        });
        self.walkers = walkers.collect();
        self.walkers.iter().for_each(|walker| self.decisions.begin(walker.deciding.row_idx));
        self.guide = router.map(|router| Guide {
            router,
            policy,
            rehearsal: Rehearsal::new(rollout.map.clone(), rollout.profile.clone(), rollout.task.clone(), policy),
            rehearses: rollout.rehearses,
            traffic: rollout.solid.then(Traffic::default),
            search_us,
        });
        if let Some(guide) = &mut self.guide {
            self.walkers.iter_mut().for_each(|walker| guide.begin(&mut self.worlds[0], walker));
        }
    }

    /// Lets NPCs look at movers and rehearse before a decision.
    fn guide(&mut self) {
        if let Some(guide) = &mut self.guide {
            guide.prepare(&mut self.worlds[0], &mut self.walkers, &self.decisions);
        }
    }

    /// Runs one decision of these NPCs.
    fn decide(&mut self, npcs: &mut [DecidingNpc], motion: &mut Motion) {
        let Self { rollout, policy, worlds, decisions, walkers, guide } = self;
        npcs.iter_mut().for_each(|npc| npc.style = walkers[npc.slot.0 as usize].style(&worlds[0]));
        let noise = npcs.iter().flat_map(|npc| walkers[npc.slot.0 as usize].noise.draw(npc.style)).collect();
        let mut batch = DecisionBatch { worlds: &mut *worlds, npcs };
        let outcomes = decisions.decide(&mut batch, policy, Noise::Rows(noise)).to_vec();
        for ((npc, outcome), action) in npcs.iter().zip(outcomes).zip(decisions.actions()) {
            let walker = &mut walkers[npc.slot.0 as usize];
            walker.record(&worlds[0], *action, motion);
            match guide {
                Some(guide) => guide.follow(&mut worlds[0], walker, outcome.end),
                None => walker.measured.end = rollout.end_of_straight(&worlds[0], walker, outcome),
            }
        }
    }
}

/// One NPC with its running attempt.
struct Walker {
    deciding: DecidingNpc,
    noise: NoiseStream,
    /// The attempt by plan; `None` if the NPC heads straight for its goal.
    attempt: Option<Attempt>,
    measured: Measured,
    /// Whether the attempt goes on after the NPC has arrived.
    keeps: bool,
    /// Whether the NPC keeps to its goal and is there.
    rests: bool,
    track: Track,
    actions: Vec<Action>,
    trace: Trace,
}

impl Walker {
    /// Spawns an NPC that follows plans if there are any, and otherwise heads straight for the goal.
    fn start(world: &mut World, goal: &Goal, noise: NoiseStream, (config, has_plans): (FollowConfig, bool)) -> Self {
        let slot = world.spawn(goal.start, goal.yaw);
        world.head_for(slot, goal.goal, config.arrival);
        Self {
            deciding: DecidingNpc::of(slot),
            noise,
            attempt: has_plans.then(|| Attempt::new(Follower::new(goal.goal, config))),
            measured: Measured::begin(goal.start),
            keeps: false,
            rests: false,
            track: vec![goal.start],
            actions: Vec::new(),
            trace: Trace::begin(world.npc(slot).expect("just spawned")),
        }
    }

    /// Whether the NPC decides.
    fn acts(&self) -> bool {
        self.measured.end.is_none() && !self.rests
    }

    fn follower(&self) -> Option<&Follower> {
        self.attempt.as_ref().map(|attempt| &attempt.follower)
    }

    fn style(&self, world: &World) -> Style {
        let npc = world.npc(self.deciding.slot).expect("a running NPC");
        self.attempt.as_ref().map_or(Style::Free, |it| it.style(world.map(), world.profile_of(npc), &npc.body))
    }

    /// Records one decision.
    fn record(&mut self, world: &World, action: Action, motion: &mut Motion) {
        let npc = world.npc(self.deciding.slot).expect("a running NPC");
        motion.note(&mut self.trace, npc, self.attempt.as_ref().and_then(|attempt| attempt.follower.ability()));
        self.actions.push(action);
        self.track.push(npc.body.feet);
        self.measured.record_decision(npc.body.feet);
    }

    /// Whether the NPC decides again; otherwise it comes to rest if it `stays`, or leaves the world.
    fn is_running(&self, world: &mut World, stays: bool) -> bool {
        match self.measured.end {
            Some(_) if stays => world.clear_waypoint(self.deciding.slot),
            Some(_) => _ = world.despawn(self.deciding.slot),
            None => {}
        }
        self.measured.end.is_none()
    }

    fn finish(self) -> Played {
        let attempt = self.measured.result(self.follower());
        Played { attempt, track: self.track, actions: self.actions }
    }
}
