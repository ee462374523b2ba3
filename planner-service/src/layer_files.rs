//! The layers of designers on disk: one file for each layer, in a folder for each level.
//!
//! Layers are user data that nothing can rebuild. Each is written to a new file that replaces the old one, so that a
//! full disk or a power failure leaves the old layer. One damaged file does not affect other layers. Files begin with
//! a checksum. A file that cannot be decoded is kept and reported.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use surefoot_net::durable;
use surefoot_planner::edits::Layer;
use surefoot_planner::store::{
    DamagedLayer, LevelId, LevelLayers, StoreError, StoreErrorKind, decode_layer, encode_layer,
};

/// Extension of the files.
const EXTENSION: &str = "layer";
/// Maximum size of a file, in bytes; the largest valid layers take less than a tenth of it.
const MAX_BYTES: u64 = 16 << 20;

/// The folder with all layers.
#[derive(Debug)]
pub(crate) struct LayerFiles {
    folder: PathBuf,
}

impl LayerFiles {
    /// Opens or creates the folder `layers` in `folder`.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let folder = folder.join("layers");
        fs::create_dir_all(&folder).map_err(fail(&folder, "the folder of the layers cannot be created"))?;
        Ok(Self { folder })
    }

    /// Returns the layers of a level by name.
    pub fn read(&self, level: &LevelId) -> Result<LevelLayers, StoreError> {
        let folder = self.folder_of(level);
        let files = match list(&folder) {
            Ok(files) => files,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(LevelLayers::default()),
            Err(error) => return Err(fail(&folder, "the layers of the level cannot be read")(error)),
        };
        let mut found = LevelLayers::default();
        for path in files {
            let bytes = match read_file(&path) {
                Ok(bytes) => bytes,
                // Removed since it was listed.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                Err(error) => return Err(fail(&path, "the layer cannot be read")(error)),
            };
            let name = name_of(&path);
            let layer = decode_layer(&bytes).and_then(|layer| match layer.name == name {
                true => Ok(layer),
                false => Err(format!("it holds the layer `{}`", layer.name)),
            });
            match layer {
                Ok(layer) => found.layers.push(layer),
                Err(reason) => found.damaged.push(DamagedLayer { name, place: path.display().to_string(), reason }),
            }
        }
        found.layers.sort_by(|a, b| a.name.cmp(&b.name));
        found.damaged.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(found)
    }

    /// Stores a layer in place of the one with the same name; a layer without edits is removed. If that fails, the
    /// layers are as before.
    pub fn put(&self, level: &LevelId, layer: &Layer) -> Result<(), StoreError> {
        let path = self.path_of(level, layer.name.as_bytes());
        if !layer.edits.is_empty() {
            return replace(&path, &encode_layer(layer)).map_err(fail(&path, "the layer cannot be written"));
        }
        match durable::remove(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(fail(&path, "the layer cannot be removed")(error)),
            _ => Ok(()),
        }
    }

    /// Adds an encoded layer as it is, unless there is a file of its name.
    pub fn add(&self, level: &LevelId, name: &[u8], bytes: &[u8]) -> Result<(), StoreError> {
        let path = self.path_of(level, name);
        match path.try_exists() {
            Ok(true) => Ok(()),
            Ok(false) => replace(&path, bytes).map_err(fail(&path, "the layer cannot be moved out of the graph cache")),
            Err(error) => Err(fail(&path, "the layer cannot be read")(error)),
        }
    }

    fn folder_of(&self, level: &LevelId) -> PathBuf {
        let digits: String = level.0.iter().map(|byte| format!("{byte:02x}")).collect();
        self.folder.join(digits)
    }

    fn path_of(&self, level: &LevelId, name: &[u8]) -> PathBuf {
        self.folder_of(level).join(format!("{}.{EXTENSION}", escape(name)))
    }
}

fn fail(path: &Path, what: &str) -> impl FnOnce(io::Error) -> StoreError {
    let (place, what) = (path.display().to_string(), what.to_owned());
    move |error| StoreError {
        place,
        reason: format!("{what}: {error}; check its permissions and the space on its disk"),
        kind: StoreErrorKind::Refused,
    }
}

/// Lists the files of layers in a folder, and nothing else.
fn list(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    Ok(paths.into_iter().filter(|path| path.extension().is_some_and(|extension| extension == EXTENSION)).collect())
}

/// Reads a file. One that is too large reads as empty, which no layer is.
fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    if fs::metadata(path)?.len() > MAX_BYTES { Ok(Vec::new()) } else { fs::read(path) }
}

/// Writes the file of a layer, and its level's folder if that does not exist yet.
fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    fs::create_dir_all(path.parent().expect("a layer is in the folder of its level"))?;
    durable::replace(path, bytes)
}

/// Returns the name as part of a file name: lower-case letters, digits, `-` and `_` stand for themselves, so that no
/// two names differ only in case.
fn escape(name: &[u8]) -> String {
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"-_".contains(&byte);
    name.iter()
        .map(|&byte| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

/// Returns the name of the layer that a file is named after.
fn name_of(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut parts = stem.split('%');
    let mut bytes = parts.next().unwrap_or_default().as_bytes().to_vec();
    for part in parts {
        let code = part.get(..2).and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(code.unwrap_or(b'%'));
        bytes.extend(&part.as_bytes()[if code.is_some() { 2 } else { 0 }..]);
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_a_file_of_its_own_and_comes_back() {
        let names = ["night", "Night", "a/b", "..", "50 %", "%41", "A", "Nächte", "con.layer"];
        let mut files = std::collections::BTreeSet::new();
        for name in names {
            let file = format!("{}.{EXTENSION}", escape(name.as_bytes()));
            assert_eq!(name_of(Path::new(&file)), name);
            assert!(files.insert(file.to_lowercase()), "{name}");
        }
    }
}
