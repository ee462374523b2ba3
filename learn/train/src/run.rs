//! A training run: rounds of collecting and learning, with logging, validation and checkpoints between them.
//!
//! [`run`] is the loop, [`Run::round`] one iteration: collect, sample, update, store.

use super::actors::Listener;
use super::config::{CONFIG_FILE, TrainConfig};
use super::error::TrainError;
use super::experience::Collected;
use super::learner::{Learner, UpdateStats};
use super::log::Log;
use super::networks::ActorNetwork;
use super::replay::{self, Batch, Census, Replay, Sampling, census};
use super::source::{RunIo, Source};
use super::stages::{STAGES_FILE, holds, stages};
use super::validation::ValidationSet;
use super::worlds::Connect;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use surefoot_game_client::GameError;
use surefoot_policy::Policy;
use surefoot_policy::checkpoint::write_atomically;
use surefoot_rollout::DEFAULT_NOISE_SHARE;

/// Number of batches, or of steps of all lanes if these have more rows, that must be stored before learning begins.
const WARM_UP: usize = 40;
/// Rounds between two progress lines of the log.
const LOG_EVERY: u64 = 50;
/// Longest time between two progress lines of a run that other processes feed.
const LOG_INTERVAL: Duration = Duration::from_secs(20);

/// A run between two rounds.
pub struct Run {
    pub(super) config: TrainConfig,
    pub(super) source: Source,
    pub(super) learner: Learner,
    /// One buffer for each environment of the source.
    pub(super) buffers: Vec<Replay>,
    pub(super) rounds: u64,
    pub(super) best: Best,
    /// Wall time of all rounds, h.
    pub(super) hours: f64,
    pub(super) connect: Connect,
    /// Time spent on updates since the last progress line.
    pub(super) learned: Duration,
    /// The stages of the weights that the run started from, for its manifests.
    pub(super) started_from: Option<serde_json::Value>,
    /// Revision of the program, for its manifests.
    pub(super) revision: Option<String>,
}

/// Folder and connections of a run.
pub struct RunArgs<'a> {
    /// Folder of the run.
    pub folder: &'a Path,
    /// Whether to resume the run in the folder.
    pub resume: bool,
    /// New addresses of the worlds of a resumed run; empty if they are unchanged.
    pub worlds: Vec<String>,
    /// Connects to worlds.
    pub connect: Connect,
    /// The endpoint for actors, if the run has any.
    pub listener: Option<Listener>,
    /// Revision of the program, if it is known.
    pub revision: Option<String>,
}

impl<'a> RunArgs<'a> {
    /// A run whose worlds are in this process.
    pub fn here(folder: &'a Path, resume: bool) -> Self {
        Self { folder, resume, worlds: Vec::new(), connect: nowhere(), listener: None, revision: None }
    }
}

/// Connects to no worlds.
fn nowhere() -> Connect {
    let reason = "this run has no connections".to_owned();
    Arc::new(move |uri| Err(GameError::Unreachable { uri: uri.into(), reason: reason.clone() }))
}

/// The best validation so far.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Best {
    score: f64,
    /// Number of updates when the score was measured.
    updates: u64,
    /// Number of updates at the last validation.
    validated: u64,
}

impl Run {
    /// Creates a new run whose worlds are in this process.
    ///
    /// # Errors
    /// If the configuration is invalid, or the model to start from cannot be used.
    pub fn new(config: TrainConfig) -> Result<Self, TrainError> {
        Self::create(config, RunIo { connect: nowhere(), listener: None })
    }

    /// Creates a new run.
    pub(super) fn create(config: TrainConfig, io: RunIo) -> Result<Self, TrainError> {
        config.validate()?;
        let stream = |number: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
            rng.set_stream(number);
            rng
        };
        let mut learner = Learner::on(config.processor.device()?, config.sac.clone(), stream(11));
        let start = config.start_from.as_deref().map(|folder| learner.start_from(folder)).transpose()?;
        let started_from = start.as_ref().map(stages);
        let connect = io.connect.clone();
        let source = Source::new(&config, stream(10), learner.policy(&config.name), io)?;
        let buffers = source.buffers(config.replay_capacity);
        let best = Best { score: -1.0, updates: 0, validated: 0 };
        Ok(Self {
            source,
            learner,
            buffers,
            rounds: 0,
            best,
            hours: 0.0,
            connect,
            learned: Duration::ZERO,
            started_from,
            revision: None,
            config,
        })
    }

    /// The current policy.
    pub fn policy(&self) -> Policy {
        self.learner.policy(&self.config.name)
    }

    /// The current policy network.
    pub fn actor(&self) -> &ActorNetwork {
        self.learner.actor()
    }

    /// Number of updates so far.
    pub fn updates(&self) -> u64 {
        self.learner.updates()
    }

    /// Number of decisions collected so far.
    pub fn decisions(&self) -> u64 {
        self.source.total_decisions()
    }

    /// Runs one round: the collector acts with the policy of the last barrier while the learner learns from rows stored
    /// before it. With worlds in this process, the result does not depend on how the two threads interleave.
    ///
    /// # Errors
    /// If other processes send nothing for too long.
    pub fn round(&mut self) -> Result<Vec<UpdateStats>, TrainError> {
        self.round_until(&AtomicBool::new(false))
    }

    /// Runs one round, which ends early when `stop` is set.
    fn round_until(&mut self, stop: &AtomicBool) -> Result<Vec<UpdateStats>, TrainError> {
        let acting = (self.policy(), self.updates());
        let update_count = if self.is_warm() { self.config.updates_per_round } else { 0 };
        let Self { config, source, learner, buffers, learned, .. } = self;
        let (collected, stats) = std::thread::scope(|scope| {
            let collecting = scope.spawn(|| source.collect(acting, config.steps_per_round, stop));
            let started = Instant::now();
            let stats = learn(learner, buffers, config.sampling(), update_count);
            *learned += started.elapsed();
            (collecting.join().expect("the collector does not panic"), stats)
        });
        for (buffer_idx, collected) in collected? {
            match collected {
                Collected::Step(step) => buffers[buffer_idx].push_step(&step),
                Collected::Closed => buffers[buffer_idx].close(),
            }
        }
        self.rounds += 1;
        Ok(stats)
    }

    /// Counts of the rows in the replay buffers.
    pub fn census(&self) -> Census {
        census(&self.buffers)
    }

    /// Whether enough rows are stored to learn from.
    fn is_warm(&self) -> bool {
        let rows = (self.config.batch * self.config.learn).max(self.source.lane_count());
        let stored: usize = self.buffers.iter().map(Replay::len).sum();
        stored >= WARM_UP * rows && replay::can_sample(&self.buffers, self.config.sampling())
    }

    fn is_over(&self) -> bool {
        let has_stalled = |patience: std::num::NonZeroU64| self.best.validated > self.best.updates + patience.get();
        self.updates() >= self.config.total_updates || self.config.stop_after.is_some_and(has_stalled)
    }

    /// Validates the policy, and saves the weights in `best` if they are the best so far.
    fn validate(&mut self, set: &ValidationSet, folder: &Path, log: &mut Log<'_>) -> Result<(), TrainError> {
        let policy = self.policy();
        let worlds = Some((self.config.worlds.as_slice(), &self.connect)).filter(|(worlds, _)| !worlds.is_empty());
        let measure = |noise_share| set.measure(&policy, noise_share, worlds);
        let (greedy, validation) = match measure(0.0).and_then(|greedy| Ok((greedy, measure(DEFAULT_NOISE_SHARE)?))) {
            Ok(both) => both,
            Err(error) => {
                log.line(&format!("validation at {} updates failed: {error}", self.updates()));
                return Ok(());
            }
        };
        log.validation(self.updates(), validation, greedy)?;
        self.best.validated = self.updates();
        if validation.score() > self.best.score {
            self.best = Best { score: validation.score(), updates: self.updates(), validated: self.updates() };
            self.save_weights(&folder.join("best"), Some(&validation))?;
        }
        Ok(())
    }
}

/// Samples batches and updates the learner with them.
fn learn(learner: &mut Learner, buffers: &[Replay], sampling: Sampling, update_count: usize) -> Vec<UpdateStats> {
    let mut batch = Batch::default();
    let mut stats = Vec::with_capacity(update_count);
    for _ in 0..update_count {
        replay::sample(buffers, sampling, learner.rng(), &mut batch);
        stats.push(learner.update(&batch));
    }
    stats
}

/// Trains in a folder until the configured number of updates, until validation no longer improves, or until `stop` is
/// set.
///
/// A resumed run ignores `config`. Log lines go to `report`.
///
/// # Errors
/// If the configuration is invalid, files cannot be read or written, the folder already contains another run, or a
/// checkpoint does not fit.
pub fn run(
    config: TrainConfig,
    args: RunArgs<'_>,
    stop: &AtomicBool,
    mut report: impl FnMut(&str),
) -> Result<(), TrainError> {
    let folder = args.folder;
    let revision = args.revision.clone();
    let mut run = if args.resume { Run::load(args)? } else { start(config, args)? };
    run.revision = revision;
    let validation_set = ValidationSet::new(&run.config);
    let mut log = Log::create(folder, &run.config, run.updates(), &mut report)?;
    let mut logged = Instant::now();
    while !run.is_over() && !stop.load(Ordering::Relaxed) {
        let started = Instant::now();
        match run.round_until(stop) {
            Ok(stats) => log.note_updates(&stats),
            Err(error) => {
                run.save(folder)?;
                return Err(error);
            }
        }
        let is_due = run.rounds.is_multiple_of(LOG_EVERY) || !run.config.is_here() && logged.elapsed() > LOG_INTERVAL;
        if is_due {
            let stats = run.source.take_stats();
            log.progress(run.updates(), run.decisions(), stats)?;
            let elapsed = std::mem::replace(&mut logged, Instant::now()).elapsed();
            let learn = std::mem::take(&mut run.learned).as_secs_f64() / elapsed.as_secs_f64();
            if let Source::Elsewhere(receiver) = &mut run.source {
                log.traffic(run.learner.updates(), learn, receiver.take_traffic())?;
            }
        }
        run.hours += started.elapsed().as_secs_f64() / 3600.0;
        if run.rounds.is_multiple_of(run.config.validate_every) {
            run.validate(&validation_set, folder, &mut log)?;
        }
        if run.rounds.is_multiple_of(run.config.checkpoint_every) {
            run.save(folder)?;
        }
    }
    run.save(folder)?;
    log.line(&format!("checkpoint written at {} updates", run.updates()));
    Ok(())
}

/// Starts a new run in a folder without one.
fn start(config: TrainConfig, RunArgs { folder, connect, listener, .. }: RunArgs<'_>) -> Result<Run, TrainError> {
    if folder.join(CONFIG_FILE).exists() {
        return Err(TrainError::Exists(folder.to_owned()));
    }
    if config.start_from.as_deref().is_some_and(|start| holds(folder, start)) {
        return Err(TrainError::Config {
            field: "start_from",
            problem: "is the run's own folder: name another folder",
        });
    }
    let text = serde_json::to_vec_pretty(&config).expect("a config is plain data");
    let run = Run::create(config, RunIo { connect, listener })?;
    std::fs::create_dir_all(folder).map_err(|source| TrainError::Io { path: folder.to_owned(), source })?;
    if let Some(stages) = &run.started_from {
        // The model that the run started from may be replaced before the run is resumed.
        write_atomically(
            &folder.join(STAGES_FILE),
            &serde_json::to_vec_pretty(stages).expect("a value is plain data"),
        )?;
    }
    write_atomically(&folder.join(CONFIG_FILE), &text)?;
    Ok(run)
}
