//! Errors of the planner.

use crate::origin::MARGIN_M;
use surefoot_net::levels::LevelError;
use surefoot_planner::edits::LayerError;
use surefoot_planner::store::{StoreError, StoreErrorKind};
use surefoot_planner::{BuildError, VertexId};

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
    #[error("graph_id is not 64 hexadecimal digits")]
    BadGraphId,
    #[error("build_id is missing")]
    NoBuildId,
    #[error("reporter is missing")]
    NoReporter,
    #[error("graph {0} is not loaded: call StartBuild first (a cached graph loads at once)")]
    UnknownGraph(String),
    #[error("graph {0} is no longer loaded: call StartBuild")]
    Unloaded(String),
    #[error("there is no build {0}, or it ended more than ten minutes ago")]
    UnknownBuild(String),
    #[error("{field} is {vertex}, but the graph has only {count} vertices")]
    UnknownVertex { field: &'static str, vertex: VertexId, count: usize },
    #[error("there is no layer `{0}`")]
    UnknownLayer(String),
    #[error("{0} builds are already running or waiting, the maximum (--max-builds)")]
    TooManyBuilds(usize),
    #[error(
        "{0} builds that this client asked for are already running or waiting, the maximum (--max-builds-per-client)"
    )]
    TooManyBuildsOfClient(usize),
    #[error(
        "this client has not asked for build {0}, or has cancelled it already: \
         only clients that wait for it, or an admin, may cancel it"
    )]
    NotRequester(String),
    #[error(
        "this planner proves edges with the policy {name} ({hash}), not with {wanted}: \
         start the planner and the workers with the same --model"
    )]
    OtherPolicy { wanted: String, name: String, hash: String },
    #[error(transparent)]
    Build(#[from] BuildError),
    #[error(transparent)]
    Level(#[from] LevelError),
    #[error("layer: {0}")]
    Layer(#[from] LayerError),
    #[error("the layers of this level have changed: read them with GetLayers, then try again")]
    LayersChanged,
    #[error("request_id `{0}` was used for a different request: choose another id")]
    RequestIdReused(String),
    #[error("the answer to an earlier call with this request_id cannot be read")]
    BadReceipt,
    #[error("{field} has {found} {what}; at most {limit} are allowed in {scope}")]
    TooManyEdits { field: &'static str, found: usize, what: &'static str, limit: usize, scope: &'static str },
    #[error("the area has more than {0} cells, the maximum: choose a larger resolution, or less time")]
    TooManyCells(usize),
    /// Place and span are for people.
    #[error("{field} is {place}: more than {MARGIN_M} m outside the map, which spans {span}")]
    OutsideMap { field: &'static str, place: String, span: String },
    /// The layers of the level cannot be read. Without them, plans could use forbidden edges.
    #[error("no plans are made on this level, because its layers cannot be read: {0}")]
    LayersUnreadable(String),
    #[error("{what}: {reason}")]
    Store { what: &'static str, reason: String },
    #[error("{what}, because the store is unavailable: {reason}")]
    StoreUnavailable { what: &'static str, reason: String },
    #[error("{}", .0.message)]
    RemoteBuildFailed(Failure),
    #[error("the service is shutting down: connect again later")]
    ShuttingDown,
    #[error("{what} failed: {reason}")]
    Lost { what: &'static str, reason: String },
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
