//! An endpoint: one address with its services, from bind to the end of the drain.

use super::connect::{self, Translator};
use super::gate::{self, Gate};
use super::generations::Generations;
use super::health::Health;
use super::incoming::{Counters, Incoming};
use super::limits::Limits;
use super::openapi;
use super::origin::Origins;
use super::revocation;
use super::security::Security;
use super::shutdown::Shutdown;
use super::tokens::Tokens;
use crate::memory::{DEFAULT_MAX_MEMORY_BYTES, MemoryBudget};
use axum::body::Bytes;
use axum::http::header::CONTENT_TYPE;
use axum::routing::{MethodRouter, get};
use std::future::Future;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::sleep;
use tonic::service::RoutesBuilder;
use tonic::transport::Server;
use tracing::{info, warn};

/// Largest header list of a request, bytes.
const MAX_HEADER_BYTES: u32 = 16 * 1024;
/// How long health checks are answered after the start of a shutdown, so that load balancers notice it.
const NOTICE: Duration = Duration::from_millis(250);
/// Longest duration of a shutdown: a silent peer must not keep a process alive.
const DRAIN_LIMIT: Duration = Duration::from_secs(5);

/// Why an endpoint cannot serve.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum ServeError {
    #[error("cannot listen on {address}")]
    Bind { address: SocketAddr, source: std::io::Error },
    #[error(
        "{0} can be reached from other machines: set --tls-cert and --tls-key, or --insecure to serve it without TLS"
    )]
    Exposed(SocketAddr),
    #[error("serving failed: {0}")]
    Transport(#[from] tonic::transport::Error),
    #[error("reflection cannot be set up: {0}")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// Limits and security of an endpoint.
#[derive(Debug, Clone, Default)]
pub struct EndpointConfig {
    /// Limits on what peers may use.
    pub limits: Limits,
    /// Tokens and encryption.
    pub security: Security,
}

/// A bound address that does not accept connections yet.
#[derive(Debug)]
pub struct Endpoint {
    listener: TcpListener,
    address: SocketAddr,
    config: EndpointConfig,
    pages: Option<axum::Router>,
    ready: watch::Receiver<bool>,
    lease: watch::Receiver<bool>,
    memory: MemoryBudget,
}

impl Endpoint {
    /// Binds a loopback `address` with the default limits and without tokens; port 0 means any free port.
    pub fn bind(address: SocketAddr) -> Result<Self, ServeError> {
        Self::open(address, EndpointConfig::default())
    }

    /// Binds `address`; port 0 means any free port.
    pub fn open(address: SocketAddr, config: EndpointConfig) -> Result<Self, ServeError> {
        let Security { tls, tokens, insecure, .. } = &config.security;
        if !address.ip().to_canonical().is_loopback() && tls.is_none() && !insecure {
            return Err(ServeError::Exposed(address));
        }
        if !address.ip().to_canonical().is_loopback() && (tls.is_none() || tokens.is_none()) {
            let missing = match (tls, tokens) {
                (None, None) => "TLS or tokens: give --tls-cert, --tls-key and --tokens",
                (None, Some(_)) => "TLS, so others can read the tokens: give --tls-cert and --tls-key",
                _ => "tokens, so any caller may do everything: give --tokens",
            };
            warn!(%address, "INSECURE: other machines can reach this address without {missing}");
        }
        let fail = |source| ServeError::Bind { address, source };
        let listener = std::net::TcpListener::bind(address).map_err(fail)?;
        listener.set_nonblocking(true).map_err(fail)?;
        let listener = TcpListener::from_std(listener).map_err(fail)?;
        let address = listener.local_addr().map_err(fail)?;
        let [ready, lease] = [(); 2].map(|()| watch::channel(true).1);
        let memory = MemoryBudget::new(DEFAULT_MAX_MEMORY_BYTES);
        Ok(Self { listener, address, config, pages: None, ready, lease, memory })
    }

    /// Also serves web pages: `pages` answers every GET and HEAD request that no service handles. Pages need no token.
    pub fn with_pages(self, pages: axum::Router) -> Self {
        Self { pages: Some(pages), ..self }
    }

    /// While `ready` is false, health checks report NOT_SERVING and calls are refused with UNAVAILABLE.
    pub fn with_readiness(self, ready: watch::Receiver<bool>) -> Self {
        Self { ready, ..self }
    }

    /// While `lease` is false, each named service reports NOT_SERVING, so that load balancers prefer other servers. The
    /// process, whose name is empty, is not affected: a restart would not help.
    pub fn with_lease(self, lease: watch::Receiver<bool>) -> Self {
        Self { lease, ..self }
    }

    /// Counts large requests against `memory`.
    pub fn with_memory(self, memory: MemoryBudget) -> Self {
        Self { memory, ..self }
    }

    /// The address that is bound.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the limits on what peers may use.
    pub fn limits(&self) -> Limits {
        self.config.limits
    }

    /// Returns the URI for clients on this machine.
    pub fn uri(&self) -> String {
        let scheme = if self.config.security.tls.is_some() { "https" } else { "http" };
        let ip = match self.address.ip() {
            ip if ip.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
            ip => ip,
        };
        format!("{scheme}://{}", SocketAddr::new(ip, self.address.port()))
    }

    /// Serves `services` until `shutdown`, then drains for at most five seconds.
    ///
    /// `names` are the services whose health is reported; `metrics` renders the answer to `GET /metrics`.
    pub async fn serve<M, F>(
        self,
        mut services: RoutesBuilder,
        names: &[&str],
        metrics: M,
        shutdown: Shutdown,
    ) -> Result<(), ServeError>
    where
        M: Fn() -> F + Clone + Send + Sync + 'static,
        F: Future<Output = String> + Send,
    {
        let (mut health, health_service) = Health::start(names, self.ready.clone(), self.lease.clone()).await;
        let reflection = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(surefoot_proto::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .build_v1()?;
        services.add_service(health_service).add_service(reflection);
        let counters = Arc::new(Counters::default());
        let routes = services
            .routes()
            .into_axum_router()
            .route("/metrics", metrics_page(metrics, counters.clone()))
            .route("/openapi.json", contracts_page(names));
        let router = self.guard(routes);
        let Self { listener, address, config: EndpointConfig { limits, security }, .. } = self;
        let (cut, stop) = (Shutdown::default(), Shutdown::default());
        let incoming = Incoming::new(listener, limits, counters, cut.clone());
        let handshake_timeout = limits.handshake_timeout;
        let generations = Generations { server: server(&limits), router, handshake_timeout, stop: stop.clone() };
        let draining = async {
            health.follow(&shutdown).await;
            sleep(NOTICE).await;
            stop.trigger();
            sleep(NOTICE).await;
            // Clients that watch the health have been notified.
            health.end_watches().await;
            sleep(DRAIN_LIMIT - 2 * NOTICE).await;
        };
        tokio::select! {
            result = generations.serve(incoming, security.tls) => result?,
            () = reload(security.tokens) => {}
            () = draining => warn!(%address, "some connections did not close in time and were cut"),
        }
        cut.trigger();
        info!(%address, "stopped serving");
        Ok(())
    }

    /// Puts the checks of requests in front of `routes`, and the pages behind them.
    fn guard(&self, mut routes: axum::Router) -> axum::Router {
        let EndpointConfig { limits, security } = self.config.clone();
        let guarded = security.tls.is_some() || security.tokens.is_some();
        let origins = Origins { named: security.origins.into(), guarded };
        let cors = origins.layer();
        let (memory, ready) = (self.memory.clone(), self.ready.clone());
        let translator = Translator::new(limits, memory.clone());
        let gate = Gate { tokens: security.tokens, origins, limits, memory, ready };
        if let Some(pages) = self.pages.clone() {
            routes = routes.fallback(move |request| gate::page(pages, request));
        }
        // Layers are added from the innermost to the outermost.
        routes
            .layer(axum::middleware::from_fn(revocation::watch))
            .layer(axum::middleware::from_fn_with_state(Arc::new(translator), connect::serve))
            .layer(axum::middleware::from_fn_with_state(Arc::new(gate), gate::pass))
            .layer(cors)
    }
}

fn server(limits: &Limits) -> Server {
    Server::builder()
        .accept_http1(true)
        .max_concurrent_streams(limits.max_streams)
        .http2_max_header_list_size(MAX_HEADER_BYTES)
        .http2_keepalive_interval(Some(limits.keepalive_interval))
        .http2_keepalive_timeout(Some(limits.keepalive_timeout))
}

fn metrics_page<M, F>(metrics: M, counters: Arc<Counters>) -> MethodRouter
where
    M: Fn() -> F + Clone + Send + Sync + 'static,
    F: Future<Output = String> + Send,
{
    get(move || {
        let (metrics, counters) = (metrics.clone(), counters.clone());
        async move { metrics().await + &counters.render() }
    })
}

fn contracts_page(names: &[&str]) -> MethodRouter {
    let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
    // Built on the first request.
    let document = Arc::<OnceLock<Bytes>>::default();
    get(move || {
        let document = document.get_or_init(|| openapi::document(&names).into()).clone();
        async move { ([(CONTENT_TYPE, "application/json")], document) }
    })
}

/// Reloads tokens when their file changes, without end.
async fn reload(tokens: Option<Tokens>) {
    if let Some(tokens) = tokens {
        tokens.reload_on_change().await;
    }
    std::future::pending().await
}
