//! Probes candidate edges with short point-goal episodes of the policy, many at a time.
//!
//! Every episode draws its heading and noise from its own random stream, which its trial names. Its result therefore
//! does not depend on the other episodes, on their order or on the number of threads.

use crate::cross::Cross;
use crate::decision::{DEFAULT_NOISE_SHARE, DecidingNpc, DecisionBatch, DecisionLoop, Noise};
use crate::goals::{Goal, random_yaw};
use crate::leap::Leap;
use crate::steer::Course;
use crate::style::Style;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;
use surefoot_planner::needs::{Need, Needs, Ride};
use surefoot_planner::probe::{Manner, Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner::ride_stops::{Boarding, longest_ride_ticks, states_for_proof};
use surefoot_planner::threads::map_indices;
use surefoot_planner::{PolicyHash, Site};
use surefoot_policy::Policy;
use surefoot_policy::noise::fill_gaussian;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::crossings::approach_between;
use surefoot_world::reliance::Reliance;
use surefoot_world::{
    Ability, Arrival, CharacterProfile, DecisionOutcome, End, Map, MoverAt, MoverOrder, NpcSlot, StopSet,
    TICKS_PER_DECISION, TaskConfig, Vec3, World, arrival,
};

/// Most trials of a chunk.
pub const MAX_CHUNK: usize = 256;
/// Fewest trials of a chunk, unless there are fewer in all.
const MIN_CHUNK: usize = 32;
/// Most trials of a thread that run at once: the batch of the policy.
const BATCH: usize = 192;
/// Decisions without progress after which a probe has failed: a short leg is hopeless sooner than a long route.
const GIVE_UP_AFTER: u32 = 12;
/// Same as [`GIVE_UP_AFTER`] for goals above the reach of jumps: the way to a device may lead away from the goal first.
const GIVE_UP_CLIMB_AFTER: u32 = 30;

/// Map, character and policy of probes.
#[derive(Debug, Clone)]
pub struct ProbeContext {
    /// Map of the probes.
    pub map: Arc<Map>,
    /// Profile of the NPCs.
    pub profile: CharacterProfile,
    /// Policy of the NPCs.
    pub policy: Policy,
}

impl ProbeContext {
    /// A context with the default character profile.
    pub fn new(map: Arc<Map>, policy: Policy) -> Self {
        Self { map, profile: CharacterProfile::default(), policy }
    }

    /// Map and character profile, as the planner needs them.
    pub fn site(&self) -> Site {
        Site { map: self.map.clone(), profile: self.profile.clone() }
    }

    /// Hash of the policy's weights.
    pub fn policy_hash(&self) -> PolicyHash {
        PolicyHash::new(self.policy.weights_hash())
    }

    /// Runs the trials of one of [`chunks`] and returns their outcomes, in order; `None` if `watch` cancelled. The same
    /// movers must be held in all of them.
    pub fn run_chunk(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        run_chunk(self, &Reliance::on(&self.map), trials, seed, watch)
    }

    /// A world with all movers at their stops for proofs, and `held` at its stop.
    pub(crate) fn world_for(&self, held: Option<MoverAt>) -> World {
        let mut world = World::new(self.map.clone(), self.profile.clone(), TaskConfig::default());
        if !self.map.movers().is_empty() {
            world.set_movers(states_for_proof(&self.map, held));
        }
        world
    }
}

/// Runs probes in this process; the results do not depend on the number of threads.
#[derive(Debug, Clone)]
pub struct InProcess {
    /// Map, character and policy.
    pub context: ProbeContext,
    /// Number of threads, at least 1.
    pub thread_count: usize,
}

impl ProbeExecutor for InProcess {
    fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let chunks = chunks(trials);
        let reliance = Reliance::on(&self.context.map);
        let outcomes = map_indices(chunks.len(), self.thread_count, |chunk_idx| {
            let chunk = &chunks[chunk_idx];
            let alike: Vec<Trial> = chunk.iter().map(|&idx| trials[idx]).collect();
            let watch = OfChunk { chunk, watch };
            if watch.is_cancelled() { None } else { run_chunk(&self.context, &reliance, &alike, seed, &watch) }
        });
        Some(in_order(&chunks, outcomes.into_iter().collect::<Option<_>>()?))
    }
}

/// Divides trials into chunks. Each chunk runs by itself ([`ProbeContext::run_chunk`]), here or on another machine.
/// Returns the indices of the trials of each chunk.
///
/// Chunks depend only on the trials. Many of them keep all threads busy to the end. The trials of one chunk share the
/// movers of its world.
pub fn chunks(trials: &[Trial]) -> Vec<Vec<usize>> {
    let chunk_len = (trials.len() / 32).clamp(MIN_CHUNK, MAX_CHUNK);
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by_key(|&idx| trials[idx].held);
    let alike = order.chunk_by(|&one, &other| trials[one].held == trials[other].held);
    alike.flat_map(|alike| alike.chunks(chunk_len)).map(<[usize]>::to_vec).collect()
}

/// Joins the outcomes of chunks to the outcomes of all trials, in order.
pub fn in_order(chunks: &[Vec<usize>], outcomes: Vec<Vec<Outcome>>) -> Vec<Outcome> {
    let mut all: Vec<(usize, Outcome)> = chunks.iter().flatten().copied().zip(outcomes.into_iter().flatten()).collect();
    all.sort_by_key(|(idx, _)| *idx);
    all.into_iter().map(|(_, outcome)| outcome).collect()
}

/// Watches the probes of a chunk.
struct OfChunk<'a> {
    /// Indices of the chunk's trials in all trials.
    chunk: &'a [usize],
    watch: &'a dyn ProbeWatch,
}

impl ProbeWatch for OfChunk<'_> {
    fn finished(&self, trial: usize, outcome: &Outcome) {
        self.watch.finished(self.chunk[trial], outcome);
    }

    fn is_cancelled(&self) -> bool {
        self.watch.is_cancelled()
    }
}

/// Runs one trial and returns its outcome, equal to the outcome in [`InProcess`], and the positions of the feet, m: the
/// start, then the position after every tick.
pub fn replay(context: &ProbeContext, trial: &Trial, seed: u64) -> (Outcome, Vec<Vec3>) {
    let reliance = Reliance::on(&context.map);
    let mut probes = Probes::new(context, &reliance, seed, trial.held);
    probes.start(0, trial);
    let mut track = vec![trial.start];
    loop {
        let finished = probes.decide(Some(&mut |worlds| {
            track.extend(worlds[0].npcs().map(|(_, npc)| npc.body.feet));
        }));
        if let Some((_, outcome)) = finished.into_iter().next() {
            return (outcome, track);
        }
    }
}

/// Runs the trials of a chunk, which share the held mover, and returns their outcomes; `None` if `watch` cancelled.
fn run_chunk(
    context: &ProbeContext,
    reliance: &Reliance,
    trials: &[Trial],
    seed: u64,
    watch: &dyn ProbeWatch,
) -> Option<Vec<Outcome>> {
    let mut probes = Probes::new(context, reliance, seed, trials.first().and_then(|trial| trial.held));
    let mut outcomes: Vec<Option<Outcome>> = vec![None; trials.len()];
    let mut waiting = trials.iter().enumerate();
    loop {
        while probes.running.len() < BATCH
            && let Some((at, trial)) = waiting.next()
        {
            if let Some(ride) = trial.ride {
                let outcome = run_ride(context, trial, ride, watch)?;
                watch.finished(at, &outcome);
                outcomes[at] = Some(outcome);
            } else {
                probes.start(at, trial);
            }
        }
        if probes.running.is_empty() {
            return outcomes.into_iter().collect();
        }
        if watch.is_cancelled() {
            return None;
        }
        for (at, outcome) in probes.decide(None) {
            watch.finished(at, &outcome);
            outcomes[at] = Some(outcome);
        }
    }
}

/// Runs a ride: the body stands still until the mover has reached the stop where the ride ends; `None` if `watch`
/// cancelled.
fn run_ride(context: &ProbeContext, trial: &Trial, ride: Ride, watch: &dyn ProbeWatch) -> Option<Outcome> {
    let mut world = context.world_for(Some(MoverAt { mover: ride.mover, stop: ride.from }));
    let mut outcome = Outcome::begin(trial.start);
    outcome.needs = Needs::of_ride(ride);
    let slot = world.spawn(trial.start, 0.0);
    world.order(ride.mover, MoverOrder::GoTo(ride.to));
    for tick in 1..=longest_ride_ticks(&context.map.movers()[ride.mover.idx()], ride) {
        if tick % TICKS_PER_DECISION == 0 && watch.is_cancelled() {
            return None;
        }
        world.tick();
        let npc = world.npc(slot).expect("just spawned");
        outcome.bounds = [outcome.bounds[0].min(npc.body.feet), outcome.bounds[1].max(npc.body.feet)];
        let has_arrived = world.movers()[ride.mover.idx()].at() == Some(ride.to);
        if npc.harm.is_some() || has_arrived {
            outcome.died = npc.harm.is_some();
            outcome.reached = has_arrived && npc.body.feet.distance(trial.goal) <= world.task().goal_radius;
            outcome.decisions = tick.div_ceil(TICKS_PER_DECISION);
            break;
        }
    }
    Some(outcome)
}

/// Called with the worlds after each tick.
pub(crate) type Watcher<'a> = dyn FnMut(&[World]) + 'a;

/// Trials that run together on one world.
pub(crate) struct Probes<'a> {
    policy: &'a Policy,
    seed: u64,
    worlds: [World; 1],
    running: Vec<Running>,
    decisions: DecisionLoop,
    reliance: &'a Reliance,
    /// The mover that is held at a stop.
    held: Option<MoverAt>,
    boarding: Option<Boarding>,
}

impl<'a> Probes<'a> {
    /// Prepares trials with the mover of `held` at its stop. `reliance` is computed for the map.
    pub(crate) fn new(context: &'a ProbeContext, reliance: &'a Reliance, seed: u64, held: Option<MoverAt>) -> Self {
        let policy = &context.policy;
        Self {
            policy,
            seed,
            worlds: [context.world_for(held)],
            running: Vec::new(),
            decisions: DecisionLoop::new(policy),
            reliance,
            held,
            boarding: Boarding::of(&context.map, held),
        }
    }

    fn start(&mut self, trial_idx: usize, trial: &Trial) {
        let style = style_of(trial, &self.worlds[0]);
        self.start_in_style(trial_idx, trial, style);
    }

    /// Starts a trial whose body moves in this style, and returns its slot in the world.
    pub(crate) fn start_in_style(&mut self, trial_idx: usize, trial: &Trial, style: Style) -> NpcSlot {
        let wait = self.boarding.map_or(0, |boarding| boarding.wait_from(trial.start));
        let started = Running::start(&mut self.worlds[0], trial_idx, (trial, style), self.seed, wait);
        let slot = started.slot;
        self.decisions.begin(DecidingNpc::of(slot).row_idx);
        self.running.push(started);
        slot
    }

    /// Whether no trial is running.
    pub(crate) fn are_done(&self) -> bool {
        self.running.is_empty()
    }

    /// Runs one decision of all running trials and returns the index and the outcome of each trial that ended. Calls
    /// `watch`, if there is one, after each tick.
    pub(crate) fn decide(&mut self, mut watch: Option<&mut Watcher<'_>>) -> Vec<(usize, Outcome)> {
        let npcs: Vec<DecidingNpc> =
            self.running.iter().map(|run| DecidingNpc::of(run.slot).in_style(run.probe.style)).collect();
        let noise = self.running.iter_mut().flat_map(|run| run.probe.noise()).collect();
        let mut batch = DecisionBatch { worlds: &mut self.worlds, npcs: &npcs };
        let noise = Noise::Rows(noise);
        let Self { reliance, running, .. } = self;
        let closed = if reliance.has_no_movers() && watch.is_none() {
            self.decisions.decide(&mut batch, self.policy, noise)
        } else {
            let note_tick = |worlds: &[World]| {
                running.iter_mut().for_each(|run| run.record_needs(&worlds[0], reliance));
                if let Some(watch) = &mut watch {
                    watch(worlds);
                }
            };
            self.decisions.decide_watched(&mut batch, self.policy, noise, note_tick)
        };
        let mut closed = closed.iter();
        let mut finished = Vec::new();
        let ([world], held) = (&mut self.worlds, self.held);
        self.running.retain_mut(|run| {
            if run.record(world, *closed.next().expect("an outcome for each NPC")) {
                return true;
            }
            world.despawn(run.slot);
            let mut outcome = run.probe.outcome.clone();
            // Trials with a held mover begin or end on it, also where a body would hardly notice that it is away.
            let held = held.map(|MoverAt { mover, stop }| Need { mover, stops: StopSet::only(stop) });
            held.into_iter().for_each(|need| outcome.needs.add(need));
            finished.push((run.trial_idx, outcome));
            false
        });
        finished
    }
}

/// The style in which the body of a trial moves.
fn style_of(trial: &Trial, world: &World) -> Style {
    let (map, profile, ends) = (world.map(), &world.config().profiles[0], [trial.start, trial.goal]);
    let course = Course::straight(trial.goal);
    match trial.manner {
        Manner::Free => Style::Free,
        Manner::OnFoot => Style::for_leg(Ability::WALK),
        Manner::Steered => {
            let cross = || Some(Style::Cross(Cross { approach: approach_between(map, profile, ends, None)?, course }));
            let leap = || Some(Style::Leap(Leap { rims: arrival::rims(map, profile, ends)?, course }));
            cross().or_else(leap).unwrap_or(Style::Walk(course))
        }
    }
}

/// One running trial in a simulated world.
struct Running {
    slot: NpcSlot,
    trial_idx: usize,
    arrival: Arrival,
    probe: RunningProbe,
}

impl Running {
    fn start(world: &mut World, trial_idx: usize, (trial, style): (&Trial, Style), seed: u64, wait: u32) -> Self {
        let (probe, Goal { start, yaw, goal }) = RunningProbe::begin(trial, seed, wait, &world.config().profiles[0]);
        let probe = RunningProbe { style, ..probe };
        let slot = world.spawn(start, yaw);
        world.head_for(slot, goal, trial.arrival);
        Self { slot, trial_idx, arrival: trial.arrival, probe }
    }

    /// Records the movers on which the body relies in this tick.
    fn record_needs(&mut self, world: &World, reliance: &Reliance) {
        let Some(npc) = world.npc(self.slot) else { return };
        let needs = &mut self.probe.outcome.needs;
        reliance.find_needs(world.map(), world.movers(), world.profile_of(npc), &npc.body, |mover, stops| {
            needs.add(Need { mover, stops });
        });
    }

    /// Records one decision and returns whether the trial continues.
    fn record(&mut self, world: &mut World, closed: DecisionOutcome) -> bool {
        let npc = world.npc(self.slot).expect("a trial has an NPC");
        let episode = npc.episode.expect("a trial has an episode");
        let report = DecisionReport {
            feet: npc.body.feet,
            is_grounded: npc.body.is_grounded(),
            ability: npc.used_abilities.most_demanding(),
            end: closed.end,
            stalled: episode.stalled_decisions,
            decisions: episode.decisions,
        };
        match self.probe.record(&report, &world.config().profiles[0]) {
            ProbeStep::Keep => true,
            ProbeStep::HeadFor(goal) => {
                world.head_for(self.slot, goal, self.arrival);
                true
            }
            ProbeStep::End => false,
        }
    }
}

/// A running trial, in a simulated world or in a game.
#[derive(Debug)]
pub struct RunningProbe {
    /// How the NPC moves.
    pub style: Style,
    /// The outcome so far.
    pub outcome: Outcome,
    keep_track: bool,
    /// Where the probe heads after the current place.
    next: Option<Vec3>,
    give_up_after: u32,
    rng: ChaCha8Rng,
    /// Decisions for which an NPC would wait before the leg.
    wait: u32,
}

/// The result of one decision of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecisionReport {
    /// Position of the feet, m.
    pub feet: Vec3,
    /// Whether the body stands on the ground.
    pub is_grounded: bool,
    /// The most demanding ability of the decision.
    pub ability: Ability,
    /// How the way to the current place ended, if it did.
    pub end: Option<End>,
    /// Decisions without a new smallest distance to that place.
    pub stalled: u32,
    /// Decisions on the way to that place.
    pub decisions: u32,
}

/// What follows a decision of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProbeStep {
    /// The NPC continues.
    Keep,
    /// The NPC heads for this place from now on, m.
    HeadFor(Vec3),
    /// The trial is over.
    End,
}

impl RunningProbe {
    /// Begins a trial with its random stream under `seed`, after `wait` decisions. Also returns where the NPC starts
    /// and heads first.
    pub fn begin(trial: &Trial, seed: u64, wait: u32, profile: &CharacterProfile) -> (Self, Goal) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(trial.stream);
        let yaw = random_yaw(&mut rng);
        let (goal, next) = trial.via.map_or((trial.goal, None), |via| (via, Some(trial.goal)));
        let mut outcome = Outcome::begin(trial.start);
        outcome.track.extend(trial.keep_track.then_some(Some(trial.start)));
        let style = if trial.manner == Manner::OnFoot { Style::for_leg(Ability::WALK) } else { Style::Free };
        let give_up_after = patience(trial.start, goal, profile);
        let probe = Self { style, outcome, keep_track: trial.keep_track, next, give_up_after, rng, wait };
        (probe, Goal { start: trial.start, yaw, goal })
    }

    /// Noise for the next action, in units of the policy's standard deviation.
    pub fn noise(&mut self) -> impl Iterator<Item = f32> + use<> {
        let share = DEFAULT_NOISE_SHARE * self.style.noise_share();
        let mut values = [0.0; ACTION_LEN];
        fill_gaussian(&mut self.rng, &mut values);
        values.into_iter().map(move |value| value * share)
    }

    /// Records one decision.
    pub fn record(&mut self, report: &DecisionReport, profile: &CharacterProfile) -> ProbeStep {
        let outcome = &mut self.outcome;
        outcome.ability = outcome.ability.max(report.ability);
        outcome.bounds = [outcome.bounds[0].min(report.feet), outcome.bounds[1].max(report.feet)];
        if self.keep_track {
            outcome.track.push(report.is_grounded.then_some(report.feet));
        }
        let gave_up = (report.stalled >= self.give_up_after).then_some(End::NoProgress);
        let Some(end) = report.end.or(gave_up) else { return ProbeStep::Keep };
        outcome.reached = end == End::Reached;
        outcome.died = end.is_harm();
        outcome.decisions = report.decisions + self.wait;
        let Some(next) = self.next.take() else { return ProbeStep::End };
        let approach = std::mem::replace(outcome, Outcome::begin(report.feet));
        self.wait = 0;
        let goes_on = approach.reached;
        outcome.approach = Some(Box::new(approach));
        if !goes_on {
            return ProbeStep::End;
        }
        self.give_up_after = patience(report.feet, next, profile);
        ProbeStep::HeadFor(next)
    }
}

/// Decisions without progress from `feet` towards `goal`, m, after which a probe has failed.
fn patience(feet: Vec3, goal: Vec3, profile: &CharacterProfile) -> u32 {
    let jumps = 1.0 + f32::from(profile.extra_jumps);
    let reach = jumps * profile.jump_speed * profile.jump_speed / (2.0 * profile.gravity);
    if goal.y - feet.y > reach { GIVE_UP_CLIMB_AFTER } else { GIVE_UP_AFTER }
}
