//! `surefoot map`.

use super::fleet::{BlobsArg, NatsArg};
use super::{core_count, parse_seeds};
use crate::terminal::{print_json, progress_bar};
use anyhow::{Context, bail};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use surefoot_generate::Stage;
use surefoot_levels::{ImportOptions, Imported, UpAxis};
use surefoot_policy::Policy;
use surefoot_report::render::{self, Picture, View};
use surefoot_world::character::bodies::{BODIES, NamedBody};
use surefoot_world::map::{Features, MapKind, MapSize, MoverDensities};
use surefoot_world::reach::{Means, Reach};
use surefoot_world::replay::Recording;
use surefoot_world::{CharacterProfile, Map, MapSpec, TICKS_PER_DECISION, Vec3};

/// Generate, show, exchange and replay maps.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Generate a map and save it
    Generate(GenerateArgs),
    /// Describe a map, measure how it is connected, or draw it
    Show(ShowArgs),
    /// Import a level (.glb, .gltf or .obj) as a map
    Import(ImportArgs),
    /// Write a map as .glb for Blender, Godot and other programs
    Export(ExportArgs),
    /// Run NPCs on a map and record their inputs
    Record(RecordArgs),
    /// Replay a recording and compare states
    Replay(ReplayArgs),
}

/// Selects a map.
#[derive(clap::Args, Clone)]
pub struct Source {
    /// Seed of a generated map, or a file: a saved map or a level (.glb, .gltf, .obj)
    #[arg(value_name = "SEED|FILE")]
    pub map: String,
    /// Settings of a generated map.
    #[command(flatten)]
    pub generated: Generated,
}

/// The body of the characters.
#[derive(clap::Args, Clone)]
pub struct BodyArg {
    /// Body of the characters: surefoot, unreal, godot, unity, heavy, small or climber, or a .toml file with the fields
    /// of a profile
    #[arg(long, default_value = "surefoot", value_name = "NAME|FILE")]
    body: String,
}

impl BodyArg {
    /// The profile of that body.
    pub fn profile(&self) -> anyhow::Result<CharacterProfile> {
        load_body(&self.body)
    }
}

/// The body with a name, or the body in a file.
pub fn load_body(name: &str) -> anyhow::Result<CharacterProfile> {
    if let Some(body) = NamedBody::find(name) {
        return Ok(body.profile());
    }
    let path = Path::new(name);
    if path.extension().is_none_or(|it| it != "toml") {
        let names = BODIES.map(|body| body.name).join(", ");
        bail!("there is no body `{name}`: there are {names}, or a .toml file with the fields of a profile");
    }
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    toml::from_str(&text).with_context(|| format!("{} is not a body", path.display()))
}

/// Settings of generated maps, besides their seeds.
#[derive(clap::Args, Clone)]
pub struct Generated {
    /// Side in metres of a generated map, 50 to 1000
    #[arg(long, default_value_t = 250, value_name = "METRES")]
    pub size: u32,
    /// Height in metres of a generated map, 40 to 200
    #[arg(long, default_value_t = 80, value_name = "METRES")]
    pub height: u32,
    /// Features of a generated map: paper, all or none, followed by changes, such as all,lava=0,zip_lines=2
    #[arg(long, default_value = "paper", value_name = "LIST", value_parser = parse_features)]
    pub features: Features,
    /// Kind of a generated map: terrain (the paper's), islands, interior, arena, tower or open
    #[arg(long, default_value = "terrain", value_name = "KIND", value_parser = parse_kind)]
    pub kind: MapKind,
    /// Movers of a generated map: none or all, followed by changes, such as all,doors=0 or lifts,crates=2
    #[arg(long, default_value = "none", value_name = "LIST", value_parser = parse_movers)]
    pub movers: MoverDensities,
    /// Do not add pads and zip lines to unreachable ground of a generated map
    #[arg(long)]
    pub no_repair: bool,
}

/// Parses densities of movers.
pub fn parse_movers(text: &str) -> Result<MoverDensities, String> {
    text.parse()
}

/// Parses a kind of map.
pub fn parse_kind(text: &str) -> Result<MapKind, String> {
    text.parse()
}

/// Parses features.
pub fn parse_features(text: &str) -> Result<Features, String> {
    text.parse()
}

impl Generated {
    /// Gives a spec this size, kind and features.
    pub fn apply(&self, spec: &MapSpec) -> anyhow::Result<MapSpec> {
        let size = MapSize { width: self.size, height: self.height, depth: self.size };
        let changed = spec.with(|it| {
            (it.size, it.features, it.kind) = (size, self.features, self.kind);
            (it.movers, it.repair) = (self.movers, !self.no_repair);
        });
        Ok(changed?)
    }
}

/// The files of a list of maps, if it names files and not seeds.
pub fn level_files(maps: &str) -> Option<Vec<&Path>> {
    let is_file = |word: &str| Path::new(word).extension().is_some_and(|it| !it.is_empty()) && !word.contains("..");
    maps.split(',').any(is_file).then(|| maps.split(',').map(Path::new).collect())
}

/// Name of a level's file, without folders.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Loads a saved map, or imports a level without scaling it.
pub fn load_level(path: &Path) -> anyhow::Result<Map> {
    Ok(load_with_origin(path)?.0)
}

/// Loads a saved map, or imports a level as it is, with the place where the level's own origin lies on the map, m.
/// Saved maps that were imported do not say it.
fn load_with_origin(path: &Path) -> anyhow::Result<(Map, Option<Vec3>)> {
    let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    if matches!(extension.as_deref(), Some("glb" | "gltf" | "obj")) {
        let options = ImportOptions { scale: 1.0, up: UpAxis::Y, keep_sides: false };
        let imported = import_level(path, None, &options)?;
        return Ok((imported.map, Some(imported.origin)));
    }
    let map = surefoot_levels::decode(&read(path)?).with_context(|| format!("cannot use {}", path.display()))?;
    let origin = map.spec().map(|_| Vec3::ZERO);
    Ok((map, origin))
}

/// Imports a level with a sidecar file, or the one beside it, and prints warnings.
fn import_level(level: &Path, sidecar: Option<&Path>, options: &ImportOptions) -> anyhow::Result<Imported> {
    let bytes = read(level)?;
    let beside = level.with_extension("surefoot.json");
    let sidecar = match sidecar {
        Some(path) => Some(path.to_owned()),
        None => beside.exists().then_some(beside),
    };
    let sidecar = sidecar
        .map(|path| std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display())))
        .transpose()?;
    let extension = level.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    let imported = match extension.as_deref() {
        Some("glb" | "gltf") => surefoot_levels::import_gltf(&bytes, sidecar.as_deref(), options),
        Some("obj") => surefoot_levels::import_obj(&bytes, sidecar.as_deref(), options),
        _ => bail!("{} is not a .glb, .gltf or .obj file", level.display()),
    }
    .with_context(|| format!("cannot import {}", level.display()))?;
    for warning in &imported.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(imported)
}

impl Source {
    /// Generates or loads the map.
    pub fn load(&self) -> anyhow::Result<Map> {
        Ok(self.load_with_origin()?.0)
    }

    /// Loads the map, with the place where the level's own origin lies on it, m, if that is known.
    pub fn load_with_origin(&self) -> anyhow::Result<(Map, Option<Vec3>)> {
        let Ok(seed) = self.map.parse::<u64>() else {
            return load_with_origin(Path::new(&self.map))
                .with_context(|| format!("`{}` is neither a seed nor a file that can be used", self.map));
        };
        let spec = self.generated.apply(&MapSpec::new(seed))?;
        let bar = progress_bar(Stage::ALL.len() as u64 - 1, "map");
        let map = surefoot_generate::generate_with(&spec, core_count(), |stage| {
            bar.set_position(Stage::ALL.iter().position(|&other| other == stage).unwrap_or(0) as u64);
            bar.set_message(stage.name());
        });
        bar.finish_and_clear();
        Ok((map, Some(Vec3::ZERO)))
    }
}

/// Generate a map and save it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot map generate 7 --features all --out seven.sfmap\n  \
        surefoot map generate 0..64 --features all --out maps\n  \
        surefoot map generate 0..64 --nats nats://127.0.0.1:4222 --blobs file:///srv/blobs --out maps")]
pub struct GenerateArgs {
    #[command(flatten)]
    source: Source,
    /// File to write the map to; of several seeds, such as 0..8 or 3,5: the folder, in which files are named after
    /// seeds
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    nats: NatsArg,
    #[command(flatten)]
    blobs: BlobsArg,
}

/// Describe a map, measure how it is connected, or draw it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot map show 2000\n  \
        surefoot map show 7 --features all --stats\n  \
        surefoot map show 7 --png map.png --iso\n  \
        surefoot map show 7 --png floor.png --section 31.5\n  \
        surefoot map show 3000 --size 1000 --height 200 --json")]
pub struct ShowArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    body: BodyArg,
    /// Measure the share of reachable goals among random ones, on foot and by every means
    #[arg(long)]
    stats: bool,
    /// Draw the map into this file
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// View from above (the default)
    #[arg(long, conflicts_with_all = ["iso", "section"])]
    top: bool,
    /// View from a corner
    #[arg(long, conflicts_with = "section")]
    iso: bool,
    /// View from above, cut off at this height in metres
    #[arg(long, value_name = "Y")]
    section: Option<f32>,
    /// Give all ground that is connected on foot one colour
    #[arg(long)]
    islands: bool,
    /// Pixels per metre in the picture; default: a picture 1,000 pixels wide, but at most 8
    #[arg(long)]
    scale: Option<f32>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Import a level as a map.
#[derive(clap::Args)]
#[command(
    after_help = "Nodes named lava*, water*, pad*, zip_line*:from, zip_line*:to, teleporter*:from, teleporter*:to and \
    jetpack* become\n\
        features; a sidecar file can list them instead.\n\n\
        Examples:\n  \
        surefoot map import level.glb --out level.sfmap\n  \
        surefoot map import level.obj --up z --scale 0.01 --out level.sfmap"
)]
pub struct ImportArgs {
    /// The level: .glb, .gltf or .obj
    level: PathBuf,
    /// File to write the map to
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Metres per unit of the level
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Axis that points up in the level
    #[arg(long, default_value = "y", value_parser = ["y", "z"])]
    up: String,
    /// Do not turn surfaces whose front seems to be on the wrong side
    #[arg(long)]
    keep_sides: bool,
    /// File with a list of features; default: LEVEL.surefoot.json beside the level, if it exists
    #[arg(long, value_name = "FILE")]
    sidecar: Option<PathBuf>,
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
        Command::Show(args) => show(args),
        Command::Import(args) => import(args),
        Command::Export(args) => write(&args.out, &surefoot_levels::export_glb(&args.source.load()?)),
        Command::Record(args) => record(args),
        Command::Replay(args) => replay(args),
    }
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    println!("wrote {} ({:.1} MB)", path.display(), bytes.len() as f64 / 1.0e6);
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

fn generate(args: &GenerateArgs) -> anyhow::Result<()> {
    args.nats.check()?;
    let is_range = args.source.map.contains("..") || args.source.map.contains(',');
    if let Some(seeds) = is_range.then(|| parse_seeds(&args.source.map).ok()).flatten() {
        return generate_all(args, &seeds);
    }
    let map = args.source.load()?;
    println!("hash {}", map.hash());
    write(&args.out, &surefoot_levels::encode(&map))
}

/// Maps that are generated together; their bytes are in memory at the same time.
const MAPS_AT_A_TIME: usize = 32;

/// Generates the maps of several seeds into a folder.
fn generate_all(args: &GenerateArgs, seeds: &[u64]) -> anyhow::Result<()> {
    let specs: anyhow::Result<Vec<MapSpec>> =
        seeds.iter().map(|&seed| args.source.generated.apply(&MapSpec::new(seed))).collect();
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
    let threads = Threads { beside_provers: 1, alone: core_count() };
    Ok(Some(maps::generate_all(&shared.dispatcher(), &grounds, specs, threads, is_made)?))
}

/// This build has no queue.
#[cfg(not(feature = "fleet"))]
fn share(args: &GenerateArgs, _: &[MapSpec], _: &(dyn Fn(usize) + Sync)) -> anyhow::Result<Option<Vec<Vec<u8>>>> {
    let _ = &args.blobs.blobs;
    Ok(None)
}

fn show(args: &ShowArgs) -> anyhow::Result<()> {
    let started = Instant::now();
    let map = args.source.load()?;
    let seconds = started.elapsed().as_secs_f64();
    let profile = args.body.profile()?;
    let reach = (args.stats || args.islands).then(|| Reach::survey(&map, &profile, core_count()));
    if let Some(path) = &args.png {
        draw(args, &map, reach.as_ref())?.save(path)?;
    }
    let placed = map.placed();
    let counts = [
        ("plateaus", placed.plateaus.len()),
        ("buildings", placed.buildings.len()),
        ("pools", placed.pools.len()),
        ("pads", placed.pads.len()),
        ("zip_lines", placed.zip_lines.len()),
        ("ravines", placed.ravines.len()),
        ("caves", placed.caves.len()),
        ("teleporters", placed.teleporters.len()),
        ("jetpacks", placed.jetpacks.len()),
    ];
    let size = map.size();
    let mut description = serde_json::json!({
        "seed": map.spec().map(|spec| spec.seed),
        "size": { "width": size.width, "height": size.height, "depth": size.depth },
        "hash": map.hash().to_string(),
        "triangles": map.mesh().triangles().len(),
        "memory_mb": map.memory_bytes() as f64 / 1.0e6,
        "load_s": seconds,
        "features": counts.into_iter().collect::<std::collections::BTreeMap<_, _>>(),
    });
    let stats = reach.as_ref().filter(|_| args.stats).map(Stats::of);
    if let (Some(stats), Some(object)) = (&stats, description.as_object_mut()) {
        object.extend(stats.to_json());
    }
    if args.json {
        return print_json(&description);
    }
    println!("map {} ({} x {} x {} m), hash {}", args.source.map, size.width, size.height, size.depth, map.hash());
    println!(
        "{} triangles, {:.0} MB, ready in {seconds:.2} s",
        map.mesh().triangles().len(),
        map.memory_bytes() as f64 / 1.0e6
    );
    let counts: Vec<String> = counts
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {}", name.replace('_', " ")))
        .collect();
    println!("{}", counts.join(", "));
    if let Some(stats) = stats {
        stats.print();
    }
    Ok(())
}

fn draw(args: &ShowArgs, map: &Map, reach: Option<&Reach>) -> anyhow::Result<Picture> {
    let side = map.extent().x.max(map.extent().z);
    let scale = args.scale.unwrap_or((1000.0 / side).min(8.0));
    if !(0.1..=16.0).contains(&scale) || scale * side > 8192.0 {
        bail!("--scale is {scale}, allowed are 0.1 to 16 and at most 8192 pixels a side");
    }
    let view = match args.section {
        Some(y) if !(0.0..=map.extent().y).contains(&y) => {
            bail!("--section is {y}, the map reaches from 0 to {} m", map.extent().y)
        }
        Some(y) => View::Section(y),
        None if args.iso => View::Iso,
        None => View::Top,
    };
    let islands = reach.filter(|_| args.islands).map(|reach| &reach.ground);
    let mut picture = Picture::of(map, view, scale, islands);
    let mut entries = render::legend(map);
    if islands.is_some() {
        entries[0] = ([200, 160, 120], "one colour: connected on foot");
    }
    picture.add_legend(&format!("map {}", args.source.map), &entries);
    Ok(picture)
}

/// How a map is connected.
struct Stats {
    walk: f64,
    all: f64,
    island_count: usize,
    place_count: usize,
    /// Share of pairs of places that are cut off without each means.
    needs: Vec<(&'static str, f64)>,
}

impl Stats {
    fn of(reach: &Reach) -> Self {
        let all = reach.share_by(|_| true);
        Self {
            walk: reach.share_on_foot(),
            all,
            island_count: reach.ground.islands().len(),
            place_count: reach.ground.cells().len(),
            needs: Means::ALL
                .iter()
                .copied()
                .map(|means| (means.name(), all - reach.share_by(|other| other != means)))
                .collect(),
        }
    }

    fn to_json(&self) -> serde_json::Map<String, serde_json::Value> {
        let table = |rows: &[(&'static str, f64)]| -> serde_json::Value {
            rows.iter().map(|&(name, share)| (name.to_owned(), share.into())).collect::<serde_json::Map<_, _>>().into()
        };
        [
            ("walk_connected", self.walk.into()),
            ("all_connected", self.all.into()),
            ("islands", self.island_count.into()),
            ("places", self.place_count.into()),
            ("cut_off_without", table(&self.needs)),
        ]
        .into_iter()
        .map(|(name, value): (&str, serde_json::Value)| (name.to_owned(), value))
        .collect()
    }

    fn print(&self) {
        println!("random goals connected on foot: {:.1} %", self.walk * 100.0);
        println!("random goals connected by every means: {:.1} %", self.all * 100.0);
        println!("{} islands among {} places to stand (1.25 m apart)", self.island_count, self.place_count);
        let list = |rows: &[(&'static str, f64)]| {
            let mut rows: Vec<_> = rows.iter().filter(|(_, share)| *share >= 0.0005).collect();
            rows.sort_by(|a, b| b.1.total_cmp(&a.1));
            let texts: Vec<String> =
                rows.iter().map(|(name, share)| format!("{} {:.1} %", name.replace('_', " "), share * 100.0)).collect();
            texts.join(", ")
        };
        println!("cut off without: {}", list(&self.needs));
    }
}

fn import(args: &ImportArgs) -> anyhow::Result<()> {
    let up = if args.up == "z" { UpAxis::Z } else { UpAxis::Y };
    let imported = import_level(
        &args.level,
        args.sidecar.as_deref(),
        &ImportOptions { scale: args.scale, up, keep_sides: args.keep_sides },
    )?;
    let size = imported.map.size();
    let [x, y, z] = imported.origin.to_array();
    println!("map of {} x {} x {} m, hash {}", size.width, size.height, size.depth, imported.map.hash());
    // Plans and graphs are in the map's frame, which begins at 0.
    println!("the level's origin is at {x} {y} {z} on the map");
    write(&args.out, &surefoot_levels::encode(&imported.map))
}

fn record(args: &RecordArgs) -> anyhow::Result<()> {
    let map = Arc::new(args.source.load()?);
    let policy = Policy::shipped().context("cannot use the shipped model")?;
    let decision_count = args.ticks / u64::from(TICKS_PER_DECISION);
    let recording = surefoot_rollout::crowd::record(map, &policy, args.npcs as usize, decision_count)?;
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
    recording.replay(Arc::new(map), None)?;
    println!("the replay reached the same state in {:.2} s", started.elapsed().as_secs_f64());
    Ok(())
}
