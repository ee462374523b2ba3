//! A training run: rounds of collecting and learning, with logging, validation and checkpoints between them.
//!
//! [`run`] is the loop, [`Run::round`] one iteration: collect, sample, update, store.

use super::collector::Collector;
use super::config::{CONFIG_FILE, TrainConfig};
use super::error::TrainError;
use super::learner::{Learner, UpdateStats};
use super::log::Log;
use super::replay::{Batch, Replay, Sampling};
use super::validation::ValidationSet;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use surefoot_policy::checkpoint::write_atomically;
use surefoot_policy::{Actor, Manifest, Policy};
use surefoot_rollout::DEFAULT_NOISE_SHARE;

/// Batches of rows, or steps of all lanes if these are more rows, that must be stored before learning begins.
const WARM_UP: usize = 40;
/// Rounds between two progress lines of the log.
const LOG_EVERY: u64 = 50;

/// A run between two rounds.
pub struct Run {
    pub(super) config: TrainConfig,
    pub(super) collector: Collector,
    pub(super) learner: Learner,
    pub(super) replay: Replay,
    pub(super) rounds: u64,
    pub(super) best: Best,
    /// Wall time of all rounds, h.
    pub(super) hours: f64,
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
    /// Creates a new run.
    ///
    /// # Errors
    /// If the configuration is invalid, or the model to start from cannot be used.
    pub fn new(config: TrainConfig) -> Result<Self, TrainError> {
        config.validate()?;
        let stream = |number: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
            rng.set_stream(number);
            rng
        };
        let collector = Collector::new(config.collector.clone(), &config.sac.network, stream(10));
        let replay = Replay::new(collector.lane_count(), config.replay_capacity);
        let mut learner = Learner::on(config.processor.device()?, config.sac.clone(), stream(11));
        if let Some(folder) = &config.start_from {
            learner.start_from(folder)?;
        }
        let best = Best { score: -1.0, updates: 0, validated: 0 };
        Ok(Self { collector, learner, replay, rounds: 0, best, hours: 0.0, config })
    }

    /// The current policy.
    pub fn policy(&self) -> Policy {
        let manifest = Manifest::new(&self.config.name, self.config.sac.network, &[], serde_json::Value::Null);
        Policy::new(self.learner.actor(), manifest)
    }

    /// The current policy network.
    pub fn actor(&self) -> &Actor {
        self.learner.actor()
    }

    /// Number of updates so far.
    pub fn updates(&self) -> u64 {
        self.learner.updates()
    }

    /// Number of decisions collected so far.
    pub fn decisions(&self) -> u64 {
        self.collector.total_decisions()
    }

    /// Runs one round: the collector acts with the actor of the last barrier, while the learner learns from rows stored
    /// before it. The results do not depend on how the two threads interleave.
    pub fn round(&mut self) -> Vec<UpdateStats> {
        let policy = self.policy();
        let update_count = if self.is_warm() { self.config.updates_per_round } else { 0 };
        let Self { config, collector, learner, replay, .. } = self;
        let (steps, stats) = std::thread::scope(|scope| {
            let collecting = scope.spawn(|| collector.collect(&policy, config.steps_per_round));
            let stats = learn(learner, replay, config.sampling(), update_count);
            (collecting.join().expect("the collector does not panic"), stats)
        });
        steps.iter().for_each(|step| replay.push_step(step));
        self.rounds += 1;
        stats
    }

    /// Whether enough rows are stored to learn from.
    fn is_warm(&self) -> bool {
        let rows = (self.config.batch * self.config.learn).max(self.collector.lane_count());
        self.replay.len() >= WARM_UP * rows && self.replay.can_sample(self.config.sampling())
    }

    fn is_over(&self) -> bool {
        let has_stalled = |patience: std::num::NonZeroU64| self.best.validated > self.best.updates + patience.get();
        self.updates() >= self.config.total_updates || self.config.stop_after.is_some_and(has_stalled)
    }

    /// Validates the policy, and saves the weights in `best` if they are the best so far.
    fn validate(&mut self, set: &ValidationSet, folder: &Path, log: &mut Log<'_>) -> Result<(), TrainError> {
        let policy = self.policy();
        let greedy = set.measure(&policy, 0.0);
        let validation = set.measure(&policy, DEFAULT_NOISE_SHARE);
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
fn learn(learner: &mut Learner, replay: &Replay, sampling: Sampling, update_count: usize) -> Vec<UpdateStats> {
    let mut batch = Batch::default();
    let mut stats = Vec::with_capacity(update_count);
    for _ in 0..update_count {
        replay.sample(sampling, learner.rng(), &mut batch);
        stats.push(learner.update(&batch));
    }
    stats
}

/// Trains in `folder` until the configured number of updates, until validation no longer improves, or until `stop` is set.
///
/// With `resume`, continues the run in `folder` and ignores `config`; otherwise starts a new run. Log lines go to `report`.
///
/// # Errors
/// If the configuration is invalid, files cannot be read or written, `folder` already contains another run, or a checkpoint
/// does not fit.
pub fn run(
    config: TrainConfig,
    folder: &Path,
    resume: bool,
    stop: &AtomicBool,
    mut report: impl FnMut(&str),
) -> Result<(), TrainError> {
    let mut run = if resume { Run::load(folder)? } else { start(config, folder)? };
    let validation_set = ValidationSet::new(&run.config);
    let mut log = Log::create(folder, run.updates(), &mut report)?;
    while !run.is_over() && !stop.load(Ordering::Relaxed) {
        let started = Instant::now();
        log.note_updates(&run.round());
        if run.rounds.is_multiple_of(LOG_EVERY) {
            let stats = run.collector.take_stats();
            log.progress(run.updates(), run.decisions(), stats)?;
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
fn start(config: TrainConfig, folder: &Path) -> Result<Run, TrainError> {
    if folder.join(CONFIG_FILE).exists() {
        return Err(TrainError::Exists(folder.to_owned()));
    }
    std::fs::create_dir_all(folder).map_err(|source| TrainError::Io { path: folder.to_owned(), source })?;
    let text = serde_json::to_vec_pretty(&config).expect("a config is plain data");
    let run = Run::new(config)?;
    write_atomically(&folder.join(CONFIG_FILE), &text)?;
    Ok(run)
}
