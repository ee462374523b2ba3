//! `surefoot eval`.

use super::map::{BodyArg, Generated, file_name, level_files, load_level};
use super::services::{GraphArgs, StyleArg};
use super::{core_count, load_policy, parse_maps, parse_seeds};
use crate::terminal::{print_json, progress_bar};
use anyhow::{Context, bail};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_agent::eval::ablation::{self, Policies};
use surefoot_agent::eval::living::{self, LivingConfig};
use surefoot_agent::eval::report::CalibrationBin;
use surefoot_agent::eval::suite::{self, Entry};
use surefoot_agent::eval::variants::{self, Variant};
use surefoot_agent::eval::{EvalConfig, EvalMap, MapName, Method, Price, Rate, Report, evaluate};
use surefoot_planner::{Attach, BuildSettings, Placement, Probing, SettingError};
use surefoot_policy::Policy;
use surefoot_report::plots;
use surefoot_rollout::{DEFAULT_NOISE_SHARE, FollowConfig};
use surefoot_world::MapSpec;

/// Measure success on maps by the paper's protocol: random goals, thirds by distance, 300 decisions of patience.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot eval --maps validation --goals 200 --placement flood\n  surefoot eval --maps validation --goals 500 --method policy --distance 2..25 --json\n  surefoot eval --maps test --goals 2500 --seed 0..3 --vertices 800 --neighbours 20\n  surefoot eval --maps level.glb,other.obj --json\n  surefoot eval --maps validation --kind islands --features all\n  surefoot eval --suite paper --goals 2500 --seed 0..3 --out docs/results/paper\n  surefoot eval --suite sweep --goals 500 --out docs/results/sweep\n  surefoot eval --suite big-map --goals 10000 --out docs/results/big-map\n  surefoot eval --suite living --runs 10"
)]
pub struct Args {
    /// Run a whole table instead: the paper's rows for which --models has weights (paper); what each of our choices adds to the paper's
    /// method, and to the others of ours (ablation); graphs of
    /// growing size on the validation maps (sweep); the 1 km map with and without graphs (big-map); or crowds, doors, lifts, platforms,
    /// floors that vanish and players (living)
    #[arg(long, value_parser = ["paper", "ablation", "sweep", "big-map", "living"], conflicts_with_all = ["method", "model", "distance"])]
    suite: Option<String>,
    /// Folder with the models of the suite
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    models: PathBuf,
    /// Save finished maps and seeds in this folder and reuse them; with --suite, also write the table, plots and JSON
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Maps to evaluate on: training, validation, test, benchmark, seeds such as 7 or 1000,1001 or 0..4, or files (.sfmap, .glb, .gltf, .obj)
    /// [default: validation; test for --suite paper]
    #[arg(long)]
    maps: Option<String>,
    #[command(flatten)]
    generated: Generated,
    #[command(flatten)]
    body: BodyArg,
    /// Goals per map and seed
    #[arg(long, default_value_t = 200, value_name = "N")]
    goals: usize,
    /// Head straight for goals (policy), or follow plans on a graph built with the options below (graph)
    #[arg(long, default_value = "graph", value_parser = ["policy", "graph"])]
    method: String,
    #[command(flatten)]
    graph: GraphArgs,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Straight-line distance to goals in metres; default: any
    #[arg(long, value_name = "MIN..MAX")]
    distance: Option<String>,
    /// Seeds of goals, graphs and noise, such as 0 or 0..3; each runs one whole evaluation
    #[arg(long, default_value = "0", value_name = "SEED")]
    seed: String,
    #[command(flatten)]
    rules: Rules,
    /// Share of the policy's exploration noise to add to actions, 0 to 1
    #[arg(long, default_value_t = DEFAULT_NOISE_SHARE, value_name = "SHARE")]
    noise: f32,
    /// Let NPCs follow their plans without rehearsing what lies ahead, as in the suites paper and sweep
    #[arg(long)]
    no_rehearsals: bool,
    /// Runs of each scene of the suite living, each with another seed
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    runs: u64,
    /// Scene of the suite living, instead of all; may be repeated
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(living::SCENES))]
    scene: Vec<String>,
    #[command(flatten)]
    style: StyleArg,
    /// Number of threads; default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Rules of attempts, where the paper's differ from ours.
#[derive(clap::Args)]
struct Rules {
    /// Follow the paper: start and goal snap to the nearest vertex, edges cost their steps, failed legs are not remembered, re-plans have no
    /// limit, nothing is rehearsed or composed, NPCs are not told where zip lines and teleporters are, no vertices or candidates at devices,
    /// all probes are run; the default model is general-lstm. Limits are those of --patience and --replan-after
    #[arg(long, conflicts_with_all = ["attach", "price", "forget", "max_replans", "no_transports"])]
    faithful: bool,
    /// Decisions without progress that end an attempt
    #[arg(long, default_value_t = FollowConfig::default().patience, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    patience: u32,
    /// Decisions without coming closer to a waypoint that cause a re-plan
    #[arg(long, default_value_t = FollowConfig::default().replan_after, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    replan_after: u32,
    /// Most re-plans of an attempt
    #[arg(long, default_value_t = FollowConfig::default().max_replans, value_name = "N")]
    max_replans: u32,
    /// Join start and goal to several near vertices, or to the nearest one
    #[arg(long, default_value = "several", value_parser = ["several", "nearest"])]
    attach: String,
    /// What edges cost: what their risks are worth besides (risk), or their mean number of decisions (steps)
    #[arg(long, default_value = "risk", value_parser = ["risk", "steps"])]
    price: String,
    /// Let plans use legs again that failed in the same attempt
    #[arg(long)]
    forget: bool,
    /// Do not tell NPCs where zip lines and teleporters are
    #[arg(long)]
    no_transports: bool,
}

impl Rules {
    fn follow(&self, composes: bool) -> FollowConfig {
        let limits =
            FollowConfig { patience: self.patience, replan_after: self.replan_after, ..FollowConfig::of_paper() };
        if self.faithful {
            return limits;
        }
        let attach = if self.attach == "nearest" { Attach::Nearest } else { Attach::Several };
        FollowConfig { max_replans: self.max_replans, remembers: !self.forget, attach, composes, ..limits }
    }

    fn price(&self) -> Price {
        if self.faithful || self.price == "steps" { Price::Steps } else { Price::Risk }
    }

    /// The policy as these rules let it sense.
    fn apply(&self, policy: Policy) -> Policy {
        if self.faithful || self.no_transports { policy.without_transports() } else { policy }
    }

    fn graph(&self, settings: BuildSettings) -> Result<BuildSettings, SettingError> {
        if !self.faithful {
            return Ok(settings);
        }
        let paper = BuildSettings::of_paper(settings.placement);
        settings.with(|it| {
            (it.probing, it.special_moves, it.threshold) = (paper.probing, paper.special_moves, paper.threshold);
        })
    }
}

/// Subfolder of `--out` for finished units.
const UNITS: &str = "units";

pub fn run(args: &Args) -> anyhow::Result<()> {
    let config = args.config()?;
    match args.suite.as_deref() {
        Some("paper") => return run_suite(args, &config),
        Some("ablation") => return run_ablation(args, &config),
        Some("sweep") => return run_sweep(args, &config),
        Some("living") => return run_living(args, &config),
        Some(_) => return run_big_map(args, &config),
        None => {}
    }
    let model = args.model.clone().or_else(|| args.rules.faithful.then(|| args.models.join("general-lstm")));
    let policy = args.rules.apply(load_policy(model.as_deref())?);
    let bar = progress_bar((config.maps.len() * config.seeds.len() * config.goals) as u64, "evaluating");
    let report = evaluate(&policy, &config, |done, _| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    if args.json { print_json(&report) } else { print_table(&report) }
}

impl Args {
    /// Generated maps by seed, or levels by file.
    fn maps(&self) -> anyhow::Result<Vec<EvalMap>> {
        let maps = self.maps.as_deref().unwrap_or("validation");
        let Some(files) = level_files(maps) else {
            let kind = |spec: MapSpec| self.generated.apply(&spec).map(EvalMap::from);
            return parse_maps(maps, self.generated.size)?.into_iter().map(kind).collect();
        };
        let level = |file: &Path| Ok(EvalMap::Level { name: file_name(file), map: Arc::new(load_level(file)?) });
        files.into_iter().map(level).collect()
    }

    fn config(&self) -> anyhow::Result<EvalConfig> {
        if !(1..=100_000).contains(&self.goals) {
            bail!("--goals is {}, allowed are 1 to 100000", self.goals);
        }
        if !(0.0..=1.0).contains(&self.noise) {
            bail!("--noise is {}, allowed are 0 to 1", self.noise);
        }
        let settings = self.rules.graph(self.graph.settings()?)?;
        let method = if self.method == "policy" { Method::Policy } else { Method::Graph(settings) };
        Ok(EvalConfig {
            maps: self.maps()?,
            goals: self.goals,
            seeds: parse_seeds(&self.seed).context("--seed")?,
            profile: self.body.profile()?,
            method,
            distance: self.distance.as_deref().map_or(Ok(1.0..f32::INFINITY), parse_distance)?,
            noise_share: self.noise,
            rehearses: !self.no_rehearsals
                && !self.rules.faithful
                && !matches!(self.suite.as_deref(), Some("paper" | "sweep")),
            follow: self.rules.follow(self.style.composes()),
            price: self.rules.price(),
            keep_in: self.out.as_ref().map(|folder| folder.join(UNITS)),
            thread_count: self.threads.unwrap_or_else(core_count),
        })
    }
}

/// The rows of the paper's table for which `--models` has weights.
fn paper_entries(args: &Args) -> anyhow::Result<Vec<Entry>> {
    let load = |name: &str| -> anyhow::Result<Option<Policy>> {
        let folder = args.models.join(name);
        if !folder.exists() {
            eprintln!("no {}: its row is omitted", folder.display());
            return Ok(None);
        }
        load_policy(Some(&folder)).map(|policy| Some(args.rules.apply(policy)))
    };
    let maps = parse_maps(args.maps.as_deref().unwrap_or("test"), args.generated.size)?;
    let mut specific = Vec::new();
    for spec in &maps {
        specific.extend(load(&format!("lstm-map-{}", spec.seed))?.map(|policy| (policy, vec![*spec])));
    }
    let (reactive, recurrent) = (load("general-reactive")?, load("general-lstm")?);
    // The paper's graphs are those of its LSTM.
    let follower = if args.rules.faithful { &recurrent } else { &reactive };
    let mut entries = Vec::new();
    let mut push = |name, method, models: Vec<(Policy, Vec<MapSpec>)>| {
        if !models.is_empty() {
            entries.push(Entry { name, method, models });
        }
    };
    let on_all = |policy: Option<Policy>| policy.map(|policy| (policy, maps.clone())).into_iter().collect::<Vec<_>>();
    push("map-specific LSTM", Method::Policy, specific);
    push("general reactive", Method::Policy, on_all(reactive.clone()));
    push("general LSTM", Method::Policy, on_all(recurrent.clone()));
    let rows = [
        ("unconstrained random graph", Placement::Random),
        ("distance-constrained graph", Placement::Spaced),
        ("density-based graph", Placement::Density),
        ("trajectory merging graph", Placement::Trajectories),
        ("trajectory merging graph with edge tests", Placement::TrajectoriesTested),
        ("flood graph", Placement::Flood),
        ("flood graph with grandchild edges", Placement::FloodGrandchildren),
    ];
    for (name, placement) in rows {
        let settings = args.rules.graph(args.graph.settings()?)?.with(|it| {
            it.probing = Probing::Exhaustive;
            it.special_moves = false;
            it.placement = placement;
        })?;
        push(name, Method::Graph(settings), on_all(follower.clone()));
    }
    if !args.rules.faithful {
        push("ours: frugal, with special moves", Method::Graph(args.graph.settings()?), on_all(reactive));
    }
    Ok(entries)
}

fn run_suite(args: &Args, base: &EvalConfig) -> anyhow::Result<()> {
    let entries = paper_entries(args)?;
    let splits = [("training", parse_maps("0..4", args.generated.size)?)].into_iter().chain([
        ("validation", parse_maps("validation", args.generated.size)?),
        ("test", parse_maps("test", args.generated.size)?),
    ]);
    let bar = progress_bar(1, "evaluating");
    let report = suite::run(&entries, &splits.collect::<Vec<_>>(), base, |row, done, total| {
        bar.set_message(row.to_owned());
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        write_suite(&report, folder)?;
    }
    if args.json {
        return print_json(&report);
    }
    print!("{}", report.markdown());
    Ok(())
}

fn eval_maps(text: &str, side: u32) -> anyhow::Result<Vec<EvalMap>> {
    Ok(parse_maps(text, side)?.into_iter().map(EvalMap::from).collect())
}

/// Crowds, doors, lifts, platforms, floors that vanish, and players.
fn run_living(args: &Args, base: &EvalConfig) -> anyhow::Result<()> {
    let policy = load_policy(Some(&args.models.join("general-reactive")))?;
    let scenes = args.scene.clone();
    let scene_count = if scenes.is_empty() { living::SCENES.len() } else { scenes.len() };
    let bar = progress_bar(scene_count as u64, "evaluating");
    let (thread_count, settings) = (base.thread_count, args.graph.settings()?);
    let config = LivingConfig { scenes, runs: args.runs, thread_count, settings };
    let report = living::run(&policy, &config, |scene| {
        bar.set_message(scene.to_owned());
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        write_into(folder, "results.json", &serde_json::to_string_pretty(&report)?)?;
        write_into(folder, "table.md", &report.markdown())?;
    }
    if args.json {
        return print_json(&report);
    }
    print!("{}", report.markdown());
    Ok(())
}

/// What each of our choices adds.
fn run_ablation(args: &Args, base: &EvalConfig) -> anyhow::Result<()> {
    let load = |name: &str| load_policy(Some(&args.models.join(name)));
    let policies = Policies { recurrent: load("general-lstm")?, reactive: load("general-reactive")? };
    let bar = progress_bar(1, "evaluating");
    let report = ablation::run(&policies, base, args.graph.settings()?, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        write_into(folder, "results.json", &serde_json::to_string_pretty(&report)?)?;
        write_into(folder, "table.md", &report.markdown())?;
    }
    if args.json {
        return print_json(&report);
    }
    print!("{}", report.markdown());
    Ok(())
}

/// Success and run time over numbers of vertices and neighbours.
fn run_sweep(args: &Args, base: &EvalConfig) -> anyhow::Result<()> {
    let base = EvalConfig { maps: eval_maps("validation", args.generated.size)?, ..base.clone() };
    let policy = load_policy(Some(&args.models.join("general-reactive")))?;
    let outcomes = run_variants(args, &base, &variants::sweep(&policy), 25.0)?;
    if let Some(folder) = &args.out {
        let sizes = size_outcomes(&outcomes);
        plots::sweep(&sizes, &folder.join("success.svg"))?;
        plots::run_time(&sizes, &folder.join("run-time.svg"))?;
    }
    Ok(())
}

/// Seed and side in metres of the large map; the paper's has 1 km.
const BIG_MAP: (u64, u32) = (3000, 1000);
/// Numbers of vertices of the large map's graphs, as in the paper.
const BIG_VERTICES: [usize; 4] = [200, 400, 800, 1600];
/// Nearest neighbours that each vertex forms candidate edges with.
const BIG_NEIGHBOURS: usize = 20;

/// The 1 km map: the policy trained on it without a graph and with graphs of growing size, then the general policy.
fn run_big_map(args: &Args, base: &EvalConfig) -> anyhow::Result<()> {
    let (seed, side) = BIG_MAP;
    let base = EvalConfig { maps: eval_maps(&seed.to_string(), side)?, ..base.clone() };
    let specific = load_policy(Some(&args.models.join(format!("lstm-map-{seed}"))))?;
    let general = load_policy(Some(&args.models.join("general-reactive")))?;
    let graph = |vertices| -> anyhow::Result<Method> {
        let settings = args.graph.settings()?.with(|it| {
            it.vertices = vertices;
            it.neighbours = BIG_NEIGHBOURS;
        });
        Ok(Method::Graph(settings?))
    };
    let mut entries = vec![Variant { name: "no graph".to_owned(), policy: specific.clone(), method: Method::Policy }];
    for vertices in BIG_VERTICES {
        let name = format!("{vertices} vertices");
        entries.push(Variant { name, policy: specific.clone(), method: graph(vertices)? });
    }
    let most = BIG_VERTICES[BIG_VERTICES.len() - 1];
    let name = format!("{most} vertices, general weights");
    entries.push(Variant { name, policy: general, method: graph(most)? });
    let outcomes = run_variants(args, &base, &entries, 100.0)?;
    if let Some(folder) = &args.out {
        let lines = outcomes.iter().map(|outcome| (outcome.name.as_str(), bins(&outcome.by_distance)));
        plots::success_by_distance(&lines.collect::<Vec<_>>(), 50.0, &folder.join("success-by-distance.svg"))?;
    }
    Ok(())
}

fn run_variants(
    args: &Args,
    base: &EvalConfig,
    entries: &[Variant],
    bin_m: f32,
) -> anyhow::Result<Vec<variants::Outcome>> {
    let bar = progress_bar(1, "evaluating");
    let outcomes = variants::run(entries, base, bin_m, |name, done, total| {
        bar.set_message(name.to_owned());
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let table = variants::markdown(&outcomes);
    if let Some(folder) = &args.out {
        write_into(folder, "results.json", &serde_json::to_string_pretty(&outcomes)?)?;
        write_into(folder, "table.md", &table)?;
    }
    if args.json {
        print_json(&outcomes)?;
    } else {
        print!("{table}");
    }
    Ok(outcomes)
}

fn write_into(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let path = folder.join(name);
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}

fn write_suite(report: &suite::SuiteReport, folder: &Path) -> anyhow::Result<()> {
    write_into(folder, "results.json", &serde_json::to_string_pretty(report)?)?;
    write_into(folder, "table.md", &report.markdown())?;
    let lines = report.rows.iter().map(|row| (row.name.as_str(), bins(&row.by_distance)));
    plots::success_by_distance(&lines.collect::<Vec<_>>(), 12.5, &folder.join("success-by-distance.svg"))?;
    let groups = report.generalisation.iter().map(|group| plots::BarGroup {
        name: &group.name,
        bars: group.splits.iter().map(|(split, rate)| (split.as_str(), rate.rate)).collect(),
        paper: suite::PAPER.iter().find(|paper| paper.name == group.name).map(|paper| paper.all),
    });
    Ok(plots::generalisation(&groups.collect::<Vec<_>>(), &folder.join("generalisation.svg"))?)
}

fn bins(by_distance: &[(f32, Rate)]) -> Vec<plots::DistanceBin> {
    let bin = |&(far_m, rate): &(f32, Rate)| plots::DistanceBin { far_m, rate: rate.rate, count: rate.n };
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

fn parse_distance(text: &str) -> anyhow::Result<Range<f32>> {
    let wrong = || format!("--distance is `{text}`, expected MIN..MAX in metres such as 2..25");
    let (low, high) = text.split_once("..").with_context(wrong)?;
    let (low, high): (f32, f32) = (low.parse().with_context(wrong)?, high.parse().with_context(wrong)?);
    if !(low >= 0.0 && low < high) {
        bail!(wrong());
    }
    Ok(low..high)
}

fn print_table(report: &Report) -> anyhow::Result<()> {
    println!(
        "method {}  model {}  maps {}  {} goals per map, seeds {:?}",
        report.method,
        report.model,
        report.maps.iter().map(MapName::to_string).collect::<Vec<_>>().join(", "),
        report.goals,
        report.seeds
    );
    println!("{:<8}{:>9}{:>19}{:>8}", "goals", "success", "95 % interval", "n");
    let rows = [
        ("all", report.success.all),
        ("easy", report.success.easy),
        ("medium", report.success.medium),
        ("hard", report.success.hard),
    ];
    for (name, Rate { rate, low, high, n }) in rows {
        println!("{name:<8}{:>8.1}%{:>10.1} - {:>5.1}%{n:>8}", 100.0 * rate, 100.0 * low, 100.0 * high);
    }
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    for map in &report.per_map {
        print!(
            "map {}: {} of the goals can be reached; of these {} were, {} died",
            map.map,
            percent(map.reachable),
            percent(map.success_reachable),
            percent(map.died)
        );
        match map.told.zip(map.died_unreachable) {
            Some((told, died)) => println!("; of the others {} were told, {} died", percent(told), percent(died)),
            None => println!(),
        }
        let calibrations = [
            ("promised -> arrived", &map.calibration),
            ("promised -> arrived as planned", &map.calibration_as_planned),
        ];
        for (what, calibration) in calibrations {
            let Some(calibration) = calibration else { continue };
            let bin = |it: &CalibrationBin| format!("{} -> {} ({})", percent(it.promised), percent(it.arrived), it.n);
            let bins: Vec<String> = calibration.bins.iter().map(bin).collect();
            println!("    {what}: {}; Brier score {:.3}", bins.join(", "), calibration.brier);
        }
    }
    if let Some(by_map) = report.by_map {
        println!(
            "over {} maps: {} % with its 95 % interval; standard deviation between maps {:.1} points",
            by_map.maps,
            by_map.percent(),
            100.0 * by_map.between_maps
        );
    }
    if let Some(spread) = report.spread {
        println!("spread between seeds {:.2} points", 100.0 * spread);
    }
    let ends: Vec<String> = report.ends.iter().map(|(end, count)| format!("{end} {count}")).collect();
    println!("ends: {}", ends.join(", "));
    if !report.faults.is_empty() {
        let faults: Vec<String> = report.faults.iter().map(|(fault, count)| format!("{fault} {count}")).collect();
        println!("failures by plan: {}", faults.join(", "));
    }
    println!(
        "mean time to goal {:.1} s, straight-line distance over distance covered {:.2}, re-plans per attempt {:.2}",
        report.seconds_to_goal, report.directness, report.replans
    );
    let motion = &report.motion;
    println!(
        "motion: {:.2} reversals/s, facing off by {:.0} degrees (median) and {:.0} (p90), {:.2} jumps per 100 m, {:.2} on legs that can be walked ({:.0} % of the way), in the air {} and {} of the time, jerk {:.0} m/s3",
        motion.reversals_per_s,
        motion.facing_p50_deg,
        motion.facing_p90_deg,
        motion.jumps_per_100m,
        motion.walk_jumps_per_100m,
        100.0 * motion.walk_share,
        percent(motion.air_share),
        percent(motion.walk_air_share),
        motion.jerk,
    );
    if let Some(graph) = &report.graph {
        println!(
            "graph: {:.0} vertices, {:.0} edges, {:.1} islands, {:.1} % of vertex pairs connected, {:.0} probes of {:.0} candidates in {:.1} s, search {:.1} us (median), attempts {:.0} s",
            graph.vertices,
            graph.edges,
            graph.islands,
            100.0 * graph.connected,
            graph.probes,
            graph.candidates,
            graph.build_s,
            graph.search_us_median,
            graph.eval_s,
        );
    }
    Ok(())
}
