//! Weights on disk: a burnpack file beside a JSON manifest that says what it is.

use crate::{Actor, ActorConfig, Policy};
use burn::module::Module;
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, Device};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::sense::OBSERVATION_VERSION;

/// Name of the weights file inside a model's folder.
pub const WEIGHTS_FILE: &str = "weights.bpk";
/// Name of the manifest inside a model's folder.
pub const MANIFEST_FILE: &str = "manifest.json";

/// What trained a set of weights, and what they fit.
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
    /// Version of the observation's meaning.
    pub observation_version: u32,
    /// blake3 of the weights file, hexadecimal.
    pub weights_hash: String,
    /// How it was trained: revision, configuration, seeds, decisions, hours, validation score.
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
        /// What the system said.
        source: std::io::Error,
    },
    /// The manifest is not valid JSON of the expected form.
    #[error("{path} is not a model manifest")]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// Where it went wrong.
        source: serde_json::Error,
    },
    /// The weights file is not the one that the manifest describes.
    #[error("weights are damaged: their hash is {found}, the manifest says {expected}")]
    Damaged {
        /// Hash of the bytes at hand.
        found: String,
        /// Hash in the manifest.
        expected: String,
    },
    /// The weights were trained for another observation or network.
    #[error("weights do not fit: {field} is {found}, this program has {expected}")]
    Mismatch {
        /// What differs.
        field: &'static str,
        /// Value in the checkpoint.
        found: String,
        /// Value in this program.
        expected: String,
    },
    /// The manifest describes a network that cannot be.
    #[error("the manifest describes a network of sizes that are not allowed (1 to 4096, memory from 0): {0:?}")]
    Sizes(ActorConfig),
    /// The weights file could not be decoded into the network.
    #[error("weights cannot be loaded into the network: {0}")]
    Decode(String),
}

/// A model inside the program.
struct Shipped {
    name: &'static str,
    manifest: &'static [u8],
    weights: &'static [u8],
}

const GENERAL_REACTIVE: Shipped = Shipped {
    name: "general-reactive",
    manifest: include_bytes!("../../models/general-reactive/manifest.json"),
    weights: include_bytes!("../../models/general-reactive/weights.bpk"),
};

const GENERAL_LSTM: Shipped = Shipped {
    name: "general-lstm",
    manifest: include_bytes!("../../models/general-lstm/manifest.json"),
    weights: include_bytes!("../../models/general-lstm/weights.bpk"),
};

impl Shipped {
    fn manifest(&self) -> Result<Manifest, CheckpointError> {
        parse_manifest(&Path::new("models").join(self.name).join(MANIFEST_FILE), self.manifest)
    }
}

impl Policy {
    /// The general reactive policy that ships with the program.
    ///
    /// # Errors
    /// Only if the program was built from a damaged checkout.
    pub fn shipped() -> Result<Self, CheckpointError> {
        Self::from_bytes(GENERAL_REACTIVE.manifest()?, GENERAL_REACTIVE.weights)
    }

    /// The policy of that name, if one ships with the program: `general-reactive` or `general-lstm`.
    ///
    /// # Errors
    /// Only if the program was built from a damaged checkout.
    pub fn shipped_as(name: &str) -> Option<Result<Self, CheckpointError>> {
        let shipped = [GENERAL_REACTIVE, GENERAL_LSTM].into_iter().find(|shipped| shipped.name == name)?;
        Some(shipped.manifest().and_then(|manifest| Self::from_bytes(manifest, shipped.weights)))
    }

    /// Reads a model's folder.
    ///
    /// # Errors
    /// If a file is missing, damaged, or does not fit this program's network or observation.
    pub fn load(folder: &Path) -> Result<Self, CheckpointError> {
        Self::from_bytes(Manifest::load(folder)?, &read(&folder.join(WEIGHTS_FILE))?)
    }

    /// Takes the contents of a model's files.
    ///
    /// # Errors
    /// If the weights are not those that the manifest describes, or do not fit this program's network or observation.
    pub fn from_bytes(manifest: Manifest, weights: &[u8]) -> Result<Self, CheckpointError> {
        manifest.check(weights)?;
        let device = Device::flex();
        let actor = load_module(Actor::new(&manifest.actor, &device, &mut ChaCha8Rng::seed_from_u64(0)), weights)?;
        Ok(Self::new(&actor, manifest))
    }

    /// Hash of the weights: part of every graph's identity.
    pub fn weights_hash(&self) -> &str {
        &self.manifest.weights_hash
    }
}

impl Manifest {
    /// Describes freshly trained weights.
    pub fn new(name: &str, actor: ActorConfig, weights: &[u8], training: serde_json::Value) -> Self {
        Self {
            name: name.to_owned(),
            kind: kind(&actor).to_owned(),
            actor,
            observation_len: OBSERVATION_LEN,
            observation_version: OBSERVATION_VERSION,
            weights_hash: hash(weights),
            training,
        }
    }

    /// Reads the manifest of a model's folder.
    ///
    /// # Errors
    /// If it is missing or not a manifest.
    pub fn load(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(MANIFEST_FILE);
        parse_manifest(&path, &read(&path)?)
    }

    /// Whether `weights` are those described, for a network and observation that this program has.
    ///
    /// # Errors
    /// Names what differs.
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
        // Room is made for a network before its weights are read, so a manifest must not ask for more than there are.
        let (needed, found) = (self.actor.parameter_count() * size_of::<f32>(), weights.len());
        if found < needed {
            return Err(CheckpointError::Decode(format!(
                "the network that the manifest describes has {needed} bytes of weights, the file is {found} bytes long"
            )));
        }
        same("kind", self.kind.clone(), kind(&self.actor).to_owned())?;
        same("observation_len", self.observation_len.to_string(), OBSERVATION_LEN.to_string())?;
        same("observation_version", self.observation_version.to_string(), OBSERVATION_VERSION.to_string())
    }
}

/// Writes a model's folder; each file appears whole or not at all.
///
/// # Errors
/// If a file cannot be written.
pub fn save(folder: &Path, manifest: &Manifest, weights: &[u8]) -> Result<(), CheckpointError> {
    let text = serde_json::to_vec_pretty(manifest).expect("a manifest is plain data");
    std::fs::create_dir_all(folder).map_err(|source| CheckpointError::Io { path: folder.to_owned(), source })?;
    write_whole(&folder.join(WEIGHTS_FILE), weights)?;
    write_whole(&folder.join(MANIFEST_FILE), &text)
}

/// Writes `bytes` beside `path`, then renames: a reader never sees half a file.
///
/// # Errors
/// If the file cannot be written.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), CheckpointError> {
    let beside = path.with_extension("tmp");
    std::fs::write(&beside, bytes)
        .and_then(|()| std::fs::rename(&beside, path))
        .map_err(|source| CheckpointError::Io { path: path.to_owned(), source })
}

/// Serializes a module's parameters.
///
/// # Errors
/// If the module cannot be encoded.
pub fn module_bytes<M: Module>(module: &M) -> Result<Vec<u8>, CheckpointError> {
    module
        .valid()
        .into_record()
        .into_bytes()
        .map(|bytes| bytes.to_vec())
        .map_err(|error| CheckpointError::Decode(error.to_string()))
}

/// Loads parameters into a module of the same shape.
///
/// # Errors
/// If they do not fit it.
pub fn load_module<M: Module>(module: M, bytes: &[u8]) -> Result<M, CheckpointError> {
    let decode = |error: burn::store::RecordError| CheckpointError::Decode(error.to_string());
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).map_err(decode)?;
    module.try_load_record(record).map_err(decode)
}

/// What an actor of these sizes is called.
fn kind(actor: &ActorConfig) -> &'static str {
    if actor.memory > 0 { "sac-lstm" } else { "sac-reactive" }
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

fn read(path: &Path) -> Result<Vec<u8>, CheckpointError> {
    std::fs::read(path).map_err(|source| CheckpointError::Io { path: path.to_owned(), source })
}

fn parse_manifest(path: &Path, bytes: &[u8]) -> Result<Manifest, CheckpointError> {
    serde_json::from_slice(bytes).map_err(|source| CheckpointError::Manifest { path: path.to_owned(), source })
}
