//! How an endpoint is protected: with TLS, with tokens, or explicitly not at all.

use super::files::{FileError, read, read_identity};
use super::tokens::Tokens;
use std::fmt;
use std::path::Path;
use std::time::Duration;
use tonic::transport::{Certificate, Identity, Server, ServerTlsConfig};

/// How an endpoint is protected. The default protects nothing and suffices only on a loopback address.
#[derive(Debug, Clone, Default)]
pub struct Security {
    /// TLS with the endpoint's certificate; `None` serves without TLS.
    pub tls: Option<ServerTls>,
    /// Tokens of those who may call; `None` lets everybody call.
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

/// Converts an error of tonic, whose chain of sources holds the actual reason.
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
}

impl fmt::Debug for ServerTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ServerTls").field("verifies_clients", &self.client_authority.is_some()).finish_non_exhaustive()
    }
}

impl ServerTls {
    /// Reads a certificate chain, its key and, if clients must present certificates, the authority that issues them; all PEM.
    ///
    /// # Errors
    /// If a file cannot be read, or a TLS server cannot be set up with the files.
    pub fn load(certificate: &Path, key: &Path, client_authority: Option<&Path>) -> Result<Self, SecurityError> {
        let client_authority = client_authority.map(|path| read(path).map(Certificate::from_pem)).transpose()?;
        let tls = Self { identity: read_identity(certificate, key)?, client_authority };
        Server::builder().tls_config(tls.config(Duration::ZERO)).map_err(|error| tls_error(&error))?;
        Ok(tls)
    }

    pub(super) fn config(&self, handshake_timeout: Duration) -> ServerTlsConfig {
        let config = ServerTlsConfig::new().identity(self.identity.clone()).timeout(handshake_timeout);
        match &self.client_authority {
            Some(authority) => config.client_ca_root(authority.clone()),
            None => config,
        }
    }
}
