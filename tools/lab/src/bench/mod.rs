//! `surefoot bench`: speed measurements on this machine, as one JSON document.

mod edits;
mod feed;
mod floods;
mod follow;
mod growth;
mod learn;
pub mod link;
mod many;
mod plan;
mod queue;
#[cfg(feature = "reference")]
mod reference;
mod scale;
mod serve;
mod soak;
mod streams;
mod survey;
mod tiles;
mod world;

use anyhow::Context;
use clap::ValueEnum;
use serde::Serialize;
use std::borrow::Cow;
use std::time::Instant;
use surefoot_cli::commands::machine;
use surefoot_cli::commands::map::{BodyArg, LevelArgs, files_only, parse_maps};
use surefoot_cli::terminal::print_json;

/// Measure speed.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot bench world\n  \
        surefoot bench learn --json\n  \
        surefoot bench plan\n  \
        surefoot bench follow\n  \
        surefoot bench serve --minutes 1\n  \
        surefoot bench soak --minutes 3\n  \
        surefoot bench floods\n  \
        surefoot bench feed\n  \
        surefoot bench scale --out docs/results/scale\n  \
        surefoot bench queue --json\n  \
        surefoot bench growth\n  \
        surefoot bench survey --maps 'levels/*.glb' --minutes 2")]
pub struct Args {
    /// What to measure
    what: Bench,
    /// serve, soak, floods: number of NPCs, on 8 worlds; default: 1024, 256 and 256
    #[arg(long, value_name = "N")]
    npcs: Option<usize>,
    /// serve, soak: duration of the measurement, above 0; survey: that of each explorer
    #[arg(long, default_value_t = 10.0, value_name = "MINUTES", value_parser = parse_minutes)]
    minutes: f64,
    /// world, survey: levels to measure on instead of generated maps (.sfmap, .glb, .gltf, .obj), or patterns such as
    /// 'levels/*.glb'; may be repeated
    #[arg(long, value_name = "FILE,...")]
    maps: Vec<String>,
    #[command(flatten)]
    levels: LevelArgs,
    #[command(flatten)]
    body: BodyArg,
    /// serve: folder for the plot of tick time over the number of NPCs; scale: folder for the recorded load,
    /// `load.json`
    #[arg(long, value_name = "FOLDER")]
    out: Option<std::path::PathBuf>,
    /// scale: simulate with this recorded load instead of recording one
    #[arg(long, value_name = "FILE")]
    load: Option<std::path::PathBuf>,
    /// scale: also measure the load on this PostgreSQL database, which must run on this machine. Needs a build with
    /// --features fleet
    #[arg(long, value_name = "URL", hide_env_values = true, requires = "blobs", conflicts_with = "load")]
    store: Option<String>,
    /// scale: the object store that belongs to --store
    #[arg(long, value_name = "URI", requires = "store")]
    blobs: Option<String>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// A bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Bench {
    /// Simulation and maps
    World,
    /// SAC updates and inference
    Learn,
    /// Graphs and path queries
    Plan,
    /// NPCs that follow plans, steered where they can be
    Follow,
    /// The world server under load
    Serve,
    /// All services under a mixed load for a long time
    Soak,
    /// Tick times while unauthenticated clients flood the server
    Floods,
    /// A learner that a growing number of worlds or actors feed
    Feed,
    /// The load of a fleet's parts, and simulated fleets of 1, 4 and 16 servers
    Scale,
    /// Probes by 1 to 4 provers over NATS; nats-server must be installed
    Queue,
    /// How the time of builds, edits, queries, spawns and events grows with their size: the exponent of a power law
    Growth,
    /// Where the survey says that bodies get, against a random explorer
    Survey,
}

impl Bench {
    fn name(self) -> String {
        self.to_possible_value().expect("no bench is hidden").get_name().to_owned()
    }
}

impl Args {
    /// The database and the object store of a fleet.
    fn fleet(&self) -> Option<[&str; 2]> {
        Some([self.store.as_deref()?, self.blobs.as_deref()?])
    }
}

fn parse_minutes(text: &str) -> Result<f64, String> {
    let minutes: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if minutes > 0.0 && minutes <= 1.0e5 { Ok(minutes) } else { Err("must be above 0 and at most 100000".to_owned()) }
}

/// One measured figure. All benches share this form.
#[derive(Serialize, Default)]
struct Figure {
    /// The level that it was measured on, if `--maps` named one; for growth, what was counted.
    #[serde(skip_serializing_if = "Option::is_none")]
    level: Option<String>,
    name: Cow<'static, str>,
    value: f64,
    unit: &'static str,
    target: Option<f64>,
    /// Whether the value meets the target.
    met: Option<bool>,
    reference: Option<f64>,
    reference_name: Option<&'static str>,
    ratio: Option<f64>,
}

impl Figure {
    fn new(name: impl Into<Cow<'static, str>>, value: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, unit, ..Self::default() }
    }

    /// Says on which level it was measured.
    fn on(self, level: &str) -> Self {
        Self { level: Some(level.to_owned()), ..self }
    }

    /// Sets a target that the value must not exceed.
    fn at_most(self, target: f64) -> Self {
        Self { target: Some(target), met: Some(self.value <= target), ..self }
    }

    /// Sets a target that the value must reach.
    fn at_least(self, target: f64) -> Self {
        Self { target: Some(target), met: Some(self.value >= target), ..self }
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
    let maps = parse_maps(&args.maps).context("--maps")?;
    args.levels.check(&maps)?;
    let files = files_only(maps).context("--maps")?;
    let figures = match args.what {
        Bench::World if files.is_empty() => world::figures()?,
        Bench::World => world::figures_on(&files, &args.levels)?,
        Bench::Survey => survey::figures(&files, &args.levels, &args.body.profile()?, args.minutes)?,
        _ if !files.is_empty() => anyhow::bail!("--maps is only for `bench world` and `bench survey`"),
        Bench::Learn => learn::figures()?,
        Bench::Plan => plan::figures()?,
        Bench::Follow => follow::figures()?,
        Bench::Serve => serve::figures(args)?,
        Bench::Soak => soak::figures(args)?,
        Bench::Floods => floods::figures(args)?,
        Bench::Feed => feed::figures()?,
        Bench::Scale => scale::figures(args)?,
        Bench::Queue => queue::figures()?,
        Bench::Growth => growth::figures()?,
    };
    if args.json {
        print_json(&serde_json::json!({ "bench": args.what.name(), "machine": machine(), "figures": figures }))?;
        return check_targets(args, &figures);
    }
    println!("{}", machine());
    let mut level = &None;
    for figure in &figures {
        let Figure { name, value, unit, .. } = figure;
        if figure.level != *level {
            level = &figure.level;
            println!("\n{}", level.as_deref().unwrap_or_default());
        }
        let missed = if figure.met == Some(false) { " MISSED" } else { "" };
        let target = figure.target.map_or(String::new(), |target| format!("  target {target}{missed}"));
        let reference = match (figure.reference_name, figure.reference, figure.ratio) {
            (Some(name), Some(value), Some(ratio)) => format!("  {name} {value:.2}, ratio {ratio:.2}"),
            _ => String::new(),
        };
        println!("{name:<28}{value:>12.2} {unit}{target}{reference}");
    }
    check_targets(args, &figures)
}

/// Fails if a service missed a target. Speed depends on the machine, so the other benches only print.
fn check_targets(args: &Args, figures: &[Figure]) -> anyhow::Result<()> {
    let missed: Vec<&str> = figures.iter().filter(|it| it.met == Some(false)).map(|it| &*it.name).collect();
    if !missed.is_empty() && matches!(args.what, Bench::Serve | Bench::Soak | Bench::Floods) {
        anyhow::bail!("targets missed: {}", missed.join(", "));
    }
    Ok(())
}

/// A number of a process in `/proc/PID/status`, in the unit of that file; `pid` may be `self`. `None` if the system
/// does not report it.
pub(super) fn process_status(pid: &str, name: &str) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Time that `work` takes, s.
fn timed<T>(work: impl FnOnce() -> T) -> f64 {
    timed_with(work).1
}

/// The result of `work`, and the time that it takes, s.
fn timed_with<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let started = Instant::now();
    let result = work();
    (result, started.elapsed().as_secs_f64())
}

/// Intercept and slope of the line through `points` (x, y) with the least squared error.
fn line_through(points: &[[f64; 2]]) -> [f64; 2] {
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / points.len() as f64;
    let [mean_x, mean_y] = [mean(0), mean(1)];
    let products: f64 = points.iter().map(|[x, y]| (x - mean_x) * (y - mean_y)).sum();
    let squares: f64 = points.iter().map(|[x, _]| (x - mean_x).powi(2)).sum();
    let slope = products / squares.max(f64::MIN_POSITIVE);
    [mean_y - slope * mean_x, slope]
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}
