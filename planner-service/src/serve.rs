//! Runs a planner service from start to shutdown.

use crate::config::PlannerConfig;
use crate::grpc::PlannerApi;
use crate::planner::Planner;
use crate::stores::PlannerStores;
use std::time::Duration;
use surefoot_net::serving::{Endpoint, MAX_MESSAGE_BYTES, ServeError, Shutdown};
use surefoot_policy::Policy;
use surefoot_proto::planner::v1::planner_service_server::{PlannerServiceServer, SERVICE_NAME};
use surefoot_proto::world::v1::map_service_server::{MapServiceServer, SERVICE_NAME as MAP_SERVICE};
use tokio::sync::watch;

/// Period at which the lease is checked.
const STANDING_EVERY: Duration = Duration::from_millis(250);

/// Serves the planner on `endpoint` until `shutdown`, then cancels its builds and stores live evidence.
pub async fn serve(
    endpoint: Endpoint,
    config: PlannerConfig,
    policy: Policy,
    store: impl Into<PlannerStores>,
    shutdown: Shutdown,
) -> Result<(), ServeError> {
    let planner = Planner::new(config, policy, store.into(), shutdown.clone());
    tokio::spawn(planner.peers.clone().follow_news());
    let metrics = {
        let planner = planner.clone();
        move || {
            let text = planner.metrics();
            async move { text }
        }
    };
    let (holds_lease, standing) = watch::channel(true);
    let reporting = tokio::spawn(report_standing(planner.clone(), holds_lease));
    let endpoint = endpoint.with_lease(standing);
    let mut routes = tonic::service::Routes::builder();
    let grpc = PlannerServiceServer::new(PlannerApi::new(planner.clone()))
        .max_decoding_message_size(endpoint.limits().max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let maps = MapServiceServer::new(planner.levels().clone())
        .max_decoding_message_size(endpoint.limits().max_import_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    routes.add_service(grpc).add_service(maps);
    let endpoint = endpoint.with_memory(planner.levels().memory().clone());
    let result = endpoint.serve(routes, &[SERVICE_NAME, MAP_SERVICE], metrics, shutdown).await;
    planner.leave().await;
    // The store closes with the last clone of the planner, so that a restart in the same process finds it unlocked.
    // The task fails only by a panic, which the panic hook reports.
    let _ = reporting.await;
    result
}

/// Reports whether the planner holds its lease, as long as there is an endpoint.
async fn report_standing(planner: Planner, holds_lease: watch::Sender<bool>) {
    let mut due = tokio::time::interval(STANDING_EVERY);
    loop {
        tokio::select! {
            _ = due.tick() => {}
            () = holds_lease.closed() => return,
        }
        let holds = planner.standing().holds_lease;
        holds_lease.send_if_modified(|known| std::mem::replace(known, holds) != holds);
    }
}
