//! Attempts of NPCs whose bodies a game moves, with rehearsals in a copy of the level.
//!
//! A game's physics differs a little from ours: a forecast holds while the body keeps within [`SLACK_M`] of it, and
//! beyond that the NPC rehearses again. For each decision the game calls [`GameAttempt::record_decision`], then
//! [`GameAttempt::prepare`] until it says how to act. docs/adr/0073-rehearsals-beside-a-game.md has measurements.

use crate::attempt::{AfterRehearsal, Attempt};
use crate::follow::{Follower, Step};
use crate::rehearse::{Forecast, NoiseStream, Rehearsal, RehearsalFailure};
use crate::style::Style;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use surefoot_planner::{Plan, Query};
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, End, Map, MoverState, Npc, TaskConfig, Vec3, World};

/// Distance between a body in a game and its forecast up to which the forecast holds, m.
pub const SLACK_M: f32 = 0.4;
/// Decisions for which an NPC that stands waits for a rehearsal.
const HOLD_DECISIONS: u32 = 9;
/// How far an NPC that waits may drift before it returns, m.
const HOLD_WITHIN_M: f32 = 1.0;

/// Rehearses legs for the NPCs of a game, which share a level, a body and a policy: on threads of its own, or in the
/// calls of [`GameAttempt::prepare`].
#[derive(Debug)]
pub struct Rehearsals {
    stage: Arc<Stage>,
    /// Where jobs go; `None` without threads.
    jobs: Option<Sender<Job>>,
    threads: Vec<JoinHandle<()>>,
    in_calls: Mutex<Rehearsal>,
}

/// What all rehearsals share.
#[derive(Debug)]
struct Stage {
    map: Arc<Map>,
    profile: CharacterProfile,
    policy: Policy,
    /// The movers as the level begins.
    movers: Vec<MoverState>,
}

/// Rehearsals of one NPC, until one ends well or it needs another plan.
#[derive(Debug)]
struct Job {
    attempt: Attempt,
    npc: Npc,
    hidden: Vec<f32>,
    noise: NoiseStream,
    reply: Sender<Results>,
}

/// How the rehearsals of a job ended, in order: the last one ended well, or it has no retry on the same plan.
type Results = Vec<Result<Forecast, RehearsalFailure>>;

impl Rehearsals {
    /// Prepares rehearsals on `map` by the body `profile`, on `thread_count` threads; without threads they run in the
    /// calls, and are as deterministic as those.
    pub fn new(map: Arc<Map>, profile: CharacterProfile, policy: &Policy, thread_count: usize) -> Self {
        let movers = World::new(map.clone(), profile.clone(), TaskConfig::default()).movers().to_vec();
        let stage = Arc::new(Stage { map, profile, policy: policy.clone(), movers });
        let (jobs, queue) = channel();
        let queue = Arc::new(Mutex::new(queue));
        let thread = |_| {
            let (stage, queue) = (stage.clone(), queue.clone());
            std::thread::spawn(move || stage.serve(&queue))
        };
        let threads = (0..thread_count).map(thread).collect();
        let in_calls = Mutex::new(stage.rehearsal());
        Self { jobs: (thread_count > 0).then_some(jobs), threads, in_calls, stage }
    }

    /// The level.
    pub fn map(&self) -> &Arc<Map> {
        &self.stage.map
    }

    /// The body.
    pub fn profile(&self) -> &CharacterProfile {
        &self.stage.profile
    }

    fn submit(&self, job: Job) {
        match &self.jobs {
            // The threads end with this handle, so that the queue is open.
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
            // A thread that panicked has nothing left to end.
            let _ = thread.join();
        }
    }
}

impl Stage {
    fn rehearsal(&self) -> Rehearsal {
        Rehearsal::new(self.map.clone(), self.profile.clone(), TaskConfig::default(), &self.policy)
    }

    /// Runs jobs until the queue is closed.
    fn serve(&self, queue: &Mutex<Receiver<Job>>) {
        let mut rehearsal = self.rehearsal();
        loop {
            let job = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
            let Ok(job) = job else { return };
            self.run(&mut rehearsal, job);
        }
    }

    fn run(&self, rehearsal: &mut Rehearsal, job: Job) {
        let Job { mut attempt, npc, hidden, mut noise, reply } = job;
        let mut results = Results::new();
        loop {
            let start = attempt.rehearsal(npc, hidden.clone(), noise);
            let result = rehearsal.run(&self.policy, vec![start], &self.movers).remove(0);
            results.push(result.clone());
            if attempt.record_rehearsal(result, &mut noise) != AfterRehearsal::Rehearse {
                // The NPC may be gone.
                let _ = reply.send(results);
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
    /// It heads for this waypoint from now on, m; then it prepares again.
    HeadFor(Vec3),
    /// It needs another plan; then it prepares again.
    Plan,
    /// Its attempt ends.
    End(End),
}

/// An attempt of an NPC of a game.
#[derive(Debug)]
pub struct GameAttempt {
    attempt: Attempt,
    pending: Option<Pending>,
    /// Whether the body was compared with its forecast since the last decision.
    is_compared: bool,
    /// Whether the NPC carried out the last decision, and did not wait.
    has_acted: bool,
    /// Whether the plan was made because rehearsals of the last one failed.
    is_retrying: bool,
}

/// A rehearsal that is under way.
#[derive(Debug)]
struct Pending {
    results: Receiver<Results>,
    /// Decisions since it began that were carried out, and those for which the NPC waited.
    acted: u32,
    held: u32,
}

impl Clone for GameAttempt {
    /// A copy without the rehearsal that is under way; it begins one of its own.
    fn clone(&self) -> Self {
        let mut attempt = self.attempt.clone();
        if self.pending.is_some() {
            attempt.extend_forecast();
        }
        Self { attempt, pending: None, ..*self }
    }
}

impl GameAttempt {
    /// Starts an attempt, which rehearses before its first decision.
    pub fn new(follower: Follower) -> Self {
        let attempt = Attempt::new(follower).with_slack(SLACK_M);
        Self { attempt, pending: None, is_compared: true, has_acted: false, is_retrying: false }
    }

    /// The plan and the progress along it.
    pub fn follower(&self) -> &Follower {
        &self.attempt.follower
    }

    /// The same, to be changed.
    pub fn follower_mut(&mut self) -> &mut Follower {
        &mut self.attempt.follower
    }

    /// Plans from `feet`, m, with `search`, and returns the first waypoint of the plan, m.
    pub fn plan(&mut self, feet: Vec3, search: impl FnMut(&Query) -> Plan) -> Vec3 {
        (self.pending, self.is_compared) = (None, true);
        self.attempt.plan(feet, search)
    }

    /// Follows a goal that may have moved, m; returns the waypoint, m, if it has changed.
    pub fn follow_goal(&mut self, goal: Vec3, feet: Vec3, has_arrived: bool) -> Option<Vec3> {
        let waypoint = self.attempt.follow_goal(goal, feet, has_arrived);
        if waypoint.is_some() {
            self.pending = None;
        }
        waypoint
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

    /// Prepares the next decision of `npc`, which is on the map of the rehearsals and heads for its waypoint. `hidden`
    /// is its row of the policy's hidden state.
    pub fn prepare(&mut self, on: &Rehearsals, npc: &Npc, hidden: &[f32], noise: &mut NoiseStream) -> Prepared {
        let Stage { map, profile, .. } = &*on.stage;
        if self.attempt.follower.waypoint().is_none() {
            return Prepared::Plan;
        }
        self.compare(map, profile, npc);
        // Rides have a state that games do not tell.
        if npc.body.is_carried() {
            self.pending = None;
            self.attempt.forget_forecast();
            self.has_acted = true;
            return Prepared::Act(Style::Free);
        }
        if self.attempt.review(map, profile, &npc.body, |_, _| true) {
            return Prepared::Plan;
        }
        self.attempt.skip_plain_rehearsal(map, profile, &npc.body);
        self.rehearse(on, npc, hidden, *noise);
        match self.collect(npc, noise) {
            Some(AfterRehearsal::Plan) => return Prepared::Plan,
            Some(AfterRehearsal::End) => return Prepared::End(End::Unreachable),
            _ => {}
        }
        if let Some(waypoint) = self.attempt.changed_waypoint(npc) {
            return Prepared::HeadFor(waypoint);
        }
        let holds = self.holds(npc);
        self.has_acted = !holds;
        Prepared::Act(if holds {
            Style::Stay { at: npc.body.feet, within: HOLD_WITHIN_M }
        } else if self.pending.is_some() && !self.attempt.is_forecast() {
            // The way in which it is being rehearsed, so that the rehearsal forecasts this decision as well.
            self.attempt.follower.style()
        } else {
            self.attempt.style(map, profile, &npc.body)
        })
    }

    /// Compares the body with its forecast, once for each decision. An NPC off its forecast returns to its way.
    fn compare(&mut self, map: &Map, profile: &CharacterProfile, npc: &Npc) {
        if std::mem::replace(&mut self.is_compared, true) {
            return;
        }
        if let Some(pending) = &mut self.pending {
            *(if self.has_acted { &mut pending.acted } else { &mut pending.held }) += 1;
        }
        if self.has_acted && !self.attempt.check_forecast(&npc.body) && npc.body.is_grounded() {
            self.attempt.follower.return_to_way(map, profile, npc.body.feet);
        }
    }

    /// Begins a rehearsal if one is due and none is under way.
    fn rehearse(&mut self, on: &Rehearsals, npc: &Npc, hidden: &[f32], noise: NoiseStream) {
        if self.pending.is_some() || !self.attempt.is_due() {
            return;
        }
        if !std::mem::take(&mut self.is_retrying) {
            self.attempt.begin_rehearsals();
        }
        let (reply, results) = channel();
        self.pending = Some(Pending { results, acted: 0, held: 0 });
        on.submit(Job { attempt: self.attempt.clone(), npc: *npc, hidden: hidden.to_vec(), noise, reply });
    }

    /// Takes the results of the rehearsal that is under way, if it has ended.
    fn collect(&mut self, npc: &Npc, noise: &mut NoiseStream) -> Option<AfterRehearsal> {
        let pending = self.pending.as_ref()?;
        let results = match pending.results.try_recv() {
            Ok(results) => results,
            Err(TryRecvError::Empty) => return None,
            // Its thread has panicked.
            Err(TryRecvError::Disconnected) => Results::new(),
        };
        let acted = pending.acted;
        self.pending = None;
        // What the rehearsal did to its copy of the attempt.
        let outcome = results.into_iter().map(|result| self.attempt.record_rehearsal(result, noise)).last()?;
        match outcome {
            AfterRehearsal::Act => self.attempt.catch_up(acted, &npc.body),
            AfterRehearsal::Plan => self.is_retrying = true,
            AfterRehearsal::Rehearse | AfterRehearsal::End => {}
        }
        Some(outcome)
    }

    /// Whether an NPC that stands waits for its rehearsal.
    fn holds(&self, npc: &Npc) -> bool {
        let waits = self.pending.as_ref().is_some_and(|pending| pending.held < HOLD_DECISIONS);
        waits && !self.attempt.is_forecast() && npc.body.is_at_rest()
    }
}
