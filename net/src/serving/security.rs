//! How an endpoint is protected: with TLS, with tokens, or explicitly not at all.

use super::files::{FileError, Stamp, read, read_identity, stamp};
use super::tokens::Tokens;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tonic::transport::{Certificate, Identity, Server, ServerTlsConfig};

/// How an endpoint is protected. The default protects nothing, which suffices only on a loopback address.
#[derive(Debug, Clone, Default)]
pub struct Security {
    /// TLS with the endpoint's certificate; `None` serves without TLS.
    pub tls: Option<ServerTls>,
    /// Accepted tokens; `None` accepts all callers.
    pub tokens: Option<Tokens>,
    /// Whether to serve other machines without TLS (`--insecure`).
    pub insecure: bool,
    /// Origins on other hosts whose web pages may call, such as `https://studio.example` (`--allow-origin`).
    pub origins: Vec<String>,
}

/// Why TLS cannot be set up for an endpoint or a client.
#[derive(Debug, thiserror::Error)]
pub enum SecurityError {
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The certificate, the key or the authority cannot be used.
    #[error("the TLS files cannot be used: {0}")]
    Tls(String),
}

/// Converts an error of tonic, whose sources contain the actual reason.
pub(crate) fn tls_error(error: &tonic::transport::Error) -> SecurityError {
    let mut text = error.to_string();
    let mut source = std::error::Error::source(error);
    while let Some(error) = source {
        text += &format!(": {error}");
        source = error.source();
    }
    SecurityError::Tls(text)
}

/// Certificate and key of an endpoint, and the authority that clients' certificates are verified with.
#[derive(Clone)]
pub struct ServerTls {
    identity: Identity,
    client_authority: Option<Certificate>,
    files: Arc<TlsFiles>,
    stamps: Vec<Stamp>,
}

/// The files of [`ServerTls`].
struct TlsFiles {
    certificate: PathBuf,
    key: PathBuf,
    client_authority: Option<PathBuf>,
}

impl TlsFiles {
    fn stamps(&self) -> Vec<Stamp> {
        [&self.certificate, &self.key].into_iter().chain(&self.client_authority).map(|path| stamp(path)).collect()
    }
}

impl fmt::Debug for ServerTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ServerTls").field("verifies_clients", &self.client_authority.is_some()).finish_non_exhaustive()
    }
}

impl ServerTls {
    /// Reads a certificate chain, its key and, if clients must present certificates, the authority that issues them;
    /// all PEM.
    pub fn load(certificate: &Path, key: &Path, client_authority: Option<&Path>) -> Result<Self, SecurityError> {
        let files = TlsFiles {
            certificate: certificate.to_owned(),
            key: key.to_owned(),
            client_authority: client_authority.map(Path::to_owned),
        };
        Self::read(Arc::new(files))
    }

    fn read(files: Arc<TlsFiles>) -> Result<Self, SecurityError> {
        // Taken before reading, so that a file that changes meanwhile is read again.
        let stamps = files.stamps();
        let client_authority =
            files.client_authority.as_deref().map(|path| read(path).map(Certificate::from_pem)).transpose()?;
        let tls = Self { identity: read_identity(&files.certificate, &files.key)?, client_authority, files, stamps };
        Server::builder().tls_config(tls.config(Duration::ZERO)).map_err(|error| tls_error(&error))?;
        Ok(tls)
    }

    /// Reloads the files if one of them has changed since the last call. Files that cannot be used are not taken, for
    /// example while only one of certificate and key has been replaced.
    pub(super) fn renew(&mut self) -> Option<Result<(), SecurityError>> {
        let stamps = self.files.stamps();
        if stamps == self.stamps {
            return None;
        }
        self.stamps = stamps;
        Some(Self::read(self.files.clone()).map(|renewed| *self = renewed))
    }

    pub(super) fn config(&self, handshake_timeout: Duration) -> ServerTlsConfig {
        let config = ServerTlsConfig::new().identity(self.identity.clone()).timeout(handshake_timeout);
        match &self.client_authority {
            Some(authority) => config.client_ca_root(authority.clone()),
            None => config,
        }
    }
}
