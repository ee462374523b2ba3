//! Weights on disk: a burnpack file beside a JSON manifest that describes it.

pub use crate::manifest::MANIFEST_FILE;
use crate::manifest::{CheckpointError, Manifest, parse_manifest, read};
use crate::policy::Policy;
use std::io::Write;
use std::path::Path;

/// Name of the weights file inside a model's folder.
pub const WEIGHTS_FILE: &str = "weights.bpk";
/// Name of the new weights file until the manifest is written.
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
    fn policy(&self) -> Result<Policy, CheckpointError> {
        let path = Path::new("models").join(self.name).join(MANIFEST_FILE);
        Policy::from_bytes(parse_manifest(&path, self.manifest)?, self.weights)
    }
}

impl Policy {
    /// The general reactive policy that ships with the program.
    ///
    /// # Errors
    /// Only if the program was built from a damaged checkout.
    pub fn shipped() -> Result<Self, CheckpointError> {
        GENERAL_REACTIVE.policy()
    }

    /// The shipped policy `general-reactive` or `general-lstm`; `None` for other names.
    ///
    /// # Errors
    /// Only if the program was built from a damaged checkout.
    pub fn shipped_named(name: &str) -> Option<Result<Self, CheckpointError>> {
        let shipped = [GENERAL_REACTIVE, GENERAL_LSTM];
        shipped.iter().find(|shipped| shipped.name == name).map(Shipped::policy)
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
}

/// Reads the weights that a manifest describes from its folder.
fn weights(folder: &Path, manifest: &Manifest) -> Result<Vec<u8>, CheckpointError> {
    unfinished(folder, manifest).map_or_else(|| read(&folder.join(WEIGHTS_FILE)), Ok)
}

/// The weights of a save that was killed after it wrote this manifest: they still have the name of the next ones.
fn unfinished(folder: &Path, manifest: &Manifest) -> Option<Vec<u8>> {
    read(&folder.join(NEXT_WEIGHTS_FILE)).ok().filter(|next| manifest.check(next).is_ok())
}

/// Writes a model's folder. If the program is killed meanwhile, the folder holds the previous model or this one.
///
/// # Errors
/// If a file cannot be written.
pub fn save(folder: &Path, manifest: &Manifest, weights: &[u8]) -> Result<(), CheckpointError> {
    let text = serde_json::to_vec_pretty(manifest).expect("a manifest is plain data");
    std::fs::create_dir_all(folder).map_err(|source| CheckpointError::Io { path: folder.to_owned(), source })?;
    let (next, path) = (folder.join(NEXT_WEIGHTS_FILE), folder.join(WEIGHTS_FILE));
    let finish = || std::fs::rename(&next, &path).map_err(|source| CheckpointError::Io { path: path.clone(), source });
    if Manifest::load(folder).is_ok_and(|former| unfinished(folder, &former).is_some()) {
        finish()?;
    }
    write_atomically(&next, weights)?;
    write_atomically(&folder.join(MANIFEST_FILE), &text)?;
    finish()
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
