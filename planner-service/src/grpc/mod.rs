//! Implementation of `PlannerService`: decodes requests, calls the planner, encodes responses.
//!
//! `streams` sends the progress of builds and the changes of graphs; `errors` converts the planner's errors to
//! statuses.

mod errors;
mod streams;

use crate::error::PlannerError;
use crate::hosted::Hosted;
use crate::jobs::Job;
use crate::layers::LayerChange;
use crate::planner::Planner;
use crate::revision::Revision;
use crate::wire::{
    build_to_wire, difference_to_wire, edits_from_wire, graph_to_wire, layer_from_wire, layer_to_wire,
    ready_graph_to_wire, report_to_wire, revision_from_wire, revision_to_wire, tactics, traffic_of, unapplied_to_wire,
    wanted,
};
use prost::Message;
use streams::{BuildProgress, GraphChanges};
use surefoot_net::idempotency::{AnswerCache, Repeatable, check_id};
use surefoot_net::paging::{PageSize, page};
use surefoot_net::reader::{self, DEFAULT_PATIENCE, ReaderStream, Source};
use surefoot_net::serving::Caller;
use surefoot_net::status::{self, Answer};
use surefoot_planner::live::Reporter;
use surefoot_planner::store::Call;
use surefoot_planner::{Query, VertexId, Zone, Zones};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::{CallFrame, Coordinates};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_server::PlannerService;
use surefoot_proto::plans::{plan_to_wire, query, traversal};
use surefoot_proto::zones;
use surefoot_world::Seed;
use tokio::task::spawn_blocking;
use tonic::{Request, Response, Status};

/// Maximum number of traversals in one report.
const MAX_TRAVERSALS: usize = 4096;

#[derive(Clone)]
pub struct PlannerApi {
    planner: Planner,
    reported: AnswerCache<u32>,
}

impl PlannerApi {
    pub fn new(planner: Planner) -> Self {
        Self { reported: AnswerCache::new(planner.config().maps.memory().clone()), planner }
    }

    /// Streams messages to a reader until the service stops.
    fn stream<S: Source>(&self, source: S) -> ReaderStream<S::Message> {
        reader::stream(source, DEFAULT_PATIENCE, Some(self.planner.shutdown()))
    }

    /// The frame of a call about a graph with the field `coordinates`.
    fn frame_on(&self, hosted: &Hosted, coordinates: i32) -> Result<CallFrame, FieldError> {
        CallFrame::of(coordinates, || Ok(self.planner.frame_of(hosted)))
    }

    /// The same for a call that has not found its graph yet.
    async fn frame(&self, graph_id: &str, coordinates: i32) -> Result<CallFrame, Status> {
        if Coordinates::read(coordinates)? == Coordinates::Map {
            return Ok(CallFrame::default());
        }
        let hosted = self.planner.get_or_load(graph_id).await?;
        Ok(self.frame_on(&hosted, coordinates)?)
    }

    /// Converts a query, and checks that it lies in or near the map of the graph.
    fn query(hosted: &Hosted, query_on_wire: &wire::PathQuery) -> Result<Query, Status> {
        let query = query(query_on_wire)?;
        hosted.check_inside(query.start, "query.start")?;
        hosted.check_inside(query.goal, "query.goal")?;
        Ok(query)
    }

    /// Changes a layer. The responses of PutLayer, AppendEdits and UndoEdits have the same fields.
    async fn change_layers<R: Message + Default>(
        &self,
        graph_id: &str,
        if_revision: u64,
        change: LayerChange,
        call: Option<Call>,
    ) -> Answer<R> {
        let hosted = self.planner.get_or_load(graph_id).await?;
        let answer = self.planner.layers.change(hosted, revision_from_wire(if_revision), change, call).await?;
        Ok(Response::new(R::decode(&*answer).map_err(|_| PlannerError::BadReceipt)?))
    }
}

/// Adds the zones of a request to those of a query.
fn with_zones(mut query: Query, shared: &Zones) -> Result<Query, Status> {
    if query.zones.is_empty() {
        query.zones = shared.clone();
    } else if !shared.is_empty() {
        let all: Vec<Zone> = shared.iter().chain(query.zones.iter()).cloned().collect();
        zones::check_count(all.len(), "queries.zones")?;
        query.zones = Zones::new(all);
    }
    Ok(query)
}

/// What identifies a call with a request id: a repeat gets the first answer.
fn call_of(caller: &Caller, request_id: &str, request: &impl Message) -> Result<Option<Call>, Status> {
    if request_id.is_empty() {
        return Ok(None);
    }
    check_id(request_id)?;
    let request = *blake3::hash(&request.encode_to_vec()).as_bytes();
    Ok(Some(Call { client: caller.name.to_string(), id: request_id.to_owned(), request }))
}

/// Converts a build to the wire in its current phase.
fn build_now(job: &Job) -> wire::Build {
    let phase = job.phases().pop().expect("a build has at least one phase");
    build_to_wire(job, phase)
}

#[tonic::async_trait]
impl PlannerService for PlannerApi {
    async fn start_build(&self, request: Request<wire::StartBuildRequest>) -> Answer<wire::StartBuildResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        self.planner.check_policy(&request.policy_hash)?;
        let wanted = wanted(&request, self.planner.levels(), self.planner.config()).await?;
        let job = self.planner.peers.start(wanted, &caller.name)?;
        let build = build_now(&job);
        job.known().await;
        Ok(Response::new(wire::StartBuildResponse { build: Some(build) }))
    }

    type WatchBuildStream = ReaderStream<wire::WatchBuildResponse>;

    async fn watch_build(&self, request: Request<wire::WatchBuildRequest>) -> Answer<Self::WatchBuildStream> {
        let job = self.planner.peers.find(&request.into_inner().build_id).await?;
        Ok(Response::new(self.stream(BuildProgress::new(job))))
    }

    async fn list_builds(&self, request: Request<wire::ListBuildsRequest>) -> Answer<wire::ListBuildsResponse> {
        let wire::ListBuildsRequest { page_size, page_token } = request.into_inner();
        let all = self.planner.peers.all().await;
        let page = page(all, |job| job.id.to_string(), PageSize::USUAL, page_size, &page_token)?;
        let builds = page.items.iter().map(|job| build_now(job)).collect();
        Ok(Response::new(wire::ListBuildsResponse { builds, next_page_token: page.next_token }))
    }

    async fn cancel_build(&self, request: Request<wire::CancelBuildRequest>) -> Answer<wire::CancelBuildResponse> {
        let caller = Caller::of(&request);
        let job = self.planner.peers.find(&request.into_inner().build_id).await?;
        self.planner.peers.cancel(&job, &caller).await?;
        Ok(Response::new(wire::CancelBuildResponse { build: Some(build_now(&job)) }))
    }

    async fn get_graph(&self, request: Request<wire::GetGraphRequest>) -> Answer<wire::GetGraphResponse> {
        let wire::GetGraphRequest { graph_id, coordinates } = request.into_inner();
        let hosted = self.planner.get_usable(&graph_id).await?;
        let frame = self.frame_on(&hosted, coordinates)?;
        let encoded = spawn_blocking(move || frame.to_level(graph_to_wire(&hosted))).await;
        Ok(Response::new(encoded.map_err(PlannerError::lost("the encoding"))?))
    }

    type WatchGraphStream = ReaderStream<wire::WatchGraphResponse>;

    async fn watch_graph(&self, request: Request<wire::WatchGraphRequest>) -> Answer<Self::WatchGraphStream> {
        let hosted = self.planner.get_or_load(&request.into_inner().graph_id).await?;
        Ok(Response::new(self.stream(GraphChanges::new(self.planner.clone(), &hosted))))
    }

    async fn list_graphs(&self, request: Request<wire::ListGraphsRequest>) -> Answer<wire::ListGraphsResponse> {
        let wire::ListGraphsRequest { page_size, page_token } = request.into_inner();
        let all = self.planner.graphs.all();
        let page = page(all, |hosted| hosted.origin.id.to_string(), PageSize::USUAL, page_size, &page_token)?;
        let graphs = page.items.iter().map(|hosted| ready_graph_to_wire(hosted)).collect();
        Ok(Response::new(wire::ListGraphsResponse { graphs, next_page_token: page.next_token }))
    }

    async fn probe_edge(&self, request: Request<wire::ProbeEdgeRequest>) -> Answer<wire::ProbeEdgeResponse> {
        let wire::ProbeEdgeRequest { graph_id, from, to, seed, coordinates } = request.into_inner();
        let hosted = self.planner.get_usable(&graph_id).await?;
        let frame = self.frame_on(&hosted, coordinates)?;
        let (outcome, track) = self.planner.probe(hosted, VertexId(from), VertexId(to), Seed(seed)).await?;
        Ok(Response::new(frame.to_level(wire::ProbeEdgeResponse {
            reached: outcome.reached,
            decisions: outcome.decisions,
            ability: convert::ability_to_wire(outcome.ability).into(),
            track: convert::pack(track.iter().flat_map(|place| place.to_array())),
        })))
    }

    async fn compare_graphs(
        &self,
        request: Request<wire::CompareGraphsRequest>,
    ) -> Answer<wire::CompareGraphsResponse> {
        let request = request.into_inner();
        let (before, after) =
            (self.planner.get_usable(&request.before).await?, self.planner.get_usable(&request.after).await?);
        let frame_before = self.frame_on(&before, request.coordinates)?;
        let frame_after = self.frame_on(&after, request.coordinates)?;
        let mut difference = difference_to_wire(self.planner.compare(before, after).await?);
        difference.lost = frame_before.to_level(difference.lost);
        difference.gained = frame_after.to_level(difference.gained);
        Ok(Response::new(difference))
    }

    async fn find_path(&self, request: Request<wire::FindPathRequest>) -> Answer<wire::FindPathResponse> {
        let request = request.into_inner();
        let hosted = self.planner.get_usable(&request.graph_id).await?;
        let frame = self.frame_on(&hosted, request.coordinates)?;
        let query = Self::query(&hosted, &frame.to_map(request.query.ok_or(FieldError::Missing("query"))?))?;
        let (planner, interim) = (self.planner.clone(), hosted.is_interim());
        let plan = spawn_blocking(move || plan_to_wire(&planner.plan(&hosted, &query))).await;
        let plan = Some(plan.map_err(PlannerError::lost("the search"))?);
        Ok(Response::new(frame.to_level(wire::FindPathResponse { plan, interim })))
    }

    async fn find_paths(&self, request: Request<wire::FindPathsRequest>) -> Answer<wire::FindPathsResponse> {
        let request = request.into_inner();
        let hosted = self.planner.get_usable(&request.graph_id).await?;
        let (count, limit) = (request.queries.len(), self.planner.config().max_queries);
        if count > limit {
            let message =
                format!("{count} queries are too many: at most {limit} are allowed in one batch (--max-queries)");
            return Err(status::too_large("queries", message));
        }
        let frame = self.frame_on(&hosted, request.coordinates)?;
        let request = frame.to_map(request);
        let shared = Zones::new(zones::list(&request.zones, "zones")?);
        let query = |query| with_zones(Self::query(&hosted, query)?, &shared);
        let queries = request.queries.iter().map(query).collect::<Result<Vec<_>, Status>>()?;
        let traffic = request.traffic.as_ref().map(traffic_of).transpose()?;
        let planner = self.planner.clone();
        // Read before planning: if an edit comes in between, the plans are newer than the revision, never older.
        let (revision, interim) = (revision_to_wire(hosted.revision()), hosted.is_interim());
        let plans = spawn_blocking(move || {
            let plans = match traffic {
                Some(mut traffic) => planner.plans_in(&hosted, &mut traffic, &queries),
                None => queries.iter().map(|query| planner.plan(&hosted, query)).collect(),
            };
            plans.iter().map(plan_to_wire).collect()
        });
        let plans = plans.await.map_err(PlannerError::lost("the search"))?;
        Ok(Response::new(frame.to_level(wire::FindPathsResponse { plans, revision, interim })))
    }

    async fn rank_places(&self, request: Request<wire::RankPlacesRequest>) -> Answer<wire::RankPlacesResponse> {
        let request = request.into_inner();
        let hosted = self.planner.get_usable(&request.graph_id).await?;
        let frame = self.frame_on(&hosted, request.coordinates)?;
        let question = tactics::rank_question(&frame.to_map(request), self.planner.config())?;
        question.check_inside(&hosted)?;
        let planner = self.planner.clone();
        // As for FindPaths.
        let (revision, interim) = (revision_to_wire(hosted.revision()), hosted.is_interim());
        let task = spawn_blocking(move || tactics::ranking_to_wire(&planner.rank_places(&hosted, &question)));
        let ranking = task.await.map_err(PlannerError::lost("the search"))?;
        Ok(Response::new(frame.to_level(wire::RankPlacesResponse { revision, interim, ..ranking })))
    }

    async fn find_reachable(
        &self,
        request: Request<wire::FindReachableRequest>,
    ) -> Answer<wire::FindReachableResponse> {
        let request = request.into_inner();
        let hosted = self.planner.get_usable(&request.graph_id).await?;
        let frame = self.frame_on(&hosted, request.coordinates)?;
        let question = tactics::reach_question(&frame.to_map(request))?;
        hosted.check_inside(question.query.start, "query.start")?;
        let (revision, interim) = (revision_to_wire(hosted.revision()), hosted.is_interim());
        let planner = self.planner.clone();
        let task =
            spawn_blocking(move || planner.reachable(&hosted, &question).map(|reach| tactics::reach_to_wire(&reach)));
        let reach = task.await.map_err(PlannerError::lost("the search"))??;
        Ok(Response::new(frame.to_level(wire::FindReachableResponse { revision, interim, ..reach })))
    }

    async fn report_traversals(
        &self,
        request: Request<wire::ReportTraversalsRequest>,
    ) -> Answer<wire::ReportTraversalsResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let call = call_of(&caller, &request.request_id, &request)?;
        let hosted = self.planner.get_usable(&request.graph_id).await?;
        let count = request.traversals.len();
        if count > MAX_TRAVERSALS {
            let message =
                format!("{count} traversals are too many: at most {MAX_TRAVERSALS} are allowed in one report");
            return Err(status::too_large("traversals", message));
        }
        let traversals = request.traversals.iter().map(traversal).collect::<Result<Vec<_>, _>>()?;
        let reporter = Reporter { name: caller.name.to_string(), is_trusted: caller.is_trusted_reporter() };
        let reports = self.planner.reports.clone();
        let report = async move { Ok(reports.add(hosted, &reporter, &traversals, call).await?) };
        // Repeats here get the answer from memory, so that they do not count even for a moment.
        let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes: 0 };
        let accepted = self.reported.once(call, &request, report).await?;
        Ok(Response::new(wire::ReportTraversalsResponse { accepted }))
    }

    async fn list_reports(&self, request: Request<wire::ListReportsRequest>) -> Answer<wire::ListReportsResponse> {
        let reports = self.planner.get_or_load(&request.into_inner().graph_id).await?.reports();
        Ok(Response::new(wire::ListReportsResponse { reports: reports.into_iter().map(report_to_wire).collect() }))
    }

    async fn drop_reports(&self, request: Request<wire::DropReportsRequest>) -> Answer<wire::DropReportsResponse> {
        let wire::DropReportsRequest { graph_id, reporter } = request.into_inner();
        let hosted = self.planner.get_or_load(&graph_id).await?;
        let dropped = self.planner.reports.drop_of(hosted, reporter).await?;
        Ok(Response::new(wire::DropReportsResponse { dropped }))
    }

    async fn get_layers(&self, request: Request<wire::GetLayersRequest>) -> Answer<wire::GetLayersResponse> {
        let wire::GetLayersRequest { graph_id, coordinates } = request.into_inner();
        let hosted = self.planner.get_usable(&graph_id).await?;
        let frame = self.frame_on(&hosted, coordinates)?;
        let (layers, unapplied) = hosted.layers();
        let revision = revision_to_wire(Revision::of(&layers));
        let layers = layers.iter().map(layer_to_wire).collect();
        let unapplied = unapplied_to_wire(&unapplied, &hosted.frame());
        Ok(Response::new(frame.to_level(wire::GetLayersResponse { layers, unapplied, revision })))
    }

    async fn put_layer(&self, request: Request<wire::PutLayerRequest>) -> Answer<wire::PutLayerResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let call = call_of(&caller, &request.request_id, &request)?;
        let frame = self.frame(&request.graph_id, request.coordinates).await?;
        let change = LayerChange::Put(layer_from_wire(frame.to_map(request.layer).as_ref())?);
        self.change_layers(&request.graph_id, request.if_revision, change, call).await
    }

    async fn append_edits(&self, request: Request<wire::AppendEditsRequest>) -> Answer<wire::AppendEditsResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        let call = call_of(&caller, &request.request_id, &request)?;
        let frame = self.frame(&request.graph_id, request.coordinates).await?;
        let change = LayerChange::Append(request.layer, edits_from_wire(&frame.to_map(request.edits))?);
        self.change_layers(&request.graph_id, request.if_revision, change, call).await
    }

    async fn undo_edits(&self, request: Request<wire::UndoEditsRequest>) -> Answer<wire::UndoEditsResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        if request.count == 0 {
            return Err(status::invalid("count", "count is 0; it must be at least 1"));
        }
        let call = call_of(&caller, &request.request_id, &request)?;
        let change = LayerChange::Undo(request.layer, request.count as usize);
        self.change_layers(&request.graph_id, request.if_revision, change, call).await
    }
}
