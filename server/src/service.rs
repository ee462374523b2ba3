//! The gRPC face of the world server: decode, call, encode.

use crate::geometry::{self, Tiles};
use crate::hosted::{HostedWorld, NpcError, SavedError, SavedMap, SavedWorld, TimeMode, world_of};
use crate::metrics::{self, WorldFigures};
use crate::quota::{Quota, QuotaError, Ticket};
use crate::registry::{Joined, Registry, ToWorker, WorkerId};
use crate::sim::SimHandle;
use crate::watch::{self, ReaderStream, Region, View};
use crate::{ServerConfig, checks};
use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, RwLock};
use std::time::Duration;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::maps::MapShelf;
use surefoot_proto::serving::{Caller, Shutdown, going_away};
use surefoot_proto::status;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_server::WorldService;
use surefoot_world::Map;
use tokio::sync::{Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};
use tracing::{info, warn};

/// Messages waiting for one worker; observations beyond are lost and their decisions count as missed.
const WORKER_QUEUE: usize = 256;
/// Threads that may make tiles of meshes at the same time.
const MESHES_AT_A_TIME: usize = 2;
/// How long a new worker may take to say hello.
const HELLO_LIMIT: Duration = Duration::from_secs(5);
/// Fractions of a period between worlds: consecutive multiples of the golden ratio spread evenly however many there are.
const GOLDEN: f64 = 0.618_033_988_749_895;

impl From<NpcError> for Status {
    fn from(error: NpcError) -> Self {
        let message = error.to_string();
        match error {
            NpcError::Unknown(npc_id) => status::not_found("npc", npc_id.to_string(), message),
            NpcError::Full { .. } => status::exhausted(message),
            NpcError::Outside { field, .. } => status::invalid(field, message),
            NpcError::Down(_) | NpcError::NoGround(_) => Status::failed_precondition(message),
        }
    }
}

impl From<QuotaError> for Status {
    fn from(error: QuotaError) -> Self {
        status::exhausted(error.to_string())
    }
}

/// Where a world runs and what never changes about it.
#[derive(Debug, Clone)]
struct Directory {
    sim: SimHandle,
    map: Arc<Map>,
    mode: TimeMode,
    /// Its place in its client's quota.
    ticket: Arc<Ticket>,
}

/// The service; clones share everything.
#[derive(Debug, Clone)]
pub struct WorldApi {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    config: ServerConfig,
    worlds: RwLock<BTreeMap<u64, Directory>>,
    last_world: AtomicU64,
    world_quota: Arc<Quota>,
    npc_quota: Arc<Quota>,
    registry: Arc<Registry>,
    maps: MapShelf,
    /// One at a time: two would write the same files.
    saving: tokio::sync::Mutex<()>,
    /// Tiles of meshes that are made at a time: worlds must go on meanwhile.
    meshing: Arc<Semaphore>,
    shutdown: Shutdown,
}

impl WorldApi {
    /// A server without worlds.
    pub fn new(config: ServerConfig, shutdown: Shutdown) -> Self {
        let shared = Shared {
            world_quota: Quota::new(
                config.max_worlds_per_client,
                "worlds, the most it may have (--max-worlds-per-client)",
            ),
            npc_quota: Quota::new(config.max_npcs_per_client, "NPCs, the most it may have (--max-npcs-per-client)"),
            maps: MapShelf::new(config.max_maps),
            config,
            worlds: RwLock::default(),
            last_world: AtomicU64::new(0),
            registry: Arc::default(),
            saving: tokio::sync::Mutex::default(),
            meshing: Arc::new(Semaphore::new(MESHES_AT_A_TIME)),
            shutdown,
        };
        Self { shared: Arc::new(shared) }
    }

    /// Maps that clients imported.
    pub fn maps(&self) -> MapShelf {
        self.shared.maps.clone()
    }

    /// Takes saved worlds up again. One that is damaged is told of and left where it is.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub async fn take_up_worlds(&self) -> Result<(), SavedError> {
        let Some(folder) = self.shared.config.state.clone() else { return Ok(()) };
        for saved in SavedWorld::read_all(&folder)? {
            let restored = saved.and_then(|saved| {
                // Also the id of one that cannot be taken up now is not given to another.
                self.shared.last_world.fetch_max(saved.id(), Ordering::Relaxed);
                let map = saved.map()?;
                Ok((saved, map))
            });
            let (saved, map) = match restored {
                Ok(restored) => restored,
                Err(error) => {
                    warn!(%error, "a saved world is not taken up");
                    continue;
                }
            };
            let world = HostedWorld::restore(&saved, map.clone(), self.shared.registry.clone(), &self.shared.npc_quota);
            info!(world_id = saved.id(), npcs = world.npc_count(), tick = world.tick(), "world taken up");
            let ticket = self.shared.world_quota.grant(saved.owner());
            if map.spec().is_none()
                && let Err(status) = self.shared.maps.put(saved.level().to_owned(), map.clone())
            {
                warn!(world_id = saved.id(), %status, "no planner will get its map");
            }
            if let Err(status) = self.start(saved.id(), world, map, ticket) {
                warn!(world_id = saved.id(), %status, "a saved world is not taken up");
            }
        }
        Ok(())
    }

    /// Saves all worlds, where the configuration says so; with `is_last` they end.
    ///
    /// # Errors
    /// If they cannot be saved.
    pub async fn save_worlds(&self, is_last: bool) -> Result<(), SavedError> {
        let Some(folder) = self.shared.config.state.clone() else { return Ok(()) };
        let _saving = self.shared.saving.lock().await;
        let worlds = self.shared.worlds.read().expect(POISON).clone();
        let mut all = Vec::new();
        for Directory { sim, ticket, map, .. } in worlds.into_values() {
            let level = self.shared.maps.name_of(&map).unwrap_or_default();
            let source = tokio::task::spawn_blocking(move || SavedMap::of(&map, level));
            let Ok(source) = source.await else { continue };
            let saved = sim.call(move |seat| {
                seat.is_over |= is_last;
                seat.world.save(ticket.client(), source)
            });
            // A world that does not answer was just dropped, or is too busy: then what was saved before stays.
            all.extend(saved.await.ok());
        }
        let api = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            std::fs::create_dir_all(&folder).map_err(|error| SavedError::Io(folder.clone(), error))?;
            for saved in &all {
                saved.write(&folder)?;
                // It may have been dropped meanwhile.
                if api.directory(saved.id()).is_err() {
                    SavedWorld::forget(&folder, saved.id())?;
                }
            }
            Ok(())
        });
        task.await.unwrap_or(Ok(()))
    }

    /// Ends all worlds.
    pub fn stop(&self) {
        let worlds = std::mem::take(&mut *self.shared.worlds.write().expect(POISON));
        for Directory { sim, .. } in worlds.into_values() {
            // One that is too busy ends with its last handle.
            let _ = sim.cast(|seat| seat.is_over = true);
        }
    }

    /// Saves all worlds again and again until the shutdown.
    pub async fn keep_saving(self) {
        let mut due = tokio::time::interval(self.shared.config.save_every);
        due.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = self.shared.shutdown.wait();
        tokio::pin!(stopping);
        // The first is due at once.
        due.tick().await;
        loop {
            tokio::select! {
                _ = due.tick() => {}
                () = &mut stopping => return,
            }
            if let Err(error) = self.save_worlds(false).await {
                warn!(%error, "worlds are not saved");
            }
        }
    }

    /// Starts a world's thread and lists it.
    fn start(&self, world_id: u64, world: HostedWorld, map: Arc<Map>, ticket: Ticket) -> Result<(), Status> {
        let limit = self.shared.config.max_worlds;
        let mode = world.mode();
        let mut worlds = self.shared.worlds.write().expect(POISON);
        if worlds.len() >= limit {
            return Err(too_many_worlds(limit));
        }
        let phase = (world_id as f64 * GOLDEN).fract();
        let sim = SimHandle::start(format!("world-{world_id}"), world, phase)
            .map_err(|error| status::exhausted(format!("no thread for another world: {error}")))?;
        worlds.insert(world_id, Directory { sim, map, mode, ticket: Arc::new(ticket) });
        Ok(())
    }

    fn sims(&self) -> Vec<SimHandle> {
        self.shared.worlds.read().expect(POISON).values().map(|directory| directory.sim.clone()).collect()
    }

    /// The Prometheus text.
    pub async fn metrics(&self) -> String {
        let mut worlds = Vec::new();
        for sim in self.sims() {
            // A world that cannot answer is absent.
            worlds.extend(sim.call(|seat| WorldFigures::of(seat)).await);
        }
        metrics::render(&worlds, &self.shared.registry.load())
    }

    fn directory(&self, world_id: u64) -> Result<Directory, Status> {
        let worlds = self.shared.worlds.read().expect(POISON);
        worlds.get(&world_id).cloned().ok_or_else(|| no_world(world_id))
    }

    /// Runs `call` on the world that `npc_id` belongs to.
    async fn with_npc<R: Send + 'static>(
        &self,
        npc_id: u64,
        call: impl FnOnce(&mut HostedWorld) -> Result<R, NpcError> + Send + 'static,
    ) -> Result<R, Status> {
        let world_id = world_of(npc_id);
        let directory = self.directory(world_id).map_err(|_| Status::from(NpcError::Unknown(npc_id)))?;
        Ok(directory.sim.call(move |seat| call(&mut seat.world)).await??)
    }

    async fn describe(&self, world_id: u64) -> Result<wire::World, Status> {
        let directory = self.directory(world_id)?;
        let counts = directory.sim.call(|seat| (seat.world.npc_count() as u32, seat.world.tick()));
        let (npc_count, tick) = counts.await?;
        Ok(wire::World {
            world_id,
            map: directory.map.spec().map(convert::map_spec_to_wire),
            map_hash: directory.map.hash().to_hex(),
            mode: directory.mode.to_wire().into(),
            npc_count,
            tick,
        })
    }

    /// Runs `call` on every world; one that is too busy is left out, and looks for workers by itself soon.
    fn cast_all(&self, call: impl Fn(&mut HostedWorld) + Clone + Send + 'static) {
        for sim in self.sims() {
            let call = call.clone();
            if let Err(status) = sim.cast(move |seat| call(&mut seat.world)) {
                warn!(%status, "a world did not take a call");
            }
        }
    }

    fn worker_left(&self, worker: WorkerId) {
        info!(worker = worker.0, "worker left");
        self.shared.registry.leave(worker);
        self.cast_all(move |world| world.lose_worker(worker));
    }

    /// Hands a worker's checked answer to its world.
    fn take_answer(&self, worker: WorkerId, batch: wire::ActionBatch) -> Result<(), Status> {
        let world_id = batch.world_id;
        let answer = checks::answer(batch)?;
        // A world that has just been dropped needs no answers any more.
        let Ok(directory) = self.directory(world_id) else { return Ok(()) };
        directory.sim.cast(move |seat| seat.world.answer(worker, answer))
    }
}

fn no_world(world_id: u64) -> Status {
    status::not_found("world", world_id.to_string(), format!("world {world_id} does not exist"))
}

fn too_many_worlds(limit: usize) -> Status {
    status::exhausted(format!("there are already {limit} worlds, the most allowed (--max-worlds)"))
}

/// Who calls, as far as quotas are concerned.
fn client_of<T>(request: &Request<T>) -> Arc<str> {
    request.extensions().get::<Caller>().map_or_else(|| "unknown".into(), |caller| caller.name.clone())
}

const POISON: &str = "no holder of this lock panics";

type BoxStream<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl WorldService for WorldApi {
    async fn create_world(
        &self,
        request: Request<wire::CreateWorldRequest>,
    ) -> Result<Response<wire::CreateWorldResponse>, Status> {
        let client = client_of(&request);
        let request = request.into_inner();
        let source = self.shared.maps.source(request.map.as_ref(), &request.map_hash)?;
        let mode = match wire::TimeMode::try_from(request.mode) {
            Ok(wire::TimeMode::Unspecified | wire::TimeMode::Realtime) => TimeMode::Realtime,
            Ok(wire::TimeMode::Lockstep) => TimeMode::Lockstep,
            Err(_) => return Err(Status::invalid_argument(format!("mode {} is unknown", request.mode))),
        };
        let limit = self.shared.config.max_worlds;
        if self.shared.worlds.read().expect(POISON).len() >= limit {
            return Err(too_many_worlds(limit));
        }
        let ticket = self.shared.world_quota.take(&client)?;
        let map = tokio::task::spawn_blocking(move || source.map())
            .await
            .map_err(|error| Status::internal(format!("map generation failed: {error}")))??;
        let world_id = self.shared.last_world.fetch_add(1, Ordering::Relaxed) + 1;
        let map_hash = map.hash();
        let world = HostedWorld::new(world_id, map.clone(), mode, self.shared.registry.clone());
        self.start(world_id, world, map, ticket)?;
        info!(world_id, map = %map_hash, ?mode, %client, "world created");
        Ok(Response::new(wire::CreateWorldResponse { world: Some(self.describe(world_id).await?) }))
    }

    async fn list_worlds(
        &self,
        _: Request<wire::ListWorldsRequest>,
    ) -> Result<Response<wire::ListWorldsResponse>, Status> {
        let ids: Vec<u64> = self.shared.worlds.read().expect(POISON).keys().copied().collect();
        let mut worlds = Vec::with_capacity(ids.len());
        for id in ids {
            // A world may have been dropped since the ids were read.
            worlds.extend(self.describe(id).await.ok());
        }
        Ok(Response::new(wire::ListWorldsResponse { worlds }))
    }

    async fn drop_world(
        &self,
        request: Request<wire::DropWorldRequest>,
    ) -> Result<Response<wire::DropWorldResponse>, Status> {
        let world_id = request.into_inner().world_id;
        let dropped = self.shared.worlds.write().expect(POISON).remove(&world_id);
        let directory = dropped.ok_or_else(|| no_world(world_id))?;
        directory.sim.call(|seat| seat.is_over = true).await?;
        if let Some(folder) = &self.shared.config.state
            && let Err(error) = SavedWorld::forget(folder, world_id)
        {
            warn!(world_id, %error, "a dropped world would come back");
        }
        info!(world_id, "world dropped");
        Ok(Response::new(wire::DropWorldResponse {}))
    }

    async fn sample_ground(
        &self,
        request: Request<wire::SampleGroundRequest>,
    ) -> Result<Response<wire::SampleGroundResponse>, Status> {
        let wire::SampleGroundRequest { world_id, count, seed } = request.into_inner();
        let map = self.directory(world_id)?.map;
        convert::in_range(f64::from(count), 1.0, 10_000.0, "count")?;
        let points = tokio::task::spawn_blocking(move || HostedWorld::sample_ground(&map, count as usize, seed))
            .await
            .map_err(|error| Status::internal(format!("sampling failed: {error}")))??;
        Ok(Response::new(wire::SampleGroundResponse { points: points.into_iter().map(convert::to_wire).collect() }))
    }

    async fn spawn_npc(
        &self,
        request: Request<wire::SpawnNpcRequest>,
    ) -> Result<Response<wire::SpawnNpcResponse>, Status> {
        let client = client_of(&request);
        let request = request.into_inner();
        let directory = self.directory(request.world_id)?;
        let position = convert::point(request.position.as_ref(), "position")?;
        let yaw = finite(request.yaw, "yaw")?;
        let limit = self.shared.config.max_npcs_per_world;
        let ticket = self.shared.npc_quota.take(&client)?;
        let npc_id = directory.sim.call(move |seat| seat.world.spawn(position, yaw, limit, ticket)).await??;
        Ok(Response::new(wire::SpawnNpcResponse { npc_id }))
    }

    async fn despawn_npc(
        &self,
        request: Request<wire::DespawnNpcRequest>,
    ) -> Result<Response<wire::DespawnNpcResponse>, Status> {
        let npc_id = request.into_inner().npc_id;
        self.with_npc(npc_id, move |world| world.despawn(npc_id)).await?;
        Ok(Response::new(wire::DespawnNpcResponse {}))
    }

    async fn set_goal(
        &self,
        request: Request<wire::SetGoalRequest>,
    ) -> Result<Response<wire::SetGoalResponse>, Status> {
        let request = request.into_inner();
        let goal = convert::point(request.goal.as_ref(), "goal")?;
        self.with_npc(request.npc_id, move |world| world.set_goal(request.npc_id, goal)).await?;
        Ok(Response::new(wire::SetGoalResponse {}))
    }

    async fn teleport_npc(
        &self,
        request: Request<wire::TeleportNpcRequest>,
    ) -> Result<Response<wire::TeleportNpcResponse>, Status> {
        let request = request.into_inner();
        let position = convert::point(request.position.as_ref(), "position")?;
        let yaw = finite(request.yaw, "yaw")?;
        self.with_npc(request.npc_id, move |world| world.teleport(request.npc_id, position, yaw)).await?;
        Ok(Response::new(wire::TeleportNpcResponse {}))
    }

    async fn get_npc(&self, request: Request<wire::GetNpcRequest>) -> Result<Response<wire::GetNpcResponse>, Status> {
        let npc_id = request.into_inner().npc_id;
        let npc = self.with_npc(npc_id, move |world| world.npc(npc_id)).await?;
        Ok(Response::new(wire::GetNpcResponse { npc: Some(npc) }))
    }

    type WatchWorldStream = ReaderStream<wire::WatchWorldResponse>;

    async fn watch_world(
        &self,
        request: Request<wire::WatchWorldRequest>,
    ) -> Result<Response<Self::WatchWorldStream>, Status> {
        let wire::WatchWorldRequest { world_id, rate_hz, region, delta } = request.into_inner();
        let directory = self.directory(world_id)?;
        let pause = watch::pause_of(rate_hz)?;
        let view = View::new(Region::read(region.as_ref())?, delta);
        let subscribed = directory.sim.call(|seat| {
            let receiver = seat.snapshots.subscribe();
            seat.publish();
            receiver
        });
        let (patience, shutdown) = (self.shared.config.reader_patience, &self.shared.shutdown);
        Ok(Response::new(watch::watch_world(world_id, subscribed.await?, view, pause, patience, shutdown)))
    }

    type FollowNpcStream = ReaderStream<wire::FollowNpcResponse>;

    async fn follow_npc(
        &self,
        request: Request<wire::FollowNpcRequest>,
    ) -> Result<Response<Self::FollowNpcStream>, Status> {
        let wire::FollowNpcRequest { npc_id, rate_hz, rays } = request.into_inner();
        let asked = watch::pause_of(rate_hz)?;
        // Rays are cast on the world's own thread.
        let pause = if rays { asked.max(watch::pause_of(0.0)?) } else { asked };
        self.with_npc(npc_id, move |world| world.npc(npc_id)).await?;
        let directory = self.directory(world_of(npc_id))?;
        let (patience, shutdown) = (self.shared.config.reader_patience, &self.shared.shutdown);
        Ok(Response::new(watch::follow_npc(npc_id, directory.sim, rays, pause, patience, shutdown)))
    }

    type GetMeshStream = ReaderStream<wire::GetMeshResponse>;

    async fn get_mesh(&self, request: Request<wire::GetMeshRequest>) -> Result<Response<Self::GetMeshStream>, Status> {
        let wire::GetMeshRequest { world_id, region, cell_m } = request.into_inner();
        let map = self.directory(world_id)?.map;
        let region = Region::read(region.as_ref())?;
        if cell_m != 0.0 {
            convert::in_range(f64::from(cell_m), 0.5, 16.0, "cell_m")?;
        }
        let tiles = move |map: &Map| Tiles::of(map, region.map(|region| region.corners()), cell_m);
        let (patience, shutdown) = (self.shared.config.reader_patience, &self.shared.shutdown);
        let turns = self.shared.meshing.clone();
        Ok(Response::new(watch::send_mesh(map, tiles, turns, patience, shutdown)))
    }

    async fn get_features(
        &self,
        request: Request<wire::GetFeaturesRequest>,
    ) -> Result<Response<wire::GetFeaturesResponse>, Status> {
        let directory = self.directory(request.into_inner().world_id)?;
        Ok(Response::new(geometry::features(&directory.map)))
    }

    async fn stall_world(
        &self,
        request: Request<wire::StallWorldRequest>,
    ) -> Result<Response<wire::StallWorldResponse>, Status> {
        let wire::StallWorldRequest { world_id, milliseconds } = request.into_inner();
        let directory = self.directory(world_id)?;
        let stall = convert::in_range(f64::from(milliseconds), 1.0, 1000.0, "milliseconds")?;
        directory.sim.call(move |_| std::thread::sleep(Duration::from_secs_f64(stall / 1000.0))).await?;
        Ok(Response::new(wire::StallWorldResponse {}))
    }

    type WorkStream = BoxStream<wire::WorkResponse>;

    async fn work(&self, request: Request<Streaming<wire::WorkRequest>>) -> Result<Response<Self::WorkStream>, Status> {
        let mut requests = request.into_inner();
        let first = tokio::time::timeout(HELLO_LIMIT, requests.next())
            .await
            .map_err(|_| Status::deadline_exceeded("no hello within five seconds"))?;
        let hello = checks::hello(first.transpose()?)?;
        let (queue, responses) = mpsc::channel::<ToWorker>(WORKER_QUEUE);
        info!(name = hello.name, policy = hello.policy, capacity = hello.capacity, "worker joins");
        let joined = self.shared.registry.join(hello.name, hello.policy, hello.capacity, queue.clone());
        let welcome = wire::WorkResponse {
            message: Some(wire::work_response::Message::Welcome(wire::Welcome { worker_id: joined.id.0 })),
        };
        // The queue is new and empty.
        let _ = queue.try_send(Ok(welcome));
        self.cast_all(HostedWorld::rebalance);
        tokio::spawn(self.clone().read_answers(joined, requests, queue));
        Ok(Response::new(Box::pin(ReceiverStream::new(responses))))
    }
}

impl WorldApi {
    /// Reads a worker's stream until it ends, fails, or the server shuts down.
    async fn read_answers(
        self,
        Joined { id: worker, cut }: Joined,
        mut requests: Streaming<wire::WorkRequest>,
        queue: mpsc::Sender<ToWorker>,
    ) {
        let shutdown = self.shared.shutdown.wait();
        tokio::pin!(shutdown);
        let end = loop {
            let request = tokio::select! {
                request = requests.next() => request,
                () = &mut shutdown => break Some(going_away()),
                () = queue.closed() => break None,
                () = cut.notified() => break Some(Status::aborted("messages were not read: connect again")),
            };
            let taken = match request {
                None | Some(Err(_)) => break None,
                Some(Ok(wire::WorkRequest { message: Some(wire::work_request::Message::Actions(batch)) })) => {
                    self.take_answer(worker, batch)
                }
                Some(Ok(_)) => Err(Status::invalid_argument("after hello only actions may be sent")),
            };
            if let Err(status) = taken {
                warn!(worker = worker.0, %status, "worker is cut off");
                break Some(status);
            }
        };
        if let Some(status) = end {
            // If the worker does not read, its stream ends without the reason.
            let _ = queue.try_send(Err(status));
        }
        self.worker_left(worker);
    }
}

fn finite(value: f32, field: &'static str) -> Result<f32, FieldError> {
    if value.is_finite() { Ok(value) } else { Err(FieldError::NotFinite(field)) }
}
