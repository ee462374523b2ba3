//! Tables of conditions: success by policy and by plan while one thing is varied, such as the map's devices, its kind,
//! or the training seed.

use super::config::{EvalConfig, EvalError, Method};
use super::intervals::Interval;
use super::maps::{EvalMap, MapName};
use super::report;
use super::run::run_cases;
use super::unit::Unit;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use surefoot_planner::BuildSettings;
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, End};

/// What one row of a table is measured with.
#[derive(Debug, Clone)]
pub struct Condition {
    /// Name of the row.
    pub name: String,
    /// Models; several that differ in their training seed alone are resampled together with the maps.
    pub policies: Vec<Policy>,
    /// Maps.
    pub maps: Vec<EvalMap>,
    /// Body of the NPCs.
    pub profile: CharacterProfile,
}

/// Success by one method.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Success over all goals, with its interval over maps and models.
    pub success: Interval,
    /// Success over the goals that can be reached, 0 to 1.
    pub of_reachable: f64,
    /// Success over the farthest third of goals, 0 to 1.
    pub hard: f64,
    /// Number of attempts.
    pub attempts: usize,
    /// Failed attempts whose goal cannot be reached: the survey, the proved edges and every attempt of the row agree.
    pub impossible: usize,
    /// Attempts that died on the way to a goal that can be reached.
    pub died: usize,
    /// Other failed attempts at goals that can be reached.
    pub avoidable: usize,
}

/// Results of one condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConditionRow {
    /// Name of the row.
    pub name: String,
    /// Names of the models.
    pub models: Vec<String>,
    /// Hashes of their weights.
    pub weights: Vec<String>,
    /// The maps.
    pub maps: Vec<MapName>,
    /// Share of goals to which a walk leads, by the survey.
    pub on_foot: f64,
    /// Share of goals that can be reached: by the survey, by proved edges, or by any attempt of the row.
    pub reachable: f64,
    /// The policy heads straight for the goal.
    pub policy: Cell,
    /// The policy follows plans.
    pub plan: Cell,
}

/// The results of all conditions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConditionReport {
    /// Name of the suite.
    pub suite: String,
    /// Goals of each map and seed.
    pub goals: usize,
    /// Seeds of goals, graphs and noise.
    pub seeds: Vec<u64>,
    /// Vertices of each graph.
    pub vertices: usize,
    /// Results.
    pub rows: Vec<ConditionRow>,
}

/// Runs every condition by policy, and by plan on graphs with these settings. `base` gives the rest. `progress` gets
/// the numbers of finished and of all units.
///
/// # Errors
/// As for [`super::evaluate`], and if a condition has fewer than two maps.
pub fn run(
    suite: &str,
    conditions: &[Condition],
    base: &EvalConfig,
    settings: BuildSettings,
    mut progress: impl FnMut(usize, usize),
) -> Result<ConditionReport, EvalError> {
    if conditions.iter().any(|it| it.maps.len() < 2) {
        return Err(EvalError::TooFewMaps);
    }
    let units_of = |it: &Condition| it.maps.len() * it.policies.len() * base.seeds.len() * 2;
    let (mut done, total) = (0, conditions.iter().map(units_of).sum());
    let mut rows = Vec::new();
    for condition in conditions {
        rows.push(row(condition, base, settings, || {
            done += 1;
            progress(done, total);
        })?);
    }
    let (goals, seeds) = (base.goals, base.seeds.clone());
    Ok(ConditionReport { suite: suite.to_owned(), goals, seeds, vertices: settings.vertices, rows })
}

/// The units of a condition by one method, model by model.
type ByModel = Vec<Vec<Unit>>;

fn row(
    condition: &Condition,
    base: &EvalConfig,
    settings: BuildSettings,
    progress: impl FnMut(),
) -> Result<ConditionRow, EvalError> {
    let Condition { name, policies, maps, profile } = condition;
    let with = |method| EvalConfig { method, maps: maps.clone(), profile: profile.clone(), ..base.clone() };
    let configs = [with(Method::Policy), with(Method::Graph(settings))];
    let cases = policies.iter().flat_map(|policy| configs.iter().map(move |config| (policy, config)));
    let mut units: [ByModel; 2] = Default::default();
    for (idx, of_case) in run_cases(&cases.collect::<Vec<_>>(), progress)?.into_iter().enumerate() {
        units[idx % configs.len()].push(of_case);
    }
    let reachable = reachable(&units);
    let all = || units.iter().flatten().flatten();
    let share = |of: fn(&Unit) -> &Vec<bool>| {
        let flags = || all().flat_map(of);
        flags().filter(|flag| **flag).count() as f64 / flags().count().max(1) as f64
    };
    let goal_count = base.goals * maps.len() * base.seeds.len();
    Ok(ConditionRow {
        name: name.clone(),
        models: policies.iter().map(|it| it.manifest().name.clone()).collect(),
        weights: policies.iter().map(|it| it.weights_hash().to_owned()).collect(),
        maps: maps.iter().map(EvalMap::name).collect(),
        on_foot: share(|unit| &unit.on_foot),
        reachable: reachable.len() as f64 / goal_count.max(1) as f64,
        policy: cell(&units[0], &reachable),
        plan: cell(&units[1], &reachable),
    })
}

/// Identifies a goal: map, seed, and index in the unit.
type GoalKey = (MapName, u64, usize);

/// Goals that can be reached, as any of these units found.
fn reachable(units: &[ByModel]) -> HashSet<GoalKey> {
    let mut goals = HashSet::new();
    for unit in units.iter().flatten().flatten() {
        let known = unit.reachable.iter().enumerate().filter(|(_, reachable)| **reachable);
        goals.extend(known.map(|(idx, _)| (unit.map.clone(), unit.seed, idx)));
    }
    goals
}

fn cell(by_model: &ByModel, reachable: &HashSet<GoalKey>) -> Cell {
    let (mut attempts, mut reached, mut impossible, mut died, mut avoidable) = (0, 0, 0, 0, 0);
    for unit in by_model.iter().flatten() {
        for (idx, attempt) in unit.attempts.iter().enumerate() {
            attempts += 1;
            match attempt.end {
                End::Reached => reached += 1,
                _ if !reachable.contains(&(unit.map.clone(), unit.seed, idx)) => impossible += 1,
                end if end.is_harm() => died += 1,
                _ => avoidable += 1,
            }
        }
    }
    let slices: Vec<&[Unit]> = by_model.iter().map(Vec::as_slice).collect();
    let flat: Vec<Unit> = by_model.iter().flatten().cloned().collect();
    Cell {
        success: Interval::of_models(&slices).expect("two maps or more"),
        of_reachable: f64::from(reached) / f64::from((attempts - impossible).max(1)),
        hard: report::success(&flat).hard.rate,
        attempts: attempts as usize,
        impossible: impossible as usize,
        died: died as usize,
        avoidable: avoidable as usize,
    }
}

impl ConditionReport {
    /// The results as a Markdown table.
    pub fn markdown(&self) -> String {
        let percent = |share: f64| format!("{:.1}", 100.0 * share);
        let mut text = format!(
            "{} goals on each map and seed, seeds {:?}, graphs of {} vertices. All figures but counts in %; success \
             with 95 % intervals over maps, and over models where a row has several.\n\n\
             | condition | maps | on foot | can be reached | by policy | hard | by plan | hard | between maps | by \
             plan, of what can be reached | failed by plan: impossible, died, avoidable |\n\
             |---|---|---|---|---|---|---|---|---|---|---|\n",
            self.goals, self.seeds, self.vertices,
        );
        for row in &self.rows {
            let ConditionRow { name, models, maps, policy, plan, .. } = row;
            let models = if models.len() > 1 { format!(" ({} models)", models.len()) } else { String::new() };
            text += &format!(
                "| {name}{models} | {} | {} | {} | {} | {} | **{}** | {} | ± {} | {} | {}, {}, {} of {} |\n",
                maps.len(),
                percent(row.on_foot),
                percent(row.reachable),
                policy.success.percent(),
                percent(policy.hard),
                plan.success.percent(),
                percent(plan.hard),
                percent(plan.success.between_maps),
                percent(plan.of_reachable),
                plan.impossible,
                plan.died,
                plan.avoidable,
                plan.attempts,
            );
        }
        text
    }
}
