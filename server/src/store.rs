//! Where worlds outlive the process: the interface of a store, and the folder of a single server, which implements it.
//!
//! A store may be shared by the servers of a fleet. Then a world belongs to one of them at a time, which has to hold a lease, and what
//! happens between two saves is recorded before anybody is told.

use crate::hosted::{Journal, SavedError, SavedLog, StateFolder, WorldSave};
use crate::ids::WorldId;
use std::collections::BTreeMap;
use std::fmt;
use std::pin::Pin;
use std::time::Duration;

/// A call of a store.
pub type StoreCall<'a, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 'a>>;

/// Why a store does not do what it is called for.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Saved(#[from] SavedError),
    /// Another server has the world.
    #[error("world {0} runs on another server")]
    Lost(WorldId),
    /// The lease of this server is over: others may have its worlds.
    #[error("the lease of this server has expired")]
    Expired,
    /// The store of the fleet does not answer, or refuses.
    #[error("{0}")]
    Unavailable(String),
    /// Too many look-ups wait for the store.
    #[error("too many look-ups wait: try again")]
    Busy,
    /// The world's thread does not answer.
    #[error("world {0} does not answer: it stays as it was saved before")]
    Silent(WorldId),
    /// This server has no memory or no thread for the world; says why.
    #[error("this server cannot run the world now: {0}")]
    CannotRun(String),
}

/// What a store has of a world.
#[derive(Debug)]
pub struct LoadedWorld {
    /// The world as it was saved last.
    pub world: WorldSave,
    /// Its events, and what has happened since; `None` if they end with the process.
    pub since: Option<(SavedLog, Vec<Journal>)>,
}

/// A time in which a server has worlds. It ends when others may have them; what was done in it must not count in the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeaseEpoch(pub i64);

/// A server of a fleet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerInfo {
    /// URI at which clients and workers reach it; empty: where this one was reached.
    pub address: String,
    /// Whether it is this server.
    pub is_here: bool,
    /// Whether it holds its lease. Otherwise its worlds are about to be taken over.
    pub is_alive: bool,
    /// Number of its worlds.
    pub world_count: u64,
}

/// Where worlds are saved.
pub trait WorldStore: fmt::Debug + Send + Sync {
    /// Worlds that this server restores at its start, in ascending order.
    fn list(&self) -> StoreCall<'_, Vec<WorldId>>;

    /// Reads a world.
    fn read(&self, id: WorldId) -> StoreCall<'_, LoadedWorld>;

    /// Saves a world, as it was in a lease epoch, in place of what was saved of it before: whole or not at all, and durable when this returns.
    fn write(&self, lease_epoch: LeaseEpoch, world: WorldSave, log: SavedLog) -> StoreCall<'_, ()>;

    /// Deletes what was saved of a world.
    fn forget(&self, id: WorldId) -> StoreCall<'_, ()>;

    /// The part that the servers of a fleet share; `None` if this server is alone.
    fn shared(&self) -> Option<&dyn SharedStore>;
}

/// What the servers of a fleet share.
pub trait SharedStore: fmt::Debug + Send + Sync {
    /// How long a silent server keeps its worlds.
    fn lease(&self) -> Duration;

    /// The lease epoch of this server.
    fn lease_epoch(&self) -> LeaseEpoch;

    /// Whether this server certainly holds its lease.
    fn holds_lease(&self) -> bool;

    /// Extends the lease.
    ///
    /// # Errors
    /// [`StoreError::Expired`] if it is over.
    fn renew(&self) -> StoreCall<'_, ()>;

    /// Gives up all worlds, and becomes a new server without any: the next lease epoch begins.
    fn rejoin(&self) -> StoreCall<'_, ()>;

    /// Ends the lease, so that others take over at once.
    fn leave(&self) -> StoreCall<'_, ()>;

    /// Resolves when servers may have left.
    fn changed(&self) -> Pin<Box<dyn Future<Output = ()> + Send + '_>>;

    /// Returns an id of at least `earliest` that no world of the fleet has had.
    fn new_id(&self, earliest: WorldId) -> StoreCall<'_, WorldId>;

    /// Takes over worlds without a living server: this server's share of them, as long as it has at most `max_worlds`. Also takes in those
    /// that are this server's in the store, such as after a claim whose answer was lost. `held` are neither: the server runs or restores
    /// them, or leaves them alone for a while. What is under way with an earlier claim to a world, such as a save, fails.
    fn claim<'a>(&'a self, max_worlds: usize, held: &'a [WorldId]) -> StoreCall<'a, Vec<WorldId>>;

    /// Gives up a world that this server cannot run, so that any other takes it over.
    fn hand_back(&self, id: WorldId) -> StoreCall<'_, ()>;

    /// Records what happened in a lease epoch. Says for each world whether it is recorded; if not, the world is another server's. Worlds that
    /// were never saved are left out, and all are if the lease epoch is over.
    fn append_journals<'a>(
        &'a self,
        lease_epoch: LeaseEpoch,
        journals: &'a [(WorldId, Journal)],
    ) -> StoreCall<'a, BTreeMap<WorldId, bool>>;

    /// Where a world runs; `None` if there is no such world.
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
