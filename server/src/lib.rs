//! The world server: many worlds stepped on threads of their own, NPCs, workers, and the gRPC face of it all.
//!
//! [`hosted`] is one world with its NPCs' decisions, [`sim`] the thread that steps several of them on an
//! absolute 60 Hz schedule, [`registry`] the workers, [`service`] decode, call, encode. Simulation never runs
//! on tokio's threads, and nothing below [`service`] awaits.

pub mod checks;
pub mod hosted;
pub mod metrics;
pub mod registry;
pub mod service;
pub mod sim;

use surefoot_proto::serving::{Endpoint, ServeError, Shutdown};
use surefoot_proto::world::v1::world_service_server::{SERVICE_NAME, WorldServiceServer};

/// Limits and sizes of a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServerConfig {
    /// Most worlds at a time (`--max-worlds`).
    pub max_worlds: usize,
    /// Most NPCs on one world (`--max-npcs`).
    pub max_npcs_per_world: usize,
    /// Threads that step worlds (`--sim-threads`).
    pub sim_threads: usize,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self { max_worlds: 16, max_npcs_per_world: 1024, sim_threads: 1 }
    }
}

/// Serves worlds on `endpoint` until `shutdown`.
///
/// # Errors
/// If the transport fails.
pub async fn serve(endpoint: Endpoint, config: ServerConfig, shutdown: Shutdown) -> Result<(), ServeError> {
    let service = service::WorldApi::new(config, shutdown.clone());
    let metrics = {
        let service = service.clone();
        move || {
            let service = service.clone();
            async move { service.metrics().await }
        }
    };
    let mut routes = tonic::service::Routes::builder();
    let grpc = WorldServiceServer::new(service.clone())
        .max_decoding_message_size(surefoot_proto::serving::MAX_MESSAGE_BYTES)
        .max_encoding_message_size(surefoot_proto::serving::MAX_MESSAGE_BYTES);
    routes.add_service(surefoot_proto::serving::with_grpc_web(grpc));
    let result = endpoint.serve(routes, &[SERVICE_NAME], metrics, shutdown).await;
    service.stop();
    result
}

/// Resolves at Ctrl-C or SIGTERM.
///
/// # Panics
/// If the system refuses to install a signal handler.
pub async fn shutdown_signal() {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).expect("SIGTERM can be handled");
    tokio::select! {
        _ = tokio::signal::ctrl_c() => {}
        _ = terminate.recv() => {}
    }
}
