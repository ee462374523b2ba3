//! Errors of the planner.

use crate::origin::MARGIN_M;
use surefoot_net::levels::LevelError;
use surefoot_planner::edits::LayerError;
use surefoot_planner::store::{StoreError, StoreErrorKind};
use surefoot_planner::{BuildError, VertexId};
use surefoot_world::Vec3;

/// Why a build of another planner failed, as the contracts name it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// Name of the reason.
    pub reason: String,
    /// Message for the client.
    pub message: String,
}

/// Why a call of the planner failed. Every client that waits for a build gets a clone of its error.
#[derive(Debug, Clone, thiserror::Error)]
pub enum PlannerError {
    /// A graph id is malformed.
    #[error("graph_id is not 64 hexadecimal digits")]
    BadGraphId,
    /// A build id is missing.
    #[error("build_id is missing")]
    NoBuildId,
    /// The name of a reporter is missing.
    #[error("reporter is missing")]
    NoReporter,
    /// The graph is not in memory.
    #[error("graph {0} is not loaded: call StartBuild first (a cached graph loads at once)")]
    UnknownGraph(String),
    /// The graph was evicted from memory.
    #[error("graph {0} is no longer loaded: call StartBuild")]
    Unloaded(String),
    /// There is no such build, or it ended more than ten minutes ago.
    #[error("there is no build {0}, or it ended more than ten minutes ago")]
    UnknownBuild(String),
    /// The graph has no such vertex.
    #[error("{field} is {vertex}, but the graph has only {count} vertices")]
    UnknownVertex {
        /// Field of the request that names the vertex.
        field: &'static str,
        /// The vertex that does not exist.
        vertex: VertexId,
        /// Number of vertices of the graph.
        count: usize,
    },
    /// The level has no such layer.
    #[error("there is no layer `{0}`")]
    UnknownLayer(String),
    /// As many builds as allowed are running or waiting.
    #[error("{0} builds are already running or waiting, the maximum (--max-builds)")]
    TooManyBuilds(usize),
    /// As many builds as one client may ask for are running or waiting.
    #[error(
        "{0} builds that this client asked for are already running or waiting, the maximum (--max-builds-per-client)"
    )]
    TooManyBuildsOfClient(usize),
    /// A client tried to cancel a build that it has not asked for.
    #[error(
        "this client has not asked for build {0}, or has cancelled it already: \
         only clients that wait for it, or an admin, may cancel it"
    )]
    NotRequester(String),
    /// The caller requires a policy that the service does not have.
    #[error(
        "this planner proves edges with the policy {name} ({hash}), not with {wanted}: \
         start the planner and the workers with the same --model"
    )]
    OtherPolicy {
        /// Beginning of the hash that the caller requires.
        wanted: String,
        /// Name of the service's policy.
        name: String,
        /// Beginning of its hash.
        hash: String,
    },
    /// The graph cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// An imported level cannot be used.
    #[error(transparent)]
    Level(#[from] LevelError),
    /// A layer is invalid.
    #[error("layer: {0}")]
    Layer(#[from] LayerError),
    /// The layers are of another revision than the caller requires.
    #[error("the layers of this level have changed: read them with GetLayers, then try again")]
    LayersChanged,
    /// A request id was used for another request.
    #[error("request_id `{0}` was used for a different request: choose another id")]
    RequestIdReused(String),
    /// The stored answer of a call cannot be read.
    #[error("the answer to an earlier call with this request_id cannot be read")]
    BadReceipt,
    /// The change exceeds what one call or level may have.
    #[error("{field} has {found} {what}; at most {limit} are allowed in {scope}")]
    TooManyEdits {
        /// Field of the request.
        field: &'static str,
        /// Number that was found.
        found: usize,
        /// What was counted.
        what: &'static str,
        /// Maximum number.
        limit: usize,
        /// What the maximum applies to.
        scope: &'static str,
    },
    /// A start or goal lies far outside the map.
    #[error(
        "{field} is ({:.1}, {:.1}, {:.1}), more than {MARGIN_M} m outside the map, \
         which reaches from 0 to ({}, {}, {})",
        point.x, point.y, point.z, extent.x, extent.y, extent.z
    )]
    OutsideMap {
        /// Field of the request that names the point.
        field: &'static str,
        /// The point, m.
        point: Vec3,
        /// Size of the map, m.
        extent: Vec3,
    },
    /// The layers of the level cannot be read. Without them, plans could use forbidden edges.
    #[error("no plans are made on this level, because its layers cannot be read: {0}")]
    LayersUnreadable(String),
    /// Layers or reports cannot be read or stored.
    #[error("{what}: {reason}")]
    Store {
        /// What failed.
        what: &'static str,
        /// Why it failed.
        reason: String,
    },
    /// The shared store is unavailable.
    #[error("{what}, because the store is unavailable: {reason}")]
    StoreUnavailable {
        /// What failed.
        what: &'static str,
        /// Why it is unavailable.
        reason: String,
    },
    /// A build of another planner failed.
    #[error("{}", .0.message)]
    RemoteBuildFailed(Failure),
    /// The service is shutting down.
    #[error("the service is shutting down: connect again later")]
    ShuttingDown,
    /// A background task ended without a result.
    #[error("{what} failed: {reason}")]
    Lost {
        /// Name of the task.
        what: &'static str,
        /// How the task ended.
        reason: String,
    },
}

impl PlannerError {
    /// Converts the failure of a background task.
    pub(crate) fn lost(what: &'static str) -> impl FnOnce(tokio::task::JoinError) -> Self {
        move |error| Self::Lost { what, reason: error.to_string() }
    }

    /// Converts a failure of the store; `what` names what cannot be done.
    pub(crate) fn store(what: &'static str) -> impl FnOnce(StoreError) -> Self {
        move |error| match error.kind {
            StoreErrorKind::Unavailable => Self::StoreUnavailable { what, reason: error.to_string() },
            StoreErrorKind::Lost | StoreErrorKind::Refused => Self::Store { what, reason: error.to_string() },
        }
    }
}
