//! `surefoot challenge motion`.

use super::{load_set, read_run};
use anyhow::Context;
use std::path::PathBuf;
use surefoot_cli::commands::{core_count, machine};
use surefoot_cli::terminal::{print_json, progress_bar};
use surefoot_eval::challenge::motion::{Comparison, MotionRow, compare};

/// Compare how the bodies of several runs move, at the goals that all of them reach.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot challenge motion ours.json.gz detour-crowd.json --set sets/mine\n  \
        surefoot challenge motion ours.json.gz detour.json --shortest detour.json --set sets/mine --json")]
pub struct Args {
    /// Runs (.json, or compressed .json.gz); their attempts may be tracks
    #[arg(value_name = "FILE", required = true)]
    runs: Vec<PathBuf>,
    /// Folder of the set; default: the set of the challenge that is named in the first run
    #[arg(long, value_name = "FOLDER")]
    set: Option<PathBuf>,
    /// Run whose walked paths are the shortest ones: only goals with such a path are measured, and the distance that
    /// bodies cover is compared with it
    #[arg(long, value_name = "FILE")]
    shortest: Option<PathBuf>,
    /// Measure only goals that all runs reach without jumps and devices
    #[arg(long)]
    on_foot: bool,
    /// Number of threads; default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let runs = args.runs.iter().map(|path| read_run(path)).collect::<anyhow::Result<Vec<_>>>()?;
    let shortest = args.shortest.as_deref().map(read_run).transpose()?;
    let first = runs.first().context("name at least one run")?;
    let (set, folder) = match &args.set {
        Some(folder) => load_set(&folder.to_string_lossy())?,
        None => load_set(&first.set)?,
    };
    let bar = progress_bar(set.maps.len() as u64, "measuring");
    let thread_count = args.threads.unwrap_or_else(core_count);
    let comparison = Comparison { runs: &runs, shortest: shortest.as_ref(), on_foot: args.on_foot };
    let rows = compare((&set, &folder), comparison, thread_count, |map| {
        bar.set_message(map.to_owned());
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    if args.json {
        return print_json(&serde_json::json!({ "set": set.hash(), "machine": machine(), "rows": rows }));
    }
    println!("{} (set {}); body {:.1} m/s\n", machine(), &set.hash()[..8], set.body.forward_speed);
    print_table(&rows);
    Ok(())
}

/// Rows as a Markdown table.
fn print_table(rows: &[MotionRow]) {
    println!(
        "| map | entrant | reached | measured | s to goal | path / shortest | reversals/s | per 100 m | facing p50, \
         p90, degrees | jumps per 100 m | in the air | jerk, m/s3 |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for it in rows {
        println!(
            "| {} | {} | {} of {} | {} | {:.1} | {} | {:.2} | {:.1} | {:.0}, {:.0} | {:.2} | {:.1} % | {:.0} |",
            it.map.as_deref().unwrap_or("all"),
            it.entrant,
            it.reached,
            it.goals,
            it.measured,
            it.seconds_to_goal,
            it.path_over_shortest.map_or("-".to_owned(), |it| format!("{it:.2}")),
            it.reversals_per_s,
            it.reversals_per_100m,
            it.facing_p50_deg,
            it.facing_p90_deg,
            it.jumps_per_100m,
            100.0 * it.air_share,
            it.jerk,
        );
    }
}
