//! Converts between the wire types of `surefoot.world.v1` and the server's own. Requests are checked here.

pub mod living;

use crate::envs::{EnvSettings, StepResults};
use crate::figures::WorldSummary;
use crate::geometry::TileMesh;
use crate::hosted::{
    EndedAttempt, EventKind, NpcEvent, NpcPlan, NpcState, NpcStatus, PlanLeg, Support, TimeMode, WorldStats,
};
use crate::ids::{NpcId, WorldId};
use crate::messages::{Answer, Assignment, Decision, Hello, ObservationBatch, ToWorker};
use crate::view::{Region, Shown};
use crate::worlds::Survey;
use std::collections::BTreeSet;
use surefoot_net::levels::BaseMap;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::pieces::piece_to_wire;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_rollout::Goal;
use surefoot_rollout::env::{Episodes, Route, actions_of};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::map::{Liquid, Outline};
use surefoot_world::mesh::Surface;
use surefoot_world::sense::{OBSERVATION_VERSION, Seen, Sight, observation_len};
use surefoot_world::{
    Action, Chance, End, Map, NPC_STATE_VERSION, OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN, Seconds, Tick, Vec3,
};
use tonic::Status;

/// Most bodies in one survey.
pub const MAX_SURVEYED: f64 = 8.0;
/// Most places that a survey lists.
pub const MAX_CUT_OFF: f64 = 10_000.0;
/// Greatest capacity of a worker, NPCs.
const MAX_CAPACITY: f64 = 65_536.0;
/// Longest name of a worker or of its policy, bytes.
const MAX_NAME: usize = 64;
/// Most waypoints in a plan.
const MAX_WAYPOINTS: usize = 4096;
/// Most NPCs of one environment, whose observations must fit into one message.
const MAX_ENV_NPCS: f64 = 4096.0;
/// Most places of a route in an environment.
const MAX_ROUTE: usize = 256;
/// Greatest heading, rad: a full turn.
const MAX_YAW: f64 = std::f64::consts::TAU;
/// Greatest distance of goals in an environment, m: across the largest map.
const MAX_GOAL_M: f64 = 1500.0;

// --- from the wire ---

/// Reads the time mode of a new world.
///
/// # Errors
/// INVALID_ARGUMENT if the value is unknown.
pub fn time_mode(mode: i32) -> Result<TimeMode, Status> {
    match wire::TimeMode::try_from(mode) {
        Ok(wire::TimeMode::Unspecified | wire::TimeMode::Realtime) => Ok(TimeMode::Realtime),
        Ok(wire::TimeMode::Lockstep) => Ok(TimeMode::Lockstep),
        Err(_) => Err(status::invalid("mode", format!("mode {mode} is unknown"))),
    }
}

/// Reads a region; absent means everywhere.
///
/// # Errors
/// If a corner is missing or not finite, or a coordinate of the low corner exceeds that of the high one.
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
///
/// # Errors
/// If it is infinite or NaN.
pub fn finite(value: f32, field: &'static str) -> Result<f32, FieldError> {
    if value.is_finite() { Ok(value) } else { Err(FieldError::NotFinite(field)) }
}

/// Reads a worker's answer.
///
/// # Errors
/// INVALID_ARGUMENT if an array has the wrong length or an NPC is named twice. A number that makes no sense concerns its NPC alone:
/// it is left out and counted.
pub fn answer(batch: wire::ActionBatch) -> Result<Answer, Status> {
    let count = batch.npc_ids.len();
    let values = convert::unpack(&batch.actions, count * ACTION_LEN, "actions.actions")?;
    each_once(batch.npc_ids.clone(), "actions.npc_ids")?;
    if batch.attempts.len() != count {
        let message = format!("actions.attempts has {} values for {count} NPCs", batch.attempts.len());
        return Err(status::invalid("actions.attempts", message));
    }
    let mut answer = Answer { tick: Tick(batch.tick), plans_failed: batch.plans_failed, ..Answer::default() };
    for (idx, (npc, attempt)) in batch.npc_ids.into_iter().zip(batch.attempts).enumerate() {
        let row = std::array::from_fn(|at| values[idx * ACTION_LEN + at]);
        let action = Action::from_array(row).ok();
        answer.invalid += u64::from(action.is_none());
        answer.decisions.push(Decision { npc: NpcId(npc), attempt, action });
    }
    for wire::Waypoint { npc_id, position, attempt } in batch.waypoints {
        match convert::point(position.as_ref(), "actions.waypoints.position") {
            Ok(position) => answer.waypoints.push((NpcId(npc_id), attempt, position)),
            Err(_) => answer.invalid += 1,
        }
    }
    for wire::CarriedPlan { npc_id, plan, attempt } in batch.plans {
        match npc_plan(plan) {
            Ok(plan) => answer.plans.push((NpcId(npc_id), attempt, plan)),
            Err(_) => answer.invalid += 1,
        }
    }
    // Calls of what does not exist come to nothing.
    let call = |call: wire::MoverCall| Some((u16::try_from(call.mover).ok()?, u8::try_from(call.stop).ok()?));
    answer.mover_calls = batch.mover_calls.into_iter().filter_map(call).collect();
    let end = |unreachable: bool| if unreachable { End::Unreachable } else { End::NoProgress };
    answer.gave_up = batch.gave_up.into_iter().map(|it| (NpcId(it.npc_id), it.attempt, end(it.unreachable))).collect();
    Ok(answer)
}

fn npc_plan(plan: Option<wire::NpcPlan>) -> Result<NpcPlan, FieldError> {
    let plan = plan.ok_or(FieldError::Missing("actions.plans.plan"))?;
    let count = plan.waypoints.len() as f64;
    convert::in_range(count, 1.0, MAX_WAYPOINTS as f64, "the count of actions.plans.plan.waypoints")?;
    convert::in_range(plan.legs.len() as f64, count, count, "the count of actions.plans.plan.legs")?;
    let waypoint = |point| convert::point(Some(point), "actions.plans.plan.waypoints");
    let leg = |leg: &wire::PlanLeg| {
        let seconds =
            convert::in_range(f64::from(leg.seconds), 0.0, f64::from(f32::MAX), "actions.plans.plan.legs.seconds")?;
        let chance = convert::in_range(f64::from(leg.chance), 0.0, 1.0, "actions.plans.plan.legs.chance")?;
        let ability = convert::ability(leg.ability);
        Ok(PlanLeg { ability, seconds: Seconds(seconds as f32), chance: Chance::new(chance) })
    };
    Ok(NpcPlan {
        waypoints: plan.waypoints.iter().map(waypoint).collect::<Result<_, FieldError>>()?,
        legs: plan.legs.iter().map(leg).collect::<Result<_, FieldError>>()?,
        no_path: plan.no_path,
    })
}

/// Reads the first message of a worker.
///
/// # Errors
/// INVALID_ARGUMENT if it is not a hello or a field is out of range, FAILED_PRECONDITION if the worker expects other
/// observations.
pub fn hello(first: Option<wire::WorkRequest>) -> Result<Hello, Status> {
    let Some(wire::work_request::Message::Hello(hello)) = first.and_then(|request| request.message) else {
        return Err(status::failure(Reason::MalformedRequest, "the first message must be hello"));
    };
    convert::in_range(f64::from(hello.capacity), 1.0, MAX_CAPACITY, "hello.capacity")?;
    for (text, field) in [(&hello.name, "hello.name"), (&hello.policy, "hello.policy")] {
        if text.len() > MAX_NAME {
            let message = format!("{field} is {} bytes long, at most {MAX_NAME} are allowed", text.len());
            return Err(status::invalid(field, message));
        }
    }
    let (len, version) = (hello.observation_len as usize, hello.observation_version);
    let sees_others = [false, true].into_iter().find(|sees_others| observation_len(*sees_others) == len);
    let Some(sees_others) = sees_others.filter(|_| version == OBSERVATION_VERSION) else {
        let message = format!(
            "the worker expects observations of {len} values, version {version}; this server sends {OBSERVATION_LEN}, or {OBSERVATION_WITH_OTHERS_LEN} with others, version {OBSERVATION_VERSION}: update the worker"
        );
        return Err(status::failure(Reason::ObservationMismatch, message));
    };
    Ok(Hello { name: hello.name, policy: hello.policy, capacity: hello.capacity, sees_others })
}

/// Reads the settings of a new environment on the map of `source`, or on a game's own level.
///
/// # Errors
/// If a number is out of range.
pub fn env_settings(request: &wire::CreateEnvRequest, source: Option<BaseMap>) -> Result<EnvSettings, FieldError> {
    let body = convert::body(request.body.as_ref())?;
    let episodes =
        if request.goals.is_empty() { endless(request)? } else { Episodes::Once(env_goals(&request.goals)?) };
    Ok(EnvSettings { source, body, solid_npcs: request.solid_npcs, episodes })
}

/// Reads endless episodes with goals at random.
fn endless(request: &wire::CreateEnvRequest) -> Result<Episodes, FieldError> {
    let npc_count = convert::in_range(f64::from(request.npc_count), 1.0, MAX_ENV_NPCS, "npc_count")? as usize;
    let nearest = convert::in_range(f64::from(request.goal_min_m), 0.0, MAX_GOAL_M, "goal_min_m")?;
    let farthest = match request.goal_max_m {
        0.0 => MAX_GOAL_M,
        farthest => convert::in_range(f64::from(farthest), nearest, MAX_GOAL_M, "goal_max_m")?,
    };
    Ok(Episodes::Endless { npc_count, band: (nearest as f32, farthest as f32), seed: request.seed })
}

/// Reads episodes with given starts and goals.
fn env_goals(goals: &[wire::EnvGoal]) -> Result<Vec<Goal>, FieldError> {
    convert::in_range(goals.len() as f64, 1.0, MAX_ENV_NPCS, "goals")?;
    let goal = |it: &wire::EnvGoal| {
        let yaw = convert::in_range(f64::from(it.yaw), -MAX_YAW, MAX_YAW, "goals.yaw")? as f32;
        Ok(Goal {
            start: convert::point(it.start.as_ref(), "goals.start")?,
            yaw,
            goal: convert::point(it.goal.as_ref(), "goals.goal")?,
        })
    };
    goals.iter().map(goal).collect()
}

/// Reads the actions and the routes of an environment's NPCs.
///
/// # Errors
/// INVALID_ARGUMENT if there is not one action for each of `npc_count` NPCs, a value is not finite, a route is out of range, or an NPC has
/// two routes.
pub fn env_actions(actions: Option<wire::EnvActions>, npc_count: usize) -> Result<(Vec<Action>, Vec<Route>), Status> {
    let wire::EnvActions { actions, routes } = actions.ok_or(FieldError::Missing("actions"))?;
    let values = convert::unpack(&actions, npc_count * ACTION_LEN, "actions.actions")?;
    let actions =
        actions_of(&values, |idx| idx as u64).map_err(|message| status::invalid("actions.actions", message))?;
    let routes = env_routes(&routes, npc_count)?;
    each_once(routes.iter().map(|route| route.npc_idx as u64).collect(), "actions.routes.npc")?;
    Ok((actions, routes))
}

/// Checks that `field` names each NPC at most once.
fn each_once(mut npcs: Vec<u64>, field: &'static str) -> Result<(), Status> {
    npcs.sort_unstable();
    let Some(pair) = npcs.windows(2).find(|pair| pair[0] == pair[1]) else { return Ok(()) };
    Err(status::invalid(field, format!("{field} names npc {} twice", pair[0])))
}

fn env_routes(routes: &[wire::EnvRoute], npc_count: usize) -> Result<Vec<Route>, FieldError> {
    at_most(npc_count, routes.len(), "actions.routes", "routes")?;
    let route = |it: &wire::EnvRoute| {
        let most = npc_count.saturating_sub(1) as f64;
        let npc_idx = convert::in_range(f64::from(it.npc), 0.0, most, "actions.routes.npc")? as usize;
        if it.waypoints.is_empty() {
            return Err(FieldError::Missing("actions.routes.waypoints"));
        }
        at_most(MAX_ROUTE, it.waypoints.len(), "actions.routes.waypoints", "places")?;
        let place = |place| convert::point(Some(place), "actions.routes.waypoints");
        let yaw = convert::in_range(f64::from(it.yaw), -MAX_YAW, MAX_YAW, "actions.routes.yaw")? as f32;
        let start = it.start.as_ref().map(|start| convert::point(Some(start), "actions.routes.start")).transpose()?;
        let waypoints = it.waypoints.iter().map(place).collect::<Result<_, FieldError>>()?;
        Ok(Route { npc_idx, start: start.map(|start| (start, yaw)), waypoints })
    };
    routes.iter().map(route).collect()
}

fn at_most(limit: usize, found: usize, field: &'static str, what: &'static str) -> Result<(), FieldError> {
    if found <= limit { Ok(()) } else { Err(FieldError::Count { field, what, found, limit }) }
}

// --- onto the wire ---

/// Converts a time mode.
pub fn time_mode_to_wire(mode: TimeMode) -> wire::TimeMode {
    match mode {
        TimeMode::Realtime => wire::TimeMode::Realtime,
        TimeMode::Lockstep => wire::TimeMode::Lockstep,
    }
}

/// Converts what a body finds on a map.
pub fn survey_to_wire(survey: &Survey) -> wire::Survey {
    wire::Survey {
        body: Some(convert::body_to_wire(&survey.body)),
        places: survey.places as u32,
        islands: survey.islands as u32,
        connected_on_foot: survey.connected_on_foot as f32,
        connected: survey.connected as f32,
        cut_off_places: survey.cut_off_places as u32,
        cut_off: survey.cut_off.iter().copied().map(convert::to_wire).collect(),
    }
}

/// Converts a world.
pub fn world_to_wire(world: &WorldSummary) -> wire::World {
    wire::World {
        world_id: world.id.0,
        map: world.map.spec().map(convert::map_spec_to_wire),
        map_hash: world.map.built_hash().to_hex(),
        mode: time_mode_to_wire(world.mode).into(),
        npc_count: world.npc_count as u32,
        tick: world.tick.0,
        bodies: world.bodies.iter().map(convert::body_to_wire).collect(),
        solid_npcs: world.solid_npcs,
        piece_count: world.map.pieces().len() as u32,
        edited_map_hash: world.map.hash().to_hex(),
    }
}

/// Converts the state of an NPC.
pub fn npc_to_wire(npc: &NpcState) -> wire::Npc {
    wire::Npc {
        npc_id: npc.id.0,
        position: Some(convert::to_wire(npc.position)),
        velocity: Some(convert::to_wire(npc.velocity)),
        yaw: npc.yaw,
        status: npc_status_to_wire(npc.status).into(),
        goal: npc.goal.map(convert::to_wire),
        waypoint: npc.waypoint.map(convert::to_wire),
        last_outcome: convert::outcome(npc.last_outcome).into(),
        attempts_begun: npc.attempts_begun,
        attempts_ended: npc.attempts_ended,
        worker_id: npc.worker.map_or(0, |worker| worker.0),
        support: support_to_wire(npc.support).into(),
        ability: convert::ability_to_wire(npc.ability).into(),
        cause: convert::outcome(npc.cause).into(),
        body_idx: npc.body.0.into(),
    }
}

fn npc_status_to_wire(status: NpcStatus) -> wire::NpcStatus {
    match status {
        NpcStatus::Idle => wire::NpcStatus::Idle,
        NpcStatus::Seeking => wire::NpcStatus::Seeking,
        NpcStatus::Down => wire::NpcStatus::Down,
    }
}

fn support_to_wire(support: Support) -> wire::Support {
    match support {
        Support::Air => wire::Support::Air,
        Support::Ground => wire::Support::Ground,
        Support::Steep => wire::Support::Steep,
        Support::Water => wire::Support::Water,
        Support::ZipLine => wire::Support::ZipLine,
    }
}

/// Converts what has changed about an NPC.
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
        status: changed(old.status, npc.status).map(|status| npc_status_to_wire(status).into()),
        goal: place(old.goal, npc.goal),
        goal_cleared: old.goal.is_some() && npc.goal.is_none(),
        waypoint: place(old.waypoint, npc.waypoint),
        waypoint_cleared: old.waypoint.is_some() && npc.waypoint.is_none(),
        last_outcome: changed(old.last_outcome, npc.last_outcome).map(|end| convert::outcome(end).into()),
        attempts_begun: changed(old.attempts_begun, npc.attempts_begun),
        attempts_ended: changed(old.attempts_ended, npc.attempts_ended),
        worker_id: changed(old.worker, npc.worker).map(|worker| worker.map_or(0, |worker| worker.0)),
        support: changed(old.support, npc.support).map(|support| support_to_wire(support).into()),
        ability: changed(old.ability, npc.ability).map(|ability| convert::ability_to_wire(ability).into()),
        cause: changed(old.cause, npc.cause).map(|cause| convert::outcome(cause).into()),
    }
}

/// Converts the events of one tick, with the cursor of the last; if `only` is not empty, only events of its NPCs are included.
/// Returns `None` if there are no events.
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
    let kind = match event.kind {
        EventKind::Spawned { position } => Event::Spawned(wire::Spawned { position: point(position) }),
        EventKind::AttemptBegan { attempt, goal } => {
            Event::AttemptBegan(wire::AttemptBegan { attempt, goal: point(goal) })
        }
        EventKind::AttemptEnded { attempt, end, goal, seconds } => Event::AttemptEnded(wire::AttemptEnded {
            attempt,
            outcome: convert::outcome(end).into(),
            goal: goal.and_then(point),
            seconds: seconds.0,
        }),
        EventKind::Jumped { ability, position } => {
            Event::Jumped(wire::Jumped { ability: convert::ability_to_wire(ability).into(), position: point(position) })
        }
        EventKind::Landed { position, impact_speed } => {
            Event::Landed(wire::Landed { position: point(position), impact_speed })
        }
        EventKind::Rode { ability, position } => {
            Event::Rode(wire::Rode { ability: convert::ability_to_wire(ability).into(), position: point(position) })
        }
        EventKind::Died { cause, attempt, position } => Event::Died(wire::Died {
            cause: convert::outcome(Some(cause)).into(),
            attempt: attempt.unwrap_or(0),
            position: point(position),
        }),
        EventKind::Teleported { position } => Event::Teleported(wire::Teleported { position: point(position) }),
        EventKind::Removed => Event::Removed(wire::Removed {}),
    };
    wire::NpcEvent { sequence: event.sequence, npc_id: event.npc.0, event: Some(kind) }
}

/// Converts the statistics of a world.
pub fn stats_to_wire(stats: &WorldStats) -> wire::WorldStats {
    let WorldStats { counters, times, without_worker } = stats;
    let [reached, fell, burnt, drowned, no_progress, unreachable] = counters.ends;
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
        ticks_late: counters.ticks_late,
        tick_histogram: times.counts().to_vec(),
        answers_stale: counters.stale,
        answers_invalid: counters.invalid,
        plans_failed: counters.plans_failed,
        npcs_without_worker: *without_worker,
    }
}

/// Converts the part of a snapshot that a reader is sent.
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

/// Converts the plan of an NPC.
pub fn npc_plan_to_wire(plan: &NpcPlan) -> wire::NpcPlan {
    let leg = |leg: &PlanLeg| wire::PlanLeg {
        ability: convert::ability_to_wire(leg.ability).into(),
        seconds: leg.seconds.0,
        chance: leg.chance.get() as f32,
    };
    wire::NpcPlan {
        waypoints: plan.waypoints.iter().copied().map(convert::to_wire).collect(),
        legs: plan.legs.iter().map(leg).collect(),
        no_path: plan.no_path.clone(),
    }
}

/// Converts an ended attempt.
pub fn ended_attempt_to_wire(ended: &EndedAttempt) -> wire::AttemptEnded {
    wire::AttemptEnded {
        attempt: ended.attempt,
        outcome: convert::outcome(Some(ended.end)).into(),
        goal: ended.goal.map(convert::to_wire),
        seconds: ended.seconds.0,
    }
}

/// Converts what an NPC sees, ray by ray.
pub fn rays_to_wire(sight: &Sight) -> Vec<wire::Ray> {
    let surface = |seen: Option<Seen>| match seen {
        None => wire::Surface::Unspecified,
        Some(Seen::Surface(surface)) => surface_to_wire(surface),
        Some(Seen::Body) => wire::Surface::Body,
    };
    let ray = |&(end, seen): &(Vec3, Option<Seen>)| wire::Ray {
        end: Some(convert::to_wire(end)),
        surface: surface(seen).into(),
    };
    sight.ends.iter().map(ray).collect()
}

/// Converts a message to a worker.
///
/// # Errors
/// A [`Goodbye`](crate::messages::Goodbye) becomes the status that ends the stream.
pub fn to_worker(message: ToWorker) -> Result<wire::WorkResponse, Status> {
    use wire::work_response::Message;
    let message = match message {
        ToWorker::Welcome(worker) => Message::Welcome(wire::Welcome { worker_id: worker.0 }),
        ToWorker::Release(world, npcs) => {
            Message::Release(wire::Release { world_id: world.0, npc_ids: npc_ids(&npcs) })
        }
        ToWorker::Assignment(assignment) => Message::Assignment(assignment_to_wire(&assignment)),
        ToWorker::Ended(WorldId(world_id), ended) => Message::Ended(wire::AttemptsEnded {
            world_id,
            npc_ids: ended.iter().map(|ended| ended.npc.0).collect(),
            attempts: ended.iter().map(|ended| ended.attempt).collect(),
            outcomes: ended.iter().map(|ended| convert::outcome(Some(ended.end)).into()).collect(),
        }),
        ToWorker::Edited(WorldId(world_id), pieces) => {
            Message::Edited(wire::MapEdited { world_id, pieces: pieces.iter().map(piece_to_wire).collect() })
        }
        ToWorker::Over(WorldId(world_id)) => Message::Over(wire::WorldOver { world_id }),
        ToWorker::Observations(batch) => Message::Observations(observations_to_wire(batch)),
        ToWorker::Goodbye(goodbye) => return Err(goodbye.into()),
    };
    Ok(wire::WorkResponse { message: Some(message) })
}

fn npc_ids(npcs: &[NpcId]) -> Vec<u64> {
    npcs.iter().map(|npc| npc.0).collect()
}

fn assignment_to_wire(assignment: &Assignment) -> wire::Assignment {
    wire::Assignment {
        world_id: assignment.world.0,
        map: assignment.spec.as_ref().map(convert::map_spec_to_wire),
        npc_ids: npc_ids(&assignment.npcs),
        mode: time_mode_to_wire(assignment.mode).into(),
        map_hash: assignment.map_hash.to_hex(),
        body: Some(convert::body_to_wire(&assignment.body.1)),
        body_idx: assignment.body.0.0.into(),
        pieces: assignment.pieces.iter().map(piece_to_wire).collect(),
        solid_npcs: assignment.solid_npcs,
    }
}

fn observations_to_wire(batch: ObservationBatch) -> wire::ObservationBatch {
    let pack_points = |points: &[Vec3]| convert::pack(points.iter().flat_map(|point| point.to_array()));
    wire::ObservationBatch {
        world_id: batch.world.0,
        tick: batch.tick.0,
        npc_ids: npc_ids(&batch.npcs),
        observations: convert::pack(batch.observations),
        positions: pack_points(&batch.positions),
        goals: pack_points(&batch.goals),
        attempts: batch.attempts,
        waypoint_reached: batch.waypoint_reached,
        grounded: batch.grounded,
        states: batch.states,
        state_version: NPC_STATE_VERSION,
        body_idx: batch.body.0.into(),
        movers: batch.movers,
    }
}

/// Converts the result of a step of an environment.
pub fn results_to_wire(results: StepResults) -> wire::EnvResults {
    let ends = results.ended.iter().map(|ended| wire::EnvEnd {
        npc: ended.npc_idx as u32,
        outcome: convert::outcome(Some(ended.end)).into(),
        final_observation: convert::pack(ended.final_observation.iter().copied()),
    });
    wire::EnvResults {
        ends: ends.collect(),
        observations: convert::pack(results.observations),
        rewards: convert::pack(results.rewards),
        positions: convert::pack_points(results.positions),
        abilities: results.abilities.into_iter().map(|ability| convert::ability_to_wire(ability) as u8).collect(),
        passed: results.passed,
    }
}

/// Converts one of `tile_count` tiles.
pub fn tile_to_wire(tile: &TileMesh, tile_count: usize) -> wire::GetMeshResponse {
    let [tile_x, tile_z] = tile.place;
    wire::GetMeshResponse {
        tile_x,
        tile_z,
        tile_count: tile_count as u32,
        positions: convert::pack(tile.positions.iter().flat_map(|point| point.to_array())),
        indices: tile.indices.iter().flat_map(|index| index.to_le_bytes()).collect(),
        surfaces: tile.surfaces.iter().map(|&surface| surface_to_wire(surface) as u8).collect(),
    }
}

/// Converts a surface.
fn surface_to_wire(surface: Surface) -> wire::Surface {
    match surface {
        Surface::Ground => wire::Surface::Ground,
        Surface::Water => wire::Surface::Water,
        Surface::Lava => wire::Surface::Lava,
        Surface::Pad => wire::Surface::Pad,
        Surface::ZipLine => wire::Surface::ZipLine,
        Surface::Teleporter => wire::Surface::Teleporter,
        Surface::Jetpack => wire::Surface::Jetpack,
    }
}

/// Converts the features of a map.
pub fn features_to_wire(map: &Map) -> wire::GetFeaturesResponse {
    let placed = map.placed();
    let line = |from, to, two_way| wire::LineFeature {
        from: Some(convert::to_wire(from)),
        to: Some(convert::to_wire(to)),
        two_way,
    };
    let pools = placed.pools.iter().map(|pool| {
        let (half_x, half_z) = pool.outline.half_extents();
        wire::PoolFeature {
            centre: Some(convert::to_wire(pool.centre)),
            half_x,
            half_z,
            round: matches!(pool.outline, Outline::Round { .. }),
            depth: pool.depth,
            lava: pool.liquid == Liquid::Lava,
        }
    });
    let pads =
        placed.pads.iter().map(|pad| wire::PadFeature { centre: Some(convert::to_wire(pad.centre)), speed: pad.speed });
    wire::GetFeaturesResponse {
        size: Some(convert::map_size_to_wire(map.size())),
        pools: pools.collect(),
        pads: pads.collect(),
        zip_lines: placed.zip_lines.iter().map(|it| line(it.from, it.to, false)).collect(),
        teleporters: placed.teleporters.iter().map(|it| line(it.from, it.to, it.two_way)).collect(),
        jetpacks: placed.jetpacks.iter().map(|it| convert::to_wire(it.centre)).collect(),
    }
}
