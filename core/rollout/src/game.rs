//! Attempts of NPCs whose bodies a game moves, with rehearsals in a copy of the level.
//!
//! A game's physics differs a little from ours. A forecast holds while the body keeps within [`SLACK_M`] of it; beyond
//! that, the NPC rehearses again. The game's proof of an edge overrules a rehearsal without progress on it: the NPC
//! then moves freely there. It also moves freely where it repeatedly fails to follow its forecasts. Rehearsals are
//! never evidence about edges. [`Rehearsals::set_pieces`] changes the copy as the game changes its level.
//!
//! For each decision, the game calls [`GameAttempt::record_decision`], then [`GameAttempt::prepare`] until that returns
//! [`Prepared::Act`]. docs/adr/0073-rehearsals-beside-a-game.md has measurements.

use crate::attempt::{AfterRehearsal, Attempt};
use crate::follow::{Follower, Step};
use crate::rehearse::{Forecast, NoiseStream, Rehearsal, RehearsalFailure};
use crate::style::Style;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError, RwLock, Weak};
use std::thread::JoinHandle;
use surefoot_planner::{LegKey, Plan, Query};
use surefoot_policy::Policy;
use surefoot_world::map::{Piece, PieceError};
use surefoot_world::{CharacterProfile, End, Gait, Map, MoverState, Npc, TaskConfig, Vec3, World};

/// Greatest distance between a body in a game and its forecast at which the forecast holds, m.
pub const SLACK_M: f32 = 0.4;
/// Most decisions for which a standing NPC waits for a rehearsal.
const HOLD_DECISIONS: u32 = 9;
/// Most decisions that an NPC carries out in the rehearsed style before the result is there; then it moves freely.
const MAX_AHEAD: u32 = 3;
/// Forecasts that fail around one place before the NPC moves freely to the end of its leg.
const MAX_DIVERGENCES: u32 = 3;
/// Radius of that place, m.
const DIVERGENCE_M: f32 = 1.0;
/// Distance within which an NPC's goal counts as its waypoint, m, because games round positions.
const SAME_M: f32 = 0.01;
/// How far an NPC that waits may drift before it returns, m.
const HOLD_WITHIN_M: f32 = 1.0;
/// Distance from a leg within which a piece may be in the way, m.
const IN_THE_WAY_M: f32 = 2.0;

/// Rehearses legs for the NPCs of a game, on threads of its own or in the calls of [`GameAttempt::prepare`]. The NPCs
/// share a level, a body and a policy.
#[derive(Debug)]
pub struct Rehearsals {
    stage: Arc<Stage>,
    /// The level with its pieces.
    map: RwLock<Arc<Map>>,
    /// Where jobs go; `None` without threads.
    jobs: Option<Sender<Job>>,
    threads: Vec<JoinHandle<()>>,
    in_calls: Mutex<Rehearsal>,
}

/// What all rehearsals share.
#[derive(Debug)]
struct Stage {
    profile: CharacterProfile,
    policy: Policy,
    /// The movers in their initial state.
    movers: Vec<MoverState>,
}

/// Rehearsals of one NPC, until one ends well or it needs another plan.
#[derive(Debug)]
struct Job {
    map: Arc<Map>,
    attempt: Attempt,
    npc: Npc,
    hidden: Vec<f32>,
    noise: NoiseStream,
    /// Where the results go; gone once the attempt no longer needs them.
    results: Weak<Results>,
}

/// Results, once there are any.
type Results = Mutex<Option<Rehearsed>>;

/// How the rehearsals of a job ended.
#[derive(Debug)]
struct Rehearsed {
    /// The failures. After each one except the last, the NPC tried again on the same plan.
    failures: Vec<RehearsalFailure>,
    /// The forecast, if the last rehearsal ended well.
    forecast: Option<Forecast>,
    /// What the attempt needs next.
    then: AfterRehearsal,
}

impl Rehearsals {
    /// Prepares rehearsals on `map` of the body `profile`, on `thread_count` threads. With 0 threads, rehearsals run in
    /// the calls of [`GameAttempt::prepare`], and equal calls give equal results.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, policy: &Policy, thread_count: usize) -> Self {
        let movers = World::new(map.clone(), profile.clone(), TaskConfig::default()).movers().to_vec();
        let stage = Arc::new(Stage { profile, policy: policy.clone(), movers });
        let (jobs, queue) = channel();
        let queue = Arc::new(Mutex::new(queue));
        let thread = |_| {
            let (stage, queue, map) = (stage.clone(), queue.clone(), map.clone());
            std::thread::spawn(move || stage.serve(map, &queue))
        };
        let threads = (0..thread_count).map(thread).collect();
        let in_calls = Mutex::new(stage.rehearsal(map.clone()));
        Self { jobs: (thread_count > 0).then_some(jobs), threads, in_calls, stage, map: RwLock::new(map) }
    }

    /// The level with its pieces.
    pub fn map(&self) -> Arc<Map> {
        self.map.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Puts exactly these pieces onto the level. If that changes it, all NPCs need another plan.
    ///
    /// # Errors
    /// If a piece is not valid, or there are too many. The pieces then stay as they are.
    pub fn set_pieces(&self, mut pieces: Vec<Piece>) -> Result<(), PieceError> {
        // Maps compare pieces in the order of their names.
        pieces.sort_by(|one, other| one.name.cmp(&other.name));
        let mut map = self.map.write().unwrap_or_else(PoisonError::into_inner);
        *map = map.holding(&pieces)?;
        Ok(())
    }

    /// The policy.
    pub fn policy(&self) -> &Policy {
        &self.stage.policy
    }

    /// The body.
    pub fn profile(&self) -> &CharacterProfile {
        &self.stage.profile
    }

    fn submit(&self, job: Job) {
        match &self.jobs {
            // The threads live as long as this handle, so the queue is open.
            Some(jobs) => _ = jobs.send(job),
            None => {
                let mut rehearsal = self.in_calls.lock().unwrap_or_else(PoisonError::into_inner);
                self.stage.run(&mut rehearsal, job);
            }
        }
    }
}

impl Drop for Rehearsals {
    fn drop(&mut self) {
        self.jobs = None;
        for thread in self.threads.drain(..) {
            // An error means that the thread panicked, so it has ended as well.
            let _ = thread.join();
        }
    }
}

impl Stage {
    fn rehearsal(&self, map: Arc<Map>) -> Rehearsal {
        Rehearsal::new(map, self.profile.clone(), TaskConfig::default(), &self.policy)
    }

    /// Runs jobs until the queue is closed.
    fn serve(&self, map: Arc<Map>, queue: &Mutex<Receiver<Job>>) {
        let mut rehearsal = self.rehearsal(map);
        loop {
            let job = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
            let Ok(job) = job else { return };
            // Each attempt has at most one wanted job, which bounds the work in the queue.
            if job.results.strong_count() > 0 {
                self.run(&mut rehearsal, job);
            }
        }
    }

    fn run(&self, rehearsal: &mut Rehearsal, job: Job) {
        let Job { map, mut attempt, npc, hidden, mut noise, results } = job;
        if !Arc::ptr_eq(rehearsal.map(), &map) {
            *rehearsal = self.rehearsal(map);
        }
        let (mut failures, mut forecast) = (Vec::new(), None);
        loop {
            let start = attempt.rehearsal(npc, hidden.clone(), noise);
            let result = rehearsal.run(&self.policy, vec![start], &self.movers).remove(0);
            match result.clone() {
                Ok(found) => forecast = Some(found),
                Err(failure) => failures.push(failure),
            }
            let then = attempt.record_rehearsal(result, &mut noise);
            if then != AfterRehearsal::Rehearse {
                // The NPC may be gone.
                if let Some(results) = results.upgrade() {
                    let ended = Some(Rehearsed { failures, forecast, then });
                    *results.lock().unwrap_or_else(PoisonError::into_inner) = ended;
                }
                return;
            }
        }
    }
}

/// What an NPC of a game does next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prepared {
    /// It carries out its next decision in this style.
    Act(Style),
    /// It heads for this waypoint from now on, m. Then call [`GameAttempt::prepare`] again.
    HeadFor(Vec3),
    /// It needs another plan. Then call [`GameAttempt::prepare`] again.
    Plan,
}

/// An attempt of an NPC of a game.
#[derive(Debug)]
pub struct GameAttempt {
    attempt: Attempt,
    pending: Option<Pending>,
    /// Whether the body was compared with its forecast since the last decision.
    is_compared: bool,
    /// Whether the NPC carried out the last decision instead of waiting.
    has_acted: bool,
    /// Whether the plan was made because rehearsals of the last one failed.
    is_retrying: bool,
    /// Index of the leg from which on the NPC rehearses; it moves freely on the legs before.
    free_until: usize,
    diverged: Diverged,
    /// The level on which the NPC prepared its last decision.
    map: Option<Arc<Map>>,
}

/// Forecasts that failed one after another.
#[derive(Debug, Clone, Copy, Default)]
struct Diverged {
    /// Where the first one failed, m.
    at: Vec3,
    count: u32,
}

/// A rehearsal that is under way.
#[derive(Debug)]
struct Pending {
    results: Arc<Results>,
    /// Decisions that the NPC carried out since the rehearsal began.
    acted: u32,
    /// Decisions for which it waited.
    held: u32,
}

impl Clone for GameAttempt {
    /// A copy without the rehearsal that is under way; it begins one of its own.
    fn clone(&self) -> Self {
        let mut attempt = self.attempt.clone();
        if self.pending.is_some() {
            attempt.extend_forecast();
        }
        Self { attempt, pending: None, map: self.map.clone(), ..*self }
    }
}

impl GameAttempt {
    /// Starts an attempt, which rehearses before its first decision.
    pub fn new(follower: Follower) -> Self {
        let attempt = Attempt::new(follower).with_slack(SLACK_M);
        let (is_compared, has_acted, is_retrying) = (true, false, false);
        Self {
            attempt,
            pending: None,
            is_compared,
            has_acted,
            is_retrying,
            free_until: 0,
            diverged: Diverged::default(),
            map: None,
        }
    }

    /// The plan and the progress along it.
    pub fn follower(&self) -> &Follower {
        &self.attempt.follower
    }

    /// Like `follower`, but mutable.
    pub fn follower_mut(&mut self) -> &mut Follower {
        &mut self.attempt.follower
    }

    /// Plans from `feet`, m, with `search`, and returns the first waypoint of the plan, m.
    pub fn plan(&mut self, feet: Vec3, search: impl FnMut(&Query) -> Plan) -> Vec3 {
        (self.pending, self.is_compared, self.free_until) = (None, true, 0);
        self.attempt.plan(feet, search)
    }

    /// Moves the goal of the attempt, m, and returns the waypoint, m, if that has changed.
    pub fn follow_goal(&mut self, goal: Vec3, feet: Vec3, has_arrived: bool) -> Option<Vec3> {
        let waypoint = self.attempt.follow_goal(goal, feet, has_arrived);
        if waypoint.is_some() {
            self.pending = None;
        }
        waypoint
    }

    /// Changes the gait. Returns whether the NPC needs another plan, because it would now take another route.
    pub fn set_gait(&mut self, gait: Gait) -> bool {
        if gait != self.attempt.follower.gait() {
            self.pending = None;
        }
        self.attempt.set_gait(gait)
    }

    /// Records one decision: see [`Follower::record_decision`].
    pub fn record_decision(&mut self, feet: Vec3, leg_end: Option<End>) -> Step {
        self.is_compared = false;
        let step = self.attempt.follower.record_decision(feet, leg_end);
        if matches!(step, Step::HeadFor(_)) {
            self.attempt.extend_forecast();
        }
        step
    }

    /// Prepares the next decision of `npc`. Its position is on the map of the rehearsals, and its goal is its waypoint.
    /// `hidden` is its row of the policy's hidden state.
    pub fn prepare(&mut self, on: &Rehearsals, npc: &Npc, hidden: &[f32], noise: &mut NoiseStream) -> Prepared {
        let (map, profile) = (&on.map(), on.profile());
        let former = self.map.replace(map.clone());
        let is_changed = former.is_some_and(|former| !Arc::ptr_eq(&former, map));
        let Some(waypoint) = self.attempt.follower.waypoint().filter(|_| !is_changed) else { return Prepared::Plan };
        let mut npc = *npc;
        if let Some(episode) = npc.episode.as_mut().filter(|episode| episode.goal.distance(waypoint) <= SAME_M) {
            (episode.goal, episode.arrival) = (waypoint, self.attempt.follower.arrival());
        }
        let npc = &npc;
        self.compare(map, profile, npc);
        if self.attempt.review(map, profile, &npc.body, |_, _| true) {
            return Prepared::Plan;
        }
        if !self.is_free(npc) {
            self.attempt.skip_plain_rehearsal(map, profile, &npc.body);
            self.rehearse((on, map), npc, hidden, *noise);
            if self.collect(npc, noise) == Some(AfterRehearsal::Plan) {
                return Prepared::Plan;
            }
        }
        if let Some(waypoint) = self.attempt.changed_waypoint(npc) {
            return Prepared::HeadFor(waypoint);
        }
        let holds = self.holds(npc);
        self.has_acted = !holds;
        Prepared::Act(if self.is_free(npc) {
            Style::Free
        } else if holds {
            Style::Stay { at: npc.body.feet, within: HOLD_WITHIN_M }
        } else if self.pending.as_ref().is_some_and(|it| it.acted < MAX_AHEAD) && !self.attempt.is_forecast() {
            // The style that is being rehearsed, so that the forecast covers this decision as well.
            self.attempt.follower.style()
        } else {
            self.attempt.style(map, profile, &npc.body)
        })
    }

    /// Compares the body with its forecast, once for each decision. An NPC that has left its forecast returns to its
    /// route.
    fn compare(&mut self, map: &Map, profile: &CharacterProfile, npc: &Npc) {
        if std::mem::replace(&mut self.is_compared, true) {
            return;
        }
        if let Some(pending) = &mut self.pending {
            *(if self.has_acted { &mut pending.acted } else { &mut pending.held }) += 1;
        }
        if !self.has_acted {
            return;
        }
        let was_forecast = self.attempt.is_forecast();
        if self.attempt.check_forecast(&npc.body) {
            return;
        }
        if was_forecast {
            self.note_divergence(npc.body.feet);
        }
        if npc.body.is_grounded() {
            self.attempt.follower.return_to_way(map, profile, npc.body.feet);
        }
    }

    /// Notes that a forecast has failed. After [`MAX_DIVERGENCES`] of them the NPC moves freely.
    fn note_divergence(&mut self, feet: Vec3) {
        let Diverged { at, count } = &mut self.diverged;
        if *count == 0 || at.distance(feet) > DIVERGENCE_M {
            (*at, *count) = (feet, 0);
        }
        *count += 1;
        if *count >= MAX_DIVERGENCES {
            self.diverged = Diverged::default();
            self.free_until = self.attempt.follower.leg_idx() + 1;
        }
    }

    /// Begins a rehearsal if one is due and none is under way.
    fn rehearse(&mut self, (on, map): (&Rehearsals, &Arc<Map>), npc: &Npc, hidden: &[f32], noise: NoiseStream) {
        if self.pending.is_some() || !self.attempt.is_due() {
            return;
        }
        if !std::mem::take(&mut self.is_retrying) {
            self.attempt.begin_rehearsals();
        }
        let results = Arc::new(Results::default());
        let (map, attempt, hidden) = (map.clone(), self.attempt.clone(), hidden.to_vec());
        on.submit(Job { map, attempt, npc: *npc, hidden, noise, results: Arc::downgrade(&results) });
        self.pending = Some(Pending { results, acted: 0, held: 0 });
    }

    /// Takes the results of the rehearsal that is under way, if it has ended.
    fn collect(&mut self, npc: &Npc, noise: &mut NoiseStream) -> Option<AfterRehearsal> {
        let Pending { results, acted, .. } = self.pending.as_ref()?;
        let (rehearsed, acted) = (results.lock().unwrap_or_else(PoisonError::into_inner).take(), *acted);
        let Rehearsed { mut failures, forecast, then } = rehearsed?;
        self.pending = None;
        let last = failures.last().copied().filter(|_| forecast.is_none());
        let is_proved = |leg: LegKey| leg.edge().is_some() && !self.is_altered(leg, npc.body.feet);
        let is_trusted = last.is_some_and(|last| then == AfterRehearsal::End || !last.is_harm && is_proved(last.leg));
        if is_trusted {
            failures.pop();
        }
        let run = self.attempt.follower.take_traversals();
        // Repeat what the rehearsals did to their copy of the attempt.
        for failure in failures {
            self.attempt.record_rehearsal(Err(failure), noise);
        }
        if let Some(forecast) = forecast {
            self.attempt.record_rehearsal(Ok(forecast), noise);
            self.attempt.catch_up(acted, &npc.body);
        }
        self.attempt.follower.set_traversals(run);
        let trusted = last.filter(|_| is_trusted).zip(self.attempt.follower.current_plan());
        if let Some((failure, plan)) = trusted {
            let failed = plan.legs.iter().rposition(|leg| leg.key == failure.leg);
            self.free_until = failed.unwrap_or(self.attempt.follower.leg_idx()) + 1;
            return Some(AfterRehearsal::Act);
        }
        self.is_retrying = then == AfterRehearsal::Plan;
        Some(then)
    }

    /// Whether a piece may be in the way of a leg of the plan, so that the game's proof of its edge no longer counts.
    fn is_altered(&self, key: LegKey, feet: Vec3) -> bool {
        let Some((map, plan)) = self.map.as_ref().zip(self.attempt.follower.current_plan()) else { return false };
        let Some(idx) = plan.legs.iter().rposition(|leg| leg.key == key) else { return false };
        let to = plan.waypoints[idx];
        let from = idx.checked_sub(1).map_or(feet, |before| plan.waypoints[before]);
        let (low, high) = (from.min(to) - IN_THE_WAY_M, from.max(to) + IN_THE_WAY_M);
        let is_near = |piece: &Piece| {
            let (lowest, highest) = piece.bounds();
            lowest.cmple(high).all() && highest.cmpge(low).all()
        };
        map.pieces().iter().any(is_near)
    }

    /// Whether the NPC moves freely without a rehearsal: on legs before `free_until`, and on rides, because games do
    /// not report their state.
    fn is_free(&mut self, npc: &Npc) -> bool {
        let is_free = npc.body.is_carried() || self.attempt.follower.leg_idx() < self.free_until;
        if is_free {
            self.pending = None;
            self.attempt.forget_forecast();
        }
        is_free
    }

    /// Whether an NPC that stands waits for its rehearsal.
    fn holds(&self, npc: &Npc) -> bool {
        let waits = self.pending.as_ref().is_some_and(|pending| pending.held < HOLD_DECISIONS);
        waits && !self.attempt.is_forecast() && npc.body.is_at_rest()
    }
}
