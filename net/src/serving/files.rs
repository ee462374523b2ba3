//! Files that protect a connection: certificates, keys, tokens.

use std::path::{Path, PathBuf};
use tonic::transport::Identity;

/// A file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read {}: {source}", path.display())]
pub struct FileError {
    /// Which.
    pub path: PathBuf,
    /// What the system said.
    pub source: std::io::Error,
}

/// Reads a file, or says which one cannot be read.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    std::fs::read(path).map_err(|source| FileError { path: path.to_owned(), source })
}

/// Reads a certificate chain and its key, both PEM.
pub(crate) fn read_identity(certificate: &Path, key: &Path) -> Result<Identity, FileError> {
    Ok(Identity::from_pem(read(certificate)?, read(key)?))
}
