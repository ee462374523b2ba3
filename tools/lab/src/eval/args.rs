//! Arguments of `surefoot eval`, and the configuration that they stand for.

use anyhow::{Context, bail};
use clap::ValueEnum;
use clap::builder::PossibleValuesParser;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_cli::commands::core_count;
use surefoot_cli::commands::fleet::{BlobsArg, NatsArg};
use surefoot_cli::commands::game::WorldArgs;
use surefoot_cli::commands::map::{
    BodyArg, Generated, LevelArgs, SeedOrFile, name_among, parse_maps_or_splits, parse_seeds, seeds_only, spec,
};
use surefoot_cli::commands::services::{GraphArgs, StyleArg};
use surefoot_eval::{EvalConfig, EvalMap, GoalArea, Method, Price, Shard, living};
use surefoot_planner::export::import_json;
use surefoot_planner::{Attach, BuildSettings, NavGraph, SettingError};
use surefoot_policy::Policy;
use surefoot_rollout::{DEFAULT_NOISE_SHARE, FollowConfig};
use surefoot_world::{Arrival, GAITS, MapSpec, NamedGait};

/// Subfolder of `--out` for finished units.
const UNITS: &str = "units";

/// Measure success on maps by the paper's protocol: random goals, thirds by distance, 300 decisions of patience.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot eval --maps validation --goals 200 --placement flood\n  \
        surefoot eval --maps validation --goals 500 --method policy --distance 2..25 --json\n  \
        surefoot eval --maps test --goals 2500 --seed 0..3 --vertices 800 --neighbours 20\n  \
        surefoot eval --maps level.glb,other.obj --json\n  \
        surefoot eval --maps '../levels/*.glb' --scale 0.01\n  \
        surefoot eval --maps validation --kind islands --features all\n  \
        surefoot eval --maps validation --gait careful --json\n  \
        surefoot eval --maps level.glb --world http://127.0.0.1:7700 --graph level.json\n  \
        surefoot eval --maps level.obj --world tcp://127.0.0.1:7701\n  \
        surefoot eval --suite paper --goals 2500 --seed 0..3 --out runs/paper\n  \
        surefoot eval --suite sweep --goals 500 --out runs/sweep\n  \
        surefoot eval --suite big-map --goals 10000 --out runs/big-map\n  \
        surefoot eval --suite living --runs 10\n  \
        surefoot eval --suite kinds --goals 150 --out runs/kinds\n  \
        surefoot eval --suite kinds --out kinds --shard 0/8\n  \
        surefoot eval --check docs/results/kinds\n  \
        surefoot eval --check docs/results/benchmark-plan --maps 5002..5064")]
pub struct Args {
    /// Run a whole table instead of one evaluation
    #[arg(long, conflicts_with_all = ["method", "distance"])]
    pub(super) suite: Option<Suite>,
    /// Folder with the models of the suite
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    pub(super) models: PathBuf,
    /// Write figures, table, plots, every attempt and their provenance into this folder. Finished maps and seeds are
    /// saved in it, and a later run reuses them
    #[arg(long, value_name = "FOLDER")]
    pub(super) out: Option<PathBuf>,
    /// Run only the maps and seeds of part I of N and save them in the folder of --out. A run without --shard then uses
    /// those of all parts. Parts may run on any machine, in any order, and more than once
    #[arg(long, value_name = "I/N", value_parser = parse_shard, conflicts_with = "check")]
    pub(super) shard: Option<Shard>,
    /// Check a folder that --out wrote: derive the figures again from its attempts, and repeat a share of the attempts.
    /// With --maps, only print the figures of these maps
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["suite", "out", "method"])]
    pub(super) check: Option<PathBuf>,
    /// Share of the attempts that --check repeats, 0 to 1
    #[arg(long, default_value_t = 0.02, value_name = "SHARE", requires = "check")]
    pub(super) share: f64,
    /// Seed for the choice of the attempts that --check repeats
    #[arg(long, default_value_t = 0, value_name = "SEED", requires = "check")]
    pub(super) check_seed: u64,
    /// Maps to evaluate on: training, validation, test, benchmark, seeds such as 7 or 1000,1001 or 0..4, files
    /// (.sfmap, .glb, .gltf, .obj), or patterns such as levels/*.glb [default: validation; test for --suite paper,
    /// benchmark for seeds, its first 16 for dial, its first 8 for kinds]
    #[arg(long, value_name = "SEEDS|FILE,...", num_args = 1..)]
    pub(super) maps: Vec<String>,
    /// Draw starts and goals on all ground of levels, also on roofs and in closed rooms. By default they come from the
    /// playable area: ground that the body can leave and come back to, around the level's spawn points or the largest.
    /// On generated maps they come from everywhere
    #[arg(long)]
    pub(super) anywhere: bool,
    #[command(flatten)]
    pub(super) generated: Generated,
    #[command(flatten)]
    pub(super) levels: LevelArgs,
    #[command(flatten)]
    pub(super) body: BodyArg,
    /// Goals per map and seed
    #[arg(long, default_value_t = 200, value_name = "N")]
    pub(super) goals: usize,
    /// How NPCs approach goals
    #[arg(long, default_value = "graph")]
    pub(super) method: Approach,
    #[command(flatten)]
    pub(super) graph: GraphArgs,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    pub(super) model: Option<PathBuf>,
    /// Straight-line distance to goals in metres; default: any
    #[arg(long, value_name = "MIN..MAX")]
    pub(super) distance: Option<String>,
    /// Seeds of goals, graphs and noise, such as 0 or 0..3; each seed runs a whole evaluation
    #[arg(long, default_value = "0", value_name = "SEED")]
    pub(super) seed: String,
    #[command(flatten)]
    pub(super) rules: Rules,
    /// Share of the policy's exploration noise to add to actions, 0 to 1
    #[arg(long, default_value_t = DEFAULT_NOISE_SHARE, value_name = "SHARE")]
    pub(super) noise: f32,
    /// Let NPCs follow their plans without rehearsing the next legs, as in the suites paper and sweep
    #[arg(long)]
    pub(super) no_rehearsals: bool,
    /// Runs of each scene of the suite living, each with another seed
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub(super) runs: u64,
    /// Scene of the suite living, instead of all; may be repeated
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(living::SCENES))]
    pub(super) scene: Vec<String>,
    #[command(flatten)]
    pub(super) style: StyleArg,
    /// Number of threads; default: one per core
    #[arg(long, value_name = "N")]
    pub(super) threads: Option<usize>,
    /// Follow plans on this graph, which `surefoot graph export --format json` wrote, instead of building one
    #[arg(long = "graph", value_name = "FILE", conflicts_with_all = ["suite", "out", "check"])]
    pub(super) graph_file: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) world: WorldArgs,
    #[command(flatten)]
    pub(super) nats: NatsArg,
    #[command(flatten)]
    pub(super) blobs: BlobsArg,
}

/// A table of several evaluations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Suite {
    /// The rows of the paper's table for which --models has weights, with the body paper
    Paper,
    /// What each of our choices adds to the paper's method, and to our other choices
    Ablation,
    /// Graphs of growing size on the validation maps, with the body paper
    Sweep,
    /// The 1 km map with and without graphs
    BigMap,
    /// Crowds, doors, lifts, platforms, floors that vanish, players, and chases
    Living,
    /// The models in the folder seeds of --models, which differ in their training seed, on the benchmark maps
    Seeds,
    /// Maps with fewer and more devices, with and without repair
    Dial,
    /// All kinds of maps, features, heights and bodies
    Kinds,
}

/// How NPCs approach goals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Approach {
    /// Head straight for the goal
    Policy,
    /// Follow plans on a graph
    Graph,
}

/// The vertices that start and goal are joined to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Joined {
    /// To several near vertices
    Several,
    /// To the nearest vertex
    Nearest,
}

/// What edges cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Cost {
    /// Decisions, and the price of the risks of failing and of dying
    Risk,
    /// The mean number of decisions
    Steps,
}

/// What counts as having arrived at a goal.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Arrive {
    /// Standing within 1 m of it where the body could walk straight to it, as in worlds of a server
    Stand,
    /// Being within 1 m of it, in the air or behind a wall as well; always so for the suites paper and sweep
    Paper,
}

/// Rules of attempts in which the paper differs from ours.
#[derive(clap::Args)]
pub(super) struct Rules {
    /// Follow the paper. Start and goal snap to the nearest vertex, edges cost their steps, failed legs are not
    /// remembered, and re-plans have no limit. Nothing is rehearsed or composed, NPCs do not sense zip lines and
    /// teleporters, devices get no vertices or candidates, and all probes are run. NPCs arrive as with --arrive paper.
    /// The default model is general-lstm, and the default body paper. --patience and --replan-after still apply
    #[arg(long, conflicts_with_all = ["attach", "price", "forget", "max_replans", "arrive", "gait", "no_transports"])]
    pub(super) faithful: bool,
    /// Decisions without progress that end an attempt
    #[arg(
        long,
        default_value_t = FollowConfig::default().patience,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    patience: u32,
    /// Decisions without coming closer to a waypoint that cause a re-plan
    #[arg(
        long,
        default_value_t = FollowConfig::default().replan_after,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    replan_after: u32,
    /// Most re-plans of an attempt
    #[arg(long, default_value_t = FollowConfig::default().max_replans, value_name = "N")]
    max_replans: u32,
    /// How start and goal are joined to the graph
    #[arg(long, default_value = "several")]
    attach: Joined,
    /// What edges cost in plans
    #[arg(long, default_value = "risk")]
    price: Cost,
    /// Let plans use legs again that failed earlier in the same attempt
    #[arg(long)]
    forget: bool,
    /// What counts as having arrived at a goal
    #[arg(long, default_value = "paper")]
    arrive: Arrive,
    /// How NPCs that follow plans go where they can walk
    #[arg(long, default_value = "run", value_name = "NAME", value_parser = gait_names())]
    gait: String,
    /// Hide zip lines and teleporters from the NPCs' observations
    #[arg(long)]
    no_transports: bool,
}

impl Rules {
    fn follow(&self, composes: bool, is_of_paper: bool) -> FollowConfig {
        let limits =
            FollowConfig { patience: self.patience, replan_after: self.replan_after, ..FollowConfig::of_paper() };
        if self.faithful {
            return limits;
        }
        let attach = if self.attach == Joined::Nearest { Attach::Nearest } else { Attach::Several };
        let touches = is_of_paper || self.arrive == Arrive::Paper;
        let arrival = if touches { Arrival::Touch } else { Arrival::Stand };
        let gait = NamedGait::find(&self.gait).expect("one of these names was parsed").gait;
        let (max_replans, remembers) = (self.max_replans, !self.forget);
        FollowConfig { max_replans, remembers, attach, composes, arrival, gait, ..limits }
    }

    fn price(&self) -> Price {
        if self.faithful || self.price == Cost::Steps { Price::Steps } else { Price::Risk }
    }

    /// The policy as these rules let it sense.
    pub(super) fn apply(&self, policy: Policy) -> Policy {
        if self.faithful || self.no_transports { policy.without_transports() } else { policy }
    }

    pub(super) fn graph(&self, settings: BuildSettings) -> Result<BuildSettings, SettingError> {
        if !self.faithful {
            return Ok(settings);
        }
        let paper = BuildSettings::of_paper(settings.placement);
        settings.with(|it| {
            (it.probing, it.special_moves, it.threshold) = (paper.probing, paper.special_moves, paper.threshold);
            it.arrival = paper.arrival;
        })
    }
}

impl Args {
    /// The maps of `--maps`, or `usual`.
    fn listed(&self, usual: &str) -> anyhow::Result<Vec<SeedOrFile>> {
        if self.maps.is_empty() { parse_maps_or_splits(&[usual]) } else { parse_maps_or_splits(&self.maps) }
    }

    /// The specs of the maps of `--maps`, or of `usual`, for suites of generated maps.
    pub(super) fn specs(&self, usual: &str) -> anyhow::Result<Vec<MapSpec>> {
        let seeds = seeds_only(self.listed(usual)?).context("this suite runs on generated maps")?;
        seeds.into_iter().map(|seed| spec(seed, self.generated.size)).collect()
    }

    /// Generated maps by seed, and levels by file.
    fn maps(&self) -> anyhow::Result<Vec<EvalMap>> {
        let maps = self.listed("validation")?;
        self.levels.check(&maps)?;
        let map = |choice: &SeedOrFile| match choice {
            SeedOrFile::Seed(seed) => Ok(EvalMap::from(self.generated.apply(&spec(*seed, self.generated.size)?)?)),
            SeedOrFile::File(file) => {
                let goals = if self.anywhere { GoalArea::Anywhere } else { GoalArea::Playable };
                Ok(EvalMap::Level { name: name_among(file, &maps), map: Arc::new(self.levels.load(file)?), goals })
            }
        };
        maps.iter().map(map).collect()
    }

    pub(super) fn config(&self) -> anyhow::Result<EvalConfig> {
        self.check_ranges()?;
        let (game, graph) = (self.world.connect()?, self.graph_file.as_deref().map(read_graph).transpose()?);
        self.check_combinations(game.is_some())?;
        let settings = self.rules.graph(self.graph.settings()?)?;
        let method = if self.method == Approach::Policy { Method::Policy } else { Method::Graph(settings) };
        let is_of_paper = self.rules.faithful || matches!(self.suite, Some(Suite::Paper | Suite::Sweep));
        Ok(EvalConfig {
            maps: self.maps()?,
            goals: self.goals,
            seeds: parse_seeds(&self.seed).context("--seed")?,
            profile: if is_of_paper { self.body.or_paper().profile()? } else { self.body.profile()? },
            method,
            distance: self.distance.as_deref().map_or(Ok(1.0..f32::INFINITY), parse_distance)?,
            noise_share: self.noise,
            rehearses: !self.no_rehearsals && !is_of_paper,
            follow: self.rules.follow(self.style.composes(), is_of_paper),
            price: self.rules.price(),
            game,
            graph,
            keep_in: self.out.as_ref().map(|folder| folder.join(UNITS)),
            shard: self.shard,
            record: None,
            thread_count: self.threads.unwrap_or_else(core_count),
        })
    }

    fn check_ranges(&self) -> anyhow::Result<()> {
        if !(1..=100_000).contains(&self.goals) {
            bail!("--goals is {}, allowed are 1 to 100000", self.goals);
        }
        if !(0.0..=1.0).contains(&self.noise) {
            bail!("--noise is {}, allowed are 0 to 1", self.noise);
        }
        Ok(())
    }

    fn check_combinations(&self, has_game: bool) -> anyhow::Result<()> {
        if has_game && (self.suite.is_some() || self.out.is_some()) {
            bail!("--world cannot be combined with --suite or --out: attempts in a game are not recorded");
        }
        if self.shard.is_some() && self.out.is_none() {
            bail!("--shard needs --out: the folder that collects the units of all shards");
        }
        self.nats.check()?;
        let is_whole = self.suite.is_none() && self.shard.is_none() && !has_game && self.graph_file.is_none();
        if self.nats.nats.is_some() && !is_whole {
            bail!(
                "--nats cannot be combined with --suite, --shard, --world or --graph: \
                 provers run evaluations of one model on graphs that they build"
            );
        }
        if self.graph_file.is_some() && self.method == Approach::Policy {
            bail!("--graph has no effect with --method policy");
        }
        Ok(())
    }
}

fn gait_names() -> PossibleValuesParser {
    PossibleValuesParser::new(GAITS.map(|gait| gait.name))
}

fn read_graph(path: &Path) -> anyhow::Result<Arc<NavGraph>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(Arc::new(import_json(&text).with_context(|| format!("{} is not a graph", path.display()))?))
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(idx, count)| Some((idx.parse().ok()?, count.parse().ok()?)));
    match numbers {
        Some((idx, count)) if idx < count => Ok(Shard { idx, count }),
        _ => Err("expected I/N with I from 0 to N - 1, such as 0/4".to_owned()),
    }
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
