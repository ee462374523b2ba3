//! `surefoot serve`, `surefoot plan` and `surefoot work`: the three services of a deployment.

use super::agones::AgonesArgs;
use super::endpoint::{CredentialArgs, EndpointArgs, open};
use super::fleet::{NatsArg, StoreArgs};
use super::{core_count, load_policy, parse_seconds};
use crate::priority;
use crate::signals::shutdown_signal;
use anyhow::{Context, ensure};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;
use surefoot_agent::{WorkConfig, work};
use surefoot_net::levels::MapPool;
use surefoot_net::memory::DEFAULT_MAX_MEMORY_BYTES;
use surefoot_net::serving::Shutdown;
use surefoot_planner::{BuildSettings, Placement, Probing, RawBuildSettings, SettingError};
use surefoot_planner_service::store::{DEFAULT_LIMIT_BYTES, DiskStore};
use surefoot_planner_service::{self as planner, PlannerConfig, PlannerStores};
use surefoot_policy::Policy;
use surefoot_server::ServerConfig;
use surefoot_studio::{Origin, PlannerAddress, Settings};
use surefoot_world::Arrival;
use tracing::info;

/// Run the world server until Ctrl-C or SIGTERM.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot serve\n  \
        surefoot serve --listen 0.0.0.0:7600 --tls-cert server.pem --tls-key server.key --tokens tokens.toml\n  \
        surefoot serve --config surefoot.toml\n  \
        curl http://127.0.0.1:7600/metrics")]
pub struct ServeArgs {
    /// Address for gRPC, Connect, Studio's page and GET /metrics
    #[arg(long, default_value = "127.0.0.1:7600", env = "SUREFOOT_LISTEN")]
    listen: SocketAddr,
    /// Planner that Studio connects to: a URL, or a port on the host that serves the page
    #[arg(long, default_value = ":7601", value_name = "URL", env = "SUREFOOT_STUDIO_PLANNER")]
    studio_planner: PlannerAddress,
    #[command(flatten)]
    studio: StudioArgs,
    #[command(flatten)]
    limits: ServerLimits,
    #[command(flatten)]
    store: StoreArgs,
    #[command(flatten)]
    agones: AgonesArgs,
    #[command(flatten)]
    endpoint: EndpointArgs,
}

impl ServeArgs {
    /// Joins the fleet, if there is one, and returns the configuration of the server at `address`.
    async fn world_config(&self, address: SocketAddr) -> anyhow::Result<ServerConfig> {
        let config = self.limits.config();
        let Some(place) = self.store.place(address)? else { return Ok(config) };
        ensure!(config.state.is_none(), "--state cannot be combined with --store, which saves the worlds of a fleet");
        let save_every = if self.limits.save_every.is_some() { config.save_every } else { SAVE_EVERY_IN_A_FLEET };
        Ok(ServerConfig { store: Some(place.world_store().await?), save_every, ..config })
    }
}

/// Flags of Studio's page.
#[derive(clap::Args)]
pub struct StudioArgs {
    /// Further origins that Studio's page may call once its user agrees, such as https://plans.example:7601; several
    /// are divided by commas
    #[arg(long, value_name = "ORIGIN", value_delimiter = ',')]
    studio_connect: Vec<Origin>,
}

impl StudioArgs {
    /// Settings of a page that is served at `listen`.
    pub fn settings(&self, planner: PlannerAddress, listen: SocketAddr) -> Settings {
        let is_local = listen.ip().to_canonical().is_loopback();
        Settings { planner, connect: self.studio_connect.clone(), is_local }
    }
}

/// Limits of a world server.
#[derive(clap::Args)]
pub struct ServerLimits {
    /// Most worlds at a time
    #[arg(long, default_value_t = ServerConfig::default().max_worlds, value_name = "N")]
    max_worlds: usize,
    /// Most worlds of one client
    #[arg(long, default_value_t = ServerConfig::default().max_worlds_per_client, value_name = "N")]
    max_worlds_per_client: usize,
    /// Most NPCs on one world
    #[arg(long, default_value_t = ServerConfig::default().max_npcs_per_world, value_name = "N")]
    max_npcs: usize,
    /// Most NPCs of one client
    #[arg(long, default_value_t = ServerConfig::default().max_npcs_per_client, value_name = "N")]
    max_npcs_per_client: usize,
    /// Most environments of remote trainers
    #[arg(long, default_value_t = ServerConfig::default().max_envs, value_name = "N")]
    max_envs: usize,
    /// Most environments of one client
    #[arg(long, default_value_t = ServerConfig::default().max_envs_per_client, value_name = "N")]
    max_envs_per_client: usize,
    /// Most imported maps to keep
    #[arg(long, default_value_t = ServerConfig::default().max_maps, value_name = "N")]
    max_maps: usize,
    /// Memory budget for maps and environments, in MB; requests beyond it are refused
    #[arg(long, default_value_t = DEFAULT_MAX_MEMORY_BYTES / MB, value_name = "MB")]
    max_memory: u64,
    /// Close a stream whose reader reads nothing for this long
    #[arg(
        long,
        default_value_t = ServerConfig::default().reader_patience.as_secs_f64(),
        value_name = "SECONDS",
        value_parser = parse_seconds
    )]
    reader_patience: f64,
    /// Folder to save worlds in, and to restore them from at start; default: worlds are not saved
    #[arg(long, value_name = "FOLDER")]
    state: Option<PathBuf>,
    /// Interval at which a running server saves its worlds; default: 30 s, in a fleet 2 s
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    save_every: Option<f64>,
}

/// Threads of a planner that probe while provers answer. Without provers, all threads probe.
#[cfg(feature = "fleet")]
const BESIDE_PROVERS: usize = 1;

/// Default interval at which a server of a fleet saves its worlds.
const SAVE_EVERY_IN_A_FLEET: Duration = Duration::from_secs(2);

/// Longest delay of the exit by blocking work that is still running.
pub const EXIT_LIMIT: Duration = Duration::from_secs(1);

const MB: u64 = 1_000_000;

impl ServerLimits {
    /// The configuration of a server with these limits.
    pub fn config(&self) -> ServerConfig {
        ServerConfig {
            max_worlds: self.max_worlds,
            max_worlds_per_client: self.max_worlds_per_client,
            max_npcs_per_world: self.max_npcs,
            max_npcs_per_client: self.max_npcs_per_client,
            max_envs: self.max_envs,
            max_envs_per_client: self.max_envs_per_client,
            idle_envs_after: ServerConfig::default().idle_envs_after,
            max_maps: self.max_maps,
            maps: MapPool::within(self.max_memory.saturating_mul(MB)),
            reader_patience: Duration::from_secs_f64(self.reader_patience),
            state: self.state.clone(),
            store: None,
            save_every: self.save_every.map_or(ServerConfig::default().save_every, Duration::from_secs_f64),
        }
    }
}

/// Run the planner service until Ctrl-C or SIGTERM.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot plan\n  \
        surefoot plan --listen 0.0.0.0:7601 --insecure --cache /var/lib/surefoot")]
pub struct PlanArgs {
    /// Address for gRPC, Connect and GET /metrics
    #[arg(long, default_value = "127.0.0.1:7601", env = "SUREFOOT_LISTEN")]
    listen: SocketAddr,
    #[command(flatten)]
    cache: CacheArgs,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Number of probing threads; default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Most vertices of a graph
    #[arg(long, default_value_t = PlannerConfig::default().max_vertices, value_name = "N")]
    max_vertices: usize,
    /// Most queries in one batch
    #[arg(long, default_value_t = PlannerConfig::default().max_queries, value_name = "N")]
    max_queries: usize,
    /// Most builds that run or are queued
    #[arg(long, default_value_t = PlannerConfig::default().max_builds, value_name = "N")]
    max_builds: usize,
    /// Most builds that run or are queued for one client
    #[arg(long, default_value_t = PlannerConfig::default().max_builds_per_client, value_name = "N")]
    max_builds_per_client: usize,
    /// Most graphs to keep in memory
    #[arg(long, default_value_t = PlannerConfig::default().graphs_in_memory, value_name = "N")]
    graphs_in_memory: usize,
    /// Most vertices of a graph that gets hub labels before it is served; larger graphs get them in the background
    #[arg(long, alias = "table-vertices", default_value_t = PlannerConfig::default().label_vertices, value_name = "N")]
    label_vertices: usize,
    /// Most imported maps to keep
    #[arg(long, default_value_t = PlannerConfig::default().max_maps, value_name = "N")]
    max_maps: usize,
    /// Memory budget for maps, in MB; imports beyond it are refused
    #[arg(long, default_value_t = DEFAULT_MAX_MEMORY_BYTES / MB, value_name = "MB")]
    max_memory: u64,
    #[command(flatten)]
    store: StoreArgs,
    #[command(flatten)]
    nats: NatsArg,
    #[command(flatten)]
    endpoint: EndpointArgs,
}

/// The cache of graphs.
#[derive(clap::Args, Clone)]
pub struct CacheArgs {
    /// Folder of the graph cache; default: surefoot in the user's cache folder
    #[arg(long, value_name = "FOLDER", env = "SUREFOOT_CACHE")]
    cache: Option<PathBuf>,
    /// Largest size of the cache; the least recently used graphs are removed first
    #[arg(long, default_value_t = DEFAULT_LIMIT_BYTES >> 20, value_name = "MIB")]
    cache_size: u64,
}

impl CacheArgs {
    /// The folder given by flag, or `surefoot` in the user's cache folder.
    pub fn folder(&self) -> anyhow::Result<PathBuf> {
        self.cache.clone().map_or_else(Self::default_folder, Ok)
    }

    /// `surefoot` in the user's cache folder.
    pub fn default_folder() -> anyhow::Result<PathBuf> {
        let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from);
        let base = base.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache")));
        Ok(base.context("neither XDG_CACHE_HOME nor HOME is set: choose a folder with --cache")?.join("surefoot"))
    }

    /// Opens the cache with its size limit.
    pub fn open(&self) -> anyhow::Result<DiskStore> {
        Ok(DiskStore::open(&self.folder()?, self.cache_size.saturating_mul(1 << 20))?)
    }
}

/// Decide for NPCs of a world server with the policy, along plans of a planner.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot work\n  \
        surefoot work --server http://server:7600 --planner http://planner:7601 --npcs 512\n  \
        surefoot work --no-planner")]
pub struct WorkArgs {
    /// URIs of the world servers, separated by commas
    #[arg(
        long,
        default_value = "http://127.0.0.1:7600",
        value_name = "URI",
        env = "SUREFOOT_SERVER",
        value_delimiter = ','
    )]
    server: Vec<String>,
    /// Serve all servers of the fleet that these belong to, including servers that join later
    #[arg(long)]
    fleet: bool,
    /// URIs of the planner and its replicas, separated by commas
    #[arg(
        long,
        default_value = "http://127.0.0.1:7601",
        value_name = "URI",
        env = "SUREFOOT_PLANNER",
        value_delimiter = ','
    )]
    planner: Vec<String>,
    /// Head straight for goals instead of following plans
    #[arg(long)]
    no_planner: bool,
    /// Most NPCs to decide for
    #[arg(long, default_value_t = 512, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    npcs: u32,
    /// Let NPCs follow their plans without rehearsing the next legs in a copy of the simulation
    #[arg(long)]
    no_rehearsals: bool,
    #[command(flatten)]
    style: StyleArg,
    /// Memory budget for the maps of rehearsals, in MB; NPCs on maps beyond it do not rehearse
    #[arg(long, default_value_t = DEFAULT_MAX_MEMORY_BYTES / MB, value_name = "MB")]
    max_memory: u64,
    /// Name of the worker in the server's lists; default: host name and process id
    #[arg(long)]
    name: Option<String>,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// What evaluates the policy
    #[arg(long, default_value = "cpu")]
    pub inference: Inference,
    #[command(flatten)]
    graph: GraphArgs,
    #[command(flatten)]
    credentials: CredentialArgs,
}

/// What evaluates a policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Inference {
    /// Surefoot's own implementation for CPUs
    Cpu,
    /// burn on the CPU, in surefoot-lab
    Burn,
    /// burn on an NVIDIA GPU, in a surefoot-lab that has the feature `cuda`
    BurnCuda,
}

/// How graphs are built.
#[derive(clap::Args, Clone, Copy)]
pub struct GraphArgs {
    /// Placement of vertices: random, spaced, density, trajectories, trajectories-tested, flood or flood-grandchildren
    #[arg(long, default_value = "spaced", value_name = "NAME", value_parser = parse_placement)]
    pub placement: Placement,
    /// Most vertices; those that are spaced keep 1 m between them, so small levels get fewer
    #[arg(long, default_value_t = 300, value_name = "N")]
    pub vertices: u32,
    /// Nearest neighbours that each vertex forms candidate edges with
    #[arg(long, default_value_t = 12, value_name = "K")]
    pub neighbours: u32,
    /// Most probes per candidate edge
    #[arg(long, default_value_t = 2, value_name = "R")]
    pub repeats: u32,
    /// Share of probes that must arrive to prove an edge
    #[arg(long, default_value_t = 0.2, value_name = "T")]
    pub threshold: f32,
    /// Run all probes of every candidate, even after its result is settled
    #[arg(long)]
    pub exhaustive: bool,
    /// Place no vertices and candidates at devices and ledges, as in the paper
    #[arg(long)]
    pub no_special_moves: bool,
    /// Let a touch prove an edge, in the air or behind a wall as well, as in the paper
    #[arg(long)]
    pub touch: bool,
}

fn parse_placement(name: &str) -> Result<Placement, String> {
    let names: Vec<&str> = Placement::ALL.iter().map(|placement| placement.name()).collect();
    name.parse().map_err(|_| format!("known are {}", names.join(", ")))
}

impl GraphArgs {
    /// The checked settings, with seed 0.
    pub fn settings(self) -> Result<BuildSettings, SettingError> {
        let raw = RawBuildSettings {
            placement: self.placement,
            vertices: self.vertices as usize,
            neighbours: self.neighbours as usize,
            repeats: self.repeats,
            threshold: f64::from(self.threshold),
            seed: 0,
            probing: if self.exhaustive { Probing::Exhaustive } else { Probing::Frugal },
            special_moves: !self.no_special_moves,
            arrival: if self.touch { Arrival::Touch } else { Arrival::Stand },
        };
        raw.try_into()
    }
}

/// Runs `body` on a tokio runtime with a shutdown that Ctrl-C or SIGTERM triggers.
pub fn run_until_signal<F>(body: impl FnOnce(Shutdown) -> F) -> anyhow::Result<()>
where
    F: Future<Output = anyhow::Result<()>>,
{
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let result = runtime.block_on(async {
        let shutdown = Shutdown::default();
        let (signal, trigger) = (shutdown_signal(), shutdown.clone());
        tokio::spawn(async move {
            signal.await;
            info!("stopping");
            trigger.trigger();
        });
        body(shutdown).await
    });
    runtime.shutdown_timeout(EXIT_LIMIT);
    result
}

/// Runs the world server until a signal stops it.
pub fn serve(args: &ServeArgs) -> anyhow::Result<()> {
    let config = args.endpoint.config()?;
    args.agones.check()?;
    run_until_signal(|shutdown| async move {
        let pages = surefoot_studio::pages(args.studio.settings(args.studio_planner.clone(), args.listen));
        let endpoint = open("--listen", args.listen, config)?.with_pages(pages);
        let config = args.world_config(endpoint.address()).await?;
        info!(address = %endpoint.address(), "world server ready");
        let (observer, serving) = surefoot_server::serve_observed(endpoint, config, shutdown);
        args.agones.run_with_sidecar(observer, serving).await
    })
}

/// Host name and process id. Containers may share a process id, and processes on a host share its name.
fn default_name() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").ok().or_else(|| std::env::var("COMPUTERNAME").ok());
    let host = host.as_deref().map_or("surefoot", str::trim);
    // The server accepts names of up to 64 bytes.
    let end = host.char_indices().map(|(at, letter)| at + letter.len_utf8()).take_while(|end| *end <= 48).last();
    format!("{}-{}", &host[..end.unwrap_or(0)], std::process::id())
}

/// Runs the planner service until a signal stops it.
pub fn plan(args: &PlanArgs) -> anyhow::Result<()> {
    let endpoint_config = args.endpoint.config()?;
    args.nats.check()?;
    let policy = load_policy(args.model.as_deref())?;
    let config = PlannerConfig {
        max_vertices: args.max_vertices,
        max_queries: args.max_queries,
        max_builds: args.max_builds,
        max_builds_per_client: args.max_builds_per_client,
        graphs_in_memory: args.graphs_in_memory,
        threads: args.threads.unwrap_or_else(core_count),
        label_vertices: args.label_vertices,
        max_maps: args.max_maps,
        maps: MapPool::within(args.max_memory.saturating_mul(MB)),
        ..PlannerConfig::default()
    };
    priority::lower();
    run_until_signal(|shutdown| async move {
        let endpoint = open("--listen", args.listen, endpoint_config)?;
        let (stores, place): (PlannerStores, _) = match args.store.place(endpoint.address())? {
            Some(place) => (place.planner_stores().await?, place.to_string()),
            None => (Box::new(args.cache.open()?).into(), args.cache.folder()?.display().to_string()),
        };
        let config = with_provers(config, args, &policy).await?;
        info!(address = %endpoint.address(), store = %place, "planner ready");
        Ok(planner::serve(endpoint, config, policy, stores, shutdown).await?)
    })
}

/// Shares the probes of builds with provers if `--nats` is given.
#[cfg(feature = "fleet")]
async fn with_provers(config: PlannerConfig, args: &PlanArgs, policy: &Policy) -> anyhow::Result<PlannerConfig> {
    let Some(nats) = &args.nats.nats else { return Ok(config) };
    let shared = super::fleet::Shared::open(nats, args.store.blobs(), policy).await?;
    info!(lane = %shared.lane, nats = %shared.queue.place(), "provers share the probes of builds");
    Ok(PlannerConfig { provers: std::sync::Arc::new(shared.provers(BESIDE_PROVERS)), ..config })
}

/// This build has no queue.
#[cfg(not(feature = "fleet"))]
#[expect(clippy::unused_async, reason = "with the feature, it connects")]
async fn with_provers(config: PlannerConfig, _: &PlanArgs, _: &Policy) -> anyhow::Result<PlannerConfig> {
    Ok(config)
}

/// How NPCs move.
#[derive(clap::Args)]
pub struct StyleArg {
    /// How NPCs that rehearse move
    #[arg(long, default_value = "composed")]
    style: Style,
}

/// A style of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Style {
    /// Face the direction of travel, and jump only where a leg needs it
    Composed,
    /// Move exactly as the policy decides
    Free,
}

impl StyleArg {
    /// Whether NPCs that rehearse move in the composed style.
    pub fn composes(&self) -> bool {
        self.style == Style::Composed
    }
}

/// Runs an NPC worker until a signal stops it. `prepare` may change how the policy is evaluated.
pub fn run_worker(args: &WorkArgs, prepare: impl FnOnce(Policy) -> anyhow::Result<Policy>) -> anyhow::Result<()> {
    let policy = prepare(load_policy(args.model.as_deref())?)?;
    let config = WorkConfig {
        servers: args.server.clone(),
        is_of_fleet: args.fleet,
        planners: if args.no_planner { Vec::new() } else { args.planner.clone() },
        credentials: args.credentials.credentials()?,
        capacity: args.npcs,
        name: args.name.clone().unwrap_or_else(default_name),
        graph: args.graph.settings()?,
        noise_share: surefoot_rollout::DEFAULT_NOISE_SHARE,
        rehearses: !args.no_rehearsals,
        composes: args.style.composes(),
        maps: MapPool::within(args.max_memory.saturating_mul(MB)),
    };
    priority::lower();
    run_until_signal(|shutdown| async move { Ok(work(config, policy, shutdown).await?) })
}
