//! Calls about one or many NPCs: the worlds on which they run, and errors for worlds that are not here.

use super::{CONFIRM_LIMIT, NpcAccess, WorldHandle, Worlds, WorldsError};
use crate::hosted::{HostedWorld, NpcError, SpawnOrder};
use crate::ids::{NpcId, WorldId};
use crate::sim::{Receipt, SimState};
use crate::store::StoreError;
use std::collections::BTreeMap;
use std::time::Duration;
use surefoot_net::serving::Caller;

/// Longest wait until a world begins its part of a batch: a stalled world delays the others by no more than this.
const WORLD_LIMIT: Duration = Duration::from_secs(5);
/// Most worlds that a batch looks up on other servers of a fleet.
const MAX_LOOKUPS: usize = 16;

impl Worlds {
    /// Adds an NPC for the caller.
    pub async fn spawn(&self, caller: &Caller, world: WorldId, order: SpawnOrder) -> Result<NpcId, WorldsError> {
        self.spawn_many(caller, world, vec![Ok(order)]).await?.pop().expect("one result for one order")
    }

    /// Adds NPCs for the caller. Each has its own result.
    pub async fn spawn_many(
        &self,
        caller: &Caller,
        world: WorldId,
        orders: Vec<Result<SpawnOrder, WorldsError>>,
    ) -> Result<Vec<Result<NpcId, WorldsError>>, WorldsError> {
        let handle = self.handle_to_change(caller, world)?;
        let limit = self.inner.config.max_npcs_per_world;
        let take = |order| Ok((order?, self.inner.npc_quota.acquire(&caller.name).map_err(WorldsError::NpcQuota)?));
        let orders: Vec<Result<_, WorldsError>> = orders.into_iter().map(take).collect();
        let spawn = handle.sim.call(move |state| {
            let mut spawn = |(order, ticket)| Ok(state.world.spawn_to(order, limit, ticket)?);
            let results = orders.into_iter().map(|order| order.and_then(&mut spawn)).collect();
            (results, state.receipt())
        });
        let (results, receipt) = spawn.await?;
        confirmed(world, receipt).await?;
        Ok(results)
    }

    /// Runs `call` for each of the `items`, on the world of its NPC; returns the results in order. The items of one
    /// world are handled between two of its ticks.
    pub async fn with_npcs<T: Send + 'static, R: Send + 'static>(
        &self,
        caller: &Caller,
        access: NpcAccess,
        items: Vec<Result<(NpcId, T), WorldsError>>,
        call: impl Fn(&mut HostedWorld, NpcId, T) -> Result<R, NpcError> + Clone + Send + 'static,
    ) -> Vec<Result<R, WorldsError>> {
        let mut results: Vec<Option<Result<R, WorldsError>>> = (0..items.len()).map(|_| None).collect();
        let mut by_world: BTreeMap<WorldId, Vec<(usize, NpcId, T)>> = BTreeMap::new();
        for (idx, item) in items.into_iter().enumerate() {
            match item {
                Ok((npc, item)) => by_world.entry(npc.world()).or_default().push((idx, npc, item)),
                Err(error) => results[idx] = Some(Err(error)),
            }
        }
        let mut lookups = MAX_LOOKUPS;
        for (world, items) in by_world {
            let places: Vec<(usize, NpcId)> = items.iter().map(|(idx, npc, _)| (*idx, *npc)).collect();
            let done = match self.handle_for(caller, world) {
                Ok(handle) => on_world(handle, caller, access, items, call.clone()).await,
                Err(error) => {
                    let found = self.whereabouts_in_batch(world, &error, &mut lookups).await;
                    let error = |npc| found.as_ref().map_or(NpcError::Unknown(npc).into(), |it| it.error(world));
                    places.iter().map(|(_, npc)| Err(error(*npc))).collect()
                }
            };
            for ((idx, _), result) in places.into_iter().zip(done) {
                results[idx] = Some(result);
            }
        }
        results.into_iter().map(|result| result.expect("every item belongs to a world or has failed")).collect()
    }

    /// Where a world is that has not been found here; `None` if it does not exist. Queries the store of a fleet.
    pub(crate) async fn whereabouts(&self, world: WorldId) -> Option<Whereabouts> {
        match self.locate(world).await {
            Ok(None) => None,
            Ok(Some(server)) if server.is_here && self.handle(world).is_ok() => None,
            Ok(Some(server)) if server.is_alive && !server.is_here => Some(Whereabouts::Elsewhere(server.address)),
            // It will be restored, here or on another server.
            Ok(Some(_)) => Some(Whereabouts::Moving),
            Err(WorldsError::Store(StoreError::Busy)) => Some(Whereabouts::Busy),
            Err(error) => Some(Whereabouts::Unanswered(error.to_string())),
        }
    }

    /// Like [`whereabouts`](Self::whereabouts), for a batch that queries the store at most `lookups` times.
    async fn whereabouts_in_batch(
        &self,
        world: WorldId,
        error: &WorldsError,
        lookups: &mut usize,
    ) -> Option<Whereabouts> {
        if matches!(error, WorldsError::Moving(_)) {
            return Some(Whereabouts::Moving);
        }
        self.shared_store()?;
        let Some(left) = lookups.checked_sub(1) else { return Some(Whereabouts::Moving) };
        *lookups = left;
        self.whereabouts(world).await
    }

    /// Runs `call` on the world of `npc`.
    pub async fn with_npc<R: Send + 'static>(
        &self,
        caller: &Caller,
        access: NpcAccess,
        npc: NpcId,
        call: impl Fn(&mut HostedWorld) -> Result<R, NpcError> + Clone + Send + 'static,
    ) -> Result<R, WorldsError> {
        let call = move |world: &mut HostedWorld, _, ()| call(world);
        self.with_npcs(caller, access, vec![Ok((npc, ()))], call).await.pop().expect("one result for one item")
    }
}

/// Where a world is that is not here.
pub(crate) enum Whereabouts {
    /// Its server may be gone, or this server may have lost it.
    Moving,
    /// The server at this address has it.
    Elsewhere(String),
    /// Unknown: too many look-ups wait.
    Busy,
    /// Unknown: the store of the fleet does not answer; holds the reason.
    Unanswered(String),
}

impl Whereabouts {
    /// The error for a call about the world.
    pub fn error(&self, world: WorldId) -> WorldsError {
        match self {
            Self::Moving => WorldsError::Moving(world),
            Self::Elsewhere(address) => WorldsError::Elsewhere(world, address.clone()),
            Self::Busy => StoreError::Busy.into(),
            Self::Unanswered(why) => StoreError::Unavailable(why.clone()).into(),
        }
    }
}

/// Runs `call` for items of one world, between two of its ticks; the results in order.
async fn on_world<T: Send + 'static, R: Send + 'static>(
    handle: WorldHandle,
    caller: &Caller,
    access: NpcAccess,
    items: Vec<(usize, NpcId, T)>,
    call: impl Fn(&mut HostedWorld, NpcId, T) -> Result<R, NpcError> + Send + 'static,
) -> Vec<Result<R, WorldsError>> {
    let (world, count) = (handle.sim.figures().summary.id, items.len());
    let may_change_all = access == NpcAccess::Read || caller.may_change(handle.ticket.client());
    let caller = caller.clone();
    let work = move |state: &mut SimState| -> (Vec<_>, Option<Receipt>) {
        let one = |(_, npc, item)| {
            if !may_change_all && !caller.may_change(state.world.owner_of(npc)?) {
                return Err(NpcError::NotOwner(npc));
            }
            call(&mut state.world, npc, item)
        };
        let done = items.into_iter().map(one).collect();
        (done, if access == NpcAccess::Change { state.receipt() } else { None })
    };
    let (done, receipt) = match handle.sim.call_within(WORLD_LIMIT, work).await {
        Ok(done) => done,
        Err(error) => return (0..count).map(|_| Err(error.into())).collect(),
    };
    let is_confirmed = confirmed(world, receipt).await.is_ok();
    let confirm = |it| if is_confirmed { Ok(it) } else { Err(WorldsError::Unconfirmed(world)) };
    done.into_iter().map(|result| result.map_err(WorldsError::from).and_then(confirm)).collect()
}

/// Waits until a change is durable, in a fleet.
async fn confirmed(world: WorldId, receipt: Option<Receipt>) -> Result<(), WorldsError> {
    let Some(receipt) = receipt else { return Ok(()) };
    match tokio::time::timeout(CONFIRM_LIMIT, receipt.confirmed()).await {
        Ok(Ok(())) => Ok(()),
        // The world has ended, or the store does not answer.
        Ok(Err(_)) | Err(_) => Err(WorldsError::Unconfirmed(world)),
    }
}
