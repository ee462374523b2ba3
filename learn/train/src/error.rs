//! Errors of training runs.

use std::path::PathBuf;
use std::time::Duration;
use surefoot_policy::CheckpointError;

/// Why a run cannot start or continue.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file of the run could not be read or written.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A checkpoint cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A configuration or state file is damaged.
    #[error("{path} is damaged: {reason}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The configuration is invalid or contradicts itself.
    #[error("configuration: {field}: {problem}")]
    Config {
        /// Name of the field to change.
        field: &'static str,
        /// What is wrong with the field.
        problem: &'static str,
    },
    /// No step has arrived from other processes for too long.
    #[error(
        "no step arrived for {} s: {live} of {count} environments or actors are connected; \
         start them, then continue with --resume",
        .waited.as_secs()
    )]
    NoSteps {
        /// Time without a step.
        waited: Duration,
        /// Sources that are connected.
        live: u64,
        /// Sources of the run.
        count: usize,
    },
    /// All threads that receive steps have ended.
    #[error("all environments or actors of the run have failed: continue with --resume")]
    NoSource,
    /// The folder already contains a run.
    #[error("{0} already contains a run: resume it, or choose another folder")]
    Exists(PathBuf),
}
