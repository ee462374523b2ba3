//! The NPC worker: connects to a world server, requests plans from the planner, and decides for NPCs.
//!
//! Each connection is a session (`session`) with one task per world (`world`). The policy runs on blocking threads, never on
//! those that move messages. A lost connection is retried with growing pauses. Without a planner, or while it is unavailable,
//! NPCs head straight for their goals. `graph` follows the planner's graph of a world's map.

mod config;
mod graph;
mod session;
mod world;

pub use config::WorkConfig;

use config::{MAX_PAUSE, MIN_PAUSE};
use session::Session;
use surefoot_net::client::LinkError;
use surefoot_net::serving::Shutdown;
use surefoot_policy::Policy;
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
}

/// Decides for NPCs until `shutdown`, reconnecting as often as needed.
///
/// # Errors
/// If an address or the credentials cannot be used, or the server refuses the worker permanently.
pub async fn work(config: WorkConfig, policy: Policy, shutdown: Shutdown) -> Result<(), WorkError> {
    let server = config.credentials.dial(&config.server)?;
    let planner = config.planner.as_ref().map(|uri| config.credentials.dial(uri)).transpose()?;
    let planner = planner.map(|dialer| dialer.connect_lazy());
    let mut pause = MIN_PAUSE;
    while !shutdown.is_triggered() {
        let session = Session { config: &config, policy: &policy, planner: planner.clone() };
        let result = tokio::select! {
            result = session.run(&server) => result,
            () = shutdown.wait() => return Ok(()),
        };
        match result {
            Ok(()) => pause = MIN_PAUSE,
            Err(status) if is_final(status.code()) => return Err(WorkError::Refused(status)),
            Err(status) => {
                warn!(server = config.server, %status, pause_ms = pause.as_millis(), "no connection to the server: trying again")
            }
        }
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
