//! What every Surefoot endpoint has: health checking, reflection, gRPC-Web, limits and a drain that ends.

use std::future::Future;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::sync::watch;
use tonic::service::RoutesBuilder;
use tonic::transport::Server;
use tonic::transport::server::TcpIncoming;
use tonic::{Code, Status};
use tracing::{info, warn};

/// Largest message in either direction unless a service says otherwise.
pub const MAX_MESSAGE_BYTES: usize = 16 * 1024 * 1024;
/// Streams that one connection may have open.
const MAX_STREAMS: u32 = 128;
/// After this a drain is cut short: a silent peer must not keep a process alive.
const DRAIN_LIMIT: Duration = Duration::from_secs(5);

/// Tells every part of a process that it is time to stop.
#[derive(Debug, Clone)]
pub struct Shutdown {
    sender: watch::Sender<bool>,
}

impl Default for Shutdown {
    fn default() -> Self {
        Self { sender: watch::Sender::new(false) }
    }
}

impl Shutdown {
    /// Starts the shutdown; further calls do nothing.
    pub fn trigger(&self) {
        self.sender.send_replace(true);
    }

    /// Whether the shutdown has begun.
    pub fn is_triggered(&self) -> bool {
        *self.sender.borrow()
    }

    /// Resolves once the shutdown has begun.
    pub fn wait(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut receiver = self.sender.subscribe();
        async move {
            // The sender cannot be gone before the value is set without the process ending anyway.
            let _ = receiver.wait_for(|&stopping| stopping).await;
        }
    }
}

/// The status that ends streams when an endpoint drains.
pub fn going_away() -> Status {
    Status::new(Code::Unavailable, "the service is shutting down: connect again later")
}

/// Why an endpoint cannot serve.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Bind {
        /// What was asked for.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// The transport failed.
    #[error("serving failed: {0}")]
    Transport(#[from] tonic::transport::Error),
    /// The descriptors of the contracts are unreadable.
    #[error("reflection cannot be set up: {0}")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// A bound address that does not accept yet.
#[derive(Debug)]
pub struct Endpoint {
    incoming: TcpIncoming,
    address: SocketAddr,
}

impl Endpoint {
    /// Binds `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// If it is taken or not allowed.
    pub fn bind(address: SocketAddr) -> Result<Self, ServeError> {
        let fail = |source| ServeError::Bind { address, source };
        let incoming = TcpIncoming::bind(address).map_err(fail)?.with_nodelay(Some(true));
        let address = incoming.local_addr().map_err(fail)?;
        Ok(Self { incoming, address })
    }

    /// Where clients connect.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves `services` (already added to the builder) until `shutdown`, then drains, at most five seconds.
    ///
    /// `names` are the services whose health is reported. `metrics` answers `GET /metrics`.
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
        let (health, health_service) = tonic_health::server::health_reporter();
        for name in names {
            health.set_service_status(*name, tonic_health::ServingStatus::Serving).await;
        }
        let reflection = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(crate::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .build_v1()?;
        services.add_service(health_service).add_service(reflection);
        let router = services.routes().into_axum_router().route("/metrics", axum::routing::get(metrics));
        let server = Server::builder()
            .accept_http1(true)
            .max_concurrent_streams(MAX_STREAMS)
            .http2_keepalive_interval(Some(Duration::from_secs(20)))
            .http2_keepalive_timeout(Some(Duration::from_secs(10)))
            .add_routes(router.into())
            .serve_with_incoming_shutdown(self.incoming, shutdown.wait());
        let drained = async {
            shutdown.wait().await;
            for name in names {
                health.set_service_status(*name, tonic_health::ServingStatus::NotServing).await;
            }
            tokio::time::sleep(DRAIN_LIMIT).await;
        };
        tokio::select! {
            result = server => result?,
            () = drained => warn!(address = %self.address, "some connections did not close in time and were cut"),
        }
        info!(address = %self.address, "stopped serving");
        Ok(())
    }
}

/// Makes a service understand gRPC-Web too, for browsers.
pub fn with_grpc_web<S>(service: S) -> tonic::service::Layered<tonic_web::GrpcWebService<S>, S>
where
    S: tonic::server::NamedService,
    tonic_web::GrpcWebService<S>: Clone,
{
    use tonic::service::LayerExt;
    tonic_web::GrpcWebLayer::new().named_layer(service)
}
