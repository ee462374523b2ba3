//! The gRPC face of the planner: decode, call, encode.
//!
//! Builds run one at a time on a thread of their own, and requests for the same graph share one build. Graphs
//! in use are kept in memory, all of them on disk.

use crate::build::{BuildError, BuildSettings, Built, GraphId, BuildStats, MAX_VERTICES, Progress, build};
use crate::placement::Placement;
use crate::cache::GraphStore;
use crate::graph::Ability;
use crate::probe::ProbeContext;
use crate::prove::Probing;
use crate::search::{self, DEFAULT_TABLE_LIMIT, NoPath, Plan, Query, Router};
use std::collections::{BTreeMap, VecDeque};
use std::pin::Pin;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use surefoot_policy::Policy;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_server::{PlannerService, PlannerServiceServer, SERVICE_NAME};
use surefoot_proto::serving::{Endpoint, MAX_MESSAGE_BYTES, ServeError, Shutdown, going_away, with_grpc_web};
use surefoot_world::{CharacterProfile, Map, MapSpec};
use tokio::sync::{Semaphore, mpsc, watch};
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};
use tracing::{info, warn};

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
}

impl Default for PlannerConfig {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { max_vertices: 2000, max_queries: 4096, max_builds: 16, graphs_in_memory: 32, threads }
    }
}

/// How often a build's progress is sent.
const PROGRESS_PERIOD: Duration = Duration::from_millis(250);
/// Failed legs that a query may carry.
const MAX_AVOID: usize = 64;
const POISON: &str = "no holder of this lock panics";

/// A graph that is ready to be asked.
#[derive(Debug)]
struct Ready {
    id: GraphId,
    map_hash: String,
    router: Router,
    stats: BuildStats,
    connected: f64,
    cached: bool,
}

/// A build that is going on, or its end.
type JobState = Option<Result<Arc<Ready>, Status>>;

/// A build that several requests may share.
#[derive(Debug, Clone)]
struct Job {
    progress: Arc<Progress>,
    state: watch::Receiver<JobState>,
}

/// The service; clones share everything.
#[derive(Clone)]
pub struct PlannerApi {
    shared: Arc<Shared>,
}

struct Shared {
    config: PlannerConfig,
    policy: Policy,
    store: Box<dyn GraphStore>,
    /// Most recently used last.
    ready: Mutex<VecDeque<Arc<Ready>>>,
    /// By spec and settings, since the map's hash is not known before it is generated.
    jobs: Mutex<BTreeMap<String, Job>>,
    /// One build at a time: each uses all cores.
    turn: Semaphore,
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
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    routes.add_service(with_grpc_web(grpc));
    let result = endpoint.serve(routes, &[SERVICE_NAME], metrics, shutdown).await;
    api.cancel_builds();
    result
}

impl From<BuildError> for Status {
    fn from(error: BuildError) -> Self {
        let message = error.to_string();
        match error {
            BuildError::Setting { .. } => Status::invalid_argument(message),
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
            ready: Mutex::default(),
            jobs: Mutex::default(),
            turn: Semaphore::new(1),
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

    fn ready(&self, graph_id: &str) -> Result<Arc<Ready>, Status> {
        let id = GraphId::parse(graph_id)
            .ok_or_else(|| Status::invalid_argument("graph_id is not 64 hexadecimal digits"))?;
        if let Some(ready) = self.recall(&id) {
            return Ok(ready);
        }
        Err(Status::not_found(format!(
            "graph {graph_id} is not loaded: call BuildGraph first (a cached graph loads at once)"
        )))
    }

    fn recall(&self, id: &GraphId) -> Option<Arc<Ready>> {
        let mut ready = self.shared.ready.lock().expect(POISON);
        let at = ready.iter().position(|entry| entry.id == *id)?;
        let entry = ready.remove(at)?;
        ready.push_back(entry.clone());
        Some(entry)
    }

    fn remember(&self, entry: Arc<Ready>) {
        let mut ready = self.shared.ready.lock().expect(POISON);
        ready.retain(|other| other.id != entry.id);
        ready.push_back(entry);
        while ready.len() > self.shared.config.graphs_in_memory {
            ready.pop_front();
        }
    }

    /// Joins the build of this graph, starting it if nobody has.
    fn join(&self, spec: MapSpec, settings: BuildSettings) -> Result<Job, Status> {
        let key = format!("{spec:?} {settings:?}");
        let mut jobs = self.shared.jobs.lock().expect(POISON);
        if let Some(job) = jobs.get(&key) {
            return Ok(job.clone());
        }
        let limit = self.shared.config.max_builds;
        if jobs.len() >= limit {
            return Err(Status::resource_exhausted(format!(
                "{limit} builds run or wait already, the most allowed (--max-builds)"
            )));
        }
        let (sender, state) = watch::channel(None);
        let job = Job { progress: Arc::default(), state };
        jobs.insert(key.clone(), job.clone());
        let (api, progress) = (self.clone(), job.progress.clone());
        tokio::spawn(async move {
            let result = api.run_build(spec, settings, progress).await;
            api.shared.jobs.lock().expect(POISON).remove(&key);
            sender.send_replace(Some(result));
        });
        Ok(job)
    }

    async fn run_build(
        &self,
        spec: MapSpec,
        settings: BuildSettings,
        progress: Arc<Progress>,
    ) -> Result<Arc<Ready>, Status> {
        let _turn = self.shared.turn.acquire().await.map_err(|_| going_away())?;
        let api = self.clone();
        let task = tokio::task::spawn_blocking(move || api.build_or_load(&spec, &settings, &progress));
        let ready = task.await.map_err(|error| Status::internal(format!("the build failed: {error}")))??;
        self.remember(ready.clone());
        Ok(ready)
    }

    fn build_or_load(
        &self,
        spec: &MapSpec,
        settings: &BuildSettings,
        progress: &Progress,
    ) -> Result<Arc<Ready>, Status> {
        let map = Arc::new(Map::generate(spec).map_err(FieldError::from)?);
        let map_hash = map.hash().to_hex();
        let context = ProbeContext { map, profile: CharacterProfile::default(), policy: self.shared.policy.clone() };
        let id = GraphId::of(&context, settings);
        if let Some(ready) = self.recall(&id) {
            return Ok(ready);
        }
        let stored = self.shared.store.get(&id).unwrap_or_else(|error| {
            warn!(%error, "the graph cache cannot be read: building instead");
            None
        });
        let cached = stored.is_some();
        let built = match stored {
            Some(built) => built,
            None => {
                let started = Instant::now();
                let built = build(&context, settings, self.shared.config.threads, progress)?;
                info!(%id, probes = built.stats.probes, edges = built.graph.edge_count(), seconds = started.elapsed().as_secs_f32(), "graph built");
                if let Err(error) = self.shared.store.put(&id, &built) {
                    warn!(%error, "the graph is not cached");
                }
                built
            }
        };
        let connected = built.graph.connected_share();
        let Built { graph, stats } = built;
        let router = Router::new(graph, DEFAULT_TABLE_LIMIT, self.shared.config.threads);
        Ok(Arc::new(Ready { id, map_hash, router, stats, connected, cached }))
    }

    fn plan(&self, router: &Router, query: &wire::PathQuery) -> Result<wire::Plan, Status> {
        if query.avoid.len() > MAX_AVOID {
            return Err(Status::invalid_argument(format!(
                "query.avoid has {} legs, allowed are {MAX_AVOID}",
                query.avoid.len()
            )));
        }
        let query = Query {
            start: convert::point(query.start.as_ref(), "query.start")?,
            goal: convert::point(query.goal.as_ref(), "query.goal")?,
            avoid: query.avoid.iter().map(|leg| (leg.from, leg.to)).collect(),
        };
        self.shared.plans.fetch_add(1, Ordering::Relaxed);
        Ok(plan_to_wire(&router.find_path(&query)))
    }
}

fn settings_from_wire(settings: Option<&wire::BuildSettings>, config: &PlannerConfig) -> Result<BuildSettings, Status> {
    let defaults = BuildSettings::default();
    let Some(settings) = settings else { return Ok(defaults) };
    let or = |value: u32, default: usize| if value == 0 { default } else { value as usize };
    let unknown = |field: &str, value: i32| Status::invalid_argument(format!("settings.{field} {value} is unknown"));
    let placement = match wire::Placement::try_from(settings.placement) {
        Ok(wire::Placement::Unspecified | wire::Placement::Spaced) => Placement::Spaced,
        Ok(wire::Placement::Random) => Placement::Random,
        Ok(wire::Placement::Density) => Placement::Density,
        Ok(wire::Placement::Trajectories) => Placement::Trajectories,
        Ok(wire::Placement::TrajectoriesTested) => Placement::TrajectoriesTested,
        Ok(wire::Placement::Flood) => Placement::Flood,
        Ok(wire::Placement::FloodGrandchildren) => Placement::FloodGrandchildren,
        Err(_) => return Err(unknown("placement", settings.placement)),
    };
    let probing = match wire::Probing::try_from(settings.probing) {
        Ok(wire::Probing::Unspecified | wire::Probing::Frugal) => Probing::Frugal,
        Ok(wire::Probing::Exhaustive) => Probing::Exhaustive,
        Err(_) => return Err(unknown("probing", settings.probing)),
    };
    let checked = BuildSettings {
        placement,
        vertices: or(settings.vertices, defaults.vertices),
        neighbours: or(settings.neighbours, defaults.neighbours),
        repeats: or(settings.repeats, defaults.repeats as usize) as u32,
        threshold: if settings.threshold == 0.0 { defaults.threshold } else { f64::from(settings.threshold) },
        seed: settings.seed,
        probing,
        special_moves: !settings.without_special_moves,
    };
    let limit = config.max_vertices.min(MAX_VERTICES);
    if checked.vertices > limit {
        return Err(Status::resource_exhausted(format!(
            "settings.vertices is {}, at most {limit} are allowed (--max-vertices)",
            checked.vertices
        )));
    }
    checked.validate()?;
    Ok(checked)
}

/// Settings on the wire.
pub fn settings_to_wire(settings: &BuildSettings) -> wire::BuildSettings {
    let placement = match settings.placement {
        Placement::Random => wire::Placement::Random,
        Placement::Spaced => wire::Placement::Spaced,
        Placement::Density => wire::Placement::Density,
        Placement::Trajectories => wire::Placement::Trajectories,
        Placement::TrajectoriesTested => wire::Placement::TrajectoriesTested,
        Placement::Flood => wire::Placement::Flood,
        Placement::FloodGrandchildren => wire::Placement::FloodGrandchildren,
    };
    let probing = match settings.probing {
        Probing::Exhaustive => wire::Probing::Exhaustive,
        Probing::Frugal => wire::Probing::Frugal,
    };
    wire::BuildSettings {
        placement: placement.into(),
        vertices: settings.vertices as u32,
        neighbours: settings.neighbours as u32,
        repeats: settings.repeats,
        threshold: settings.threshold as f32,
        seed: settings.seed,
        probing: probing.into(),
        without_special_moves: !settings.special_moves,
    }
}

fn ability_to_wire(ability: Ability) -> i32 {
    match ability {
        Ability::Walk => wire::Ability::Walk,
        Ability::Jump => wire::Ability::Jump,
        Ability::DoubleJump => wire::Ability::DoubleJump,
        Ability::Pad => wire::Ability::Pad,
        Ability::ZipLine => wire::Ability::ZipLine,
        Ability::Teleporter => wire::Ability::Teleporter,
        Ability::Jetpack => wire::Ability::Jetpack,
    }
    .into()
}

fn ability_from_wire(ability: i32) -> Ability {
    match wire::Ability::try_from(ability) {
        Ok(wire::Ability::Jump) => Ability::Jump,
        Ok(wire::Ability::DoubleJump) => Ability::DoubleJump,
        Ok(wire::Ability::Pad) => Ability::Pad,
        Ok(wire::Ability::ZipLine) => Ability::ZipLine,
        Ok(wire::Ability::Teleporter) => Ability::Teleporter,
        Ok(wire::Ability::Jetpack) => Ability::Jetpack,
        Ok(wire::Ability::Walk | wire::Ability::Unspecified) | Err(_) => Ability::Walk,
    }
}

/// A plan on the wire.
pub fn plan_to_wire(plan: &Plan) -> wire::Plan {
    let reason = match plan.no_path {
        None => wire::NoPath::Unspecified,
        Some(NoPath::StartOffGraph) => wire::NoPath::StartOffGraph,
        Some(NoPath::GoalOffGraph) => wire::NoPath::GoalOffGraph,
        Some(NoPath::DifferentIslands) => wire::NoPath::DifferentIslands,
        Some(NoPath::OneWay) => wire::NoPath::OneWay,
    };
    let leg = |leg: &search::Leg| wire::Leg {
        from: leg.from,
        to: leg.to,
        seconds: leg.seconds,
        chance: leg.chance,
        ability: ability_to_wire(leg.ability),
    };
    wire::Plan {
        found: plan.no_path.is_none(),
        reason: reason.into(),
        waypoints: plan.waypoints.iter().copied().map(convert::to_wire).collect(),
        legs: plan.legs.iter().map(leg).collect(),
        seconds: plan.seconds(),
        chance: plan.chance(),
    }
}

/// A plan from the wire.
///
/// # Errors
/// If it has no waypoints, not one leg for each, or a point that is not finite.
pub fn plan_from_wire(plan: &wire::Plan) -> Result<Plan, FieldError> {
    if plan.waypoints.is_empty() || plan.waypoints.len() != plan.legs.len() {
        return Err(FieldError::Length {
            field: "plan.legs",
            found: plan.legs.len(),
            expected: plan.waypoints.len().max(1),
        });
    }
    let waypoints =
        plan.waypoints.iter().map(|point| convert::point(Some(point), "plan.waypoints")).collect::<Result<_, _>>()?;
    let legs = plan.legs.iter().map(|leg| search::Leg {
        from: leg.from,
        to: leg.to,
        seconds: leg.seconds,
        chance: leg.chance,
        ability: ability_from_wire(leg.ability),
    });
    let no_path = match wire::NoPath::try_from(plan.reason) {
        Ok(wire::NoPath::StartOffGraph) => Some(NoPath::StartOffGraph),
        Ok(wire::NoPath::GoalOffGraph) => Some(NoPath::GoalOffGraph),
        Ok(wire::NoPath::OneWay) => Some(NoPath::OneWay),
        Ok(wire::NoPath::DifferentIslands) => Some(NoPath::DifferentIslands),
        Ok(wire::NoPath::Unspecified) | Err(_) => None,
    };
    Ok(Plan { waypoints, legs: legs.collect(), no_path, nearest: None })
}

impl Ready {
    fn summary(&self) -> wire::GraphSummary {
        wire::GraphSummary {
            map_hash: self.map_hash.clone(),
            vertices: self.router.graph().vertex_count() as u32,
            edges: self.router.graph().edge_count() as u32,
            islands: self.router.graph().island_count(),
            connected: self.connected as f32,
            probes: self.stats.probes,
            build_s: self.stats.seconds as f32,
            cached: self.cached,
        }
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
        let spec = convert::map_spec(request.map.as_ref())?;
        let settings = settings_from_wire(request.settings.as_ref(), &self.shared.config)?;
        let job = self.join(spec, settings)?;
        let (queue, stream) = mpsc::channel(4);
        tokio::spawn(report(job, queue, self.shared.shutdown.clone()));
        Ok(Response::new(Box::pin(ReceiverStream::new(stream))))
    }

    async fn get_graph(
        &self,
        request: Request<wire::GetGraphRequest>,
    ) -> Result<Response<wire::GetGraphResponse>, Status> {
        let ready = self.ready(&request.into_inner().graph_id)?;
        let graph = ready.router.graph();
        let edge = |edge: &crate::Edge| wire::Edge {
            from: edge.from,
            to: edge.to,
            tries: edge.evidence.tries,
            successes: edge.evidence.successes,
            decisions_mean: edge.evidence.decisions_mean() as f32,
            decisions_deviation: edge.evidence.decisions_deviation() as f32,
            ability: ability_to_wire(edge.evidence.ability),
        };
        Ok(Response::new(wire::GetGraphResponse {
            summary: Some(ready.summary()),
            vertices: (0..graph.vertex_count() as u32).map(|vertex| convert::to_wire(graph.position(vertex))).collect(),
            islands: graph.islands().to_vec(),
            edges: graph.edges().map(edge).collect(),
        }))
    }

    async fn find_path(
        &self,
        request: Request<wire::FindPathRequest>,
    ) -> Result<Response<wire::FindPathResponse>, Status> {
        let request = request.into_inner();
        let ready = self.ready(&request.graph_id)?;
        let query = request.query.ok_or(FieldError::Missing("query"))?;
        let plan = self.plan(&ready.router, &query)?;
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
            return Err(Status::resource_exhausted(format!(
                "{} queries, at most {limit} are allowed in one batch (--max-queries)",
                request.queries.len()
            )));
        }
        let api = self.clone();
        let plans = tokio::task::spawn_blocking(move || {
            request.queries.iter().map(|query| api.plan(&ready.router, query)).collect::<Result<Vec<_>, Status>>()
        });
        let plans = plans.await.map_err(|error| Status::internal(format!("the search failed: {error}")))??;
        Ok(Response::new(wire::FindPathsResponse { plans }))
    }
}

/// Streams a build's progress, then its end.
async fn report(mut job: Job, queue: mpsc::Sender<Result<wire::BuildGraphResponse, Status>>, shutdown: Shutdown) {
    let stopping = shutdown.wait();
    tokio::pin!(stopping);
    loop {
        let finished = tokio::select! {
            state = job.state.wait_for(Option::is_some) => Some(match state {
                Ok(state) => state.clone().expect("waited for it"),
                Err(_) => Err(Status::internal("the build was lost: ask again")),
            }),
            () = tokio::time::sleep(PROGRESS_PERIOD) => None,
            () = &mut stopping => Some(Err(going_away())),
            () = queue.closed() => return,
        };
        let (probes_done, probes_total) =
            (job.progress.done.load(Ordering::Relaxed), job.progress.total.load(Ordering::Relaxed));
        let (last, message) = match finished {
            None => {
                let stage = if probes_total == 0 { "vertices" } else { "probe" };
                (
                    false,
                    Ok(wire::BuildGraphResponse {
                        stage: stage.to_owned(),
                        probes_done,
                        probes_total,
                        ..Default::default()
                    }),
                )
            }
            Some(result) => {
                let done = result.map(|ready| wire::BuildGraphResponse {
                    graph_id: ready.id.to_string(),
                    stage: "done".to_owned(),
                    probes_done,
                    probes_total,
                    summary: Some(ready.summary()),
                });
                (true, done)
            }
        };
        if queue.send(message).await.is_err() || last {
            return;
        }
    }
}
