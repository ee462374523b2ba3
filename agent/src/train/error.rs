//! Errors of training runs.

use std::path::PathBuf;
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
    /// The folder already contains a run.
    #[error("{0} already contains a run: resume it, or choose another folder")]
    Exists(PathBuf),
}
