//! `surefoot map`.

mod import;
mod levels;
mod list;
mod show;
mod source;

pub use levels::LevelArgs;
pub use list::{
    SPLITS, SeedOrFile, file_name, files_only, name_among, parse_maps, parse_maps_or_splits, parse_seeds, parse_specs,
    seeds_only, spec,
};
pub use show::check_scale;
pub use source::{BodyArg, Generated, Source, load_body};

use crate::commands::fleet::{BlobsArg, NatsArg};
use crate::terminal::{progress_bar, with_spinner};
use anyhow::{Context, bail};
use levels::{read, written};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use surefoot_policy::Policy;
use surefoot_world::replay::Recording;
use surefoot_world::{MapSpec, TICKS_PER_DECISION};

/// Generate, show, import, export and replay maps.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Generate a map and save it
    Generate(GenerateArgs),
    /// Describe a map, measure how it is connected, or draw it
    Show(show::Args),
    /// Import a level (.glb, .gltf or .obj) as a map
    Import(import::Args),
    /// Write a map as .glb for Blender, Godot and other programs
    Export(ExportArgs),
    /// Run NPCs on a map and record their inputs
    Record(RecordArgs),
    /// Replay a recording and compare states
    Replay(ReplayArgs),
}

/// Generate a map and save it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot map generate 7 --features all --out seven.sfmap\n  \
        surefoot map generate 0..64 --features all --out maps\n  \
        surefoot map generate 0..64 --nats nats://127.0.0.1:4222 --blobs file:///srv/blobs --out maps")]
pub struct GenerateArgs {
    /// Seed of the map, or several seeds, such as 0..8 or 3,5
    #[arg(value_name = "SEEDS")]
    seeds: String,
    #[command(flatten)]
    generated: Generated,
    /// File to write the map to; of several seeds: the folder, in which files are named after seeds
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    nats: NatsArg,
    #[command(flatten)]
    blobs: BlobsArg,
}

/// Write a map as .glb.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot map export 7 --features all --out seven.glb")]
pub struct ExportArgs {
    #[command(flatten)]
    source: Source,
    /// File to write the level to
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Run NPCs on a map and record their inputs.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot map record 7 --npcs 32 --ticks 3600 --out run.sfreplay")]
pub struct RecordArgs {
    #[command(flatten)]
    source: Source,
    /// Number of NPCs, each with its own goals
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=4096))]
    npcs: u32,
    /// Number of ticks, 60 per second, rounded down to whole decisions of 10
    #[arg(long, default_value_t = 3600, value_parser = clap::value_parser!(u64).range(10..=1_000_000))]
    ticks: u64,
    /// File to write the recording to
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Replay a recording; without --check, only describe it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot map replay run.sfreplay --check")]
pub struct ReplayArgs {
    /// The recording
    file: PathBuf,
    /// Run the recording and compare its state with the recorded state every 600 ticks and at the end
    #[arg(long)]
    check: bool,
    /// The saved map; needed for recordings on imported maps
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
}

/// Runs a command.
pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Generate(args) => generate(args),
        Command::Show(args) => show::run(args),
        Command::Import(args) => import::run(args),
        Command::Export(args) => write(&args.out, &surefoot_levels::export_glb(&args.source.load()?)),
        Command::Record(args) => record(args),
        Command::Replay(args) => replay(args),
    }
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    println!("{}", written(path, bytes)?);
    Ok(())
}

fn generate(args: &GenerateArgs) -> anyhow::Result<()> {
    args.nats.check()?;
    let seeds = parse_seeds(&args.seeds)?;
    if let (&[seed], false) = (seeds.as_slice(), args.seeds.contains("..")) {
        let map = args.generated.generate(seed)?;
        println!("hash {}", map.hash());
        return write(&args.out, &surefoot_levels::encode(&map));
    }
    generate_all(args, &seeds)
}

/// Maps that are generated together; their bytes are in memory at the same time.
const MAPS_AT_A_TIME: usize = 32;

/// Generates the maps of several seeds into a folder.
fn generate_all(args: &GenerateArgs, seeds: &[u64]) -> anyhow::Result<()> {
    let specs: anyhow::Result<Vec<MapSpec>> =
        seeds.iter().map(|&seed| args.generated.apply(&MapSpec::new(seed))).collect();
    let specs = specs?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    let bar = progress_bar(specs.len() as u64, "maps");
    let path = |spec: &MapSpec| args.out.join(format!("{}.sfmap", spec.seed));
    for specs in specs.chunks(MAPS_AT_A_TIME) {
        match share(args, specs, &|_| bar.inc(1))? {
            Some(maps) => specs.iter().zip(maps).try_for_each(|(spec, bytes)| write(&path(spec), &bytes))?,
            None => {
                for spec in specs {
                    write(&path(spec), &surefoot_levels::encode(&surefoot_generate::generate(spec)))?;
                    bar.inc(1);
                }
            }
        }
    }
    bar.finish_and_clear();
    println!("{} maps in {}", specs.len(), args.out.display());
    Ok(())
}

/// Lets provers generate maps if `--nats` is given, and returns the saved maps.
#[cfg(feature = "fleet")]
fn share(
    args: &GenerateArgs,
    specs: &[MapSpec],
    is_made: &(dyn Fn(usize) + Sync),
) -> anyhow::Result<Option<Vec<Vec<u8>>>> {
    use super::fleet::Shared;
    use surefoot_fleet::work::{dispatch::Threads, maps};

    let Some(nats) = &args.nats.nats else { return Ok(None) };
    // Maps need no policy, so any lane works. Provers with the shipped model are the most likely to run.
    let policy = super::load_policy(None)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let shared = runtime.block_on(Shared::open(nats, args.blobs.blobs.as_deref(), &policy))?;
    let grounds = runtime.block_on(async { shared.maps() });
    let threads = Threads { beside_provers: 1, alone: crate::commands::core_count() };
    Ok(Some(maps::generate_all(&shared.dispatcher(), &grounds, specs, threads, is_made)?))
}

/// This build has no queue.
#[cfg(not(feature = "fleet"))]
fn share(args: &GenerateArgs, _: &[MapSpec], _: &(dyn Fn(usize) + Sync)) -> anyhow::Result<Option<Vec<Vec<u8>>>> {
    let _ = &args.blobs.blobs;
    Ok(None)
}

fn record(args: &RecordArgs) -> anyhow::Result<()> {
    let map = Arc::new(args.source.load()?);
    let policy = Policy::shipped().context("cannot use the shipped model")?;
    let decision_count = args.ticks / u64::from(TICKS_PER_DECISION);
    let recording = with_spinner("recording", || {
        surefoot_rollout::crowd::record(map, &policy, args.npcs as usize, decision_count)
    })?;
    println!("{} ticks, {} inputs", recording.tick_count(), recording.input_count());
    write(&args.out, &recording.encode())
}

fn replay(args: &ReplayArgs) -> anyhow::Result<()> {
    let recording =
        Recording::decode(&read(&args.file)?).with_context(|| format!("cannot use {}", args.file.display()))?;
    println!("{} ticks, {} inputs, map {}", recording.tick_count(), recording.input_count(), recording.map);
    if !args.check {
        return Ok(());
    }
    let map = match (&args.map, recording.spec) {
        (Some(path), _) => {
            surefoot_levels::decode(&read(path)?).with_context(|| format!("cannot use {}", path.display()))?
        }
        (None, Some(spec)) => surefoot_generate::generate(&spec),
        (None, None) => bail!("the recording was made on an imported map: give its file with --map"),
    };
    let started = Instant::now();
    with_spinner("replaying", || recording.replay(Arc::new(map), None))?;
    println!("the replay reached the same state in {:.2} s", started.elapsed().as_secs_f64());
    Ok(())
}
