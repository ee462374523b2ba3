//! The planner's graph of a world's map: requests its build, and again when the planner has lost it.

use super::config::{MAX_PAUSE, MIN_PAUSE};
use std::time::Duration;
use surefoot_net::client::Link;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::planner::v1::{self as planner, BuildStage};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use tokio::sync::watch;
use tokio_stream::StreamExt;
use tonic::{Code, Status};
use tracing::{info, warn};

/// Longest wait for an imported map to be fetched or imported.
const IMPORT_LIMIT: Duration = Duration::from_secs(60);

/// Converts a revision from the wire, where 0 means none.
pub(super) fn revision_from_wire(revision: u64) -> Option<u64> {
    (revision != 0).then_some(revision)
}

/// The planner's graph of one map.
pub(super) struct Graph {
    pub client: PlannerServiceClient<Link>,
    /// Id of the graph; empty until it is built, and again when the planner no longer knows it.
    pub id: watch::Receiver<String>,
    /// Sender of `id`; clear it when the planner no longer knows the graph.
    pub ready: watch::Sender<String>,
    /// Revision of designers' edits; `None` while unknown.
    pub revision: watch::Receiver<Option<u64>>,
    build: tokio::task::JoinHandle<()>,
}

impl Graph {
    /// Starts a task that has `planner` build the graph of an assignment's map. An imported map is fetched from `server`.
    pub fn start(server: Link, planner: Link, assignment: &wire::Assignment, settings: planner::BuildSettings) -> Self {
        let client = PlannerServiceClient::new(planner.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let (ready, id) = watch::channel(String::new());
        let (edited, revision) = watch::channel(None);
        let maps = |link| {
            MapServiceClient::new(link)
                .max_decoding_message_size(MAX_MESSAGE_BYTES)
                .max_encoding_message_size(MAX_MESSAGE_BYTES)
        };
        let is_imported = assignment.map.is_none();
        let builder = Builder {
            client: client.clone(),
            request: planner::StartBuildRequest {
                map: assignment.map,
                map_hash: if is_imported { assignment.map_hash.clone() } else { String::new() },
                settings: Some(settings),
            },
            server_maps: maps(server),
            planner_maps: maps(planner),
        };
        Self { client, id, ready: ready.clone(), revision, build: tokio::spawn(builder.run(ready, edited)) }
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        self.build.abort();
    }
}

struct Builder {
    client: PlannerServiceClient<Link>,
    request: planner::StartBuildRequest,
    server_maps: MapServiceClient<Link>,
    planner_maps: MapServiceClient<Link>,
}

impl Builder {
    /// Has the graph built, retrying after failures and when it is lost. Sends its id to `ready` and its revision to `edited`.
    async fn run(mut self, ready: watch::Sender<String>, edited: watch::Sender<Option<u64>>) {
        let mut pause = MIN_PAUSE;
        loop {
            match self.build().await {
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
                    warn!(%status, "no graph yet: NPCs head straight for their goals");
                    tokio::time::sleep(pause).await;
                    pause = (pause * 2).min(MAX_PAUSE);
                }
            }
        }
    }

    /// Watches the edits of a graph; never returns.
    async fn watch(&self, graph_id: &str, edited: &watch::Sender<Option<u64>>) {
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
                // The next query causes a rebuild: a planner may evict graphs that are not queried. Older planners do not
                // implement the stream.
                Code::NotFound | Code::Unimplemented => std::future::pending().await,
                _ => tokio::time::sleep(MAX_PAUSE).await,
            }
        }
    }

    async fn build(&mut self) -> Result<String, Status> {
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
            match (build.stage(), build.failure) {
                (BuildStage::Done, _) => return Ok(build.graph_id),
                (BuildStage::Cancelled, _) => return Err(Status::cancelled("the build was cancelled")),
                (BuildStage::Failed, Some(failure)) => return Err(Status::new(failure.code.into(), failure.message)),
                _ => {}
            }
        }
        Err(Status::unavailable("the planner ended the build without a graph"))
    }

    /// Imports the server's map into the planner.
    async fn forward_map(&mut self) -> Result<(), Status> {
        let mut get = tonic::Request::new(wire::GetMapRequest { map_hash: self.request.map_hash.clone() });
        get.set_timeout(IMPORT_LIMIT);
        let wire::GetMapResponse { map, file } = self.server_maps.get_map(get).await?.into_inner();
        let import = wire::ImportMapRequest {
            name: map.unwrap_or_default().name,
            format: wire::MapFormat::Saved.into(),
            file,
            sidecar: String::new(),
        };
        let mut import = tonic::Request::new(import);
        import.set_timeout(IMPORT_LIMIT);
        self.planner_maps.import_map(import).await.map(drop)
    }
}
