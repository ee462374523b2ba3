//! Client connections: the servers they trust, and the credentials they send.
//!
//! Credential files are reloaded when they change. The next call of a link uses a new connection; calls in progress
//! stay on the old one.

use crate::secret::Secret;
use crate::serving::security::{SecurityError, tls_error};
use crate::serving::{FileError, RELOAD_PERIOD, Stamp, read, read_identity, stamp};
use http::header::AUTHORIZATION;
use http::{HeaderValue, Request};
use parking_lot::Mutex;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tonic::body::Body;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Error, Identity};
use tower_service::Service;
use tracing::{info, warn};

/// Longest time that connecting may take.
const CONNECT_LIMIT: Duration = Duration::from_secs(3);
/// Interval between pings, and timeout of a ping. A dead server is detected after their sum.
const KEEPALIVE: (Duration, Duration) = (Duration::from_secs(20), Duration::from_secs(10));

/// Why a connection cannot be set up.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum LinkError {
    #[error("{0} is not a URI such as http://127.0.0.1:7600")]
    Uri(String),
    #[error("the token may contain only visible ASCII characters")]
    Token,
    #[error(transparent)]
    File(#[from] FileError),
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

/// Where credentials come from.
#[derive(Default)]
struct Sources {
    /// A token that never changes.
    bearer: Option<HeaderValue>,
    token: Option<PathBuf>,
    tls: ClientTlsFiles,
}

impl Sources {
    fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let identity = self.tls.identity.iter().flat_map(|(certificate, key)| [certificate, key]);
        self.token.iter().chain(&self.tls.authority).chain(identity)
    }

    fn stamps(&self) -> Vec<Stamp> {
        self.files().map(|path| stamp(path)).collect()
    }

    fn read(&self) -> Result<Parts, LinkError> {
        let identity =
            self.tls.identity.as_ref().map(|(certificate, key)| read_identity(certificate, key)).transpose()?;
        let authority = |path: &PathBuf| Ok::<_, FileError>(Certificate::from_pem(read(path)?));
        let bearer = match &self.token {
            Some(path) => Some(bearer(&Secret::new(String::from_utf8_lossy(&read(path)?).trim()))?),
            None => self.bearer.clone(),
        };
        Ok(Parts { bearer, authority: self.tls.authority.as_ref().map(authority).transpose()?, identity })
    }
}

/// Contents of the credential files.
#[derive(Default)]
struct Parts {
    bearer: Option<HeaderValue>,
    authority: Option<Certificate>,
    identity: Option<Identity>,
}

impl fmt::Debug for Parts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("has_token", &self.bearer.is_some())
            .field("has_identity", &self.identity.is_some())
            .finish_non_exhaustive()
    }
}

struct Loaded {
    parts: Arc<Parts>,
    stamps: Vec<Stamp>,
    looked: Instant,
}

/// Credentials of a client; the default has neither a token nor a certificate. Clones share them, reloads included.
#[derive(Clone)]
pub struct Credentials {
    sources: Arc<Sources>,
    loaded: Arc<Mutex<Loaded>>,
}

impl Default for Credentials {
    fn default() -> Self {
        Self::of(Sources::default(), Parts::default(), Vec::new())
    }
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.loaded.lock().parts.fmt(f)
    }
}

impl Credentials {
    /// Reads the TLS files and prepares the token for sending.
    pub fn load(token: Option<&Secret>, files: &ClientTlsFiles) -> Result<Self, LinkError> {
        Self::from_sources(Sources { bearer: token.map(bearer).transpose()?, token: None, tls: files.clone() })
    }

    /// Reads the TLS files and the secret of a token in the file `token`.
    pub fn load_with_token_file(token: &Path, files: &ClientTlsFiles) -> Result<Self, LinkError> {
        Self::from_sources(Sources { bearer: None, token: Some(token.to_owned()), tls: files.clone() })
    }

    fn from_sources(sources: Sources) -> Result<Self, LinkError> {
        // Taken before reading, so that a file that changes meanwhile is read again.
        let stamps = sources.stamps();
        let parts = sources.read()?;
        Ok(Self::of(sources, parts, stamps))
    }

    fn of(sources: Sources, parts: Parts, stamps: Vec<Stamp>) -> Self {
        let loaded = Loaded { parts: Arc::new(parts), stamps, looked: Instant::now() };
        Self { sources: Arc::new(sources), loaded: Arc::new(Mutex::new(loaded)) }
    }

    /// Whether the credentials can change.
    fn have_files(&self) -> bool {
        self.sources.files().next().is_some()
    }

    /// The current credentials. Changed files are reloaded first; if they cannot be used, the previous credentials stay
    /// in use.
    fn current(&self) -> Arc<Parts> {
        let mut loaded = self.loaded.lock();
        if self.have_files() && loaded.looked.elapsed() >= RELOAD_PERIOD {
            loaded.looked = Instant::now();
            let stamps = self.sources.stamps();
            if stamps != loaded.stamps {
                loaded.stamps = stamps;
                match self.sources.read() {
                    Ok(parts) => {
                        loaded.parts = Arc::new(parts);
                        info!("client: credentials reloaded");
                    }
                    Err(error) => {
                        warn!(%error, "client: cannot use the changed files; the old credentials stay")
                    }
                }
            }
        }
        loaded.parts.clone()
    }

    /// Prepares connections to `uri` with these credentials; `https://` means TLS.
    pub fn dial(&self, uri: &str) -> Result<Dialer, LinkError> {
        let parts = self.current();
        let endpoint = self.endpoint(uri, &parts)?;
        let target = Target { tried: parts.clone(), parts, endpoint };
        Ok(Dialer { uri: uri.to_owned(), credentials: self.clone(), target: Arc::new(Mutex::new(target)) })
    }

    fn endpoint(&self, uri: &str, parts: &Parts) -> Result<Endpoint, LinkError> {
        let endpoint = Endpoint::from_shared(uri.to_owned()).map_err(|_| LinkError::Uri(uri.to_owned()))?;
        let endpoint = endpoint
            .connect_timeout(CONNECT_LIMIT)
            .tcp_nodelay(true)
            .http2_keep_alive_interval(KEEPALIVE.0)
            .keep_alive_timeout(KEEPALIVE.1);
        if endpoint.uri().scheme_str() != Some("https") {
            return Ok(endpoint);
        }
        Ok(endpoint.tls_config(self.tls(parts)).map_err(|error| tls_error(&error))?)
    }

    fn tls(&self, parts: &Parts) -> ClientTlsConfig {
        let mut tls = match &parts.authority {
            Some(authority) => ClientTlsConfig::new().ca_certificate(authority.clone()),
            None => ClientTlsConfig::new().with_native_roots(),
        };
        if let Some(identity) = &parts.identity {
            tls = tls.identity(identity.clone());
        }
        match &self.sources.tls.server_name {
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

/// The endpoint and credentials that a dialer connects with.
#[derive(Debug, Clone)]
struct Target {
    parts: Arc<Parts>,
    endpoint: Endpoint,
    /// Credentials of the last attempt to switch.
    tried: Arc<Parts>,
}

/// Connects to one address; it can be used any number of times.
#[derive(Debug, Clone)]
pub struct Dialer {
    uri: String,
    credentials: Credentials,
    target: Arc<Mutex<Target>>,
}

impl Dialer {
    fn target(&self) -> Target {
        let parts = self.credentials.current();
        let mut target = self.target.lock();
        if !Arc::ptr_eq(&target.tried, &parts) {
            target.tried = parts.clone();
            match self.credentials.endpoint(&self.uri, &parts) {
                Ok(endpoint) => (target.parts, target.endpoint) = (parts, endpoint),
                // Only one of certificate and key may have been replaced yet.
                Err(error) => {
                    warn!(%error, uri = self.uri, "client: cannot use the new credentials; the old ones stay")
                }
            }
        }
        target.clone()
    }

    fn link(&self, Target { parts, .. }: Target, channel: Channel) -> Link {
        let renewal = self.credentials.have_files().then(|| Renewal {
            dialer: self.clone(),
            parts: parts.clone(),
            latest: Arc::new(Mutex::new((parts.clone(), channel.clone()))),
        });
        Link { channel, bearer: parts.bearer.clone(), renewal }
    }

    /// Connects now.
    pub async fn connect(&self) -> Result<Link, Error> {
        let target = self.target();
        let channel = target.endpoint.connect().await?;
        Ok(self.link(target, channel))
    }

    /// Returns a link that connects on the first call, and reconnects when the connection is lost.
    pub fn connect_lazy(&self) -> Link {
        let target = self.target();
        let channel = target.endpoint.connect_lazy();
        self.link(target, channel)
    }
}

/// A connection for generated clients. It adds the token, if there is one, to every call.
#[derive(Debug, Clone)]
pub struct Link {
    channel: Channel,
    bearer: Option<HeaderValue>,
    /// None for credentials that cannot change.
    renewal: Option<Renewal>,
}

/// How a link gets new credentials.
#[derive(Debug, Clone)]
struct Renewal {
    dialer: Dialer,
    /// Credentials of this link.
    parts: Arc<Parts>,
    /// The newest credentials and connection of any clone of the link.
    latest: Arc<Mutex<(Arc<Parts>, Channel)>>,
}

impl Link {
    fn renew(&mut self) {
        let Some(renewal) = &mut self.renewal else { return };
        let target = renewal.dialer.target();
        if Arc::ptr_eq(&target.parts, &renewal.parts) {
            return;
        }
        let mut latest = renewal.latest.lock();
        if !Arc::ptr_eq(&latest.0, &target.parts) {
            *latest = (target.parts.clone(), target.endpoint.connect_lazy());
        }
        self.channel = latest.1.clone();
        self.bearer = target.parts.bearer.clone();
        renewal.parts = target.parts;
    }
}

impl From<Channel> for Link {
    fn from(channel: Channel) -> Self {
        Self { channel, bearer: None, renewal: None }
    }
}

impl Service<Request<Body>> for Link {
    type Response = http::Response<Body>;
    type Error = Error;
    type Future = <Channel as Service<Request<Body>>>::Future;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Error>> {
        self.renew();
        Service::poll_ready(&mut self.channel, cx)
    }

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        if let Some(bearer) = &self.bearer {
            request.headers_mut().insert(AUTHORIZATION, bearer.clone());
        }
        self.channel.call(request)
    }
}
