//! Between wire types and the planner's own.

use super::PlannerConfig;
use crate::build::{BuildSettings, MAX_VERTICES};
use crate::edits::{Edit, Layer, Unfit};
use crate::graph::{Ability, Edge};
use crate::live::Passage;
use crate::placement::Placement;
use crate::prove::Probing;
use crate::search::{self, NoPath, Plan};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::status;
use surefoot_proto::world::v1 as world;
use surefoot_world::DECISION_SECONDS;
use tonic::Status;

/// Settings from the wire, defaults filled in.
///
/// # Errors
/// If an enum value is unknown or a number out of range.
pub fn settings_from_wire(
    settings: Option<&wire::BuildSettings>,
    config: &PlannerConfig,
) -> Result<BuildSettings, Status> {
    let defaults = BuildSettings::default();
    let Some(settings) = settings else { return Ok(defaults) };
    let or = |value: u32, default: usize| if value == 0 { default } else { value as usize };
    let unknown = |field: &str, value: i32| {
        status::invalid(format!("settings.{field}"), format!("settings.{field} {value} is unknown"))
    };
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
        let message =
            format!("settings.vertices is {}, at most {limit} are allowed (--max-vertices)", checked.vertices);
        return Err(status::too_much("settings.vertices", message));
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

/// An ability on the wire.
pub fn ability_to_wire(ability: Ability) -> i32 {
    match ability {
        Ability::Walk => world::Ability::Walk,
        Ability::Jump => world::Ability::Jump,
        Ability::DoubleJump => world::Ability::DoubleJump,
        Ability::Pad => world::Ability::Pad,
        Ability::ZipLine => world::Ability::ZipLine,
        Ability::Teleporter => world::Ability::Teleporter,
        Ability::Jetpack => world::Ability::Jetpack,
    }
    .into()
}

fn ability_from_wire(ability: i32) -> Ability {
    match world::Ability::try_from(ability) {
        Ok(world::Ability::Jump) => Ability::Jump,
        Ok(world::Ability::DoubleJump) => Ability::DoubleJump,
        Ok(world::Ability::Pad) => Ability::Pad,
        Ok(world::Ability::ZipLine) => Ability::ZipLine,
        Ok(world::Ability::Teleporter) => Ability::Teleporter,
        Ok(world::Ability::Jetpack) => Ability::Jetpack,
        Ok(world::Ability::Walk | world::Ability::Unspecified) | Err(_) => Ability::Walk,
    }
}

/// A plan as a worker tells the world server of it.
pub fn npc_plan_to_wire(plan: &Plan) -> world::NpcPlan {
    let legs = plan.legs.iter().map(|leg| world::PlanLeg {
        ability: ability_to_wire(leg.ability),
        seconds: leg.seconds,
        chance: leg.chance,
    });
    let no_path = match plan.no_path {
        None => "",
        Some(NoPath::StartOffGraph) => "no proved edge leaves near the start",
        Some(NoPath::GoalOffGraph) => "no proved edge arrives near the goal",
        Some(NoPath::DifferentIslands) => "start and goal lie on different islands",
        Some(NoPath::OneWay) => "the goal leads to the start, but not back",
    };
    world::NpcPlan {
        waypoints: plan.waypoints.iter().copied().map(convert::to_wire).collect(),
        legs: legs.collect(),
        no_path: no_path.to_owned(),
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
        nearest_reachable: plan.nearest.map(convert::to_wire),
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
    let nearest = match &plan.nearest_reachable {
        Some(nearest) => Some(convert::point(Some(nearest), "plan.nearest_reachable")?),
        None => None,
    };
    Ok(Plan { waypoints, legs: legs.collect(), no_path, nearest })
}

/// An edge on the wire; `forced` if a designer put it in.
pub fn edge_to_wire(edge: &Edge, forced: bool) -> wire::Edge {
    wire::Edge {
        from: edge.from,
        to: edge.to,
        tries: edge.evidence.tries,
        successes: edge.evidence.successes,
        decisions_mean: edge.evidence.decisions_mean() as f32,
        decisions_deviation: edge.evidence.decisions_deviation() as f32,
        ability: ability_to_wire(edge.evidence.ability),
        chance: edge.evidence.chance() as f32,
        seconds: edge.evidence.cost() as f32 * DECISION_SECONDS,
        price_factor: edge.evidence.price_factor,
        forced,
    }
}

/// Most decisions that a passage may be said to have taken.
const MAX_DECISIONS: u32 = 10_000;

/// A passage from the wire.
///
/// # Errors
/// If it is said to have taken too many decisions.
pub fn passage_from_wire(traversal: &wire::Traversal) -> Result<Passage, FieldError> {
    let &wire::Traversal { from, to, reached, decisions } = traversal;
    if decisions > MAX_DECISIONS {
        let (value, max) = (f64::from(decisions), f64::from(MAX_DECISIONS));
        return Err(FieldError::Range { field: "traversals.decisions", value, min: 0.0, max });
    }
    Ok(Passage { from, to, reached, decisions })
}

/// A layer from the wire; its numbers are checked by the layer itself.
///
/// # Errors
/// If it, one of its edits or a place is missing, or a place is not finite.
pub fn layer_from_wire(layer: Option<&wire::Layer>) -> Result<Layer, Status> {
    let layer = layer.ok_or(FieldError::Missing("layer"))?;
    Ok(Layer { name: layer.name.clone(), edits: edits_from_wire(&layer.edits)? })
}

/// Edits from the wire.
///
/// # Errors
/// If one is empty, or a place is missing or not finite.
pub fn edits_from_wire(edits: &[wire::Edit]) -> Result<Vec<Edit>, Status> {
    edits.iter().map(edit_from_wire).collect::<Result<_, FieldError>>().map_err(Status::from)
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

/// A layer on the wire.
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

/// What does not fit, on the wire.
pub fn unfit_to_wire(unfit: &[Unfit]) -> Vec<wire::UnfitEdit> {
    unfit
        .iter()
        .map(|unfit| wire::UnfitEdit {
            layer: unfit.layer.clone(),
            index: unfit.index as u32,
            reason: unfit.reason.to_string(),
        })
        .collect()
}
