//! Attempts that run together in one world.

use super::guide::{Guide, GuideTimes};
use super::walker::{AttemptResult, Played, Walker};
use crate::decision::{DEFAULT_NOISE_SHARE, DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use crate::follow::FollowConfig;
use crate::goals::Goal;
use crate::motion::Motion;
use crate::rehearse::{NoiseStream, Rehearsal};
use std::sync::Arc;
use std::time::Instant;
use surefoot_planner::{Router, Traffic};
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, DecisionOutcome, End, Map, TaskConfig, World, WorldConfig};

/// Most NPCs of one batch.
const BATCH: usize = 256;

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
    /// How long it took to plan, review and rehearse.
    pub times: GuideTimes,
    /// How the NPCs moved.
    pub motion: Motion,
    /// Decisions in which NPCs were steered, without their policy.
    pub steered: u64,
    /// Duration of all decisions: sensing, the policy and ten ticks of the world, s.
    pub decide_s: f64,
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
        Figures { times, motion, steered, decide_s }: &mut Figures,
        before_each_decision: &mut dyn FnMut(&mut World, u32),
    ) -> Vec<Played> {
        let mut run = Run::prepare(self, policy);
        before_each_decision(&mut run.worlds[0], 0);
        run.begin(router, goals, times);
        let mut npcs: Vec<DecidingNpc> = run.walkers.iter().map(|walker| walker.deciding).collect();
        for decision in 1.. {
            before_each_decision(&mut run.worlds[0], decision);
            run.guide();
            npcs.retain(|npc| run.walkers[npc.slot.0 as usize].is_running(&mut run.worlds[0], self.solid));
            if npcs.is_empty() {
                break;
            }
            let started = Instant::now();
            run.decide(&mut npcs, motion);
            *decide_s += started.elapsed().as_secs_f64();
            *steered += npcs.iter().filter(|npc| npc.style.is_steered()).count() as u64;
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
pub(super) struct Run<'a> {
    pub(super) rollout: &'a Rollout,
    pub(super) policy: &'a Policy,
    pub(super) worlds: [World; 1],
    pub(super) decisions: DecisionLoop,
    pub(super) walkers: Vec<Walker>,
    /// `None` if NPCs head straight for their goals.
    pub(super) guide: Option<Guide<'a>>,
}

impl<'a> Run<'a> {
    /// A world without NPCs.
    pub fn prepare(rollout: &'a Rollout, policy: &'a Policy) -> Self {
        let config = WorldConfig::new(rollout.profile.clone(), rollout.task.clone(), rollout.solid);
        let worlds = [World::with_config(rollout.map.clone(), config)];
        Self { rollout, policy, worlds, decisions: DecisionLoop::new(policy), walkers: Vec::new(), guide: None }
    }

    /// Begins an attempt for each goal, with its first plan if there is a router.
    pub fn begin(&mut self, router: Option<&'a Router>, goals: &[Goal], times: &'a mut GuideTimes) {
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
            times,
        });
        if let Some(guide) = &mut self.guide {
            self.walkers.iter_mut().for_each(|walker| guide.begin(&mut self.worlds[0], walker));
        }
    }

    /// Lets NPCs look at movers and rehearse before a decision.
    pub fn guide(&mut self) {
        if let Some(guide) = &mut self.guide {
            guide.prepare(&mut self.worlds[0], &mut self.walkers, &self.decisions);
        }
    }

    /// Runs one decision of these NPCs.
    pub fn decide(&mut self, npcs: &mut [DecidingNpc], motion: &mut Motion) {
        let Self { rollout, policy, worlds, decisions, walkers, guide } = self;
        npcs.iter_mut().for_each(|npc| npc.style = walkers[npc.slot.0 as usize].style(&worlds[0]));
        npcs.iter().for_each(|npc| walkers[npc.slot.0 as usize].predict(&worlds[0]));
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
