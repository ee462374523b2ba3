//! The files of a run: its whole state, which resumes exactly, and its weights.

use super::config::{CONFIG_FILE, TrainConfig};
use super::error::TrainError;
use super::learner::{CRITICS_FILE, Learner, LearnerState};
use super::networks::module_bytes;
use super::replay::{Census, Replay, census};
use super::run::{Best, Run, RunArgs};
use super::source::{RunIo, Source, SourceState};
use super::stages::{STAGES_FILE, total};
use super::validation::Validation;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;
use surefoot_policy::Manifest;
use surefoot_policy::checkpoint::{self, write_atomically};

/// Name of the state file in a run's folder.
const STATE_FILE: &str = "state.bin";

/// The state of a run. It owns its replay buffers when it is read, and borrows them when it is written, so that a
/// gigabyte is not copied.
#[derive(Serialize, Deserialize)]
struct RunState<B> {
    source: SourceState,
    learner: LearnerState,
    buffers: B,
    rounds: u64,
    best: Best,
    hours: f64,
}

/// Counts the rows of the replay buffers in the last checkpoint of the run in `folder`.
///
/// # Errors
/// If there is no checkpoint, or it is damaged.
pub fn census_of(folder: &Path) -> Result<Census, TrainError> {
    Ok(census(&read_state(folder)?.0.buffers))
}

/// Reads the state of the run in `folder`, and returns it with the path of its file.
fn read_state(folder: &Path) -> Result<(RunState<Vec<Replay>>, PathBuf), TrainError> {
    let path = folder.join(STATE_FILE);
    let bytes = std::fs::read(&path).map_err(|source| TrainError::Io { path: path.clone(), source })?;
    let damaged = |reason: &str| TrainError::Damaged { path: path.clone(), reason: reason.to_owned() };
    let (body, crc) = bytes.split_last_chunk::<4>().ok_or_else(|| damaged("too short"))?;
    if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
        return Err(damaged("its checksum does not match"));
    }
    let state = postcard::from_bytes(body).map_err(|error| damaged(&error.to_string()))?;
    Ok((state, path))
}

/// Reads the stages of the weights that the run in `folder` started from, if there are any.
fn read_stages(folder: &Path) -> Result<Option<serde_json::Value>, TrainError> {
    let path = folder.join(STAGES_FILE);
    match std::fs::read(&path) {
        Ok(bytes) => {
            let damaged = |error: serde_json::Error| TrainError::Damaged { path, reason: error.to_string() };
            serde_json::from_slice(&bytes).map(Some).map_err(damaged)
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(TrainError::Io { path, source }),
    }
}

impl Run {
    /// Writes the whole state, and the current weights to `last`.
    pub(super) fn save(&self, folder: &Path) -> Result<(), TrainError> {
        let state = RunState {
            source: self.source.save(),
            learner: self.learner.save()?,
            buffers: self.buffers.as_slice(),
            rounds: self.rounds,
            best: self.best,
            hours: self.hours,
        };
        let mut bytes = postcard::to_stdvec(&state).expect("run state is plain data");
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        write_atomically(&folder.join(STATE_FILE), &bytes)?;
        self.save_weights(&folder.join("last"), None)
    }

    /// Writes a model's folder.
    pub(super) fn save_weights(&self, folder: &Path, validation: Option<&Validation>) -> Result<(), TrainError> {
        let weights = module_bytes(self.actor())?;
        // `started_from` names the start by its hash, because a path means nothing on another machine.
        let config = TrainConfig { start_from: None, ..self.config.clone() };
        let mut training = serde_json::json!({
            "config": config,
            "updates": self.updates(),
            "decisions": self.decisions(),
            "hours": self.hours,
            "validation": validation,
            "revision": self.revision,
        });
        if self.revision.is_none() {
            training["revision_unknown"] = "the run was not started in a checkout".into();
        }
        if let Some(stages) = &self.started_from {
            training["started_from"] = stages.clone();
        }
        training["total"] = total(&training);
        let manifest = Manifest::new(&self.config.name, self.config.sac.network, &weights, training);
        std::fs::create_dir_all(folder).map_err(|source| TrainError::Io { path: folder.to_owned(), source })?;
        write_atomically(&folder.join(CRITICS_FILE), &module_bytes(self.learner.critics())?)?;
        Ok(checkpoint::save(folder, &manifest, &weights)?)
    }

    /// Loads the run of a folder. NPCs in other processes start new attempts.
    ///
    /// # Errors
    /// If a file cannot be read, is damaged, or does not fit the others.
    pub(super) fn load(RunArgs { folder, worlds, connect, listener, .. }: RunArgs<'_>) -> Result<Self, TrainError> {
        let path = folder.join(CONFIG_FILE);
        let bytes = std::fs::read(&path).map_err(|source| TrainError::Io { path: path.clone(), source })?;
        let mut config: TrainConfig =
            serde_json::from_slice(&bytes).map_err(|error| TrainError::Damaged { path, reason: error.to_string() })?;
        if !worlds.is_empty() {
            config.worlds = worlds;
        }
        config.validate()?;
        let io = RunIo { connect: connect.clone(), listener };
        if !folder.join(STATE_FILE).exists() {
            // The run was killed before its first checkpoint.
            return Self::create(config, io);
        }
        let (state, path) = read_state(folder)?;
        let started_from = read_stages(folder)?;
        let damaged = |reason: &str| TrainError::Damaged { path: path.clone(), reason: reason.to_owned() };
        let foreign = || damaged("it does not fit the lanes, networks or maps in config.json");
        let learner = Learner::restore(config.processor.device()?, config.sac.clone(), state.learner)?;
        let policy = learner.policy(&config.name);
        let source = Source::restore(&config, state.source, policy, io)?.ok_or_else(foreign)?;
        let lane_count = source.lane_count() / source.buffer_count();
        let fits = |buffer: &Replay| buffer.fits(lane_count, config.replay_capacity, &config.sac.network);
        let is_here = matches!(source, Source::Here(_));
        if !state.buffers.iter().all(fits) || is_here && state.buffers.len() != 1 {
            return Err(foreign());
        }
        let mut buffers = state.buffers;
        if !is_here {
            // The number of worlds may have changed.
            buffers.iter_mut().for_each(Replay::close);
            let made = source.buffers(config.replay_capacity).into_iter();
            buffers.truncate(source.buffer_count());
            let known = buffers.len();
            buffers.extend(made.skip(known));
        }
        Ok(Self {
            source,
            learner,
            buffers,
            rounds: state.rounds,
            best: state.best,
            hours: state.hours,
            connect,
            learned: Duration::ZERO,
            started_from,
            revision: None,
            config,
        })
    }
}
