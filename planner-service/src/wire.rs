//! Conversions between the wire types of `surefoot.planner.v1` and the planner's own types. Incoming values are
//! checked here.
//!
//! This file has builds, graphs and layers; [`tactics`] has questions about many places.

pub mod tactics;

use crate::config::PlannerConfig;
use crate::error::{Failure, PlannerError};
use crate::figures::Figures;
use crate::hosted::{GraphView, Hosted};
use crate::jobs::{BuildPhase, Job};
use crate::revision::Revision;
use prost::Message;
use std::num::NonZeroU64;
use std::sync::atomic::Ordering;
use surefoot_net::levels::{BaseMap, LevelStore, MapSource, grpc};
use surefoot_net::status;
use surefoot_planner::edits::{Edit, Layer, Unapplied};
use surefoot_planner::live::{Reported, Reporter};
use surefoot_planner::reachability::Difference;
use surefoot_planner::settings::MAX_VERTICES;
use surefoot_planner::{BuildSettings, Edge, Placement, Probing, RawBuildSettings, Traffic};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::CallFrame;
use surefoot_proto::pieces::piece_to_wire;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::plans::{MAX_CROWDS, needs_to_wire, settings_to_wire};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::{self as world, MapSpec};
use surefoot_world::map::LevelFrame;
use surefoot_world::{Arrival, CharacterProfile, DECISION_SECONDS, Vec3};
use tonic::Status;

/// The inputs of a graph.
pub type Wanted = (MapSource, CharacterProfile, BuildSettings);

/// Encodes the recipe of a graph, for all planners that share a store: the request that asks for it.
pub fn recipe((source, body, settings): (&MapSource, &CharacterProfile, &BuildSettings)) -> Vec<u8> {
    let (map, map_hash) = match source.base() {
        BaseMap::Spec(spec) => (Some(convert::map_spec_to_wire(spec)), String::new()),
        BaseMap::Level(level) => (None, level.map.hash().to_hex()),
    };
    let mut encoded = settings_to_wire(settings);
    if f64::from(encoded.threshold) != settings.threshold {
        // Only the default has more digits than the contract; absent, it keeps them.
        encoded.threshold = 0.0;
    }
    let request = wire::StartBuildRequest {
        map,
        settings: Some(encoded),
        map_hash,
        policy_hash: String::new(),
        body: Some(convert::body_to_wire(body)),
        pieces: source.pieces().iter().map(piece_to_wire).collect(),
        coordinates: world::Coordinates::Unspecified.into(),
    };
    request.encode_to_vec()
}

/// Decodes what [`recipe`] encoded.
pub async fn read_recipe(bytes: &[u8], levels: &LevelStore, config: &PlannerConfig) -> Result<Wanted, PlannerError> {
    let read = async {
        let request = wire::StartBuildRequest::decode(bytes)
            .map_err(|error| status::failure(Reason::Internal, format!("the recipe of a graph is damaged: {error}")))?;
        wanted(&request, levels, config).await
    };
    read.await.map_err(|status: Status| PlannerError::RemoteBuildFailed(as_failure(&status)))
}

pub async fn wanted(
    request: &wire::StartBuildRequest,
    levels: &LevelStore,
    config: &PlannerConfig,
) -> Result<Wanted, Status> {
    // Kept in memory until the source refers to it.
    let _level = match request.map_hash.as_str() {
        "" => None,
        hash if request.map.is_none() => Some(levels.fetch(hash).await?),
        _ => None,
    };
    let made = grpc::source(levels, request.map.as_ref(), &request.map_hash)?;
    let frame = CallFrame::of(request.coordinates, || Ok::<_, FieldError>(made.frame()))?;
    let source = grpc::with_pieces(made, &frame.to_map(request.pieces.clone()))?;
    let settings = settings_from_wire(request.settings.as_ref(), config)?;
    let body = convert::body(request.body.as_ref())?;
    Ok((source, body, settings))
}

/// Converts an error for other planners.
pub fn failure_of(error: &PlannerError) -> Failure {
    as_failure(&Status::from(error.clone()))
}

fn as_failure(status: &Status) -> Failure {
    let reason = Reason::of(status).unwrap_or(Reason::Internal);
    Failure { reason: reason.name().to_owned(), message: status.message().to_owned() }
}

pub fn traffic_of(traffic: &wire::Traffic) -> Result<Traffic, Status> {
    if traffic.crowds.len() > MAX_CROWDS {
        let message = format!("{} crowds are too many: at most {MAX_CROWDS} are allowed", traffic.crowds.len());
        return Err(status::too_large("traffic.crowds", message));
    }
    let mut read = Traffic::default();
    for crowd in &traffic.crowds {
        read.add_crowd(convert::point(crowd.place.as_ref(), "traffic.crowds.place")?, crowd.npcs);
    }
    Ok(read)
}

/// Converts settings from the wire; absent values become defaults.
pub fn settings_from_wire(
    settings: Option<&wire::BuildSettings>,
    config: &PlannerConfig,
) -> Result<BuildSettings, Status> {
    let defaults = BuildSettings::default();
    let Some(settings) = settings else { return Ok(defaults) };
    let or = |value: u32, default: usize| if value == 0 { default } else { value as usize };
    let placement = convert::enum_or(settings.placement, Placement::Spaced, "settings.placement")?;
    let probing = convert::enum_or(settings.probing, Probing::Frugal, "settings.probing")?;
    let raw = RawBuildSettings {
        placement,
        vertices: or(settings.vertices, defaults.vertices),
        neighbours: or(settings.neighbours, defaults.neighbours),
        repeats: or(settings.repeats, defaults.repeats as usize) as u32,
        threshold: if settings.threshold == 0.0 { defaults.threshold } else { f64::from(settings.threshold) },
        seed: settings.seed,
        probing,
        special_moves: !settings.without_special_moves,
        arrival: if settings.touch { Arrival::Touch } else { defaults.arrival },
    };
    let limit = config.max_vertices.min(MAX_VERTICES);
    if raw.vertices > limit {
        let message = format!("settings.vertices is {}; at most {limit} are allowed (--max-vertices)", raw.vertices);
        return Err(status::too_large("settings.vertices", message));
    }
    let checked = BuildSettings::try_from(raw);
    checked.map_err(|error| status::invalid(format!("settings.{}", error.field), error.to_string()))
}

/// Converts a required revision from the wire; 0 means that any revision will do.
pub fn revision_from_wire(revision: u64) -> Option<Revision> {
    NonZeroU64::new(revision).map(Revision)
}

pub fn revision_to_wire(revision: Revision) -> u64 {
    revision.0.get()
}

/// Converts an edge to the wire; `forced` says whether a designer forced it.
pub fn edge_to_wire(edge: &Edge, forced: bool) -> wire::Edge {
    let (needs, ride) = needs_to_wire(&edge.evidence.needs);
    wire::Edge {
        from: edge.key.from.0,
        to: edge.key.to.0,
        tries: edge.evidence.tries,
        successes: edge.evidence.successes,
        decisions_mean: edge.evidence.decisions_mean().0 as f32,
        decisions_deviation: edge.evidence.decisions_deviation().0 as f32,
        ability: convert::ability_to_wire(edge.evidence.ability).into(),
        chance: edge.evidence.chance().get() as f32,
        seconds: edge.evidence.cost() as f32 * DECISION_SECONDS,
        price_factor: edge.evidence.price_factor,
        forced,
        deaths: edge.evidence.deaths,
        death_chance: edge.evidence.death_chance() as f32,
        needs,
        ride,
    }
}

/// Converts a layer from the wire. [`Layer::validate`] checks its name and numbers later.
pub fn layer_from_wire(layer: Option<&wire::Layer>) -> Result<Layer, FieldError> {
    let layer = layer.ok_or(FieldError::Missing("layer"))?;
    Ok(Layer { name: layer.name.clone(), edits: edits_from_wire(&layer.edits)? })
}

/// Converts edits from the wire.
pub fn edits_from_wire(edits: &[wire::Edit]) -> Result<Vec<Edit>, FieldError> {
    edits.iter().map(edit_from_wire).collect()
}

fn edit_from_wire(edit: &wire::Edit) -> Result<Edit, FieldError> {
    let from = |point: &Option<surefoot_proto::world::v1::Vec3>| convert::point(point.as_ref(), "edit.from");
    let to = |point: &Option<surefoot_proto::world::v1::Vec3>| convert::point(point.as_ref(), "edit.to");
    let at = |edit: &wire::VertexEdit| convert::point(edit.at.as_ref(), "edit.at");
    Ok(match edit.edit.as_ref().ok_or(FieldError::Missing("edit"))? {
        wire::edit::Edit::ForbidEdge(edit) => Edit::ForbidEdge { from: from(&edit.from)?, to: to(&edit.to)? },
        wire::edit::Edit::ForceEdge(edit) => {
            Edit::ForceEdge { from: from(&edit.from)?, to: to(&edit.to)?, seconds: edit.seconds }
        }
        wire::edit::Edit::PriceEdge(edit) => {
            Edit::PriceEdge { from: from(&edit.from)?, to: to(&edit.to)?, factor: edit.factor }
        }
        wire::edit::Edit::AddVertex(edit) => Edit::AddVertex { at: at(edit)? },
        wire::edit::Edit::MoveVertex(edit) => Edit::MoveVertex { from: from(&edit.from)?, to: to(&edit.to)? },
        wire::edit::Edit::RemoveVertex(edit) => Edit::RemoveVertex { at: at(edit)? },
    })
}

/// Converts a layer to the wire.
pub fn layer_to_wire(layer: &Layer) -> wire::Layer {
    wire::Layer { name: layer.name.clone(), edits: layer.edits.iter().map(edit_to_wire).collect() }
}

fn edit_to_wire(edit: &Edit) -> wire::Edit {
    let point = |point| Some(convert::to_wire(point));
    let edit = match *edit {
        Edit::ForbidEdge { from, to } => {
            wire::edit::Edit::ForbidEdge(wire::EdgeEdit { from: point(from), to: point(to) })
        }
        Edit::ForceEdge { from, to, seconds } => {
            wire::edit::Edit::ForceEdge(wire::ForceEdge { from: point(from), to: point(to), seconds })
        }
        Edit::PriceEdge { from, to, factor } => {
            wire::edit::Edit::PriceEdge(wire::PriceEdge { from: point(from), to: point(to), factor })
        }
        Edit::AddVertex { at } => wire::edit::Edit::AddVertex(wire::VertexEdit { at: point(at) }),
        Edit::MoveVertex { from, to } => {
            wire::edit::Edit::MoveVertex(wire::MoveVertex { from: point(from), to: point(to) })
        }
        Edit::RemoveVertex { at } => wire::edit::Edit::RemoveVertex(wire::VertexEdit { at: point(at) }),
    };
    wire::Edit { edit: Some(edit) }
}

/// Converts edits that could not be applied to a level with this frame.
pub fn unapplied_to_wire(unapplied: &[Unapplied], frame: &LevelFrame) -> Vec<wire::UnappliedEdit> {
    unapplied
        .iter()
        .map(|unapplied| wire::UnappliedEdit {
            layer: unapplied.layer.clone(),
            index: unapplied.index as u32,
            reason: unapplied.reason.describe(frame),
        })
        .collect()
}

/// Encodes the answer to a change of layers. The responses of PutLayer, AppendEdits and UndoEdits have the same fields.
pub fn changed(figures: &Figures, (unapplied, frame): (&[Unapplied], &LevelFrame), revision: Revision) -> Vec<u8> {
    let summary = Some(summary_to_wire(figures));
    let (unapplied, revision) = (unapplied_to_wire(unapplied, frame), revision_to_wire(revision));
    wire::PutLayerResponse { summary, unapplied, revision }.encode_to_vec()
}

pub fn summary_to_wire(figures: &Figures) -> wire::GraphSummary {
    let Figures { map_hash, stats, cached, summary } = figures;
    wire::GraphSummary {
        map_hash: map_hash.clone(),
        vertices: summary.vertices as u32,
        edges: summary.edges as u32,
        islands: summary.islands,
        connected: summary.connected as f32,
        probes: stats.probes,
        build_s: stats.seconds as f32,
        cached: *cached,
        candidates: stats.candidates,
        traversals: summary.traversals,
        edits: summary.edits as u32,
        unapplied_edits: summary.unapplied_edits as u32,
        expected_edges: summary.expected_edges as u32,
    }
}

pub fn graph_to_wire(hosted: &Hosted) -> wire::GetGraphResponse {
    let summary = Some(summary_to_wire(&hosted.figures()));
    hosted.with_edited(|GraphView { graph, forced, removed, revision }| wire::GetGraphResponse {
        summary,
        vertices: graph.vertices().map(|vertex| convert::to_wire(graph.position(vertex))).collect(),
        islands: graph.islands().to_vec(),
        edges: graph.edges().map(|edge| edge_to_wire(edge, forced.contains(&edge.key))).collect(),
        revision: revision_to_wire(revision),
        removed: removed.iter().map(|vertex| vertex.0).collect(),
    })
}

pub fn ready_graph_to_wire(hosted: &Hosted) -> wire::ReadyGraph {
    let (map, level) = source_to_wire(&hosted.origin.source);
    wire::ReadyGraph {
        graph_id: hosted.origin.id.to_string(),
        map,
        level,
        settings: Some(settings_to_wire(&hosted.origin.settings)),
        summary: Some(summary_to_wire(&hosted.figures())),
        body: Some(convert::body_to_wire(&hosted.origin.body)),
        piece_count: hosted.origin.source.pieces().len() as u32,
    }
}

pub fn report_to_wire(report: Reported) -> wire::Report {
    let Reported { reporter: Reporter { name, is_trusted }, traversals, failures } = report;
    wire::Report { reporter: name, trusted: is_trusted, traversals, failures }
}

/// Returns the spec of a generated map, or else the name of an imported level.
fn source_to_wire(source: &MapSource) -> (Option<MapSpec>, String) {
    match source.base() {
        BaseMap::Spec(spec) => (Some(convert::map_spec_to_wire(spec)), String::new()),
        BaseMap::Level(level) => (None, level.name.clone()),
    }
}

/// Converts a build in `phase`, the current or an earlier one, to the wire.
pub fn build_to_wire(job: &Job, phase: BuildPhase) -> wire::Build {
    let end = job.end().filter(|_| phase.is_end());
    let (map, level) = source_to_wire(&job.source);
    let made = end.as_ref().and_then(|end| end.as_ref().ok());
    let failure = end.as_ref().and_then(|end| end.as_ref().err()).filter(|_| phase == BuildPhase::Failed);
    let interim = job.usable().filter(|_| matches!(phase, BuildPhase::Probes | BuildPhase::Index));
    wire::Build {
        build_id: job.id.to_string(),
        stage: phase_to_wire(phase).into(),
        probes_done: job.progress.done.load(Ordering::Relaxed),
        probes_total: job.progress.total.load(Ordering::Relaxed),
        graph_id: made.map(|made| made.graph.to_string()).unwrap_or_default(),
        summary: made.map(|made| summary_to_wire(&made.figures)),
        failure: failure.map(failure_to_wire),
        map,
        level,
        settings: Some(settings_to_wire(&job.settings)),
        start_time: Some(job.started.into()),
        body: Some(convert::body_to_wire(&job.body)),
        interim_graph_id: interim.map(|id| id.to_string()).unwrap_or_default(),
        piece_count: job.source.pieces().len() as u32,
    }
}

fn failure_to_wire(error: &PlannerError) -> wire::BuildFailure {
    let status = Status::from(error.clone());
    wire::BuildFailure {
        code: status.code().into(),
        reason: Reason::of(&status).map(|reason| reason.name().to_owned()).unwrap_or_default(),
        message: status.message().to_owned(),
    }
}

fn phase_to_wire(phase: BuildPhase) -> wire::BuildStage {
    match phase {
        BuildPhase::Queued => wire::BuildStage::Queued,
        BuildPhase::Map => wire::BuildStage::Map,
        BuildPhase::Vertices => wire::BuildStage::Vertices,
        BuildPhase::Probes => wire::BuildStage::Probes,
        BuildPhase::Index => wire::BuildStage::Index,
        BuildPhase::Done => wire::BuildStage::Done,
        BuildPhase::Failed => wire::BuildStage::Failed,
        BuildPhase::Cancelled => wire::BuildStage::Cancelled,
    }
}

pub fn difference_to_wire(found: Difference) -> wire::CompareGraphsResponse {
    let places = |places: Vec<Vec3>| places.into_iter().map(convert::to_wire).collect();
    wire::CompareGraphsResponse {
        lost: places(found.lost),
        gained: places(found.gained),
        connected_before: found.connected_before as f32,
        connected_after: found.connected_after as f32,
        islands_before: found.islands.0 as u32,
        islands_after: found.islands.1 as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_net::memory::MemoryBudget;
    use surefoot_world::MapSpec;
    use surefoot_world::character::bodies::BODIES;

    #[tokio::test]
    async fn a_recipe_makes_the_same_graph() {
        let (levels, config) = (LevelStore::new(1, MemoryBudget::new(1 << 20)), PlannerConfig::default());
        let spec = MapSpec::with_side(7, 50).unwrap();
        let defaults = BuildSettings::default();
        let own = wire::BuildSettings { vertices: 77, threshold: 0.3, seed: 5, touch: true, ..Default::default() };
        let own = settings_from_wire(Some(&own), &config).unwrap();
        for settings in [defaults, own] {
            for body in BODIES.iter().map(|preset| preset.profile()) {
                let source = MapSource::from(BaseMap::Spec(spec));
                let bytes = recipe((&source, &body, &settings));
                let (read, read_body, read_settings) = read_recipe(&bytes, &levels, &config).await.unwrap();
                assert_eq!((read.key(), read_body, read_settings), (source.key(), body, settings));
            }
        }
        assert!(read_recipe(&[255; 7], &levels, &config).await.is_err());
    }
}
