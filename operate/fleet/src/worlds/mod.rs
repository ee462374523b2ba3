//! Worlds of a fleet: their owners (`rows`, in the database) and their saves (as blobs).
//!
//! Each save is a blob. The statement that writes its name into the row of the world checks the fencing token and the
//! lease. A server whose lease has expired writes blobs that nothing refers to.

mod lookups;
mod rows;

use crate::blobs::{BlobId, Blobs};
use crate::database::Database;
use crate::error::FleetError;
use crate::membership::{MemberKind, Membership};
use crate::notifications;
use lookups::Lookups;
use parking_lot::Mutex;
use rows::Ownership;
pub use rows::saves as saved;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;
use surefoot_server::WorldId;
use surefoot_server::hosted::{FleetSave, Journal, SavedError, SavedLog, WorldSave};
use surefoot_server::store::{LeaseEpoch, LoadedWorld, ServerInfo, SharedStore, StoreError, WorldStore, async_trait};
use tokio::sync::{Notify, mpsc};
use tokio::task::JoinSet;
use tracing::warn;

/// The store of a fleet's worlds, for one of its servers.
#[derive(Debug)]
pub struct FleetWorlds {
    database: Database,
    blobs: Blobs,
    membership: Membership,
    /// The worlds of this server.
    held: Mutex<BTreeMap<WorldId, Held>>,
    lookups: Lookups,
    /// The latest token when this server last claimed worlds. A world with a later one may be new: it may have started
    /// here after the caller listed the worlds that a claim skips.
    horizon: AtomicI64,
    /// Notified when a server has left.
    left: Arc<Notify>,
    /// Listens to other servers until this is dropped.
    _listening: JoinSet<()>,
}

/// A world that this server owns.
#[derive(Debug, Clone, Copy)]
struct Held {
    claim: Ownership,
    /// Name of the blob with the last save.
    blob: BlobId,
}

impl From<FleetError> for StoreError {
    fn from(error: FleetError) -> Self {
        Self::Unavailable(error.to_string())
    }
}

impl FleetWorlds {
    /// Makes this process a server of the fleet, which others reach at `address`.
    pub async fn join(database: Database, blobs: Blobs, address: &str, lease: Duration) -> Result<Self, FleetError> {
        let membership = Membership::join(&database, MemberKind::Server, address, lease).await?;
        let (left, mut listening) = (Arc::new(Notify::new()), JoinSet::new());
        let (sender, mut heard) = mpsc::channel(1);
        listening.spawn(notifications::listen(database.clone(), rows::CHANNEL, sender));
        let notified = left.clone();
        listening.spawn(async move {
            while heard.recv().await.is_some() {
                notified.notify_one();
            }
        });
        let (held, lookups, horizon) = (Mutex::default(), Lookups::default(), AtomicI64::new(0));
        Ok(Self { database, blobs, membership, held, lookups, horizon, left, _listening: listening })
    }

    fn held(&self, id: WorldId) -> Option<Held> {
        self.held.lock().get(&id).copied()
    }

    /// Notes how a save ended, unless the world has got a new token meanwhile.
    fn note_save(&self, id: WorldId, saved: Held, is_ours: bool) {
        let mut held = self.held.lock();
        if held.get(&id).is_some_and(|now| now.claim.token != saved.claim.token) {
            return;
        }
        if is_ours {
            held.insert(id, saved)
        } else {
            held.remove(&id)
        };
    }

    /// Removes a blob that no row refers to.
    async fn clear(&self, blob: BlobId) {
        if let Err(error) = self.blobs.remove(blob).await {
            warn!(%error, %blob, "server: cannot delete an unreferenced blob");
        }
    }
}

#[async_trait]
impl WorldStore for FleetWorlds {
    async fn list(&self) -> Result<Vec<WorldId>, StoreError> {
        // Worlds of a fleet are claimed.
        Ok(Vec::new())
    }

    async fn read(&self, id: WorldId) -> Result<LoadedWorld, StoreError> {
        let Held { blob, .. } = self.held(id).ok_or(StoreError::Lost(id))?;
        let place: PathBuf = format!("{} blob {blob}", self.blobs.place()).into();
        let damaged = || StoreError::Saved(SavedError::Damaged(place.clone()));
        let bytes = self.blobs.get(blob).await?.ok_or_else(damaged)?;
        let named = place.clone();
        let decode = move || FleetSave::decode(&bytes, &named);
        let kept = tokio::task::spawn_blocking(decode).await;
        let kept = kept.map_err(|error| StoreError::Unavailable(error.to_string()))??;
        let FleetSave { world, log, .. } = Some(kept).filter(|kept| kept.world.id() == id).ok_or_else(damaged)?;
        let journals = rows::journals(&self.database, id).await?.into_iter();
        let journals = journals.map(|(through, bytes)| Journal::decode(through, &bytes));
        let journals = journals.collect::<Result<_, _>>().map_err(|_| damaged())?;
        Ok(LoadedWorld { world, since: Some((log, journals)) })
    }

    async fn write(&self, lease_epoch: LeaseEpoch, world: WorldSave, log: SavedLog) -> Result<(), StoreError> {
        let (id, through) = (world.id(), log.written());
        let held = self.held(id);
        let claim = match held {
            Some(held) => held.claim,
            None => rows::new_claim(&self.database, self.membership.id()).await?,
        };
        if claim.member != lease_epoch.0 {
            return Err(StoreError::Lost(id));
        }
        // With the token, saves of two lease epochs are two blobs, even if the world has not changed.
        let save = FleetSave { token: claim.token, world, log };
        let bytes = tokio::task::spawn_blocking(move || save.encode()).await;
        let bytes = bytes.map_err(|error| StoreError::Unavailable(error.to_string()))?;
        let blob = self.blobs.put(bytes).await?;
        let is_ours = match held {
            Some(_) => rows::save(&self.database, id, claim, blob, through).await?,
            None => rows::insert(&self.database, id, claim, blob, through).await?,
        };
        let unneeded = if is_ours { held.map(|held| held.blob) } else { Some(blob) };
        self.note_save(id, Held { claim, blob }, is_ours);
        if let Some(unneeded) = unneeded.filter(|unneeded| *unneeded != blob || held.is_none_or(|it| it.blob != blob)) {
            self.clear(unneeded).await;
        }
        if is_ours { Ok(()) } else { Err(StoreError::Lost(id)) }
    }

    async fn forget(&self, id: WorldId) -> Result<(), StoreError> {
        let Held { claim, blob } = self.held(id).ok_or(StoreError::Lost(id))?;
        if !rows::forget(&self.database, id, claim).await? {
            return Err(StoreError::Lost(id));
        }
        self.held.lock().remove(&id);
        self.clear(blob).await;
        Ok(())
    }

    fn shared(&self) -> Option<&dyn SharedStore> {
        Some(self)
    }
}

#[async_trait]
impl SharedStore for FleetWorlds {
    fn lease(&self) -> Duration {
        self.membership.lease()
    }

    fn lease_epoch(&self) -> LeaseEpoch {
        LeaseEpoch(self.membership.id())
    }

    fn holds_lease(&self) -> bool {
        self.membership.holds_lease()
    }

    async fn renew(&self) -> Result<(), StoreError> {
        match self.membership.renew().await {
            Ok(true) => Ok(()),
            Ok(false) => Err(StoreError::Expired),
            Err(_) if !self.membership.holds_lease() => Err(StoreError::Expired),
            Err(error) => Err(error.into()),
        }
    }

    async fn rejoin(&self) -> Result<(), StoreError> {
        // In the database, the lease may still be valid, and with it the claims to worlds that this server has stopped.
        self.membership.leave().await?;
        self.held.lock().clear();
        self.membership.rejoin().await?;
        Ok(rows::notify(&self.database).await?)
    }

    async fn leave(&self) -> Result<(), StoreError> {
        self.membership.leave().await?;
        Ok(rows::notify(&self.database).await?)
    }

    async fn changed(&self) {
        self.left.notified().await;
    }

    async fn new_id(&self, earliest: WorldId) -> Result<WorldId, StoreError> {
        Ok(rows::new_id(&self.database, earliest).await?)
    }

    async fn claim(&self, max_worlds: usize, held: &[WorldId]) -> Result<Vec<WorldId>, StoreError> {
        let horizon = self.horizon.load(Ordering::Relaxed);
        let claimed = rows::claim(&self.database, &self.membership, max_worlds, (held, horizon)).await?;
        match rows::last_token(&self.database).await {
            Ok(last) => self.horizon.store(last, Ordering::Relaxed),
            Err(error) => {
                warn!(%error, "server: cannot read the latest token; lost claims wait for the next query")
            }
        }
        let mut held = self.held.lock();
        Ok(claimed
            .into_iter()
            .map(|(id, claim, blob)| {
                held.insert(id, Held { claim, blob });
                id
            })
            .collect())
    }

    async fn hand_back(&self, id: WorldId) -> Result<(), StoreError> {
        let Held { claim, .. } = self.held(id).ok_or(StoreError::Lost(id))?;
        if !rows::hand_back(&self.database, id, claim).await? {
            return Err(StoreError::Lost(id));
        }
        self.held.lock().remove(&id);
        Ok(rows::notify(&self.database).await?)
    }

    async fn append_journals(
        &self,
        lease_epoch: LeaseEpoch,
        journals: &[(WorldId, Journal)],
    ) -> Result<BTreeMap<WorldId, bool>, StoreError> {
        let held = journals.iter().filter_map(|(id, journal)| Some((*id, self.held(*id)?.claim, journal)));
        let held = held.filter(|(_, claim, _)| claim.member == lease_epoch.0);
        Ok(rows::append(&self.database, held.collect()).await?)
    }

    async fn locate(&self, id: WorldId) -> Result<Option<ServerInfo>, StoreError> {
        self.lookups.locate(&self.database, id, self.membership.id()).await
    }

    async fn servers(&self) -> Result<Vec<ServerInfo>, StoreError> {
        self.lookups.servers(&self.database, self.membership.id()).await
    }
}
