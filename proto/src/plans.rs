//! Conversions of the types that clients, workers and planners exchange: queries, plans, settings, traversals.

use crate::convert::{self, FieldError, WireEnum};
use crate::planner::v1 as wire;
use crate::world::v1 as world;
use crate::zones;
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::live::Traversal;
use surefoot_planner::search::many::RankBy;
use surefoot_planner::{
    ABILITY_PRICES, AbilityPrices, Attach, BuildSettings, Caution, EdgeKey, Leg, LegKey, Need, Needs, NoPath,
    Placement, Plan, Probing, Query, Ride, Stop, Traffic, VertexId, Zones,
};
use surefoot_world::{Ability, Arrival, Chance, MoverId, Seconds, StopIdx, StopSet};

crate::wire_enum!(NoPath = wire::NoPath: StartOffGraph GoalOffGraph DifferentIslands OneWay GoalInZone);
crate::wire_enum!(RankBy = wire::RankBy: Cost Seconds);
crate::wire_enum!(Probing = wire::Probing: Exhaustive Frugal);
crate::wire_enum!(
    Placement = wire::Placement: Random Spaced Density Trajectories TrajectoriesTested Flood FloodGrandchildren
);

/// Maximum number of legs that a query avoids.
const MAX_AVOID: usize = 64;
/// Maximum number of decisions of a traversal.
const MAX_DECISIONS: u32 = 10_000;

fn stop(stop: Option<&wire::Stop>, field: &'static str) -> Result<Stop, FieldError> {
    use wire::stop::Stop as Kind;
    match stop.and_then(|stop| stop.stop).ok_or(FieldError::Missing(field))? {
        Kind::Vertex(vertex) => Ok(Stop::Vertex(VertexId(vertex))),
        Kind::End(end) => match wire::QueryEnd::try_from(end) {
            Ok(wire::QueryEnd::Start) => Ok(Stop::Start),
            Ok(wire::QueryEnd::Goal) => Ok(Stop::Goal),
            Ok(wire::QueryEnd::Unspecified) | Err(_) => Err(FieldError::Unknown { field, value: end }),
        },
    }
}

fn stop_to_wire(stop: Stop) -> Option<wire::Stop> {
    use wire::stop::Stop as Kind;
    let stop = match stop {
        Stop::Vertex(vertex) => Kind::Vertex(vertex.0),
        Stop::Start => Kind::End(wire::QueryEnd::Start.into()),
        Stop::Goal => Kind::End(wire::QueryEnd::Goal.into()),
    };
    Some(wire::Stop { stop: Some(stop) })
}

fn leg_key(ends: &wire::LegEnds) -> Result<LegKey, FieldError> {
    Ok(LegKey { from: stop(ends.from.as_ref(), "query.avoid.from")?, to: stop(ends.to.as_ref(), "query.avoid.to")? })
}

/// Converts an ability other than walking, which every plan needs.
fn special(value: i32, field: &'static str) -> Result<Ability, FieldError> {
    match convert::ability(value) {
        Ability::WALK => Err(FieldError::Unknown { field, value }),
        ability => Ok(ability),
    }
}

fn prices(list: &[wire::AbilityPrice]) -> Result<AbilityPrices, FieldError> {
    let mut prices = AbilityPrices::default();
    for price in list {
        let ability = special(price.ability, "query.prices.ability")?;
        if !prices.add(ability, Seconds(price.seconds)) {
            let (min, max) = ((*ABILITY_PRICES.start()).into(), (*ABILITY_PRICES.end()).into());
            return Err(FieldError::Range { field: "query.prices.seconds", value: price.seconds.into(), min, max });
        }
    }
    Ok(prices)
}

fn caution(value: f32) -> Result<Caution, FieldError> {
    Caution::new(value).ok_or(FieldError::Range { field: "query.caution", value: value.into(), min: 0.0, max: 1.0 })
}

/// Most movers of a map.
const MAX_MOVERS: usize = surefoot_world::map::mover::MAX_MOVERS;

fn stops(movers: &[wire::MoverStops]) -> Result<Vec<StopSet>, FieldError> {
    let mut stops = Vec::new();
    for known in movers {
        let most = MAX_MOVERS as f64 - 1.0;
        convert::in_range(f64::from(known.mover), 0.0, most, "query.movers.mover")?;
        let idx = known.mover as usize;
        if stops.len() <= idx {
            stops.resize(idx + 1, StopSet::ALL);
        }
        stops[idx] = stops[idx].intersection(StopSet(known.stops as u16));
    }
    Ok(stops)
}

fn stops_to_wire((mover, stops): (usize, StopSet)) -> wire::MoverStops {
    wire::MoverStops { mover: mover as u32, stops: stops.0.into() }
}

/// Converts the movers that an edge or a leg depends on, with their stops, and its ride.
pub fn needs_to_wire(needs: &Needs) -> (Vec<wire::MoverStops>, Option<wire::MoverRide>) {
    let list = needs.iter().map(|need| stops_to_wire((need.mover.idx(), need.stops))).collect();
    let ride = needs.ride.map(|ride| wire::MoverRide {
        mover: ride.mover.0.into(),
        from_stop: ride.from.0.into(),
        to_stop: ride.to.0.into(),
    });
    (list, ride)
}

/// Reads the movers that a leg depends on; `None` if there are none.
fn needs(leg: &wire::Leg) -> Result<Option<Needs>, FieldError> {
    let most = MAX_MOVERS as f64 - 1.0;
    let mover = |mover: u32| {
        convert::in_range(f64::from(mover), 0.0, most, "plan.legs.needs.mover").map(|it| MoverId(it as u16))
    };
    let stop =
        |stop: u32| convert::in_range(f64::from(stop), 0.0, 15.0, "plan.legs.ride.stop").map(|it| StopIdx(it as u8));
    let mut needs = Needs::default();
    for need in &leg.needs {
        needs.add(Need { mover: mover(need.mover)?, stops: StopSet(need.stops as u16) });
    }
    if let Some(ride) = leg.ride {
        needs.ride = Some(Ride { mover: mover(ride.mover)?, from: stop(ride.from_stop)?, to: stop(ride.to_stop)? });
    }
    Ok(Some(needs).filter(|needs| !needs.is_empty()))
}

/// Most crowds of a request; the smallest ones are left out.
pub const MAX_CROWDS: usize = 256;

/// Converts the largest crowds of the predicted traffic.
pub fn traffic_to_wire(traffic: &Traffic) -> wire::Traffic {
    let crowds = traffic.crowds().into_iter().take(MAX_CROWDS);
    let crowd = |(place, npcs)| wire::Crowd { place: Some(convert::to_wire(place)), npcs };
    wire::Traffic { crowds: crowds.map(crowd).collect() }
}

/// Converts a query from the wire.
pub fn query(query: &wire::PathQuery) -> Result<Query, FieldError> {
    let (found, limit) = (query.avoid.len(), MAX_AVOID);
    if found > limit {
        return Err(FieldError::Count { field: "query.avoid", what: "legs", found, limit });
    }
    Ok(Query {
        start: convert::point(query.start.as_ref(), "query.start")?,
        goal: convert::point(query.goal.as_ref(), "query.goal")?,
        avoid: query.avoid.iter().map(leg_key).collect::<Result<_, _>>()?,
        without: query.without.iter().map(|&ability| special(ability, "query.without")).collect::<Result<_, _>>()?,
        prices: prices(&query.prices)?,
        caution: query.caution.map_or(Ok(Caution::CAREFUL), caution)?,
        stops: stops(&query.movers)?,
        attach: Attach::Several,
        zones: Zones::new(zones::list(&query.zones, "query.zones")?),
        tags: zones::tags(&query.tags, "query.tags")?,
    })
}

/// Converts a query to the wire.
pub fn query_to_wire(query: &Query) -> wire::PathQuery {
    let price = |(ability, price): (Ability, Seconds)| wire::AbilityPrice {
        ability: convert::ability_to_wire(ability).into(),
        seconds: price.0,
    };
    let avoid = |leg: &LegKey| wire::LegEnds { from: stop_to_wire(leg.from), to: stop_to_wire(leg.to) };
    wire::PathQuery {
        start: Some(convert::to_wire(query.start)),
        goal: Some(convert::to_wire(query.goal)),
        avoid: query.avoid.iter().map(avoid).collect(),
        without: query.without.iter().map(|ability| convert::ability_to_wire(ability).into()).collect(),
        caution: (query.caution != Caution::CAREFUL).then_some(query.caution.get()),
        movers: query.stops.iter().copied().enumerate().map(stops_to_wire).collect(),
        zones: query.zones.iter().map(zones::zone_to_wire).collect(),
        tags: query.tags.iter().cloned().collect(),
        prices: query.prices.iter().map(price).collect(),
    }
}

/// Converts a plan to the wire.
pub fn plan_to_wire(plan: &Plan) -> wire::Plan {
    let reason = plan.no_path.map_or(wire::NoPath::Unspecified, NoPath::to_wire);
    let leg = |(idx, leg): (usize, &Leg)| {
        let (needs, ride) = plan.needs_of(idx).map(needs_to_wire).unwrap_or_default();
        wire::Leg {
            from: stop_to_wire(leg.key.from),
            to: stop_to_wire(leg.key.to),
            seconds: leg.seconds.0,
            chance: leg.chance.get() as f32,
            ability: convert::ability_to_wire(leg.ability).into(),
            death_chance: leg.death_chance,
            needs,
            ride,
        }
    };
    wire::Plan {
        found: plan.no_path.is_none(),
        reason: reason.into(),
        waypoints: plan.waypoints.iter().copied().map(convert::to_wire).collect(),
        legs: plan.legs.iter().enumerate().map(leg).collect(),
        seconds: plan.seconds().0,
        chance: plan.chance().get() as f32,
        nearest_reachable: plan.nearest.map(convert::to_wire),
        arrival_chance: plan.arrival_chance().get() as f32,
        death_chance: plan.death_chance() as f32,
        as_planned_chance: plan.as_planned_chance().get() as f32,
    }
}

/// Converts a plan from the wire.
pub fn plan(plan: &wire::Plan) -> Result<Plan, FieldError> {
    if plan.waypoints.is_empty() || plan.waypoints.len() != plan.legs.len() {
        return Err(FieldError::Length {
            field: "plan.legs",
            found: plan.legs.len(),
            expected: plan.waypoints.len().max(1),
        });
    }
    let waypoints =
        plan.waypoints.iter().map(|point| convert::point(Some(point), "plan.waypoints")).collect::<Result<_, _>>()?;
    let leg = |leg: &wire::Leg| {
        let from = stop(leg.from.as_ref(), "plan.legs.from")?;
        let to = stop(leg.to.as_ref(), "plan.legs.to")?;
        if !(0.0..=f32::MAX).contains(&leg.seconds) {
            let (value, max) = (f64::from(leg.seconds), f64::from(f32::MAX));
            return Err(FieldError::Range { field: "plan.legs.seconds", value, min: 0.0, max });
        }
        Ok(Leg {
            key: LegKey { from, to },
            seconds: Seconds(leg.seconds),
            chance: Chance::new(f64::from(leg.chance)),
            // A broken planner must not spread NaN.
            death_chance: if leg.death_chance.is_nan() { 0.0 } else { leg.death_chance.clamp(0.0, 1.0) },
            ability: convert::ability(leg.ability),
        })
    };
    let legs = plan.legs.iter().map(leg).collect::<Result<_, FieldError>>()?;
    let mut all_needs = Vec::new();
    for (idx, leg) in plan.legs.iter().enumerate() {
        all_needs.extend(needs(leg)?.map(|needs| (idx, needs)));
    }
    let nearest = plan.nearest_reachable.as_ref();
    let nearest = nearest.map(|nearest| convert::point(Some(nearest), "plan.nearest_reachable")).transpose()?;
    Ok(Plan { needs: all_needs, waypoints, legs, no_path: NoPath::from_wire(plan.reason), nearest })
}

/// Converts a plan to the form in which a worker reports it to the world server.
pub fn npc_plan_to_wire(plan: &Plan) -> world::NpcPlan {
    let legs = plan.legs.iter().map(|leg| world::PlanLeg {
        ability: convert::ability_to_wire(leg.ability).into(),
        seconds: leg.seconds.0,
        chance: leg.chance.get() as f32,
    });
    let no_path = match plan.no_path {
        None => "",
        Some(NoPath::StartOffGraph) => "no proved edge leaves a vertex near the start",
        Some(NoPath::GoalOffGraph) => "no proved edge reaches a vertex near the goal",
        Some(NoPath::DifferentIslands) => "no path joins the islands of start and goal",
        Some(NoPath::OneWay) => "a path leads from the goal to the start, but not from the start to the goal",
        Some(NoPath::GoalInZone) => "the goal is in a zone that the NPC must not enter",
    };
    world::NpcPlan {
        waypoints: plan.waypoints.iter().copied().map(convert::to_wire).collect(),
        legs: legs.collect(),
        no_path: no_path.to_owned(),
    }
}

/// Converts settings to the wire.
pub fn settings_to_wire(settings: &BuildSettings) -> wire::BuildSettings {
    wire::BuildSettings {
        placement: settings.placement.to_wire().into(),
        vertices: settings.vertices as u32,
        neighbours: settings.neighbours as u32,
        repeats: settings.repeats,
        threshold: settings.threshold as f32,
        seed: settings.seed,
        probing: settings.probing.to_wire().into(),
        without_special_moves: !settings.special_moves,
        touch: settings.arrival == Arrival::Touch,
    }
}

/// Converts a traversal from the wire.
pub fn traversal(traversal: &wire::Traversal) -> Result<Traversal, FieldError> {
    let &wire::Traversal { from, to, reached, decisions, died } = traversal;
    if decisions > MAX_DECISIONS {
        let (value, max) = (f64::from(decisions), f64::from(MAX_DECISIONS));
        return Err(FieldError::Range { field: "traversals.decisions", value, min: 0.0, max });
    }
    let end = match (reached, died) {
        (true, true) => return Err(FieldError::Exclusive("traversals.died", "traversals.reached")),
        (_, true) => TryEnd::Died,
        (reached, false) => TryEnd::of(reached),
    };
    Ok(Traversal { edge: EdgeKey::new(from, to), end, decisions })
}

/// Converts a traversal to the wire.
pub fn traversal_to_wire(traversal: &Traversal) -> wire::Traversal {
    wire::Traversal {
        from: traversal.edge.from.0,
        to: traversal.edge.to.0,
        reached: traversal.end == TryEnd::Arrived,
        decisions: traversal.decisions,
        died: traversal.end == TryEnd::Died,
    }
}
