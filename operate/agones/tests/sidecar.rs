//! Tests of a server beside a fake sidecar: what the server reports, in which order, and what happens while the sidecar
//! is away.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use surefoot_agones::proto::beta::sdk_server::{Sdk as Counters, SdkServer as CountersServer};
use surefoot_agones::proto::beta::{Counter, GetCounterRequest, UpdateCounterRequest};
use surefoot_agones::proto::sdk::sdk_server::{Sdk, SdkServer};
use surefoot_agones::proto::sdk::{Empty, GameServer, KeyValue};
use surefoot_agones::{Pace, run_with_sidecar};
use surefoot_net::client::LinkError;
use surefoot_net::serving::{Endpoint, Shutdown};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::observer::Observer;
use surefoot_server::{ServerConfig, ServerError, WorldId};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_stream::StreamExt;
use tonic::transport::Channel;
use tonic::transport::server::TcpIncoming;
use tonic::{Request, Response, Status, Streaming};

const PACE: Pace = Pace { beat: Duration::from_millis(10), longest_retry: Duration::from_millis(40) };
/// How long a world's thread may be silent in these tests.
const PATIENCE: Duration = Duration::from_millis(100);

/// A report that the sidecar received.
#[derive(Debug, Clone, PartialEq, Eq)]
enum ReportedCounter {
    Ready,
    Allocate,
    Health,
    Count(String, i64),
    Shutdown,
}

fn count(name: &str, count: i64) -> ReportedCounter {
    ReportedCounter::Count(name.to_owned(), count)
}

/// A sidecar; clones share it. Refuses as that of Agones does: with UNKNOWN.
#[derive(Debug, Clone)]
struct Fake {
    told: watch::Sender<Vec<(ReportedCounter, Instant)>>,
    capacities: Arc<Mutex<BTreeMap<String, i64>>>,
}

impl Default for Fake {
    fn default() -> Self {
        let capacities = [("worlds".to_owned(), 64), ("npcs".to_owned(), 3)];
        Self { told: watch::Sender::default(), capacities: Arc::new(Mutex::new(capacities.into())) }
    }
}

impl Fake {
    fn note(&self, told: ReportedCounter) -> Result<Response<Empty>, Status> {
        self.told.send_modify(|all| all.push((told, Instant::now())));
        Ok(Response::new(Empty {}))
    }

    fn all(&self) -> Vec<ReportedCounter> {
        self.told.borrow().iter().map(|(told, _)| told.clone()).collect()
    }

    /// All reports except health.
    fn changes(&self) -> Vec<ReportedCounter> {
        self.all().into_iter().filter(|told| *told != ReportedCounter::Health).collect()
    }

    /// Waits until `enough` holds for the reports received so far.
    async fn until(&self, enough: impl Fn(&[ReportedCounter]) -> bool) {
        let mut told = self.told.subscribe();
        let enough = |all: &Vec<(ReportedCounter, Instant)>| {
            enough(&all.iter().map(|(told, _)| told.clone()).collect::<Vec<_>>())
        };
        let waiting = tokio::time::timeout(Duration::from_secs(60), told.wait_for(enough));
        assert!(waiting.await.is_ok(), "only {:?}", self.changes());
    }

    async fn until_told(&self, what: ReportedCounter) {
        self.until(|all| all.contains(&what)).await;
    }

    /// Serves on `address`; port 0 means any free port.
    fn serve(&self, address: SocketAddr) -> Serving {
        let incoming = TcpIncoming::bind(address).unwrap();
        let address = incoming.local_addr().unwrap();
        let server = tonic::transport::Server::builder()
            .add_service(SdkServer::new(self.clone()))
            .add_service(CountersServer::new(self.clone()));
        let stop = Shutdown::default();
        // A signal without a sender counts as given.
        let kept = stop.clone();
        let task = tokio::spawn(async move {
            server.serve_with_incoming_shutdown(incoming, kept.wait()).await.unwrap();
            drop(kept);
        });
        Serving { address, stop, task }
    }
}

/// A sidecar that is there.
struct Serving {
    address: SocketAddr,
    stop: Shutdown,
    task: JoinHandle<()>,
}

impl Serving {
    /// Ends it with its connections.
    async fn end(self) {
        self.stop.trigger();
        self.task.await.unwrap();
    }
}

#[tonic::async_trait]
impl Sdk for Fake {
    async fn ready(&self, _: Request<Empty>) -> Result<Response<Empty>, Status> {
        self.note(ReportedCounter::Ready)
    }

    async fn allocate(&self, _: Request<Empty>) -> Result<Response<Empty>, Status> {
        self.note(ReportedCounter::Allocate)
    }

    async fn shutdown(&self, _: Request<Empty>) -> Result<Response<Empty>, Status> {
        self.note(ReportedCounter::Shutdown)
    }

    async fn health(&self, request: Request<Streaming<Empty>>) -> Result<Response<Empty>, Status> {
        let mut pings = request.into_inner();
        while let Some(Ok(Empty {})) = pings.next().await {
            self.note(ReportedCounter::Health)?;
        }
        Ok(Response::new(Empty {}))
    }

    async fn get_game_server(&self, _: Request<Empty>) -> Result<Response<GameServer>, Status> {
        Err(Status::unimplemented("not used"))
    }

    type WatchGameServerStream = tokio_stream::Empty<Result<GameServer, Status>>;

    async fn watch_game_server(&self, _: Request<Empty>) -> Result<Response<Self::WatchGameServerStream>, Status> {
        Err(Status::unimplemented("not used"))
    }

    async fn set_label(&self, _: Request<KeyValue>) -> Result<Response<Empty>, Status> {
        Err(Status::unimplemented("not used"))
    }

    async fn set_annotation(&self, _: Request<KeyValue>) -> Result<Response<Empty>, Status> {
        Err(Status::unimplemented("not used"))
    }

    async fn reserve(&self, _: Request<surefoot_agones::proto::sdk::Duration>) -> Result<Response<Empty>, Status> {
        Err(Status::unimplemented("not used"))
    }
}

#[tonic::async_trait]
impl Counters for Fake {
    async fn get_counter(&self, request: Request<GetCounterRequest>) -> Result<Response<Counter>, Status> {
        let name = request.into_inner().name;
        let capacity = self.capacities.lock().unwrap().get(&name).copied();
        let capacity = capacity.ok_or_else(|| Status::unknown(format!("counter not found: {name}")))?;
        Ok(Response::new(Counter { name, count: 0, capacity }))
    }

    async fn update_counter(&self, request: Request<UpdateCounterRequest>) -> Result<Response<Counter>, Status> {
        let wanted = request.into_inner().counter_update_request.unwrap();
        let capacity = self.get_counter(Request::new(GetCounterRequest { name: wanted.name.clone() })).await?;
        let (capacity, count) = (capacity.into_inner().capacity, wanted.count.unwrap());
        if count > capacity {
            return Err(Status::unknown("out of range. Count must be within range [0,Capacity]"));
        }
        self.note(ReportedCounter::Count(wanted.name.clone(), count))?;
        Ok(Response::new(Counter { name: wanted.name, count, capacity }))
    }
}

/// A server beside a sidecar.
struct Running {
    client: WorldServiceClient<Channel>,
    observer: Observer,
    shutdown: Shutdown,
    task: JoinHandle<Result<(), Failure>>,
}

#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Server(#[from] ServerError),
    #[error(transparent)]
    Link(#[from] LinkError),
}

async fn start(sidecar: SocketAddr, config: ServerConfig) -> Running {
    let endpoint = Endpoint::bind(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
    let (uri, shutdown) = (endpoint.uri(), Shutdown::default());
    let (observer, serving) = surefoot_server::serve_observed(endpoint, config, shutdown.clone());
    let observer = observer.with_patience(PATIENCE);
    let (seen, serving) = (observer.clone(), async move { Ok(serving.await?) });
    let task =
        tokio::spawn(async move { run_with_sidecar(&format!("http://{sidecar}"), PACE, observer, serving).await });
    Running { client: WorldServiceClient::connect(uri).await.unwrap(), observer: seen, shutdown, task }
}

impl Running {
    async fn create_world(&mut self) -> u64 {
        let size = wire::MapSize { width: 50, height: 40, depth: 50 };
        let map = Some(wire::MapSpec { seed: 3, size: Some(size), ..Default::default() });
        let request = wire::CreateWorldRequest { map, mode: wire::TimeMode::Realtime.into(), ..Default::default() };
        self.client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id
    }

    async fn spawn(&mut self, world_id: u64) {
        let sample = wire::SampleGroundRequest { world_id, count: 1, ..Default::default() };
        let position = self.client.sample_ground(sample).await.unwrap().into_inner().points.pop();
        let request = wire::SpawnNpcRequest { world_id, position, ..Default::default() };
        self.client.spawn_npc(request).await.unwrap();
    }

    async fn stop(self) {
        self.shutdown.trigger();
        self.task.await.unwrap().unwrap();
    }
}

fn anywhere() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 0))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_is_ready_then_allocated_while_it_has_worlds_and_shut_down_at_the_end() {
    let fake = Fake::default();
    let mut server = start(fake.serve(anywhere()).address, ServerConfig::default()).await;
    fake.until_told(count("npcs", 0)).await;
    let world_id = server.create_world().await;
    fake.until_told(count("worlds", 1)).await;
    server.spawn(world_id).await;
    fake.until_told(count("npcs", 1)).await;
    server.client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    fake.until(|all| all.iter().filter(|told| **told == count("npcs", 0)).count() == 2).await;
    server.stop().await;
    let begin = [ReportedCounter::Ready, count("worlds", 0), count("npcs", 0)];
    let used = [ReportedCounter::Allocate, count("worlds", 1), count("npcs", 1)];
    let end = [ReportedCounter::Ready, count("worlds", 0), count("npcs", 0), ReportedCounter::Shutdown];
    assert_eq!(fake.changes(), [&begin[..], &used, &end].concat());
    assert!(fake.all().contains(&ReportedCounter::Health));
}

#[tokio::test(flavor = "multi_thread")]
async fn health_stops_while_most_worlds_stand_still_and_not_for_one_of_them() {
    let fake = Fake::default();
    let mut server = start(fake.serve(anywhere()).address, ServerConfig::default()).await;
    let worlds = [server.create_world().await, server.create_world().await, server.create_world().await];
    fake.until_told(count("worlds", 3)).await;
    let stall = |world_id| {
        let observer = server.observer.clone();
        async move { observer.stall(WorldId(world_id), Duration::from_secs(1)).await.unwrap() }
    };
    // One of three: health is reported all the time, and so more often than before and after the stall.
    let beats_now = || fake.all().iter().filter(|told| **told == ReportedCounter::Health).count();
    let calm = beats_now();
    stall(worlds[0]).await;
    assert!(beats_now() > calm + 10, "{} beats in a second", beats_now() - calm);
    let before = Instant::now();
    tokio::join!(stall(worlds[0]), stall(worlds[1]));
    let after = Instant::now();
    fake.until(|all| all.last() == Some(&ReportedCounter::Health)).await;
    let beats = |told: &(ReportedCounter, Instant)| (told.0 == ReportedCounter::Health).then_some(told.1);
    let mut told = fake.told.subscribe();
    let is_later = |all: &Vec<(ReportedCounter, Instant)>| all.iter().filter_map(beats).any(|at| at > after);
    tokio::time::timeout(Duration::from_secs(60), told.wait_for(is_later)).await.unwrap().unwrap();
    let at: Vec<Instant> = fake.told.borrow().iter().filter_map(beats).filter(|at| *at >= before).collect();
    let longest = at.windows(2).map(|pair| pair[1] - pair[0]).chain([at[0] - before]).max().unwrap();
    assert!(longest > Duration::from_millis(500), "health was reported again after {longest:?}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn restored_worlds_are_reported_once_they_stand() {
    let folder = tempfile::tempdir().unwrap();
    let config = ServerConfig { state: Some(folder.path().to_owned()), ..Default::default() };
    let mut server = start(Fake::default().serve(anywhere()).address, config.clone()).await;
    // Refused until the server is ready.
    while server.client.list_worlds(wire::ListWorldsRequest::default()).await.is_err() {
        tokio::task::yield_now().await;
    }
    let world_id = server.create_world().await;
    server.spawn(world_id).await;
    server.stop().await;
    let fake = Fake::default();
    let server = start(fake.serve(anywhere()).address, config).await;
    fake.until_told(count("npcs", 1)).await;
    server.stop().await;
    let changes = fake.changes();
    assert_eq!(changes[..3], [ReportedCounter::Ready, ReportedCounter::Allocate, count("worlds", 1)], "{changes:?}");
    assert_eq!(changes.last(), Some(&ReportedCounter::Shutdown));
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_are_served_while_the_sidecar_is_away() {
    // An address that is free.
    let gone = Fake::default().serve(anywhere());
    let address = gone.address;
    gone.end().await;
    let mut server = start(address, ServerConfig::default()).await;
    let world_id = server.create_world().await;
    // It comes, and learns what it has missed.
    let fake = Fake::default();
    let serving = fake.serve(address);
    fake.until_told(count("worlds", 1)).await;
    assert_eq!(fake.changes()[..2], [ReportedCounter::Ready, ReportedCounter::Allocate]);
    // It goes and comes again: its game server was allocated, and stays so.
    serving.end().await;
    server.spawn(world_id).await;
    let again = Fake::default();
    let _serving = again.serve(address);
    again.until_told(count("npcs", 1)).await;
    assert!(!again.changes().contains(&ReportedCounter::Ready), "{:?}", again.changes());
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_ends_in_time_although_the_sidecar_is_away() {
    let gone = Fake::default().serve(anywhere());
    let address = gone.address;
    gone.end().await;
    let server = start(address, ServerConfig::default()).await;
    tokio::time::timeout(Duration::from_secs(20), server.stop()).await.expect("the end has a deadline");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_counter_is_filled_or_left_out_as_the_sidecar_has_it() {
    let fake = Fake::default();
    fake.capacities.lock().unwrap().remove("worlds");
    let mut server = start(fake.serve(anywhere()).address, ServerConfig::default()).await;
    let world_id = server.create_world().await;
    for _ in 0..4 {
        server.spawn(world_id).await;
    }
    // Of four, the capacity of three.
    fake.until_told(count("npcs", 3)).await;
    fake.capacities.lock().unwrap().insert("worlds".to_owned(), 8);
    fake.until_told(count("worlds", 1)).await;
    server.stop().await;
}
