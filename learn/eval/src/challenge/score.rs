//! The scorer: drives the paths or repeats the actions of a run, and measures where the body gets.

use super::host::Hosted;
use super::run::{Approach, MapRun, Run, RunError};
use super::set::{GoalSet, SetError, SetMap};
use super::trial::attempt;
use super::{VERSION, set};
use crate::report::{self, Rate, Success};
use crate::unit::Unit;
use crate::{Interval, Terrain, is_on_foot, reachable};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use surefoot_planner::threads::map_indices;
use surefoot_rollout::{AttemptResult, Goal, Motion};
use surefoot_world::reach::Reach;
use surefoot_world::{CharacterProfile, End, Map};

/// The score of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Version of the challenge.
    pub challenge: u32,
    /// Name of the set.
    pub set: String,
    /// Hash of the set's maps, body and goals.
    pub set_hash: String,
    /// Name of the entrant.
    pub entrant: String,
    /// Description of the entrant.
    pub about: String,
    /// Success over all goals, and by thirds of each map's goals by distance.
    pub success: Success,
    /// Success with its interval over maps; absent with one map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_map: Option<Interval>,
    /// Success at goals that are reachable on foot, by the survey.
    pub on_foot: Rate,
    /// Success at all other goals.
    pub not_on_foot: Rate,
    /// Number of attempts by outcome.
    pub ends: BTreeMap<String, usize>,
    /// Share of the unreachable goals, by the survey and by this run, that the entrant reported; absent without such
    /// goals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub told: Option<f64>,
    /// Share of the attempts at reachable goals that ended in death.
    pub died: f64,
    /// Mean duration of successful attempts, s.
    pub seconds_to_goal: f64,
    /// Mean length of the path of successful attempts, m; absent for hosted attempts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metres_to_goal: Option<f64>,
    /// Mean of straight-line distance over distance covered, over successful attempts; absent for attempts that were
    /// hosted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub directness: Option<f64>,
    /// Mean time for preparing a map, s, as the entrant reports it.
    pub build_s: f64,
    /// Mean size of the prepared data of a map, bytes, as the entrant reports it.
    pub bytes: f64,
    /// The maps, in the order of the set.
    pub maps: Vec<MapScore>,
}

/// The score of a run on one map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapScore {
    /// Name of the map.
    pub name: String,
    /// Success over its goals.
    pub success: Rate,
    /// Number of attempts by outcome.
    pub ends: BTreeMap<String, usize>,
    /// Mean duration of successful attempts, s.
    pub seconds_to_goal: f64,
    /// Time for preparing the map, s, as the entrant reports it.
    pub build_s: f64,
    /// Size of the prepared data, bytes, as the entrant reports it.
    pub bytes: u64,
}

/// Why a run has no score.
#[derive(Debug, thiserror::Error)]
pub enum ScoreError {
    /// The run does not fit the set.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The set cannot be used.
    #[error(transparent)]
    Set(#[from] SetError),
}

/// Scores a run on the set whose files are in `folder`. `progress` gets the name of each map before its attempts are
/// made.
///
/// # Errors
/// If the run does not fit the set, or a map cannot be loaded.
pub fn score(
    set: &GoalSet,
    folder: &Path,
    run: &Run,
    thread_count: usize,
    mut progress: impl FnMut(&str),
) -> Result<Score, ScoreError> {
    set.check()?;
    let runs = run.check(set)?;
    let is_track = |of_run: &&&MapRun| of_run.attempts.iter().any(|attempt| matches!(attempt, Approach::Track(_)));
    if let Some(of_run) = runs.iter().find(is_track) {
        return Err(RunError::Track(of_run.name.clone()).into());
    }
    let mut units = Vec::with_capacity(runs.len());
    for (of_set, of_run) in set.maps.iter().zip(&runs) {
        progress(&of_set.name);
        let map = of_set.load(folder)?;
        let trial = |idx: usize| attempt(&map, &set.body, &of_set.goals[idx], &of_run.attempts[idx]).0;
        let attempts = map_indices(of_set.goals.len(), thread_count, trial);
        units.push(unit(&map, &set.body, of_set, attempts, thread_count));
    }
    Ok(summarise(set, (&run.entrant, &run.about), &runs, &units))
}

/// Scores attempts that a server hosted, map by map in the order of the set, with the entrant's name and description.
///
/// # Errors
/// If a map cannot be had.
///
/// # Panics
/// If there is not one attempt for each goal.
pub fn score_hosted(
    set: &GoalSet,
    folder: &Path,
    entrant: (&str, &str),
    hosted: &[Hosted],
    thread_count: usize,
) -> Result<Score, ScoreError> {
    let mut units = Vec::with_capacity(hosted.len());
    for (of_set, hosted) in set.maps.iter().zip(hosted) {
        assert_eq!(hosted.attempts.len(), of_set.goals.len(), "one attempt for each goal");
        let map = of_set.load(folder)?;
        units.push(unit(&map, &set.body, of_set, hosted.attempts.clone(), thread_count));
    }
    let runs = set.maps.iter().zip(hosted);
    let runs: Vec<MapRun> = runs
        .map(|(map, hosted)| MapRun {
            name: map.name.clone(),
            build_s: hosted.warm_up_s,
            bytes: 0,
            attempts: Vec::new(),
        })
        .collect();
    let score = summarise(set, entrant, &runs.iter().collect::<Vec<_>>(), &units);
    Ok(Score { metres_to_goal: None, directness: None, ..score })
}

/// All attempts on one map, with the reachability of the goals by the survey.
fn unit(
    map: &Arc<Map>,
    body: &CharacterProfile,
    of_set: &SetMap,
    attempts: Vec<AttemptResult>,
    thread_count: usize,
) -> Unit {
    let goals: Vec<Goal> = of_set.goals.iter().copied().map(Goal::from).collect();
    let reach = Reach::survey_far(map, body, thread_count);
    let terrain = Terrain { map, profile: body, reach: &reach };
    let surveyed = reachable(&terrain, None, &goals);
    let known = surveyed.into_iter().zip(&attempts).map(|(known, attempt)| known || attempt.end == End::Reached);
    Unit {
        map: of_set.report_name(),
        seed: set::SEED,
        distances: goals.iter().map(Goal::distance).collect(),
        reachable: known.collect(),
        on_foot: goals.iter().map(|goal| is_on_foot(&terrain, goal)).collect(),
        attempts,
        motion: Motion::default(),
        graph: None,
        playable: None,
    }
}

fn summarise(set: &GoalSet, (entrant, about): (&str, &str), runs: &[&MapRun], units: &[Unit]) -> Score {
    let mean = |of: fn(&MapRun) -> f64| runs.iter().map(|it| of(it)).sum::<f64>() / runs.len().max(1) as f64;
    let reached = || goals(units).filter(|goal| goal.attempt.end == End::Reached);
    let share = |of: fn(&Seen<'_>) -> f64| reached().map(|it| of(&it)).sum::<f64>() / reached().count().max(1) as f64;
    let out_of_reach = goals(units).filter(|goal| !goal.can_be_reached).count();
    let told = goals(units).filter(|goal| !goal.can_be_reached && goal.attempt.end == End::Unreachable).count();
    let can_be_reached = goals(units).filter(|goal| goal.can_be_reached).count();
    let died = goals(units).filter(|goal| goal.can_be_reached && goal.attempt.end.is_harm()).count();
    let by_ground = |on_foot: bool| {
        let of = || goals(units).filter(|goal| goal.on_foot == on_foot);
        Rate::of(of().filter(|goal| goal.attempt.end == End::Reached).count(), of().count())
    };
    let map_score = |(unit, of_run): (&Unit, &&MapRun)| MapScore {
        name: of_run.name.clone(),
        success: report::success(std::slice::from_ref(unit)).all,
        ends: report::count_ends(std::slice::from_ref(unit)),
        seconds_to_goal: report::seconds_to_goal(std::slice::from_ref(unit)),
        build_s: of_run.build_s,
        bytes: of_run.bytes,
    };
    Score {
        challenge: VERSION,
        set: set.set.clone(),
        set_hash: set.hash(),
        entrant: entrant.to_owned(),
        about: about.to_owned(),
        success: report::success(units),
        by_map: Interval::of(units),
        on_foot: by_ground(true),
        not_on_foot: by_ground(false),
        ends: report::count_ends(units),
        told: (out_of_reach > 0).then(|| told as f64 / out_of_reach as f64),
        died: died as f64 / can_be_reached.max(1) as f64,
        seconds_to_goal: report::seconds_to_goal(units),
        metres_to_goal: Some(share(|it| f64::from(it.attempt.length))),
        directness: Some(share(|it| f64::from(it.distance / it.attempt.length.max(it.distance).max(f32::EPSILON)))),
        build_s: mean(|it| it.build_s),
        bytes: mean(|it| it.bytes as f64),
        maps: units.iter().zip(runs).map(map_score).collect(),
    }
}

/// An attempt with the facts about its goal.
struct Seen<'u> {
    attempt: &'u AttemptResult,
    distance: f32,
    on_foot: bool,
    can_be_reached: bool,
}

fn goals(units: &[Unit]) -> impl Iterator<Item = Seen<'_>> {
    units.iter().flat_map(|unit| {
        unit.attempts.iter().enumerate().map(|(idx, attempt)| Seen {
            attempt,
            distance: unit.distances[idx],
            on_foot: unit.on_foot[idx],
            can_be_reached: unit.reachable[idx],
        })
    })
}
