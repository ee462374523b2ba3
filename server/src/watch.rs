//! What game clients see of a world: snapshots of a region, whole or as changes, and one NPC with its plan.
//!
//! A slow reader gets the latest snapshot and costs one message; one that does not read at all is cut off.

use crate::geometry::{Tiles, surface_to_wire};
use crate::hosted::{HostedWorld, NpcError};
use crate::sim::SimHandle;
use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::serving::{Shutdown, going_away};
use surefoot_proto::status;
use surefoot_proto::world::v1 as wire;
use surefoot_world::{Map, Vec3};
use tokio::sync::{Semaphore, mpsc, watch};
use tokio_stream::Stream;
use tonic::Status;

/// Messages waiting for one reader; older snapshots are skipped.
const QUEUE: usize = 1;
/// Snapshots a second unless the reader says otherwise.
const DEFAULT_RATE: f64 = 10.0;

/// The pause between two messages at a wanted rate, 0 for the default.
///
/// # Errors
/// If the rate is out of range.
pub fn pause_of(rate_hz: f32) -> Result<Duration, FieldError> {
    let rate = if rate_hz == 0.0 { DEFAULT_RATE } else { convert::in_range(f64::from(rate_hz), 0.1, 60.0, "rate_hz")? };
    Ok(Duration::from_secs_f64(1.0 / rate))
}

/// A box with edges along the axes.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    low: Vec3,
    high: Vec3,
}

impl Region {
    /// Reads a region; absent means everywhere.
    ///
    /// # Errors
    /// If a corner is missing or not finite, or the low one is above the high one.
    pub fn read(region: Option<&wire::Region>) -> Result<Option<Self>, FieldError> {
        let Some(region) = region else { return Ok(None) };
        let low = convert::point(region.low.as_ref(), "region.low")?;
        let high = convert::point(region.high.as_ref(), "region.high")?;
        for (low, high, field) in
            [(low.x, high.x, "region.high.x"), (low.y, high.y, "region.high.y"), (low.z, high.z, "region.high.z")]
        {
            convert::in_range(f64::from(high), f64::from(low), f64::from(f32::MAX), field)?;
        }
        Ok(Some(Self { low, high }))
    }

    /// Its lowest and its highest corner, m.
    pub fn corners(&self) -> [Vec3; 2] {
        [self.low, self.high]
    }

    fn holds(&self, npc: &wire::Npc) -> bool {
        npc.position.is_some_and(|wire::Vec3 { x, y, z }| {
            let within = |value, low, high| (low..=high).contains(&value);
            within(x, self.low.x, self.high.x)
                && within(y, self.low.y, self.high.y)
                && within(z, self.low.z, self.high.z)
        })
    }
}

/// Turns snapshots into what one reader asked for.
#[derive(Debug)]
pub struct View {
    region: Option<Region>,
    delta: bool,
    /// With changes only: what the reader has.
    seen: Option<BTreeMap<u64, wire::Npc>>,
}

impl View {
    /// NPCs of `region`; with `delta` only what changed since the snapshot shown before.
    pub fn new(region: Option<Region>, delta: bool) -> Self {
        Self { region, delta, seen: None }
    }

    /// What the reader is to be sent of a snapshot.
    pub fn show(&mut self, snapshot: &wire::WatchWorldResponse) -> wire::WatchWorldResponse {
        let within = |npc: &&wire::Npc| self.region.is_none_or(|region| region.holds(npc));
        let npcs: Vec<wire::Npc> = snapshot.npcs.iter().filter(within).copied().collect();
        let full = wire::WatchWorldResponse {
            tick: snapshot.tick,
            npcs,
            stats: snapshot.stats.clone(),
            is_delta: false,
            gone_npc_ids: Vec::new(),
        };
        if !self.delta {
            return full;
        }
        let now: BTreeMap<u64, wire::Npc> = full.npcs.iter().map(|npc| (npc.npc_id, *npc)).collect();
        let Some(before) = self.seen.replace(now) else { return full };
        let now = self.seen.as_ref().expect("just put there");
        wire::WatchWorldResponse {
            gone_npc_ids: before.keys().filter(|id| !now.contains_key(id)).copied().collect(),
            npcs: full.npcs.into_iter().filter(|npc| before.get(&npc.npc_id) != Some(npc)).collect(),
            is_delta: true,
            ..full
        }
    }
}

/// A stream to one reader that ends with a status.
#[derive(Debug)]
pub struct ReaderStream<T> {
    messages: mpsc::Receiver<T>,
    end: Arc<OnceLock<Status>>,
    is_over: bool,
}

impl<T> Stream for ReaderStream<T> {
    type Item = Result<T, Status>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.is_over {
            return Poll::Ready(None);
        }
        if let Some(message) = ready!(self.messages.poll_recv(context)) {
            return Poll::Ready(Some(Ok(message)));
        }
        self.is_over = true;
        Poll::Ready(self.end.get().cloned().map(Err))
    }
}

/// Where messages for one reader go.
struct Reader<T> {
    queue: mpsc::Sender<T>,
    end: Arc<OnceLock<Status>>,
    patience: Duration,
}

impl<T> Reader<T> {
    fn new(patience: Duration) -> (Self, ReaderStream<T>) {
        let (queue, messages) = mpsc::channel(QUEUE);
        let end = Arc::new(OnceLock::new());
        (Self { queue, end: end.clone(), patience }, ReaderStream { messages, end, is_over: false })
    }

    /// Ends the stream with `status`.
    fn close(self, status: Status) {
        // Set once: this consumes the reader.
        let _ = self.end.set(status);
    }

    /// Hands a message over, waiting for a slow reader as long as its patience lasts; `None` if the stream is over.
    async fn send(self, message: T) -> Option<Self> {
        match tokio::time::timeout(self.patience, self.queue.send(message)).await {
            Ok(Ok(())) => Some(self),
            Ok(Err(_)) => None,
            Err(_) => {
                let seconds = self.patience.as_secs_f32();
                self.close(Status::aborted(format!("nothing was read for {seconds} s: watch again")));
                None
            }
        }
    }
}

/// Sends a reader its view of every snapshot that it has time for.
pub fn watch_world(
    world_id: u64,
    mut snapshots: watch::Receiver<Arc<wire::WatchWorldResponse>>,
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
                    Err(_) => {
                        let (id, message) = (world_id.to_string(), format!("world {world_id} was dropped"));
                        return reader.close(status::not_found("world", id, message));
                    }
                },
                () = &mut stopping => return reader.close(going_away()),
                () = reader.queue.closed() => return,
            };
            match reader.send(view.show(&snapshot)).await {
                Some(still) => reader = still,
                None => return,
            }
            tokio::time::sleep(pause).await;
        }
    });
    stream
}

/// Sends a reader the tiles of a map, which are made while they are sent, whenever `turns` has a turn left.
pub fn send_mesh(
    map: Arc<Map>,
    tiles: impl FnOnce(&Map) -> Tiles + Send + 'static,
    turns: Arc<Semaphore>,
    patience: Duration,
    shutdown: &Shutdown,
) -> ReaderStream<wire::GetMeshResponse> {
    let (mut reader, stream) = Reader::new(patience);
    let shutdown = shutdown.clone();
    let lost = || Status::internal("the mesh cannot be made");
    tokio::spawn(async move {
        let of = map.clone();
        let Some(tiles) = in_turn(&turns, &reader.queue, move || Arc::new(tiles(&of))).await else {
            return reader.close(lost());
        };
        for tile_idx in 0..tiles.count() {
            if shutdown.is_triggered() {
                return reader.close(going_away());
            }
            let (of, tiles) = (map.clone(), tiles.clone());
            let tile = in_turn(&turns, &reader.queue, move || tiles.encode(&of, tile_idx)).await;
            let Some(tile) = tile else { return reader.close(lost()) };
            match reader.send(tile).await {
                Some(still) => reader = still,
                None => return,
            }
        }
    });
    stream
}

/// Works on a thread of its own when it is its turn; `None` if it panics, or the reader has left before.
async fn in_turn<T: Send + 'static, M>(
    turns: &Semaphore,
    reader: &mpsc::Sender<M>,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let _turn = tokio::select! {
        biased;
        () = reader.closed() => return None,
        turn = turns.acquire() => turn.ok()?,
    };
    tokio::task::spawn_blocking(work).await.ok()
}

/// What a reader is told of an NPC at one moment.
struct Look {
    message: wire::FollowNpcResponse,
    plan: Option<Arc<wire::NpcPlan>>,
    history: Vec<wire::EndedAttempt>,
}

fn look(world: &HostedWorld, npc_id: u64, rays: bool) -> Result<Look, NpcError> {
    let (npc, plan, history) = (world.npc(npc_id)?, world.plan(npc_id)?, world.history(npc_id)?);
    let waypoints = plan.as_ref().map_or(&[][..], |plan| &plan.waypoints);
    let heading = waypoints.iter().position(|waypoint| Some(*waypoint) == npc.waypoint);
    let mut message = wire::FollowNpcResponse {
        tick: world.tick(),
        waypoint_idx: heading.unwrap_or(waypoints.len().saturating_sub(1)) as u32,
        npc: Some(npc),
        ..Default::default()
    };
    if rays {
        let sight = world.sight(npc_id)?;
        message.eyes = Some(convert::to_wire(sight.eye));
        let ray = |(end, surface): (Vec3, Option<_>)| wire::Ray {
            end: Some(convert::to_wire(end)),
            surface: surface.map_or(wire::Surface::Unspecified, surface_to_wire).into(),
        };
        message.rays = sight.ends.into_iter().map(ray).collect();
    }
    Ok(Look { message, plan, history })
}

/// Sends a reader one NPC's state, with `rays` what it sees, and its plan and history when they have changed.
pub fn follow_npc(
    npc_id: u64,
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
        // What the reader has; it knows of nothing before the first message.
        let mut shown: Option<(Option<Arc<wire::NpcPlan>>, Vec<wire::EndedAttempt>)> = None;
        loop {
            let Look { mut message, plan, history } = match sim.call(move |seat| look(&seat.world, npc_id, rays)).await
            {
                Ok(Ok(look)) => look,
                Ok(Err(error)) => return reader.close(error.into()),
                Err(_) => return reader.close(NpcError::Unknown(npc_id).into()),
            };
            let same = |a: &Option<Arc<wire::NpcPlan>>, b: &Option<Arc<wire::NpcPlan>>| match (a, b) {
                (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                (a, b) => a.is_none() && b.is_none(),
            };
            if !shown.as_ref().is_some_and(|(shown, _)| same(shown, &plan)) {
                message.plan = Some(plan.as_deref().cloned().unwrap_or_default());
            }
            if shown.as_ref().is_none_or(|(_, shown)| *shown != history) {
                message.history = history.clone();
            }
            shown = Some((plan, history));
            match reader.send(message).await {
                Some(still) => reader = still,
                None => return,
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                () = &mut stopping => return reader.close(going_away()),
                () = reader.queue.closed() => return,
            }
        }
    });
    stream
}
