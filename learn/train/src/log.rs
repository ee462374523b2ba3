//! The log of a run: text lines, and curves for TensorBoard and MLflow.

use super::collector::CollectorStats;
use super::config::TrainConfig;
use super::error::TrainError;
use super::experience::Traffic;
use super::learner::UpdateStats;
use super::mlflow::FileStore;
use super::tensorboard::EventWriter;
use super::validation::Validation;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The log of one run.
pub(super) struct Log<'a> {
    folder: PathBuf,
    report: &'a mut dyn FnMut(&str),
    events: EventWriter,
    store: FileStore,
    /// Statistics of the last update that updated the actor.
    recent: UpdateStats,
    since: Instant,
    updates_before: u64,
}

impl<'a> Log<'a> {
    /// Creates a log that sends lines to `report` and writes curves into `folder`, for TensorBoard and MLflow.
    pub fn create(
        folder: &Path,
        config: &TrainConfig,
        updates: u64,
        report: &'a mut dyn FnMut(&str),
    ) -> Result<Self, TrainError> {
        let failed = |source| TrainError::Io { path: folder.to_owned(), source };
        let events = EventWriter::create(&folder.join("tensorboard")).map_err(failed)?;
        let parameters = serde_json::to_value(config).expect("a config is plain data");
        let store = FileStore::open(&folder.join("mlruns"), &config.name, &parameters).map_err(failed)?;
        Ok(Self {
            folder: folder.to_owned(),
            report,
            events,
            store,
            recent: UpdateStats::default(),
            since: Instant::now(),
            updates_before: updates,
        })
    }

    /// Logs one line.
    pub fn line(&mut self, text: &str) {
        (self.report)(text);
    }

    fn scalars(&mut self, updates: u64, values: &[(&str, f32)]) -> Result<(), TrainError> {
        let written = self.events.scalars(updates, values).and_then(|()| self.store.scalars(updates, values));
        written.map_err(|source| TrainError::Io { path: self.folder.clone(), source })
    }

    /// Records the statistics of a round's updates.
    pub fn note_updates(&mut self, stats: &[UpdateStats]) {
        if let Some(last) = stats.iter().rfind(|stats| stats.actor_loss.is_finite()) {
            self.recent = *last;
        }
    }

    /// Logs the progress of the run and its speed since the last call.
    pub fn progress(&mut self, updates: u64, decisions: u64, stats: CollectorStats) -> Result<(), TrainError> {
        let seconds = self.since.elapsed().as_secs_f64();
        let rate = |count: u64| count as f64 / seconds;
        let success = stats.reached as f64 / stats.episodes.max(1) as f64;
        let (decisions_s, updates_s) = (rate(stats.decisions), rate(updates - self.updates_before));
        let UpdateStats { critic_loss, q_mean, actor_loss, entropy, alpha } = self.recent;
        self.line(&format!(
            "updates {updates} decisions {decisions} | {decisions_s:.0} decisions/s {updates_s:.1} updates/s | \
             success {:.1} % of {} | q {q_mean:.3} critic {critic_loss:.4} entropy {entropy:.2} alpha {alpha:.4}",
            100.0 * success,
            stats.episodes,
        ));
        self.scalars(
            updates,
            &[
                ("collect/success", success as f32),
                ("collect/reward_per_decision", (stats.reward / stats.decisions.max(1) as f64) as f32),
                ("speed/decisions_s", decisions_s as f32),
                ("speed/updates_s", updates_s as f32),
                ("sac/critic_loss", critic_loss),
                ("sac/actor_loss", actor_loss),
                ("sac/q_mean", q_mean),
                ("sac/entropy", entropy),
                ("sac/alpha", alpha),
            ],
        )?;
        (self.since, self.updates_before) = (Instant::now(), updates);
        Ok(())
    }

    /// Logs how the sources fared, and how time was spent.
    pub fn traffic(&mut self, updates: u64, learn: f64, traffic: Traffic) -> Result<(), TrainError> {
        let Traffic { act, encode, wait, live, stale, lost, repeated } = traffic;
        self.line(&format!(
            "sources: {live} connected, {lost} lost | {stale} stale decisions, {repeated} repeated steps | \
             act {:.0} % encode {:.0} % wait {:.0} % learn {:.0} %",
            100.0 * act,
            100.0 * encode,
            100.0 * wait,
            100.0 * learn,
        ));
        let shares = [("act", act), ("encode", encode), ("wait", wait), ("learn", learn)];
        let counts = [
            ("sources/connected", live),
            ("sources/lost", lost),
            ("sources/stale", stale),
            ("sources/repeated", repeated),
        ];
        let shares = shares.map(|(name, share)| (format!("time/{name}"), share as f32));
        let counts = counts.map(|(name, count)| (name.to_owned(), count as f32));
        let values: Vec<_> = shares.iter().chain(&counts).map(|(name, value)| (name.as_str(), *value)).collect();
        self.scalars(updates, &values)
    }

    /// Logs success on validation maps, with the default noise and without.
    pub fn validation(&mut self, updates: u64, noisy: Validation, greedy: Validation) -> Result<(), TrainError> {
        self.line(&format!(
            "validation at {updates} updates: {:.1} % up to 25 m, {:.1} % at 25-60 m (without noise {:.1} %, {:.1} %)",
            100.0 * noisy.near,
            100.0 * noisy.far,
            100.0 * greedy.near,
            100.0 * greedy.far,
        ));
        self.scalars(
            updates,
            &[
                ("validation/near", noisy.near as f32),
                ("validation/far", noisy.far as f32),
                ("validation/near_without_noise", greedy.near as f32),
                ("validation/far_without_noise", greedy.far as f32),
            ],
        )
    }
}
