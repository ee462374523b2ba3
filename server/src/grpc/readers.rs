//! Streams to readers: snapshots, events, statistics and mesh of a world, and one NPC with its plan.
//!
//! A slow reader gets the latest snapshot, and at most one message waits for it; a reader that does not read at all is cut off.

use crate::geometry::Tiles;
use crate::hosted::{EndedAttempt, HostedWorld, NpcError, NpcEvent, NpcPlan, NpcState, Snapshot};
use crate::ids::{NpcId, WorldId};
use crate::sim::SimError;
use crate::sim::{EventBatch, SimHandle, SimState};
use crate::view::View;
use crate::wire::{
    ended_attempt_to_wire, events_to_wire, npc_plan_to_wire, npc_to_wire, rays_to_wire, shown_to_wire, stats_to_wire,
    tile_to_wire,
};
use crate::worlds::WorldsError;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use surefoot_net::reader::{Reader, ReaderStream};
use surefoot_net::serving::{Shutdown, shutting_down};
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_world::sense::Sight;
use surefoot_world::{Map, Tick};
use tokio::sync::broadcast::{Receiver, error::RecvError};
use tokio::sync::{Semaphore, watch};
use tonic::Status;

/// Most events that are copied out of a world's log at a time.
const EVENTS_AT_A_TIME: usize = 4096;
/// Pause before a call to a busy world is repeated.
const BUSY_PAUSE: Duration = Duration::from_millis(50);
/// Snapshots per second if the reader does not set a rate.
const DEFAULT_RATE: f64 = 10.0;

/// Returns the pause between two messages at a rate, 0.1 to 60 Hz; 0 means the default.
///
/// # Errors
/// If the rate is out of range.
pub fn pause_of(rate_hz: f32) -> Result<Duration, FieldError> {
    let rate = if rate_hz == 0.0 { DEFAULT_RATE } else { convert::in_range(f64::from(rate_hz), 0.1, 60.0, "rate_hz")? };
    Ok(Duration::from_secs_f64(1.0 / rate))
}

/// Returns the pause between two messages of statistics at a period of 0.1 to 60 s; 0 means one second.
///
/// # Errors
/// If the period is out of range.
pub fn period_of(period_s: f32) -> Result<Duration, FieldError> {
    let seconds = if period_s == 0.0 { 1.0 } else { convert::in_range(f64::from(period_s), 0.1, 60.0, "period_s")? };
    Ok(Duration::from_secs_f64(seconds))
}

/// Streams a reader's view of snapshots. Snapshots that come while it is not ready for the next are skipped.
pub fn watch_world(
    world_id: WorldId,
    mut snapshots: watch::Receiver<Arc<Snapshot>>,
    mut view: View,
    pause: Duration,
    patience: Duration,
    shutdown: &Shutdown,
) -> ReaderStream<wire::WatchWorldResponse> {
    let (mut reader, stream) = Reader::new(patience);
    let stopping = shutdown.wait();
    snapshots.mark_changed();
    tokio::spawn(async move {
        tokio::pin!(stopping);
        loop {
            let snapshot = tokio::select! {
                changed = snapshots.changed() => match changed {
                    Ok(()) => snapshots.borrow_and_update().clone(),
                    Err(_) => return reader.close(WorldsError::UnknownWorld(world_id).into()),
                },
                () = &mut stopping => return reader.close(shutting_down()),
                () = reader.closed() => return,
            };
            match reader.send(shown_to_wire(&view.show(&snapshot))).await {
                Some(still) => reader = still,
                None => return,
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                () = &mut stopping => return reader.close(shutting_down()),
                () = reader.closed() => return,
            }
        }
    });
    stream
}

/// Streams every wanted event of a world, past events first.
pub fn watch_events(
    begin: wire::WatchEventsResponse,
    mut source: EventSource,
    patience: Duration,
    shutdown: &Shutdown,
) -> ReaderStream<wire::WatchEventsResponse> {
    let (mut reader, stream) = Reader::new(patience);
    let stopping = shutdown.wait();
    tokio::spawn(async move {
        tokio::pin!(stopping);
        // The first message says where the stream begins, so that it can be resumed even if nothing happens.
        let mut messages = vec![begin];
        loop {
            for message in messages {
                match reader.send(message).await {
                    Some(still) => reader = still,
                    None => return,
                }
            }
            messages = tokio::select! {
                next = source.next() => match next {
                    Ok(messages) => messages,
                    Err(status) => return reader.close(status),
                },
                () = &mut stopping => return reader.close(shutting_down()),
                () = reader.closed() => return,
            };
        }
    });
    stream
}

/// Where a reader takes events from: the batches that a world publishes each tick, and the world's log while the reader
/// is behind them, as at its start. A slow reader falls behind when it misses batches. If the log has dropped what it
/// needs next, its stream ends.
pub struct EventSource {
    /// Epoch of the world's cursors.
    pub epoch: u64,
    /// The world of the events.
    pub world: WorldId,
    /// Only events of these NPCs; if empty, of all.
    pub npcs: BTreeSet<NpcId>,
    /// The world's thread, which has the log.
    pub sim: SimHandle,
    /// Batches since the subscription.
    pub batches: Receiver<Arc<EventBatch>>,
    /// Sequence number of the last event that the reader has; 0 means before the oldest event kept.
    pub after: u64,
    /// Whether the log is read.
    pub is_behind: bool,
}

impl EventSource {
    /// The next messages; there may be none in a batch.
    ///
    /// # Errors
    /// The status with which the stream ends.
    async fn next(&mut self) -> Result<Vec<wire::WatchEventsResponse>, Status> {
        if self.is_behind {
            return self.read_log().await;
        }
        let batch = match self.batches.recv().await {
            Ok(batch) => batch,
            Err(RecvError::Lagged(_)) => {
                self.is_behind = true;
                return Ok(Vec::new());
            }
            Err(RecvError::Closed) => return Err(WorldsError::UnknownWorld(self.world).into()),
        };
        // Events before the batch, or those of an empty one, did not come as a batch.
        self.is_behind = batch.after > self.after || batch.events.is_empty();
        if self.is_behind {
            return Ok(Vec::new());
        }
        let known = batch.events.partition_point(|event| event.sequence <= self.after);
        Ok(self.take(&batch.events[known..]))
    }

    async fn read_log(&mut self) -> Result<Vec<wire::WatchEventsResponse>, Status> {
        let after = self.after;
        let read = move |state: &mut SimState| {
            let log = state.world.events();
            log.after(after, EVENTS_AT_A_TIME).map(|events| (events, log.latest()))
        };
        match self.sim.call(read).await {
            Ok(Ok((events, latest))) => {
                self.is_behind = events.len() == EVENTS_AT_A_TIME;
                let messages = self.take(&events);
                if !self.is_behind {
                    // The last numbers may be those of events that were lost with another server.
                    self.after = self.after.max(latest);
                }
                Ok(messages)
            }
            // Events that were kept when the stream began are gone: the reader was too slow for the world.
            Ok(Err(error)) => Err(status::failure(Reason::ReaderTooSlow, error.to_string())),
            Err(SimError::Busy) => {
                // Without a pause this would be a busy loop, because there are events to be read.
                tokio::time::sleep(BUSY_PAUSE).await;
                Ok(Vec::new())
            }
            Err(SimError::Stopped) => Err(WorldsError::UnknownWorld(self.world).into()),
        }
    }

    /// Takes events: a message for each tick that has wanted ones.
    fn take(&mut self, events: &[NpcEvent]) -> Vec<wire::WatchEventsResponse> {
        self.after = events.last().map_or(self.after, |event| event.sequence);
        let ticks = events.chunk_by(|a, b| a.tick == b.tick);
        let messages = ticks.filter_map(|tick| events_to_wire(self.epoch, tick, &self.npcs));
        messages.filter(|message| !message.events.is_empty()).collect()
    }
}

/// Streams the statistics of a world periodically.
pub fn watch_stats(
    world: WorldId,
    sim: SimHandle,
    pause: Duration,
    patience: Duration,
    shutdown: &Shutdown,
) -> ReaderStream<wire::WatchStatsResponse> {
    let (mut reader, stream) = Reader::new(patience);
    let stopping = shutdown.wait();
    tokio::spawn(async move {
        tokio::pin!(stopping);
        loop {
            match sim.call(|state| (state.world.tick(), state.world.stats())).await {
                Ok((tick, stats)) => {
                    let message = wire::WatchStatsResponse {
                        tick: tick.0,
                        server_time: Some(SystemTime::now().into()),
                        stats: Some(stats_to_wire(&stats)),
                    };
                    match reader.send(message).await {
                        Some(still) => reader = still,
                        None => return,
                    }
                }
                Err(SimError::Busy) => {}
                Err(SimError::Stopped) => return reader.close(WorldsError::UnknownWorld(world).into()),
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                () = &mut stopping => return reader.close(shutting_down()),
                () = reader.closed() => return,
            }
        }
    });
    stream
}

/// Streams the tiles of a map. Each is built when its turn comes, which the semaphore `turns` limits for all readers.
pub fn send_mesh(
    map: Arc<Map>,
    tiles: impl FnOnce(&Map) -> Tiles + Send + 'static,
    turns: Arc<Semaphore>,
    patience: Duration,
    shutdown: &Shutdown,
) -> ReaderStream<wire::GetMeshResponse> {
    let (mut reader, stream) = Reader::new(patience);
    let shutdown = shutdown.clone();
    let lost = || status::failure(Reason::Internal, "the mesh cannot be made");
    tokio::spawn(async move {
        let of = map.clone();
        let Some(tiles) = in_turn(&turns, &reader, move || Arc::new(tiles(&of))).await else {
            return reader.close(lost());
        };
        for tile_idx in 0..tiles.count() {
            if shutdown.is_triggered() {
                return reader.close(shutting_down());
            }
            let (of, tiles) = (map.clone(), tiles.clone());
            let encode = move || tile_to_wire(&tiles.mesh(&of, tile_idx), tiles.count());
            let tile = in_turn(&turns, &reader, encode).await;
            let Some(tile) = tile else { return reader.close(lost()) };
            match reader.send(tile).await {
                Some(still) => reader = still,
                None => return,
            }
        }
    });
    stream
}

/// Runs `work` on a blocking thread when its turn comes; returns `None` if `work` panics or the reader leaves before.
async fn in_turn<T: Send + 'static, M>(
    turns: &Semaphore,
    reader: &Reader<M>,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let _turn = tokio::select! {
        biased;
        () = reader.closed() => return None,
        turn = turns.acquire() => turn.ok()?,
    };
    tokio::task::spawn_blocking(work).await.ok()
}

/// State of a followed NPC at one moment.
struct FollowState {
    tick: Tick,
    time: SystemTime,
    npc: NpcState,
    sight: Option<Sight>,
    plan: Option<Arc<NpcPlan>>,
    history: Vec<EndedAttempt>,
}

impl FollowState {
    fn at(world: &HostedWorld, npc: NpcId, rays: bool) -> Result<Self, NpcError> {
        Ok(Self {
            tick: world.tick(),
            time: SystemTime::now(),
            npc: world.npc(npc)?,
            sight: rays.then(|| world.sight(npc)).transpose()?,
            plan: world.plan(npc)?,
            history: world.history(npc)?,
        })
    }

    /// Converts the state; plan and history are included only if they differ from those in `shown`.
    fn to_wire(&self, shown: Option<&FollowState>) -> wire::FollowNpcResponse {
        let waypoints = self.plan.as_ref().map_or(&[][..], |plan| &plan.waypoints);
        let heading = waypoints.iter().position(|waypoint| Some(*waypoint) == self.npc.waypoint);
        let mut message = wire::FollowNpcResponse {
            tick: self.tick.0,
            server_time: Some(self.time.into()),
            waypoint_idx: heading.unwrap_or(waypoints.len().saturating_sub(1)) as u32,
            npc: Some(npc_to_wire(&self.npc)),
            ..Default::default()
        };
        if let Some(sight) = &self.sight {
            message.eyes = Some(convert::to_wire(sight.eye));
            message.rays = rays_to_wire(sight);
        }
        if !shown.is_some_and(|shown| is_same_plan(&shown.plan, &self.plan)) {
            message.plan = Some(self.plan.as_deref().map(npc_plan_to_wire).unwrap_or_default());
        }
        if shown.is_none_or(|shown| shown.history != self.history) {
            message.history = self.history.iter().map(ended_attempt_to_wire).collect();
        }
        message
    }
}

fn is_same_plan(a: &Option<Arc<NpcPlan>>, b: &Option<Arc<NpcPlan>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// Streams the state of one NPC, with its plan and history whenever they have changed, and with `rays` what it sees.
pub fn follow_npc(
    npc: NpcId,
    sim: SimHandle,
    rays: bool,
    pause: Duration,
    patience: Duration,
    shutdown: &Shutdown,
) -> ReaderStream<wire::FollowNpcResponse> {
    let (mut reader, stream) = Reader::new(patience);
    let stopping = shutdown.wait();
    tokio::spawn(async move {
        tokio::pin!(stopping);
        // The state that was sent last.
        let mut shown: Option<FollowState> = None;
        loop {
            let current = match sim.call(move |state| FollowState::at(&state.world, npc, rays)).await {
                Ok(Ok(current)) => current,
                Ok(Err(error)) => return reader.close(error.into()),
                Err(SimError::Busy) => {
                    tokio::time::sleep(BUSY_PAUSE).await;
                    continue;
                }
                Err(SimError::Stopped) => return reader.close(NpcError::Unknown(npc).into()),
            };
            let message = current.to_wire(shown.as_ref());
            shown = Some(current);
            match reader.send(message).await {
                Some(still) => reader = still,
                None => return,
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                () = &mut stopping => return reader.close(shutting_down()),
                () = reader.closed() => return,
            }
        }
    });
    stream
}
