//! The gRPC face of the planner: decode, call, encode.
//!
//! Graphs in use (`hosted`) are kept in memory, all of them on disk; `builds` makes new ones. What NPCs report counts at once
//! where it makes an edge dearer; a new table follows within seconds.

mod builds;
mod hosted;
pub mod wire_form;

pub use wire_form::{npc_plan_to_wire, plan_from_wire, plan_to_wire, settings_to_wire};

use crate::build::{BuildError, GraphId};
use crate::cache::{GraphStore, StoreError};
use crate::edits::{Layer, LayerError};
use crate::live::LiveEvidence;
use crate::probe::{self, ProbeContext, Trial};
use crate::reachability;
use crate::search::{DEFAULT_TABLE_LIMIT, Query};
use builds::{Listed, report};
use hosted::{Hosted, revision_of};
use std::collections::{BTreeMap, VecDeque};
use std::pin::Pin;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use surefoot_policy::Policy;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::maps::{DEFAULT_MAX_MAPS, MapShelf, MapSource};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_server::{PlannerService, PlannerServiceServer, SERVICE_NAME};
use surefoot_proto::serving::{Endpoint, MAX_MESSAGE_BYTES, ServeError, Shutdown, going_away, with_grpc_web};
use surefoot_proto::status;
use surefoot_proto::world::v1::map_service_server::{MapServiceServer, SERVICE_NAME as MAP_SERVICE};
use surefoot_world::{Map, Vec3};
use tokio::sync::{Semaphore, mpsc, watch};
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};
use tracing::warn;
use wire_form::{
    edits_from_wire, layer_from_wire, layer_to_wire, passage_from_wire, settings_from_wire, unfit_to_wire,
};

/// Limits and sizes of a planner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlannerConfig {
    /// Most vertices of a graph (`--max-vertices`).
    pub max_vertices: usize,
    /// Most queries in one batch (`--max-queries`).
    pub max_queries: usize,
    /// Most builds that run or wait (`--max-builds`).
    pub max_builds: usize,
    /// Graphs kept in memory (`--graphs-in-memory`).
    pub graphs_in_memory: usize,
    /// Threads that probe (`--threads`).
    pub threads: usize,
    /// Vertices up to which a graph gets a table of next hops, 5 bytes for each pair (`--table-vertices`).
    pub table_vertices: usize,
    /// Most imported maps that are kept (`--max-maps`).
    pub max_maps: usize,
}

impl Default for PlannerConfig {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            max_vertices: 2000,
            max_queries: 4096,
            max_builds: 16,
            graphs_in_memory: 32,
            threads,
            table_vertices: DEFAULT_TABLE_LIMIT,
            max_maps: DEFAULT_MAX_MAPS,
        }
    }
}

/// Failed legs that a query may carry.
const MAX_AVOID: usize = 64;
/// Passages that one report may hold.
const MAX_PASSAGES: usize = 4096;
/// From a report to the table that has learned from it.
const REFRESH_AFTER: Duration = Duration::from_secs(2);
/// Those who watch a graph that does not change are told so after this: well before their connection counts as silent.
const REMIND_AFTER: Duration = Duration::from_secs(20);
const POISON: &str = "no holder of this lock panics";

/// The service; clones share everything.
#[derive(Clone)]
pub struct PlannerApi {
    shared: Arc<Shared>,
}

struct Shared {
    config: PlannerConfig,
    policy: Policy,
    store: Box<dyn GraphStore>,
    maps: MapShelf,
    /// Most recently used last.
    ready: Mutex<VecDeque<Arc<Hosted>>>,
    /// By source and settings, since the hash of a generated map is not known before.
    jobs: Mutex<BTreeMap<String, Listed>>,
    /// One build at a time: each uses all cores.
    turn: Semaphore,
    /// One change of layers at a time, and no graph that takes them up meanwhile.
    editing: Arc<tokio::sync::Mutex<()>>,
    /// Probes that run at a time for those who ask for one.
    probing: Arc<Semaphore>,
    /// The map of the last such probe.
    probed_map: Mutex<Option<Arc<Map>>>,
    plans: std::sync::atomic::AtomicU64,
    shutdown: Shutdown,
}

/// Serves the planner on `endpoint` until `shutdown`.
///
/// # Errors
/// If the transport fails.
pub async fn serve(
    endpoint: Endpoint,
    config: PlannerConfig,
    policy: Policy,
    store: Box<dyn GraphStore>,
    shutdown: Shutdown,
) -> Result<(), ServeError> {
    let api = PlannerApi::new(config, policy, store, shutdown.clone());
    let metrics = {
        let api = api.clone();
        move || {
            let text = api.metrics();
            async move { text }
        }
    };
    let mut routes = tonic::service::Routes::builder();
    let grpc = PlannerServiceServer::new(api.clone())
        .max_decoding_message_size(endpoint.limits().max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let maps = MapServiceServer::new(api.shared.maps.clone())
        .max_decoding_message_size(endpoint.limits().max_import_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    routes.add_service(with_grpc_web(grpc)).add_service(with_grpc_web(maps));
    let result = endpoint.serve(routes, &[SERVICE_NAME, MAP_SERVICE], metrics, shutdown).await;
    api.cancel_builds();
    api.remember_reports();
    result
}

impl From<BuildError> for Status {
    fn from(error: BuildError) -> Self {
        let message = error.to_string();
        match error {
            BuildError::Setting { field, .. } => status::invalid(format!("settings.{field}"), message),
            BuildError::NoGround(_) => Status::failed_precondition(message),
            BuildError::Cancelled => Status::cancelled(message),
        }
    }
}

impl PlannerApi {
    /// A planner for one policy.
    pub fn new(config: PlannerConfig, policy: Policy, store: Box<dyn GraphStore>, shutdown: Shutdown) -> Self {
        let shared = Shared {
            config,
            policy,
            store,
            maps: MapShelf::new(config.max_maps),
            ready: Mutex::default(),
            jobs: Mutex::default(),
            turn: Semaphore::new(1),
            editing: Arc::default(),
            probing: Arc::new(Semaphore::new(config.threads.max(1))),
            probed_map: Mutex::default(),
            plans: std::sync::atomic::AtomicU64::new(0),
            shutdown,
        };
        Self { shared: Arc::new(shared) }
    }

    fn cancel_builds(&self) {
        for job in self.shared.jobs.lock().expect(POISON).values() {
            job.progress.cancel.store(true, Ordering::Relaxed);
        }
    }

    fn remember_reports(&self) {
        for hosted in self.shared.ready.lock().expect(POISON).iter() {
            self.remember_report(hosted, &hosted.live());
        }
    }

    fn remember_report(&self, hosted: &Hosted, live: &LiveEvidence) {
        if !live.is_empty()
            && let Err(error) = self.shared.store.put_live(&hosted.origin.id, live)
        {
            warn!(%error, "what NPCs reported is not remembered");
        }
    }

    fn metrics(&self) -> String {
        let plans = self.shared.plans.load(Ordering::Relaxed);
        let graphs = self.shared.ready.lock().expect(POISON).len();
        let builds = self.shared.jobs.lock().expect(POISON).len();
        format!(
            "# HELP surefoot_plans_total Plans answered.\n# TYPE surefoot_plans_total counter\nsurefoot_plans_total {plans}\n\
             # HELP surefoot_graphs_in_memory Graphs ready to be asked.\n# TYPE surefoot_graphs_in_memory gauge\nsurefoot_graphs_in_memory {graphs}\n\
             # HELP surefoot_builds Builds that run or wait.\n# TYPE surefoot_builds gauge\nsurefoot_builds {builds}\n"
        )
    }

    /// A graph that somebody asks something.
    fn ready(&self, graph_id: &str) -> Result<Arc<Hosted>, Status> {
        let hosted = self.find(graph_id)?;
        self.recall(&hosted.origin.id);
        Ok(hosted)
    }

    /// A graph, without counting as a use of it.
    fn find(&self, graph_id: &str) -> Result<Arc<Hosted>, Status> {
        let id = GraphId::parse(graph_id)
            .ok_or_else(|| status::invalid("graph_id", "graph_id is not 64 hexadecimal digits"))?;
        let ready = self.shared.ready.lock().expect(POISON);
        if let Some(hosted) = ready.iter().find(|entry| entry.origin.id == id) {
            return Ok(hosted.clone());
        }
        let message = format!("graph {graph_id} is not loaded: call BuildGraph first (a cached graph loads at once)");
        Err(status::not_found("graph", graph_id, message))
    }

    fn recall(&self, id: &GraphId) -> Option<Arc<Hosted>> {
        let mut ready = self.shared.ready.lock().expect(POISON);
        let at = ready.iter().position(|entry| entry.origin.id == *id)?;
        let entry = ready.remove(at)?;
        ready.push_back(entry.clone());
        Some(entry)
    }

    fn remember(&self, entry: Arc<Hosted>) {
        let mut ready = self.shared.ready.lock().expect(POISON);
        ready.retain(|other| other.origin.id != entry.origin.id);
        ready.push_back(entry);
        while ready.len() > self.shared.config.graphs_in_memory {
            ready.pop_front();
        }
    }

    /// Lays changed layers over all graphs of a level, remembers them, and says what the graph is like now. Unless `if_revision`
    /// is 0, only if the layers are in that state.
    async fn change_layers(
        &self,
        graph_id: &str,
        if_revision: u64,
        change: impl FnOnce(&mut Vec<Layer>) -> Result<Layer, Status> + Send + 'static,
    ) -> Result<LaidOver, Status> {
        let editing = self.shared.editing.clone().lock_owned().await;
        let hosted = self.ready(graph_id)?;
        let api = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            // Held until the change is made, even if nobody waits for the answer any more.
            let _editing = editing;
            let level = hosted.level();
            // What is kept is what counts: a graph shows it a little later.
            let mut layers = api
                .shared
                .store
                .layers(&level)
                .map_err(|error| Status::internal(format!("the layers cannot be read: {error}")))?;
            if if_revision != 0 && if_revision != revision_of(&layers) {
                return Err(Status::aborted(
                    "somebody else has changed the layers of this level meanwhile: GetLayers tells how, then try again",
                ));
            }
            let changed = change(&mut layers)?;
            changed.validate().map_err(|error| Status::from(LayerProblem(error)))?;
            layers.retain(|layer| layer.name != changed.name);
            if !changed.edits.is_empty() {
                layers.push(changed.clone());
            }
            layers.sort_by(|a, b| a.name.cmp(&b.name));
            api.shared
                .store
                .put_layer(&level, &changed)
                .map_err(|error| Status::internal(format!("the layer cannot be kept: {error}")))?;
            let mut all: Vec<Arc<Hosted>> = api.shared.ready.lock().expect(POISON).iter().cloned().collect();
            if !all.iter().any(|other| Arc::ptr_eq(other, &hosted)) {
                all.push(hosted.clone());
            }
            for other in all.iter().filter(|other| other.level() == level) {
                other.lay_over(layers.clone());
            }
            let (_, unfit) = hosted.layers();
            Ok(LaidOver { summary: hosted.summary(), unfit: unfit_to_wire(&unfit), revision: hosted.revision() })
        });
        task.await.map_err(|error| Status::internal(format!("the edit failed: {error}")))?
    }

    /// What probes on a graph's map run with. The map that was asked for last is kept, since designers try one edge after another.
    fn context_of(&self, hosted: &Hosted) -> Result<ProbeContext, Status> {
        // Others who need it wait until it is made.
        let mut kept = self.shared.probed_map.lock().expect(POISON);
        let map = match kept.clone().filter(|map| map.hash().to_hex() == hosted.origin.map_hash) {
            Some(map) => map,
            None => hosted.origin.source.map()?,
        };
        *kept = Some(map.clone());
        drop(kept);
        Ok(ProbeContext::new(map, self.shared.policy.clone()))
    }

    /// Tells one reader what a graph is like now, and again whenever it has changed.
    async fn tell_changes(
        self,
        graph_id: String,
        mut changes: watch::Receiver<()>,
        queue: mpsc::Sender<Result<wire::WatchGraphResponse, Status>>,
    ) {
        let stopping = self.shared.shutdown.wait();
        tokio::pin!(stopping);
        changes.mark_changed();
        let end = loop {
            tokio::select! {
                changed = changes.changed() => if changed.is_err() {
                    break status::not_found("graph", &graph_id, format!("graph {graph_id} is no longer loaded: call BuildGraph"));
                },
                () = tokio::time::sleep(REMIND_AFTER) => {}
                () = &mut stopping => break going_away(),
                () = queue.closed() => return,
            }
            let told = match self.find(&graph_id) {
                Ok(hosted) => wire::WatchGraphResponse { summary: Some(hosted.summary()), revision: hosted.revision() },
                Err(status) => break status,
            };
            tokio::select! {
                sent = queue.send(Ok(told)) => if sent.is_err() { return },
                () = &mut stopping => return,
            }
        };
        // A reader that does not read does not learn why its stream is over.
        let _ = queue.try_send(Err(end));
    }

    /// Makes a new table of a graph, unless one is due already.
    fn refresh_later(&self, hosted: Arc<Hosted>) {
        if hosted.refresh_is_due.swap(true, Ordering::Relaxed) {
            return;
        }
        let api = self.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = tokio::time::sleep(REFRESH_AFTER) => {}
                () = api.shared.shutdown.wait() => return,
            }
            let task = tokio::task::spawn_blocking(move || {
                hosted.refresh_is_due.store(false, Ordering::Relaxed);
                let live = hosted.refresh();
                api.remember_report(&hosted, &live);
            });
            if let Err(error) = task.await {
                warn!(%error, "a graph is not brought up to date");
            }
        });
    }

    fn plan(&self, hosted: &Hosted, query: &wire::PathQuery) -> Result<wire::Plan, Status> {
        if query.avoid.len() > MAX_AVOID {
            let message = format!("query.avoid has {} legs, allowed are {MAX_AVOID}", query.avoid.len());
            return Err(status::invalid("query.avoid", message));
        }
        let query = Query {
            start: convert::point(query.start.as_ref(), "query.start")?,
            goal: convert::point(query.goal.as_ref(), "query.goal")?,
            avoid: query.avoid.iter().map(|leg| (leg.from, leg.to)).collect(),
        };
        self.shared.plans.fetch_add(1, Ordering::Relaxed);
        Ok(plan_to_wire(&hosted.plan(&query)))
    }
}

type BoxStream<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl PlannerService for PlannerApi {
    type BuildGraphStream = BoxStream<wire::BuildGraphResponse>;

    async fn build_graph(
        &self,
        request: Request<wire::BuildGraphRequest>,
    ) -> Result<Response<Self::BuildGraphStream>, Status> {
        let request = request.into_inner();
        let source = self.shared.maps.source(request.map.as_ref(), &request.map_hash)?;
        let settings = settings_from_wire(request.settings.as_ref(), &self.shared.config)?;
        let job = self.join(source, settings)?;
        let (queue, stream) = mpsc::channel(4);
        tokio::spawn(report(job, queue, self.shared.shutdown.clone()));
        Ok(Response::new(Box::pin(ReceiverStream::new(stream))))
    }

    async fn get_graph(
        &self,
        request: Request<wire::GetGraphRequest>,
    ) -> Result<Response<wire::GetGraphResponse>, Status> {
        let ready = self.ready(&request.into_inner().graph_id)?;
        Ok(Response::new(ready.to_wire()))
    }

    type WatchGraphStream = BoxStream<wire::WatchGraphResponse>;

    async fn watch_graph(
        &self,
        request: Request<wire::WatchGraphRequest>,
    ) -> Result<Response<Self::WatchGraphStream>, Status> {
        let graph_id = request.into_inner().graph_id;
        let changes = self.ready(&graph_id)?.changes();
        let (queue, stream) = mpsc::channel(1);
        tokio::spawn(self.clone().tell_changes(graph_id, changes, queue));
        Ok(Response::new(Box::pin(ReceiverStream::new(stream))))
    }

    async fn list_graphs(
        &self,
        _request: Request<wire::ListGraphsRequest>,
    ) -> Result<Response<wire::ListGraphsResponse>, Status> {
        let ready: Vec<Arc<Hosted>> = self.shared.ready.lock().expect(POISON).iter().rev().cloned().collect();
        let graphs = ready.iter().map(|hosted| {
            let (map, level) = match &hosted.origin.source {
                MapSource::Spec(spec) => (Some(convert::map_spec_to_wire(spec)), String::new()),
                MapSource::Level(level) => (None, level.name.clone()),
            };
            wire::ReadyGraph {
                graph_id: hosted.origin.id.to_string(),
                map,
                level,
                settings: Some(settings_to_wire(&hosted.origin.settings)),
                summary: Some(hosted.summary()),
            }
        });
        Ok(Response::new(wire::ListGraphsResponse { graphs: graphs.collect() }))
    }

    async fn probe_edge(
        &self,
        request: Request<wire::ProbeEdgeRequest>,
    ) -> Result<Response<wire::ProbeEdgeResponse>, Status> {
        let wire::ProbeEdgeRequest { graph_id, from, to, seed } = request.into_inner();
        let hosted = self.ready(&graph_id)?;
        let ends = hosted.with_graph(|graph| {
            let position = |vertex: u32| ((vertex as usize) < graph.vertex_count()).then(|| graph.position(vertex));
            [(from, "from"), (to, "to")].map(|(vertex, field)| {
                position(vertex).ok_or_else(|| {
                    let message = format!("{field} is {vertex}, the graph has {} vertices", graph.vertex_count());
                    status::not_found("vertex", vertex.to_string(), message)
                })
            })
        });
        let [start, goal] = ends;
        let trial = Trial { start: start?, goal: goal?, stream: 0, keep_track: false };
        let Ok(turn) = self.shared.probing.clone().acquire_owned().await else { return Err(going_away()) };
        let api = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            // Whoever asked may be gone: the turn is over when the probe is.
            let _turn = turn;
            let context = api.context_of(&hosted)?;
            Ok::<_, Status>(probe::replay(&context, &trial, seed))
        });
        let (outcome, track) = task.await.map_err(|error| Status::internal(format!("the probe failed: {error}")))??;
        Ok(Response::new(wire::ProbeEdgeResponse {
            reached: outcome.reached,
            decisions: outcome.decisions,
            ability: wire_form::ability_to_wire(outcome.ability),
            track: convert::pack(track.iter().flat_map(|place| place.to_array())),
        }))
    }

    async fn compare_graphs(
        &self,
        request: Request<wire::CompareGraphsRequest>,
    ) -> Result<Response<wire::CompareGraphsResponse>, Status> {
        let request = request.into_inner();
        let (before, after) = (self.ready(&request.before)?, self.ready(&request.after)?);
        let task = tokio::task::spawn_blocking(move || {
            before.with_graph(|before| after.with_graph(|after| reachability::compare(before, after)))
        });
        let found = task.await.map_err(|error| Status::internal(format!("the comparison failed: {error}")))?;
        let places = |places: Vec<Vec3>| places.into_iter().map(convert::to_wire).collect();
        Ok(Response::new(wire::CompareGraphsResponse {
            lost: places(found.lost),
            gained: places(found.gained),
            connected_before: found.connected_before as f32,
            connected_after: found.connected_after as f32,
            islands_before: found.islands.0 as u32,
            islands_after: found.islands.1 as u32,
        }))
    }

    async fn find_path(
        &self,
        request: Request<wire::FindPathRequest>,
    ) -> Result<Response<wire::FindPathResponse>, Status> {
        let request = request.into_inner();
        let ready = self.ready(&request.graph_id)?;
        let query = request.query.ok_or(FieldError::Missing("query"))?;
        let plan = self.plan(&ready, &query)?;
        Ok(Response::new(wire::FindPathResponse { plan: Some(plan) }))
    }

    async fn find_paths(
        &self,
        request: Request<wire::FindPathsRequest>,
    ) -> Result<Response<wire::FindPathsResponse>, Status> {
        let request = request.into_inner();
        let ready = self.ready(&request.graph_id)?;
        let limit = self.shared.config.max_queries;
        if request.queries.len() > limit {
            let count = request.queries.len();
            let message = format!("{count} queries, at most {limit} are allowed in one batch (--max-queries)");
            return Err(status::too_much("queries", message));
        }
        let api = self.clone();
        // If an edit comes in between, the plans are at least as new.
        let revision = ready.revision();
        let plans = tokio::task::spawn_blocking(move || {
            request.queries.iter().map(|query| api.plan(&ready, query)).collect::<Result<Vec<_>, Status>>()
        });
        let plans = plans.await.map_err(|error| Status::internal(format!("the search failed: {error}")))??;
        Ok(Response::new(wire::FindPathsResponse { plans, revision }))
    }

    async fn report_traversals(
        &self,
        request: Request<wire::ReportTraversalsRequest>,
    ) -> Result<Response<wire::ReportTraversalsResponse>, Status> {
        let request = request.into_inner();
        let hosted = self.ready(&request.graph_id)?;
        if request.traversals.len() > MAX_PASSAGES {
            let count = request.traversals.len();
            let message = format!("{count} traversals, at most {MAX_PASSAGES} are allowed in one report");
            return Err(status::too_much("traversals", message));
        }
        let passages = request.traversals.iter().map(passage_from_wire).collect::<Result<Vec<_>, _>>()?;
        let accepted = hosted.report(&passages);
        if accepted > 0 {
            self.refresh_later(hosted);
        }
        Ok(Response::new(wire::ReportTraversalsResponse { accepted }))
    }

    async fn get_layers(
        &self,
        request: Request<wire::GetLayersRequest>,
    ) -> Result<Response<wire::GetLayersResponse>, Status> {
        let (layers, unfit) = self.ready(&request.into_inner().graph_id)?.layers();
        let revision = revision_of(&layers);
        let layers = layers.iter().map(layer_to_wire).collect();
        Ok(Response::new(wire::GetLayersResponse { layers, unfit: unfit_to_wire(&unfit), revision }))
    }

    async fn put_layer(
        &self,
        request: Request<wire::PutLayerRequest>,
    ) -> Result<Response<wire::PutLayerResponse>, Status> {
        let request = request.into_inner();
        let layer = layer_from_wire(request.layer.as_ref())?;
        let LaidOver { summary, unfit, revision } =
            self.change_layers(&request.graph_id, request.if_revision, |_| Ok(layer)).await?;
        Ok(Response::new(wire::PutLayerResponse { summary: Some(summary), unfit, revision }))
    }

    async fn append_edits(
        &self,
        request: Request<wire::AppendEditsRequest>,
    ) -> Result<Response<wire::AppendEditsResponse>, Status> {
        let wire::AppendEditsRequest { graph_id, layer: name, edits, if_revision } = request.into_inner();
        let edits = edits_from_wire(&edits)?;
        let append = move |layers: &mut Vec<Layer>| {
            let old = layers.iter().find(|layer| layer.name == name);
            let mut layer = old.cloned().unwrap_or(Layer { name, edits: Vec::new() });
            layer.edits.extend(edits);
            Ok(layer)
        };
        let LaidOver { summary, unfit, revision } = self.change_layers(&graph_id, if_revision, append).await?;
        Ok(Response::new(wire::AppendEditsResponse { summary: Some(summary), unfit, revision }))
    }

    async fn undo_edits(
        &self,
        request: Request<wire::UndoEditsRequest>,
    ) -> Result<Response<wire::UndoEditsResponse>, Status> {
        let wire::UndoEditsRequest { graph_id, layer: name, count, if_revision } = request.into_inner();
        if count == 0 {
            return Err(status::invalid("count", "count is 0, at least 1 edit can be taken back"));
        }
        let undo = move |layers: &mut Vec<Layer>| {
            let layer = layers.iter().find(|layer| layer.name == name);
            let missing = || status::not_found("layer", &name, format!("there is no layer `{name}`"));
            let mut layer = layer.cloned().ok_or_else(missing)?;
            layer.edits.truncate(layer.edits.len().saturating_sub(count as usize));
            Ok(layer)
        };
        let LaidOver { summary, unfit, revision } = self.change_layers(&graph_id, if_revision, undo).await?;
        Ok(Response::new(wire::UndoEditsResponse { summary: Some(summary), unfit, revision }))
    }
}

/// What a graph is like after its layers were changed.
struct LaidOver {
    summary: wire::GraphSummary,
    unfit: Vec<wire::UnfitEdit>,
    revision: u64,
}

/// A layer that is refused.
struct LayerProblem(LayerError);

impl From<LayerProblem> for Status {
    fn from(LayerProblem(error): LayerProblem) -> Self {
        status::invalid("layer", format!("layer: {error}"))
    }
}

/// What the store holds, or nothing where it cannot be read.
fn or_nothing<T: Default>(read: Result<T, StoreError>) -> T {
    read.unwrap_or_else(|error| {
        warn!(%error, "the graph cache cannot be read");
        T::default()
    })
}
