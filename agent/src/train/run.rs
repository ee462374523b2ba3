//! A training run: rounds, log, validation, checkpoints, resumption.

use super::collector::{Collector, CollectorConfig, CollectorState};
use super::replay::{Batch, Replay, Sampling, Step};
use super::sac::{Learner, LearnerState, SacConfig, UpdateStats};
use super::tensorboard::EventWriter;
use crate::rollout::{DEFAULT_NOISE_SHARE, Goal, Rollout};
use burn::tensor::Device;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use surefoot_policy::checkpoint::{self, module_bytes, write_whole};
use surefoot_policy::{Actor, ActorConfig, CheckpointError, Manifest, Policy};
use surefoot_world::{CharacterProfile, End, Map, TaskConfig, navigable};

/// What a learner computes on.
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
    fn device(self) -> Result<Device, TrainError> {
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

/// Everything that decides a run; written to `config.json` beside its results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// Name of the model.
    pub name: String,
    /// Seed of weights, noise, batches, maps and goals.
    pub seed: u64,
    /// What the learner computes on; collecting always takes the CPU.
    #[serde(default)]
    pub processor: Processor,
    /// Updates after which the run is complete.
    pub total_updates: u64,
    /// Decisions of every NPC per round.
    pub steps_per_round: usize,
    /// Updates per round.
    pub updates_per_round: usize,
    /// Sequences per batch; for a reactive agent each is one transition.
    pub batch: usize,
    /// Steps of each sequence that only warm up memories; 0 for a reactive agent.
    #[serde(default)]
    pub burn_in: usize,
    /// Steps of each sequence that are learned from; 1 for a reactive agent.
    #[serde(default = "one")]
    pub learn: usize,
    /// Rewards summed before bootstrapping.
    pub n_step: usize,
    /// Discount per decision.
    pub discount: f32,
    /// Reflect half of the sequences left to right.
    pub mirror: bool,
    /// Rows kept in the replay buffer.
    pub replay_capacity: usize,
    /// Rounds between validations.
    pub validate_every: u64,
    /// Rounds between full checkpoints.
    pub checkpoint_every: u64,
    /// Goals per validation map, up to 25 m away and again beyond.
    pub validation_goals: usize,
    /// Seeds of the validation maps.
    pub validation_seeds: Vec<u64>,
    /// Updates without a better validation after which the run ends early; 0 for never.
    #[serde(default)]
    pub stop_after: u64,
    /// Folder of a run or model to start from: `weights.bpk` and `critics.bpk`. A reactive one may start a recurrent one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_from: Option<PathBuf>,
    /// The learner.
    pub sac: SacConfig,
    /// The collector.
    pub collector: CollectorConfig,
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
            checkpoint_every: 1500,
            validation_goals: 100,
            validation_seeds: vec![1000, 1001, 1002, 1003],
            stop_after: 24_000,
            start_from: None,
            sac: SacConfig::default(),
            collector: CollectorConfig::default(),
        }
    }
}

fn one() -> usize {
    1
}

impl TrainConfig {
    /// The defaults of the recurrent agent: burn-in of 20 decisions as in the paper, and 20 to learn from.
    pub fn recurrent() -> Self {
        let network = ActorConfig { memory: 64, ..ActorConfig::default() };
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

    /// Trains on these maps. For a single map, all collecting happens on it and validation too: a map-specific policy.
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

    /// Whether the parts fit each other.
    ///
    /// # Errors
    /// Names the field that does not.
    pub fn validate(&self) -> Result<(), TrainError> {
        let refuse = |field: &'static str, problem: &'static str| Err(TrainError::Config { field, problem });
        let is_recurrent = self.sac.network.memory > 0;
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
        ] {
            if value == 0 {
                return refuse(field, "must be at least 1");
            }
        }
        if self.collector.map_seeds.is_empty() {
            return refuse("collector.map_seeds", "is empty");
        }
        if self.collector.spec(0).validate().is_err() {
            return refuse(
                "collector.map_side and map_features",
                "make no valid map: see `surefoot map generate --help`",
            );
        }
        Ok(())
    }

    fn sampling(&self) -> Sampling {
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

/// Why a run cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file of the run could not be read or written.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A checkpoint cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A configuration or state file is damaged.
    #[error("{path}: damaged: {reason}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The configuration contradicts itself.
    #[error("configuration: {field}: {problem}")]
    Config {
        /// What to change.
        field: &'static str,
        /// Why.
        problem: &'static str,
    },
    /// The folder already holds a run.
    #[error("{0} already holds a run: resume it, or choose another folder")]
    Exists(PathBuf),
}

/// A ChaCha generator's place in its stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RngState {
    seed: [u8; 32],
    stream: u64,
    word_pos: u128,
}

impl RngState {
    /// Where `rng` stands.
    pub fn of(rng: &ChaCha8Rng) -> Self {
        Self { seed: rng.get_seed(), stream: rng.get_stream(), word_pos: rng.get_word_pos() }
    }

    /// A generator that goes on from there.
    pub fn generator(&self) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::from_seed(self.seed);
        rng.set_stream(self.stream);
        rng.set_word_pos(self.word_pos);
        rng
    }
}

/// The state of a run between two rounds.
pub struct Run {
    config: TrainConfig,
    collector: Collector,
    learner: Learner,
    replay: Replay,
    rounds: u64,
    best: Best,
    hours: f64,
}

/// The best validation so far.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Best {
    score: f64,
    /// Updates when it was measured.
    updates: u64,
    /// Updates at the last validation.
    validated: u64,
}

#[derive(Serialize, Deserialize)]
struct RunState {
    collector: CollectorState,
    learner: LearnerState,
    replay: Replay,
    rounds: u64,
    best: Best,
    hours: f64,
}

/// Name of the critics' weights inside a model's folder.
pub const CRITICS_FILE: &str = "critics.bpk";
const CONFIG_FILE: &str = "config.json";
const STATE_FILE: &str = "state.bin";

impl Run {
    /// A run at its beginning.
    ///
    /// # Errors
    /// If the configuration contradicts itself, or the model to start from cannot be used.
    pub fn new(config: TrainConfig) -> Result<Self, TrainError> {
        config.validate()?;
        let stream = |number: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
            rng.set_stream(number);
            rng
        };
        let collector = Collector::new(config.collector.clone(), 2 * config.sac.network.memory, stream(10));
        let replay = Replay::new(collector.lane_count(), config.replay_capacity);
        let mut learner = Learner::on(config.processor.device()?, config.sac.clone(), stream(11));
        if let Some(folder) = &config.start_from {
            learner.start_from(folder)?;
        }
        let best = Best { score: -1.0, updates: 0, validated: 0 };
        Ok(Self { collector, learner, replay, rounds: 0, best, hours: 0.0, config })
    }

    /// The policy as it stands.
    pub fn policy(&self) -> Policy {
        let manifest = Manifest::new(&self.config.name, self.config.sac.network, &[], serde_json::Value::Null);
        Policy::new(self.learner.actor(), manifest)
    }

    /// The policy network as it stands.
    pub fn actor(&self) -> &Actor {
        self.learner.actor()
    }

    /// Updates made so far.
    pub fn updates(&self) -> u64 {
        self.learner.updates()
    }

    /// Whether validation has not improved for as long as the configuration allows.
    fn has_stalled(&self) -> bool {
        self.config.stop_after > 0 && self.best.validated > self.best.updates + self.config.stop_after
    }

    /// Decisions collected so far.
    pub fn decisions(&self) -> u64 {
        self.collector.total_decisions()
    }

    /// One round: the collector acts with the actor as of the last barrier, while the learner learns from
    /// what was stored before it. Both results are independent of how the two threads interleave.
    pub fn round(&mut self) -> Vec<UpdateStats> {
        let policy = self.policy();
        let Self { config, collector, learner, replay, .. } = self;
        let sampling = config.sampling();
        let warm = replay.len() >= 40 * (config.batch * config.learn).max(collector.lane_count())
            && replay.can_sample(sampling);
        let (steps, stats) = std::thread::scope(|scope| {
            let collecting = scope.spawn(|| {
                let mut steps: Vec<Step> = Vec::new();
                collector.round(&policy, config.steps_per_round, |step| steps.push(step));
                steps
            });
            let mut stats = Vec::new();
            let mut batch = Batch::default();
            for _ in 0..if warm { config.updates_per_round } else { 0 } {
                replay.sample(sampling, learner.rng(), &mut batch);
                stats.push(learner.update(&batch));
            }
            (collecting.join().expect("the collector does not panic"), stats)
        });
        for step in &steps {
            replay.push_step(step);
        }
        self.rounds += 1;
        stats
    }

    fn save(&self, folder: &Path) -> Result<(), TrainError> {
        // Borrowing twin of `RunState`, so that a gigabyte of replay is not copied.
        #[derive(Serialize)]
        struct Saved<'a> {
            collector: CollectorState,
            learner: LearnerState,
            replay: &'a Replay,
            rounds: u64,
            best: Best,
            hours: f64,
        }
        let state = Saved {
            collector: self.collector.save(),
            learner: self.learner.save()?,
            replay: &self.replay,
            rounds: self.rounds,
            best: self.best,
            hours: self.hours,
        };
        let mut bytes = postcard::to_stdvec(&state).expect("run state is plain data");
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        write_whole(&folder.join(STATE_FILE), &bytes)?;
        self.save_weights(&folder.join("last"), None)
    }

    fn save_weights(&self, folder: &Path, validation: Option<&Validation>) -> Result<(), TrainError> {
        let weights = module_bytes(self.actor())?;
        let training = serde_json::json!({
            "config": self.config,
            "updates": self.updates(),
            "decisions": self.collector.total_decisions(),
            "hours": self.hours,
            "validation": validation,
        });
        let manifest = Manifest::new(&self.config.name, self.config.sac.network, &weights, training);
        checkpoint::save(folder, &manifest, &weights)?;
        write_whole(&folder.join(CRITICS_FILE), &module_bytes(self.learner.critics())?)?;
        Ok(())
    }

    fn load(folder: &Path) -> Result<Self, TrainError> {
        let read = |path: PathBuf| {
            std::fs::read(&path).map(|bytes| (path.clone(), bytes)).map_err(|source| TrainError::Io { path, source })
        };
        let (path, bytes) = read(folder.join(CONFIG_FILE))?;
        let config: TrainConfig =
            serde_json::from_slice(&bytes).map_err(|error| TrainError::Damaged { path, reason: error.to_string() })?;
        let (path, bytes) = read(folder.join(STATE_FILE))?;
        let damaged = |reason: &str| TrainError::Damaged { path: path.clone(), reason: reason.to_owned() };
        let (body, crc) = bytes.split_last_chunk::<4>().ok_or_else(|| damaged("too short"))?;
        if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
            return Err(damaged("its checksum does not match"));
        }
        let state: RunState = postcard::from_bytes(body).map_err(|error| damaged(&error.to_string()))?;
        Ok(Self {
            collector: Collector::restore(config.collector.clone(), state.collector),
            learner: Learner::restore(config.processor.device()?, config.sac.clone(), state.learner)?,
            replay: state.replay,
            rounds: state.rounds,
            best: state.best,
            hours: state.hours,
            config,
        })
    }
}

/// Success of the deterministic policy on validation maps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Share of goals up to 25 m away that were reached.
    pub near: f64,
    /// Share of goals 25 to 60 m away that were reached.
    pub far: f64,
}

/// The fixed goals that a run is validated on.
struct ValidationSet {
    maps: Vec<(Arc<Map>, Vec<Goal>, Vec<Goal>)>,
    task: TaskConfig,
}

impl ValidationSet {
    fn new(config: &TrainConfig) -> Self {
        let maps = config
            .validation_seeds
            .iter()
            .map(|&seed| {
                let map = Arc::new(Map::generate(&config.collector.spec(seed)).expect("a valid spec"));
                let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5EED);
                let points = navigable::sample_many(&map, &CharacterProfile::default(), 800, &mut rng).expect("ground");
                let near = Goal::draw(&points, 2.0..25.0, config.validation_goals, &mut rng);
                let far = Goal::draw(&points, 25.0..60.0, config.validation_goals, &mut rng);
                (map, near, far)
            })
            .collect();
        Self { maps, task: TaskConfig::default() }
    }

    fn measure(&self, policy: &Policy, noise_share: f32) -> Validation {
        let mut reached = [0usize; 2];
        let mut tried = [0usize; 2];
        for (map, near, far) in &self.maps {
            for (band, goals) in [near, far].into_iter().enumerate() {
                let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), self.task.clone());
                // Shorter than the task's patience: this only ranks checkpoints.
                rollout.give_up_after = 90;
                rollout.noise_share = noise_share;
                for end in rollout.run(policy, goals) {
                    tried[band] += 1;
                    reached[band] += usize::from(end.end == End::Reached);
                }
            }
        }
        let share = |band: usize| reached[band] as f64 / tried[band].max(1) as f64;
        Validation { near: share(0), far: share(1) }
    }
}

/// Trains in `folder` until the configured number of updates, or until `stop` is set.
///
/// With `resume`, continues the run in `folder` and ignores `config`; otherwise starts one there. Log lines go
/// to `report`.
///
/// # Errors
/// If files cannot be read or written, or a checkpoint does not fit.
pub fn run(
    config: TrainConfig,
    folder: &Path,
    resume: bool,
    stop: &AtomicBool,
    mut report: impl FnMut(&str),
) -> Result<(), TrainError> {
    let io = |source| TrainError::Io { path: folder.to_owned(), source };
    let mut run = if resume {
        Run::load(folder)?
    } else {
        if folder.join(CONFIG_FILE).exists() {
            return Err(TrainError::Exists(folder.to_owned()));
        }
        std::fs::create_dir_all(folder).map_err(io)?;
        let text = serde_json::to_vec_pretty(&config).expect("a config is plain data");
        let run = Run::new(config)?;
        write_whole(&folder.join(CONFIG_FILE), &text)?;
        run
    };
    let validation_set = ValidationSet::new(&run.config);
    let mut events = EventWriter::create(&folder.join("tensorboard")).map_err(io)?;
    let (mut since, mut updates_before) = (Instant::now(), run.updates());
    let mut recent = UpdateStats::default();
    while run.updates() < run.config.total_updates && !run.has_stalled() && !stop.load(Ordering::Relaxed) {
        let started = Instant::now();
        if let Some(last) = run.round().into_iter().rfind(|stats| stats.actor_loss.is_finite()) {
            recent = last;
        }
        if run.rounds.is_multiple_of(50) {
            let stats = run.collector.take_stats();
            let seconds = since.elapsed().as_secs_f64();
            let rate = |count: u64| count as f64 / seconds;
            let success = stats.reached as f64 / stats.episodes.max(1) as f64;
            let updates = run.updates();
            report(&format!(
                "updates {updates} decisions {} | {:.0} decisions/s {:.1} updates/s | success {:.1} % of {} | q {:.3} critic {:.4} entropy {:.2} alpha {:.4}",
                run.collector.total_decisions(),
                rate(stats.decisions),
                rate(updates - updates_before),
                100.0 * success,
                stats.episodes,
                recent.q_mean,
                recent.critic_loss,
                recent.entropy,
                recent.alpha,
            ));
            events
                .scalars(
                    updates,
                    &[
                        ("collect/success", success as f32),
                        ("collect/reward_per_decision", (stats.reward / stats.decisions.max(1) as f64) as f32),
                        ("speed/decisions_s", rate(stats.decisions) as f32),
                        ("speed/updates_s", rate(updates - updates_before) as f32),
                        ("sac/critic_loss", recent.critic_loss),
                        ("sac/actor_loss", recent.actor_loss),
                        ("sac/q_mean", recent.q_mean),
                        ("sac/entropy", recent.entropy),
                        ("sac/alpha", recent.alpha),
                    ],
                )
                .map_err(io)?;
            (since, updates_before) = (Instant::now(), updates);
        }
        run.hours += started.elapsed().as_secs_f64() / 3600.0;
        if run.rounds.is_multiple_of(run.config.validate_every) {
            validate(&mut run, &validation_set, folder, &mut events, &mut report)?;
        }
        if run.rounds.is_multiple_of(run.config.checkpoint_every) {
            run.save(folder)?;
        }
    }
    run.save(folder)?;
    report(&format!("checkpoint written at {} updates", run.updates()));
    Ok(())
}

fn validate(
    run: &mut Run,
    set: &ValidationSet,
    folder: &Path,
    events: &mut EventWriter,
    report: &mut impl FnMut(&str),
) -> Result<(), TrainError> {
    let policy = run.policy();
    let greedy = set.measure(&policy, 0.0);
    let validation = set.measure(&policy, DEFAULT_NOISE_SHARE);
    report(&format!(
        "validation at {} updates: {:.1} % up to 25 m, {:.1} % at 25-60 m (without noise {:.1} %, {:.1} %)",
        run.updates(),
        100.0 * validation.near,
        100.0 * validation.far,
        100.0 * greedy.near,
        100.0 * greedy.far,
    ));
    events
        .scalars(
            run.updates(),
            &[
                ("validation/near", validation.near as f32),
                ("validation/far", validation.far as f32),
                ("validation/near_without_noise", greedy.near as f32),
                ("validation/far_without_noise", greedy.far as f32),
            ],
        )
        .map_err(|source| TrainError::Io { path: folder.to_owned(), source })?;
    let score = validation.near + 0.5 * validation.far;
    run.best.validated = run.updates();
    if score > run.best.score {
        run.best = Best { score, updates: run.updates(), validated: run.updates() };
        run.save_weights(&folder.join("best"), Some(&validation))?;
    }
    Ok(())
}
