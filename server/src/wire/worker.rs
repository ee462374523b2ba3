//! Messages of workers and to workers on the wire.

use super::each_once;
use crate::hosted::{NpcPlan, PlanLeg, Standing};
use crate::ids::{NpcId, WorldId};
use crate::messages::{Answer, Assignment, Decision, Hello, ObservationBatch, ToWorker};
use surefoot_net::status;
use surefoot_planner::{Tags, Zone};
use surefoot_proto::convert::{self, FieldError, WireEnum};
use surefoot_proto::movement;
use surefoot_proto::pieces::piece_to_wire;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::zones;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::{OBSERVATION_VERSION, observation_len};
use surefoot_world::{
    Action, Arrival, Chance, End, Gait, MoverAt, MoverId, NPC_STATE_VERSION, OBSERVATION_LEN,
    OBSERVATION_WITH_OTHERS_LEN, Seconds, StopIdx, Tick, Vec3,
};
use tonic::Status;

/// Greatest capacity of a worker, NPCs.
const MAX_CAPACITY: f64 = 65_536.0;
/// Longest name of a worker or of its policy, bytes.
const MAX_NAME: usize = 64;
/// Most waypoints in a plan.
const MAX_WAYPOINTS: usize = 4096;

/// Reads a worker's answer. An invalid number affects only its NPC: it is left out and counted.
pub fn answer(batch: wire::ActionBatch) -> Result<Answer, Status> {
    let count = batch.npc_ids.len();
    let values = convert::unpack(&batch.actions, count * ACTION_LEN, "actions.actions")?;
    each_once(batch.npc_ids.clone(), "actions.npc_ids")?;
    if batch.attempts.len() != count {
        let message = format!("actions.attempts has {} values for {count} NPCs", batch.attempts.len());
        return Err(status::invalid("actions.attempts", message));
    }
    if !batch.standings.is_empty() && batch.standings.len() != count {
        let message = format!("actions.standings has {} values for {count} NPCs", batch.standings.len());
        return Err(status::invalid("actions.standings", message));
    }
    let mut answer = Answer {
        tick: Tick(batch.tick),
        plans_failed: batch.plans_failed,
        observes: batch.observes,
        ..Answer::default()
    };
    for (idx, (npc, attempt)) in batch.npc_ids.into_iter().zip(batch.attempts).enumerate() {
        let row = std::array::from_fn(|at| values[idx * ACTION_LEN + at]);
        let action = Action::from_array(row).ok();
        answer.invalid += u64::from(action.is_none());
        // Reasons that this version does not know are left out.
        let standing = batch.standings.get(idx).and_then(|&reason| Standing::from_wire(reason.into()));
        answer.decisions.push(Decision { npc: NpcId(npc), attempt, action, standing });
    }
    for wire::Waypoint { npc_id, position, attempt, stands } in batch.waypoints {
        let arrival = if stands { Arrival::Stand } else { Arrival::Pass };
        match convert::point(position.as_ref(), "actions.waypoints.position") {
            Ok(position) => answer.waypoints.push((NpcId(npc_id), attempt, (position, arrival))),
            Err(_) => answer.invalid += 1,
        }
    }
    for wire::CarriedPlan { npc_id, plan, attempt } in batch.plans {
        match npc_plan(plan) {
            Ok(plan) => answer.plans.push((NpcId(npc_id), attempt, plan)),
            Err(_) => answer.invalid += 1,
        }
    }
    for prediction in batch.predictions {
        match movement::trajectory(&prediction) {
            Ok(trajectory) => answer.predictions.push((NpcId(prediction.npc_id), prediction.attempt, trajectory)),
            Err(_) => answer.invalid += 1,
        }
    }
    // Calls of movers that do not exist are ignored.
    let call = |call: wire::MoverCall| {
        let (mover, stop) = (MoverId(u16::try_from(call.mover).ok()?), StopIdx(u8::try_from(call.stop).ok()?));
        Some(MoverAt { mover, stop })
    };
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
            "the worker expects observations of {len} values, version {version}; this server sends {OBSERVATION_LEN}, \
             or {OBSERVATION_WITH_OTHERS_LEN} with others, version {OBSERVATION_VERSION}: update the worker"
        );
        return Err(status::failure(Reason::ObservationMismatch, message));
    };
    Ok(Hello { name: hello.name, policy: hello.policy, capacity: hello.capacity, sees_others })
}

/// Converts a message to a worker. A [`Goodbye`](crate::messages::Goodbye) becomes the status that ends the stream.
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
        ToWorker::ZonesChanged { world: WorldId(world_id), zones, tags } => {
            let changed = Some(world_zones_to_wire(zones.as_deref(), &tags));
            Message::ZonesChanged(wire::ZonesChanged { world_id, changed })
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

/// Converts zones, unless they are unchanged, and tags of NPCs.
fn world_zones_to_wire(zones: Option<&[Zone]>, tags: &[(NpcId, Tags)]) -> wire::WorldZones {
    wire::WorldZones {
        zones: zones.map(|zones| wire::ZoneList { zones: zones.iter().map(zones::zone_to_wire).collect() }),
        tags: tags.iter().map(|(npc, tags)| zones::npc_tags_to_wire(npc.0, tags)).collect(),
    }
}

fn assignment_to_wire(assignment: &Assignment) -> wire::Assignment {
    let has_tags = assignment.tags.iter().any(|(_, tags)| !tags.is_empty());
    let has_zones = has_tags || !assignment.zones.is_empty();
    wire::Assignment {
        world_id: assignment.world.0,
        map: assignment.spec.as_ref().map(convert::map_spec_to_wire),
        npc_ids: npc_ids(&assignment.npcs),
        mode: assignment.mode.to_wire().into(),
        map_hash: assignment.map_hash.to_hex(),
        body: Some(convert::body_to_wire(&assignment.body.1)),
        body_idx: assignment.body.0.0.into(),
        pieces: assignment.pieces.iter().map(piece_to_wire).collect(),
        solid_npcs: assignment.solid_npcs,
        zones: has_zones.then(|| world_zones_to_wire(Some(&assignment.zones), &assignment.tags)),
    }
}

fn observations_to_wire(batch: ObservationBatch) -> wire::ObservationBatch {
    let pack_points = |points: &[Vec3]| convert::pack(points.iter().flat_map(|point| point.to_array()));
    let are_usual = batch.gaits.iter().all(|gait| *gait == Gait::default());
    let gaits = batch.gaits.into_iter().filter(|_| !are_usual);
    wire::ObservationBatch {
        world_id: batch.world.0,
        tick: batch.tick.0,
        npc_ids: npc_ids(&batch.npcs),
        observations: convert::pack(batch.observations),
        positions: pack_points(&batch.positions),
        goals: pack_points(&batch.goals),
        touches: batch.touches,
        gaits: gaits.map(convert::gait_to_wire).collect(),
        attempts: batch.attempts,
        waypoint_reached: batch.waypoint_reached,
        grounded: batch.grounded,
        states: batch.states,
        state_version: NPC_STATE_VERSION,
        body_idx: batch.body.0.into(),
        movers: batch.movers,
    }
}
