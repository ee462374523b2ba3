//! The NPC worker: connects to a world server, carries NPCs, asks the planner for plans, decides.
//!
//! One session per connection (`session`); one task per world within it (`world`). The policy runs on blocking threads, never on
//! the ones that move messages. A lost server is looked for again with growing pauses; without a planner (or
//! while it is away) NPCs head straight for their goals. `graph` keeps the planner's graph of a world's map.

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

/// A worker that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum WorkError {
    /// No connection can be made as configured.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The server will not have this worker.
    #[error("the server refuses this worker: {0}")]
    Refused(Status),
}

/// Carries NPCs until `shutdown`, through any number of connections.
///
/// # Errors
/// If an address or credentials cannot be used, or the server refuses the worker for good.
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

/// Whether trying again with the same worker is no use.
fn is_final(code: Code) -> bool {
    use Code::{FailedPrecondition, InvalidArgument, PermissionDenied, Unauthenticated};
    matches!(code, FailedPrecondition | InvalidArgument | PermissionDenied | Unauthenticated)
}
