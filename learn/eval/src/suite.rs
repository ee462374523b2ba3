//! The paper's table beside our results.

use super::config::{EvalConfig, EvalError, Method};
use super::intervals::Interval;
use super::maps::{EvalMap, MapName};
use super::report::{self, Rate, Success};
use super::run::run_units;
use super::unit::{GraphFigures, Unit};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use surefoot_policy::Policy;
use surefoot_rollout::follow::Fault;
use surefoot_world::{End, MapSpec};

/// Width of the distance bins, m.
const BIN_M: f32 = 25.0;

/// One row of the paper's table: success rates on four test maps with 2,500 goals each and 3 seeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PaperRow {
    /// Name of the method.
    pub name: &'static str,
    /// Success rate over all goals, 0 to 1.
    pub all: f64,
    /// Success rate over the nearest third of goals.
    pub easy: f64,
    /// Success rate over the middle third.
    pub medium: f64,
    /// Success rate over the farthest third.
    pub hard: f64,
}

/// The rows of the paper: policies, then graphs.
pub const PAPER: [PaperRow; 10] = [
    row("map-specific LSTM", [0.899, 0.911, 0.891, 0.892]),
    row("general reactive", [0.680, 0.821, 0.619, 0.574]),
    row("general LSTM", [0.696, 0.833, 0.661, 0.556]),
    row("unconstrained random graph", [0.824, 0.878, 0.812, 0.767]),
    row("distance-constrained graph", [0.859, 0.904, 0.850, 0.809]),
    row("density-based graph", [0.833, 0.888, 0.820, 0.776]),
    row("trajectory merging graph", [0.812, 0.880, 0.808, 0.724]),
    row("trajectory merging graph with edge tests", [0.862, 0.903, 0.855, 0.816]),
    row("flood graph", [0.800, 0.822, 0.804, 0.765]),
    row("flood graph with grandchild edges", [0.856, 0.898, 0.849, 0.808]),
];

const fn row(name: &'static str, [all, easy, medium, hard]: [f64; 4]) -> PaperRow {
    PaperRow { name, all, easy, medium, hard }
}

/// Configuration of one of our rows.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Name of the row; equal to the name of the paper's row to compare with, if any.
    pub name: &'static str,
    /// How NPCs approach goals.
    pub method: Method,
    /// Models, each with the maps to evaluate it on.
    pub models: Vec<(Policy, Vec<MapSpec>)>,
}

/// Results of one of our rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the row; equal to the name of the paper's row to compare with, if any.
    pub name: String,
    /// Names of the models.
    pub models: Vec<String>,
    /// Hashes of the models' weights.
    pub weights: Vec<String>,
    /// Success rates.
    pub success: Success,
    /// Success over all goals with an interval over maps instead of goals; absent with one map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_map: Option<Interval>,
    /// Standard deviation of the overall rate between seeds; absent with one seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Number of attempts by outcome.
    pub ends: BTreeMap<String, usize>,
    /// Number of failed attempts that followed plans, by fault.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub faults: BTreeMap<String, usize>,
    /// Mean figures of the graphs; absent without graphs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub graph: Option<GraphFigures>,
    /// Path efficiency: mean over all goals of success times the length of the shortest path that any row found,
    /// divided by the length of the path taken.
    pub efficiency: f64,
    /// Mean duration of successful attempts, s.
    pub seconds_to_goal: f64,
    /// Success rates by distance, each with its bin's upper end, m.
    pub by_distance: Vec<(f32, Rate)>,
}

/// Success rates of one model on several splits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Generalisation {
    /// Name of the row.
    pub name: String,
    /// Name of each split with the success rate on it.
    pub splits: Vec<(String, Rate)>,
}

/// Results of the whole suite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SuiteReport {
    /// Number of goals per map and seed.
    pub goals: usize,
    /// Seeds of goals, graphs and noise.
    pub seeds: Vec<u64>,
    /// Seeds of the maps.
    pub maps: Vec<u64>,
    /// Our rows.
    pub rows: Vec<Row>,
    /// Success rates by split, for rows of one model without plans.
    pub generalisation: Vec<Generalisation>,
}

/// All units of one entry.
struct Outcome<'e> {
    entry: &'e Entry,
    units: Vec<Unit>,
}

/// Runs every entry. `base` gives all settings except maps and method. `progress` gets the name of the row or split and
/// the numbers of its finished and of all its attempts.
pub fn run(
    entries: &[Entry],
    splits: &[(&str, Vec<MapSpec>)],
    base: &EvalConfig,
    mut progress: impl FnMut(&str, usize, usize),
) -> Result<SuiteReport, EvalError> {
    let mut outcomes = Vec::new();
    for entry in entries {
        let total = entry.models.iter().map(|(_, maps)| maps.len()).sum::<usize>() * base.seeds.len() * base.goals;
        let mut units = Vec::new();
        for (policy, maps) in &entry.models {
            let config = EvalConfig {
                maps: maps.iter().copied().map(EvalMap::from).collect(),
                method: entry.method,
                ..base.clone()
            };
            let before = units.len() * base.goals;
            units.extend(run_units(policy, &config, |done, _| progress(entry.name, before + done, total))?);
        }
        outcomes.push(Outcome { entry, units });
    }
    let mut generalisation = Vec::new();
    for entry in entries.iter().filter(|entry| entry.method == Method::Policy && entry.models.len() == 1) {
        let mut shares = Vec::new();
        for (split, maps) in splits {
            let seeds = base.seeds[..1].to_vec();
            let config = EvalConfig {
                maps: maps.iter().copied().map(EvalMap::from).collect(),
                method: entry.method,
                seeds,
                ..base.clone()
            };
            let units = run_units(&entry.models[0].0, &config, |done, total| progress(split, done, total))?;
            shares.push(((*split).to_owned(), report::success(&units).all));
        }
        generalisation.push(Generalisation { name: entry.name.to_owned(), splits: shares });
    }
    let shortest = shortest_lengths(&outcomes);
    let maps = outcomes.first().map_or(Vec::new(), |outcome| {
        outcome.entry.models.iter().flat_map(|(_, maps)| maps).map(|spec| spec.seed).collect()
    });
    let rows = outcomes.iter().map(|outcome| outcome.row(&base.seeds, &shortest)).collect();
    Ok(SuiteReport { goals: base.goals, seeds: base.seeds.clone(), maps, rows, generalisation })
}

/// Identifies a goal: map, seed, and index in the unit.
type GoalKey = (MapName, u64, usize);

/// Length of the shortest successful path to each goal over all rows, m.
fn shortest_lengths(outcomes: &[Outcome<'_>]) -> HashMap<GoalKey, f32> {
    let mut shortest = HashMap::new();
    for unit in outcomes.iter().flat_map(|outcome| &outcome.units) {
        for (idx, attempt) in unit.attempts.iter().enumerate().filter(|(_, attempt)| attempt.end == End::Reached) {
            let length = shortest.entry((unit.map.clone(), unit.seed, idx)).or_insert(f32::INFINITY);
            *length = attempt.length.min(*length);
        }
    }
    shortest
}

impl Outcome<'_> {
    fn row(&self, seeds: &[u64], shortest: &HashMap<GoalKey, f32>) -> Row {
        let units = &self.units;
        let attempt_count: usize = units.iter().map(|unit| unit.attempts.len()).sum();
        let mut efficiency = 0.0;
        for unit in units {
            for (idx, attempt) in unit.attempts.iter().enumerate().filter(|(_, attempt)| attempt.end == End::Reached) {
                let best = shortest[&(unit.map.clone(), unit.seed, idx)];
                efficiency += f64::from(best / attempt.length.max(best).max(f32::EPSILON));
            }
        }
        Row {
            name: self.entry.name.to_owned(),
            models: self.entry.models.iter().map(|(policy, _)| policy.manifest().name.clone()).collect(),
            weights: self.entry.models.iter().map(|(policy, _)| policy.weights_hash().to_owned()).collect(),
            success: report::success(units),
            by_map: Interval::of(units),
            spread: report::spread(units, seeds),
            ends: report::count_ends(units),
            faults: report::count_faults(units),
            graph: report::graph_figures(units),
            efficiency: efficiency / attempt_count.max(1) as f64,
            seconds_to_goal: report::seconds_to_goal(units),
            by_distance: report::by_distance(units, BIN_M),
        }
    }
}

impl SuiteReport {
    /// The table as Markdown, with our figures and the paper's in percent.
    pub fn markdown(&self) -> String {
        let percent = |share: f64| format!("{:.1}", 100.0 * share);
        let mut text = format!(
            "{} maps, {} goals each, {} seeds. Success in %: ours (the paper's); intervals are those of 95 % over \
             maps.\n\n",
            self.maps.len(),
            self.goals,
            self.seeds.len()
        );
        text += "| method | all | interval | between seeds | easy | medium | hard | path efficiency | time to goal \
         |\n|---|---|---|---|---|---|---|---|---|\n";
        for row in &self.rows {
            let paper = PAPER.iter().find(|paper| paper.name == row.name);
            let cell = |rate: Rate, theirs: fn(&PaperRow) -> f64| match paper {
                Some(paper) => format!("{} ({})", percent(rate.rate), percent(theirs(paper))),
                None => percent(rate.rate),
            };
            let Success { all, easy, medium, hard } = row.success;
            text += &format!(
                "| {} | **{}** | {} | {} | {} | {} | {} | {:.2} | {:.1} s |\n",
                row.name,
                cell(all, |paper| paper.all),
                row.by_map.map_or("-".to_owned(), |it| format!("{} to {}", percent(it.low), percent(it.high))),
                row.spread.map_or("-".to_owned(), |spread| format!("± {:.2}", 100.0 * spread)),
                cell(easy, |paper| paper.easy),
                cell(medium, |paper| paper.medium),
                cell(hard, |paper| paper.hard),
                row.efficiency,
                row.seconds_to_goal,
            );
        }
        text += "\n| method | ";
        let names: Vec<String> = report::outcomes().map(|end| end.name().replace('_', " ")).collect();
        text += &names.join(" | ");
        text += " |\n|---|---|---|---|---|---|\n";
        for row in &self.rows {
            let counts: Vec<String> = report::outcomes().map(|end| row.ends[end.name()].to_string()).collect();
            text += &format!("| {} | {} |\n", row.name, counts.join(" | "));
        }
        text += &self.faults();
        text
    }

    /// A table of faults and graph figures of the rows with plans; empty without such rows.
    fn faults(&self) -> String {
        let rows = || self.rows.iter().filter_map(|row| Some((row, row.graph.as_ref()?)));
        if rows().next().is_none() {
            return String::new();
        }
        let mut text = "\n| failures by plan | ".to_owned();
        text += &Fault::ALL.map(|fault| fault.name().replace('_', " ")).join(" | ");
        text += " | vertices | edges | probes | islands | pairs connected \
         |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
        for (row, graph) in rows() {
            let counts = Fault::ALL.map(|fault| row.faults.get(fault.name()).copied().unwrap_or(0).to_string());
            text += &format!(
                "| {} | {} | {:.0} | {:.0} | {:.0} | {:.1} | {:.1} % |\n",
                row.name,
                counts.join(" | "),
                graph.vertices,
                graph.edges,
                graph.probes,
                graph.islands,
                100.0 * graph.connected,
            );
        }
        text
    }
}
