//! An endpoint: one address with its services, from binding to the end of the drain.

use super::connect::{self, Translator};
use super::gate::{self, Gate};
use super::generations::Generations;
use super::incoming::{Counters, Incoming};
use super::limits::Limits;
use super::openapi;
use super::origin::Origins;
use super::revocation;
use super::security::Security;
use super::shutdown::Shutdown;
use crate::memory::{DEFAULT_MAX_MEMORY_BYTES, MemoryBudget};
use axum::body::Bytes;
use axum::http::header::CONTENT_TYPE;
use std::future::Future;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::sleep;
use tonic::service::RoutesBuilder;
use tonic::transport::Server;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;
use tracing::{info, warn};

/// Largest header list of a request, bytes.
const MAX_HEADER_BYTES: u32 = 16 * 1024;
/// How long health checks are still answered after a shutdown began, so that load balancers notice it.
const NOTICE: Duration = Duration::from_millis(250);
/// Longest time from the start of a shutdown to its end: a silent peer must not keep a process alive.
const DRAIN_LIMIT: Duration = Duration::from_secs(5);

/// Why an endpoint cannot serve.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The endpoint cannot listen on the address.
    #[error("cannot listen on {address}: {source}")]
    Bind {
        /// The address that was configured.
        address: SocketAddr,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Other machines could reach the address, and nothing would be encrypted.
    #[error(
        "{0} can be reached from other machines: set --tls-cert and --tls-key, or --insecure to serve it without TLS"
    )]
    Exposed(SocketAddr),
    /// The transport failed.
    #[error("serving failed: {0}")]
    Transport(#[from] tonic::transport::Error),
    /// The descriptors of the contracts cannot be read.
    #[error("reflection cannot be set up: {0}")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// Limits and security of an endpoint.
#[derive(Debug, Clone, Default)]
pub struct EndpointConfig {
    /// Limits on what peers may use.
    pub limits: Limits,
    /// Who may call, and whether connections are encrypted.
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
    standing: watch::Receiver<bool>,
    memory: MemoryBudget,
}

impl Endpoint {
    /// Binds a loopback `address` with the default limits, open to everybody on this machine; port 0 means any free port.
    ///
    /// # Errors
    /// If the address is in use, not permitted, or not a loopback address.
    pub fn bind(address: SocketAddr) -> Result<Self, ServeError> {
        Self::open(address, EndpointConfig::default())
    }

    /// Binds `address`; port 0 means any free port.
    ///
    /// # Errors
    /// If the address is in use or not permitted, or if other machines can reach it and neither TLS nor `insecure` is
    /// configured.
    pub fn open(address: SocketAddr, config: EndpointConfig) -> Result<Self, ServeError> {
        let Security { tls, tokens, insecure, .. } = &config.security;
        if !address.ip().to_canonical().is_loopback() && tls.is_none() && !insecure {
            return Err(ServeError::Exposed(address));
        }
        if !address.ip().to_canonical().is_loopback() && (tls.is_none() || tokens.is_none()) {
            let missing = match (tls, tokens) {
                (None, None) => "TLS or tokens: give --tls-cert, --tls-key and --tokens",
                (None, Some(_)) => "TLS, so tokens can be read on the way: give --tls-cert and --tls-key",
                _ => "tokens, so everybody may do everything: give --tokens",
            };
            warn!(%address, "INSECURE: other machines can reach this address without {missing}");
        }
        let fail = |source| ServeError::Bind { address, source };
        let listener = std::net::TcpListener::bind(address).map_err(fail)?;
        listener.set_nonblocking(true).map_err(fail)?;
        let listener = TcpListener::from_std(listener).map_err(fail)?;
        let address = listener.local_addr().map_err(fail)?;
        let [ready, standing] = [(); 2].map(|()| watch::channel(true).1);
        let memory = MemoryBudget::new(DEFAULT_MAX_MEMORY_BYTES);
        Ok(Self { listener, address, config, pages: None, ready, standing, memory })
    }

    /// Also serves web pages: `pages` answers every GET and HEAD request that no service handles. Pages need no token.
    pub fn with_pages(self, pages: axum::Router) -> Self {
        Self { pages: Some(pages), ..self }
    }

    /// While `ready` is false, health checks report NOT_SERVING and calls are refused with UNAVAILABLE.
    pub fn with_readiness(self, ready: watch::Receiver<bool>) -> Self {
        Self { ready, ..self }
    }

    /// While `standing` is false, the health of each named service is NOT_SERVING, so that load balancers prefer others.
    /// The health of the whole process, whose name is empty, stays: a restart would not help.
    pub fn with_lease(self, standing: watch::Receiver<bool>) -> Self {
        Self { standing, ..self }
    }

    /// Large requests are paid for from `memory`.
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

    /// Serves `services` (already added to the builder) until `shutdown`, then drains for at most five seconds.
    ///
    /// `names` are the services whose health is reported; `metrics` renders the answer to `GET /metrics`.
    ///
    /// # Errors
    /// If the transport fails.
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
        let Self { listener, address, config: EndpointConfig { limits, security }, pages, ready, standing, memory } =
            self;
        let (mut health, health_service) = tonic_health::server::health_reporter();
        let served: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        // The empty name stands for the process.
        let names: Vec<&str> = names.iter().copied().chain([""]).collect();
        let (is_ready, holds) = (*ready.borrow(), *standing.borrow());
        report(&health, &names, is_ready, holds).await;
        let reflection = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(surefoot_proto::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .build_v1()?;
        services.add_service(health_service).add_service(reflection);
        let counters = Arc::new(Counters::default());
        let page = {
            let counters = counters.clone();
            move || {
                let (metrics, counters) = (metrics.clone(), counters.clone());
                async move { metrics().await + &counters.render() }
            }
        };
        let guarded = security.tls.is_some() || security.tokens.is_some();
        let origins = Origins { named: security.origins.into(), guarded };
        let cors = origins.layer();
        let reloading = security.tokens.clone();
        let reloading = async move {
            if let Some(tokens) = reloading {
                tokens.keep_loaded().await;
            }
            std::future::pending::<()>().await
        };
        let translator = Translator::new(limits, memory.clone());
        let gate = Gate { tokens: security.tokens, origins, limits, memory, ready: ready.clone() };
        let contracts = {
            // Built on the first request.
            let (document, names) = (Arc::<OnceLock<Bytes>>::default(), served);
            move || {
                let document = document.get_or_init(|| openapi::document(&names).into()).clone();
                async move { ([(CONTENT_TYPE, "application/json")], document) }
            }
        };
        let mut router = services
            .routes()
            .into_axum_router()
            .route("/metrics", axum::routing::get(page))
            .route("/openapi.json", axum::routing::get(contracts));
        if let Some(pages) = pages {
            router = router.fallback(move |request| gate::page(pages, request));
        }
        // Layers are added from the innermost to the outermost.
        let router = router
            .layer(axum::middleware::from_fn(revocation::watch))
            .layer(axum::middleware::from_fn_with_state(Arc::new(translator), connect::serve))
            .layer(axum::middleware::from_fn_with_state(Arc::new(gate), gate::pass))
            .layer(cors);
        let server = Server::builder()
            .accept_http1(true)
            .max_concurrent_streams(limits.max_streams)
            .http2_max_header_list_size(MAX_HEADER_BYTES)
            .http2_keepalive_interval(Some(limits.keepalive_interval))
            .http2_keepalive_timeout(Some(limits.keepalive_timeout));
        let (cut, stop) = (Shutdown::default(), Shutdown::default());
        let incoming = Incoming::new(listener, limits, counters, cut.clone());
        let reporter = health.clone();
        let noticed = async {
            tokio::select! {
                () = shutdown.wait() => {}
                () = keep_reporting(&reporter, &names, ready, standing) => {}
            }
            report(&reporter, &names, false, false).await;
            sleep(NOTICE).await;
            stop.trigger();
            std::future::pending::<()>().await;
        };
        let generations =
            Generations { server, router, handshake_timeout: limits.handshake_timeout, stop: stop.clone() };
        let server = generations.serve(incoming, security.tls);
        let drained = async {
            shutdown.wait().await;
            sleep(2 * NOTICE).await;
            // Watchers of the health have been notified; this ends their streams.
            for name in &names {
                health.clear_service_status(name).await;
            }
            sleep(DRAIN_LIMIT - 2 * NOTICE).await;
        };
        tokio::select! {
            result = server => result?,
            () = reloading => {}
            () = noticed => {}
            () = drained => warn!(%address, "some connections did not close in time and were cut"),
        }
        cut.trigger();
        info!(%address, "stopped serving");
        Ok(())
    }
}

/// Reports the health of the services `names`. The health of the process, whose name is empty, does not depend on
/// `standing`.
async fn report(health: &HealthReporter, names: &[&str], is_ready: bool, standing: bool) {
    for name in names {
        let serves = is_ready && (standing || name.is_empty());
        let status = if serves { ServingStatus::Serving } else { ServingStatus::NotServing };
        health.set_service_status(*name, status).await;
    }
}

/// Reports the health whenever it changes, without end.
async fn keep_reporting(
    health: &HealthReporter,
    names: &[&str],
    mut ready: watch::Receiver<bool>,
    mut standing: watch::Receiver<bool>,
) {
    // A sender that is gone without a word says nothing more: the services stay as they are.
    async fn changed(value: &mut watch::Receiver<bool>) {
        if value.changed().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
    loop {
        tokio::select! {
            () = changed(&mut ready) => {}
            () = changed(&mut standing) => {}
        }
        let (is_ready, holds) = (*ready.borrow(), *standing.borrow());
        report(health, names, is_ready, holds).await;
    }
}
