//! Why a planner cannot do what it is asked.

use surefoot_net::levels::LevelError;
use surefoot_planner::edits::LayerError;
use surefoot_planner::store::StoreError;
use surefoot_planner::{BuildError, VertexId};

/// Why a planner cannot do what it is asked. Cloned to all who wait for one build.
#[derive(Debug, Clone, thiserror::Error)]
pub enum PlannerError {
    /// A graph id is not one.
    #[error("graph_id is not 64 hexadecimal digits")]
    BadGraphId,
    /// No such graph is in memory.
    #[error("graph {0} is not loaded: call StartBuild first (a cached graph loads at once)")]
    UnknownGraph(String),
    /// A graph is no longer in memory.
    #[error("graph {0} is no longer loaded: call StartBuild")]
    Unloaded(String),
    /// There is no such build, or it ended too long ago.
    #[error("there is no build {0}, or it ended more than ten minutes ago")]
    UnknownBuild(String),
    /// A graph has no such vertex.
    #[error("{field} is {vertex}, the graph has {count} vertices")]
    UnknownVertex {
        /// Which field names it.
        field: &'static str,
        /// What it names.
        vertex: VertexId,
        /// Vertices that there are.
        count: usize,
    },
    /// A level has no such layer.
    #[error("there is no layer `{0}`")]
    UnknownLayer(String),
    /// As many builds run or wait as may.
    #[error("{0} builds run or wait already, the most allowed (--max-builds)")]
    TooManyBuilds(usize),
    /// The graph cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// An imported level cannot be used.
    #[error(transparent)]
    Level(#[from] LevelError),
    /// A layer is refused.
    #[error("layer: {0}")]
    Layer(#[from] LayerError),
    /// Layers were changed since the revision that the caller knows.
    #[error("somebody else has changed the layers of this level meanwhile: GetLayers tells how, then try again")]
    Overtaken,
    /// Layers cannot be read or kept.
    #[error("{what}: {reason}")]
    Store {
        /// What was tried.
        what: &'static str,
        /// Why it failed.
        reason: String,
    },
    /// The service is shutting down.
    #[error("the service is shutting down: connect again later")]
    ShuttingDown,
    /// Work in the background ended without a result.
    #[error("{what} failed: {reason}")]
    Lost {
        /// Which work.
        what: &'static str,
        /// How it ended.
        reason: String,
    },
}

impl PlannerError {
    /// Work in the background that ended without a result.
    pub(crate) fn lost(what: &'static str) -> impl FnOnce(tokio::task::JoinError) -> Self {
        move |error| Self::Lost { what, reason: error.to_string() }
    }

    /// A store that did not do what was tried.
    pub(crate) fn store(what: &'static str) -> impl FnOnce(StoreError) -> Self {
        move |error| Self::Store { what, reason: error.to_string() }
    }
}
