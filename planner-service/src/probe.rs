//! Proves candidate edges: short point-goal episodes of the policy, many at a time.
//!
//! Every episode draws its heading and noise from a stream of its own, named by what it tries, so its result does not
//! depend on which others run, in which order or on how many threads.

use crate::graph::Ability;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use surefoot_policy::actor::gaussian;
use surefoot_policy::{Memories, Policy};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::{
    CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, TICKS_PER_DECISION, TaskConfig, Vec3, World,
};

/// Most trials handed to a thread at a time.
const MAX_CHUNK: usize = 512;
/// Fewest, unless there are no more.
const MIN_CHUNK: usize = 32;
/// Of those, how many run at once: the batch of the policy.
const BATCH: usize = 192;
/// Decisions without progress after which a probe has failed.
const GIVE_UP_AFTER: u32 = 30;
/// Share of the policy's exploration noise that probes act with; the same as NPCs on their way.
pub const NOISE_SHARE: f32 = 0.5;

/// What a probe runs with.
#[derive(Debug, Clone)]
pub struct ProbeContext {
    /// On this map.
    pub map: Arc<Map>,
    /// As this character.
    pub profile: CharacterProfile,
    /// With this policy.
    pub policy: Policy,
}

impl ProbeContext {
    /// As the default character.
    pub fn new(map: Arc<Map>, policy: Policy) -> Self {
        Self { map, profile: CharacterProfile::default(), policy }
    }
}

/// One episode to run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Where the feet start, m.
    pub start: Vec3,
    /// Where they should be, m.
    pub goal: Vec3,
    /// Names the episode's random stream.
    pub stream: u64,
    /// Whether to keep the way taken.
    pub keep_track: bool,
}

/// How it went.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Whether the goal was reached.
    pub reached: bool,
    /// Decisions taken.
    pub decisions: u32,
    /// The most demanding ability used.
    pub ability: Ability,
    /// Corners of the box around the way taken, m.
    pub bounds: [Vec3; 2],
    /// Where the feet stood after each decision, first the start, m, and nothing where they were in the air; empty
    /// unless it was to be kept.
    pub track: Vec<Option<Vec3>>,
}

/// Runs probes somewhere: here on all cores, or later on workers.
pub trait ProbeExecutor {
    /// Runs each trial and returns its outcome, in the order of the trials; equal seeds give equal outcomes.
    ///
    /// `progress` counts finished trials. `None` if `cancel` was set before the last one finished.
    fn run(&self, trials: &[Trial], seed: u64, progress: &AtomicU64, cancel: &AtomicBool) -> Option<Vec<Outcome>>;
}

/// Probes in this process on all cores; equal results for any number of them.
#[derive(Debug, Clone)]
pub struct InProcess {
    /// What to run.
    pub context: ProbeContext,
    /// Threads to use.
    pub thread_count: usize,
}

impl ProbeExecutor for InProcess {
    fn run(&self, trials: &[Trial], seed: u64, progress: &AtomicU64, cancel: &AtomicBool) -> Option<Vec<Outcome>> {
        // Chunks do not depend on the number of threads, since what shares a batch may.
        let chunk_len = (trials.len() / 8).clamp(MIN_CHUNK, MAX_CHUNK);
        let chunks: Vec<&[Trial]> = trials.chunks(chunk_len).collect();
        let next = AtomicUsize::new(0);
        let results: Mutex<Vec<Option<Vec<Outcome>>>> = Mutex::new(vec![None; chunks.len()]);
        std::thread::scope(|scope| {
            for _ in 0..self.thread_count.clamp(1, chunks.len().max(1)) {
                scope.spawn(|| {
                    loop {
                        let chunk_idx = next.fetch_add(1, Ordering::Relaxed);
                        let Some(chunk) = chunks.get(chunk_idx) else { return };
                        let outcomes = run_chunk(&self.context, chunk, seed, progress, cancel);
                        results.lock().expect("no probe panics")[chunk_idx] = outcomes;
                    }
                });
            }
        });
        let outcomes: Option<Vec<Vec<Outcome>>> = results.into_inner().expect("no probe panics").into_iter().collect();
        outcomes.map(|chunks| chunks.into_iter().flatten().collect())
    }
}

/// One running trial.
struct Running {
    slot: NpcSlot,
    trial_idx: usize,
    rng: ChaCha8Rng,
    outcome: Outcome,
}

impl Running {
    fn start(world: &mut World, trial_idx: usize, trial: &Trial, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(trial.stream);
        let yaw = rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
        let slot = world.spawn(trial.start, yaw);
        world.set_goal(slot, trial.goal);
        let outcome = Outcome {
            reached: false,
            decisions: 0,
            ability: Ability::Walk,
            bounds: [trial.start; 2],
            track: if trial.keep_track { vec![Some(trial.start)] } else { Vec::new() },
        };
        Self { slot, trial_idx, rng, outcome }
    }

    /// What is added to its next action.
    fn noise(&mut self) -> impl Iterator<Item = f32> + use<> {
        gaussian(&mut self.rng, ACTION_LEN).into_iter().map(|value| value * NOISE_SHARE)
    }

    /// Settles one decision; whether the trial goes on.
    fn close_decision(&mut self, world: &mut World, keep_track: bool) -> bool {
        let closed = world.close_decision(self.slot).expect("a trial has an episode");
        let npc = world.npc(self.slot).expect("a trial has an NPC");
        let episode = npc.episode.expect("a trial has an episode");
        let outcome = &mut self.outcome;
        outcome.ability = outcome.ability.max(Ability::used(npc.events));
        outcome.bounds = [outcome.bounds[0].min(npc.body.feet), outcome.bounds[1].max(npc.body.feet)];
        if keep_track {
            outcome.track.push(npc.body.is_grounded().then_some(npc.body.feet));
        }
        let gave_up = (episode.stalled_decisions >= GIVE_UP_AFTER).then_some(End::NoProgress);
        let Some(end) = closed.end.or(gave_up) else { return true };
        outcome.reached = end == End::Reached;
        outcome.decisions = episode.decisions;
        false
    }
}

/// Runs one trial and keeps the place of the feet after every tick, first the start, m. The outcome is the one that
/// [`InProcess`] finds.
pub fn replay(context: &ProbeContext, trial: &Trial, seed: u64) -> (Outcome, Vec<Vec3>) {
    let mut world = World::new(context.map.clone(), context.profile.clone(), TaskConfig::default());
    let mut probe = Running::start(&mut world, 0, trial, seed);
    let mut memories = Memories::new(&context.policy);
    memories.forget(probe.slot.0 as usize);
    let (mut observation, mut actions) = ([0.0; OBSERVATION_LEN], Vec::new());
    let mut track = vec![trial.start];
    loop {
        world.observe(probe.slot, &mut observation);
        let who = [probe.slot.0 as usize];
        memories.act_with_noise(&context.policy, who.into_iter(), &observation, probe.noise().collect(), &mut actions);
        world.decide(probe.slot, actions[0]);
        for _ in 0..TICKS_PER_DECISION {
            world.tick();
            track.push(world.npc(probe.slot).expect("a trial has an NPC").body.feet);
        }
        if !probe.close_decision(&mut world, false) {
            return (probe.outcome, track);
        }
    }
}

fn run_chunk(
    context: &ProbeContext,
    trials: &[Trial],
    seed: u64,
    progress: &AtomicU64,
    cancel: &AtomicBool,
) -> Option<Vec<Outcome>> {
    let mut world = World::new(context.map.clone(), context.profile.clone(), TaskConfig::default());
    let mut outcomes: Vec<Option<Outcome>> = vec![None; trials.len()];
    let mut waiting = trials.iter().enumerate();
    let mut running: Vec<Running> = Vec::new();
    let (mut observations, mut actions) = (Vec::new(), Vec::new());
    let mut memories = Memories::new(&context.policy);
    loop {
        while running.len() < BATCH
            && let Some((trial_idx, trial)) = waiting.next()
        {
            let started = Running::start(&mut world, trial_idx, trial, seed);
            memories.forget(started.slot.0 as usize);
            running.push(started);
        }
        if running.is_empty() {
            return outcomes.into_iter().collect();
        }
        if cancel.load(Ordering::Relaxed) {
            return None;
        }
        observations.resize(running.len() * OBSERVATION_LEN, 0.0);
        let mut noise = Vec::with_capacity(running.len() * ACTION_LEN);
        for (probe, row) in running.iter_mut().zip(observations.chunks_exact_mut(OBSERVATION_LEN)) {
            world.observe(probe.slot, row);
            noise.extend(probe.noise());
        }
        let who = running.iter().map(|probe| probe.slot.0 as usize);
        memories.act_with_noise(&context.policy, who, &observations, noise, &mut actions);
        for (probe, action) in running.iter().zip(&actions) {
            world.decide(probe.slot, *action);
        }
        world.tick_decision();
        running.retain_mut(|probe| {
            if probe.close_decision(&mut world, trials[probe.trial_idx].keep_track) {
                return true;
            }
            world.despawn(probe.slot);
            outcomes[probe.trial_idx] = Some(probe.outcome.clone());
            progress.fetch_add(1, Ordering::Relaxed);
            false
        });
    }
}
