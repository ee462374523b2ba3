//! Configuration of a training run.

use super::error::TrainError;
use super::replay::Sampling;
use burn::tensor::Device;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use surefoot_levels::FileError;
use surefoot_policy::ActorConfig;
use surefoot_world::map::{Features, MapKind, MoverDensities};
use surefoot_world::{CharacterProfile, Map, MapSpec, RawMapSpec, SpecError, navigable};

/// Name of the configuration file in a run's folder.
pub(super) const CONFIG_FILE: &str = "config.json";

/// Most NPCs of an environment.
const MAX_NPCS: usize = 4096;
/// Most actors of a run.
const MAX_ACTORS: usize = 1024;

/// Processor that the learner computes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Processor {
    /// The CPU.
    #[default]
    Cpu,
    /// The first CUDA device; only in builds with the feature `cuda`.
    Cuda,
}

impl Processor {
    /// The device of this processor.
    ///
    /// # Errors
    /// If this program was built without support for it.
    pub fn device(self) -> Result<Device, TrainError> {
        match self {
            Processor::Cpu => Ok(Device::flex()),
            #[cfg(feature = "cuda")]
            Processor::Cuda => Ok(Device::cuda(0)),
            #[cfg(not(feature = "cuda"))]
            Processor::Cuda => Err(TrainError::Config {
                field: "processor",
                problem: "is cuda, but this program was built without it: build with `--features cuda`",
            }),
        }
    }
}

/// Everything that determines a run; saved as `config.json` beside its results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// Name of the model.
    pub name: String,
    /// Seed of weights, noise, batches, maps and goals.
    pub seed: u64,
    /// Processor that the learner computes on; the collector always uses the CPU.
    #[serde(default)]
    pub processor: Processor,
    /// Number of updates after which the run ends.
    pub total_updates: u64,
    /// Number of decisions of every NPC per round.
    pub steps_per_round: usize,
    /// Number of updates per round.
    pub updates_per_round: usize,
    /// Number of sequences per batch; a reactive agent's are single transitions.
    pub batch: usize,
    /// Burn-in steps of each sequence, which only warm up the LSTM; 0 for a reactive agent.
    #[serde(default)]
    pub burn_in: usize,
    /// Steps of each sequence to learn from; 1 for a reactive agent.
    #[serde(default = "one")]
    pub learn: usize,
    /// Number of rewards summed before bootstrapping.
    pub n_step: usize,
    /// Discount per decision.
    pub discount: f32,
    /// Whether to mirror half of the sequences left to right.
    pub mirror: bool,
    /// Capacity of the replay buffer in rows.
    pub replay_capacity: usize,
    /// Rounds between validations.
    pub validate_every: u64,
    /// Rounds between full checkpoints.
    pub checkpoint_every: u64,
    /// Number of goals per validation map in each of two bands: up to 25 m, and 25 to 60 m.
    pub validation_goals: usize,
    /// Seeds of the validation maps.
    pub validation_seeds: Vec<u64>,
    /// Updates without a better validation after which the run ends early; `None` for never, written as 0 in files.
    #[serde(default, with = "zero_is_none")]
    pub stop_after: Option<NonZeroU64>,
    /// Folder of a run or model to start from, with `weights.bpk` and `critics.bpk`. A recurrent agent may start from a
    /// reactive one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_from: Option<PathBuf>,
    /// Configuration of the learner.
    pub sac: SacConfig,
    /// Configuration of the collector.
    pub collector: CollectorConfig,
    /// Addresses of servers or games whose worlds run the NPCs; empty: this process runs them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub worlds: Vec<String>,
    /// Environments in each of `worlds`, with `collector.npcs_per_world` NPCs each. While one moves, another decides.
    #[serde(default = "two")]
    pub envs_per_world: usize,
    /// Number of actors that feed the run, each with `collector.world_count` times `collector.npcs_per_world` NPCs; 0:
    /// this process collects.
    #[serde(default)]
    pub actors: usize,
    /// Greatest age of the weights that chose an action, in updates. Older decisions are not learned from. Only used
    /// with `worlds` or `actors`.
    #[serde(default = "usual_staleness")]
    pub max_staleness: u64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            name: "general-reactive".to_owned(),
            seed: 1,
            processor: Processor::Cpu,
            total_updates: 120_000,
            steps_per_round: 8,
            updates_per_round: 16,
            batch: 256,
            burn_in: 0,
            learn: 1,
            n_step: 3,
            discount: 0.98,
            mirror: true,
            replay_capacity: 1_000_000,
            validate_every: 400,
            checkpoint_every: 500,
            validation_goals: 100,
            validation_seeds: vec![1000, 1001, 1002, 1003],
            stop_after: NonZeroU64::new(24_000),
            start_from: None,
            sac: SacConfig::default(),
            collector: CollectorConfig::default(),
            worlds: Vec::new(),
            envs_per_world: two(),
            actors: 0,
            max_staleness: usual_staleness(),
        }
    }
}

fn terrain_only() -> Vec<MapKind> {
    vec![MapKind::Terrain]
}

fn usual_height() -> u32 {
    RawMapSpec::new(0).size.height
}

fn one() -> usize {
    1
}

fn two() -> usize {
    2
}

fn usual_staleness() -> u64 {
    2_000
}

impl TrainConfig {
    /// The defaults of the recurrent agent: 20 decisions of burn-in as in the paper, and 20 to learn from.
    pub fn recurrent() -> Self {
        let network = ActorConfig { memory: NonZeroUsize::new(64), ..ActorConfig::default() };
        Self {
            name: "general-lstm".to_owned(),
            batch: 32,
            burn_in: 20,
            learn: 20,
            updates_per_round: 4,
            sac: SacConfig { network, ..SacConfig::default() },
            ..Self::default()
        }
    }

    /// Sets the saved maps to train and validate on.
    pub fn train_on_levels(&mut self, levels: Vec<PathBuf>) {
        let seeds: Vec<u64> = (0..levels.len() as u64).collect();
        self.train_on(seeds.clone());
        self.collector.levels = levels;
        self.validation_seeds = seeds;
    }

    /// Sets the training maps. With a single map, collecting and validation both use it, for a map-specific policy.
    pub fn train_on(&mut self, map_seeds: Vec<u64>) {
        if map_seeds.len() == 1 {
            self.collector.npcs_per_world *= self.collector.world_count;
            self.collector.world_count = 1;
            self.collector.rounds_per_map = u64::MAX;
            self.validation_seeds.clone_from(&map_seeds);
            self.validation_goals *= 4;
        }
        self.collector.map_seeds = map_seeds;
    }

    /// Checks the configuration.
    ///
    /// # Errors
    /// Names the invalid field.
    pub fn validate(&self) -> Result<(), TrainError> {
        let refuse = |field: &'static str, problem: &'static str| Err(TrainError::Config { field, problem });
        let is_recurrent = self.sac.network.memory.is_some();
        if !is_recurrent && (self.burn_in, self.learn) != (0, 1) {
            return refuse("burn_in and learn", "a reactive agent (memory 0) learns from single steps: 0 and 1");
        }
        if is_recurrent && self.learn < 2 {
            return refuse("learn", "a recurrent agent (memory above 0) needs sequences of 2 steps or more");
        }
        for (field, value) in [
            ("batch", self.batch),
            ("n_step", self.n_step),
            ("steps_per_round", self.steps_per_round),
            ("sac.network.hidden", self.sac.network.hidden),
            ("sac.network.ray_features", self.sac.network.ray_features),
            ("collector.world_count", self.collector.world_count),
            ("collector.npcs_per_world", self.collector.npcs_per_world),
            ("envs_per_world", self.envs_per_world),
        ] {
            if value == 0 {
                return refuse(field, "must be at least 1");
            }
        }
        if self.collector.map_seeds.is_empty() {
            return refuse("collector.map_seeds", "is empty");
        }
        if self.collector.map_kinds.is_empty() {
            return refuse("collector.map_kinds", "is empty");
        }
        for (field, share) in [
            ("collector.random_bodies", self.collector.random_bodies),
            ("collector.reachable_share", self.collector.reachable_share),
        ] {
            if !(0.0..=1.0).contains(&share) {
                return refuse(field, "must be 0 to 1");
            }
        }
        self.check_worlds()?;
        self.check_maps()
    }

    /// Checks the limits of NPCs in other processes.
    fn check_worlds(&self) -> Result<(), TrainError> {
        let refuse = |field, problem| Err(TrainError::Config { field, problem });
        let level_count = self.collector.levels.len();
        if self.is_here() {
            return Ok(());
        }
        if self.actors > 0 && !self.worlds.is_empty() {
            return refuse("actors and worlds", "cannot both feed a run: set one of them");
        }
        if self.sac.network.sees_others || self.collector.solid_npcs {
            return refuse(
                "sac.network.sees_others and collector.solid_npcs",
                "NPCs in other processes do not collide: set both to false",
            );
        }
        if self.actors == 0 && level_count > 1 && level_count != self.worlds.len() {
            return refuse("collector.levels", "name one level for all worlds, or one for each");
        }
        if self.collector.npcs_per_world > MAX_NPCS {
            return refuse("collector.npcs_per_world", "must be at most 4096 in other processes");
        }
        if self.actors > MAX_ACTORS {
            return refuse("actors", "must be at most 1024");
        }
        Ok(())
    }

    /// Checks that maps can be loaded and have room for the body.
    fn check_maps(&self) -> Result<(), TrainError> {
        let CollectorConfig { levels, body, .. } = &self.collector;
        self.collector.spec(0).map_err(|_| map_refusal())?;
        // Generated maps have ground for the default body; for other bodies one map is tried.
        let tried_count =
            if levels.is_empty() { usize::from(*body != CharacterProfile::default()) } else { levels.len() };
        for seed in 0..tried_count as u64 {
            let (map, mut rng) = (self.collector.map(seed)?, ChaCha8Rng::seed_from_u64(seed));
            if navigable::sample_many(&map, body, 1, &mut rng).is_err() {
                let problem = "does not fit anywhere on one of the maps";
                return Err(TrainError::Config { field: "collector.body", problem });
            }
        }
        Ok(())
    }

    /// Whether NPCs collect experience in this process.
    pub fn is_here(&self) -> bool {
        self.worlds.is_empty() && self.actors == 0
    }

    /// How batches are drawn.
    pub fn sampling(&self) -> Sampling {
        Sampling {
            batch: self.batch,
            burn_in: self.burn_in,
            learn: self.learn,
            n_step: self.n_step,
            discount: self.discount,
            mirror: self.mirror,
        }
    }
}

/// Configuration of the learner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SacConfig {
    /// Layer sizes of actor and critics.
    pub network: ActorConfig,
    /// Adam's step size for all networks and the temperature.
    pub learning_rate: f64,
    /// Share by which the target critics move towards the critics at each update.
    pub tau: f32,
    /// Entropy of the policy that the temperature is tuned to, in nats.
    pub target_entropy: f32,
    /// Temperature at the start; see docs/adr/0009-low-initial-temperature.md.
    pub initial_alpha: f32,
    /// Lower bound of the temperature.
    pub min_alpha: f32,
    /// Number of critic updates per update of actor and temperature.
    pub actor_interval: u64,
    /// Number of updates over which the step size falls linearly to a tenth; `None` for a constant one, written as 0 in
    /// files.
    #[serde(default, with = "zero_is_none")]
    pub decay_updates: Option<NonZeroU64>,
}

impl Default for SacConfig {
    fn default() -> Self {
        Self {
            network: ActorConfig::default(),
            learning_rate: 3.0e-4,
            tau: 0.005,
            target_entropy: -2.0,
            initial_alpha: 0.004,
            min_alpha: 1.0e-4,
            actor_interval: 2,
            decay_updates: NonZeroU64::new(120_000),
        }
    }
}

/// Configuration of the collector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CollectorConfig {
    /// Seeds of the training maps; consecutive seeds are written as a range.
    #[serde(with = "seed_range")]
    pub map_seeds: Vec<u64>,
    /// Saved maps to train on instead of generated ones; a map's seed modulo their number chooses one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub levels: Vec<PathBuf>,
    /// Side of the training maps, m.
    pub map_side: u32,
    /// Height of the training maps, m.
    #[serde(default = "usual_height")]
    pub map_height: u32,
    /// Features of the training maps.
    #[serde(default)]
    pub map_features: Features,
    /// Movers of the training maps.
    #[serde(default)]
    pub map_movers: MoverDensities,
    /// Kinds of the training maps; a map's seed modulo their number chooses one.
    #[serde(default = "terrain_only")]
    pub map_kinds: Vec<MapKind>,
    /// Whether the NPCs of a map collide.
    #[serde(default)]
    pub solid_npcs: bool,
    /// Body of the NPCs, in validation as well.
    #[serde(default)]
    pub body: CharacterProfile,
    /// Share of the maps whose NPCs have a random body instead.
    #[serde(default)]
    pub random_bodies: f64,
    /// Share of goals that are drawn from places that the survey finds reachable for the NPC. The rest are drawn from
    /// all places.
    #[serde(default)]
    pub reachable_share: f64,
    /// Number of maps in use at a time.
    pub world_count: usize,
    /// Number of NPCs on each map.
    pub npcs_per_world: usize,
    /// Rounds after which the oldest map is replaced by another.
    pub rounds_per_map: u64,
    /// Share of goals drawn from `near_goals`; the rest is drawn from `far_goals`.
    pub near_share: f64,
    /// Range of distances of near goals, m.
    pub near_goals: (f32, f32),
    /// Range of distances of far goals, m.
    pub far_goals: (f32, f32),
    /// Probability that an NPC continues from its goal to another one without respawning, as when following waypoints.
    pub switch_chance: f64,
    /// Share of spawns that retry a failed attempt on the same map, if there is one.
    #[serde(default)]
    pub retry_share: f64,
    /// Probability per decision that an NPC gets a new goal before it reaches its goal, as after a re-plan.
    #[serde(default)]
    pub redirect_chance: f64,
    /// Decisions without progress after which an attempt is cut off (truncated).
    pub give_up_after: u32,
    /// Number of random decisions at the start of the run.
    pub random_decisions: u64,
}

impl Default for CollectorConfig {
    fn default() -> Self {
        Self {
            map_seeds: (0..128).collect(),
            levels: Vec::new(),
            map_side: 250,
            map_height: usual_height(),
            map_features: Features::default(),
            map_movers: MoverDensities::default(),
            map_kinds: terrain_only(),
            solid_npcs: false,
            body: CharacterProfile::default(),
            random_bodies: 0.0,
            reachable_share: 0.0,
            world_count: 8,
            npcs_per_world: 32,
            rounds_per_map: 120,
            near_share: 0.85,
            near_goals: (2.0, 40.0),
            far_goals: (40.0, 120.0),
            switch_chance: 0.6,
            retry_share: 0.3,
            redirect_chance: 0.003,
            give_up_after: 200,
            random_decisions: 20_000,
        }
    }
}

impl CollectorConfig {
    /// The training map of a seed.
    ///
    /// # Errors
    /// If its spec is out of range, or its file cannot be read or used.
    pub(super) fn map(&self, seed: u64) -> Result<Map, TrainError> {
        if self.levels.is_empty() {
            return self.spec(seed).map(|spec| surefoot_generate::generate(&spec)).map_err(|_| map_refusal());
        }
        let path = &self.levels[(seed % self.levels.len() as u64) as usize];
        let bytes = std::fs::read(path).map_err(|source| TrainError::Io { path: path.clone(), source })?;
        let damaged = |error: FileError| TrainError::Damaged { path: path.clone(), reason: error.to_string() };
        surefoot_levels::decode(&bytes).map_err(damaged)
    }

    /// The spec of the generated training map of a seed.
    ///
    /// # Errors
    /// If the side, the height or the features are out of range.
    pub fn spec(&self, seed: u64) -> Result<MapSpec, SpecError> {
        MapSpec::with_side(seed, self.map_side)?.with(|spec| {
            spec.size.height = self.map_height;
            spec.features = self.map_features;
            spec.movers = self.map_movers;
            spec.kind = self.map_kinds[(seed % self.map_kinds.len() as u64) as usize];
        })
    }
}

fn map_refusal() -> TrainError {
    let problem = "make no valid map: see `surefoot map generate --help`";
    TrainError::Config { field: "collector.map_side, map_height and map_features", problem }
}

/// Serializes consecutive seeds as a range.
mod seed_range {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::ops::Range;

    /// Most seeds of a range.
    const MAX_SEEDS: u64 = 1 << 20;

    #[derive(Serialize, Deserialize)]
    #[serde(untagged)]
    enum Seeds {
        Range(Range<u64>),
        List(Vec<u64>),
    }

    pub fn serialize<S: Serializer>(seeds: &[u64], serializer: S) -> Result<S::Ok, S::Error> {
        let are_range = seeds.len() > 1 && seeds.windows(2).all(|pair| pair[0].checked_add(1) == Some(pair[1]));
        let end = seeds.last().and_then(|last| last.checked_add(1)).filter(|_| are_range);
        let seeds = end.map_or_else(|| Seeds::List(seeds.to_vec()), |end| Seeds::Range(seeds[0]..end));
        seeds.serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u64>, D::Error> {
        match Seeds::deserialize(deserializer)? {
            Seeds::List(seeds) => Ok(seeds),
            Seeds::Range(range) if range.end.saturating_sub(range.start) > MAX_SEEDS => {
                Err(D::Error::custom(format!("the range of seeds has more than {MAX_SEEDS}")))
            }
            Seeds::Range(range) => Ok(range.collect()),
        }
    }
}

/// Serializes `None` as 0.
mod zero_is_none {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::num::NonZeroU64;

    pub fn serialize<S: Serializer>(count: &Option<NonZeroU64>, serializer: S) -> Result<S::Ok, S::Error> {
        count.map_or(0, NonZeroU64::get).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<NonZeroU64>, D::Error> {
        Ok(NonZeroU64::new(u64::deserialize(deserializer)?))
    }
}
