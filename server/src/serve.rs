//! The lifecycle of a server: restore worlds, serve, save worlds.

use crate::config::ServerConfig;
use crate::envs::Envs;
use crate::grpc::WorldApi;
use crate::grpc::env::EnvApi;
use crate::hosted::SavedError;
use crate::worlds::Worlds;
use surefoot_net::idempotency::Answers;
use surefoot_net::serving::{Endpoint, MAX_MESSAGE_BYTES, ServeError, Shutdown, with_grpc_web};
use surefoot_proto::world::v1::env_service_server::{EnvServiceServer, SERVICE_NAME as ENV_SERVICE};
use surefoot_proto::world::v1::map_service_server::{MapServiceServer, SERVICE_NAME as MAP_SERVICE};
use surefoot_proto::world::v1::world_service_server::{SERVICE_NAME as WORLD_SERVICE, WorldServiceServer};
use tonic::service::RoutesBuilder;

/// Serves worlds on `endpoint` until `shutdown`, then saves them.
///
/// # Errors
/// If the transport fails, or the folder for saved worlds cannot be used.
pub async fn serve(endpoint: Endpoint, config: ServerConfig, shutdown: Shutdown) -> Result<(), ServerError> {
    let worlds = Worlds::new(config, shutdown.clone());
    worlds.restore_all().await?;
    if worlds.config().state.is_some() {
        tokio::spawn(worlds.clone().keep_saving());
    }
    let metrics = {
        let worlds = worlds.clone();
        move || {
            let worlds = worlds.clone();
            async move { worlds.metrics().await }
        }
    };
    let routes = routes(&endpoint, &worlds, &shutdown);
    let result = endpoint.serve(routes, &[WORLD_SERVICE, ENV_SERVICE, MAP_SERVICE], metrics, shutdown).await;
    let saved = worlds.save_all(true).await;
    worlds.stop();
    result?;
    Ok(saved?)
}

fn routes(endpoint: &Endpoint, worlds: &Worlds, shutdown: &Shutdown) -> RoutesBuilder {
    let limits = endpoint.limits();
    let envs =
        EnvApi { envs: Envs::new(worlds.config().max_envs), shutdown: shutdown.clone(), created: Answers::default() };
    let envs = EnvServiceServer::new(envs)
        .max_decoding_message_size(limits.max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let maps = MapServiceServer::new(worlds.levels().clone())
        .max_decoding_message_size(limits.max_import_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let worlds = WorldServiceServer::new(WorldApi::new(worlds.clone()))
        .max_decoding_message_size(limits.max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let mut routes = tonic::service::Routes::builder();
    routes.add_service(with_grpc_web(worlds)).add_service(with_grpc_web(envs)).add_service(with_grpc_web(maps));
    routes
}

/// Why a server ends without having been stopped.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The endpoint failed.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// Worlds cannot be saved or restored.
    #[error("cannot save or restore worlds: {0}")]
    Saved(#[from] SavedError),
}
