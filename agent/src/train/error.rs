//! Why a training run cannot start or go on.

use std::path::PathBuf;
use surefoot_policy::CheckpointError;

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
