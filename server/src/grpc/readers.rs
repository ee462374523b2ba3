//! Streams to readers: snapshots, segments, events, statistics and mesh of a world, and one NPC with its plan.
//!
//! A slow reader gets the latest snapshot, and at most one message waits for it; a reader that does not read at all is
//! cut off.

use super::npcs::{check_count, npc_on};
use super::{Call, Reply, WorldApi, frame_on};
use crate::geometry::Tiles;
use crate::hosted::{EndedAttempt, HostedWorld, NpcError, NpcEvent, NpcPlan, NpcState, Poses, Snapshot};
use crate::ids::{NpcId, WorldId};
use crate::segments::Fit;
use crate::sim::{EventBatch, SimError, SimHandle, SimState};
use crate::view::{Region, View};
use crate::wire::{
    ended_attempt_to_wire, events_to_wire, map::tile_to_wire, news_to_wire, npc_plan_to_wire, npc_to_wire,
    rays_to_wire, region as convert_region, shown_to_wire, stats_to_wire,
};
use crate::worlds::{NpcAccess, WorldsError};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use surefoot_net::reader::{ReaderStream, Source};
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::{CallFrame, Coordinates};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_world::sense::Sight;
use surefoot_world::{Map, Tick};
use tokio::sync::broadcast::{Receiver, error::RecvError};
use tokio::sync::{Semaphore, watch};
use tokio::time::{Interval, MissedTickBehavior, interval};
use tonic::Status;

/// Most events that are copied out of a world's log at a time.
const EVENTS_AT_A_TIME: usize = 4096;
/// Pause before a call to a busy world is repeated.
const BUSY_PAUSE: Duration = Duration::from_millis(50);
/// Snapshots per second if the reader does not set a rate.
const DEFAULT_RATE: f64 = 10.0;
/// Most ticks of a segment if the reader does not set them.
const DEFAULT_MAX_TICKS: u32 = 30;

/// The pause between two messages at a rate of 0.1 to 60 Hz; 0 means the default.
fn pause_of(rate_hz: f32) -> Result<Duration, FieldError> {
    let rate = if rate_hz == 0.0 { DEFAULT_RATE } else { convert::in_range(f64::from(rate_hz), 0.1, 60.0, "rate_hz")? };
    Ok(Duration::from_secs_f64(1.0 / rate))
}

/// The pause between two messages of statistics at a period of 0.1 to 60 s; 0 means one second.
fn period_of(period_s: f32) -> Result<Duration, FieldError> {
    let seconds = if period_s == 0.0 { 1.0 } else { convert::in_range(f64::from(period_s), 0.1, 60.0, "period_s")? };
    Ok(Duration::from_secs_f64(seconds))
}

/// The most ticks of a segment, 6 to 60; 0 means 30.
fn max_ticks_of(max_ticks: u32) -> Result<usize, FieldError> {
    let ticks = if max_ticks == 0 { DEFAULT_MAX_TICKS } else { max_ticks };
    convert::in_range(f64::from(ticks), 6.0, 60.0, "max_ticks")?;
    Ok(ticks as usize)
}

/// Ticks now, and then after each `pause`. Missed ticks are not caught up.
fn every(pause: Duration) -> Interval {
    let mut due = interval(pause);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    due
}

/// Streams a reader's view of snapshots. Snapshots that come while it is not ready for the next one are skipped.
pub async fn watch_world(
    api: &WorldApi,
    call: Call<wire::WatchWorldRequest>,
) -> Reply<ReaderStream<wire::WatchWorldResponse>> {
    let (caller, wire::WatchWorldRequest { world_id, rate_hz, region, delta, coordinates, movement }) = call;
    let world = WorldId(world_id);
    let handle = api.worlds.handle_for(&caller, world)?;
    let (pause, frame) = (pause_of(rate_hz)?, frame_on(&handle, coordinates)?);
    let view = View::new(convert_region(frame.to_map(region).as_ref())?, delta).with_movement(movement);
    let subscribed = handle.sim.call(|state| {
        let receiver = state.snapshots.subscribe();
        state.show_snapshot();
        receiver
    });
    let mut snapshots = subscribed.await?;
    snapshots.mark_changed();
    Ok(api.stream_in(frame, Snapshots { world, snapshots, view, due: every(pause) }))
}

struct Snapshots {
    world: WorldId,
    snapshots: watch::Receiver<Arc<Snapshot>>,
    view: View,
    due: Interval,
}

impl Source for Snapshots {
    type Message = wire::WatchWorldResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        self.due.tick().await;
        if self.snapshots.changed().await.is_err() {
            return Some(Err(WorldsError::UnknownWorld(self.world).into()));
        }
        let snapshot = self.snapshots.borrow_and_update().clone();
        Some(Ok(vec![shown_to_wire(&self.view.show(&snapshot))]))
    }
}

/// Streams the segments of the bodies in a reader's view. A reader that misses ticks gets all bodies again.
pub async fn watch_segments(
    api: &WorldApi,
    call: Call<wire::WatchSegmentsRequest>,
) -> Reply<ReaderStream<wire::WatchSegmentsResponse>> {
    let (caller, wire::WatchSegmentsRequest { world_id, region, max_ticks, coordinates }) = call;
    let world = WorldId(world_id);
    let handle = api.worlds.handle_for(&caller, world)?;
    let (max_ticks, frame) = (max_ticks_of(max_ticks)?, frame_on(&handle, coordinates)?);
    let fit = Fit::new(convert_region(frame.to_map(region).as_ref())?, max_ticks);
    let subscribed = handle.sim.call(|state| (Arc::new(state.world.poses()), state.poses.subscribe()));
    let (first, poses) = subscribed.await?;
    Ok(api.stream_in(frame, Segments { world, first: Some(first), poses, fit }))
}

struct Segments {
    world: WorldId,
    /// The poses at the subscription.
    first: Option<Arc<Poses>>,
    /// Those of every tick since.
    poses: Receiver<Arc<Poses>>,
    fit: Fit,
}

impl Source for Segments {
    type Message = wire::WatchSegmentsResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        let poses = match self.first.take() {
            Some(first) => first,
            None => match self.poses.recv().await {
                Ok(poses) => poses,
                Err(RecvError::Lagged(_)) => {
                    self.fit.restart();
                    return Some(Ok(Vec::new()));
                }
                Err(RecvError::Closed) => return Some(Err(WorldsError::UnknownWorld(self.world).into())),
            },
        };
        Some(Ok(self.fit.follow(&poses).as_ref().map(news_to_wire).into_iter().collect()))
    }
}

/// Streams the wanted events of a world, past events first.
pub async fn watch_events(
    api: &WorldApi,
    call: Call<wire::WatchEventsRequest>,
) -> Reply<ReaderStream<wire::WatchEventsResponse>> {
    let (caller, wire::WatchEventsRequest { world_id, after, npc_ids, coordinates }) = call;
    check_count(npc_ids.len(), "npc_ids")?;
    let (world, epoch) = (WorldId(world_id), api.worlds.epoch_of(WorldId(world_id)));
    let handle = api.worlds.handle_for(&caller, world)?;
    let frame = frame_on(&handle, coordinates)?;
    if let Some(after) = after.filter(|after| after.epoch != epoch && after.sequence != 0) {
        let message = format!("after.epoch is {}, the epoch is {epoch}: the server has restarted since", after.epoch);
        return Err(status::failure(Reason::EventsLost, message));
    }
    let sequence = after.map(|after| after.sequence);
    let subscribed = handle.sim.call(move |state| {
        let log = state.world.events();
        let after = sequence.unwrap_or_else(|| log.latest());
        log.after(after, 0).map(|_| (after, state.world.tick(), state.events.subscribe()))
    });
    let (after, tick, batches) = subscribed.await?.map_err(Status::from)?;
    // The first message says where the stream begins, so that it can be resumed even if nothing happens.
    let begin = wire::WatchEventsResponse {
        tick: tick.0,
        server_time: Some(SystemTime::now().into()),
        cursor: Some(wire::EventCursor { epoch, sequence: after }),
        events: Vec::new(),
    };
    let npcs = npc_ids.into_iter().map(NpcId).collect();
    let (sim, begin) = (handle.sim, Some(begin));
    Ok(api.stream_in(frame, Events { begin, epoch, world, npcs, sim, batches, after, is_behind: true }))
}

/// Takes events from the batches that a world publishes each tick, and from the world's log while the reader is behind
/// them, as at its start. A slow reader falls behind when it misses batches. If the log has dropped events that the
/// reader needs next, the stream ends.
struct Events {
    begin: Option<wire::WatchEventsResponse>,
    /// Epoch of the world's cursors.
    epoch: u64,
    world: WorldId,
    /// Only events of these NPCs; if empty, of all.
    npcs: BTreeSet<NpcId>,
    sim: SimHandle,
    /// Batches since the subscription.
    batches: Receiver<Arc<EventBatch>>,
    /// Sequence number of the last event that the reader has; 0 means before the oldest event kept.
    after: u64,
    /// Whether the log is read.
    is_behind: bool,
}

impl Source for Events {
    type Message = wire::WatchEventsResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        Some(match self.begin.take() {
            Some(begin) => Ok(vec![begin]),
            None if self.is_behind => self.read_log().await,
            None => self.read_batch().await,
        })
    }
}

impl Events {
    async fn read_batch(&mut self) -> Result<Vec<wire::WatchEventsResponse>, Status> {
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
            // The log has dropped events since the stream began: the reader was too slow for the world.
            Ok(Err(error)) => Err(status::failure(Reason::ReaderTooSlow, error.to_string())),
            Err(SimError::Busy) => {
                // Without a pause this would be a busy loop, because there are unread events.
                tokio::time::sleep(BUSY_PAUSE).await;
                Ok(Vec::new())
            }
            Err(SimError::Stopped) => Err(WorldsError::UnknownWorld(self.world).into()),
        }
    }

    /// Converts events: a message for each tick that has wanted ones.
    fn take(&mut self, events: &[NpcEvent]) -> Vec<wire::WatchEventsResponse> {
        self.after = events.last().map_or(self.after, |event| event.sequence);
        let ticks = events.chunk_by(|a, b| a.tick == b.tick);
        let messages = ticks.filter_map(|tick| events_to_wire(self.epoch, tick, &self.npcs));
        messages.filter(|message| !message.events.is_empty()).collect()
    }
}

/// Streams the statistics of a world periodically.
pub async fn watch_stats(
    api: &WorldApi,
    call: Call<wire::WatchStatsRequest>,
) -> Reply<ReaderStream<wire::WatchStatsResponse>> {
    let (caller, wire::WatchStatsRequest { world_id, period_s }) = call;
    let world = WorldId(world_id);
    let sim = api.worlds.handle_for(&caller, world)?.sim;
    Ok(api.stream(Stats { world, sim, due: every(period_of(period_s)?) }))
}

struct Stats {
    world: WorldId,
    sim: SimHandle,
    due: Interval,
}

impl Source for Stats {
    type Message = wire::WatchStatsResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        self.due.tick().await;
        Some(match self.sim.call(|state| (state.world.tick(), state.world.stats())).await {
            Ok((tick, stats)) => Ok(vec![wire::WatchStatsResponse {
                tick: tick.0,
                server_time: Some(SystemTime::now().into()),
                stats: Some(stats_to_wire(&stats)),
            }]),
            Err(SimError::Busy) => Ok(Vec::new()),
            Err(SimError::Stopped) => Err(WorldsError::UnknownWorld(self.world).into()),
        })
    }
}

/// Streams the tiles of a map. Each is built when its turn comes, which a semaphore limits for all readers.
pub async fn get_mesh(api: &WorldApi, call: Call<wire::GetMeshRequest>) -> Reply<ReaderStream<wire::GetMeshResponse>> {
    let (_, wire::GetMeshRequest { world_id, region, cell_m, coordinates }) = call;
    let handle = api.worlds.handle(WorldId(world_id))?;
    let (map, frame) = (handle.shown.get(), frame_on(&handle, coordinates)?);
    let region = convert_region(frame.to_map(region).as_ref())?;
    if cell_m != 0.0 {
        convert::in_range(f64::from(cell_m), 0.5, 16.0, "cell_m")?;
    }
    Ok(api.stream(Mesh { map, frame, region, cell_m, tiles: None, tile_idx: 0, turns: api.meshing.clone() }))
}

struct Mesh {
    map: Arc<Map>,
    frame: CallFrame,
    region: Option<Region>,
    cell_m: f32,
    /// None until the first message.
    tiles: Option<Arc<Tiles>>,
    /// The next tile.
    tile_idx: usize,
    turns: Arc<Semaphore>,
}

impl Mesh {
    /// Runs `work` on a blocking thread when its turn comes.
    async fn in_turn<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Result<T, Status> {
        // Never closed.
        let turn = self.turns.clone().acquire_owned().await.ok();
        let work = move || {
            // Held until the work is done, even if the reader leaves.
            let _turn = turn;
            work()
        };
        let lost = |_| status::failure(Reason::Internal, "the mesh cannot be made");
        tokio::task::spawn_blocking(work).await.map_err(lost)
    }

    async fn tiles(&mut self) -> Result<Arc<Tiles>, Status> {
        if let Some(tiles) = &self.tiles {
            return Ok(tiles.clone());
        }
        let (map, region, cell_m) = (self.map.clone(), self.region, self.cell_m);
        let sort = move || Arc::new(Tiles::of(&map, region.map(|region| region.corners()), cell_m));
        Ok(self.tiles.insert(self.in_turn(sort).await?).clone())
    }

    async fn tile(&mut self) -> Result<Option<wire::GetMeshResponse>, Status> {
        let tiles = self.tiles().await?;
        if self.tile_idx == tiles.count() {
            return Ok(None);
        }
        let (map, frame, tile_idx) = (self.map.clone(), self.frame, self.tile_idx);
        self.tile_idx += 1;
        let tile = move || frame.to_level(tile_to_wire(&tiles.mesh(&map, tile_idx), tiles.count()));
        self.in_turn(tile).await.map(Some)
    }
}

impl Source for Mesh {
    type Message = wire::GetMeshResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        self.tile().await.map(|tile| tile.map(|tile| vec![tile])).transpose()
    }
}

/// Streams the state of one NPC, with its plan and history after each change, and its rays if requested.
pub async fn follow_npc(
    api: &WorldApi,
    call: Call<wire::FollowNpcRequest>,
) -> Reply<ReaderStream<wire::FollowNpcResponse>> {
    let (caller, wire::FollowNpcRequest { npc_id, rate_hz, rays, coordinates }) = call;
    let (npc, coordinates) = (NpcId(npc_id), Coordinates::read(coordinates)?);
    let wanted = pause_of(rate_hz)?;
    // Rays are cast on the world's own thread.
    let pause = if rays { wanted.max(pause_of(0.0)?) } else { wanted };
    let find = move |world: &mut HostedWorld| npc_on(world, npc, ());
    let (_, frame) = api.worlds.with_npc(&caller, NpcAccess::Read, npc, find).await?;
    let sim = api.worlds.handle_for(&caller, npc.world())?.sim;
    Ok(api.stream_in(coordinates.on(&frame), FollowedNpc { npc, sim, rays, due: every(pause), sent: None }))
}

struct FollowedNpc {
    npc: NpcId,
    sim: SimHandle,
    rays: bool,
    due: Interval,
    /// The state that was sent last.
    sent: Option<FollowState>,
}

impl Source for FollowedNpc {
    type Message = wire::FollowNpcResponse;

    async fn next(&mut self) -> Option<Result<Vec<Self::Message>, Status>> {
        self.due.tick().await;
        let (npc, rays) = (self.npc, self.rays);
        Some(match self.sim.call(move |state| FollowState::at(&state.world, npc, rays)).await {
            Ok(Ok(current)) => {
                let message = current.to_wire(self.sent.as_ref());
                self.sent = Some(current);
                Ok(vec![message])
            }
            Ok(Err(error)) => Err(error.into()),
            Err(SimError::Busy) => Ok(Vec::new()),
            Err(SimError::Stopped) => Err(NpcError::Unknown(npc).into()),
        })
    }
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

    /// Converts the state; plan and history are included only if they differ from those in `sent`.
    fn to_wire(&self, sent: Option<&FollowState>) -> wire::FollowNpcResponse {
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
        if !sent.is_some_and(|sent| is_same_plan(&sent.plan, &self.plan)) {
            message.plan = Some(self.plan.as_deref().map(npc_plan_to_wire).unwrap_or_default());
        }
        if sent.is_none_or(|sent| sent.history != self.history) {
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
