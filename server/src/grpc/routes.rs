//! The calls about routes: what NPCs do between the goals that clients set.

use super::npcs::{check_count, facing, ids, item_error, item_result, radius_or};
use super::{Call, Reply, WorldApi};
use crate::hosted::{Area, HostedWorld, MAX_DWELL_TICKS, NpcError, Route, STOP_COUNT, Stop, Target, Threat};
use crate::ids::NpcId;
use crate::worlds::NpcAccess;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::Coordinates;
use surefoot_proto::world::v1 as wire;
use surefoot_world::{PlayerSlot, TICKS_PER_SECOND};

/// Most stops of all routes in a call.
const MAX_STOPS: usize = 16_384;

pub async fn set_routes(api: &WorldApi, call: Call<wire::SetRoutesRequest>) -> Reply<wire::SetRoutesResponse> {
    let (caller, wire::SetRoutesRequest { routes }) = call;
    check_count(routes.len(), "routes")?;
    let stop_count: usize = routes.iter().map(stop_count).sum();
    if stop_count > MAX_STOPS {
        let message = format!("routes have {stop_count} stops, at most {MAX_STOPS} are allowed in one call");
        return Err(status::too_large("routes", message));
    }
    let item = |item: &wire::NpcRoute| {
        let route = item.route.as_ref().map(route).transpose()?;
        Ok((NpcId(item.npc_id), (route, Coordinates::read(item.coordinates)?)))
    };
    let items = routes.iter().map(item).collect();
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, set_route_on).await;
    Ok(wire::SetRoutesResponse { results: results.into_iter().map(item_result).collect() })
}

pub async fn get_routes(api: &WorldApi, call: Call<wire::GetRoutesRequest>) -> Reply<wire::GetRoutesResponse> {
    use wire::get_route_result::Result as Kind;
    let (caller, wire::GetRoutesRequest { npc_ids, coordinates }) = call;
    let (items, coordinates) = (ids("npc_ids", npc_ids)?, Coordinates::read(coordinates)?);
    let route_of = move |world: &mut HostedWorld, npc, ()| {
        let frame = coordinates.on(world.map().frame());
        let mut route = world.route(npc)?;
        for place in route.iter_mut().flat_map(Route::places_mut) {
            *place = frame.to_level(*place);
        }
        Ok(wire::Route { kind: route.map(to_wire) })
    };
    let results = api.worlds.with_npcs(&caller, NpcAccess::Read, items, route_of).await;
    let result = |result: Result<_, _>| wire::GetRouteResult {
        result: Some(result.map_or_else(|error| Kind::Error(item_error(error)), Kind::Route)),
    };
    Ok(wire::GetRoutesResponse { results: results.into_iter().map(result).collect() })
}

/// Converts a route, whose places stay as they are.
fn to_wire(route: Route) -> wire::route::Kind {
    use wire::route::Kind;
    let seconds = |ticks: u64| ticks as f32 / TICKS_PER_SECOND as f32;
    match route {
        Route::Patrol { stops, back_and_forth } => {
            let stop = |Stop { at, dwell, radius, facing }| wire::PatrolStop {
                position: Some(convert::to_wire(at)),
                dwell_s: seconds(dwell),
                radius,
                facing,
            };
            Kind::Patrol(wire::Patrol { stops: stops.into_iter().map(stop).collect(), back_and_forth })
        }
        Route::Hold { post, radius, facing } => {
            Kind::Hold(wire::Hold { position: post.map(convert::to_wire), radius, facing })
        }
        Route::Wander { area, dwell } => {
            let area = match area {
                Area::Zone(name) => wire::wander::Area::Zone(name),
                Area::Circle { centre, radius } => {
                    wire::wander::Area::Circle(wire::WanderCircle { centre: Some(convert::to_wire(centre)), radius })
                }
            };
            Kind::Wander(wire::Wander { area: Some(area), dwell_s: seconds(dwell) })
        }
        Route::Flee(Threat { from, distance, hides }) => {
            let from = match from {
                Target::Npc(npc) => Some(wire::flee::From::FromNpcId(npc.0)),
                Target::Player(player) => Some(wire::flee::From::FromPlayerId(player.0)),
                Target::Moving { from, .. } => Some(wire::flee::From::Position(convert::to_wire(from))),
                // No threat is a place in a group.
                Target::Rank(_) => None,
            };
            Kind::Flee(wire::Flee { from, distance, hide: hides })
        }
    }
}

fn stop_count(item: &wire::NpcRoute) -> usize {
    match item.route.as_ref().and_then(|route| route.kind.as_ref()) {
        Some(wire::route::Kind::Patrol(patrol)) => patrol.stops.len(),
        _ => 0,
    }
}

// Only the world of an NPC knows the frame of its map.
fn set_route_on(
    world: &mut HostedWorld,
    npc: NpcId,
    (mut route, coordinates): (Option<Route>, Coordinates),
) -> Result<(), NpcError> {
    let frame = coordinates.on(world.map().frame());
    for place in route.iter_mut().flat_map(Route::places_mut) {
        *place = frame.to_map(*place);
    }
    world.set_route(npc, route)
}

/// Reads a route, with places in the coordinates of its item.
fn route(route: &wire::Route) -> Result<Route, FieldError> {
    use wire::route::Kind;
    match route.kind.as_ref().ok_or(FieldError::Missing("route.kind"))? {
        Kind::Patrol(wire::Patrol { stops, back_and_forth }) => {
            let (least, most) = (*STOP_COUNT.start() as f64, *STOP_COUNT.end() as f64);
            convert::in_range(stops.len() as f64, least, most, "patrol.stops")?;
            let stops = stops.iter().map(stop).collect::<Result<_, _>>()?;
            Ok(Route::Patrol { stops, back_and_forth: *back_and_forth })
        }
        Kind::Hold(hold) => Ok(Route::Hold {
            post: hold.position.map(|at| convert::point(Some(&at), "hold.position")).transpose()?,
            radius: radius_or(hold.radius, 1.0, 1.0, "hold.radius")?,
            facing: facing(hold.facing, "hold.facing")?,
        }),
        Kind::Wander(wire::Wander { area, dwell_s }) => {
            let area = area.as_ref().ok_or(FieldError::Missing("wander.area"))?;
            Ok(Route::Wander { area: self::area(area)?, dwell: dwell(*dwell_s, "wander.dwell_s")? })
        }
        Kind::Flee(wire::Flee { from, distance, hide }) => {
            convert::in_range(f64::from(*distance), 2.0, 200.0, "flee.distance")?;
            let from = from.as_ref().ok_or(FieldError::Missing("flee.from"))?;
            Ok(Route::Flee(Threat { from: threat(from)?, distance: *distance, hides: *hide }))
        }
    }
}

fn stop(stop: &wire::PatrolStop) -> Result<Stop, FieldError> {
    Ok(Stop {
        at: convert::point(stop.position.as_ref(), "patrol.stops.position")?,
        dwell: dwell(stop.dwell_s, "patrol.stops.dwell_s")?,
        radius: radius_or(stop.radius, 1.0, 0.3, "patrol.stops.radius")?,
        facing: facing(stop.facing, "patrol.stops.facing")?,
    })
}

fn threat(from: &wire::flee::From) -> Result<Target, FieldError> {
    Ok(match from {
        wire::flee::From::FromNpcId(npc) => Target::Npc(NpcId(*npc)),
        wire::flee::From::FromPlayerId(player) => Target::Player(PlayerSlot(*player)),
        wire::flee::From::Position(at) => Target::at(convert::point(Some(at), "flee.position")?),
    })
}

fn area(area: &wire::wander::Area) -> Result<Area, FieldError> {
    match area {
        wire::wander::Area::Zone(name) => Ok(Area::Zone(name.clone())),
        wire::wander::Area::Circle(wire::WanderCircle { centre, radius }) => {
            convert::in_range(f64::from(*radius), 1.0, 500.0, "wander.circle.radius")?;
            Ok(Area::Circle { centre: convert::point(centre.as_ref(), "wander.circle.centre")?, radius: *radius })
        }
    }
}

/// Reads a rest, and returns it in ticks.
fn dwell(seconds: f32, field: &'static str) -> Result<u64, FieldError> {
    let ticks_per_second = f64::from(TICKS_PER_SECOND);
    let seconds = convert::in_range(f64::from(seconds), 0.0, MAX_DWELL_TICKS as f64 / ticks_per_second, field)?;
    Ok((seconds * ticks_per_second).round() as u64)
}
