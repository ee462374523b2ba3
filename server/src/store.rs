//! Stores of worlds that outlive the process: the interface, and the folder of a single server, which implements it.
//!
//! The servers of a fleet share a store. Then a world belongs to one server at a time, which must hold a lease, and
//! events between two saves are written to the store before clients see them.

use crate::hosted::{Journal, SavedError, SavedLog, StateFolder, WorldSave};
use crate::ids::WorldId;
use std::collections::BTreeMap;
use std::fmt;
use std::pin::Pin;
use std::time::Duration;

/// A call of a store.
pub type StoreCall<'a, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 'a>>;

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
pub trait WorldStore: fmt::Debug + Send + Sync {
    /// The worlds that this server restores at its start, in ascending order.
    fn list(&self) -> StoreCall<'_, Vec<WorldId>>;

    /// Reads a world.
    fn read(&self, id: WorldId) -> StoreCall<'_, LoadedWorld>;

    /// Replaces the save of a world by one that was made in `lease_epoch`, atomically. It is durable when this returns.
    fn write(&self, lease_epoch: LeaseEpoch, world: WorldSave, log: SavedLog) -> StoreCall<'_, ()>;

    /// Deletes the save of a world.
    fn forget(&self, id: WorldId) -> StoreCall<'_, ()>;

    /// The part that the servers of a fleet share; `None` if this server is alone.
    fn shared(&self) -> Option<&dyn SharedStore>;
}

/// The part of a store that the servers of a fleet share.
pub trait SharedStore: fmt::Debug + Send + Sync {
    /// Time after which a silent server loses its worlds.
    fn lease(&self) -> Duration;

    /// The current lease epoch of this server.
    fn lease_epoch(&self) -> LeaseEpoch;

    /// Whether this server certainly holds its lease.
    fn holds_lease(&self) -> bool;

    /// Extends the lease.
    ///
    /// # Errors
    /// [`StoreError::Expired`] if it has expired.
    fn renew(&self) -> StoreCall<'_, ()>;

    /// Gives up all worlds, and joins as a new server without worlds: the next lease epoch begins.
    fn rejoin(&self) -> StoreCall<'_, ()>;

    /// Ends the lease, so that other servers take over at once.
    fn leave(&self) -> StoreCall<'_, ()>;

    /// Resolves when a server may have left.
    fn changed(&self) -> Pin<Box<dyn Future<Output = ()> + Send + '_>>;

    /// Returns a new id of at least `earliest`, which no world of the fleet has had.
    fn new_id(&self, earliest: WorldId) -> StoreCall<'_, WorldId>;

    /// Takes over this server's share of the worlds without a living server, up to `max_worlds` in all. Also returns
    /// worlds that the store already assigns to this server, such as after a claim whose answer was lost. Worlds in
    /// `held` are left out: the server runs or restores them, or waits after a failure. Calls with an earlier claim to
    /// a world, such as a save, fail.
    fn claim<'a>(&'a self, max_worlds: usize, held: &'a [WorldId]) -> StoreCall<'a, Vec<WorldId>>;

    /// Gives up a world that this server cannot run, so that another server takes it over.
    fn hand_back(&self, id: WorldId) -> StoreCall<'_, ()>;

    /// Appends journals that were made in `lease_epoch`. Returns whether each was appended; if not, another server has
    /// the world. Worlds that were never saved are left out. If the lease epoch has ended, all are left out.
    fn append_journals<'a>(
        &'a self,
        lease_epoch: LeaseEpoch,
        journals: &'a [(WorldId, Journal)],
    ) -> StoreCall<'a, BTreeMap<WorldId, bool>>;

    /// The server that has a world; `None` if there is no such world.
    fn locate(&self, id: WorldId) -> StoreCall<'_, Option<ServerInfo>>;

    /// All servers that hold their lease.
    fn servers(&self) -> StoreCall<'_, Vec<ServerInfo>>;
}

impl WorldStore for StateFolder {
    fn list(&self) -> StoreCall<'_, Vec<WorldId>> {
        Box::pin(async { Ok(self.files()?.into_keys().collect()) })
    }

    fn read(&self, id: WorldId) -> StoreCall<'_, LoadedWorld> {
        let path = self.file_of(id);
        Box::pin(async move {
            let world = on_disk(move || WorldSave::read(&path)).await?;
            Ok(LoadedWorld { world, since: None })
        })
    }

    fn write(&self, _: LeaseEpoch, world: WorldSave, _: SavedLog) -> StoreCall<'_, ()> {
        let folder = self.clone();
        Box::pin(on_disk(move || folder.replace(&world)))
    }

    fn forget(&self, id: WorldId) -> StoreCall<'_, ()> {
        let folder = self.clone();
        Box::pin(on_disk(move || folder.remove(id)))
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
