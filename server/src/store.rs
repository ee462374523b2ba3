//! Stores of worlds that outlive the process: the interface, and the folder of a single server, which implements it.
//!
//! The servers of a fleet share a store. Then a world belongs to one server at a time, which must hold a lease, and
//! events between two saves are written to the store before clients see them.

use crate::hosted::{Journal, SavedError, SavedLog, StateFolder, WorldSave};
use crate::ids::WorldId;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;
pub use tonic::async_trait;

/// Why a store does not carry out a call.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Saved(#[from] SavedError),
    /// Another server has the world.
    #[error("world {0} runs on another server")]
    Lost(WorldId),
    /// The lease of this server has expired: other servers may have its worlds.
    #[error("the lease of this server has expired")]
    Expired,
    /// The store of the fleet does not answer, or refuses the call.
    #[error("{0}")]
    Unavailable(String),
    /// Too many look-ups wait for the store.
    #[error("too many look-ups wait: try again")]
    Busy,
    /// The world's thread does not answer.
    #[error("world {0} does not answer: its previous save is kept")]
    Silent(WorldId),
    /// This server has no memory or no thread for the world; holds the reason.
    #[error("this server cannot run the world now: {0}")]
    CannotRun(String),
}

/// A world as a store returns it.
#[derive(Debug)]
pub struct LoadedWorld {
    /// The latest save.
    pub world: WorldSave,
    /// The events at the save, and the journals since then; `None` if the store does not keep events.
    pub since: Option<(SavedLog, Vec<Journal>)>,
}

/// A period in which a server holds its lease without a gap. Writes of an earlier epoch are refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeaseEpoch(pub i64);

/// A server of a fleet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerInfo {
    /// URI for clients and workers; empty: the URI at which this server was reached.
    pub address: String,
    /// Whether it is this server.
    pub is_here: bool,
    /// Whether it holds its lease. Otherwise its worlds will be taken over.
    pub is_alive: bool,
    /// Number of its worlds.
    pub world_count: u64,
}

/// A store of worlds.
#[async_trait]
pub trait WorldStore: fmt::Debug + Send + Sync {
    /// The worlds that this server restores at its start, in ascending order.
    async fn list(&self) -> Result<Vec<WorldId>, StoreError>;

    /// Reads a world.
    async fn read(&self, id: WorldId) -> Result<LoadedWorld, StoreError>;

    /// Replaces the save of a world by one that was made in `lease_epoch`, atomically. It is durable when this returns.
    async fn write(&self, lease_epoch: LeaseEpoch, world: WorldSave, log: SavedLog) -> Result<(), StoreError>;

    /// Deletes the save of a world.
    async fn forget(&self, id: WorldId) -> Result<(), StoreError>;

    /// The part that the servers of a fleet share; `None` if this server is alone.
    fn shared(&self) -> Option<&dyn SharedStore>;
}

/// The part of a store that the servers of a fleet share.
#[async_trait]
pub trait SharedStore: fmt::Debug + Send + Sync {
    /// Time after which a silent server loses its worlds.
    fn lease(&self) -> Duration;

    /// The current lease epoch of this server.
    fn lease_epoch(&self) -> LeaseEpoch;

    /// Whether this server certainly holds its lease.
    fn holds_lease(&self) -> bool;

    /// Extends the lease.
    async fn renew(&self) -> Result<(), StoreError>;

    /// Gives up all worlds, and joins as a new server without worlds: the next lease epoch begins.
    async fn rejoin(&self) -> Result<(), StoreError>;

    /// Ends the lease, so that other servers take over at once.
    async fn leave(&self) -> Result<(), StoreError>;

    /// Resolves when a server may have left.
    async fn changed(&self);

    /// Returns a new id of at least `earliest`, which no world of the fleet has had.
    async fn new_id(&self, earliest: WorldId) -> Result<WorldId, StoreError>;

    /// Takes over this server's share of the worlds without a living server, up to `max_worlds` in all. Also returns
    /// worlds that the store already assigns to this server, such as after a claim whose answer was lost. Worlds in
    /// `held` are left out: the server runs or restores them, or waits after a failure. Calls with an earlier claim to
    /// a world, such as a save, fail.
    async fn claim(&self, max_worlds: usize, held: &[WorldId]) -> Result<Vec<WorldId>, StoreError>;

    /// Gives up a world that this server cannot run, so that another server takes it over.
    async fn hand_back(&self, id: WorldId) -> Result<(), StoreError>;

    /// Appends journals that were made in `lease_epoch`. Returns whether each was appended; if not, another server has
    /// the world. Worlds that were never saved are left out. If the lease epoch has ended, all are left out.
    async fn append_journals(
        &self,
        lease_epoch: LeaseEpoch,
        journals: &[(WorldId, Journal)],
    ) -> Result<BTreeMap<WorldId, bool>, StoreError>;

    /// The server that has a world; `None` if there is no such world.
    async fn locate(&self, id: WorldId) -> Result<Option<ServerInfo>, StoreError>;

    /// All servers that hold their lease.
    async fn servers(&self) -> Result<Vec<ServerInfo>, StoreError>;
}

#[async_trait]
impl WorldStore for StateFolder {
    async fn list(&self) -> Result<Vec<WorldId>, StoreError> {
        Ok(self.files()?.into_keys().collect())
    }

    async fn read(&self, id: WorldId) -> Result<LoadedWorld, StoreError> {
        let path = self.file_of(id);
        let world = on_disk(move || WorldSave::read(&path)).await?;
        Ok(LoadedWorld { world, since: None })
    }

    async fn write(&self, _: LeaseEpoch, world: WorldSave, _: SavedLog) -> Result<(), StoreError> {
        let folder = self.clone();
        on_disk(move || folder.replace(&world)).await
    }

    async fn forget(&self, id: WorldId) -> Result<(), StoreError> {
        let folder = self.clone();
        on_disk(move || folder.remove(id)).await
    }

    fn shared(&self) -> Option<&dyn SharedStore> {
        None
    }
}

async fn on_disk<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, SavedError> + Send + 'static,
) -> Result<T, StoreError> {
    let done = tokio::task::spawn_blocking(work).await;
    Ok(done.map_err(|error| StoreError::Unavailable(error.to_string()))??)
}
