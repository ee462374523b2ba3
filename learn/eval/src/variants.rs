//! Many variants on one split: graphs of growing size, or the 1 km map with and without graphs.

use super::config::{EvalConfig, EvalError, Method};
use super::maps::MapName;
use super::report::{self, Rate, Report};
use super::run::run_units;
use serde::{Deserialize, Serialize};
use surefoot_planner::{BuildSettings, Placement};
use surefoot_policy::Policy;

/// A model and a method to evaluate.
#[derive(Debug, Clone)]
pub struct Variant {
    /// Name in tables.
    pub name: String,
    /// The model.
    pub policy: Policy,
    /// How NPCs approach goals.
    pub method: Method,
}

/// Results of one variant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Name of the variant.
    pub name: String,
    /// Configured number of vertices; 0 without a graph.
    pub vertices: usize,
    /// Configured number of neighbours of each vertex; 0 without a graph.
    pub neighbours: usize,
    /// The evaluation's report.
    pub report: Report,
    /// Success rates by distance, each with its bin's upper end, m.
    pub by_distance: Vec<(f32, Rate)>,
}

/// Numbers of vertices in the paper's sweep.
pub const SWEEP_VERTICES: [usize; 5] = [50, 100, 200, 400, 800];
/// Numbers of neighbours in the paper's sweep.
pub const SWEEP_NEIGHBOURS: [usize; 4] = [5, 10, 20, 40];

/// The paper's sweep over graph sizes: distance-constrained placement, exhaustive probing.
pub fn sweep(policy: &Policy) -> Vec<Variant> {
    let sizes = SWEEP_VERTICES.iter().flat_map(|&vertices| SWEEP_NEIGHBOURS.map(|neighbours| (vertices, neighbours)));
    sizes
        .map(|(vertices, neighbours)| {
            let settings = BuildSettings::of_paper(Placement::Spaced).with(|it| {
                it.vertices = vertices;
                it.neighbours = neighbours;
            });
            let method = Method::Graph(settings.expect("sizes within the limits"));
            Variant { name: format!("{vertices} x {neighbours}"), policy: policy.clone(), method }
        })
        .collect()
}

/// Runs every variant on the maps of `base`. `progress` gets the variant's name and the numbers of its finished and of
/// all its attempts.
pub fn run(
    variants: &[Variant],
    base: &EvalConfig,
    bin_m: f32,
    mut progress: impl FnMut(&str, usize, usize),
) -> Result<Vec<Outcome>, EvalError> {
    variants
        .iter()
        .map(|variant| {
            let config = EvalConfig { method: variant.method, ..base.clone() };
            let units = run_units(&variant.policy, &config, |done, total| progress(&variant.name, done, total))?;
            let (vertices, neighbours) = match variant.method {
                Method::Policy => (0, 0),
                Method::Graph(settings) => (settings.vertices, settings.neighbours),
            };
            Ok(Outcome {
                name: variant.name.clone(),
                vertices,
                neighbours,
                report: report::summarise(&variant.policy, &config, &units),
                by_distance: report::by_distance(&units, bin_m),
            })
        })
        .collect()
}

/// A table of all outcomes as Markdown; empty without outcomes.
pub fn markdown(outcomes: &[Outcome]) -> String {
    let Some(first) = outcomes.first() else { return String::new() };
    let report = &first.report;
    let mut text = format!(
        "Maps {}, {} goals each, seeds {:?}. Success in % with its 95 % interval.\n\n\
         | variant | weights | all | easy | medium | hard | re-plans | time to goal | probes | build | attempts | \
         search |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
        report.maps.iter().map(MapName::to_string).collect::<Vec<_>>().join(", "),
        report.goals,
        report.seeds
    );
    for Outcome { name, report, .. } in outcomes {
        let percent = |rate: f64| format!("{:.1}", 100.0 * rate);
        let all = report.success.all;
        text += &format!(
            "| {name} | {} | **{}** ({}-{}) | {} | {} | {} | {:.2} | {:.1} s |",
            report.model,
            percent(all.rate),
            percent(all.low),
            percent(all.high),
            percent(report.success.easy.rate),
            percent(report.success.medium.rate),
            percent(report.success.hard.rate),
            report.replans,
            report.seconds_to_goal,
        );
        text += &match &report.graph {
            Some(graph) => format!(
                " {:.0} | {:.1} s | {:.0} s | {:.1} us |\n",
                graph.probes, graph.build_s, graph.eval_s, graph.search_us_median
            ),
            None => " - | - | - | - |\n".to_owned(),
        };
    }
    text
}
