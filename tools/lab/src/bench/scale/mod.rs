//! How far a fleet scales. `load` and `record` measure its parts on this machine, `model` computes how many parts a
//! fleet needs and how busy they are, and `simulation` runs fleets of several sizes with the recorded load and checks
//! their tick times (`docs/guides/scaling.md`).

mod load;
mod model;
#[cfg(feature = "fleet")]
mod record;
mod record_load;
mod simulation;

use super::serve::{TARGET_LATE_SHARE, TARGET_ON_TIME, TARGET_P99_MS};
use super::{Args, Figure};
use anyhow::Context;
use load::Load;
use model::{Fleet, Model};
use simulation::{Played, play};

/// Numbers of servers that are simulated.
const SERVERS: [usize; 3] = [1, 4, 16];
/// Cores of one server.
const SERVER_CORES: usize = 2;
/// Tried numbers of NPCs per server, ascending.
const LADDER: [usize; 9] = [512, 1024, 1536, 2048, 3072, 4096, 5120, 6144, 8192];
/// Largest planned utilisation of a pool.
const PLANNED_SHARE: f64 = 0.7;

pub fn figures(args: &Args) -> anyhow::Result<Vec<Figure>> {
    let load = match &args.load {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            serde_json::from_str(&text).with_context(|| format!("{} is not a recorded load", path.display()))?
        }
        None => Load::record(args.fleet())?,
    };
    if let Some(folder) = &args.out {
        let path = folder.join("load.json");
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        std::fs::write(&path, serde_json::to_string_pretty(&load)? + "\n")
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let model = Model::of(&load)?;
    model.print();
    compare_with_what_was_measured(&load, &model);
    let mut figures = model.figures();
    let mut per_server = Vec::new();
    for servers in SERVERS {
        let held = most_held(&load, &model, servers);
        per_server.push(held);
        let name = if servers == 1 { "held_by_1_server".to_owned() } else { format!("held_by_each_of_{servers}") };
        figures.push(Figure::new(name, held as f64, "NPCs"));
    }
    model.print_fleets(per_server[2].max(1));
    let alone = per_server[0].max(1) as f64;
    figures.push(Figure::new("efficiency_at_16", per_server[2] as f64 / alone, ""));
    Ok(figures)
}

/// Simulates the recorded deployment, whose server, workers and planner share the cores, and prints both results.
fn compare_with_what_was_measured(load: &Load, model: &Model) {
    eprintln!("\nthe recorded machine, {} cores for all parts: simulated and measured", load.cores);
    for rung in &load.rungs {
        let played = play(Fleet::on_one_machine(load, rung.npcs), model, load);
        eprintln!(
            "{:>5} NPCs: tick p50 {:.2} and {:.2} ms, p99 {:.2} and {:.2} ms, late {:.3} and {:.3} %, cores busy \
             {:.1} and {:.1} %",
            rung.npcs,
            played.tick_p50_ms,
            rung.tick_p50_ms,
            played.tick_p99_ms,
            rung.tick_p99_ms,
            100.0 * played.late_share,
            100.0 * rung.late_share,
            100.0 * played.server_share,
            100.0 * rung.busy_share(load.cores),
        );
    }
}

/// Prints the tried numbers of NPCs for a fleet with `servers` servers, and returns the largest number within all
/// targets.
fn most_held(load: &Load, model: &Model, servers: usize) -> usize {
    eprintln!("\n{servers} servers of {SERVER_CORES} cores, with the model's numbers of workers and planners");
    let mut held = 0;
    for npcs in LADDER {
        let fleet = Fleet::planned(model, servers, SERVER_CORES, npcs, PLANNED_SHARE);
        let played = play(fleet, model, load);
        let expected = model.shares(&fleet);
        let is_held = is_held(&played);
        let of = |share: f64| 100.0 * share;
        eprintln!(
            "{npcs:>5} NPCs each, {} workers, {} planners: tick p99 {:.2} ms, {:.3} % late, {:.3} % of decisions on \
             time; busy, simulated (model): servers {:.0} ({:.0}) %, workers {:.0} ({:.0}) %, planners {:.0} ({:.0}) \
             %, database {:.1} ({:.1}) %: {}",
            fleet.workers,
            fleet.planners,
            played.tick_p99_ms,
            of(played.late_share),
            of(played.on_time_share),
            of(played.server_share),
            of(expected.server),
            of(played.worker_share),
            of(expected.worker),
            of(played.planner_share),
            of(expected.planner),
            of(played.record_share),
            of(expected.record),
            if is_held { "held" } else { "not held" },
        );
        if !is_held {
            break;
        }
        held = npcs;
    }
    held
}

fn is_held(played: &Played) -> bool {
    played.tick_p99_ms <= TARGET_P99_MS
        && played.late_share <= TARGET_LATE_SHARE
        && played.on_time_share >= TARGET_ON_TIME
}
