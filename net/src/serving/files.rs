//! Reads certificates, keys and tokens.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use tonic::transport::Identity;

/// Period of checks for changed files.
pub(crate) const RELOAD_PERIOD: Duration = Duration::from_secs(2);

/// A file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read {}: {source}", path.display())]
pub struct FileError {
    /// Path of the file.
    pub path: PathBuf,
    /// Error of the operating system.
    pub source: std::io::Error,
}

/// Reads a whole file; the error names its path.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    std::fs::read(path).map_err(|source| FileError { path: path.to_owned(), source })
}

/// Reads a certificate chain and its key, both PEM.
pub(crate) fn read_identity(certificate: &Path, key: &Path) -> Result<Identity, FileError> {
    Ok(Identity::from_pem(read(certificate)?, read(key)?))
}

/// Modification time and length of a file; `None` if it cannot be read.
pub(crate) type Stamp = Option<(SystemTime, u64)>;

pub(crate) fn stamp(path: &Path) -> Stamp {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}
