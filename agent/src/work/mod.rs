//! The NPC worker: connects to a world server, requests plans from the planner, and decides for NPCs.
//!
//! Each connection is a session (`session`) with one task per world (`world`). The policy runs on a thread of its own (`inference`),
//! in lockstep on blocking threads, never on those that move messages. A lost connection is retried with growing pauses. Without a
//! planner, or while it is unavailable, NPCs head straight for their goals. `graph` follows the planner's graph of a world's map; `ahead`
//! holds the map itself, on which NPCs rehearse the legs of their plans.

mod ahead;
mod config;
mod graph;
mod inference;
mod session;
mod world;

pub use config::WorkConfig;

use ahead::Maps;
use config::{MAX_PAUSE, MIN_PAUSE};
use graph::Graphs;
use session::{Session, SessionEnd};
use std::sync::Arc;
use surefoot_net::client::LinkError;
use surefoot_net::replicas::Replicas;
use surefoot_net::serving::Shutdown;
use surefoot_policy::Policy;
use surefoot_proto::plans::settings_to_wire;
use tonic::{Code, Status};
use tracing::warn;

/// Why a worker cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum WorkError {
    /// An address or the credentials cannot be used.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The server refuses this worker, and would refuse it again.
    #[error("the server refuses this worker: {0}")]
    Refused(Status),
    /// The planner proves edges with another policy than this worker's.
    #[error("the planner cannot plan for this worker: {}", .0.message())]
    OtherPolicy(Status),
}

/// Decides for NPCs until `shutdown`, reconnecting as often as needed.
///
/// # Errors
/// If an address or the credentials cannot be used, or the server refuses the worker permanently.
pub async fn work(config: WorkConfig, policy: Policy, shutdown: Shutdown) -> Result<(), WorkError> {
    let server = config.credentials.dial(&config.server)?;
    let planners = Replicas::dial(&config.credentials, &config.planners)?;
    let policy_hash = &policy.manifest().weights_hash;
    let graphs = Graphs::new(&planners, settings_to_wire(&config.graph), policy_hash.clone());
    let graphs = (!config.planners.is_empty()).then_some(graphs);
    let maps = config.rehearses.then(|| Arc::new(Maps::new(config.maps.clone())));
    let mut pause = MIN_PAUSE;
    while !shutdown.is_triggered() {
        let session = Session { config: &config, policy: &policy, graphs: graphs.as_ref(), maps: maps.as_ref() };
        let end = tokio::select! {
            end = session.run(&server) => end,
            () = shutdown.wait() => return Ok(()),
        };
        let status = match end {
            SessionEnd::OtherPolicy(status) => return Err(WorkError::OtherPolicy(status)),
            SessionEnd::Refused(status) if is_final(status.code()) => return Err(WorkError::Refused(status)),
            SessionEnd::Refused(status) => status,
            SessionEnd::Lost(status) => {
                pause = MIN_PAUSE;
                status
            }
        };
        warn!(server = config.server, %status, pause_ms = pause.as_millis(), "no connection to the server: trying again");
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            () = shutdown.wait() => {}
        }
        pause = (pause * 2).min(MAX_PAUSE);
    }
    Ok(())
}

/// Whether a retry with the same worker would fail again.
fn is_final(code: Code) -> bool {
    use Code::{FailedPrecondition, InvalidArgument, PermissionDenied, Unauthenticated};
    matches!(code, FailedPrecondition | InvalidArgument | PermissionDenied | Unauthenticated)
}
