//! The manifest of a set of weights: the network that they fit, how they were trained, and their hash.

use crate::config::ActorConfig;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use surefoot_world::sense::OBSERVATION_VERSION;

/// Name of the manifest inside a model's folder.
pub const MANIFEST_FILE: &str = "manifest.json";

/// Describes a set of weights; stored beside them as `manifest.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the model, as used in reports.
    pub name: String,
    /// `sac-reactive` or `sac-lstm`.
    pub kind: String,
    /// Layer sizes.
    pub actor: ActorConfig,
    /// Length of an observation row.
    pub observation_len: usize,
    /// Version of the observation's layout and meaning.
    pub observation_version: u32,
    /// blake3 of the weights file, hexadecimal.
    pub weights_hash: String,
    /// How the model was trained, as free-form JSON: revision, configuration, seeds, decisions, hours, validation
    /// score.
    pub training: serde_json::Value,
}

/// Why weights cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// A file could not be read or written.
    #[error("cannot read or write {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The manifest is not valid JSON of the expected form.
    #[error("{path} is not a model manifest")]
    Manifest {
        /// Path of the manifest.
        path: PathBuf,
        /// The parse error.
        source: serde_json::Error,
    },
    /// The manifest describes another weights file.
    #[error("weights are damaged: their hash is {found}, the manifest says {expected}")]
    Damaged {
        /// Hash of the actual bytes.
        found: String,
        /// Hash in the manifest.
        expected: String,
    },
    /// The weights were trained for another observation or network.
    #[error("weights do not fit: {field} is {found}, this program has {expected}")]
    Mismatch {
        /// Name of the field that differs.
        field: &'static str,
        /// Value in the checkpoint.
        found: String,
        /// Value in this program.
        expected: String,
    },
    /// The manifest has sizes that are not allowed.
    #[error("the manifest has sizes that are not allowed (1 to 4096, memory from 0): {0:?}")]
    Sizes(ActorConfig),
    /// The weights file could not be decoded into the network.
    #[error("weights cannot be loaded into the network: {0}")]
    Decode(String),
}

impl Manifest {
    /// Describes freshly trained weights.
    pub fn new(name: &str, actor: ActorConfig, weights: &[u8], training: serde_json::Value) -> Self {
        Self {
            name: name.to_owned(),
            kind: kind(&actor).to_owned(),
            actor,
            observation_len: actor.observation_len(),
            observation_version: OBSERVATION_VERSION,
            weights_hash: hash(weights),
            training,
        }
    }

    /// Reads the manifest of a model's folder.
    ///
    /// # Errors
    /// If the file cannot be read or is not a manifest.
    pub fn load(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(MANIFEST_FILE);
        parse_manifest(&path, &read(&path)?)
    }

    /// Checks that `weights` match the manifest and fit this program's network and observation.
    ///
    /// # Errors
    /// Names the field that differs.
    pub fn check(&self, weights: &[u8]) -> Result<(), CheckpointError> {
        let found = hash(weights);
        if found != self.weights_hash {
            return Err(CheckpointError::Damaged { found, expected: self.weights_hash.clone() });
        }
        let same = |field, found: String, expected: String| {
            if found == expected { Ok(()) } else { Err(CheckpointError::Mismatch { field, found, expected }) }
        };
        if !self.actor.is_sound() {
            return Err(CheckpointError::Sizes(self.actor));
        }
        same("kind", self.kind.clone(), kind(&self.actor).to_owned())?;
        same("observation_len", self.observation_len.to_string(), self.actor.observation_len().to_string())?;
        same("observation_version", self.observation_version.to_string(), OBSERVATION_VERSION.to_string())
    }
}

/// The manifest's `kind` for an actor of these sizes.
fn kind(actor: &ActorConfig) -> &'static str {
    if actor.memory.is_some() { "sac-lstm" } else { "sac-reactive" }
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

pub(crate) fn read(path: &Path) -> Result<Vec<u8>, CheckpointError> {
    std::fs::read(path).map_err(|source| CheckpointError::Io { path: path.to_owned(), source })
}

pub(crate) fn parse_manifest(path: &Path, bytes: &[u8]) -> Result<Manifest, CheckpointError> {
    serde_json::from_slice(bytes).map_err(|source| CheckpointError::Manifest { path: path.to_owned(), source })
}
