//! What workers send, checked.

use crate::env::actions_of;
use crate::hosted::Answer;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::status;
use surefoot_proto::world::v1 as wire;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::sense::OBSERVATION_VERSION;
use tonic::Status;

/// Most NPCs that one worker may offer to carry.
const MAX_CAPACITY: f64 = 65_536.0;
/// Longest name of a worker or its policy, bytes.
const MAX_NAME: usize = 64;
/// Most waypoints of a plan.
const MAX_WAYPOINTS: usize = 4096;

/// Reads an answer.
///
/// # Errors
/// INVALID_ARGUMENT if an array has the wrong length, a number is not finite, or an NPC is named twice.
pub fn answer(batch: wire::ActionBatch) -> Result<Answer, Status> {
    let count = batch.npc_ids.len();
    let values = convert::unpack(&batch.actions, count * ACTION_LEN, "actions.actions")?;
    let mut seen: Vec<u64> = batch.npc_ids.clone();
    seen.sort_unstable();
    if let Some(pair) = seen.windows(2).find(|pair| pair[0] == pair[1]) {
        let message = format!("actions.npc_ids names npc {} twice", pair[0]);
        return Err(status::invalid("actions.npc_ids", message));
    }
    let actions =
        actions_of(&values, |idx| batch.npc_ids[idx]).map_err(|message| status::invalid("actions.actions", message))?;
    let waypoints = batch.waypoints.iter().map(|waypoint| {
        Ok((waypoint.npc_id, convert::point(waypoint.position.as_ref(), "actions.waypoints.position")?))
    });
    let waypoints = waypoints.collect::<Result<_, FieldError>>()?;
    let plans = batch.plans.into_iter().map(|carried| Ok((carried.npc_id, plan(carried.plan)?)));
    Ok(Answer {
        tick: batch.tick,
        actions,
        waypoints,
        plans: plans.collect::<Result<_, FieldError>>()?,
        npc_ids: batch.npc_ids,
        gave_up: batch.gave_up,
    })
}

fn plan(plan: Option<wire::NpcPlan>) -> Result<wire::NpcPlan, FieldError> {
    let plan = plan.ok_or(FieldError::Missing("actions.plans.plan"))?;
    let count = plan.waypoints.len() as f64;
    convert::in_range(count, 1.0, MAX_WAYPOINTS as f64, "the count of actions.plans.plan.waypoints")?;
    convert::in_range(plan.legs.len() as f64, count, count, "the count of actions.plans.plan.legs")?;
    for waypoint in &plan.waypoints {
        convert::point(Some(waypoint), "actions.plans.plan.waypoints")?;
    }
    for leg in &plan.legs {
        convert::in_range(f64::from(leg.seconds), 0.0, f64::from(f32::MAX), "actions.plans.plan.legs.seconds")?;
        convert::in_range(f64::from(leg.chance), 0.0, 1.0, "actions.plans.plan.legs.chance")?;
    }
    Ok(plan)
}

/// Reads the first message of a worker.
///
/// # Errors
/// INVALID_ARGUMENT if it is another message or a field is out of range, FAILED_PRECONDITION if the worker expects other observations.
pub fn hello(first: Option<wire::WorkRequest>) -> Result<wire::Hello, Status> {
    let Some(wire::work_request::Message::Hello(hello)) = first.and_then(|request| request.message) else {
        return Err(Status::invalid_argument("the first message must be hello"));
    };
    convert::in_range(f64::from(hello.capacity), 1.0, MAX_CAPACITY, "hello.capacity")?;
    for (text, field) in [(&hello.name, "hello.name"), (&hello.policy, "hello.policy")] {
        if text.len() > MAX_NAME {
            let message = format!("{field} is {} bytes long, allowed are {MAX_NAME}", text.len());
            return Err(status::invalid(field, message));
        }
    }
    let (len, version) = (hello.observation_len as usize, hello.observation_version);
    if (len, version) != (OBSERVATION_LEN, OBSERVATION_VERSION) {
        return Err(Status::failed_precondition(format!(
            "hello expects observations of {len} values, version {version}; this server sends {OBSERVATION_LEN}, version {OBSERVATION_VERSION}: update the worker"
        )));
    }
    Ok(hello)
}
