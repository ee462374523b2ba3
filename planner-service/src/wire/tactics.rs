//! Conversions of questions about many places.

use crate::config::PlannerConfig;
use crate::tactics::{RankQuestion, RankedPlace, Ranking, Reach, ReachQuestion};
use surefoot_net::status;
use surefoot_planner::Query;
use surefoot_planner::places::{Around, Sight};
use surefoot_planner::search::many::{RankBy, SharedEnd};
use surefoot_planner::search::reach::{ReachedCell, ReachedVertex};
use surefoot_proto::convert::{self, FieldError, WireEnum};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::plans;
use surefoot_world::{Seconds, Vec3};
use tonic::Status;

/// Greatest number of eyes of a question.
const MAX_EYES: usize = 16;
/// Greatest height of eyes above the feet, m.
const MAX_EYE_HEIGHT_M: f64 = 10.0;
/// Greatest distance of drawn places, m.
const MAX_RADIUS_M: f64 = 200.0;
/// Number of drawn places by default.
const USUAL_DRAWN: u32 = 256;
/// Greatest time of a question about what is reached, s.
const MAX_SECONDS: f64 = 600.0;
/// Range of the sides of cells, m.
const SIDES_M: [f64; 2] = [0.5, 50.0];

pub fn rank_question(request: &wire::RankPlacesRequest, config: &PlannerConfig) -> Result<RankQuestion, Status> {
    let (query, shared) = one_ended(request.query.as_ref())?;
    let around = request.around.as_ref().map(around_of).transpose()?;
    let drawn = around.map_or(0, |around| around.most);
    let (count, limit) = (request.places.len().saturating_add(drawn), config.max_queries);
    if count > limit {
        let message = format!("{count} places are too many: at most {limit} are allowed in one call (--max-queries)");
        return Err(status::too_large("places", message));
    }
    if count == 0 {
        return Err(status::invalid("places", "places and around are both missing"));
    }
    let eye_height = request.eye_height.map(f64::from);
    let eye_height = eye_height.map(|height| convert::in_range(height, 0.0, MAX_EYE_HEIGHT_M, "eye_height"));
    Ok(RankQuestion {
        query,
        shared,
        places: points(&request.places, "places")?,
        around,
        sight: sight_of(request)?,
        eye_height: eye_height.transpose()?.map(|height| height as f32),
        by: convert::enum_or(request.by, RankBy::Cost, "by")?,
        most: if request.best == 0 { usize::MAX } else { request.best as usize },
    })
}

pub fn reach_question(request: &wire::FindReachableRequest) -> Result<ReachQuestion, Status> {
    let (query, shared) = one_ended(request.query.as_ref())?;
    if shared == SharedEnd::Goal {
        return Err(FieldError::Missing("query.start").into());
    }
    let resolution = f64::from(request.resolution);
    if resolution != 0.0 {
        convert::in_range(resolution, SIDES_M[0], SIDES_M[1], "resolution")?;
    }
    Ok(ReachQuestion {
        query,
        limit: Seconds(above_zero(request.seconds, MAX_SECONDS, "seconds")?),
        side_m: (resolution != 0.0).then_some(request.resolution),
    })
}

/// Reads a query with one end, which stands for the other one, too.
fn one_ended(query: Option<&wire::PathQuery>) -> Result<(Query, SharedEnd), FieldError> {
    let query = query.ok_or(FieldError::Missing("query"))?;
    let (shared, end) = match (query.start, query.goal) {
        (Some(_), Some(_)) => return Err(FieldError::Exclusive("query.start", "query.goal")),
        (Some(start), None) => (SharedEnd::Start, start),
        (None, Some(goal)) => (SharedEnd::Goal, goal),
        (None, None) => return Err(FieldError::Missing("query.start or query.goal")),
    };
    let both = wire::PathQuery { start: Some(end), goal: Some(end), ..query.clone() };
    Ok((plans::query(&both)?, shared))
}

fn around_of(around: &wire::Around) -> Result<Around, FieldError> {
    Ok(Around {
        centre: convert::point(around.centre.as_ref(), "around.centre")?,
        radius_m: above_zero(around.radius, MAX_RADIUS_M, "around.radius")?,
        most: if around.count == 0 { USUAL_DRAWN } else { around.count } as usize,
    })
}

fn sight_of(request: &wire::RankPlacesRequest) -> Result<Sight, FieldError> {
    let found = request.hidden_from.len() + request.sees.len();
    if found > MAX_EYES {
        let (field, what, limit) = ("hidden_from and sees", "eyes", MAX_EYES);
        return Err(FieldError::Count { field, what, found, limit });
    }
    Ok(Sight { hidden_from: points(&request.hidden_from, "hidden_from")?, sees: points(&request.sees, "sees")? })
}

fn points(points: &[surefoot_proto::world::v1::Vec3], field: &'static str) -> Result<Vec<Vec3>, FieldError> {
    points.iter().map(|point| convert::point(Some(point), field)).collect()
}

/// Returns `value` if it is above 0 and at most `max`.
fn above_zero(value: f32, max: f64, field: &'static str) -> Result<f32, FieldError> {
    convert::in_range(value.into(), f64::from(f32::MIN_POSITIVE), max, field).map(|_| value)
}

pub fn ranking_to_wire(ranking: &Ranking) -> wire::RankPlacesResponse {
    wire::RankPlacesResponse {
        places: ranking.places.iter().map(ranked_to_wire).collect(),
        considered: ranking.considered as u32,
        fitting: ranking.fitting as u32,
        ..Default::default()
    }
}

fn ranked_to_wire(ranked: &RankedPlace) -> wire::RankedPlace {
    let common = wire::RankedPlace {
        place: Some(convert::to_wire(ranked.place)),
        index: ranked.idx as u32,
        found: ranked.arrival.is_ok(),
        ..Default::default()
    };
    match &ranked.arrival {
        Ok(arrival) => wire::RankedPlace {
            seconds: arrival.seconds.0,
            cost: arrival.cost.0,
            chance: arrival.chance.get() as f32,
            arrival_chance: arrival.arrival_chance.get() as f32,
            death_chance: arrival.death_chance as f32,
            ..common
        },
        Err(reason) => wire::RankedPlace { reason: reason.to_wire().into(), ..common },
    }
}

pub fn reach_to_wire(reach: &Reach) -> wire::FindReachableResponse {
    let vertex = |(reached, position): &(ReachedVertex, Vec3)| wire::ReachedVertex {
        vertex: reached.vertex.0,
        position: Some(convert::to_wire(*position)),
        seconds: reached.seconds.0,
    };
    let cell =
        |cell: &ReachedCell| wire::ReachedCell { centre: Some(convert::to_wire(cell.centre)), seconds: cell.seconds.0 };
    wire::FindReachableResponse {
        vertices: reach.vertices.iter().map(vertex).collect(),
        cells: reach.cells.iter().map(cell).collect(),
        ..Default::default()
    }
}
