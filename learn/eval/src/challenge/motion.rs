//! How the bodies of several runs move, over the goals that all of them reach.

use super::run::{Approach, MapRun, Run};
use super::score::ScoreError;
use super::set::{GoalSet, SetGoal, SetMap};
use super::trial::attempt;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use surefoot_planner::threads::map_indices;
use surefoot_rollout::Motion;
use surefoot_rollout::motion::Sample;
use surefoot_world::{Ability, CharacterProfile, DECISION_SECONDS, End, Map, TaskConfig, Vec3};

/// How an entrant moved at the goals that all runs reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionRow {
    /// Name of the map; absent for all maps together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Name of the entrant.
    pub entrant: String,
    /// Goals of the map.
    pub goals: usize,
    /// Goals that the entrant reached.
    pub reached: usize,
    /// Goals that are measured, the same for all runs.
    pub measured: usize,
    /// Mean time to a goal, s.
    pub seconds_to_goal: f64,
    /// Distance covered on the plane, with the rest to the goal, over the length of the shortest path on the plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path_over_shortest: Option<f64>,
    /// How often per second a heading that had turned to one side turned back by five degrees or more.
    pub reversals_per_s: f64,
    /// The same for every 100 m.
    pub reversals_per_100m: f64,
    /// Median of the angle between facing and motion, degrees.
    pub facing_p50_deg: f64,
    /// The same angle at the 90th percentile.
    pub facing_p90_deg: f64,
    /// Jumps per 100 m; 0 for tracks, which do not say when a body jumps.
    pub jumps_per_100m: f64,
    /// Share of the time in the air.
    pub air_share: f64,
    /// Mean change of acceleration on the plane, m/s3.
    pub jerk: f64,
}

/// What is measured.
#[derive(Debug, Clone, Copy)]
pub struct Comparison<'a> {
    /// The runs.
    pub runs: &'a [Run],
    /// A run whose walked paths are the shortest ones that are known; only goals with such a path are measured.
    pub shortest: Option<&'a Run>,
    /// Whether only goals are measured that all runs reach without jumps and devices.
    pub on_foot: bool,
}

/// Measures the motion of runs on the set whose files are in `folder`: for each map, and for all of them together if
/// there are several, a row for each run in their order. `progress` gets the name of each map before its attempts are
/// made.
///
/// # Errors
/// If a run does not fit the set, or a map cannot be loaded.
pub fn compare(
    (set, folder): (&GoalSet, &Path),
    Comparison { runs, shortest, on_foot }: Comparison<'_>,
    thread_count: usize,
    mut progress: impl FnMut(&str),
) -> Result<Vec<MotionRow>, ScoreError> {
    set.check()?;
    let checked = runs.iter().map(|run| run.check(set)).collect::<Result<Vec<_>, _>>()?;
    let shortest = shortest.map(|run| run.check(set)).transpose()?;
    let mut rows = Vec::new();
    let mut totals = vec![Sums::default(); runs.len()];
    for (idx, of_set) in set.maps.iter().enumerate() {
        progress(&of_set.name);
        let map = of_set.load(folder)?;
        let lengths = shortest.as_ref().map(|maps| walked_lengths(of_set, maps[idx]));
        let made = checked.iter().map(|maps| attempts((&map, &set.body), of_set, maps[idx], thread_count));
        let counts = |track: &Vec<Sample>| !on_foot || track.iter().all(|sample| sample.used.is_empty());
        let sums = measure(of_set, lengths.as_deref(), &made.collect::<Vec<_>>(), counts);
        for ((run, total), sums) in runs.iter().zip(&mut totals).zip(sums) {
            rows.push(sums.row(Some(&of_set.name), &run.entrant));
            total.add(&sums);
        }
    }
    if set.maps.len() > 1 {
        rows.extend(runs.iter().zip(&totals).map(|(run, total)| total.row(None, &run.entrant)));
    }
    Ok(rows)
}

/// The tracks of the attempts that reached their goals.
fn attempts(
    (map, body): (&Arc<Map>, &CharacterProfile),
    of_set: &SetMap,
    run: &MapRun,
    thread_count: usize,
) -> Vec<Option<Vec<Sample>>> {
    map_indices(of_set.goals.len(), thread_count, |idx| {
        let (result, track) = attempt(map, body, &of_set.goals[idx], &run.attempts[idx]);
        (result.end == End::Reached).then_some(track)
    })
}

/// The lengths of the walked paths of a run on the plane, m.
fn walked_lengths(of_set: &SetMap, run: &MapRun) -> Vec<Option<f64>> {
    of_set.goals.iter().zip(&run.attempts).map(|(goal, approach)| walked_length(approach, goal)).collect()
}

/// Length on the plane of a path that is walked from start to goal, m.
fn walked_length(approach: &Approach, goal: &SetGoal) -> Option<f64> {
    let Approach::Path(points) = approach else { return None };
    let end = Vec3::from_array(points.last()?.at);
    let leads_there = end.distance(Vec3::from_array(goal.goal)) <= TaskConfig::default().goal_radius;
    let is_walk = points.iter().all(|point| point.by == Ability::WALK);
    let places = points.iter().map(|point| Vec3::from_array(point.at));
    let all: Vec<Vec3> = [Vec3::from_array(goal.start)].into_iter().chain(places).collect();
    (leads_there && is_walk).then(|| all.windows(2).map(|pair| on_plane(pair[0], pair[1])).sum())
}

fn on_plane(from: Vec3, to: Vec3) -> f64 {
    f64::from((to - from).with_y(0.0).length())
}

/// Sums over the goals of one run.
#[derive(Debug, Clone, Default)]
struct Sums {
    goals: usize,
    reached: usize,
    measured: usize,
    decisions: usize,
    covered_m: f64,
    /// Length of the shortest paths, m; `None` if they are unknown.
    shortest_m: Option<f64>,
    motion: Motion,
}

/// The sums of each run over the goals that all of them reached with tracks that count.
fn measure(
    of_set: &SetMap,
    lengths: Option<&[Option<f64>]>,
    runs: &[Vec<Option<Vec<Sample>>>],
    counts: impl Fn(&Vec<Sample>) -> bool,
) -> Vec<Sums> {
    let is_measured = |idx: &usize| {
        lengths.is_none_or(|all| all[*idx].is_some())
            && runs.iter().all(|tracks| tracks[*idx].as_ref().is_some_and(&counts))
    };
    let measured: Vec<usize> = (0..of_set.goals.len()).filter(is_measured).collect();
    let shortest_m = lengths.map(|all| measured.iter().filter_map(|idx| all[*idx]).sum());
    let sums = |tracks: &Vec<Option<Vec<Sample>>>| {
        let reached = tracks.iter().flatten().count();
        let mut sums = Sums { goals: tracks.len(), reached, measured: measured.len(), shortest_m, ..Sums::default() };
        for &idx in &measured {
            let track = tracks[idx].as_deref().unwrap_or_default();
            sums.decisions += track.len().saturating_sub(1);
            sums.covered_m += track.windows(2).map(|pair| on_plane(pair[0].feet, pair[1].feet)).sum::<f64>();
            let goal = Vec3::from_array(of_set.goals[idx].goal);
            sums.covered_m += track.last().map_or(0.0, |last| on_plane(last.feet, goal));
            sums.motion.add(&Motion::of_track(track));
        }
        sums
    };
    runs.iter().map(sums).collect()
}

impl Sums {
    fn add(&mut self, other: &Self) {
        let is_first = self.goals == 0;
        self.goals += other.goals;
        self.reached += other.reached;
        self.measured += other.measured;
        self.decisions += other.decisions;
        self.covered_m += other.covered_m;
        self.shortest_m =
            if is_first { other.shortest_m } else { self.shortest_m.zip(other.shortest_m).map(|(a, b)| a + b) };
        self.motion.add(&other.motion);
    }

    fn row(&self, map: Option<&str>, entrant: &str) -> MotionRow {
        let Self { motion, .. } = self;
        MotionRow {
            map: map.map(str::to_owned),
            entrant: entrant.to_owned(),
            goals: self.goals,
            reached: self.reached,
            measured: self.measured,
            seconds_to_goal: self.decisions as f64 * f64::from(DECISION_SECONDS) / self.measured.max(1) as f64,
            path_over_shortest: self.shortest_m.filter(|it| *it > 0.0).map(|shortest| self.covered_m / shortest),
            reversals_per_s: motion.reversals_per_s(),
            reversals_per_100m: motion.reversals_per_100m(),
            facing_p50_deg: motion.facing_deg(0.5),
            facing_p90_deg: motion.facing_deg(0.9),
            jumps_per_100m: motion.all.jumps_per_100m(),
            air_share: motion.all.air_share(),
            jerk: motion.mean_jerk(),
        }
    }
}
