//! How an endpoint is protected: TLS, tokens, or openly not at all.

use super::files::{FileError, read, read_identity};
use super::tokens::Tokens;
use std::fmt;
use std::path::Path;
use std::time::Duration;
use tonic::transport::{Certificate, Identity, Server, ServerTlsConfig};

/// How an endpoint is protected. The default is enough on a loopback address only.
#[derive(Debug, Clone, Default)]
pub struct Security {
    /// Certificate, key and whom to ask for a certificate of their own.
    pub tls: Option<ServerTls>,
    /// Who may call; without tokens everybody may.
    pub tokens: Option<Tokens>,
    /// Serve other machines without TLS (`--insecure`).
    pub insecure: bool,
    /// Web pages from other hosts that may call, such as `https://studio.example` (`--allow-origin`).
    pub origins: Vec<String>,
}

/// Why an endpoint or a client cannot be protected as asked.
#[derive(Debug, thiserror::Error)]
pub enum SecurityError {
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// Certificate, key or authority are no use.
    #[error("the TLS files cannot be used: {0}")]
    Tls(String),
}

/// An error of tonic's with what lies below it, which is where the reason is.
pub(crate) fn tls_error(error: &tonic::transport::Error) -> SecurityError {
    let mut text = error.to_string();
    let mut source = std::error::Error::source(error);
    while let Some(error) = source {
        text += &format!(": {error}");
        source = error.source();
    }
    SecurityError::Tls(text)
}

/// What an endpoint needs for TLS.
#[derive(Clone)]
pub struct ServerTls {
    identity: Identity,
    client_authority: Option<Certificate>,
}

impl fmt::Debug for ServerTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ServerTls").field("asks_clients", &self.client_authority.is_some()).finish_non_exhaustive()
    }
}

impl ServerTls {
    /// Reads a certificate chain, its key, and the authority that every client must show a certificate of, all PEM.
    ///
    /// # Errors
    /// If one cannot be read, or they do not make a TLS server.
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
