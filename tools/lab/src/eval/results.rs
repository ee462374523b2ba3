//! Results of all suites: as JSON, as a table, and as plots.

use crate::provenance::write_into;
use serde::Serialize;
use std::path::Path;
use surefoot_cli::terminal::print_json;
use surefoot_eval::ablation::AblationReport;
use surefoot_eval::conditions::ConditionReport;
use surefoot_eval::living::LivingReport;
use surefoot_eval::suite::{self, SuiteReport};
use surefoot_eval::variants::{self, Outcome};
use surefoot_eval::{Interval, Rate, Report};
use surefoot_report::plots;

/// What was measured.
#[derive(Serialize)]
#[serde(untagged)]
pub enum Results {
    Plain(Box<Report>),
    Paper(SuiteReport),
    Ablation(Box<AblationReport>),
    Sweep(Vec<Outcome>),
    BigMap(Vec<Outcome>),
    Living(LivingReport),
    Conditions(ConditionReport),
}

impl Results {
    pub fn json(&self) -> anyhow::Result<serde_json::Value> {
        Ok(serde_json::to_value(self)?)
    }

    /// The table in Markdown; `None` without a suite.
    fn table(&self) -> Option<String> {
        match self {
            Self::Plain(_) => None,
            Self::Paper(report) => Some(report.markdown()),
            Self::Ablation(report) => Some(report.markdown()),
            Self::Sweep(outcomes) | Self::BigMap(outcomes) => Some(variants::markdown(outcomes)),
            Self::Living(report) => Some(report.markdown()),
            Self::Conditions(report) => Some(report.markdown()),
        }
    }

    pub fn print(&self, json: bool) -> anyhow::Result<()> {
        match (json, self) {
            (true, _) => print_json(&self.json()?)?,
            (false, Self::Plain(report)) => super::plain::print(report),
            (false, _) => print!("{}", self.table().unwrap_or_default()),
        }
        Ok(())
    }

    /// Writes table and plots.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        if let Some(table) = self.table() {
            write_into(folder, "table.md", &table)?;
        }
        match self {
            Self::Plain(_) | Self::Living(_) => {}
            Self::Paper(report) => write_paper(report, folder)?,
            Self::Ablation(report) => write_ablation(report, folder)?,
            Self::Conditions(report) => write_conditions(report, folder)?,
            Self::Sweep(outcomes) => {
                let sizes = size_outcomes(outcomes);
                plots::sweep(&sizes, &folder.join("success.svg"))?;
                plots::run_time(&sizes, &folder.join("run-time.svg"))?;
            }
            Self::BigMap(outcomes) => {
                let lines = outcomes.iter().map(|outcome| (outcome.name.as_str(), bins(&outcome.by_distance)));
                let path = folder.join("success-by-distance.svg");
                plots::success_by_distance(&lines.collect::<Vec<_>>(), 50.0, &path)?;
            }
        }
        Ok(())
    }
}

fn write_paper(report: &SuiteReport, folder: &Path) -> anyhow::Result<()> {
    let lines = report.rows.iter().map(|row| (row.name.as_str(), bins(&row.by_distance)));
    plots::success_by_distance(&lines.collect::<Vec<_>>(), 12.5, &folder.join("success-by-distance.svg"))?;
    let groups = report.generalisation.iter().map(|group| plots::BarGroup {
        name: &group.name,
        bars: group.splits.iter().map(|(split, rate)| (split.as_str(), rate.rate)).collect(),
        paper: suite::PAPER.iter().find(|paper| paper.name == group.name).map(|paper| paper.all),
    });
    Ok(plots::generalisation(&groups.collect::<Vec<_>>(), &folder.join("generalisation.svg"))?)
}

fn write_ablation(report: &AblationReport, folder: &Path) -> anyhow::Result<()> {
    let rows = report.factors.iter().map(|it| range_row(it.factor.about(), [&it.adds_to_paper, &it.adds_to_ours]));
    let axes = plots::RangeAxes {
        title: "What each choice adds, with 95 % intervals over maps",
        x: "points",
        series: &["to the paper's method", "to all others of ours"],
    };
    Ok(plots::ranges(axes, &rows.collect::<Vec<_>>(), &folder.join("factors.svg"))?)
}

fn write_conditions(report: &ConditionReport, folder: &Path) -> anyhow::Result<()> {
    let rows = report.rows.iter().map(|row| range_row(&row.name, [&row.policy.success, &row.plan.success]));
    let axes = plots::RangeAxes {
        title: "Success with 95 % intervals over maps and models",
        x: "success, %",
        series: &["the policy alone", "the policy by plan"],
    };
    Ok(plots::ranges(axes, &rows.collect::<Vec<_>>(), &folder.join("success.svg"))?)
}

fn range_row<'a>(name: &'a str, intervals: [&Interval; 2]) -> plots::RangeRow<'a> {
    let range = |it: &Interval| [it.low, it.mean, it.high].map(|share| 100.0 * share);
    plots::RangeRow { name, ranges: intervals.map(range).to_vec() }
}

fn bins(by_distance: &[(f32, Rate)]) -> Vec<plots::DistanceBin> {
    let bin = |&(far_m, rate): &(f32, Rate)| plots::DistanceBin {
        far_m,
        rate: rate.rate,
        interval: [rate.low, rate.high],
        count: rate.n,
    };
    by_distance.iter().map(bin).collect()
}

/// Outcomes that used a graph, with its size.
fn size_outcomes(outcomes: &[variants::Outcome]) -> Vec<plots::SizeOutcome> {
    let size = |outcome: &variants::Outcome| {
        let graph = outcome.report.graph.as_ref()?;
        Some(plots::SizeOutcome {
            vertices: outcome.vertices,
            neighbours: outcome.neighbours,
            rate: outcome.report.success.all.rate,
            total_s: graph.build_s + graph.eval_s,
            search_us: graph.search_us_median,
        })
    };
    outcomes.iter().filter_map(size).collect()
}
