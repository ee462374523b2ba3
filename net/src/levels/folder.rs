//! Levels in folders of this machine: the file of a level, its sidecar, and the files that it refers to.
//!
//! For programs that read files of their user: the command line and the Python package. Services get levels as bytes,
//! and read no file that a client names.

use std::io;
use std::path::{Component, Path, PathBuf};
use surefoot_levels::{Files, ImportError, ImportOptions, Imported};

/// Most bytes of a file that a level refers to.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Why a level's file cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum LevelFileError {
    /// The level or its sidecar cannot be read.
    #[error("cannot read {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// The name of the file ends as no level's does.
    #[error("{} is not a .glb, .gltf, .obj or .zip file", .0.display())]
    Extension(PathBuf),
    /// The content cannot be used.
    #[error("cannot import {}", .path.display())]
    Import {
        /// The level.
        path: PathBuf,
        /// The reason.
        source: ImportError,
    },
}

/// Format of a level.
enum Format {
    Gltf,
    Obj,
    /// One of them with the files that it refers to.
    Zip,
}

impl Format {
    /// The format that the name of a file tells; `None` for saved maps and everything else.
    fn of(file: &Path) -> Option<Self> {
        match file.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "glb" | "gltf" => Some(Self::Gltf),
            "obj" => Some(Self::Obj),
            "zip" => Some(Self::Zip),
            _ => None,
        }
    }
}

/// Whether a file has the name of a level, which is imported. Saved maps are no levels.
pub fn is_level(file: &Path) -> bool {
    Format::of(file).is_some()
}

/// Imports the level in a file, with this sidecar, or else with `LEVEL.surefoot.json` beside it if that exists.
///
/// # Errors
/// If the level or the sidecar cannot be read or used.
pub fn import_file(level: &Path, sidecar: Option<&Path>, options: &ImportOptions) -> Result<Imported, LevelFileError> {
    let format = Format::of(level).ok_or_else(|| LevelFileError::Extension(level.to_owned()))?;
    let bytes = std::fs::read(level).map_err(unread(level))?;
    let beside = level.with_extension("surefoot.json");
    let sidecar = sidecar.or_else(|| beside.exists().then_some(beside.as_path()));
    let sidecar = sidecar.map(|path| std::fs::read_to_string(path).map_err(unread(path))).transpose()?;
    let imported = match format {
        Format::Gltf => surefoot_levels::import_gltf(&bytes, sidecar.as_deref(), options, &LevelFolder::of(level)),
        Format::Obj => surefoot_levels::import_obj(&bytes, sidecar.as_deref(), options),
        Format::Zip => surefoot_levels::import_zip(&bytes, sidecar.as_deref(), options),
    };
    imported.map_err(|source| LevelFileError::Import { path: level.to_owned(), source })
}

fn unread(path: &Path) -> impl FnOnce(io::Error) -> LevelFileError {
    |source| LevelFileError::Read { path: path.to_owned(), source }
}

/// The folder of a level. The files that the level refers to are read from it and from nowhere else.
pub struct LevelFolder(PathBuf);

impl LevelFolder {
    /// The folder that has the file of a level.
    pub fn of(level: &Path) -> Self {
        let folder = level.parent().filter(|it| !it.as_os_str().is_empty());
        Self(folder.unwrap_or(Path::new(".")).to_owned())
    }

    /// The path of a file without links. Fails if it is outside the folder.
    fn find(&self, path: &str) -> Result<PathBuf, String> {
        let outside = || format!("`{path}` is outside the level's folder: put it beside the level");
        let mut depth = 0_usize;
        for part in Path::new(path).components() {
            depth = match part {
                Component::Normal(_) => depth + 1,
                Component::CurDir => depth,
                Component::ParentDir => depth.checked_sub(1).ok_or_else(outside)?,
                Component::Prefix(_) | Component::RootDir => return Err(outside()),
            };
        }
        let real = |it: &Path| it.canonicalize().map_err(|error| unreadable(path, &error));
        let (folder, file) = (real(&self.0)?, real(&self.0.join(path))?);
        // A link may lead elsewhere.
        if file.starts_with(folder) { Ok(file) } else { Err(outside()) }
    }
}

impl Files for LevelFolder {
    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        let file = self.find(path)?;
        let about = file.metadata().map_err(|error| unreadable(path, &error))?;
        // Reading a pipe may wait forever.
        if !about.is_file() {
            return Err(format!("`{path}` is not a file"));
        }
        if about.len() > MAX_FILE_BYTES {
            return Err(format!("`{path}` has {} bytes, at most {MAX_FILE_BYTES} are read", about.len()));
        }
        std::fs::read(&file).map_err(|error| unreadable(path, &error))
    }
}

fn unreadable(path: &str, error: &io::Error) -> String {
    format!("cannot read `{path}` in the level's folder: {error}")
}
