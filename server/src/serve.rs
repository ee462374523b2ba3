//! The lifecycle of a server: restore worlds, serve, save worlds.

use crate::config::ServerConfig;
use crate::envs::{EnvBackend, Envs, Host, IDLE_LIMIT};
use crate::grpc::WorldApi;
use crate::grpc::directory::DirectoryApi;
use crate::grpc::env::EnvApi;
use crate::grpc::redirect::RedirectToOwner;
use crate::hosted::SavedError;
use crate::lease;
use crate::observer::Observer;
use crate::store::StoreError;
use crate::worlds::Worlds;
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::idempotency::AnswerCache;
use surefoot_net::levels::LevelStore;
use surefoot_net::serving::{Endpoint, Limits, MAX_MESSAGE_BYTES, ServeError, Shutdown};
use surefoot_proto::world::v1::directory_service_server::{DirectoryServiceServer, SERVICE_NAME as DIRECTORY_SERVICE};
use surefoot_proto::world::v1::env_service_server::{EnvServiceServer, SERVICE_NAME as ENV_SERVICE};
use surefoot_proto::world::v1::map_service_server::{MapServiceServer, SERVICE_NAME as MAP_SERVICE};
use surefoot_proto::world::v1::world_service_server::{SERVICE_NAME as WORLD_SERVICE, WorldServiceServer};
use tokio::sync::watch;
use tonic::service::RoutesBuilder;
use tracing::warn;

/// Time limit of the last save. Together with the drain of the endpoint, a shutdown takes less than ten seconds.
const LAST_SAVE: Duration = Duration::from_secs(4);
/// Time limit of leaving the fleet.
const LEAVE_LIMIT: Duration = Duration::from_secs(2);

/// Serves worlds on `endpoint` until `shutdown`, then saves them. Saved worlds are restored in the background; until
/// then health checks report NOT_SERVING.
pub async fn serve(endpoint: Endpoint, config: ServerConfig, shutdown: Shutdown) -> Result<(), ServerError> {
    serve_observed(endpoint, config, shutdown).1.await
}

/// As [`serve`], with an observer of the server.
pub fn serve_observed(
    endpoint: Endpoint,
    config: ServerConfig,
    shutdown: Shutdown,
) -> (Observer, impl Future<Output = Result<(), ServerError>> + Send) {
    let worlds = Worlds::new(config, shutdown.clone());
    // Without saved worlds the server is ready at once.
    let config = worlds.config();
    let (ready, is_ready) = watch::channel(config.state.is_none() && config.store.is_none());
    (Observer::new(worlds.clone(), is_ready), run(endpoint, worlds, ready, shutdown))
}

async fn run(
    endpoint: Endpoint,
    worlds: Worlds,
    ready: watch::Sender<bool>,
    shutdown: Shutdown,
) -> Result<(), ServerError> {
    worlds.open_state()?;
    let is_ready = ready.subscribe();
    let (holds_lease, lease) = watch::channel(true);
    let restoring = tokio::spawn(restore(worlds.clone(), ready, holds_lease, shutdown.clone()));
    let metrics = {
        let worlds = worlds.clone();
        move || std::future::ready(worlds.metrics())
    };
    let memory = worlds.maps().memory().clone();
    let endpoint = endpoint.with_readiness(is_ready).with_lease(lease).with_memory(memory);
    let routes = routes(&endpoint, &worlds, &shutdown);
    let services = [WORLD_SERVICE, DIRECTORY_SERVICE, ENV_SERVICE, MAP_SERVICE];
    let result = endpoint.serve(routes, &services, metrics, shutdown.clone()).await;
    // Also if the transport failed.
    shutdown.trigger();
    let saved = worlds.save_all(true, LAST_SAVE).await;
    worlds.stop();
    if let Some(shared) = worlds.shared_store()
        && !matches!(tokio::time::timeout(LEAVE_LIMIT, shared.leave()).await, Ok(Ok(())))
    {
        warn!("lease: not released (the database does not answer); worlds move when it expires");
    }
    result?;
    if let Ok(restored) = restoring.await {
        restored?;
    }
    Ok(saved?)
}

/// Restores saved worlds, then saves all worlds periodically.
async fn restore(
    worlds: Worlds,
    ready: watch::Sender<bool>,
    holds_lease: watch::Sender<bool>,
    shutdown: Shutdown,
) -> Result<(), StoreError> {
    if worlds.shared_store().is_some() {
        tokio::spawn(worlds.clone().save_loop());
        // Runs until the process ends, because journals are written during the drain too.
        tokio::spawn(lease::run(worlds, ready, holds_lease));
        return Ok(());
    }
    if let Err(error) = worlds.restore_all().await {
        // A server that cannot read its worlds must not run without them.
        shutdown.trigger();
        return Err(error);
    }
    ready.send_replace(true);
    if worlds.config().state.is_some() {
        tokio::spawn(worlds.save_loop());
    }
    // Keeps the sender.
    shutdown.wait().await;
    Ok(())
}

fn routes(endpoint: &Endpoint, worlds: &Worlds, shutdown: &Shutdown) -> RoutesBuilder {
    let limits = endpoint.limits();
    let (config, backend) = (worlds.config(), EnvBackend::Maps(worlds.maps().clone()));
    let envs = Envs::new(config.max_envs, config.max_envs_per_client, config.idle_envs_after, backend);
    let envs = env_service(limits, envs, Some(worlds.levels().clone()), shutdown);
    let maps = MapServiceServer::new(worlds.levels().clone())
        .max_decoding_message_size(limits.max_import_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let directory = DirectoryServiceServer::new(DirectoryApi { worlds: worlds.clone() });
    let inner = WorldServiceServer::new(WorldApi::new(worlds.clone()))
        .max_decoding_message_size(limits.max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let worlds = RedirectToOwner { inner, worlds: worlds.clone() };
    let mut routes = tonic::service::Routes::builder();
    routes.add_service(directory);
    routes.add_service(worlds).add_service(envs).add_service(maps);
    routes
}

fn env_service(
    limits: Limits,
    envs: Envs,
    levels: Option<LevelStore>,
    shutdown: &Shutdown,
) -> EnvServiceServer<EnvApi> {
    let (sweeping, stopping) = (envs.clone().keep_sweeping(), shutdown.wait());
    tokio::spawn(async move {
        tokio::select! {
            () = sweeping => {}
            () = stopping => {}
        }
    });
    let created = AnswerCache::new(envs.memory().clone());
    EnvServiceServer::new(EnvApi { envs, levels, shutdown: shutdown.clone(), created })
        .max_decoding_message_size(limits.max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES)
}

/// Serves environments of a game on `endpoint` until `shutdown`, at most `limit` at a time.
pub async fn serve_game(
    endpoint: Endpoint,
    host: Arc<dyn Host>,
    limit: usize,
    shutdown: Shutdown,
) -> Result<(), ServeError> {
    // A game has one trainer.
    let envs = Envs::new(limit, limit, IDLE_LIMIT, EnvBackend::Game(host));
    let envs = env_service(endpoint.limits(), envs, None, &shutdown);
    let mut routes = tonic::service::Routes::builder();
    routes.add_service(envs);
    endpoint.serve(routes, &[ENV_SERVICE], || async { String::new() }, shutdown).await
}

/// Why a server ends without a shutdown.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The endpoint failed.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// The folder for worlds cannot be used.
    #[error("cannot save or restore worlds")]
    Folder(#[from] SavedError),
    /// Worlds cannot be saved or restored.
    #[error("cannot save or restore worlds")]
    Saved(#[from] StoreError),
}
