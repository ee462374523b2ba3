//! Saves and restores worlds. In a fleet, also takes worlds over from other servers, and drops worlds that others have.

use super::{CONFIRM_LIMIT, WorldHandle, Worlds, WorldsError};
use crate::hosted::{HostedWorld, Journal, RestoredMap, SavedError, SavedMap, StateFolder, WorldSave};
use crate::ids::WorldId;
use crate::store::{LeaseEpoch, LoadedWorld, ServerInfo, SharedStore, StoreError, WorldStore};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_net::levels::{BaseMap, LevelError, LevelStore, SharedMap};
use surefoot_net::memory::Reservation;
use surefoot_net::serving::Caller;
use tokio::task::JoinSet;
use tokio::time::Instant;
use tracing::{info, warn};

/// Time limit of saving all worlds while the server runs.
const SAVE_LIMIT: Duration = Duration::from_secs(60);
/// Longest wait for the journal of a world.
const JOURNAL_LIMIT: Duration = Duration::from_millis(20);
/// Longest wait for the save of a world.
const WORLD_LIMIT: Duration = Duration::from_secs(5);
/// Most bytes that decoding needs for each byte of a saved map.
const DECODE_FACTOR: u64 = 8;

impl Worlds {
    /// Opens the configured store or folder for saved worlds. A folder is locked against other processes.
    pub fn open_state(&self) -> Result<(), SavedError> {
        let config = &self.inner.config;
        let store = match (&config.store, &config.state) {
            (Some(store), _) => store.clone(),
            (None, Some(path)) => Arc::new(StateFolder::open(path)?),
            (None, None) => return Ok(()),
        };
        // Opened once, at the start.
        let _ = self.inner.store.set(store);
        Ok(())
    }

    pub(crate) fn store(&self) -> Option<&Arc<dyn WorldStore>> {
        self.inner.store.get()
    }

    /// The part of the store that the servers of a fleet share; `None` without a fleet.
    pub(crate) fn shared_store(&self) -> Option<&dyn SharedStore> {
        self.store()?.shared()
    }

    /// The epoch of a world's event cursors. In a fleet it belongs to the world, because cursors outlive the server.
    pub fn epoch_of(&self, id: WorldId) -> u64 {
        if self.shared_store().is_some() { id.0 } else { self.epoch() }
    }

    /// The server that has a world; `None` if there is no such world.
    pub async fn locate(&self, id: WorldId) -> Result<Option<ServerInfo>, WorldsError> {
        match self.shared_store() {
            Some(shared) => Ok(shared.locate(id).await?),
            None => Ok(self.handle(id).ok().map(|_| self.here())),
        }
    }

    /// All servers of the fleet; only this one without a fleet.
    pub async fn servers(&self) -> Result<Vec<ServerInfo>, WorldsError> {
        match self.shared_store() {
            Some(shared) => Ok(shared.servers().await?),
            None => Ok(vec![self.here()]),
        }
    }

    fn here(&self) -> ServerInfo {
        let world_count = self.ids().len() as u64;
        ServerInfo { address: String::new(), is_here: true, is_alive: true, world_count }
    }

    /// Restores saved worlds until the server shuts down. A world that cannot be restored is logged, and its file is
    /// not changed; no other world gets its id.
    pub async fn restore_all(&self) -> Result<(), StoreError> {
        let Some(store) = self.store() else { return Ok(()) };
        for id in store.list().await? {
            self.inner.last_world.fetch_max(id.0, Ordering::Relaxed);
            let restored = tokio::select! {
                restored = self.restore(id, LeaseEpoch::default()) => restored,
                () = self.inner.shutdown.wait() => return Ok(()),
            };
            if let Err(error) = restored {
                warn!(world_id = id.0, %error, "cannot restore a saved world; its file was left in place");
            }
        }
        Ok(())
    }

    /// The lease epoch of this server, in a fleet.
    fn lease_epoch(&self) -> LeaseEpoch {
        self.shared_store().map(SharedStore::lease_epoch).unwrap_or_default()
    }

    /// Worlds of this server, in a fleet: they run, are being restored, or wait after a failure.
    pub(crate) fn held(&self) -> Vec<WorldId> {
        // In this order, because a world runs before its takeover ends.
        let mut held = self.inner.takeovers.ids();
        held.extend(self.ids());
        held.into_iter().collect()
    }

    /// Begins to restore a world that this server has claimed in `lease_epoch`.
    pub(crate) fn begin_takeover(&self, id: WorldId, lease_epoch: LeaseEpoch) {
        self.inner.takeovers.begin(id);
        let worlds = self.clone();
        tokio::spawn(async move {
            let taking = tokio::spawn({
                let worlds = worlds.clone();
                async move { worlds.take_over(id, lease_epoch).await }
            });
            if taking.await.is_err() {
                // It panicked.
                worlds.inner.takeovers.note_failure(id);
            }
            worlds.inner.takeovers.end(id);
        });
    }

    /// Restores a world that this server has claimed. A world that it cannot run is handed back, and not tried again
    /// for a while.
    async fn take_over(&self, id: WorldId, lease_epoch: LeaseEpoch) {
        // Never closed.
        let _turn = self.inner.takeovers.turns.acquire().await.ok();
        if self.inner.shutdown.is_triggered() || self.lease_epoch() != lease_epoch {
            return;
        }
        let (world_id, takeovers) = (id.0, &self.inner.takeovers);
        match self.restore(id, lease_epoch).await {
            Ok(()) => _ = self.inner.taken_over_count.fetch_add(1, Ordering::Relaxed),
            Err(StoreError::Lost(_)) => {}
            // The next claim returns it again.
            Err(StoreError::Unavailable(error)) => warn!(world_id, error, "cannot read the world now; trying again"),
            Err(error) => {
                warn!(world_id, %error, "cannot restore the world here; handing it back to the fleet");
                takeovers.note_failure(id);
                let Some(shared) = self.shared_store() else { return };
                let handed = tokio::time::timeout(shared.lease(), shared.hand_back(id)).await;
                if !matches!(handed, Ok(Ok(()) | Err(StoreError::Lost(_)))) {
                    warn!(
                        world_id,
                        "cannot hand the world back (the database does not answer); trying to restore it again"
                    );
                }
            }
        }
    }

    /// Restores one world and starts it, unless `lease_epoch` has ended.
    pub(crate) async fn restore(&self, id: WorldId, lease_epoch: LeaseEpoch) -> Result<(), StoreError> {
        let Some(store) = self.store() else { return Ok(()) };
        let LoadedWorld { world: saved, since } = store.read(id).await?;
        let is_in_fleet = since.is_some();
        let (shared, reading) = if is_in_fleet { self.make_room(&saved).await? } else { (None, None) };
        let known = shared.as_ref().map(|shared| shared.map().clone());
        let make =
            move || Ok::<_, SavedError>((known.map_or_else(|| saved.maps(), |base| saved.maps_on(base))?, saved));
        let base = tokio::task::spawn_blocking(make).await;
        let (RestoredMap { base, map }, saved) = base.map_err(|error| StoreError::Unavailable(error.to_string()))??;
        drop(reading);
        let world_id = id.0;
        if base.spec().is_none() {
            let owner = Caller::on_behalf_of(saved.owner());
            match self.inner.levels.put(&owner, saved.level().to_owned(), base.clone()) {
                Ok(_) => {}
                Err(LevelError::Memory(error)) if is_in_fleet => return Err(cannot_run(&error)),
                Err(error) => {
                    warn!(world_id, %error, "cannot keep the map of a restored world; MapService does not return it");
                }
            }
        }
        if self.lease_epoch() != lease_epoch {
            return Err(StoreError::Lost(id));
        }
        let mut world = HostedWorld::restore(&saved, map, self.inner.registry.clone(), &self.inner.npc_quota);
        if let Some((log, journals)) = since {
            world.resume(log, journals, &self.inner.npc_quota);
        }
        let (npcs, tick) = (world.npc_count(), world.tick().0);
        let ticket = self.inner.world_quota.grant(saved.owner());
        // In a fleet, the store has assigned the world already: --max-worlds does not apply.
        let limit = if is_in_fleet { usize::MAX } else { self.inner.config.max_worlds };
        let shared = shared.unwrap_or_else(|| self.maps().adopt(saved.owner(), base));
        self.start(id, world, (shared, ticket), limit).map_err(|error| cannot_run(&error))?;
        info!(world_id, npcs, tick, "world restored");
        Ok(())
    }

    /// Reserves memory for restoring a world of the fleet, and generates its map. A server without a fleet restores its
    /// worlds one by one, even beyond the budget. In a fleet, another server may have room.
    async fn make_room(&self, saved: &WorldSave) -> Result<(Option<Arc<SharedMap>>, Option<Reservation>), StoreError> {
        match saved.source() {
            // Worlds with equal maps share them.
            SavedMap::Spec(spec) => {
                let base = self.maps().get(saved.owner(), &BaseMap::Spec(*spec)).await;
                Ok((Some(base.map_err(|error| cannot_run(&error))?), None))
            }
            SavedMap::File(_, bytes) => {
                let reserved = self.maps().memory().reserve(saved.owner(), DECODE_FACTOR * bytes.len() as u64);
                Ok((None, Some(reserved.map_err(|error| cannot_run(&error))?)))
            }
        }
    }

    /// Saves all worlds, if there is a store; with `is_last` they end. If a world cannot be saved within `limit`, its
    /// previous save is kept. Returns the first error; the other worlds are saved nevertheless.
    pub async fn save_all(&self, is_last: bool, limit: Duration) -> Result<(), StoreError> {
        if self.store().is_none() {
            return Ok(());
        }
        let too_slow = || StoreError::Saved(SavedError::TooSlow(limit));
        let deadline = Instant::now() + limit;
        let Ok(_saving) = tokio::time::timeout_at(deadline, self.inner.saving.lock()).await else {
            return Err(too_slow());
        };
        let mut saving = JoinSet::new();
        for id in self.ids() {
            let worlds = self.clone();
            saving.spawn(async move { worlds.save(id, is_last).await });
        }
        let mut first_error = None;
        loop {
            match tokio::time::timeout_at(deadline, saving.join_next()).await {
                Ok(None) => break,
                Ok(Some(Ok(Ok(())) | Err(_))) => {}
                Ok(Some(Ok(Err(error)))) => _ = first_error.get_or_insert(error),
                Err(_) => {
                    first_error.get_or_insert(too_slow());
                    break;
                }
            }
        }
        first_error.map_or(Ok(()), Err)
    }

    /// Saves one world, and logs a failure; with `is_last` the world ends. A world that another server has is dropped.
    pub(crate) async fn save(&self, id: WorldId, is_last: bool) -> Result<(), StoreError> {
        let lease_epoch = self.lease_epoch();
        let (Some(store), Ok(handle)) = (self.store(), self.handle(id)) else { return Ok(()) };
        if self.lease_epoch() != lease_epoch {
            return Ok(());
        }
        let saved_world = handle.saving.clone();
        // Continues if the caller is dropped: a world that is dropped meanwhile must not come back.
        let saving = tokio::spawn(save((id, handle), self.inner.levels.clone(), store.clone(), (lease_epoch, is_last)));
        let saved = saving.await.unwrap_or(Ok(()));
        match &saved {
            Ok(()) => {}
            // The world that runs now may be of the next lease epoch, or restored after a panic.
            Err(StoreError::Lost(_)) if self.lease_epoch() != lease_epoch => {}
            Err(StoreError::Lost(_)) => {
                let is_same = |now: WorldHandle| Arc::ptr_eq(&now.saving, &saved_world);
                if self.handle(id).is_ok_and(is_same) {
                    self.lose(id, "another server has it");
                }
            }
            Err(error) => {
                warn!(world_id = id.0, %error, "cannot save a world; its previous save is kept");
                self.inner.failed_save_count.fetch_add(1, Ordering::Relaxed);
            }
        }
        saved
    }

    /// Saves a new world in the store of the fleet before the client gets its id. If the save may have failed, the
    /// world stops; it is restored if the store has it.
    pub(super) async fn persist_new(&self, id: WorldId) -> Result<(), WorldsError> {
        if self.shared_store().is_none() {
            return Ok(());
        }
        let silent = || StoreError::Unavailable(format!("no answer within {} s", CONFIRM_LIMIT.as_secs()));
        let saved = tokio::time::timeout(CONFIRM_LIMIT, self.save(id, false)).await;
        let saved = saved.unwrap_or_else(|_| Err(silent()));
        if saved.is_err() {
            self.lose(id, "it cannot be saved");
        }
        Ok(saved?)
    }

    /// Saves all worlds periodically until the shutdown.
    pub async fn save_loop(self) {
        let mut due = tokio::time::interval(self.inner.config.save_every);
        due.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = self.inner.shutdown.wait();
        tokio::pin!(stopping);
        // The first tick of an interval is due at once.
        due.tick().await;
        loop {
            tokio::select! {
                _ = due.tick() => {}
                () = &mut stopping => return,
            }
            // Each failure has been logged.
            let _ = self.save_all(false, SAVE_LIMIT).await;
        }
    }

    /// The journals of all worlds that are not in the store yet. Worlds that do not answer at once are left out.
    pub(crate) async fn unconfirmed(&self) -> Vec<(WorldId, Journal)> {
        let deadline = Instant::now() + JOURNAL_LIMIT;
        let mut calls = Vec::new();
        for (id, sim) in self.running() {
            calls.push((id, tokio::spawn(async move { sim.call(|state| state.world.unconfirmed()).await })));
        }
        let mut journals = Vec::new();
        for (id, answer) in calls {
            if let Ok(Ok(Ok(Some(journal)))) = tokio::time::timeout_at(deadline, answer).await {
                journals.push((id, journal));
            }
        }
        journals
    }

    /// Lets readers of a world see its events up to the number `through`.
    pub(crate) fn confirm(&self, id: WorldId, through: u64) {
        let sim = self.inner.worlds.read().get(&id).map(|handle| handle.sim.clone());
        let Some(sim) = sim else { return };
        // If the world is too busy, the next journal has the same events again.
        let _ = sim.cast(move |state| state.world.confirm(through));
    }

    /// Stops a world that another server has or will have.
    pub(crate) fn lose(&self, id: WorldId, why: &str) {
        let lost = self.inner.worlds.write().remove(&id);
        if let Some(handle) = lost {
            warn!(world_id = id.0, why, "stopped serving the world");
            let _ = handle.sim.cast(|state| state.is_over = true);
        }
    }

    /// Stops all worlds, which other servers have or will have.
    pub(crate) fn lose_all(&self, why: &str) {
        self.ids().into_iter().for_each(|id| self.lose(id, why));
    }
}

fn cannot_run(error: &dyn std::fmt::Display) -> StoreError {
    StoreError::CannotRun(error.to_string())
}

/// Saves one world. If it has just been dropped, or does not answer in time, its previous save is not changed.
async fn save(
    (id, handle): (WorldId, WorldHandle),
    levels: LevelStore,
    store: Arc<dyn WorldStore>,
    (lease_epoch, is_last): (LeaseEpoch, bool),
) -> Result<(), StoreError> {
    let WorldHandle { sim, ticket, shown, saving, is_dropped, .. } = handle;
    let _saving = saving.lock().await;
    let map = shown.get();
    let level = levels.name_of(map.built_hash()).unwrap_or_default();
    let Ok(source) = tokio::task::spawn_blocking(move || SavedMap::of(&map, level)).await else { return Ok(()) };
    let saved = sim.call(move |state| {
        state.is_over |= is_last;
        (state.world.save(ticket.client(), source), state.world.save_log())
    });
    let saved = tokio::time::timeout(WORLD_LIMIT, saved).await;
    // Locked only now, because a stuck world can be dropped meanwhile.
    let is_dropped = is_dropped.lock().await;
    let (saved, log) = match saved {
        _ if *is_dropped => return Ok(()),
        Err(_) => return Err(StoreError::Silent(id)),
        Ok(Err(_)) => return Ok(()),
        Ok(Ok(saved)) => saved,
    };
    let through = log.written();
    store.write(lease_epoch, saved, log).await?;
    // A world that has just ended has no readers.
    let _ = sim.cast(move |state| state.world.confirm(through));
    Ok(())
}
