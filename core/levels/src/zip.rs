//! A level and its files in one `.zip`.

use crate::container::Files;
use crate::faults::ImportError;
use std::cell::RefCell;
use std::io::{Cursor, Read};
use zip::ZipArchive;

/// Most bytes of a file in an archive.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Endings of files that are levels, the one that is preferred first.
const LEVELS: [&str; 3] = [".gltf", ".glb", ".obj"];
const SIDECAR: &str = ".surefoot.json";

/// A `.zip` of one level and the files that it refers to.
pub(super) struct Zip<'a> {
    archive: RefCell<ZipArchive<Cursor<&'a [u8]>>>,
    /// Path of the level in the archive.
    level: String,
}

impl<'a> Zip<'a> {
    /// First bytes of a `.zip`.
    pub(super) const MAGIC: &'static [u8] = b"PK\x03\x04";

    /// Opens an archive and finds the level in it.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| ImportError::Zip(error.to_string()))?;
        // Names that cannot be read are no level's.
        let names: Vec<String> = archive.file_names().flatten().map(|name| name.into_owned()).collect();
        // What macOS adds is no level.
        let is_level = |name: &&String, end: &str| {
            let name = name.to_lowercase();
            let file = name.rsplit('/').next().unwrap_or(&name);
            name.ends_with(end) && !name.starts_with("__macosx/") && !file.starts_with("._")
        };
        let found = LEVELS.iter().find_map(|end| {
            let levels: Vec<&String> = names.iter().filter(|name| is_level(name, end)).collect();
            (!levels.is_empty()).then_some(levels)
        });
        match found.as_deref() {
            Some([level]) => Ok(Self { level: (*level).clone(), archive: RefCell::new(archive) }),
            Some([one, other, ..]) => {
                Err(ImportError::Zip(format!("it holds several levels, such as `{one}` and `{other}`: pack one level")))
            }
            _ => Err(ImportError::Zip("it holds no .gltf, .glb or .obj file".to_owned())),
        }
    }

    /// The level.
    pub(super) fn level(&self) -> Result<Vec<u8>, ImportError> {
        self.content(&self.level).map_err(ImportError::Zip)
    }

    /// The sidecar beside the level; `None` if there is none.
    pub(super) fn sidecar(&self) -> Result<Option<String>, ImportError> {
        let stem = self.level.rsplit_once('.').map_or(self.level.as_str(), |(stem, _)| stem);
        let path = format!("{stem}{SIDECAR}");
        if self.archive.borrow().index_for_name(&path).is_none() {
            return Ok(None);
        }
        let bytes = self.content(&path).map_err(ImportError::Zip)?;
        String::from_utf8(bytes).map(Some).map_err(|_| ImportError::Sidecar("it is not UTF-8".to_owned()))
    }

    fn content(&self, path: &str) -> Result<Vec<u8>, String> {
        let mut archive = self.archive.borrow_mut();
        let file = archive.by_name(path).map_err(|error| format!("`{path}`: {error}"))?;
        let len = file.size();
        if len > MAX_FILE_BYTES {
            return Err(format!("`{path}` has more than {} MB", MAX_FILE_BYTES >> 20));
        }
        let mut bytes = Vec::new();
        // Callers have reserved memory for the size in the archive, which may be wrong.
        let read = file.take(len + 1).read_to_end(&mut bytes).map_err(|error| format!("`{path}`: {error}"))?;
        if read as u64 > len {
            return Err(format!("`{path}` is longer than the archive says: pack it again"));
        }
        Ok(bytes)
    }
}

/// Whether a level is a `.zip`.
pub fn is_zip(level: &[u8]) -> bool {
    level.starts_with(Zip::MAGIC)
}

/// Number of bytes to which a level unpacks: 0 unless it is a `.zip`.
///
/// # Errors
/// If the archive cannot be read.
pub fn unpacked_bytes(level: &[u8]) -> Result<u64, ImportError> {
    if !is_zip(level) {
        return Ok(0);
    }
    let mut archive = ZipArchive::new(Cursor::new(level)).map_err(|error| ImportError::Zip(error.to_string()))?;
    let count = archive.len();
    let len = |idx| archive.by_index_raw(idx).map_or(0, |file| file.size());
    Ok((0..count).map(len).fold(0, u64::saturating_add))
}

impl Files for Zip<'_> {
    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        let folder = self.level.rsplit_once('/').map_or("", |(folder, _)| folder);
        let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
        for part in path.split('/') {
            match part {
                "" | "." => {}
                ".." => {
                    parts.pop().ok_or("it is outside the .zip")?;
                }
                part => parts.push(part),
            }
        }
        self.content(&parts.join("/"))
    }
}
