//! Client connections: the servers they trust, and the credentials they send.

use crate::secret::Secret;
use crate::serving::security::{SecurityError, tls_error};
use crate::serving::{FileError, read, read_identity};
use http::header::AUTHORIZATION;
use http::{HeaderValue, Request};
use std::fmt;
use std::path::{Path, PathBuf};
use std::task::{Context, Poll};
use std::time::Duration;
use tonic::body::Body;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Error, Identity};
use tower_service::Service;

/// Longest time that connecting may take.
const CONNECT_LIMIT: Duration = Duration::from_secs(3);
/// Interval between pings, and timeout of a ping. A dead server is noticed after their sum.
const KEEPALIVE: (Duration, Duration) = (Duration::from_secs(20), Duration::from_secs(10));

/// Why a connection cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The address is not a URI.
    #[error("{0} is not a URI such as http://127.0.0.1:7600")]
    Uri(String),
    /// A header cannot carry the token.
    #[error("the token may contain only visible ASCII characters")]
    Token,
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// TLS cannot be set up with the given files.
    #[error(transparent)]
    Security(#[from] SecurityError),
}

/// PEM files for TLS.
#[derive(Debug, Clone, Default)]
pub struct ClientTlsFiles {
    /// Authority that must have issued the server's certificate; default: any that the system trusts.
    pub authority: Option<PathBuf>,
    /// Certificate and key that the client presents; default: none.
    pub identity: Option<(PathBuf, PathBuf)>,
    /// Name that the server's certificate must be valid for; default: the host of the URI.
    pub server_name: Option<String>,
}

/// Credentials of a client; the default has neither a token nor a certificate.
#[derive(Clone, Default)]
pub struct Credentials {
    bearer: Option<HeaderValue>,
    authority: Option<Certificate>,
    identity: Option<Identity>,
    server_name: Option<String>,
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("has_token", &self.bearer.is_some())
            .field("has_identity", &self.identity.is_some())
            .finish_non_exhaustive()
    }
}

impl Credentials {
    /// Reads the TLS files and prepares the token for sending.
    ///
    /// # Errors
    /// If a file cannot be read, or a header cannot carry the token.
    pub fn load(token: Option<&Secret>, files: &ClientTlsFiles) -> Result<Self, LinkError> {
        let identity = files.identity.as_ref().map(|(certificate, key)| read_identity(certificate, key)).transpose()?;
        let authority = |path: &PathBuf| Ok::<_, FileError>(Certificate::from_pem(read(Path::new(path))?));
        Ok(Self {
            bearer: token.map(bearer).transpose()?,
            authority: files.authority.as_ref().map(authority).transpose()?,
            identity,
            server_name: files.server_name.clone(),
        })
    }

    /// Prepares connections to `uri` with these credentials; `https://` means TLS.
    ///
    /// # Errors
    /// If `uri` is not a URI, or TLS cannot be set up.
    pub fn dial(&self, uri: &str) -> Result<Dialer, LinkError> {
        let endpoint = Endpoint::from_shared(uri.to_owned()).map_err(|_| LinkError::Uri(uri.to_owned()))?;
        let mut endpoint = endpoint
            .connect_timeout(CONNECT_LIMIT)
            .tcp_nodelay(true)
            .http2_keep_alive_interval(KEEPALIVE.0)
            .keep_alive_timeout(KEEPALIVE.1);
        if endpoint.uri().scheme_str() == Some("https") {
            endpoint = endpoint.tls_config(self.tls()).map_err(|error| tls_error(&error))?;
        }
        Ok(Dialer { endpoint, bearer: self.bearer.clone() })
    }

    fn tls(&self) -> ClientTlsConfig {
        let mut tls = match &self.authority {
            Some(authority) => ClientTlsConfig::new().ca_certificate(authority.clone()),
            None => ClientTlsConfig::new().with_native_roots(),
        };
        if let Some(identity) = &self.identity {
            tls = tls.identity(identity.clone());
        }
        match &self.server_name {
            Some(name) => tls.domain_name(name.clone()),
            None => tls,
        }
    }
}

fn bearer(token: &Secret) -> Result<HeaderValue, LinkError> {
    let mut value = HeaderValue::try_from(format!("Bearer {}", token.reveal())).map_err(|_| LinkError::Token)?;
    value.set_sensitive(true);
    Ok(value)
}

/// Connects to one address; it can be used any number of times.
#[derive(Debug, Clone)]
pub struct Dialer {
    endpoint: Endpoint,
    bearer: Option<HeaderValue>,
}

impl Dialer {
    /// Connects at once.
    ///
    /// # Errors
    /// If the server does not answer, or its certificate is not trusted.
    pub async fn connect(&self) -> Result<Link, Error> {
        Ok(Link { channel: self.endpoint.connect().await?, bearer: self.bearer.clone() })
    }

    /// Returns a link that connects on the first call, and again whenever the connection is lost.
    pub fn connect_lazy(&self) -> Link {
        Link { channel: self.endpoint.connect_lazy(), bearer: self.bearer.clone() }
    }
}

/// A connection for generated clients, which adds the token, if there is one, to every call.
#[derive(Debug, Clone)]
pub struct Link {
    channel: Channel,
    bearer: Option<HeaderValue>,
}

impl From<Channel> for Link {
    fn from(channel: Channel) -> Self {
        Self { channel, bearer: None }
    }
}

impl Service<Request<Body>> for Link {
    type Response = http::Response<Body>;
    type Error = Error;
    type Future = <Channel as Service<Request<Body>>>::Future;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Error>> {
        Service::poll_ready(&mut self.channel, cx)
    }

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        if let Some(bearer) = &self.bearer {
            request.headers_mut().insert(AUTHORIZATION, bearer.clone());
        }
        self.channel.call(request)
    }
}
