//! Probes candidate edges in a game: the policy runs there, many trials at a time, and the planner hears how they went.
//!
//! Every trial has the heading, the noise and the patience that it has in a world of ours ([`RunningProbe`]), so a game
//! with our physics proves our edges. Edges that hang on movers are not proved: the contract does not tell where they
//! stand.

use super::drive::{Deciding, Drive, seen};
use super::link::{Game, GameError, Level};
use std::sync::Mutex;
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner::threads::map_indices;
use surefoot_planner::{BuildError, BuildSettings, Built, Progress};
use surefoot_policy::Policy;
use surefoot_rollout::env::Route;
use surefoot_rollout::graphs;
use surefoot_rollout::probe::{DecisionReport, ProbeStep, RunningProbe};
use surefoot_rollout::style::npc_of;
use surefoot_rollout::{Goal, ProbeContext};
use surefoot_world::{End, Episode, TaskConfig};

/// NPCs of one environment.
const LANES: usize = 128;
/// Fewest trials of an environment, unless there are fewer in all.
const MIN_CHUNK: usize = 64;
/// Most trials of an environment, so that the game need not keep one for long.
const MAX_CHUNK: usize = 1024;

/// Runs probes in a game.
#[derive(Debug)]
pub struct InGame<'a> {
    game: &'a Game,
    level: Level,
    policy: &'a Policy,
    /// Environments that run at once, at least 1.
    env_count: usize,
    /// Why the game is of no use, once it is not.
    error: Mutex<Option<GameError>>,
}

/// Why a graph cannot be proved in a game.
#[derive(Debug, thiserror::Error)]
pub enum InGameError {
    /// The game is of no use.
    #[error(transparent)]
    Game(#[from] GameError),
    /// The level is.
    #[error(transparent)]
    Build(#[from] BuildError),
}

/// Builds a graph of the level of `context` whose edges `game` proves in `env_count` environments at once.
///
/// # Errors
/// If the game is of no use, the level has no navigable ground, or `progress.cancel` was set.
pub fn build(
    game: &Game,
    context: &ProbeContext,
    settings: &BuildSettings,
    env_count: usize,
    progress: &Progress,
) -> Result<Built, InGameError> {
    let executor = InGame::new(game, context, env_count);
    let built = graphs::build_by(&executor, context, settings, env_count, progress);
    executor.take_error().map_or(Ok(()), Err)?;
    Ok(built?)
}

impl<'a> InGame<'a> {
    /// Prepares probes on the level of `context`, in `env_count` environments at once.
    pub fn new(game: &'a Game, context: &'a ProbeContext, env_count: usize) -> Self {
        let level = Level { map: context.map.clone(), body: context.profile.clone(), solid_npcs: false };
        Self { game, level, policy: &context.policy, env_count: env_count.max(1), error: Mutex::default() }
    }

    /// Why the last run ended early, if the game was the cause.
    pub fn take_error(&self) -> Option<GameError> {
        self.error.lock().expect("no holder panics").take()
    }

    fn has_failed(&self) -> bool {
        self.error.lock().expect("no holder panics").is_some()
    }

    /// Runs the trials from `first` on, and returns their outcomes; `None` if `watch` cancelled, or the game failed
    /// elsewhere.
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
        let mut crew = Crew::begin(self, trials, runnable, seed)?;
        while crew.lanes.iter().any(Option::is_some) {
            if watch.is_cancelled() || self.has_failed() {
                return Ok(None);
            }
            for (idx, outcome) in crew.decide()? {
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
                self.error.lock().expect("no holder panics").get_or_insert(error);
                None
            })
        });
        Some(results.into_iter().collect::<Option<Vec<_>>>()?.into_iter().flatten().collect())
    }
}

/// The NPCs of one environment, which run trials one after another.
struct Crew<'a> {
    run: &'a InGame<'a>,
    trials: &'a [Trial],
    seed: u64,
    drive: Drive<'a>,
    lanes: Vec<Option<Lane>>,
    waiting: std::vec::IntoIter<usize>,
    /// Routes that go with the next step.
    routes: Vec<Route>,
    task: TaskConfig,
}

/// An NPC with the trial that it runs.
struct Lane {
    trial_idx: usize,
    probe: RunningProbe,
    /// The way to the place for which it heads.
    episode: Episode,
    /// Places of its route that it had passed before the last step.
    passed: u32,
    /// Whether it will be put at its start after the next step.
    is_arriving: bool,
}

impl Lane {
    fn begin(run: &InGame<'_>, trials: &[Trial], trial_idx: usize, seed: u64) -> (Self, Goal) {
        let (probe, goal) = RunningProbe::begin(&trials[trial_idx], seed, 0, &run.level.body);
        let episode = Episode::new(goal.goal, goal.start);
        (Self { trial_idx, probe, episode, passed: 0, is_arriving: false }, goal)
    }
}

impl<'a> Crew<'a> {
    /// Puts NPCs at the starts of the first of these trials, at least one.
    fn begin(run: &'a InGame<'a>, trials: &'a [Trial], which: Vec<usize>, seed: u64) -> Result<Self, GameError> {
        let mut waiting = which.into_iter();
        let (lanes, goals): (Vec<Lane>, Vec<Goal>) =
            waiting.by_ref().take(LANES).map(|idx| Lane::begin(run, trials, idx, seed)).unzip();
        let routes = (0..).zip(&lanes).filter_map(|(npc_idx, lane)| route(npc_idx, &trials[lane.trial_idx], None));
        let routes = routes.collect();
        let env = run.game.open(&run.level, &goals)?;
        Ok(Self {
            run,
            trials,
            seed,
            drive: Drive::new(env, run.policy, &run.level.body),
            lanes: lanes.into_iter().map(Some).collect(),
            waiting,
            routes,
            task: TaskConfig::default(),
        })
    }

    /// Runs one decision of all NPCs, and returns the trials that are over, with their outcomes.
    fn decide(&mut self) -> Result<Vec<(usize, Outcome)>, GameError> {
        let (mut deciding, mut noise) = (Vec::new(), Vec::new());
        for (npc_idx, lane) in self.lanes.iter_mut().enumerate() {
            let Some(lane) = lane.as_mut().filter(|lane| !lane.is_arriving) else { continue };
            deciding.push(Deciding { npc_idx, style: lane.probe.style });
            noise.extend(lane.probe.noise());
        }
        let routes = std::mem::take(&mut self.routes);
        self.drive.decide(&deciding, noise, &routes)?;
        let mut over = Vec::new();
        for npc_idx in 0..self.lanes.len() {
            if self.note(npc_idx) {
                continue;
            }
            let Some(lane) = self.lanes[npc_idx].take() else { continue };
            over.push((lane.trial_idx, lane.probe.outcome));
            self.next_trial(npc_idx);
        }
        Ok(over)
    }

    /// Records the last step of an NPC, and returns whether its trial goes on.
    fn note(&mut self, npc_idx: usize) -> bool {
        let Some(lane) = &mut self.lanes[npc_idx] else { return false };
        if std::mem::take(&mut lane.is_arriving) {
            return true;
        }
        let state = self.drive.state();
        let feet = state.positions[npc_idx];
        let has_passed = state.passed[npc_idx] > std::mem::replace(&mut lane.passed, state.passed[npc_idx]);
        lane.episode.note_tick(feet, &self.task);
        lane.episode.close_decision(&self.task);
        let report = DecisionReport {
            feet,
            is_grounded: npc_of(seen(state, npc_idx)).body.is_grounded(),
            ability: state.abilities[npc_idx],
            end: if has_passed { Some(End::Reached) } else { state.ended[npc_idx] },
            stalled: lane.episode.stalled_decisions,
            decisions: lane.episode.decisions,
        };
        match lane.probe.record(&report, &self.run.level.body) {
            ProbeStep::Keep => true,
            ProbeStep::HeadFor(goal) => {
                lane.episode = Episode::new(goal, feet);
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
        let (lane, goal) = Lane::begin(self.run, self.trials, trial_idx, self.seed);
        let start = Some((goal.start, goal.yaw));
        let to_goal = || Route { npc_idx, start, waypoints: vec![goal.goal] };
        self.routes.push(route(npc_idx, &self.trials[trial_idx], start).unwrap_or_else(to_goal));
        self.drive.forget(npc_idx);
        self.lanes[npc_idx] = Some(Lane { is_arriving: true, ..lane });
    }
}

/// The route of a trial that leads by another place.
fn route(npc_idx: usize, trial: &Trial, start: Option<(surefoot_world::Vec3, f32)>) -> Option<Route> {
    trial.via.map(|via| Route { npc_idx, start, waypoints: vec![via, trial.goal] })
}
