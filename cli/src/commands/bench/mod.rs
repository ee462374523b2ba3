//! `surefoot bench`: speed measurements on this machine, as one JSON document.

mod learn;
mod plan;
#[cfg(feature = "reference")]
mod reference;
mod serve;
mod world;

use crate::terminal::print_json;
use serde::Serialize;
use std::time::Instant;

/// Measure speed.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot bench world\n  surefoot bench learn --json\n  surefoot bench plan\n  surefoot bench serve --minutes 1"
)]
pub struct Args {
    /// world: simulation and maps; learn: SAC updates and inference; plan: graphs and path queries; serve: the world server under load
    #[arg(value_parser = ["world", "learn", "plan", "serve"])]
    what: String,
    /// serve: Number of NPCs, on 8 worlds
    #[arg(long, default_value_t = 1024, value_name = "N")]
    npcs: usize,
    /// serve: Duration of the measurement
    #[arg(long, default_value_t = 10.0, value_name = "MINUTES")]
    minutes: f64,
    /// serve: Folder for the plot of tick time over the number of NPCs
    #[arg(long, value_name = "FOLDER")]
    out: Option<std::path::PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// One measured figure. All benches share this form.
#[derive(Serialize)]
struct Figure {
    name: &'static str,
    value: f64,
    unit: &'static str,
    target: Option<f64>,
    reference: Option<f64>,
    reference_name: Option<&'static str>,
    ratio: Option<f64>,
}

impl Figure {
    fn new(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self { name, value, unit, target: None, reference: None, reference_name: None, ratio: None }
    }

    fn target(self, target: f64) -> Self {
        Self { target: Some(target), ..self }
    }

    /// Like [`with_reference`](Self::with_reference), if this build includes the other system.
    fn with_optional_reference(self, name: &'static str, reference: Option<f64>, higher_is_better: bool) -> Self {
        match reference {
            Some(reference) => self.with_reference(name, reference, higher_is_better),
            None => self,
        }
    }

    /// Adds the figure of another system, measured in the same run. The ratio says how many times better ours is.
    fn with_reference(self, name: &'static str, reference: f64, higher_is_better: bool) -> Self {
        let ratio = if higher_is_better { self.value / reference } else { reference / self.value };
        Self { reference: Some(reference), reference_name: Some(name), ratio: Some(ratio), ..self }
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let figures = match args.what.as_str() {
        "world" => world::figures()?,
        "learn" => learn::figures()?,
        "serve" => serve::figures(args)?,
        _ => plan::figures()?,
    };
    if args.json {
        return print_json(&serde_json::json!({ "bench": args.what, "machine": machine(), "figures": figures }));
    }
    println!("{}", machine());
    for figure in &figures {
        let Figure { name, value, unit, .. } = figure;
        let target = figure.target.map_or(String::new(), |target| format!("  target {target}"));
        let reference = match (figure.reference_name, figure.reference, figure.ratio) {
            (Some(name), Some(value), Some(ratio)) => format!("  {name} {value:.2}, ratio {ratio:.2}"),
            _ => String::new(),
        };
        println!("{name:<28}{value:>12.2} {unit}{target}{reference}");
    }
    Ok(())
}

fn machine() -> String {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map(|rest| rest.trim_start_matches([' ', '\t', ':']));
    format!("{} x {}", super::core_count(), model.unwrap_or(std::env::consts::ARCH))
}

fn timed(mut work: impl FnMut()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}
