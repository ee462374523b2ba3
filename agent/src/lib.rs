//! The NPC worker: connects to a world server, requests plans from the planner, and decides for NPCs.
//!
//! Each connection is a `session` with one task per world and body (`world`). The policy of realtime worlds runs on a
//! thread of its own (`inference`), that of lockstep worlds on blocking threads, and never on threads that move
//! messages. A lost connection is retried with growing pauses. Without a planner, or while it is unavailable, NPCs head
//! straight for their goals. `graph` follows the planner's graph of a world's map; `maps` holds the maps on which NPCs
//! rehearse. In a fleet a worker has a session with each server of the `directory`, and the sessions share its
//! `capacity`.

mod capacity;
mod config;
pub mod crowd;
mod directory;
mod graph;
mod inference;
mod maps;
mod session;
mod world;

pub use capacity::measure_capacity;
pub use config::WorkConfig;

use capacity::CapacityShare;
use config::{MAX_PAUSE, MIN_PAUSE};
use directory::LookUps;
use graph::Graphs;
use maps::Maps;
use session::{Session, SessionEnd};
use std::collections::BTreeSet;
use std::sync::Arc;
use surefoot_net::client::LinkError;
use surefoot_net::replicas::Replicas;
use surefoot_net::serving::Shutdown;
use surefoot_policy::Policy;
use surefoot_proto::plans::settings_to_wire;
use tokio::sync::watch;
use tokio::task::JoinSet;
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

/// What all connections of a worker share.
struct Worker {
    config: WorkConfig,
    policy: Policy,
    /// The planner's graphs; none without a planner.
    graphs: Option<Graphs>,
    /// Maps to rehearse on; none without rehearsals.
    maps: Option<Arc<Maps>>,
    capacity_share: CapacityShare,
    shutdown: Shutdown,
}

impl Worker {
    fn session<'a>(&'a self, address: &'a str) -> Session<'a> {
        let Self { config, policy, graphs, maps, capacity_share, .. } = self;
        Session { address, config, policy, graphs: graphs.as_ref(), maps: maps.as_ref(), capacity_share }
    }
}

/// Decides for NPCs until `shutdown`, reconnecting as often as needed.
pub async fn work(config: WorkConfig, policy: Policy, shutdown: Shutdown) -> Result<(), WorkError> {
    let planners = Replicas::dial(&config.credentials, &config.planners)?;
    let policy_hash = &policy.manifest().weights_hash;
    let graphs = Graphs::new(&planners, settings_to_wire(&config.graph), policy_hash.clone());
    let graphs = (!config.planners.is_empty()).then_some(graphs);
    let maps = config.rehearses.then(|| Arc::new(Maps::new(config.maps.clone())));
    let capacity_share = CapacityShare::new(config.capacity);
    let (listing, listed) = watch::channel(config.servers.iter().cloned().collect());
    let worker = Arc::new(Worker { config, policy, graphs, maps, capacity_share, shutdown: shutdown.clone() });
    if !worker.config.is_of_fleet {
        return serve_all(&worker, listed).await;
    }
    listing.send_replace(BTreeSet::new());
    let (credentials, seeds) = (worker.config.credentials.clone(), worker.config.servers.clone());
    let directory = directory::follow(credentials, seeds, listing, LookUps::default());
    tokio::select! {
        followed = directory => Ok(followed?),
        served = serve_all(&worker, listed) => served,
    }
}

/// Serves all listed servers until the shutdown.
async fn serve_all(worker: &Arc<Worker>, mut listed: watch::Receiver<BTreeSet<String>>) -> Result<(), WorkError> {
    let mut served = BTreeSet::new();
    let mut tasks = JoinSet::new();
    let mut is_final = false;
    loop {
        let now = listed.borrow_and_update().clone();
        for server in now.difference(&served) {
            tasks.spawn(serve(worker.clone(), server.clone(), listed.clone()));
        }
        served.extend(now);
        tokio::select! {
            changed = listed.changed(), if !is_final => is_final = changed.is_err(),
            Some(ended) = tasks.join_next() => match ended {
                // The server is no longer listed, or the worker shuts down.
                Ok(Ok(server)) => _ = served.remove(&server),
                Ok(Err(error)) => return Err(error),
                Err(error) => std::panic::resume_unwind(error.into_panic()),
            },
            () = worker.shutdown.wait() => return Ok(()),
        }
    }
}

/// Decides for NPCs of one server until the shutdown, or until the server is no longer listed.
async fn serve(
    worker: Arc<Worker>,
    address: String,
    mut listed: watch::Receiver<BTreeSet<String>>,
) -> Result<String, WorkError> {
    let server = worker.config.credentials.dial(&address)?;
    let mut pause = MIN_PAUSE;
    // A server without its lease has no worlds, even if it has not noticed.
    let gone = async {
        if listed.wait_for(|listed| !listed.contains(&address)).await.is_err() {
            std::future::pending::<()>().await;
        }
    };
    let sessions = async {
        loop {
            let end = worker.session(&address).run(&server).await;
            worker.capacity_share.leave(&address);
            let status = match end {
                SessionEnd::OtherPolicy(status) => return WorkError::OtherPolicy(status),
                SessionEnd::Refused(status) if is_final(status.code()) => return WorkError::Refused(status),
                SessionEnd::Refused(status) => status,
                SessionEnd::Lost(status) => {
                    pause = MIN_PAUSE;
                    status
                }
            };
            warn!(server = address, %status, pause_ms = pause.as_millis(), "no connection to the server; retrying");
            tokio::time::sleep(pause).await;
            pause = (pause * 2).min(MAX_PAUSE);
        }
    };
    let ended = tokio::select! {
        error = sessions => Err(error),
        () = gone => Ok(()),
        () = worker.shutdown.wait() => Ok(()),
    };
    worker.capacity_share.leave(&address);
    ended.map(|()| address)
}

/// Whether a retry with the same worker would fail again.
fn is_final(code: Code) -> bool {
    use Code::{FailedPrecondition, InvalidArgument, PermissionDenied, Unauthenticated};
    matches!(code, FailedPrecondition | InvalidArgument | PermissionDenied | Unauthenticated)
}
