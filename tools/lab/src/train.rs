//! `surefoot train`.

use anyhow::Context;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use surefoot_cli::commands::endpoint::{CredentialArgs, EndpointArgs};
use surefoot_cli::commands::map::{LevelArgs, SeedOrFile, file_name, files_only, load_body, parse_maps, seeds_only};
use surefoot_cli::commands::{game, parse_seconds, revision};
use surefoot_net::client::Credentials;
use surefoot_net::serving::Endpoint;
use surefoot_train::actors::Listener;
use surefoot_train::worlds::Connect;
use surefoot_train::{self, Processor, RunArgs, TrainConfig};
use surefoot_world::map::{Features, MapKind, MoverDensities};

/// Default number of actors that can connect.
const USUAL_ACTORS: usize = 2;

/// Train a reactive or recurrent SAC agent. Ctrl-C or SIGTERM writes a checkpoint and exits; --resume continues
/// exactly.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot train runs/first\n  \
        surefoot train runs/first --resume\n  \
        surefoot train runs/lstm --recurrent --from models/general-reactive\n  \
        surefoot train runs/level --recurrent --from models/general-lstm --maps 2000\n  \
        surefoot train runs/mine --config my.json --updates 50000\n  \
        surefoot train runs/mine --from models/general-reactive --maps level.glb --body unity\n  \
        surefoot train runs/game --from models/general-reactive --maps level.glb --worlds \
        http://10.0.0.7:7700,http://10.0.0.8:7700\n  \
        surefoot train runs/fed --listen 0.0.0.0:7610 --actors 8 --tls-cert server.pem --tls-key server.key --tokens \
        tokens.toml\n  \
        tensorboard --logdir runs")]
pub struct Args {
    /// Folder of the run: config.json, state.bin, best/, last/, tensorboard/
    folder: PathBuf,
    /// Continue the run in the folder
    #[arg(
        long,
        conflicts_with_all = ["config", "updates", "seed", "recurrent", "from", "maps", "size", "height", "features",
            "movers", "kind", "body", "name", "processor", "npcs", "envs", "scale", "up", "keep_sides", "no_names",
            "all_scenes", "sidecar"]
    )]
    resume: bool,
    /// Use this configuration (the config.json of another run) instead of the defaults
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Train the agent with an LSTM
    #[arg(long, conflicts_with = "config")]
    recurrent: bool,
    /// Start from the weights of this model or run; a recurrent agent may start from a reactive one
    #[arg(long, value_name = "FOLDER")]
    from: Option<PathBuf>,
    /// Seeds of the maps to train on, such as 0..128, or files (.sfmap, .glb, .gltf, .obj) and patterns such as
    /// 'levels/*.glb', which are copied to the run's folder. May be repeated. With a single map, the policy specialises
    /// in it
    #[arg(long, value_name = "SEEDS|FILE,...")]
    maps: Vec<String>,
    #[command(flatten)]
    levels: LevelArgs,
    /// Side of the training maps in metres
    #[arg(long, value_name = "METRES")]
    size: Option<u32>,
    /// Height of the training maps in metres
    #[arg(long, value_name = "METRES")]
    height: Option<u32>,
    /// Features of the training maps: paper, all or none, followed by changes, such as all,lava=0
    #[arg(long, value_name = "LIST")]
    features: Option<Features>,
    /// Movers of the training maps: none or all, followed by changes, such as all,doors=0
    #[arg(long, value_name = "LIST")]
    movers: Option<MoverDensities>,
    /// Kinds of the training maps: terrain, islands, interior, arena, tower, open; several take turns by seed
    #[arg(long, value_name = "KIND,...", value_delimiter = ',')]
    kind: Vec<MapKind>,
    /// Body to train: surefoot, paper, unreal, godot, unity, heavy, small or climber, or a .toml file with the fields
    /// of a profile
    #[arg(long, value_name = "NAME|FILE")]
    body: Option<String>,
    /// Name of the model
    #[arg(long)]
    name: Option<String>,
    /// Processor of the learner
    #[arg(long, value_parser = PossibleValuesParser::new(["cpu", "cuda"]).map(processor))]
    processor: Option<Processor>,
    /// Stop after N updates
    #[arg(long, value_name = "N")]
    updates: Option<u64>,
    /// Seed of weights, noise, maps and goals
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    /// Collect experience in the worlds at these addresses instead of this process: Surefoot's servers, or games, which
    /// run the level of
    /// --maps. One level is for all worlds; of several, each world runs one. With --resume, the new addresses
    #[arg(long, visible_alias = "world", value_name = "URI,...", value_delimiter = ',', env = "SUREFOOT_WORLDS")]
    worlds: Vec<String>,
    /// Environments at a time in each world
    #[arg(long, value_name = "N", requires = "worlds")]
    envs: Option<usize>,
    /// NPCs on each map, or in each environment of --worlds
    #[arg(long, value_name = "N")]
    npcs: Option<usize>,
    /// Let actors (`surefoot act`) collect the experience instead of this process; they connect to this address
    #[arg(long, value_name = "ADDRESS", conflicts_with = "worlds")]
    listen: Option<SocketAddr>,
    /// Most actors that can connect; each has as many NPCs as the run would have in this process [default: 2]
    #[arg(long, value_name = "N", requires = "listen")]
    actors: Option<usize>,
    /// Shortest time between two versions of weights that the learner sends to an actor
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = parse_seconds)]
    weights_every: f64,
    /// Print the contents of the run's replay buffers as JSON, and exit
    #[arg(long, conflicts_with_all = ["resume", "worlds", "listen"])]
    inspect: bool,
    #[command(flatten)]
    credentials: CredentialArgs,
    #[command(flatten)]
    endpoint: EndpointArgs,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    if args.inspect {
        println!("{}", serde_json::to_string_pretty(&surefoot_train::census_of(&args.folder)?)?);
        return Ok(());
    }
    let config = args.config()?;
    let stop = Arc::new(AtomicBool::new(false));
    stop_on_signal(stop.clone())?;
    let connect = connector(args.credentials.credentials()?);
    if !args.resume {
        // A wrong address is reported before anything is written.
        config.worlds.iter().try_for_each(|uri| connect(uri).map(drop))?;
    }
    let listener = args.listen.map(|address| listen(address, &args.endpoint, args.weights_every)).transpose()?;
    if let Some(listener) = &listener {
        println!("actors connect to {}", listener.endpoint.address());
    }
    let (resume, worlds) = (args.resume, args.worlds);
    let run_args = RunArgs { folder: &args.folder, resume, worlds, connect, listener, revision: revision() };
    surefoot_train::run(config, run_args, &stop, |line| println!("{line}"))?;
    Ok(())
}

impl Args {
    /// The configuration of the run: the file or the defaults, changed by the flags.
    fn config(&self) -> anyhow::Result<TrainConfig> {
        let mut config = match &self.config {
            Some(path) => {
                let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
                serde_json::from_slice(&text)
                    .with_context(|| format!("{} is not a training configuration", path.display()))?
            }
            None if self.recurrent => TrainConfig::recurrent(),
            None => TrainConfig::default(),
        };
        if let Some(updates) = self.updates {
            config.total_updates = updates;
            config.sac.decay_updates = NonZeroU64::new(updates);
            config.stop_after = NonZeroU64::new(updates / 5);
        }
        config.envs_per_world = self.envs.unwrap_or(config.envs_per_world);
        config.seed = self.seed.unwrap_or(config.seed);
        config.start_from = self.from.clone().or(config.start_from);
        config.name = self.name.clone().unwrap_or(config.name);
        self.configure_maps(&mut config)?;
        config.collector.npcs_per_world = self.npcs.unwrap_or(config.collector.npcs_per_world);
        if !self.worlds.is_empty() {
            if config.start_from.is_some() && self.config.is_none() {
                // A trained policy needs no random actions first.
                config.collector.random_decisions = 0;
            }
            config.worlds.clone_from(&self.worlds);
        }
        if let Some(processor) = self.processor {
            config.processor = processor;
        }
        if self.listen.is_some() {
            config.actors = self.actors.unwrap_or(USUAL_ACTORS);
        }
        Ok(config)
    }

    /// Applies the flags about maps and bodies. Levels are copied into the folder of the run.
    fn configure_maps(&self, config: &mut TrainConfig) -> anyhow::Result<()> {
        let collector = &mut config.collector;
        collector.map_side = self.size.unwrap_or(collector.map_side);
        collector.map_height = self.height.unwrap_or(collector.map_height);
        collector.map_features = self.features.unwrap_or(collector.map_features);
        collector.map_movers = self.movers.unwrap_or(collector.map_movers);
        if !self.kind.is_empty() {
            collector.map_kinds.clone_from(&self.kind);
        }
        if let Some(body) = &self.body {
            (collector.body, collector.random_bodies) = (load_body(body)?, 0.0);
        }
        let maps = parse_maps(&self.maps).context("--maps")?;
        self.levels.check(&maps)?;
        match maps.first() {
            Some(SeedOrFile::File(_)) => {
                let files = files_only(maps).context("--maps")?;
                config.train_on_levels(copy_levels(&files, &self.levels, &self.folder)?);
            }
            Some(SeedOrFile::Seed(_)) => config.train_on(seeds_only(maps).context("--maps")?),
            None => {}
        }
        Ok(())
    }
}

/// Connects training to its worlds with these credentials.
pub fn connector(credentials: Credentials) -> Connect {
    Arc::new(move |uri| game::connect(uri, &credentials))
}

fn processor(name: String) -> Processor {
    if name == "cuda" { Processor::Cuda } else { Processor::Cpu }
}

/// Binds the address at which actors connect.
fn listen(address: SocketAddr, endpoint: &EndpointArgs, weights_every: f64) -> anyhow::Result<Listener> {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let endpoint = {
        let _inside = runtime.enter();
        Endpoint::open(address, endpoint.config()?)?
    };
    Ok(Listener { endpoint, runtime, weights_every: Duration::from_secs_f64(weights_every) })
}

/// Saves levels as maps in the folder of a run, and returns the files.
pub fn copy_levels(files: &[PathBuf], levels: &LevelArgs, run: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let folder = run.join("levels");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let copy = |(idx, file): (usize, &PathBuf)| {
        let map = levels.load(file)?;
        // Files of different folders may have one name.
        let to = folder.join(format!("{idx}-{}", file_name(file))).with_extension("sfmap");
        std::fs::write(&to, surefoot_levels::encode(&map)).with_context(|| format!("cannot write {}", to.display()))?;
        Ok(to)
    };
    files.iter().enumerate().map(copy).collect()
}

/// Sets `stop` on the first Ctrl-C or SIGTERM.
pub fn stop_on_signal(stop: Arc<AtomicBool>) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let signal = {
        let _inside = runtime.enter();
        surefoot_cli::signals::shutdown_signal()
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        runtime.block_on(signal);
        stop.store(true, Ordering::Relaxed);
    })?;
    Ok(())
}
