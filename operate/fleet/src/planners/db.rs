//! What the parts of [`FleetPlanner`](super::FleetPlanner) have in common: connections, membership, and how blocking
//! calls wait for them.

use crate::blobs::{BlobId, Blobs};
use crate::database::Database;
use crate::error::{DATABASE, FleetError};
use crate::membership::Membership;
use crate::notifications;
use parking_lot::Mutex;
use sqlx::{PgConnection, Postgres, Transaction};
use std::collections::BTreeSet;
use std::sync::atomic::AtomicU64;
use std::time::Duration;
use surefoot_planner::GraphId;
use surefoot_planner::store::{LevelId, StoreError, StoreErrorKind};
use tokio::runtime::Handle;
use tracing::warn;

/// Longest wait for the database, such as behind a broken network.
pub const PATIENCE: Duration = Duration::from_secs(5);
/// Longest wait for a call that reads or writes a blob.
pub const BLOB_PATIENCE: Duration = Duration::from_secs(30);
/// Name of the store in messages to clients, which must not contain its address.
pub const PLACE: &str = "the db store";
/// Channel of the notifications of all planners.
pub const CHANNEL: &str = "surefoot_planners";

/// The database and blobs of one planner.
#[derive(Debug)]
pub struct PlannerDb {
    /// The database.
    pub database: Database,
    /// Graphs and levels.
    pub blobs: Blobs,
    /// The membership of this planner.
    pub membership: Membership,
    /// Graphs that this planner is building.
    pub building: Mutex<BTreeSet<[u8; 32]>>,
    /// Number of graphs that were not published because their claims had been lost.
    pub stale_publishes: AtomicU64,
    /// Runs the futures of blocking calls.
    runtime: Handle,
}

impl PlannerDb {
    /// Creates a planner that builds nothing yet.
    pub fn new(database: Database, blobs: Blobs, membership: Membership, runtime: Handle) -> Self {
        Self { database, blobs, membership, building: Mutex::default(), stale_publishes: AtomicU64::new(0), runtime }
    }

    /// Waits for a call of the database.
    pub fn block<T>(&self, call: impl Future<Output = Result<T, FleetError>>) -> Result<T, StoreError> {
        self.block_for(PATIENCE, call)
    }

    /// Waits at most `patience` for a call.
    pub fn block_for<T>(
        &self,
        patience: Duration,
        call: impl Future<Output = Result<T, FleetError>>,
    ) -> Result<T, StoreError> {
        let silent = || FleetError::new(DATABASE, format!("no answer within {} s", patience.as_secs()));
        let within = async { tokio::time::timeout(patience, call).await.unwrap_or_else(|_| Err(silent())) };
        self.runtime.block_on(within).map_err(for_clients)
    }

    /// Renews the lease, or joins again if it has expired.
    pub async fn renew_lease(&self) -> Result<(), FleetError> {
        if !self.membership.renew().await? {
            let expired = self.membership.id();
            self.membership.rejoin().await?;
            warn!(member = expired, now = self.membership.id(), "planner: its lease expired; it joined again");
        }
        Ok(())
    }

    /// Begins a transaction.
    pub async fn begin(&self) -> Result<Transaction<'static, Postgres>, sqlx::Error> {
        self.database.pool.begin().await
    }

    /// Notifies all planners, once the transaction of `connection` is committed.
    pub async fn notify(&self, connection: &mut PgConnection, note: &Note) -> Result<(), sqlx::Error> {
        notifications::notify(connection, CHANNEL, &note.encode(self.membership.id())).await
    }
}

/// Logs a failure, and converts it for clients: without addresses or messages of the database.
fn for_clients(error: FleetError) -> StoreError {
    warn!(%error, "planner: a call of the shared store failed");
    let reason = match error.kind {
        StoreErrorKind::Unavailable => "it does not answer",
        StoreErrorKind::Lost => "an entry is gone or damaged",
        StoreErrorKind::Refused => "it refuses the call",
    };
    let reason = format!("{reason}; the log of the planner has details");
    StoreError { place: PLACE.to_owned(), reason, kind: error.kind }
}

/// A notification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Note {
    /// A graph was published, or its builder gave up.
    Graph(GraphId),
    /// The layers of a level have changed.
    Layers(LevelId),
    /// The evidence of a graph has changed.
    Evidence(GraphId),
    /// A planner has left.
    Left,
}

impl Note {
    fn encode(&self, member: i64) -> String {
        let hex = |hash: [u8; 32]| BlobId(hash);
        match *self {
            Self::Graph(id) => format!("graph {member} {}", hex(id.0)),
            Self::Layers(level) => format!("layers {member} {}", hex(level.0)),
            Self::Evidence(id) => format!("evidence {member} {}", hex(id.0)),
            Self::Left => format!("left {member}"),
        }
    }

    /// Decodes a notification and the id of its sender; `None` if its kind is unknown.
    pub fn decode(text: &str) -> Option<(Self, i64)> {
        let mut words = text.split(' ');
        let (kind, member) = (words.next()?, words.next()?.parse().ok()?);
        let mut hash = || Some(words.next()?.parse::<BlobId>().ok()?.0);
        let note = match kind {
            "graph" => Self::Graph(GraphId(hash()?)),
            "layers" => Self::Layers(LevelId(hash()?)),
            "evidence" => Self::Evidence(GraphId(hash()?)),
            "left" => Self::Left,
            _ => return None,
        };
        Some((note, member))
    }
}

/// Converts a number that is never negative.
pub fn unsigned(number: i64) -> u64 {
    u64::try_from(number).unwrap_or(0)
}

/// Converts a number, at most the largest that the database can hold.
pub fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_come_back_and_those_of_later_versions_are_passed_over() {
        for note in [
            Note::Graph(GraphId([1; 32])),
            Note::Layers(LevelId([2; 32])),
            Note::Evidence(GraphId([255; 32])),
            Note::Left,
        ] {
            assert_eq!(Note::decode(&note.encode(77)), Some((note, 77)));
        }
        for text in ["", "graph", "graph 7", "graph 7 zz", "worlds 7", "ping 7"] {
            assert_eq!(Note::decode(text), None, "{text}");
        }
    }
}
