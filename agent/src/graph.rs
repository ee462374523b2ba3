//! The planner's graphs of the worlds' maps: builds, edits, queries and reports.
//!
//! All calls about one map go to the same replica of the planner while it answers. Worlds on equal maps share a graph.
//! Streams use a connection of their own, and their number is limited, so that queries never wait behind them.

use super::config::{MAX_PAUSE, MIN_PAUSE};
use parking_lot::Mutex;
use prost::Message;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};
use std::time::Duration;
use surefoot_net::client::Link;
use surefoot_net::replicas::{ReplicaLink, ReplicaLinks, Replicas};
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_planner::live::Traversal;
use surefoot_planner::{Plan, Query, Traffic, Zones};
use surefoot_proto::convert;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::planner::v1::{self as planner, BuildStage};
use surefoot_proto::plans;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::zones;
use surefoot_world::MapSpec;
use surefoot_world::map::Piece;
use tokio::sync::{Semaphore, watch};
use tokio::time::Instant;
use tokio_stream::StreamExt;
use tonic::{Code, Status};
use tracing::{info, warn};

/// Longest wait for an imported map to be fetched or imported.
const IMPORT_LIMIT: Duration = Duration::from_secs(60);

/// Builds whose progress is watched at a time; further ones wait.
const WATCHED_BUILDS: usize = 50;
/// Graphs whose edits are watched at a time; for further graphs, the answers to queries show edits. Builds and graphs
/// together stay below the streams that a planner allows on a connection (128).
const WATCHED_GRAPHS: usize = 50;
/// Longest wait for a batch of plans.
const PLAN_LIMIT: Duration = Duration::from_secs(5);

/// Converts a revision from the wire, where 0 means none.
fn revision_from_wire(revision: u64) -> Option<u64> {
    (revision != 0).then_some(revision)
}

/// The map, with its pieces, and the body: worlds with equal keys share a graph.
#[derive(Debug, Clone)]
pub(super) struct GraphKey {
    map: Option<wire::MapSpec>,
    pub map_hash: String,
    body: Option<wire::Body>,
    pieces: Vec<wire::Piece>,
}

/// Hash of a map without its pieces, and a body and the pieces as they are on the wire.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Identity(String, Vec<u8>, Vec<Vec<u8>>);

impl GraphKey {
    /// The key of an assignment's map and body.
    pub fn of(assignment: &wire::Assignment) -> Self {
        let wire::Assignment { map, map_hash, body, pieces, .. } = assignment.clone();
        Self { map, map_hash, body, pieces }
    }

    /// Whether the key has the body of an assignment.
    pub fn is_for(&self, assignment: &wire::Assignment) -> bool {
        self.body == assignment.body
    }

    /// The key of the same map with other pieces.
    pub fn with_pieces(&self, pieces: Vec<wire::Piece>) -> Self {
        Self { pieces, ..self.clone() }
    }

    /// The pieces on the map.
    pub fn pieces(&self) -> Result<Vec<Piece>, String> {
        surefoot_proto::pieces::pieces(&self.pieces, "pieces").map_err(|error| error.to_string())
    }

    /// Equal for equal maps and bodies.
    fn identity(&self) -> Identity {
        let pieces = self.pieces.iter().map(Message::encode_to_vec).collect();
        Identity(self.map_hash.clone(), self.body.as_ref().map(Message::encode_to_vec).unwrap_or_default(), pieces)
    }

    /// The spec of the map; `None` if it was imported.
    pub fn spec(&self) -> Option<Result<MapSpec, String>> {
        self.map.as_ref().map(|spec| convert::map_spec(Some(spec)).map_err(|error| error.to_string()))
    }

    /// Downloads an imported map from the server, as a saved map.
    pub async fn download(&self, server: Link) -> Result<Vec<u8>, String> {
        let mut client = MapServiceClient::new(server).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let request = wire::GetMapRequest { map_hash: self.map_hash.clone() };
        let mut chunks = client.get_map(request).await.map_err(|status| status.to_string())?.into_inner();
        let mut bytes = Vec::new();
        while let Some(message) = chunks.next().await {
            bytes.extend(message.map_err(|status| status.to_string())?.chunk);
        }
        Ok(bytes)
    }
}

/// The graphs of one planner, shared by all worlds of a worker.
pub(super) struct Graphs {
    queries: ReplicaLinks,
    streams: ReplicaLinks,
    settings: planner::BuildSettings,
    policy_hash: String,
    by_key: Mutex<BTreeMap<Identity, Weak<Graph>>>,
    watched_builds: Arc<Semaphore>,
    watched_graphs: Arc<Semaphore>,
    other_policy: watch::Sender<Option<Status>>,
}

impl Graphs {
    /// Graphs of these replicas, which share them, proved with the policy of that hash.
    pub fn new(planners: &Replicas, settings: planner::BuildSettings, policy_hash: String) -> Self {
        Self {
            queries: planners.connect_lazy(),
            streams: planners.connect_lazy(),
            settings,
            policy_hash,
            by_key: Mutex::default(),
            watched_builds: Arc::new(Semaphore::new(WATCHED_BUILDS)),
            watched_graphs: Arc::new(Semaphore::new(WATCHED_GRAPHS)),
            other_policy: watch::Sender::new(None),
        }
    }

    /// The graph of a map for a body. Unless a world uses it already, it is requested from the planner. An imported map
    /// is downloaded from `server`.
    pub fn of(&self, key: GraphKey, server: Link) -> Arc<Graph> {
        let mut by_key = self.by_key.lock();
        by_key.retain(|_, graph| graph.strong_count() > 0);
        let identity = key.identity();
        if let Some(graph) = by_key.get(&identity).and_then(Weak::upgrade) {
            return graph;
        }
        let graph = Arc::new(self.start(key, server));
        by_key.insert(identity, Arc::downgrade(&graph));
        graph
    }

    /// Resolves when the planner has refused to prove edges with this worker's policy.
    pub async fn other_policy(&self) -> Status {
        let mut refused = self.other_policy.subscribe();
        // The sender lives as long as `self`.
        let refused = refused.wait_for(Option::is_some).await;
        refused
            .ok()
            .and_then(|status| status.clone())
            .unwrap_or_else(|| Status::internal("the watch of the planner's policy has ended"))
    }

    fn start(&self, key: GraphKey, server: Link) -> Graph {
        let (ready, id) = watch::channel(String::new());
        let (interim, interim_id) = watch::channel(String::new());
        let (edited, revision) = watch::channel(None);
        let (running, progress) = watch::channel(Instant::now());
        let (queries, streams) = (self.queries.for_key(&key.map_hash), self.streams.for_key(&key.map_hash));
        let planner = |link| PlannerServiceClient::new(link).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let is_imported = key.map.is_none();
        let builder = Builder {
            client: planner(streams.clone()),
            request: planner::StartBuildRequest {
                map: key.map,
                map_hash: if is_imported { key.map_hash } else { String::new() },
                settings: Some(self.settings),
                policy_hash: self.policy_hash.clone(),
                body: key.body,
                pieces: key.pieces,
                ..Default::default()
            },
            server_maps: MapServiceClient::new(server).max_decoding_message_size(MAX_MESSAGE_BYTES),
            planner_maps: MapServiceClient::new(streams).max_encoding_message_size(MAX_MESSAGE_BYTES),
            watched_builds: self.watched_builds.clone(),
            watched_graphs: self.watched_graphs.clone(),
            other_policy: self.other_policy.clone(),
            running,
            interim,
        };
        Graph {
            client: planner(queries.clone()),
            link: queries,
            id,
            interim_id,
            ready: ready.clone(),
            revision,
            progress,
            build: tokio::spawn(builder.run(ready, edited)),
        }
    }
}

/// The planner's graph of one map for one body.
pub(super) struct Graph {
    client: PlannerServiceClient<ReplicaLink>,
    /// The link of `client`.
    link: ReplicaLink,
    /// Id of the graph; empty until it is built, and again when the planner no longer knows it.
    pub id: watch::Receiver<String>,
    /// Id of the interim graph, while the build is running and as soon as it answers queries; otherwise empty.
    interim_id: watch::Receiver<String>,
    /// Sender of `id`; cleared when the planner no longer knows the graph.
    ready: watch::Sender<String>,
    /// Revision of designers' edits; `None` while unknown.
    pub revision: watch::Receiver<Option<u64>>,
    /// When the planner last reported that the build is running.
    progress: watch::Receiver<Instant>,
    build: tokio::task::JoinHandle<()>,
}

impl Graph {
    /// Waits until the graph is ready: at most `limit`, and at most `silence` without a report from the planner.
    /// Returns whether it is ready.
    pub async fn wait(&self, limit: Duration, silence: Duration) -> bool {
        let (mut id, progress) = (self.id.clone(), self.progress.clone());
        let started = Instant::now();
        loop {
            let heard = started.max(*progress.borrow());
            let until = (heard + silence).min(started + limit);
            match tokio::time::timeout_at(until, id.wait_for(|id| !id.is_empty())).await {
                Ok(ready) => return ready.is_ok(),
                Err(_) if started.max(*progress.borrow()) > heard && Instant::now() < started + limit => {}
                Err(_) => return false,
            }
        }
    }

    /// Id of the graph for plans now, or of the interim graph if `takes_interim`; empty if there is none.
    pub fn id_for_plans(&self, takes_interim: bool) -> String {
        let id = self.id.borrow().clone();
        if id.is_empty() && takes_interim { self.interim_id.borrow().clone() } else { id }
    }

    /// Whether no replica of the planner has answered of late; queries can wait until one is tried again.
    pub fn is_resting(&self) -> bool {
        self.link.is_resting()
    }

    /// Requests plans on the graph `graph_id` that respect `zones`; on a failure there are none.
    pub async fn find_paths(
        &self,
        graph_id: String,
        queries: &[Query],
        zones: &Zones,
        traffic: Option<&Traffic>,
    ) -> Plans {
        let queries = queries.iter().map(plans::query_to_wire).collect();
        let request = planner::FindPathsRequest {
            graph_id,
            queries,
            traffic: traffic.map(plans::traffic_to_wire),
            zones: zones.iter().map(zones::zone_to_wire).collect(),
            ..Default::default()
        };
        let mut client = self.client.clone();
        let answer = tokio::time::timeout(PLAN_LIMIT, client.find_paths(request)).await;
        let planner::FindPathsResponse { plans, revision, interim } = match answer {
            Ok(Ok(response)) => response.into_inner(),
            Ok(Err(status)) => {
                if status.code() == Code::NotFound {
                    // The planner has evicted the graph.
                    self.ready.send_replace(String::new());
                }
                warn!(%status, "the planner found no paths");
                return Plans::default();
            }
            Err(_) => {
                warn!("the planner did not answer within {} s", PLAN_LIMIT.as_secs());
                return Plans::default();
            }
        };
        let plans = plans.iter().map(|plan| plans::plan(plan).ok()).collect();
        Plans { plans, revision: revision_from_wire(revision), is_interim: interim }
    }

    /// Reports traversals of edges in the background, to an interim graph if `takes_interim`.
    pub fn report(&self, takes_interim: bool, traversals: Vec<Traversal>) {
        let graph_id = self.id_for_plans(takes_interim);
        if graph_id.is_empty() {
            // The planner has lost the graph of these traversals.
            return;
        }
        let request = planner::ReportTraversalsRequest {
            graph_id,
            traversals: traversals.iter().map(plans::traversal_to_wire).collect(),
            // The link adds the id.
            request_id: String::new(),
        };
        let mut client = self.client.clone();
        tokio::spawn(async move {
            if let Ok(Err(status)) = tokio::time::timeout(PLAN_LIMIT, client.report_traversals(request)).await {
                warn!(%status, "cannot report traversals to the planner");
            }
        });
    }
}

/// Plans for a batch of queries.
#[derive(Default)]
pub(super) struct Plans {
    /// The plan for each query, in order; `None` or missing if there is none.
    pub plans: Vec<Option<Plan>>,
    /// Revision of designers' edits with which the plans were made.
    pub revision: Option<u64>,
    /// Whether the graph is incomplete, so that goals without a path may have one.
    pub is_interim: bool,
}

impl Drop for Graph {
    fn drop(&mut self) {
        self.build.abort();
    }
}

struct Builder {
    client: PlannerServiceClient<ReplicaLink>,
    request: planner::StartBuildRequest,
    server_maps: MapServiceClient<Link>,
    planner_maps: MapServiceClient<ReplicaLink>,
    watched_builds: Arc<Semaphore>,
    watched_graphs: Arc<Semaphore>,
    other_policy: watch::Sender<Option<Status>>,
    running: watch::Sender<Instant>,
    /// Sender of `Graph::interim_id`.
    interim: watch::Sender<String>,
}

impl Builder {
    /// Builds the graph, again after failures and when the planner has lost it. Sends its id to `ready` and its
    /// revision to `edited`.
    async fn run(mut self, ready: watch::Sender<String>, edited: watch::Sender<Option<u64>>) {
        let mut pause = MIN_PAUSE;
        loop {
            let built = self.build().await;
            self.interim.send_replace(String::new());
            match built {
                Ok(graph_id) => {
                    info!(graph_id, "graph ready");
                    ready.send_replace(graph_id.clone());
                    let mut lost = ready.subscribe();
                    let known = tokio::select! {
                        // A query clears the id if the planner no longer knows the graph, which is then built again.
                        result = lost.wait_for(String::is_empty) => result.is_ok(),
                        () = self.watch(&graph_id, &edited) => true,
                    };
                    if !known {
                        return;
                    }
                    edited.send_replace(None);
                    pause = MIN_PAUSE;
                }
                Err(status) => {
                    if Reason::of(&status) == Some(Reason::PolicyMismatch) {
                        self.other_policy.send_replace(Some(status));
                        return;
                    }
                    warn!(%status, "the planner has built no graph; NPCs head straight for their goals");
                    tokio::time::sleep(pause).await;
                    pause = (pause * 2).min(MAX_PAUSE);
                }
            }
        }
    }

    /// Watches the edits of a graph; never returns.
    async fn watch(&self, graph_id: &str, edited: &watch::Sender<Option<u64>>) {
        let Ok(_turn) = self.watched_graphs.acquire().await else { return std::future::pending().await };
        let mut client = self.client.clone();
        loop {
            let request = planner::WatchGraphRequest { graph_id: graph_id.to_owned() };
            let ended = match client.watch_graph(request).await {
                Ok(changes) => {
                    let mut changes = changes.into_inner();
                    loop {
                        match changes.next().await {
                            Some(Ok(change)) => drop(edited.send_replace(revision_from_wire(change.revision))),
                            Some(Err(status)) => break status,
                            None => break Status::unavailable("the stream ended"),
                        }
                    }
                }
                Err(status) => status,
            };
            edited.send_replace(None);
            match ended.code() {
                // The next query causes a rebuild: a planner may evict graphs that are not queried. Older planners do
                // not implement the stream.
                Code::NotFound | Code::Unimplemented => std::future::pending().await,
                _ => tokio::time::sleep(MAX_PAUSE).await,
            }
        }
    }

    async fn build(&mut self) -> Result<String, Status> {
        let turns = self.watched_builds.clone();
        // Never closed.
        let _turn = turns.acquire().await.map_err(|_| Status::unavailable("shutting down"))?;
        match self.build_known().await {
            Err(status) if status.code() == Code::NotFound && !self.request.map_hash.is_empty() => {
                self.forward_map().await?;
                self.build_known().await
            }
            result => result,
        }
    }

    async fn build_known(&mut self) -> Result<String, Status> {
        let started = self.client.start_build(self.request.clone()).await?.into_inner();
        let build_id = started.build.unwrap_or_default().build_id;
        let mut progress = self.client.watch_build(planner::WatchBuildRequest { build_id }).await?.into_inner();
        while let Some(message) = progress.next().await {
            let build = message?.build.unwrap_or_default();
            self.running.send_replace(Instant::now());
            self.interim.send_replace(build.interim_graph_id.clone());
            match (build.stage(), build.failure) {
                (BuildStage::Done, _) => return Ok(build.graph_id),
                (BuildStage::Cancelled, _) => return Err(Status::cancelled("the build was cancelled")),
                (BuildStage::Failed, Some(failure)) => return Err(Status::new(failure.code.into(), failure.message)),
                _ => {}
            }
        }
        Err(Status::unavailable("the planner ended the build without a graph"))
    }

    /// Imports the server's map into the planner, chunk by chunk.
    async fn forward_map(&mut self) -> Result<(), Status> {
        let map_hash = self.request.map_hash.clone();
        let upload_id = format!("worker-{}", map_hash.get(..32).unwrap_or_default());
        let forward = async {
            let get = wire::GetMapRequest { map_hash };
            let mut chunks = self.server_maps.get_map(get).await?.into_inner();
            let (mut name, mut offset) = (String::new(), 0);
            while let Some(message) = chunks.next().await {
                let wire::GetMapResponse { map, chunk, .. } = message?;
                if let Some(map) = map {
                    name = map.name;
                }
                let chunk_len = chunk.len() as u64;
                let part = wire::UploadChunkRequest { upload_id: upload_id.clone(), offset, data: chunk };
                self.planner_maps.upload_chunk(part).await?;
                offset += chunk_len;
            }
            let import = wire::ImportMapRequest {
                name,
                format: wire::MapFormat::Saved.into(),
                upload_id: upload_id.clone(),
                ..wire::ImportMapRequest::default()
            };
            self.planner_maps.import_map(import).await.map(drop)
        };
        let timeout = |_| Status::deadline_exceeded("the planner did not import the map within a minute");
        tokio::time::timeout(IMPORT_LIMIT, forward).await.map_err(timeout)?
    }
}
