//! `surefoot challenge`.

mod motion;

use crate::processes::{Services, Setup};
use crate::provenance::Start;
use anyhow::{Context, bail};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::Serialize;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use surefoot_cli::commands::endpoint::CredentialArgs;
use surefoot_cli::commands::map::{BodyArg, LevelArgs, file_name, files_only, parse_maps};
use surefoot_cli::commands::services::GraphArgs;
use surefoot_cli::commands::{core_count, load_policy};
use surefoot_cli::terminal::{print_json, progress_bar};
use surefoot_eval::challenge::host::{Hosting, Stats, host};
use surefoot_eval::challenge::record::{Entry, record};
use surefoot_eval::challenge::{GoalSet, Run, SETS, Score, score, score_hosted};
use surefoot_eval::{EvalMap, GoalArea};

/// File of a set in its folder.
const SET_FILE: &str = "set.json";
/// Most bytes of a run, unpacked.
const MAX_RUN_BYTES: u64 = 1 << 30;

/// Compare agents and planners of any origin on the same goals: docs/guides/challenge.md is the protocol.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Write a set: its goals, and its maps as .glb and .sfmap
    Set(SetArgs),
    /// Attempt the goals of a set with our own NPCs, and write a run
    Record(RecordArgs),
    /// Score a run: drive its paths or repeat its actions, and measure where the body gets
    Score(ScoreArgs),
    /// Compare how the bodies of several runs move, at the goals that all of them reach
    Motion(motion::Args),
    /// Send NPCs of a world server to the goals of a set, and score the outcomes that the server reports
    Host(HostArgs),
}

/// Write a set: its goals, and its maps as .glb and .sfmap.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot challenge set paper-like --out sets/paper-like\n  \
        surefoot challenge set custom --maps level.glb,other.obj --goals 100 --body unity --out sets/mine")]
pub struct SetArgs {
    /// Name of the set: paper-like, kinds or benchmark; or custom for one of your own
    name: String,
    /// Folder to write to
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Levels of a custom set (.sfmap, .glb, .gltf, .obj), or patterns such as 'levels/*.glb'; may be repeated
    #[arg(long, value_name = "FILE,...")]
    maps: Vec<String>,
    #[command(flatten)]
    levels: LevelArgs,
    /// Goals on each map of a custom set
    #[arg(long, default_value_t = 300, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    goals: u32,
    #[command(flatten)]
    body: BodyArg,
    /// Write only the goals, without maps
    #[arg(long)]
    no_maps: bool,
}

/// Attempt the goals of a set with our own NPCs, and write a run.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot challenge record paper-like --out surefoot.json.gz\n  \
        surefoot challenge record sets/mine --straight --model general-lstm --out straight.json.gz")]
pub struct RecordArgs {
    /// Name of a set, or its folder
    #[arg(value_name = "SET|FOLDER")]
    set: String,
    /// File to write; compressed if its name ends in .gz
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Head straight for goals instead of following plans
    #[arg(long)]
    straight: bool,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Name of the entrant; default: the method and the model
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    #[command(flatten)]
    graph: GraphArgs,
    /// Number of threads; default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Score a run: drive its paths or repeat its actions, and measure where the body gets.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot challenge score run.json\n  \
        surefoot challenge score run.json.gz --set sets/mine --json")]
pub struct ScoreArgs {
    /// Runs (.json, or compressed .json.gz), for one table
    #[arg(value_name = "FILE", required = true)]
    runs: Vec<PathBuf>,
    /// Folder of the set; default: the set of the challenge that is named in the run
    #[arg(long, value_name = "FOLDER")]
    set: Option<PathBuf>,
    /// Number of threads; default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Write the scores and their provenance into this folder
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON document: a score, or a list of them with several runs
    #[arg(long)]
    json: bool,
}

/// Send NPCs of a world server to the goals of a set, and score the outcomes that the server reports. The server's
/// workers decide.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot challenge host benchmark:8x128                 # our own server, planner and worker, at 60 Hz\n  \
        surefoot challenge host benchmark:8x128 --lockstep\n  \
        surefoot challenge host kinds --server http://127.0.0.1:7600 --name \"my workers\"")]
pub struct HostArgs {
    /// Name of a set, or a part of it such as benchmark:8x128
    set: String,
    /// World server; default: start a server, a planner and workers, each in its own process
    #[arg(long, value_name = "URI")]
    server: Option<String>,
    /// Let worlds wait for the workers' decisions, instead of running at 60 Hz
    #[arg(long)]
    lockstep: bool,
    /// Most attempts that run at the same time
    #[arg(long, default_value_t = 1024, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    at_once: u32,
    /// Goals of each map that are attempted first, unscored, so that the workers have the graph
    #[arg(long, default_value_t = 16, value_name = "N")]
    warm_up: usize,
    /// Time limit for the attempts that run together
    #[arg(
        long,
        default_value_t = 600,
        value_name = "SECONDS",
        value_parser = clap::value_parser!(u64).range(1..=86_400)
    )]
    limit: u64,
    /// Name of the entrant
    #[arg(long, default_value = "Surefoot over gRPC", value_name = "NAME")]
    name: String,
    /// Number of workers to start
    #[arg(
        long,
        default_value_t = 1,
        value_name = "N",
        conflicts_with = "server",
        value_parser = clap::value_parser!(u16).range(1..=64)
    )]
    workers: u16,
    #[command(flatten)]
    credentials: CredentialArgs,
    /// Write the score and its provenance into this folder
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Set(args) => write_set(args),
        Command::Record(args) => write_record(args),
        Command::Score(args) => print_scores(args),
        Command::Motion(args) => motion::run(args),
        Command::Host(args) => host_set(args),
    }
}

fn write_set(args: &SetArgs) -> anyhow::Result<()> {
    let maps = parse_maps(&args.maps).context("--maps")?;
    args.levels.check(&maps)?;
    let set = match (args.name.as_str(), files_only(maps).context("--maps")?) {
        ("custom", files) if files.is_empty() => bail!("a custom set needs --maps"),
        ("custom", files) => custom(args, &files)?,
        (name, files) if files.is_empty() => GoalSet::named(name)?,
        _ => bail!("--maps is only for the set custom: the maps of the other sets are fixed"),
    };
    create(&args.out)?;
    if !args.no_maps {
        let bar = progress_bar(set.maps.len() as u64, "writing maps");
        for map in &set.maps {
            let made = map.load(&args.out)?;
            write(&args.out.join(format!("{}.glb", map.name)), &surefoot_levels::export_glb(&made))?;
            write(&args.out.join(format!("{}.sfmap", map.name)), &surefoot_levels::encode(&made))?;
            bar.inc(1);
        }
        bar.finish_and_clear();
    }
    write(&args.out.join(SET_FILE), &serde_json::to_vec(&set)?)?;
    let goals: usize = set.maps.iter().map(|map| map.goals.len()).sum();
    println!("{}: {} maps, {goals} goals, hash {}", set.set, set.maps.len(), set.hash());
    Ok(())
}

/// A set of the user's levels, which are saved in its folder.
fn custom(args: &SetArgs, files: &[PathBuf]) -> anyhow::Result<GoalSet> {
    create(&args.out)?;
    let mut levels = Vec::with_capacity(files.len());
    for file in files {
        let map = Arc::new(args.levels.load(file)?);
        let name = Path::new(&file_name(file)).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let saved = PathBuf::from(format!("{name}.sfmap"));
        write(&args.out.join(&saved), &surefoot_levels::encode(&map))?;
        levels.push((EvalMap::Level { name, map, goals: GoalArea::Anywhere }, Some(saved)));
    }
    Ok(GoalSet::draw(&args.name, levels, args.body.profile()?, args.goals as usize, 0)?)
}

/// The set with a name, or in a folder, and the folder of its files.
fn load_set(name: &str) -> anyhow::Result<(GoalSet, PathBuf)> {
    let whole = name.split_once(':').map_or(name, |(whole, _)| whole);
    if SETS.contains(&whole) && !Path::new(name).exists() {
        return Ok((GoalSet::named(name)?, PathBuf::new()));
    }
    let folder = PathBuf::from(name);
    let path = folder.join(SET_FILE);
    let text = std::fs::read(&path).with_context(|| {
        format!("cannot read {}; the sets of the challenge are {}", path.display(), SETS.join(", "))
    })?;
    let set: GoalSet = serde_json::from_slice(&text).with_context(|| format!("{} is not a set", path.display()))?;
    set.check()?;
    Ok((set, folder))
}

fn write_record(args: &RecordArgs) -> anyhow::Result<()> {
    let (set, folder) = load_set(&args.set)?;
    let policy = load_policy(args.model.as_deref())?;
    let means = if args.straight { "straight" } else { "by plan" };
    let name = args.name.clone().unwrap_or_else(|| format!("Surefoot {means}, {}", policy.manifest().name));
    let graph = if args.straight { None } else { Some(args.graph.settings()?) };
    let entry = Entry { name, policy, graph, thread_count: args.threads.unwrap_or_else(core_count) };
    let bar = progress_bar(set.maps.len() as u64, "recording");
    let run = record(&entry, &set, &folder, |map| {
        bar.set_message(map.to_owned());
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    write_run(&args.out, &run)
}

fn write_run(path: &Path, run: &Run) -> anyhow::Result<()> {
    let failed = || format!("cannot write {}", path.display());
    let mut file = BufWriter::new(File::create(path).with_context(failed)?);
    if is_packed(path) {
        let mut packed = GzEncoder::new(file, Compression::default());
        serde_json::to_writer(&mut packed, run).with_context(failed)?;
        return packed.finish().and_then(|mut file| file.flush()).with_context(failed);
    }
    serde_json::to_writer(&mut file, run).with_context(failed)?;
    file.flush().with_context(failed)
}

fn read_run(path: &Path) -> anyhow::Result<Run> {
    let file = BufReader::new(File::open(path).with_context(|| format!("cannot read {}", path.display()))?);
    let text: Box<dyn Read> = if is_packed(path) { Box::new(GzDecoder::new(file)) } else { Box::new(file) };
    let text = BufReader::new(text.take(MAX_RUN_BYTES));
    serde_json::from_reader(text).with_context(|| format!("{} is not a run (docs/guides/challenge.md)", path.display()))
}

fn is_packed(path: &Path) -> bool {
    path.extension().is_some_and(|it| it == "gz")
}

fn print_scores(args: &ScoreArgs) -> anyhow::Result<()> {
    let start = Start::now();
    let thread_count = args.threads.unwrap_or_else(core_count);
    let mut loaded: Option<(GoalSet, PathBuf)> = None;
    let mut scores = Vec::with_capacity(args.runs.len());
    for path in &args.runs {
        let run = read_run(path)?;
        let (set, folder) = match loaded.take() {
            Some(set) if set.0.set == run.set => set,
            _ => match &args.set {
                Some(folder) => load_set(&folder.to_string_lossy())?,
                None => load_set(&run.set)?,
            },
        };
        let bar = progress_bar(set.maps.len() as u64, "scoring");
        let scored = score(&set, &folder, &run, thread_count, |map| {
            bar.set_message(map.to_owned());
            bar.inc(1);
        });
        bar.finish_and_clear();
        scores.push(scored.with_context(|| format!("cannot score {}", path.display()))?);
        loaded = Some((set, folder));
    }
    if let Some(folder) = &args.out {
        start.write(folder, "challenge", &scores, (Vec::new(), None))?;
    }
    match (args.json, scores.as_slice()) {
        (true, [score]) => print_json(score),
        (true, scores) => print_json(&scores),
        (false, scores) => {
            print_table(scores);
            Ok(())
        }
    }
}

/// A score of hosted attempts, with the timing of their worlds.
#[derive(Serialize)]
struct HostedScore {
    #[serde(flatten)]
    score: Score,
    mode: &'static str,
    at_once: u32,
    /// Share of ticks that were late or dropped.
    ticks_late_share: f64,
    /// Share of decisions that were answered in time.
    decisions_on_time_share: f64,
}

fn host_set(args: &HostArgs) -> anyhow::Result<()> {
    let start = Start::now();
    let (set, folder) = load_set(&args.set)?;
    let hosting = Hosting {
        lockstep: args.lockstep,
        at_once: args.at_once as usize,
        warm_up: args.warm_up,
        limit: Duration::from_secs(args.limit),
    };
    let credentials = args.credentials.credentials()?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let (cache, npcs) = (tempfile::tempdir()?, 2 * args.at_once as usize);
    let setup = Setup { workers: args.workers.into(), ..Setup::new(npcs, cache.path()) };
    let own = if args.server.is_none() { Some(runtime.block_on(Services::start(setup))?) } else { None };
    let uri = args.server.as_ref().or_else(|| own.as_ref().map(|own| &own.server_uri)).expect("one of them");
    let bar = progress_bar(set.maps.len() as u64, "hosting");
    let hosted = runtime.block_on(async {
        let link = credentials.dial(uri)?.connect_lazy();
        let hosted = host(link, &set, hosting, |map| {
            bar.set_message(map.to_owned());
            bar.inc(1);
        });
        anyhow::Ok(hosted.await?)
    })?;
    bar.finish_and_clear();
    drop(own);
    let about = format!("Surefoot {}", env!("CARGO_PKG_VERSION"));
    let score = score_hosted(&set, &folder, (&args.name, &about), &hosted, core_count())?;
    let sum = |of: fn(&Stats) -> u64| hosted.iter().map(|it| of(&it.stats)).sum::<u64>() as f64;
    let (late, ticks) = (sum(|it| it.ticks_late), sum(|it| it.ticks));
    let (answered, missed) = (sum(|it| it.answered), sum(|it| it.missed));
    let hosted = HostedScore {
        score,
        mode: if args.lockstep { "lockstep" } else { "realtime" },
        at_once: args.at_once,
        ticks_late_share: late / ticks.max(1.0),
        decisions_on_time_share: answered / (answered + missed).max(1.0),
    };
    if let Some(folder) = &args.out {
        start.write(folder, "challenge", &hosted, (Vec::new(), None))?;
    }
    if args.json {
        return print_json(&hosted);
    }
    print_table(std::slice::from_ref(&hosted.score));
    println!(
        "\n{}, at most {} NPCs at once: {:.3} % of ticks late, {:.3} % of decisions on time; ends: {}",
        hosted.mode,
        hosted.at_once,
        100.0 * hosted.ticks_late_share,
        100.0 * hosted.decisions_on_time_share,
        hosted.score.ends.iter().map(|(end, count)| format!("{end} {count}")).collect::<Vec<_>>().join(", "),
    );
    Ok(())
}

/// Scores as a Markdown table.
fn print_table(scores: &[Score]) {
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    let or_none = |share: Option<f64>| share.map_or("-".to_owned(), percent);
    println!("Success in %, with 95 % intervals over maps where there are several.\n");
    println!(
        "| entrant | set | all | interval | hard | on foot | not on foot | died | reported | time to goal | path | \
         build | size |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for it in scores {
        println!(
            "| {} | {} ({}) | **{}** | {} | {} | {} of {} | {} of {} | {} | {} | {:.1} s | {} | {:.1} s | {:.2} MB |",
            it.entrant,
            it.set,
            &it.set_hash[..8],
            percent(it.success.all.rate),
            it.by_map.map_or("-".to_owned(), |it| format!("{} to {}", percent(it.low), percent(it.high))),
            percent(it.success.hard.rate),
            percent(it.on_foot.rate),
            it.on_foot.n,
            percent(it.not_on_foot.rate),
            it.not_on_foot.n,
            percent(it.died),
            or_none(it.told),
            it.seconds_to_goal,
            it.metres_to_goal.map_or("-".to_owned(), |it| format!("{it:.0} m")),
            it.build_s,
            it.bytes / 1.0e6,
        );
    }
}

fn create(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}
