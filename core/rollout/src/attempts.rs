//! Runs many attempts at once in this process, straight or by plan, for validation, evaluation and pictures.

use crate::attempt::{AfterRehearsal, Attempt};
use crate::decision::{DEFAULT_NOISE_SHARE, DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use crate::follow::scene::Scene;
use crate::follow::{Fault, FollowConfig, Follower, Step};
use crate::goals::Goal;
use crate::motion::{Motion, Trace};
use crate::rehearse::{NoiseStream, Rehearsal};
use crate::style::Style;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;
use surefoot_planner::EdgeCosts;
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
        let config = WorldConfig::new(self.profile.clone(), self.task.clone(), self.solid);
        let mut worlds = [World::with_config(self.map.clone(), config)];
        before_each_decision(&mut worlds[0], 0);
        let mut decisions = DecisionLoop::new(policy);
        let mut walkers: Vec<Walker> = (0..)
            .zip(goals)
            .map(|(idx, goal)| {
                let noise = NoiseStream::new(self.noise_share, self.seed, idx);
                Walker::start(&mut worlds[0], goal, noise, (self.follow, router.is_some()))
            })
            .collect();
        walkers.iter().for_each(|walker| decisions.begin(walker.deciding.row_idx));
        let mut guide = router.map(|router| Guide {
            router,
            policy,
            rehearsal: Rehearsal::new(self.map.clone(), self.profile.clone(), self.task.clone(), policy),
            rehearses: self.rehearses,
            traffic: self.solid.then(Traffic::default),
            search_us,
        });
        if let Some(guide) = &mut guide {
            walkers.iter_mut().for_each(|walker| guide.begin(&mut worlds[0], walker));
        }
        let mut npcs: Vec<DecidingNpc> = walkers.iter().map(|walker| walker.deciding).collect();
        for decision in 1.. {
            before_each_decision(&mut worlds[0], decision);
            if let Some(guide) = &mut guide {
                guide.prepare(&mut worlds[0], &mut walkers, &decisions);
            }
            npcs.retain(|npc| walkers[npc.slot.0 as usize].is_running(&mut worlds[0], self.solid));
            if npcs.is_empty() {
                break;
            }
            npcs.iter_mut().for_each(|npc| npc.style = walkers[npc.slot.0 as usize].style(&worlds[0]));
            let noise = npcs.iter().flat_map(|npc| walkers[npc.slot.0 as usize].noise.draw(npc.style)).collect();
            let mut batch = DecisionBatch { worlds: &mut worlds, npcs: &npcs };
            let outcomes = decisions.decide(&mut batch, policy, Noise::Rows(noise)).to_vec();
            for ((npc, outcome), action) in npcs.iter().zip(outcomes).zip(decisions.actions()) {
                let walker = &mut walkers[npc.slot.0 as usize];
                walker.record(&worlds[0], *action, motion);
                match &mut guide {
                    Some(guide) => guide.follow(&mut worlds[0], walker, outcome.end),
                    None => walker.measured.end = self.end_of_straight(&worlds[0], walker, outcome),
                }
            }
        }
        walkers.into_iter().map(Walker::finish).collect()
    }

    /// How the attempt of an NPC that heads straight for its goal has ended, if it has.
    fn end_of_straight(&self, world: &World, walker: &Walker, outcome: DecisionOutcome) -> Option<End> {
        let episode = world.npc(walker.deciding.slot).and_then(|npc| npc.episode).expect("an episode in every slot");
        let is_out_of_patience = episode.stalled_decisions >= self.follow.patience;
        outcome.end.or(is_out_of_patience.then_some(End::NoProgress))
    }
}

/// One NPC with its running attempt.
struct Walker {
    deciding: DecidingNpc,
    noise: NoiseStream,
    /// The attempt by plan; `None` if the NPC heads straight for its goal.
    attempt: Option<Attempt>,
    measured: Measured,
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
            track: vec![goal.start],
            actions: Vec::new(),
            trace: Trace::begin(world.npc(slot).expect("just spawned")),
        }
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

/// Plans for NPCs, and rehearses their plans.
struct Guide<'a> {
    router: &'a Router,
    policy: &'a Policy,
    rehearsal: Rehearsal,
    rehearses: bool,
    /// Predicted places of the NPCs; `None` if they do not get in each other's way.
    traffic: Option<Traffic>,
    search_us: &'a mut Vec<f64>,
}

impl Guide<'_> {
    /// Begins the attempt of an NPC with its first plan.
    fn begin(&mut self, world: &mut World, walker: &mut Walker) {
        self.plan(world, walker, walker.measured.feet);
        let Walker { attempt, measured, .. } = walker;
        measured.record_first_plan(&attempt_of(attempt).follower);
    }

    /// Prepares the next decision of all NPCs.
    fn prepare(&mut self, world: &mut World, walkers: &mut [Walker], decisions: &DecisionLoop) {
        self.count_traffic(walkers);
        if !world.movers().is_empty() {
            walkers.iter_mut().for_each(|walker| self.watch_movers(world, walker));
        }
        if self.rehearses {
            self.rehearse(world, walkers, decisions);
        }
    }

    fn count_traffic(&mut self, walkers: &[Walker]) {
        let Some(traffic) = &mut self.traffic else { return };
        *traffic = Traffic::default();
        for walker in walkers.iter().filter(|walker| walker.measured.end.is_none()) {
            if let Some(follower) = walker.follower() {
                follower.add_to(traffic, walker.measured.feet);
            }
        }
    }

    /// Processes one decision of an NPC. `leg_end` is how the way to the current waypoint ended, if it did.
    fn follow(&mut self, world: &mut World, walker: &mut Walker, leg_end: Option<End>) {
        let slot = walker.deciding.slot;
        let body = world.npc(slot).expect("a running NPC").body;
        let attempt = attempt_of(&mut walker.attempt);
        let is_as_forecast = attempt.check_forecast(&body);
        let mut step = attempt.follower.record_decision(body.feet, leg_end);
        let is_pushed = world.config().npc_collision && !is_as_forecast && body.is_grounded();
        if is_pushed && matches!(step, Step::Keep | Step::HeadFor(_)) {
            let waypoint = attempt.follower.return_to_way(world.map(), &world.config().profiles[0], body.feet);
            step = waypoint.map_or(step, Step::HeadFor);
        }
        match step {
            Step::Keep => {}
            Step::HeadFor(waypoint) => {
                attempt.extend_forecast();
                world.head_for(slot, waypoint, attempt.follower.arrival());
            }
            Step::Plan => self.plan(world, walker, body.feet),
            Step::End(end) => walker.measured.end = Some(end),
        }
    }

    /// Plans for an NPC from `feet`, m; it heads for the first waypoint.
    fn plan(&mut self, world: &mut World, walker: &mut Walker, feet: Vec3) {
        let Self { router, traffic, search_us, .. } = self;
        let waypoint = attempt_of(&mut walker.attempt).plan(feet, |query| {
            let started = Instant::now();
            let plan = match traffic {
                Some(traffic) => router.find_path_in(traffic, query, &EdgeCosts::new()),
                None => router.find_path(query),
            };
            search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
            plan
        });
        let arrival = attempt_of(&mut walker.attempt).follower.arrival();
        world.head_for(walker.deciding.slot, waypoint, arrival);
    }

    /// Lets an NPC watch the movers, call those that it needs, and plan again if they bar its plan.
    fn watch_movers(&mut self, world: &mut World, walker: &mut Walker) {
        if walker.measured.end.is_some() {
            return;
        }
        let body = world.npc(walker.deciding.slot).expect("a running NPC").body;
        let watch = |world: &World, attempt: &mut Attempt| {
            let scene = Scene { map: world.map(), states: world.movers() };
            attempt.follower.watch_movers(scene, body.feet, body.is_grounded());
        };
        let attempt = attempt_of(&mut walker.attempt);
        watch(world, attempt);
        if attempt.follower.has_used_up_replans() {
            walker.measured.end = Some(End::NoProgress);
            return;
        }
        if attempt.follower.waypoint().is_none() && !attempt.follower.is_barred() {
            self.plan(world, walker, body.feet);
            watch(world, attempt_of(&mut walker.attempt));
        }
        if let Some(call) = walker.follower().and_then(Follower::call) {
            world.call(call);
        }
    }

    /// Rehearses the next legs of all NPCs that are due, until nothing goes wrong any more.
    fn rehearse(&mut self, world: &mut World, walkers: &mut [Walker], decisions: &DecisionLoop) {
        let hidden_len = self.policy.memory_len();
        let is_due =
            |walker: &Walker| walker.measured.end.is_none() && walker.attempt.as_ref().is_some_and(Attempt::is_due);
        let mut due: Vec<usize> = (0..walkers.len()).filter(|idx| is_due(&walkers[*idx])).collect();
        due.iter().for_each(|idx| attempt_of(&mut walkers[*idx].attempt).begin_rehearsals());
        while !due.is_empty() {
            let starts = due.iter().map(|idx| {
                let Walker { deciding, attempt, noise, .. } = &mut walkers[*idx];
                let npc = *world.npc(deciding.slot).expect("a running NPC");
                let hidden = decisions.hidden()[deciding.row_idx * hidden_len..][..hidden_len].to_vec();
                attempt_of(attempt).rehearsal(npc, hidden, *noise)
            });
            let starts = starts.collect();
            let mut results = self.rehearsal.run(self.policy, starts, world.movers()).into_iter();
            due.retain(|idx| {
                let walker = &mut walkers[*idx];
                let result = results.next().expect("a result for each rehearsal");
                match attempt_of(&mut walker.attempt).record_rehearsal(result, &mut walker.noise) {
                    AfterRehearsal::Act => false,
                    AfterRehearsal::Rehearse => true,
                    AfterRehearsal::Plan => {
                        let feet = world.npc(walker.deciding.slot).expect("a running NPC").body.feet;
                        self.plan(world, walker, feet);
                        true
                    }
                    AfterRehearsal::End => {
                        walker.measured.end = Some(End::Unreachable);
                        false
                    }
                }
            });
        }
    }
}

/// The attempt of an NPC with a guide.
fn attempt_of(attempt: &mut Option<Attempt>) -> &mut Attempt {
    attempt.as_mut().expect("NPCs with a guide follow plans")
}
