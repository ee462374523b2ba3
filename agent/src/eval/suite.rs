//! The paper's table with our rows beside it.

use super::config::{EvalConfig, EvalError, Method};
use super::report::{self, Rate, Success};
use super::run::run_units;
use super::unit::{GraphFigures, Unit};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;
use surefoot_policy::Policy;
use surefoot_rollout::follow::Fault;
use surefoot_world::{End, MapSpec};

/// Width of the bins that success is counted in by distance, m.
const BIN_M: f32 = 25.0;

/// One row of the paper's table: success on its four test maps, 2,500 goals each, 3 seeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PaperRow {
    /// What was evaluated.
    pub name: &'static str,
    /// Over all goals.
    pub all: f64,
    /// By difficulty.
    pub easy: f64,
    /// By difficulty.
    pub medium: f64,
    /// By difficulty.
    pub hard: f64,
}

/// Published rows first, then those that were only built.
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

/// What stands behind one row of ours.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Name of the paper's row that it stands beside.
    pub name: &'static str,
    /// How goals are approached.
    pub method: Method,
    /// Models, each with the maps that it is evaluated on.
    pub models: Vec<(Policy, Vec<MapSpec>)>,
}

/// One row of ours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the paper's row that it stands beside.
    pub name: String,
    /// Names of the weights.
    pub models: Vec<String>,
    /// Hashes of the weights.
    pub weights: Vec<String>,
    /// Success rates.
    pub success: Success,
    /// Standard deviation of the overall rate between seeds; absent with one seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Attempts by how they ended.
    pub ends: BTreeMap<String, usize>,
    /// Failed attempts by plan by what they were doing.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub faults: BTreeMap<String, usize>,
    /// Mean figures of the graphs, where graphs are used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub graph: Option<GraphFigures>,
    /// Path efficiency: mean over all goals of success times the shortest way that any row found, over the way taken.
    pub efficiency: f64,
    /// Mean seconds of successful attempts.
    pub seconds_to_goal: f64,
    /// Success by distance: upper end of each bin, m.
    pub by_distance: Vec<(f32, Rate)>,
}

/// Success of one model on maps of several splits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Generalisation {
    /// Name of the row.
    pub name: String,
    /// Name of each split with the success on it.
    pub splits: Vec<(String, Rate)>,
}

/// The whole suite's result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SuiteReport {
    /// Goals per map and seed.
    pub goals: usize,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// Seeds of the maps.
    pub maps: Vec<u64>,
    /// Our rows.
    pub rows: Vec<Row>,
    /// Success by split of the models that are not bound to a map.
    pub generalisation: Vec<Generalisation>,
}

/// Everything that was run for one entry.
struct Outcome<'e> {
    entry: &'e Entry,
    units: Vec<Unit>,
}

/// Runs every entry; `base` gives goals, seeds, threads and where units are kept. `progress` gets the name of the row, the
/// attempts finished in it and their total.
///
/// # Errors
/// As for [`super::evaluate`].
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
            let config = EvalConfig { maps: maps.clone(), method: entry.method, ..base.clone() };
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
            let config = EvalConfig { maps: maps.clone(), method: entry.method, seeds, ..base.clone() };
            let units = run_units(&entry.models[0].0, &config, |done, total| progress(split, done, total))?;
            shares.push(((*split).to_owned(), report::success(&units).all));
        }
        generalisation.push(Generalisation { name: entry.name.to_owned(), splits: shares });
    }
    let shortest = shortest_ways(&outcomes);
    let maps = outcomes.first().map_or(Vec::new(), |outcome| {
        outcome.entry.models.iter().flat_map(|(_, maps)| maps).map(|spec| spec.seed).collect()
    });
    let rows = outcomes.iter().map(|outcome| outcome.row(&base.seeds, &shortest)).collect();
    Ok(SuiteReport { goals: base.goals, seeds: base.seeds.clone(), maps, rows, generalisation })
}

/// A goal among all: map, seed, and place in the unit.
type GoalKey = (u64, u64, usize);

/// The shortest successful way to each goal that any row found, m.
fn shortest_ways(outcomes: &[Outcome<'_>]) -> HashMap<GoalKey, f32> {
    let mut shortest = HashMap::new();
    for unit in outcomes.iter().flat_map(|outcome| &outcome.units) {
        for (idx, attempt) in unit.attempts.iter().enumerate().filter(|(_, attempt)| attempt.end == End::Reached) {
            let way = shortest.entry((unit.map, unit.seed, idx)).or_insert(f32::INFINITY);
            *way = attempt.length.min(*way);
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
                let best = shortest[&(unit.map, unit.seed, idx)];
                efficiency += f64::from(best / attempt.length.max(best).max(f32::EPSILON));
            }
        }
        Row {
            name: self.entry.name.to_owned(),
            models: self.entry.models.iter().map(|(policy, _)| policy.manifest().name.clone()).collect(),
            weights: self.entry.models.iter().map(|(policy, _)| policy.weights_hash().to_owned()).collect(),
            success: report::success(units),
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
    /// The table as Markdown: our figures in percent, the paper's beside them.
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        let percent = |share: f64| format!("{:.1}", 100.0 * share);
        writeln!(
            text,
            "{} maps, {} goals each, {} seeds. Success in %: ours (the paper's).\n",
            self.maps.len(),
            self.goals,
            self.seeds.len()
        )
        .expect("a String takes everything");
        text += "| method | all | between seeds | easy | medium | hard | path efficiency | time to goal |\n|---|---|---|---|---|---|---|---|\n";
        for row in &self.rows {
            let paper = PAPER.iter().find(|paper| paper.name == row.name);
            let cell = |rate: Rate, theirs: fn(&PaperRow) -> f64| match paper {
                Some(paper) => format!("{} ({})", percent(rate.rate), percent(theirs(paper))),
                None => percent(rate.rate),
            };
            let Success { all, easy, medium, hard } = row.success;
            writeln!(
                text,
                "| {} | **{}** | {} | {} | {} | {} | {:.2} | {:.1} s |",
                row.name,
                cell(all, |paper| paper.all),
                row.spread.map_or("-".to_owned(), |spread| format!("± {:.2}", 100.0 * spread)),
                cell(easy, |paper| paper.easy),
                cell(medium, |paper| paper.medium),
                cell(hard, |paper| paper.hard),
                row.efficiency,
                row.seconds_to_goal,
            )
            .expect("a String takes everything");
        }
        text += "\n| method | ";
        text += &End::ALL.map(|end| end.name().replace('_', " ")).join(" | ");
        text += " |\n|---|---|---|---|---|---|\n";
        for row in &self.rows {
            let counts = End::ALL.map(|end| row.ends[end.name()].to_string());
            writeln!(text, "| {} | {} |", row.name, counts.join(" | ")).expect("a String takes everything");
        }
        text += &self.faults();
        text
    }

    /// What rows with plans failed at, and what their graphs took.
    fn faults(&self) -> String {
        let rows = || self.rows.iter().filter_map(|row| Some((row, row.graph.as_ref()?)));
        if rows().next().is_none() {
            return String::new();
        }
        let mut text = "\n| failures by plan | ".to_owned();
        text += &Fault::ALL.map(|fault| fault.name().replace('_', " ")).join(" | ");
        text += " | vertices | edges | probes | islands | pairs connected | search |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";
        for (row, graph) in rows() {
            let counts = Fault::ALL.map(|fault| row.faults.get(fault.name()).copied().unwrap_or(0).to_string());
            writeln!(
                text,
                "| {} | {} | {:.0} | {:.0} | {:.0} | {:.1} | {:.1} % | {:.1} us |",
                row.name,
                counts.join(" | "),
                graph.vertices,
                graph.edges,
                graph.probes,
                graph.islands,
                100.0 * graph.connected,
                graph.search_us_median,
            )
            .expect("a String takes everything");
        }
        text
    }
}
