//! What planners that share a store agree on: which planner builds which graph, which builds are open, and what other
//! planners have changed. Crates that know databases implement [`Replicas`].

use crate::error::Failure;
use crate::jobs::{BuildId, BuildPhase};
use std::time::SystemTime;
use surefoot_planner::live::Counts;
use surefoot_planner::store::{LevelId, Receipt, StoreError};
use surefoot_planner::{Built, GraphId};
use tokio::sync::mpsc;

/// The right to publish one graph. It is lost when the planner falls silent for its lease; a later one has a greater number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Token(pub i64);

/// Who builds a graph.
#[derive(Debug, Clone, PartialEq)]
pub enum ClaimOutcome {
    /// This planner does.
    Ours(Token),
    /// Nobody: the graph is in the store.
    Published,
    /// Another planner, which has come so far; `None` if it has not said.
    Theirs(Option<BuildStatus>),
}

/// How far a build has come.
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
    /// How far it has come.
    pub status: BuildStatus,
    /// The graph, when it is done.
    pub graph: Option<GraphId>,
    /// Why it failed, if it did.
    pub failure: Option<Failure>,
    /// The clients that its planner knows to wait for it.
    pub requesters: Vec<String>,
    /// Those that have withdrawn by way of other planners.
    pub withdrawals: Withdrawals,
    /// When it was requested.
    pub started: SystemTime,
    /// Whether this planner runs it.
    pub is_ours: bool,
}

/// What clients have asked other planners about a build of this one.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Withdrawals {
    /// The clients that do not wait for it any more, in the order in which they said so.
    pub clients: Vec<String>,
    /// Whether it is cancelled for everybody.
    pub is_cancelled: bool,
}

/// How a planner stands among others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// Whether nobody can have taken over what it builds.
    pub holds_lease: bool,
    /// Graphs that it did not publish, because their claims had been lost.
    pub stale_publishes: u64,
}

/// Traversals that one call reported, and its receipt. Both are stored together, or neither if the receipt exists.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The call.
    pub receipt: Receipt,
    /// What it reported of edges that were proved.
    pub counts: Vec<Counts>,
}

/// Something that changed elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum News {
    /// A graph was published, or whoever built it gave up.
    Graph(GraphId),
    /// The layers of a level have changed.
    Layers(LevelId),
    /// The live evidence of a graph has changed.
    Evidence(GraphId),
    /// It is time to look for builds whose planners have died.
    Orphans,
    /// News may have been lost: anything may have changed.
    Everything,
}

/// What planners that share a store agree on. Calls block.
pub trait Replicas: Send + Sync {
    /// A number that tells the planners that run at a time apart.
    fn site(&self) -> u64;

    /// How this planner stands among the others.
    fn standing(&self) -> Standing {
        Standing { holds_lease: true, stale_publishes: 0 }
    }

    /// News of other planners, of whom this one is to take note; `None` after the first call.
    fn news(&self) -> Option<mpsc::Receiver<News>> {
        None
    }

    /// Claims the build of a graph for `build`, unless the graph is in the store or another planner that lives has claimed it.
    ///
    /// # Errors
    /// If the store is away, or this planner counts as dead at the moment.
    fn claim(&self, graph: &GraphId, build: BuildId) -> Result<ClaimOutcome, StoreError>;

    /// Gives a claim up.
    fn release(&self, graph: &GraphId);

    /// Stores a graph that this planner built, if its claim still holds; returns whether it does.
    ///
    /// # Errors
    /// If the store is away.
    fn publish(&self, graph: &GraphId, token: Token, recipe: &[u8], built: &Built) -> Result<bool, StoreError>;

    /// Returns how to make a graph that some planner has; `None` if none has.
    ///
    /// # Errors
    /// If the store is away.
    fn recipe(&self, graph: &GraphId) -> Result<Option<Vec<u8>>, StoreError>;

    /// Notes how to make a graph that is not stored itself, since it follows quickly from another.
    ///
    /// # Errors
    /// If the store is away.
    fn note_recipe(&self, graph: &GraphId, recipe: &[u8]) -> Result<(), StoreError>;

    /// Tells the others of a build of this planner. Returns what clients have asked them about it.
    ///
    /// # Errors
    /// If the store is away.
    fn post(&self, operation: &Operation) -> Result<Withdrawals, StoreError>;

    /// Returns a build of any planner.
    ///
    /// # Errors
    /// If the store is away.
    fn operation(&self, id: BuildId) -> Result<Option<Operation>, StoreError>;

    /// Returns the builds of all planners that are running or waiting.
    ///
    /// # Errors
    /// If the store is away.
    fn open_operations(&self) -> Result<Vec<Operation>, StoreError>;

    /// Tells the planner that runs a build which clients do not wait for it any more.
    ///
    /// # Errors
    /// If the store is away.
    fn withdraw(&self, id: BuildId, withdrawals: &Withdrawals) -> Result<(), StoreError>;

    /// Takes over builds whose planners have died, a few at a time.
    ///
    /// # Errors
    /// If the store is away.
    fn adopt(&self) -> Result<Vec<Operation>, StoreError>;

    /// Adds to the live evidence of a graph what calls have reported, unless it has been added before.
    ///
    /// # Errors
    /// If the store is away.
    fn add_evidence(&self, graph: &GraphId, reports: &[Report]) -> Result<(), StoreError>;

    /// Removes the live evidence of a graph that reporters of this name reported.
    ///
    /// # Errors
    /// If the store is away.
    fn drop_evidence(&self, graph: &GraphId, name: &str) -> Result<(), StoreError>;

    /// Leaves: others take over at once.
    fn leave(&self) {}
}
