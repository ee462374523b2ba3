//! Shared scaffolding of the whole-system tests: real services on real sockets with free ports.

pub mod packages;
pub mod source;
pub mod stage;

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;
use surefoot_agent::{WorkConfig, WorkError, work};
use surefoot_net::client::Credentials;
use surefoot_net::levels::MapPool;
use surefoot_net::serving::{Endpoint, EndpointConfig, Shutdown};
use surefoot_planner::BuildSettings;
use surefoot_planner_service::store::{DEFAULT_LIMIT_BYTES, DiskStore};
use surefoot_planner_service::{self as planner_service, PlannerConfig};
use surefoot_policy::Policy;
use surefoot_proto::planner::v1 as planner;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as world;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::observer::Observer;
use surefoot_server::{ServerConfig, WorldId};
use surefoot_studio::{PlannerAddress, Settings};
use tokio::task::JoinHandle;
use tokio_stream::StreamExt;
use tonic::transport::Channel;

/// A running service that stops on drop or on [`stop`](Self::stop).
#[derive(Debug)]
pub struct Running {
    /// URI that clients connect to.
    pub uri: String,
    shutdown: Shutdown,
    task: JoinHandle<()>,
    /// What others in the process see of a world server.
    observer: Option<Observer>,
}

impl Running {
    /// Begins the shutdown without waiting for its end, unlike [`Running::stop`].
    pub fn begin_stop(&self) {
        self.shutdown.trigger();
    }

    /// Host and port, for plain sockets.
    pub fn address(&self) -> &str {
        self.uri.rsplit('/').next().expect("a URI")
    }

    /// Keeps the thread of a world busy for so long, from when the result is polled.
    pub fn stall(&self, world_id: u64, time: Duration) -> impl Future<Output = ()> + Send + 'static {
        let observer = self.observer.clone().expect("a world server");
        // A stall that waits while the server ends is not run.
        async move { _ = observer.stall(WorldId(world_id), time).await }
    }

    /// Stops gracefully and waits for the end.
    pub async fn stop(self) {
        self.shutdown.trigger();
        let end = tokio::time::timeout(LIMIT, self.task).await.expect("a service ends in time");
        end.expect("a service ends without a panic");
    }
}

fn free_port() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 0))
}

/// Starts a world server.
pub fn start_server(config: ServerConfig) -> Running {
    start_server_at(EndpointConfig::default(), config)
}

/// Starts a world server with an endpoint configuration.
pub fn start_server_at(endpoint: EndpointConfig, config: ServerConfig) -> Running {
    let (endpoint, shutdown) = (Endpoint::open(free_port(), endpoint).expect("a free port"), Shutdown::default());
    let studio = Settings { planner: PlannerAddress::Port(7601), connect: Vec::new(), is_local: true };
    let endpoint = endpoint.with_pages(surefoot_studio::pages(studio));
    let uri = endpoint.uri();
    let (observer, serving) = surefoot_server::serve_observed(endpoint, config, shutdown.clone());
    let task = tokio::spawn(async move { serving.await.expect("the server serves") });
    Running { uri, shutdown, task, observer: Some(observer) }
}

/// Starts a planner with its cache in `folder`.
pub fn start_planner(folder: &Path, config: PlannerConfig) -> Running {
    start_planner_at(EndpointConfig::default(), folder, config)
}

/// Starts a planner with an endpoint configuration.
pub fn start_planner_at(endpoint: EndpointConfig, folder: &Path, config: PlannerConfig) -> Running {
    let (endpoint, shutdown) = (Endpoint::open(free_port(), endpoint).expect("a free port"), Shutdown::default());
    let store = DiskStore::open(folder, DEFAULT_LIMIT_BYTES).expect("a cache folder");
    let (policy, stop) = (Policy::shipped().expect("shipped weights"), shutdown.clone());
    let uri = endpoint.uri();
    let task = tokio::spawn(async move {
        planner_service::serve(endpoint, config, policy, Box::new(store), stop).await.expect("the planner serves");
    });
    Running { uri, shutdown, task, observer: None }
}

/// Response of `GET /metrics`, including headers; `headers` are request headers, each with its line end.
pub async fn metrics(server: &Running, headers: &str) -> String {
    get(server, "/metrics", headers).await
}

/// Response of a `GET` request, including headers; `headers` are request headers, each with its line end.
pub async fn get(server: &Running, path: &str, headers: &str) -> String {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let mut socket = tokio::net::TcpStream::connect(server.address()).await.expect("the server accepts");
    let request = format!("GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n{headers}\r\n", server.address());
    socket.write_all(request.as_bytes()).await.expect("a request");
    let mut text = String::new();
    socket.read_to_string(&mut text).await.expect("an answer");
    text
}

/// A running worker.
#[derive(Debug)]
pub struct Worker {
    shutdown: Shutdown,
    /// Resolves with the worker's result.
    pub task: JoinHandle<Result<(), WorkError>>,
}

impl Worker {
    /// Breaks the worker's connections at once, as a killed process would.
    pub fn kill(&self) {
        self.task.abort();
    }

    /// Stops the worker and waits for its end.
    pub async fn stop(self) {
        self.shutdown.trigger();
        // A worker that was killed has no result.
        let _ = tokio::time::timeout(LIMIT, self.task).await.expect("a worker ends in time");
    }
}

/// Starts a worker with the shipped reactive policy; without a planner its NPCs head straight for their goals.
pub fn start_worker(server: &Running, planner: Option<&Running>, capacity: u32) -> Worker {
    start_worker_with(Policy::shipped().expect("shipped weights"), server, planner, capacity)
}

/// Starts a worker with a given policy.
pub fn start_worker_with(policy: Policy, server: &Running, planner: Option<&Running>, capacity: u32) -> Worker {
    start_worker_as(Credentials::default(), policy, server, planner, capacity)
}

/// Starts a worker with credentials.
pub fn start_worker_as(
    credentials: Credentials,
    policy: Policy,
    server: &Running,
    planner: Option<&Running>,
    capacity: u32,
) -> Worker {
    let config = WorkConfig { credentials, ..worker_config(server, planner, capacity) };
    start_worker_of(config, policy)
}

/// Starts a worker of any configuration.
pub fn start_worker_of(config: WorkConfig, policy: Policy) -> Worker {
    let shutdown = Shutdown::default();
    let stop = shutdown.clone();
    Worker { shutdown, task: tokio::spawn(work(config, policy, stop)) }
}

/// What workers run with unless a test wants it otherwise.
pub fn worker_config(server: &Running, planner: Option<&Running>, capacity: u32) -> WorkConfig {
    WorkConfig {
        servers: vec![server.uri.clone()],
        is_of_fleet: false,
        planners: planner.map(|planner| planner.uri.clone()).into_iter().collect(),
        credentials: Credentials::default(),
        capacity,
        name: "e2e".to_owned(),
        graph: BuildSettings::default()
            .with(|it| {
                it.vertices = 50;
                it.neighbours = 8;
                it.repeats = 1;
                it.threshold = 0.5;
            })
            .unwrap(),
        noise_share: surefoot_rollout::DEFAULT_NOISE_SHARE,
        rehearses: true,
        composes: true,
        maps: MapPool::default(),
    }
}

/// Settings of a graph that is quick to build.
pub fn small_graph() -> planner::BuildSettings {
    planner::BuildSettings { vertices: 50, neighbours: 8, repeats: 1, threshold: 0.5, ..Default::default() }
}

/// A small map with all features.
pub fn small_map(seed: u64) -> world::MapSpec {
    world::MapSpec { seed, size: Some(world::MapSize { width: 100, height: 80, depth: 100 }), ..Default::default() }
}

/// A client of a world server that has restored its worlds.
pub async fn world_client(server: &Running) -> WorldServiceClient<Channel> {
    let mut client = WorldServiceClient::connect(server.uri.clone()).await.expect("the server accepts");
    let starting = async {
        while let Err(status) = client.get_server(world::GetServerRequest {}).await {
            if Reason::of(&status) != Some(Reason::Starting) {
                break;
            }
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, starting).await.expect("the server starts");
    client
}

/// A client of a planner.
pub async fn planner_client(planner: &Running) -> PlannerServiceClient<Channel> {
    PlannerServiceClient::connect(planner.uri.clone()).await.expect("the planner accepts")
}

/// Creates a world and returns it.
pub async fn create_world(client: &mut WorldServiceClient<Channel>, seed: u64, mode: world::TimeMode) -> world::World {
    let request = world::CreateWorldRequest { map: Some(small_map(seed)), mode: mode.into(), ..Default::default() };
    client.create_world(request).await.expect("a valid spec").into_inner().world.expect("a description")
}

/// Random points on the ground of a world.
pub async fn ground(client: &mut WorldServiceClient<Channel>, world_id: u64, count: u32) -> Vec<world::Vec3> {
    let request = world::SampleGroundRequest { world_id, count, seed: 1, body: None, ..Default::default() };
    client.sample_ground(request).await.expect("ground").into_inner().points
}

/// Builds a graph to its end and returns its id and summary.
pub async fn build_graph(client: &mut PlannerServiceClient<Channel>, seed: u64) -> (String, planner::GraphSummary) {
    let build = build_to_end(client, start_of(seed)).await;
    (build.graph_id, build.summary.expect("a finished build has a summary"))
}

/// Request for the build of a small graph.
pub fn start_of(seed: u64) -> planner::StartBuildRequest {
    planner::StartBuildRequest { map: Some(small_map(seed)), settings: Some(small_graph()), ..Default::default() }
}

/// Starts a build and watches it to its end.
pub async fn build_to_end(
    client: &mut PlannerServiceClient<Channel>,
    request: planner::StartBuildRequest,
) -> planner::Build {
    let started = client.start_build(request).await.expect("valid settings").into_inner().build.expect("a build");
    watch_build(client, &started.build_id).await.pop().expect("a build says how it ended")
}

/// All states that a build reports until its end.
pub async fn watch_build(client: &mut PlannerServiceClient<Channel>, build_id: &str) -> Vec<planner::Build> {
    let request = planner::WatchBuildRequest { build_id: build_id.to_owned() };
    let progress = client.watch_build(request).await.expect("a build").into_inner();
    progress.map(|message| message.expect("the build goes on").build.expect("a build")).collect().await
}

/// The latest figures of a world.
pub async fn stats(client: &mut WorldServiceClient<Channel>, world_id: u64) -> world::WorldStats {
    let request = world::WatchStatsRequest { world_id, period_s: 0.1 };
    let mut figures = client.watch_stats(request).await.expect("the world exists").into_inner();
    figures.next().await.expect("a first message").expect("figures").stats.expect("figures")
}

/// Watches a world's figures until `done` accepts them, and returns them.
pub async fn stats_until(
    client: &mut WorldServiceClient<Channel>,
    world_id: u64,
    done: impl Fn(&world::WorldStats) -> bool,
) -> world::WorldStats {
    let watching = async {
        let request = world::WatchStatsRequest { world_id, period_s: 0.1 };
        let mut figures = client.watch_stats(request).await.expect("the world exists").into_inner();
        while let Some(message) = figures.next().await {
            let stats = message.expect("the stream goes on").stats.expect("figures");
            if done(&stats) {
                return stats;
            }
        }
        panic!("the stream ended");
    };
    tokio::time::timeout(LIMIT, watching).await.expect("in time")
}

/// Far longer than any step takes, so that a hang fails the test instead of blocking it.
pub const LIMIT: Duration = Duration::from_secs(120);

/// Spawns an NPC and returns its id.
pub async fn spawn(client: &mut WorldServiceClient<Channel>, world_id: u64, at: world::Vec3) -> u64 {
    let request = world::SpawnNpcRequest { world_id, position: Some(at), ..Default::default() };
    client.spawn_npc(request).await.unwrap().into_inner().npc_id
}

/// Sends an NPC to a goal.
pub async fn set_goal(client: &mut WorldServiceClient<Channel>, npc_id: u64, goal: world::Vec3) {
    client.set_goal(world::SetGoalRequest { npc_id, goal: Some(goal), ..Default::default() }).await.unwrap();
}

/// Watches a world until `done` accepts a snapshot, and returns it.
pub async fn watch_until(
    client: &mut WorldServiceClient<Channel>,
    world_id: u64,
    done: impl Fn(&world::WatchWorldResponse) -> bool,
) -> world::WatchWorldResponse {
    let watching = async {
        let mut snapshots = watch(client, world_id, 60.0).await;
        while let Some(snapshot) = snapshots.next().await {
            let snapshot = snapshot.unwrap();
            if done(&snapshot) {
                return snapshot;
            }
        }
        panic!("the stream ended");
    };
    tokio::time::timeout(LIMIT, watching).await.expect("in time")
}

/// Distance between two points, m.
pub fn distance(a: world::Vec3, b: world::Vec3) -> f32 {
    ((a.x - b.x).powi(2) + (a.y - b.y).powi(2) + (a.z - b.z).powi(2)).sqrt()
}

/// Opens the stream of a world's snapshots.
pub async fn watch(
    client: &mut WorldServiceClient<Channel>,
    world_id: u64,
    rate_hz: f32,
) -> tonic::Streaming<world::WatchWorldResponse> {
    let request = world::WatchWorldRequest { world_id, rate_hz, ..Default::default() };
    client.watch_world(request).await.expect("the world exists").into_inner()
}

/// Waits until `GET /metrics` has this line.
pub async fn until_metrics_say(service: &Running, line: &str) {
    let waiting = async {
        while !metrics(service, "").await.lines().any(|found| found == line) {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, waiting).await.unwrap_or_else(|_| panic!("the metrics never said `{line}`"));
}

/// Sends an NPC of a realtime world from one place to another and returns the plan that it follows. Sends it again
/// whenever its attempt ends before the plan arrives.
pub async fn follow_until_planned(
    client: &mut WorldServiceClient<Channel>,
    steps: &mut tonic::Streaming<world::FollowNpcResponse>,
    npc_id: u64,
    [start, goal]: [world::Vec3; 2],
) -> world::NpcPlan {
    let following = async {
        set_goal(client, npc_id, goal).await;
        while let Some(step) = steps.next().await {
            let step = step.expect("the stream goes on");
            if let Some(plan) = step.plan.filter(|plan| !plan.waypoints.is_empty()) {
                return plan;
            }
            if step.npc.expect("an NPC").status() != world::NpcStatus::Seeking {
                let teleport =
                    world::TeleportNpcRequest { npc_id, position: Some(start), yaw: 0.0, ..Default::default() };
                client.teleport_npc(teleport).await.expect("a place on the map");
                set_goal(client, npc_id, goal).await;
            }
        }
        panic!("the stream ended");
    };
    tokio::time::timeout(LIMIT, following).await.expect("a plan")
}
