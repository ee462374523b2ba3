//! Probes candidate edges in a game: the policy runs there, many trials at a time.
//!
//! Every trial has the same heading, noise and patience as in a simulated world ([`RunningProbe`]), so a game with the
//! same physics proves the same edges. Edges that depend on movers are not proved: the contract does not report movers.

use super::drive::{Deciding, Drive, seen};
use super::link::{Game, GameError, Level};
use parking_lot::Mutex;
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner::threads::map_indices;
use surefoot_planner::{BuildError, BuildSettings, Progress, Rehearsed};
use surefoot_policy::Policy;
use surefoot_rollout::env::Route;
use surefoot_rollout::graphs;
use surefoot_rollout::probe::{DecisionReport, ProbeStep, RunningProbe};
use surefoot_rollout::style::npc_of;
use surefoot_rollout::{Goal, InProcess, ProbeContext};
use surefoot_world::{End, Episode, TaskConfig};

/// NPCs of one environment.
const SLOTS: usize = 128;
/// Fewest trials of an environment, unless there are fewer in all.
const MIN_CHUNK: usize = 64;
/// Most trials of an environment, so that environments are short-lived.
const MAX_CHUNK: usize = 1024;

/// Runs probes in a game.
#[derive(Debug)]
pub struct InGame<'a> {
    game: &'a Game,
    level: Level,
    policy: &'a Policy,
    /// Environments that run at once, at least 1.
    env_count: usize,
    /// Why the game failed.
    error: Mutex<Option<GameError>>,
}

/// Why a graph cannot be proved in a game.
#[derive(Debug, thiserror::Error)]
pub enum InGameError {
    /// The game failed.
    #[error(transparent)]
    Game(#[from] GameError),
    /// The level has no ground, or the build was cancelled.
    #[error(transparent)]
    Build(#[from] BuildError),
}

/// Builds a graph of the level of `context`. Characters of our own prove a draft; `game` proves again what plans use of
/// it, in `env_count` environments at once. Exhaustive probing proves all edges in the game.
///
/// # Errors
/// If the game fails, the level has no navigable ground, or `progress.cancel` was set.
pub fn build(
    game: &Game,
    context: &ProbeContext,
    settings: &BuildSettings,
    env_count: usize,
    progress: &Progress,
) -> Result<Rehearsed, InGameError> {
    let executor = InGame::new(game, context, env_count);
    let rehearsal = Rehearsal(InProcess { context: context.clone(), thread_count: env_count });
    let built = graphs::build_rehearsed_by([&executor, &rehearsal], context, settings, env_count, progress);
    executor.take_error().map_or(Ok(()), Err)?;
    Ok(built?)
}

impl<'a> InGame<'a> {
    /// Prepares probes on the level of `context`, in `env_count` environments at once.
    pub fn new(game: &'a Game, context: &'a ProbeContext, env_count: usize) -> Self {
        let level = Level { map: context.map.clone(), body: context.profile.clone(), solid_npcs: false };
        Self { game, level, policy: &context.policy, env_count: env_count.max(1), error: Mutex::default() }
    }

    /// The failure of the game that ended the last run early.
    pub fn take_error(&self) -> Option<GameError> {
        self.error.lock().take()
    }

    fn has_failed(&self) -> bool {
        self.error.lock().is_some()
    }

    /// Runs the trials from index `first`, and returns their outcomes; `None` if `watch` cancelled, or the game failed
    /// in another environment.
    fn run_chunk(
        &self,
        (first, trials): (usize, &[Trial]),
        seed: u64,
        watch: &dyn ProbeWatch,
    ) -> Result<Option<Vec<Outcome>>, GameError> {
        let can_run = |trial: &Trial| trial.ride.is_none() && trial.held.is_none();
        let (runnable, others): (Vec<usize>, Vec<usize>) = (0..trials.len()).partition(|idx| can_run(&trials[*idx]));
        let mut outcomes: Vec<Outcome> = trials.iter().map(|trial| Outcome::begin(trial.start)).collect();
        others.into_iter().for_each(|idx| watch.finished(first + idx, &outcomes[idx]));
        if runnable.is_empty() {
            return Ok(Some(outcomes));
        }
        let mut runner = TrialRunner::begin(self, trials, runnable, seed)?;
        while runner.slots.iter().any(Option::is_some) {
            if watch.is_cancelled() || self.has_failed() {
                return Ok(None);
            }
            for (idx, outcome) in runner.decide()? {
                watch.finished(first + idx, &outcome);
                outcomes[idx] = outcome;
            }
        }
        Ok(Some(outcomes))
    }
}

impl ProbeExecutor for InGame<'_> {
    fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let chunk_len = trials.len().div_ceil(4 * self.env_count).clamp(MIN_CHUNK, MAX_CHUNK);
        let chunks: Vec<&[Trial]> = trials.chunks(chunk_len).collect();
        let results = map_indices(chunks.len(), self.env_count, |idx| {
            if self.has_failed() {
                return None;
            }
            let outcomes = self.run_chunk((idx * chunk_len, chunks[idx]), seed, watch);
            outcomes.unwrap_or_else(|error| {
                self.error.lock().get_or_insert(error);
                None
            })
        });
        Some(results.into_iter().collect::<Option<Vec<_>>>()?.into_iter().flatten().collect())
    }

    fn steers_leaps(&self) -> bool {
        false
    }
}

/// Characters of our own, moved as those of the game are: by their policy alone.
struct Rehearsal(InProcess);

impl ProbeExecutor for Rehearsal {
    fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        self.0.run(trials, seed, watch)
    }

    fn steers_leaps(&self) -> bool {
        false
    }
}

/// The NPCs of one environment. Each runs one trial after another.
struct TrialRunner<'a> {
    run: &'a InGame<'a>,
    trials: &'a [Trial],
    seed: u64,
    drive: Drive<'a>,
    slots: Vec<Option<TrialSlot>>,
    waiting: std::vec::IntoIter<usize>,
    /// Routes that go with the next step.
    routes: Vec<Route>,
    task: TaskConfig,
}

/// A trial of an NPC.
struct TrialSlot {
    trial_idx: usize,
    probe: RunningProbe,
    /// The way to the current place.
    episode: Episode,
    /// Places of its route that it had passed before the last step.
    passed: u32,
    /// Whether the NPC is put at its start after the next step.
    is_arriving: bool,
}

impl TrialSlot {
    fn begin(run: &InGame<'_>, trials: &[Trial], trial_idx: usize, seed: u64) -> (Self, Goal) {
        let (probe, goal) = RunningProbe::begin(&trials[trial_idx], seed, 0, &run.level.body);
        let episode = Episode::new(goal.goal, goal.start);
        (Self { trial_idx, probe, episode, passed: 0, is_arriving: false }, goal)
    }
}

impl<'a> TrialRunner<'a> {
    /// Puts NPCs at the starts of the first trials, at least one.
    fn begin(run: &'a InGame<'a>, trials: &'a [Trial], which: Vec<usize>, seed: u64) -> Result<Self, GameError> {
        let mut waiting = which.into_iter();
        let (slots, goals): (Vec<TrialSlot>, Vec<Goal>) =
            waiting.by_ref().take(SLOTS).map(|idx| TrialSlot::begin(run, trials, idx, seed)).unzip();
        let routes = (0..).zip(&slots).filter_map(|(npc_idx, slot)| route(npc_idx, &trials[slot.trial_idx], None));
        let routes = routes.collect();
        let env = run.game.open(&run.level, &goals)?;
        Ok(Self {
            run,
            trials,
            seed,
            drive: Drive::new(env, run.policy, &run.level.body),
            slots: slots.into_iter().map(Some).collect(),
            waiting,
            routes,
            task: TaskConfig::default(),
        })
    }

    /// Runs one decision of all NPCs, and returns the trials that have ended, with their outcomes.
    fn decide(&mut self) -> Result<Vec<(usize, Outcome)>, GameError> {
        let (mut deciding, mut noise) = (Vec::new(), Vec::new());
        for (npc_idx, slot) in self.slots.iter_mut().enumerate() {
            let Some(slot) = slot.as_mut().filter(|slot| !slot.is_arriving) else { continue };
            deciding.push(Deciding { npc_idx, style: slot.probe.style, npc: None });
            noise.extend(slot.probe.noise());
        }
        let routes = std::mem::take(&mut self.routes);
        self.drive.decide(&deciding, noise, &routes)?;
        let mut over = Vec::new();
        for npc_idx in 0..self.slots.len() {
            if self.note(npc_idx) {
                continue;
            }
            let Some(slot) = self.slots[npc_idx].take() else { continue };
            over.push((slot.trial_idx, slot.probe.outcome));
            self.next_trial(npc_idx);
        }
        Ok(over)
    }

    /// Records the last step of an NPC, and returns whether its trial continues.
    fn note(&mut self, npc_idx: usize) -> bool {
        let Some(slot) = &mut self.slots[npc_idx] else { return false };
        if std::mem::take(&mut slot.is_arriving) {
            return true;
        }
        let state = self.drive.state();
        let feet = state.positions[npc_idx];
        let has_passed = state.passed[npc_idx] > std::mem::replace(&mut slot.passed, state.passed[npc_idx]);
        slot.episode.note_tick(feet, &self.task);
        slot.episode.close_decision(&self.task);
        let report = DecisionReport {
            feet,
            is_grounded: npc_of(seen(state, npc_idx)).body.is_grounded(),
            ability: state.abilities[npc_idx],
            end: if has_passed { Some(End::Reached) } else { state.ended[npc_idx] },
            stalled: slot.episode.stalled_decisions,
            decisions: slot.episode.decisions,
        };
        match slot.probe.record(&report, &self.run.level.body) {
            ProbeStep::Keep => true,
            ProbeStep::HeadFor(goal) => {
                slot.episode = Episode::new(goal, feet);
                if !has_passed {
                    // The first place was reached before the route began there.
                    self.routes.push(Route { npc_idx, start: None, waypoints: vec![goal] });
                }
                true
            }
            ProbeStep::End => false,
        }
    }

    /// Sends an NPC to the start of the next trial, if there is one.
    fn next_trial(&mut self, npc_idx: usize) {
        let Some(trial_idx) = self.waiting.next() else { return };
        let (slot, goal) = TrialSlot::begin(self.run, self.trials, trial_idx, self.seed);
        let start = Some((goal.start, goal.yaw));
        let to_goal = || Route { npc_idx, start, waypoints: vec![goal.goal] };
        self.routes.push(route(npc_idx, &self.trials[trial_idx], start).unwrap_or_else(to_goal));
        self.drive.forget(npc_idx);
        self.slots[npc_idx] = Some(TrialSlot { is_arriving: true, ..slot });
    }
}

/// The route of a trial through its intermediate place.
fn route(npc_idx: usize, trial: &Trial, start: Option<(surefoot_world::Vec3, f32)>) -> Option<Route> {
    trial.via.map(|via| Route { npc_idx, start, waypoints: vec![via, trial.goal] })
}
