//! `surefoot up`: all services in one process, with a crowd to watch.

use super::endpoint::{CredentialArgs, EndpointArgs, open};
use super::map::{BodyArg, Generated, LevelArgs, file_name, files_only, parse_maps};
use super::services::{CacheArgs, EXIT_LIMIT, GraphArgs, ServerLimits, StudioArgs, run_until_signal};
use super::{core_count, load_policy};
use crate::priority;
use crate::terminal::{is_interactive, print_json};
use anyhow::{Context, bail};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use surefoot_agent::crowd::Crowd;
use surefoot_agent::{WorkConfig, measure_capacity, work};
use surefoot_net::client::{Credentials, Link};
use surefoot_net::serving::{EndpointConfig, Shutdown};
use surefoot_planner_service::{self as planner, PlannerConfig};
use surefoot_proto::convert::{body_to_wire, map_spec_to_wire};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, WatchStatsResponse, WorldStats};
use surefoot_studio::PlannerAddress;
use surefoot_world::{CharacterProfile, MapSpec};
use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task::JoinSet;

/// Seed of the scene's first map. No map of the scene belongs to a split that is trained on or measured on.
const FIRST_SEED: u64 = 9000;
/// Number of seeds, from [`FIRST_SEED`], that belong to the scene.
const MAX_SCENE_MAPS: u64 = 1000;
/// Bytes of a level that are uploaded at a time; servers take 1 MiB in a message unless configured.
const UPLOAD_BYTES: usize = 512 * 1024;
/// Most NPCs of a worker that a server accepts.
const MAX_WORKER_NPCS: u32 = 65_536;
/// Pause between two calls to a server that is starting.
const START_PAUSE: Duration = Duration::from_millis(200);

/// Run all services in one process: world server, planner, NPC workers, and a crowd with random goals.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot up\n  \
        surefoot up --for 120 --json\n  \
        surefoot up --maps 4 --npcs 512\n  \
        surefoot up --kind islands --body unity\n  \
        surefoot up --maps level.glb,other.obj\n  \
        surefoot up --maps 'levels/*.glb' --scale 0.01")]
pub struct Args {
    /// Address of the world server; port 0 picks a free port
    #[arg(long, default_value = "127.0.0.1:7600")]
    listen: SocketAddr,
    /// Address of the planner; port 0 picks a free port
    #[arg(long, default_value = "127.0.0.1:7601")]
    planner_listen: SocketAddr,
    /// Number of worlds, each on its own unseen map; or files (.sfmap, .glb, .gltf, .obj) and patterns such as
    /// levels/*.glb, for a world on each
    #[arg(long, default_value = "2", value_name = "N|FILE,...", num_args = 1..)]
    maps: Vec<String>,
    #[command(flatten)]
    generated: Generated,
    #[command(flatten)]
    levels: LevelArgs,
    #[command(flatten)]
    body: BodyArg,
    /// Number of NPCs in the crowd. Workers also take NPCs of clients: as many as the machine can hold
    #[arg(long, default_value_t = 128, value_name = "N")]
    npcs: usize,
    /// Number of NPC workers
    #[arg(long, default_value_t = 2, value_name = "N")]
    workers: u32,
    /// Let NPCs pass through one another
    #[arg(long)]
    ghosts: bool,
    /// Exit after this time with a summary; the exit code is not 0 if no NPC arrived
    #[arg(long = "for", value_name = "SECONDS")]
    duration: Option<f64>,
    #[command(flatten)]
    cache: CacheArgs,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    #[command(flatten)]
    graph: GraphArgs,
    #[command(flatten)]
    studio: StudioArgs,
    #[command(flatten)]
    limits: ServerLimits,
    /// Print the summary as one JSON document
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    endpoint: EndpointArgs,
    #[command(flatten)]
    credentials: CredentialArgs,
}

/// Runs all services and a crowd in one process.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.npcs == 0 || args.workers == 0 {
        bail!("--npcs and --workers must be at least 1");
    }
    let maps = args.maps()?;
    let body = args.body.profile()?;
    let endpoints = args.endpoint.config()?;
    if endpoints.security.tokens.is_some() && !args.credentials.has_token() {
        bail!(
            "--tokens needs --token or --token-file: the workers and the crowd of `up` call with the token of an admin"
        );
    }
    let credentials = args.credentials.credentials()?;
    let background = priority::background()?;
    let setup = Setup { maps, body, endpoints, credentials, background: background.handle().clone() };
    let result = run_until_signal(|shutdown| scene(args, setup, shutdown));
    background.shutdown_timeout(EXIT_LIMIT);
    result
}

/// The map of a world of the scene.
enum SceneMap {
    Generated(MapSpec),
    /// Name and saved map of a level.
    Level(String, Vec<u8>),
}

impl Args {
    fn maps(&self) -> anyhow::Result<Vec<SceneMap>> {
        if let [count] = self.maps.as_slice()
            && let Ok(count) = count.parse::<u64>()
        {
            self.levels.check(&[])?;
            if !(1..=MAX_SCENE_MAPS).contains(&count) {
                bail!("--maps is `{count}`: give a number from 1 to {MAX_SCENE_MAPS}, or files");
            }
            let generated = |idx| Ok(SceneMap::Generated(self.generated.apply(&MapSpec::new(FIRST_SEED + idx))?));
            return (0..count).map(generated).collect();
        }
        let maps = parse_maps(&self.maps).context("--maps takes a number of worlds, or files")?;
        let files = files_only(maps.clone()).context("--maps takes a number of worlds, or files")?;
        self.levels.check(&maps)?;
        let level = |file: PathBuf| {
            let map = self.levels.load(&file)?;
            Ok(SceneMap::Level(file_name(&file), surefoot_levels::encode(&map)))
        };
        files.into_iter().map(level).collect()
    }
}

/// What the scene runs with, after the flags have been checked.
struct Setup {
    maps: Vec<SceneMap>,
    body: CharacterProfile,
    endpoints: EndpointConfig,
    credentials: Credentials,
    /// Where the planner and the workers run.
    background: Handle,
}

/// The tasks of the scene; the first that fails ends it.
type Parts = JoinSet<anyhow::Result<()>>;

async fn scene(args: &Args, setup: Setup, shutdown: Shutdown) -> anyhow::Result<()> {
    let started = Instant::now();
    let mut parts = Parts::new();
    let server_uri = start_services(args, &setup, &shutdown, &mut parts)?;
    let link = setup.credentials.dial(&server_uri)?.connect().await.context("cannot connect to the world server")?;
    drop_former_scene(&link).await.context("cannot prepare the world server")?;
    let map_count = setup.maps.len();
    let mut watches = Vec::with_capacity(map_count);
    for (idx, map) in setup.maps.into_iter().enumerate() {
        let npcs = args.npcs / map_count + usize::from(idx < args.npcs % map_count);
        let request = world_request(&link, map, &setup.body, !args.ghosts).await?;
        let crowd = Crowd::start(link.clone(), request, npcs, FIRST_SEED + idx as u64)
            .await
            .context("cannot populate a world")?;
        let (stats, latest) = watch::channel(WatchStatsResponse::default());
        watches.push(Watched { world_id: crowd.world().world_id, npcs, latest });
        let stop = shutdown.clone();
        parts.spawn(async move {
            tokio::select! {
                result = crowd.keep_busy(stats) => result.context("a crowd stopped"),
                () = stop.wait() => Ok(()),
            }
        });
    }
    let maps = if map_count == 1 { "map" } else { "maps" };
    eprintln!("{} NPCs on {map_count} {maps}, ready after {:.1} s", args.npcs, started.elapsed().as_secs_f64());
    let failure = watch_scene(args, started, &watches, &mut parts, &shutdown).await;
    shutdown.trigger();
    while let Some(ended) = parts.join_next().await {
        // Only the first failure is reported.
        drop(ended);
    }
    failure?;
    summarise(args, started, &watches)
}

/// Starts the world server, the planner and the workers, and returns the URI of the server.
fn start_services(args: &Args, setup: &Setup, shutdown: &Shutdown, parts: &mut Parts) -> anyhow::Result<String> {
    let plans = open("--planner-listen", args.planner_listen, setup.endpoints.clone())?;
    let planner_address = PlannerAddress::Port(plans.address().port());
    let pages = surefoot_studio::pages(args.studio.settings(planner_address, args.listen));
    let server = open("--listen", args.listen, setup.endpoints.clone())?.with_pages(pages);
    let (server_uri, planner_uri) = (server.uri(), plans.uri());
    let policy = load_policy(args.model.as_deref())?;
    let store = args.cache.open()?;
    eprintln!("world server  {server_uri}  (gRPC, JSON, GET /metrics)");
    eprintln!("planner       {planner_uri}");
    match surefoot_studio::missing() {
        None => eprintln!("Studio        {server_uri}/  open it in a browser: NPCs, their plans, and the graph"),
        Some(reason) => eprintln!("Studio        not in this build: {reason}"),
    }
    if let Ok(program) = std::env::current_exe() {
        let program = program.display();
        eprintln!("type next     {program} up --maps level.glb      NPCs in a level of yours (after Ctrl-C)");
        eprintln!("              {program} graph reach level.glb    what no character can reach in it");
    }
    let (limits, stop) = (args.limits.config(), shutdown.clone());
    // The planner proves and the workers rehearse on the server's maps, so that no map is generated or held twice.
    let maps = limits.maps.clone();
    parts.spawn(async move { Ok(surefoot_server::serve(server, limits, stop).await?) });
    let (prober, stop) = (policy.clone(), shutdown.clone());
    let config = PlannerConfig { threads: core_count(), maps: maps.clone(), ..PlannerConfig::default() };
    let plans = async move { Ok(planner::serve(plans, config, prober, Box::new(store), stop).await?) };
    parts.spawn_on(plans, &setup.background);
    let capacity = worker_capacity(args, measure_capacity(&policy));
    for idx in 0..args.workers {
        let config = WorkConfig {
            servers: vec![server_uri.clone()],
            is_of_fleet: false,
            planners: vec![planner_uri.clone()],
            credentials: setup.credentials.clone(),
            capacity,
            name: format!("up-{idx}"),
            graph: args.graph.settings()?,
            noise_share: surefoot_rollout::DEFAULT_NOISE_SHARE,
            rehearses: true,
            composes: true,
            maps: maps.clone(),
        };
        let (policy, stop) = (policy.clone(), shutdown.clone());
        parts.spawn_on(async move { Ok(work(config, policy, stop).await?) }, &setup.background);
    }
    Ok(server_uri)
}

/// NPCs that a worker takes of the `measured` ones that the machine can hold: an equal part, and at least the crowd.
fn worker_capacity(args: &Args, measured: u32) -> u32 {
    let npcs = args.npcs.min(MAX_WORKER_NPCS as usize) as u32;
    measured.div_ceil(args.workers).clamp(npcs, MAX_WORKER_NPCS)
}

/// The request for a world on a map. A level is imported first, and its worlds of an earlier scene are dropped.
async fn world_request(
    link: &Link,
    map: SceneMap,
    body: &CharacterProfile,
    solid_npcs: bool,
) -> anyhow::Result<wire::CreateWorldRequest> {
    let body = Some(body_to_wire(body));
    let mut request = wire::CreateWorldRequest { body, solid_npcs: Some(solid_npcs), ..Default::default() };
    match map {
        SceneMap::Generated(spec) => request.map = Some(map_spec_to_wire(&spec)),
        SceneMap::Level(name, file) => {
            request.map_hash = import(link, &name, &file).await.with_context(|| format!("cannot import {name}"))?;
            drop_worlds(link, |world| world.map_hash == request.map_hash).await?;
        }
    }
    Ok(request)
}

/// Waits until the server has restored its saved worlds, then drops the worlds of an earlier scene, which would
/// accumulate.
async fn drop_former_scene(link: &Link) -> anyhow::Result<()> {
    let mut client = WorldServiceClient::new(link.clone());
    while let Err(status) = client.get_server(wire::GetServerRequest {}).await {
        if Reason::of(&status) != Some(Reason::Starting) {
            return Err(status.into());
        }
        tokio::time::sleep(START_PAUSE).await;
    }
    let seeds = FIRST_SEED..FIRST_SEED + MAX_SCENE_MAPS;
    drop_worlds(link, |world| world.map.is_some_and(|map| seeds.contains(&map.seed))).await
}

/// Imports a saved map into the server, and returns its hash.
async fn import(link: &Link, name: &str, file: &[u8]) -> anyhow::Result<String> {
    let mut client = MapServiceClient::new(link.clone());
    let upload_id = format!("up-{name}");
    for (idx, part) in file.chunks(UPLOAD_BYTES).enumerate() {
        let offset = (idx * UPLOAD_BYTES) as u64;
        let request = wire::UploadChunkRequest { upload_id: upload_id.clone(), offset, data: part.to_vec() };
        client.upload_chunk(request).await?;
    }
    let format = wire::MapFormat::Saved.into();
    let request = wire::ImportMapRequest { name: name.to_owned(), format, upload_id, ..Default::default() };
    Ok(client.import_map(request).await?.into_inner().map.unwrap_or_default().map_hash)
}

/// Drops the worlds for which `is_former` holds.
async fn drop_worlds(link: &Link, is_former: impl Fn(&wire::World) -> bool) -> anyhow::Result<()> {
    let mut client = WorldServiceClient::new(link.clone());
    let mut page_token = String::new();
    loop {
        let request = wire::ListWorldsRequest { page_size: 0, page_token };
        let wire::ListWorldsResponse { worlds, next_page_token, .. } = client.list_worlds(request).await?.into_inner();
        for world in worlds {
            if is_former(&world) {
                client.drop_world(wire::DropWorldRequest { world_id: world.world_id }).await?;
            }
        }
        page_token = next_page_token;
        if page_token.is_empty() {
            return Ok(());
        }
    }
}

/// A world of the scene.
struct Watched {
    world_id: u64,
    npcs: usize,
    latest: watch::Receiver<WatchStatsResponse>,
}

/// Prints a table periodically until the time is up, a signal arrives, or a part fails.
async fn watch_scene(
    args: &Args,
    started: Instant,
    watches: &[Watched],
    parts: &mut Parts,
    shutdown: &Shutdown,
) -> anyhow::Result<()> {
    let period = Duration::from_secs(if is_interactive() { 1 } else { 10 });
    let mut ticks = tokio::time::interval_at(tokio::time::Instant::now() + period, period);
    let end = args
        .duration
        .map(|seconds| tokio::time::Instant::from_std(started) + Duration::from_secs_f64(seconds.clamp(0.0, 1.0e6)));
    let time_up = async {
        match end {
            Some(end) => tokio::time::sleep_until(end).await,
            None => std::future::pending().await,
        }
    };
    tokio::pin!(time_up);
    let mut before = 0;
    loop {
        tokio::select! {
            _ = ticks.tick() => before = print_table(started, watches, before, period),
            () = &mut time_up => return Ok(()),
            () = shutdown.wait() => return Ok(()),
            Some(ended) = parts.join_next() => ended.context("a part of the scene panicked")??,
        }
    }
}

fn stats(watching: &watch::Receiver<WatchStatsResponse>) -> WorldStats {
    watching.borrow().stats.clone().unwrap_or_default()
}

/// Number of attempts that have ended.
pub(super) fn attempts(stats: &WorldStats) -> u64 {
    stats.reached + stats.fell + stats.burnt + stats.drowned + stats.no_progress + stats.unreachable
}

pub(super) fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

/// Prints one row per world; returns the decisions answered so far.
fn print_table(started: Instant, watches: &[Watched], before: u64, period: Duration) -> u64 {
    let mut table = format!(
        "{:>6.0} s  {:>5} {:>5} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8}\n",
        started.elapsed().as_secs_f64(),
        "world",
        "npcs",
        "tick p50",
        "tick p99",
        "dropped",
        "missed",
        "arrived",
        "success"
    );
    let mut answered = 0;
    for Watched { world_id, npcs, latest } in watches {
        let stats = stats(latest);
        answered += stats.decisions_answered;
        table += &format!(
            "          {world_id:>5} {:>5} {:>6.2} ms {:>6.2} ms {:>8} {:>7.2}% {:>8} {:>7.1}%\n",
            npcs,
            stats.tick_us_p50 / 1000.0,
            stats.tick_us_p99 / 1000.0,
            stats.ticks_dropped,
            percent(stats.decisions_missed, stats.decisions_requested),
            stats.reached,
            percent(stats.reached, attempts(&stats)),
        );
    }
    eprintln!("{table}          {:.0} decisions/s", (answered.saturating_sub(before)) as f64 / period.as_secs_f64());
    answered
}

fn summarise(args: &Args, started: Instant, watches: &[Watched]) -> anyhow::Result<()> {
    let all: Vec<WorldStats> = watches.iter().map(|watched| stats(&watched.latest)).collect();
    let sum = |value: fn(&WorldStats) -> u64| all.iter().map(value).sum::<u64>();
    let worst = |value: fn(&WorldStats) -> f32| all.iter().map(value).fold(0.0, f32::max);
    let (arrivals, attempted) = (sum(|stats| stats.reached), sum(attempts));
    if args.json {
        print_json(&serde_json::json!({
            "seconds": started.elapsed().as_secs_f64(),
            "npcs": args.npcs,
            "maps": watches.len(),
            "arrivals": arrivals,
            "attempts": attempted,
            "success": arrivals as f64 / attempted.max(1) as f64,
            "ends": {
                "reached": arrivals,
                "fell": sum(|s| s.fell),
                "burnt": sum(|s| s.burnt),
                "drowned": sum(|s| s.drowned),
                "no_progress": sum(|s| s.no_progress),
                "unreachable": sum(|s| s.unreachable),
            },
            "tick_ms_p50": worst(|s| s.tick_us_p50) / 1000.0,
            "tick_ms_p99": worst(|s| s.tick_us_p99) / 1000.0,
            "ticks_dropped": sum(|s| s.ticks_dropped),
            "decisions_requested": sum(|s| s.decisions_requested),
            "decisions_missed": sum(|s| s.decisions_missed),
        }))?;
    } else {
        println!(
            "{arrivals} arrivals in {attempted} finished attempts: {:.1} % success (fell {}, burnt {}, drowned {}, no \
             progress {}, unreachable {})",
            percent(arrivals, attempted),
            sum(|s| s.fell),
            sum(|s| s.burnt),
            sum(|s| s.drowned),
            sum(|s| s.no_progress),
            sum(|s| s.unreachable)
        );
        println!(
            "tick p50 {:.2} ms, p99 {:.2} ms, {} ticks dropped, {:.2} % of {} decisions missed",
            worst(|s| s.tick_us_p50) / 1000.0,
            worst(|s| s.tick_us_p99) / 1000.0,
            sum(|s| s.ticks_dropped),
            percent(sum(|s| s.decisions_missed), sum(|s| s.decisions_requested)),
            sum(|s| s.decisions_requested)
        );
    }
    if args.duration.is_some() && arrivals == 0 {
        bail!("no NPC arrived");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::map::SPLITS;
    use surefoot_policy::Policy;

    #[test]
    fn the_scene_shows_no_map_of_a_split() {
        let scene = FIRST_SEED..FIRST_SEED + MAX_SCENE_MAPS;
        for (name, seeds) in SPLITS {
            assert!(seeds.end <= scene.start || seeds.start >= scene.end, "{name}: {seeds:?}");
        }
        // The map of 1 km.
        assert!(!scene.contains(&3000));
        let policy = Policy::shipped().unwrap();
        let stages = std::iter::successors(Some(&policy.manifest().training), |stage| stage.get("started_from"));
        for seeds in stages.map(|stage| &stage["config"]["collector"]["map_seeds"]).filter(|it| !it.is_null()) {
            assert!(seeds["end"].as_u64().unwrap() <= scene.start, "trained on {seeds}");
        }
    }
}
