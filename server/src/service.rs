//! The gRPC face of the world server: decode, call, encode.

use crate::ServerConfig;
use crate::checks::{check_answer, check_hello};
use crate::hosted::{HostedWorld, NpcError, TimeMode, world_of};
use crate::metrics::{self, WorldFigures};
use crate::registry::{Registry, ToWorker, WorkerId};
use crate::sim::{Seat, Sim, SimHandle};
use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, RwLock};
use std::time::Duration;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::serving::{Shutdown, going_away};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_server::WorldService;
use surefoot_world::Map;
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};
use tracing::{info, warn};

/// Messages waiting for one worker; a batch beyond is lost and its decisions count as missed.
const WORKER_QUEUE: usize = 256;
/// Snapshots waiting for one watcher; older ones are skipped.
const WATCH_QUEUE: usize = 1;
/// How long a new worker may take to say hello.
const HELLO_LIMIT: Duration = Duration::from_secs(5);

impl From<NpcError> for Status {
    fn from(error: NpcError) -> Self {
        let message = error.to_string();
        match error {
            NpcError::Unknown(_) => Status::not_found(message),
            NpcError::Full { .. } => Status::resource_exhausted(message),
            NpcError::Outside { .. } => Status::invalid_argument(message),
            NpcError::Down(_) | NpcError::NoGround(_) => Status::failed_precondition(message),
        }
    }
}

/// Where a world runs and what never changes about it.
#[derive(Debug, Clone)]
struct Directory {
    sim: SimHandle,
    map: Arc<Map>,
    mode: TimeMode,
}

/// The service; clones share everything.
#[derive(Debug, Clone)]
pub struct WorldApi {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    config: ServerConfig,
    /// Emptied at the end, which ends the simulation threads.
    sims: RwLock<Vec<SimHandle>>,
    worlds: RwLock<BTreeMap<u64, Directory>>,
    last_world: AtomicU64,
    registry: Arc<Registry>,
    shutdown: Shutdown,
}

impl WorldApi {
    /// Starts the simulation threads.
    ///
    /// # Panics
    /// If the system refuses a thread.
    pub fn new(config: ServerConfig, shutdown: Shutdown) -> Self {
        let sims = (0..config.sim_threads.max(1))
            .map(|idx| SimHandle::start(format!("sim-{idx}")).expect("the system grants a few threads"))
            .collect();
        let shared = Shared {
            config,
            sims: RwLock::new(sims),
            worlds: RwLock::default(),
            last_world: AtomicU64::new(0),
            registry: Arc::default(),
            shutdown,
        };
        Self { shared: Arc::new(shared) }
    }

    /// Lets the simulation threads end.
    pub fn stop(&self) {
        self.shared.worlds.write().expect(POISON).clear();
        self.shared.sims.write().expect(POISON).clear();
    }

    /// The Prometheus text.
    pub async fn metrics(&self) -> String {
        let sims = self.shared.sims.read().expect(POISON).clone();
        let mut worlds = Vec::new();
        for sim in sims {
            let figures = sim
                .call(|sim| sim.seats.iter().map(|(&id, seat)| WorldFigures::of(id, &seat.world)).collect::<Vec<_>>());
            // A thread that cannot answer is shown by its worlds being absent.
            worlds.extend(figures.await.unwrap_or_default());
        }
        let (workers, carried) = self.shared.registry.load();
        metrics::render(&worlds, workers, carried)
    }

    fn directory(&self, world_id: u64) -> Result<Directory, Status> {
        let worlds = self.shared.worlds.read().expect(POISON);
        worlds.get(&world_id).cloned().ok_or_else(|| Status::not_found(format!("world {world_id} does not exist")))
    }

    /// Runs `call` on the world that `npc_id` belongs to.
    async fn with_npc<R: Send + 'static>(
        &self,
        npc_id: u64,
        call: impl FnOnce(&mut HostedWorld) -> Result<R, NpcError> + Send + 'static,
    ) -> Result<R, Status> {
        let world_id = world_of(npc_id);
        let directory = self.directory(world_id).map_err(|_| Status::from(NpcError::Unknown(npc_id)))?;
        let result = directory.sim.call(move |sim| Some(call(&mut sim.seats.get_mut(&world_id)?.world))).await?;
        Ok(result.ok_or(NpcError::Unknown(npc_id))??)
    }

    async fn describe(&self, world_id: u64) -> Result<wire::World, Status> {
        let directory = self.directory(world_id)?;
        let counts = directory
            .sim
            .call(move |sim| sim.seats.get(&world_id).map(|seat| (seat.world.npc_count() as u32, seat.world.tick())));
        let (npc_count, tick) = counts.await?.unwrap_or_default();
        Ok(wire::World {
            world_id,
            map: directory.map.spec().map(convert::map_spec_to_wire),
            map_hash: directory.map.hash().to_hex(),
            mode: directory.mode.to_wire().into(),
            npc_count,
            tick,
        })
    }

    /// Runs `call` on every simulation thread; a thread that is too busy is left out.
    fn cast_all(&self, call: impl Fn(&mut Sim) + Clone + Send + 'static) {
        for sim in self.shared.sims.read().expect(POISON).iter() {
            let call = call.clone();
            if let Err(status) = sim.cast(move |sim| call(sim)) {
                warn!(%status, "a simulation thread did not take a call");
            }
        }
    }

    fn worker_left(&self, worker: WorkerId) {
        info!(worker = worker.0, "worker left");
        self.shared.registry.leave(worker);
        self.cast_all(move |sim| {
            for seat in sim.seats.values_mut() {
                seat.world.lose_worker(worker);
            }
        });
    }

    /// Hands a worker's checked answer to its world.
    fn take_answer(&self, worker: WorkerId, batch: &wire::ActionBatch) -> Result<(), Status> {
        let answer = check_answer(batch)?;
        let world_id = batch.world_id;
        // A world that has just been dropped needs no answers any more.
        let Ok(directory) = self.directory(world_id) else { return Ok(()) };
        directory.sim.cast(move |sim| {
            if let Some(seat) = sim.seats.get_mut(&world_id) {
                seat.world.answer(worker, &answer);
            }
        })
    }
}

const POISON: &str = "no holder of this lock panics";

type BoxStream<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl WorldService for WorldApi {
    async fn create_world(
        &self,
        request: Request<wire::CreateWorldRequest>,
    ) -> Result<Response<wire::CreateWorldResponse>, Status> {
        let request = request.into_inner();
        let spec = convert::map_spec(request.map.as_ref())?;
        let mode = match wire::TimeMode::try_from(request.mode) {
            Ok(wire::TimeMode::Unspecified | wire::TimeMode::Realtime) => TimeMode::Realtime,
            Ok(wire::TimeMode::Lockstep) => TimeMode::Lockstep,
            Err(_) => return Err(Status::invalid_argument(format!("mode {} is unknown", request.mode))),
        };
        let limit = self.shared.config.max_worlds;
        let full =
            || Status::resource_exhausted(format!("there are already {limit} worlds, the most allowed (--max-worlds)"));
        if self.shared.worlds.read().expect(POISON).len() >= limit {
            return Err(full());
        }
        let map = tokio::task::spawn_blocking(move || Map::generate(&spec))
            .await
            .map_err(|error| Status::internal(format!("map generation failed: {error}")))?
            .map_err(FieldError::from)?;
        let map = Arc::new(map);
        let world_id = self.shared.last_world.fetch_add(1, Ordering::Relaxed) + 1;
        let sim = {
            let sims = self.shared.sims.read().expect(POISON);
            let sim = sims.get(world_id as usize % sims.len().max(1)).ok_or_else(going_away)?;
            sim.clone()
        };
        {
            let mut worlds = self.shared.worlds.write().expect(POISON);
            if worlds.len() >= limit {
                return Err(full());
            }
            worlds.insert(world_id, Directory { sim: sim.clone(), map: map.clone(), mode });
        }
        info!(world_id, seed = spec.seed, ?mode, "world created");
        let world = HostedWorld::new(world_id, map, mode, self.shared.registry.clone());
        sim.call(move |sim| {
            let snapshots = watch::Sender::new(world.snapshot());
            sim.seats.insert(world_id, Seat { world, snapshots });
        })
        .await?;
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
        let directory = self.directory(world_id)?;
        directory
            .sim
            .call(move |sim| {
                if let Some(mut seat) = sim.seats.remove(&world_id) {
                    seat.world.release_all();
                }
            })
            .await?;
        self.shared.worlds.write().expect(POISON).remove(&world_id);
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
        let request = request.into_inner();
        let world_id = request.world_id;
        let directory = self.directory(world_id)?;
        let position = convert::point(request.position.as_ref(), "position")?;
        let yaw = finite(request.yaw, "yaw")?;
        let limit = self.shared.config.max_npcs_per_world;
        let spawned = directory.sim.call(move |sim| {
            let seat = sim.seats.get_mut(&world_id)?;
            Some(seat.world.spawn(position, yaw, limit))
        });
        let npc_id = spawned.await?.ok_or_else(|| Status::not_found(format!("world {world_id} does not exist")))??;
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

    type WatchWorldStream = BoxStream<wire::WatchWorldResponse>;

    async fn watch_world(
        &self,
        request: Request<wire::WatchWorldRequest>,
    ) -> Result<Response<Self::WatchWorldStream>, Status> {
        let wire::WatchWorldRequest { world_id, rate_hz } = request.into_inner();
        let directory = self.directory(world_id)?;
        let rate = if rate_hz == 0.0 { 10.0 } else { convert::in_range(f64::from(rate_hz), 0.1, 60.0, "rate_hz")? };
        let subscribed = directory.sim.call(move |sim| {
            let seat = sim.seats.get(&world_id)?;
            let receiver = seat.snapshots.subscribe();
            seat.publish();
            Some(receiver)
        });
        let snapshots =
            subscribed.await?.ok_or_else(|| Status::not_found(format!("world {world_id} does not exist")))?;
        let (queue, stream) = mpsc::channel(WATCH_QUEUE);
        let pause = Duration::from_secs_f64(1.0 / rate);
        tokio::spawn(forward_snapshots(world_id, snapshots, pause, queue, self.shared.shutdown.clone()));
        Ok(Response::new(Box::pin(ReceiverStream::new(stream))))
    }

    type WorkStream = BoxStream<wire::WorkResponse>;

    async fn work(&self, request: Request<Streaming<wire::WorkRequest>>) -> Result<Response<Self::WorkStream>, Status> {
        let mut requests = request.into_inner();
        let first = tokio::time::timeout(HELLO_LIMIT, requests.next())
            .await
            .map_err(|_| Status::deadline_exceeded("no hello within five seconds"))?;
        let hello = check_hello(first.transpose()?.as_ref())?;
        let (queue, responses) = mpsc::channel::<ToWorker>(WORKER_QUEUE);
        let worker = self.shared.registry.join(hello.capacity, queue.clone());
        info!(worker = worker.0, name = hello.name, capacity = hello.capacity, "worker joined");
        let welcome = wire::WorkResponse {
            message: Some(wire::work_response::Message::Welcome(wire::Welcome { worker_id: worker.0 })),
        };
        // The queue is new and empty.
        let _ = queue.try_send(Ok(welcome));
        self.cast_all(|sim| {
            for seat in sim.seats.values_mut() {
                seat.world.assign_workers();
            }
        });
        tokio::spawn(self.clone().read_answers(worker, requests, queue));
        Ok(Response::new(Box::pin(ReceiverStream::new(responses))))
    }
}

impl WorldApi {
    /// Reads a worker's stream until it ends, fails, or the server shuts down.
    async fn read_answers(
        self,
        worker: WorkerId,
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
            };
            let taken = match request {
                None | Some(Err(_)) => break None,
                Some(Ok(wire::WorkRequest { message: Some(wire::work_request::Message::Actions(batch)) })) => {
                    self.take_answer(worker, &batch)
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

async fn forward_snapshots(
    world_id: u64,
    mut snapshots: watch::Receiver<wire::WatchWorldResponse>,
    pause: Duration,
    queue: mpsc::Sender<Result<wire::WatchWorldResponse, Status>>,
    shutdown: Shutdown,
) {
    let stopping = shutdown.wait();
    tokio::pin!(stopping);
    snapshots.mark_changed();
    loop {
        let message = tokio::select! {
            changed = snapshots.changed() => match changed {
                Ok(()) => Ok(snapshots.borrow_and_update().clone()),
                Err(_) => Err(Status::not_found(format!("world {world_id} was dropped"))),
            },
            () = &mut stopping => Err(going_away()),
            () = queue.closed() => return,
        };
        let last = message.is_err();
        // Waiting here for a slow reader skips the snapshots in between.
        if queue.send(message).await.is_err() || last {
            return;
        }
        tokio::time::sleep(pause).await;
    }
}

fn finite(value: f32, field: &'static str) -> Result<f32, FieldError> {
    if value.is_finite() { Ok(value) } else { Err(FieldError::NotFinite(field)) }
}
