//! Converts between the wire types of `surefoot.world.v1` and the server's own. Requests are checked here.
//!
//! This file has worlds, NPCs and what readers see of them; [`worker`], [`env`], [`map`] and [`living`] have the rest.

pub mod env;
pub mod living;
pub mod map;
pub mod worker;

use crate::figures::WorldSummary;
use crate::hosted::{
    BodyId, EndedAttempt, EventKind, Movement, NpcEvent, NpcPlan, NpcState, NpcStatus, PlanLeg, RouteKind, Standing,
    Support, TimeMode, WorldStats,
};
use crate::ids::NpcId;
use crate::segments::{News, STEP_M, Start};
use crate::view::{Region, Shown};
use std::collections::BTreeSet;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError, WireEnum};
use surefoot_proto::movement;
use surefoot_proto::wire_enum;
use surefoot_proto::world::v1 as wire;
use surefoot_world::Vec3;
use surefoot_world::sense::{Seen, Sight};
use tonic::Status;

wire_enum!(TimeMode = wire::TimeMode: Realtime Lockstep);
wire_enum!(NpcStatus = wire::NpcStatus: Idle Seeking Down);
wire_enum!(Support = wire::Support: Air Ground Steep Water ZipLine);
wire_enum!(Standing = wire::Standing:
    NoWorker SilentWorker AwaitsMap AwaitsGraph AwaitsPlan AwaitsRehearsal AwaitsMover Barred Blocked AtTarget Holds
    Rests NoPlace AwaitsGroup);
wire_enum!(RouteKind = wire::RouteKind: Patrol Hold Wander Flee);

/// Reads a region; absent means everywhere.
pub fn region(region: Option<&wire::Region>) -> Result<Option<Region>, FieldError> {
    let Some(region) = region else { return Ok(None) };
    let low = convert::point(region.low.as_ref(), "region.low")?;
    let high = convert::point(region.high.as_ref(), "region.high")?;
    for (low, high, field) in
        [(low.x, high.x, "region.high.x"), (low.y, high.y, "region.high.y"), (low.z, high.z, "region.high.z")]
    {
        convert::in_range(f64::from(high), f64::from(low), f64::from(f32::MAX), field)?;
    }
    Ok(Some(Region { low, high }))
}

/// Checks that the number in `field` is finite.
pub fn finite(value: f32, field: &'static str) -> Result<f32, FieldError> {
    if value.is_finite() { Ok(value) } else { Err(FieldError::NotFinite(field)) }
}

/// Checks that `field` names each NPC at most once.
pub(super) fn each_once(mut npcs: Vec<u64>, field: &'static str) -> Result<(), Status> {
    npcs.sort_unstable();
    let Some(pair) = npcs.windows(2).find(|pair| pair[0] == pair[1]) else { return Ok(()) };
    Err(status::invalid(field, format!("{field} names npc {} twice", pair[0])))
}

pub fn world_to_wire(world: &WorldSummary) -> wire::World {
    wire::World {
        world_id: world.id.0,
        map: world.map.spec().map(convert::map_spec_to_wire),
        map_hash: world.map.built_hash().to_hex(),
        mode: world.mode.to_wire().into(),
        npc_count: world.npc_count as u32,
        tick: world.tick.0,
        bodies: world.bodies.iter().map(convert::body_to_wire).collect(),
        solid_npcs: world.solid_npcs,
        piece_count: world.map.pieces().len() as u32,
        edited_map_hash: world.map.hash().to_hex(),
        zone_count: world.zone_count as u32,
    }
}

pub fn npc_to_wire(npc: &NpcState) -> wire::Npc {
    wire::Npc {
        npc_id: npc.id.0,
        position: Some(convert::to_wire(npc.position)),
        velocity: Some(convert::to_wire(npc.velocity)),
        yaw: npc.yaw,
        status: npc.status.to_wire().into(),
        goal: npc.goal.map(convert::to_wire),
        waypoint: npc.waypoint.map(convert::to_wire),
        last_outcome: convert::outcome(npc.last_outcome).into(),
        attempts_begun: npc.attempts_begun,
        attempts_ended: npc.attempts_ended,
        worker_id: npc.worker.map_or(0, |worker| worker.0),
        support: npc.support.to_wire().into(),
        ability: npc.ability.to_wire().into(),
        cause: convert::outcome(npc.cause).into(),
        body_idx: npc.body.0.into(),
        standing: standing_to_wire(npc.standing),
        route: route_to_wire(npc.route),
        route_stop: npc.route_stop,
        movement: npc.movement.map(movement_to_wire),
    }
}

fn npc_delta_to_wire((old, npc): &(NpcState, NpcState)) -> wire::NpcDelta {
    /// The new value, if it differs from the old one.
    fn changed<T: PartialEq>(old: T, new: T) -> Option<T> {
        (old != new).then_some(new)
    }
    let place = |old: Option<Vec3>, new: Option<Vec3>| changed(old, new).flatten().map(convert::to_wire);
    wire::NpcDelta {
        npc_id: npc.id.0,
        position: changed(old.position, npc.position).map(convert::to_wire),
        velocity: changed(old.velocity, npc.velocity).map(convert::to_wire),
        yaw: changed(old.yaw, npc.yaw),
        status: changed(old.status, npc.status).map(|status| status.to_wire().into()),
        goal: place(old.goal, npc.goal),
        goal_cleared: old.goal.is_some() && npc.goal.is_none(),
        waypoint: place(old.waypoint, npc.waypoint),
        waypoint_cleared: old.waypoint.is_some() && npc.waypoint.is_none(),
        last_outcome: changed(old.last_outcome, npc.last_outcome).map(|end| convert::outcome(end).into()),
        attempts_begun: changed(old.attempts_begun, npc.attempts_begun),
        attempts_ended: changed(old.attempts_ended, npc.attempts_ended),
        worker_id: changed(old.worker, npc.worker).map(|worker| worker.map_or(0, |worker| worker.0)),
        support: changed(old.support, npc.support).map(|support| support.to_wire().into()),
        ability: changed(old.ability, npc.ability).map(|ability| ability.to_wire().into()),
        cause: changed(old.cause, npc.cause).map(|cause| convert::outcome(cause).into()),
        standing: changed(old.standing, npc.standing).map(standing_to_wire),
        route: changed(old.route, npc.route).map(route_to_wire),
        route_stop: changed(old.route_stop, npc.route_stop),
        movement: changed(old.movement, npc.movement).flatten().map(movement_to_wire),
    }
}

fn movement_to_wire(Movement { locomotion, prediction }: Movement) -> wire::Movement {
    movement::movement_to_wire(&locomotion, prediction)
}

fn standing_to_wire(reason: Option<Standing>) -> i32 {
    reason.map_or(wire::Standing::Unspecified, Standing::to_wire).into()
}

fn route_to_wire(kind: Option<RouteKind>) -> i32 {
    kind.map_or(wire::RouteKind::Unspecified, RouteKind::to_wire).into()
}

/// The warning that `lacking` NPCs have no worker, because all of `workers` are full.
pub fn no_worker_to_wire(lacking: usize, workers: usize) -> wire::Warning {
    let npcs = if lacking == 1 { "1 NPC has".to_owned() } else { format!("{lacking} NPCs have") };
    let message = match workers {
        0 => format!("{npcs} no worker, because none is connected: start one with `surefoot work`"),
        1 => format!("{npcs} no worker, because the only one is full: start another, or raise `surefoot work --npcs`"),
        _ => {
            format!("{npcs} no worker, because all {workers} are full: start another, or raise `surefoot work --npcs`")
        }
    };
    wire::Warning { reason: wire::WarningReason::NoWorker.into(), message }
}

/// Converts the events of one tick, with the cursor of the last; if `only` is not empty, only events of its NPCs are
/// included. Returns `None` if there are no events.
pub fn events_to_wire(epoch: u64, events: &[NpcEvent], only: &BTreeSet<NpcId>) -> Option<wire::WatchEventsResponse> {
    let last = events.last()?;
    let wanted = events.iter().filter(|event| only.is_empty() || only.contains(&event.npc));
    Some(wire::WatchEventsResponse {
        tick: last.tick.0,
        server_time: Some(last.time.into()),
        cursor: Some(wire::EventCursor { epoch, sequence: last.sequence }),
        events: wanted.map(event_to_wire).collect(),
    })
}

fn event_to_wire(event: &NpcEvent) -> wire::NpcEvent {
    use wire::npc_event::Event;
    let point = |point| Some(convert::to_wire(point));
    let kind = match event.kind.clone() {
        EventKind::Spawned { position } => Event::Spawned(wire::Spawned { position: point(position) }),
        EventKind::AttemptBegan { attempt, goal, .. } => {
            Event::AttemptBegan(wire::AttemptBegan { attempt, goal: point(goal) })
        }
        EventKind::TargetReached { attempt, goal } => {
            Event::TargetReached(wire::TargetReached { attempt, goal: point(goal) })
        }
        EventKind::TargetLost { attempt } => Event::TargetLost(wire::TargetLost { attempt }),
        EventKind::TargetUnreachable { attempt, no_path } => {
            Event::TargetUnreachable(wire::TargetUnreachable { attempt, no_path: no_path.as_ref().to_owned() })
        }
        EventKind::TargetReachable { attempt } => Event::TargetReachable(wire::TargetReachable { attempt }),
        EventKind::RouteSet { kind } => Event::RouteSet(wire::RouteSet { kind: route_to_wire(kind) }),
        EventKind::StopReached { attempt, stop } => Event::StopReached(wire::StopReached { attempt, stop }),
        EventKind::AttemptEnded { attempt, end, goal, distance_m, seconds, no_path } => {
            Event::AttemptEnded(wire::AttemptEnded {
                attempt,
                outcome: convert::outcome(end).into(),
                goal: goal.and_then(point),
                seconds: seconds.0,
                distance_m,
                no_path: no_path.to_string(),
            })
        }
        EventKind::Jumped { ability, position } => {
            Event::Jumped(wire::Jumped { ability: ability.to_wire().into(), position: point(position) })
        }
        EventKind::Landed { position, impact_speed } => {
            Event::Landed(wire::Landed { position: point(position), impact_speed })
        }
        EventKind::Rode { ability, position } => {
            Event::Rode(wire::Rode { ability: ability.to_wire().into(), position: point(position) })
        }
        EventKind::Died { cause, attempt, position } => Event::Died(wire::Died {
            cause: convert::outcome(Some(cause)).into(),
            attempt: attempt.unwrap_or(0),
            position: point(position),
        }),
        EventKind::Teleported { position } => Event::Teleported(wire::Teleported { position: point(position) }),
        EventKind::Removed => Event::Removed(wire::Removed {}),
        EventKind::Stands { reason, seconds, position } => Event::Stands(wire::Stands {
            reason: reason.to_wire().into(),
            seconds: seconds.0,
            position: point(position),
        }),
    };
    wire::NpcEvent { sequence: event.sequence, npc_id: event.npc.0, event: Some(kind) }
}

pub fn stats_to_wire(stats: &WorldStats) -> wire::WorldStats {
    let WorldStats { counters, times, without_worker } = stats;
    let [reached, fell, burnt, drowned, no_progress, unreachable, reached_near] = counters.ends;
    wire::WorldStats {
        tick_us_p50: times.quantile_us(0.5),
        tick_us_p99: times.quantile_us(0.99),
        ticks_dropped: counters.ticks_dropped,
        decisions_requested: counters.asked,
        decisions_answered: counters.answered,
        decisions_missed: counters.missed,
        reached,
        fell,
        burnt,
        drowned,
        no_progress,
        unreachable,
        reached_near,
        ticks_late: counters.ticks_late,
        tick_histogram: times.counts().to_vec(),
        answers_stale: counters.stale,
        answers_invalid: counters.invalid,
        plans_failed: counters.plans_failed,
        npcs_without_worker: *without_worker,
    }
}

pub fn shown_to_wire(shown: &Shown) -> wire::WatchWorldResponse {
    wire::WatchWorldResponse {
        tick: shown.tick.0,
        server_time: Some(shown.time.into()),
        is_delta: shown.is_delta,
        npcs: shown.npcs.iter().map(npc_to_wire).collect(),
        changed: shown.changed.iter().map(npc_delta_to_wire).collect(),
        gone_npc_ids: shown.gone.iter().map(|npc| npc.0).collect(),
        movers: shown.movers.iter().map(|(idx, state, pose)| living::mover_state_to_wire(*idx, state, *pose)).collect(),
        players: shown.players.iter().map(|(slot, player)| living::player_to_wire(*slot, player)).collect(),
        map_revision: shown.map_revision,
    }
}

pub fn news_to_wire(news: &News) -> wire::WatchSegmentsResponse {
    let start = |start: &Start| wire::SegmentStart {
        body: start.body,
        who: Some(match start.id {
            BodyId::Npc(npc) => wire::segment_start::Who::NpcId(npc.0),
            BodyId::Player(slot) => wire::segment_start::Who::PlayerId(slot.0),
        }),
        position: Some(convert::to_wire(start.at.place())),
        heading: start.at.heading.into(),
    };
    wire::WatchSegmentsResponse {
        tick: news.tick.0,
        restarts: news.restarts,
        step: if news.restarts { STEP_M } else { 0.0 },
        gone: news.gone.clone(),
        bodies: news.segments.iter().map(|segment| segment.body).collect(),
        ticks: news.segments.iter().map(|segment| segment.ticks).collect(),
        moves: news.segments.iter().flat_map(|segment| segment.steps).collect(),
        turns: news.segments.iter().map(|segment| segment.turn).collect(),
        starts: news.starts.iter().map(start).collect(),
    }
}

pub fn npc_plan_to_wire(plan: &NpcPlan) -> wire::NpcPlan {
    let leg = |leg: &PlanLeg| wire::PlanLeg {
        ability: leg.ability.to_wire().into(),
        seconds: leg.seconds.0,
        chance: leg.chance.get() as f32,
    };
    wire::NpcPlan {
        waypoints: plan.waypoints.iter().copied().map(convert::to_wire).collect(),
        legs: plan.legs.iter().map(leg).collect(),
        no_path: plan.no_path.clone(),
    }
}

pub fn ended_attempt_to_wire(ended: &EndedAttempt) -> wire::AttemptEnded {
    wire::AttemptEnded {
        attempt: ended.attempt,
        outcome: convert::outcome(Some(ended.end)).into(),
        goal: ended.goal.map(convert::to_wire),
        seconds: ended.seconds.0,
        distance_m: ended.distance_m,
        no_path: ended.no_path.to_string(),
    }
}

pub fn rays_to_wire(sight: &Sight) -> Vec<wire::Ray> {
    let surface = |seen: Option<Seen>| match seen {
        None => wire::Surface::Unspecified,
        Some(Seen::Surface(surface)) => surface.to_wire(),
        Some(Seen::Body) => wire::Surface::Body,
    };
    let ray = |&(end, seen): &(Vec3, Option<Seen>)| wire::Ray {
        end: Some(convert::to_wire(end)),
        surface: surface(seen).into(),
    };
    sight.ends.iter().map(ray).collect()
}
