//! The world server: many worlds, each stepped on a thread of its own, NPCs, workers, and the gRPC face of it all.
//!
//! [`hosted`] is one world with its NPCs' decisions, [`sim`] the thread that steps it on an absolute 60 Hz
//! schedule, [`registry`] the workers, [`watch`] what clients see, [`env`](mod@env) worlds that remote trainers step themselves,
//! [`service`] decode, call, encode. Simulation never runs on tokio's threads, and nothing below [`service`] and [`watch`] awaits.

pub mod checks;
pub mod env;
mod env_service;
pub mod geometry;
pub mod hosted;
pub mod metrics;
pub mod quota;
pub mod registry;
pub mod service;
pub mod sim;
pub mod times;
pub mod watch;

use std::path::PathBuf;
use std::time::Duration;
use surefoot_proto::maps::DEFAULT_MAX_MAPS;
use surefoot_proto::serving::{Endpoint, MAX_MESSAGE_BYTES, ServeError, Shutdown, with_grpc_web};
use surefoot_proto::world::v1::env_service_server::{EnvServiceServer, SERVICE_NAME as ENV_SERVICE};
use surefoot_proto::world::v1::map_service_server::{MapServiceServer, SERVICE_NAME as MAP_SERVICE};
use surefoot_proto::world::v1::world_service_server::{SERVICE_NAME as WORLD_SERVICE, WorldServiceServer};

/// Limits and sizes of a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerConfig {
    /// Most worlds at a time (`--max-worlds`); each has a thread.
    pub max_worlds: usize,
    /// Most worlds of one client (`--max-worlds-per-client`).
    pub max_worlds_per_client: usize,
    /// Most NPCs on one world (`--max-npcs`).
    pub max_npcs_per_world: usize,
    /// Most NPCs of one client (`--max-npcs-per-client`).
    pub max_npcs_per_client: usize,
    /// Most environments of remote trainers (`--max-envs`).
    pub max_envs: usize,
    /// Most imported maps that are kept (`--max-maps`).
    pub max_maps: usize,
    /// How long a reader of a stream may leave everything unread until it is cut off (`--reader-patience`).
    pub reader_patience: Duration,
    /// Where worlds are saved when the server stops and taken up again when it starts (`--state`).
    pub state: Option<PathBuf>,
    /// How often they are saved while it runs, so that little is lost if it is killed (`--save-every`).
    pub save_every: Duration,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            max_worlds: 64,
            max_worlds_per_client: 32,
            max_npcs_per_world: 4096,
            max_npcs_per_client: 8192,
            max_envs: 16,
            max_maps: DEFAULT_MAX_MAPS,
            reader_patience: Duration::from_secs(5),
            state: None,
            save_every: Duration::from_secs(30),
        }
    }
}

/// Serves worlds on `endpoint` until `shutdown`, then saves them.
///
/// # Errors
/// If the transport fails, or the folder for saved worlds cannot be used.
pub async fn serve(endpoint: Endpoint, config: ServerConfig, shutdown: Shutdown) -> Result<(), ServerError> {
    let service = service::WorldApi::new(config.clone(), shutdown.clone());
    service.take_up_worlds().await?;
    if config.state.is_some() {
        tokio::spawn(service.clone().keep_saving());
    }
    let metrics = {
        let service = service.clone();
        move || {
            let service = service.clone();
            async move { service.metrics().await }
        }
    };
    let mut routes = tonic::service::Routes::builder();
    let worlds = WorldServiceServer::new(service.clone())
        .max_decoding_message_size(endpoint.limits().max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let envs = EnvServiceServer::new(env_service::EnvApi::new(config.max_envs, shutdown.clone()))
        .max_decoding_message_size(endpoint.limits().max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let maps = MapServiceServer::new(service.maps())
        .max_decoding_message_size(endpoint.limits().max_import_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    routes.add_service(with_grpc_web(worlds)).add_service(with_grpc_web(envs)).add_service(with_grpc_web(maps));
    let result = endpoint.serve(routes, &[WORLD_SERVICE, ENV_SERVICE, MAP_SERVICE], metrics, shutdown).await;
    let saved = service.save_worlds(true).await;
    service.stop();
    result?;
    Ok(saved?)
}

/// Why a server ends other than by being told to.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The endpoint failed.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// Worlds cannot be saved or taken up.
    #[error("saved worlds: {0}")]
    Saved(#[from] hosted::SavedError),
}

/// Resolves at Ctrl-C or SIGTERM. Both are caught from this call on, whether the future is polled yet or not.
///
/// # Panics
/// If the system refuses to install a signal handler, or outside a tokio runtime.
pub fn shutdown_signal() -> impl Future<Output = ()> + Send + 'static {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).expect("SIGTERM can be handled");
    let mut interrupt = signal(SignalKind::interrupt()).expect("SIGINT can be handled");
    async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
    }
}
