//! What planners that share a store agree on: which planner builds which graph, which builds are open, and what other
//! planners have changed. Crates that know databases implement [`Replicas`].

use crate::error::Failure;
use crate::jobs::{BuildId, BuildPhase};
use std::time::SystemTime;
use surefoot_planner::live::Counts;
use surefoot_planner::store::{LevelId, Receipt, StoreError};
use surefoot_planner::{Built, GraphId};
use tokio::sync::mpsc;

/// The right to publish one graph. A planner that does not renew its lease loses it. A later one has a greater number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Token(pub i64);

/// Which planner builds a graph.
#[derive(Debug, Clone, PartialEq)]
pub enum ClaimOutcome {
    /// This planner does.
    Ours(Token),
    /// No planner: the graph is in the store.
    Published,
    /// Another planner; `None` if it has not posted a status.
    Theirs(Option<BuildStatus>),
}

/// Status of a build.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuildStatus {
    /// The phase.
    pub phase: BuildPhase,
    /// Number of probes that have finished.
    pub done: u64,
    /// Number of probes that are known to be needed.
    pub total: u64,
}

/// A build as all planners see it.
#[derive(Debug, Clone, PartialEq)]
pub struct Operation {
    /// Identifies the build.
    pub id: BuildId,
    /// What is built: `wire::recipe` encodes it.
    pub recipe: Vec<u8>,
    /// Its status.
    pub status: BuildStatus,
    /// The graph, when it is done.
    pub graph: Option<GraphId>,
    /// Why it failed, if it did.
    pub failure: Option<Failure>,
    /// The clients that wait for it, as its planner knows.
    pub requesters: Vec<String>,
    /// Withdrawals through other planners.
    pub withdrawals: Withdrawals,
    /// When it was requested.
    pub started: SystemTime,
    /// Whether this planner runs it.
    pub is_ours: bool,
}

/// Withdrawals from a build through planners that do not run it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Withdrawals {
    /// The clients that no longer wait for it, in the order of their withdrawals.
    pub clients: Vec<String>,
    /// Whether it is cancelled for everybody.
    pub is_cancelled: bool,
}

/// A planner among others that share its store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// Whether it holds its lease, so that no other planner can have taken over its builds.
    pub holds_lease: bool,
    /// Number of graphs that were not published because their claims had been lost.
    pub stale_publishes: u64,
}

/// Traversals that one call reported, and its receipt. Both are stored together, or neither if the receipt exists.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The call.
    pub receipt: Receipt,
    /// The traversals along proved edges.
    pub counts: Vec<Counts>,
}

/// A change by another planner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum News {
    /// A graph was published, or its builder gave up.
    Graph(GraphId),
    /// The layers of a level have changed.
    Layers(LevelId),
    /// The live evidence of a graph has changed.
    Evidence(GraphId),
    /// Builds whose planners have died may be taken over.
    Orphans,
    /// News may have been lost: anything may have changed.
    Everything,
}

/// What planners that share a store agree on. Calls block, and fail while the store is unavailable.
pub trait Replicas: Send + Sync {
    /// A number that identifies this planner among those that run at the same time.
    fn site(&self) -> u64;

    /// Returns the lease and losses of this planner.
    fn standing(&self) -> Standing {
        Standing { holds_lease: true, stale_publishes: 0 }
    }

    /// Returns the changes by other planners; `None` after the first call.
    fn news(&self) -> Option<mpsc::Receiver<News>> {
        None
    }

    /// Claims the build of a graph for `build`, unless the graph is in the store or a living planner has claimed it.
    fn claim(&self, graph: &GraphId, build: BuildId) -> Result<ClaimOutcome, StoreError>;

    /// Releases a claim.
    fn release(&self, graph: &GraphId);

    /// Stores a graph that this planner built, if its claim still holds. Returns whether it does.
    fn publish(&self, graph: &GraphId, token: Token, recipe: &[u8], built: &Built) -> Result<bool, StoreError>;

    /// Returns the recipe of a graph; `None` if no planner has the graph.
    fn recipe(&self, graph: &GraphId) -> Result<Option<Vec<u8>>, StoreError>;

    /// Stores the recipe of a graph that is not stored itself, since it follows quickly from another.
    fn note_recipe(&self, graph: &GraphId, recipe: &[u8]) -> Result<(), StoreError>;

    /// Posts a build of this planner. Returns withdrawals through other planners.
    fn post(&self, operation: &Operation) -> Result<Withdrawals, StoreError>;

    /// Returns a build of any planner.
    fn operation(&self, id: BuildId) -> Result<Option<Operation>, StoreError>;

    /// Returns the builds of all planners that are running or waiting.
    fn open_operations(&self) -> Result<Vec<Operation>, StoreError>;

    /// Notes withdrawals from a build for the planner that runs it.
    fn withdraw(&self, id: BuildId, withdrawals: &Withdrawals) -> Result<(), StoreError>;

    /// Takes over a few builds whose planners have died.
    fn adopt(&self) -> Result<Vec<Operation>, StoreError>;

    /// Adds reports to the live evidence of a graph. A report that was added before is ignored.
    fn add_evidence(&self, graph: &GraphId, reports: &[Report]) -> Result<(), StoreError>;

    /// Removes the live evidence that reporters of this name reported.
    fn drop_evidence(&self, graph: &GraphId, name: &str) -> Result<(), StoreError>;

    /// Ends the lease, so that other planners take over at once.
    fn leave(&self) {}
}
