//! Weights on disk: a burnpack file beside a JSON manifest that describes it.

use crate::actor::Actor;
pub use crate::manifest::MANIFEST_FILE;
use crate::manifest::{CheckpointError, Manifest, parse_manifest, read};
use crate::policy::Policy;
use burn::module::Module;
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, DType, Device};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::io::Write;
use std::path::Path;

/// Name of the weights file inside a model's folder.
pub const WEIGHTS_FILE: &str = "weights.bpk";
/// Where weights wait until their manifest is written.
const NEXT_WEIGHTS_FILE: &str = "weights.next";

/// A model compiled into the program.
struct Shipped {
    name: &'static str,
    manifest: &'static [u8],
    weights: &'static [u8],
}

const GENERAL_REACTIVE: Shipped = Shipped {
    name: "general-reactive",
    manifest: include_bytes!("../../../models/general-reactive/manifest.json"),
    weights: include_bytes!("../../../models/general-reactive/weights.bpk"),
};

const GENERAL_LSTM: Shipped = Shipped {
    name: "general-lstm",
    manifest: include_bytes!("../../../models/general-lstm/manifest.json"),
    weights: include_bytes!("../../../models/general-lstm/weights.bpk"),
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

    /// The shipped policy `general-reactive` or `general-lstm`; `None` for other names.
    ///
    /// # Errors
    /// Only if the program was built from a damaged checkout.
    pub fn shipped_named(name: &str) -> Option<Result<Self, CheckpointError>> {
        let shipped = [GENERAL_REACTIVE, GENERAL_LSTM].into_iter().find(|shipped| shipped.name == name)?;
        Some(shipped.manifest().and_then(|manifest| Self::from_bytes(manifest, shipped.weights)))
    }

    /// Reads a policy from a model's folder.
    ///
    /// # Errors
    /// If a file is missing, damaged, or does not fit this program's network or observation.
    pub fn load(folder: &Path) -> Result<Self, CheckpointError> {
        let manifest = Manifest::load(folder)?;
        let weights = weights(folder, &manifest)?;
        Self::from_bytes(manifest, &weights)
    }

    /// Decodes a policy from the contents of a model's files.
    ///
    /// # Errors
    /// If the weights do not match the manifest, or do not fit this program's network or observation.
    pub fn from_bytes(manifest: Manifest, weights: &[u8]) -> Result<Self, CheckpointError> {
        manifest.check(weights)?;
        let device = Device::flex();
        let actor = load_module(Actor::new(&manifest.actor, &device, &mut ChaCha8Rng::seed_from_u64(0)), weights)?;
        Ok(Self::new(&actor, manifest))
    }

    /// blake3 of the weights file, hexadecimal; part of every graph's id.
    pub fn weights_hash(&self) -> &str {
        &self.manifest().weights_hash
    }
}

/// Reads the weights that a manifest describes from its folder.
///
/// # Errors
/// If the file cannot be read.
pub fn weights(folder: &Path, manifest: &Manifest) -> Result<Vec<u8>, CheckpointError> {
    // A program that is killed between the manifest and the weights leaves these beside the former ones.
    match read(&folder.join(NEXT_WEIGHTS_FILE)) {
        Ok(next) if manifest.check(&next).is_ok() => Ok(next),
        _ => read(&folder.join(WEIGHTS_FILE)),
    }
}

/// Writes a model's folder. Whenever the program is killed, the folder holds the former model or this one.
///
/// # Errors
/// If a file cannot be written.
pub fn save(folder: &Path, manifest: &Manifest, weights: &[u8]) -> Result<(), CheckpointError> {
    let text = serde_json::to_vec_pretty(manifest).expect("a manifest is plain data");
    std::fs::create_dir_all(folder).map_err(|source| CheckpointError::Io { path: folder.to_owned(), source })?;
    let (next, path) = (folder.join(NEXT_WEIGHTS_FILE), folder.join(WEIGHTS_FILE));
    write_atomically(&next, weights)?;
    write_atomically(&folder.join(MANIFEST_FILE), &text)?;
    std::fs::rename(&next, &path).map_err(|source| CheckpointError::Io { path, source })
}

/// Writes a file atomically: writes `bytes` beside `path`, then renames, so that readers never see a partial file.
///
/// # Errors
/// If the file cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), CheckpointError> {
    let temporary = path.with_extension("tmp");
    std::fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&temporary, path))
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
/// If the bytes cannot be decoded, or the shapes or types of numbers differ.
pub fn load_module<M: Module>(module: M, bytes: &[u8]) -> Result<M, CheckpointError> {
    let decode = |error: burn::store::RecordError| CheckpointError::Decode(error.to_string());
    check_types(bytes).map_err(CheckpointError::Decode)?;
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).map_err(decode)?;
    module.try_load_record(record).map_err(decode)
}

/// Checks that all tensors hold `f32`: burn panics on types that are none of a module's.
fn check_types(bytes: &[u8]) -> Result<(), String> {
    let file =
        burn_pack::Reader::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).map_err(|error| error.to_string())?;
    for tensor in file.into_tensors().map_err(|error| error.to_string())? {
        if tensor.dtype != DType::F32 {
            return Err(format!("tensor {} is of type {:?}, expected F32", tensor.name, tensor.dtype));
        }
    }
    Ok(())
}
