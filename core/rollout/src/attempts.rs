//! Runs whole episodes towards many goals at once, straight or by plan, for validation, evaluation and pictures.

use crate::decision::{DEFAULT_NOISE_SHARE, DecisionLoop, Lane, Noise, Stage};
use crate::follow::{Fault, FollowConfig, Follower, Step};
use crate::goals::Goal;
use crate::motion::{Motion, Trace};
use crate::rehearse::{Actor, Ghost, Next, NoiseStream, Rehearsal, Resort, Tally};
use crate::scene::Scene;
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
pub struct Attempt {
    /// How the attempt ended.
    pub end: End,
    /// Number of decisions.
    pub decisions: u32,
    /// Number of re-plans.
    pub replans: u32,
    /// Length of the path from decision to decision, m.
    pub length: f32,
    /// Number of plans that were taken: 1 for one that went through as planned.
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

/// An attempt, and what the NPC did in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    /// Result of the attempt.
    pub attempt: Attempt,
    /// Where the NPC was.
    pub track: Track,
    /// What it did, decision by decision.
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

    /// Runs one attempt for each goal, heading straight for the goal, and returns the attempts in the order of the goals.
    pub fn run(&self, policy: &Policy, goals: &[Goal]) -> Vec<Attempt> {
        self.measure(policy, None, goals, &mut Figures::default())
    }

    /// Same as [`run`](Self::run), but following plans of `router`, if there is one, and adds what was measured to `figures`.
    pub fn measure(
        &self,
        policy: &Policy,
        router: Option<&Router>,
        goals: &[Goal],
        figures: &mut Figures,
    ) -> Vec<Attempt> {
        let run = |chunk| self.run_batch(policy, router, chunk, figures, &mut |_, _| {});
        goals.chunks(BATCH).flat_map(run).map(|played| played.attempt).collect()
    }

    /// Runs all attempts together, following plans of `router`, in a world that `stir` changes before each decision, of which it gets the
    /// number. Returns the attempts in the order of the goals.
    pub fn live(
        &self,
        policy: &Policy,
        router: &Router,
        goals: &[Goal],
        mut stir: impl FnMut(&mut World, u32),
    ) -> Vec<Attempt> {
        let played = self.run_batch(policy, Some(router), goals, &mut Figures::default(), &mut stir);
        played.into_iter().map(|played| played.attempt).collect()
    }

    /// Same as [`measure`](Self::measure), but returns what the NPCs did besides.
    pub fn play(&self, policy: &Policy, router: Option<&Router>, goals: &[Goal]) -> Vec<Played> {
        let run = |chunk| self.run_batch(policy, router, chunk, &mut Figures::default(), &mut |_, _| {});
        goals.chunks(BATCH).flat_map(run).collect()
    }

    fn run_batch(
        &self,
        policy: &Policy,
        router: Option<&Router>,
        goals: &[Goal],
        Figures { search_us, motion }: &mut Figures,
        stir: &mut dyn FnMut(&mut World, u32),
    ) -> Vec<Played> {
        let config = WorldConfig::new(self.profile.clone(), self.task.clone(), self.solid);
        let mut worlds = [World::with_config(self.map.clone(), config)];
        stir(&mut worlds[0], 0);
        let mut decisions = DecisionLoop::new(policy);
        let mut walkers: Vec<Walker> = (0..)
            .zip(goals)
            .map(|(idx, goal)| {
                let noise = NoiseStream::new(self.noise_share, self.seed, idx);
                Walker::start(&mut worlds[0], goal, noise, router.map(|_| self.follow))
            })
            .collect();
        let mut guide = router.map(|router| Guide {
            router,
            policy,
            rehearsal: Rehearsal::new(self.map.clone(), self.profile.clone(), self.task.clone(), policy),
            rehearses: self.rehearses,
            traffic: self.solid.then(Traffic::default),
            search_us,
        });
        for walker in &mut walkers {
            decisions.begin(walker.lane.row_idx);
            if let (Some(follower), Some(guide)) = (&mut walker.follower, &mut guide) {
                let waypoint = guide.plan(follower, walker.track[0]);
                worlds[0].set_waypoint(walker.lane.slot, waypoint);
                walker.promised = follower.promised();
                walker.rehearses_next = true;
            }
        }
        let mut lanes: Vec<Lane> = walkers.iter().map(|walker| walker.lane).collect();
        for decision in 1.. {
            stir(&mut worlds[0], decision);
            if let Some(guide) = &mut guide {
                guide.count_traffic(&walkers);
                guide.look(&mut worlds[0], &mut walkers);
                guide.rehearse(&mut worlds[0], &mut walkers, &decisions);
            }
            lanes.retain(|lane| walkers[lane.slot.0 as usize].goes_on(&mut worlds[0], self.solid));
            if lanes.is_empty() {
                break;
            }
            lanes.iter_mut().for_each(|lane| lane.style = walkers[lane.slot.0 as usize].style());
            let noise = lanes.iter().flat_map(|lane| walkers[lane.slot.0 as usize].noise.draw(lane.style)).collect();
            let mut stage = Stage { worlds: &mut worlds, lanes: &lanes };
            let closed = decisions.decide(&mut stage, policy, Noise::Rows(noise)).to_vec();
            for ((lane, outcome), action) in lanes.iter().zip(closed).zip(decisions.actions()) {
                let walker = &mut walkers[lane.slot.0 as usize];
                walker.actions.push(*action);
                walker.note_motion(&worlds[0], motion);
                self.settle(&mut worlds[0], walker, guide.as_mut(), outcome);
            }
        }
        walkers.into_iter().map(Walker::finish).collect()
    }

    /// Processes one decision of one NPC.
    fn settle(&self, world: &mut World, walker: &mut Walker, guide: Option<&mut Guide<'_>>, outcome: DecisionOutcome) {
        let npc = world.npc(walker.lane.slot).expect("an NPC in every slot");
        let stalled = npc.episode.expect("an episode in every slot").stalled_decisions;
        walker.track.push(npc.body.feet);
        match guide {
            Some(guide) => guide.follow(world, walker, outcome.end),
            None => walker.end = outcome.end.or((stalled >= self.follow.patience).then_some(End::NoProgress)),
        }
    }
}

/// One NPC with its running attempt.
struct Walker {
    lane: Lane,
    noise: NoiseStream,
    follower: Option<Follower>,
    /// Chances of arriving as planned, and with re-plans, that the first plan gave.
    promised: Option<(f32, f32)>,
    /// Whether what lies ahead must be rehearsed before the next decision.
    rehearses_next: bool,
    ghost: Option<Ghost>,
    track: Track,
    actions: Vec<Action>,
    trace: Trace,
    end: Option<End>,
}

impl Walker {
    /// Spawns an NPC that follows plans with the configuration `by_plan`, or heads straight for the goal without one.
    fn start(world: &mut World, goal: &Goal, noise: NoiseStream, by_plan: Option<FollowConfig>) -> Self {
        let slot = world.spawn(goal.start, goal.yaw);
        world.set_waypoint(slot, goal.goal);
        let follower = by_plan.map(|config| Follower::new(goal.goal, config));
        let track = vec![goal.start];
        let trace = Trace::begin(world.npc(slot).expect("just spawned"));
        Self {
            lane: Lane::of(slot),
            noise,
            follower,
            promised: None,
            rehearses_next: false,
            ghost: None,
            track,
            actions: Vec::new(),
            trace,
            end: None,
        }
    }

    /// How the NPC moves next: composed only where a rehearsal has shown that it arrives so.
    fn style(&self) -> Style {
        if let Some(stay) = self.follower.as_ref().and_then(Follower::stays) {
            return stay;
        }
        let ghost = self.ghost.as_ref().filter(|ghost| ghost.is_ahead());
        ghost.and(self.follower.as_ref()).map_or(Style::Free, Follower::style)
    }

    fn note_motion(&mut self, world: &World, motion: &mut Motion) {
        let npc = world.npc(self.lane.slot).expect("a running NPC");
        motion.note(&mut self.trace, npc, self.follower.as_ref().and_then(Follower::ability));
    }

    /// Whether the attempt goes on; otherwise the NPC comes to rest if it `stays`, and is removed if not.
    fn goes_on(&self, world: &mut World, stays: bool) -> bool {
        match self.end {
            Some(_) if stays => world.clear_waypoint(self.lane.slot),
            Some(_) => _ = world.despawn(self.lane.slot),
            None => {}
        }
        self.end.is_none()
    }

    fn finish(self) -> Played {
        let end = self.end.expect("every attempt ends");
        let failed = self.follower.as_ref().filter(|_| end != End::Reached);
        let attempt = Attempt {
            end,
            decisions: self.track.len() as u32 - 1,
            plans: self.follower.as_ref().map_or(0, Follower::plans),
            promised: self.promised.map(|it| it.0),
            promised_arrival: self.promised.map(|it| it.1),
            replans: self.follower.as_ref().map_or(0, Follower::replans),
            length: self.track.windows(2).fold(0.0, |length, step| length + step[0].distance(step[1])),
            fault: failed.map(|follower| follower.fault(end.is_harm())),
        };
        Played { attempt, track: self.track, actions: self.actions }
    }
}

/// Where plans come from, and what tries them out.
struct Guide<'a> {
    router: &'a Router,
    policy: &'a Policy,
    rehearsal: Rehearsal,
    rehearses: bool,
    /// Where the NPCs are about to be; `None` if they do not get in each other's way.
    traffic: Option<Traffic>,
    search_us: &'a mut Vec<f64>,
}

impl Guide<'_> {
    fn count_traffic(&mut self, walkers: &[Walker]) {
        let Some(traffic) = &mut self.traffic else { return };
        *traffic = Traffic::default();
        for walker in walkers.iter().filter(|walker| walker.end.is_none()) {
            if let (Some(follower), Some(feet)) = (&walker.follower, walker.track.last()) {
                follower.add_to(traffic, *feet);
            }
        }
    }

    /// Processes one decision of an NPC. `leg_end` is the end of the episode towards the current waypoint, if it ended.
    fn follow(&mut self, world: &mut World, walker: &mut Walker, leg_end: Option<End>) {
        let slot = walker.lane.slot;
        let body = world.npc(slot).expect("a running NPC").body;
        let feet = body.feet;
        let is_barred = walker.follower.as_ref().is_some_and(Follower::is_barred);
        if self.rehearses && !is_barred && !walker.ghost.as_mut().is_some_and(|ghost| ghost.foretold(&body)) {
            (walker.ghost, walker.rehearses_next) = (None, true);
        }
        let follower = walker.follower.as_mut().expect("NPCs with a guide follow plans");
        let waypoint_reached = leg_end == Some(End::Reached);
        let is_arrival = waypoint_reached && follower.is_last_leg() && !follower.is_second_best();
        if is_arrival || leg_end.is_some_and(End::is_harm) {
            walker.end = leg_end;
            return;
        }
        let is_pushed = world.config().npc_collision && walker.ghost.is_none() && body.is_grounded();
        let step = match follower.note(feet, waypoint_reached) {
            step @ (Step::Keep | Step::Head(_)) if is_pushed => {
                follower.regain(world.map(), &world.config().profiles[0], feet).map_or(step, Step::Head)
            }
            step => step,
        };
        let waypoint = match step {
            Step::Keep => return,
            Step::Head(waypoint) => waypoint,
            Step::Plan => {
                walker.ghost = None;
                self.plan(follower, feet)
            }
            Step::GiveUp => return walker.end = Some(End::NoProgress),
            Step::Unreachable => return walker.end = Some(End::Unreachable),
        };
        world.set_waypoint(slot, waypoint);
        walker.rehearses_next = true;
    }

    /// Plans from `feet`, m, and returns the first waypoint, m.
    fn plan(&mut self, follower: &mut Follower, feet: Vec3) -> Vec3 {
        let Self { router, traffic, search_us, .. } = self;
        follower.plan(feet, |query| {
            let started = Instant::now();
            let plan = match traffic {
                Some(traffic) => router.find_path_in(traffic, query, &EdgeCosts::new()),
                None => router.find_path(query),
            };
            search_us.push(started.elapsed().as_secs_f64() * 1.0e6);
            plan
        })
    }

    /// Lets all NPCs look at the movers, and call those that they want; those whose way is barred plan anew.
    fn look(&mut self, world: &mut World, walkers: &mut [Walker]) {
        if world.movers().is_empty() {
            return;
        }
        for walker in walkers.iter_mut().filter(|walker| walker.end.is_none()) {
            let follower = walker.follower.as_mut().expect("NPCs with a guide follow plans");
            let body = world.npc(walker.lane.slot).expect("a running NPC").body;
            follower.look(Scene { map: world.map(), states: world.movers() }, body.feet, body.is_grounded());
            if follower.has_replanned_enough() {
                walker.end = Some(End::NoProgress);
                continue;
            }
            if follower.waypoint().is_none() && !follower.is_barred() {
                let waypoint = self.plan(follower, body.feet);
                world.set_waypoint(walker.lane.slot, waypoint);
                (walker.ghost, walker.rehearses_next) = (None, true);
                let follower = walker.follower.as_mut().expect("NPCs with a guide follow plans");
                follower.look(Scene { map: world.map(), states: world.movers() }, body.feet, body.is_grounded());
            }
            if let Some(call) = walker.follower.as_ref().and_then(Follower::call) {
                world.call(call.mover, call.stop);
            }
        }
    }

    /// Rehearses the next legs of all NPCs that are due, until nothing goes wrong any more.
    fn rehearse(&mut self, world: &mut World, walkers: &mut [Walker], decisions: &DecisionLoop) {
        let hidden_len = self.policy.memory_len();
        let mut waiting: Vec<(usize, Tally)> = Vec::new();
        for (idx, walker) in walkers.iter_mut().enumerate() {
            let is_due = std::mem::take(&mut walker.rehearses_next) && walker.end.is_none();
            if self.rehearses && is_due {
                waiting.push((idx, Tally::default()));
            }
        }
        while !waiting.is_empty() {
            let ghosts: Vec<Option<Ghost>> = waiting.iter().map(|(idx, _)| walkers[*idx].ghost.take()).collect();
            let actors = waiting.iter().zip(ghosts).map(|((idx, _), ghost)| {
                let Walker { lane, follower, noise, .. } = &walkers[*idx];
                let npc = *world.npc(lane.slot).expect("a running NPC");
                let follower = follower.as_ref().expect("NPCs with a guide follow plans");
                let hidden = decisions.hidden()[lane.row_idx * hidden_len..][..hidden_len].to_vec();
                Actor { npc, follower: follower.clone(), hidden, noise: *noise, ghost }
            });
            let actors: Vec<Actor> = actors.collect();
            let results = self.rehearsal.run(self.policy, actors, world.movers());
            let mut results = results.into_iter();
            waiting.retain_mut(|(idx, tally)| {
                let walker = &mut walkers[*idx];
                match results.next().expect("a result for each actor") {
                    Ok(ghost) => {
                        let follower = walker.follower.as_mut().expect("NPCs with a guide follow plans");
                        follower.learn_way(ghost.way());
                        walker.ghost = Some(ghost);
                        false
                    }
                    Err(mishap) => {
                        let follower = walker.follower.as_mut().expect("NPCs with a guide follow plans");
                        let resort = tally.note(mishap, follower);
                        self.resort(world, walker, resort)
                    }
                }
            });
        }
    }

    /// Does what is left for an NPC after a mishap in a rehearsal, and returns whether it rehearses again.
    fn resort(&mut self, world: &mut World, walker: &mut Walker, resort: Resort) -> bool {
        let follower = walker.follower.as_mut().expect("NPCs with a guide follow plans");
        match resort.take(follower, &mut walker.noise) {
            Next::Again => true,
            Next::Plan => {
                let feet = world.npc(walker.lane.slot).expect("a running NPC").body.feet;
                let waypoint = self.plan(follower, feet);
                world.set_waypoint(walker.lane.slot, waypoint);
                true
            }
            Next::Wait => false,
            Next::Stop => {
                walker.end = Some(End::Unreachable);
                false
            }
        }
    }
}
