//! What a worker sends, checked before anything acts on it.

use crate::hosted::Answer;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::world::v1 as wire;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::sense::OBSERVATION_VERSION;
use tonic::Status;

/// Most NPCs that one worker may offer to carry.
const MAX_CAPACITY: f64 = 65_536.0;
/// Longest name of a worker, bytes.
const MAX_NAME: usize = 64;

/// A worker's answer, if every part of it can be used.
///
/// # Errors
/// Names the field that is of the wrong length, names an NPC twice, or holds a number that is not finite.
pub fn check_answer(batch: &wire::ActionBatch) -> Result<Answer, Status> {
    let count = batch.npc_ids.len();
    let values = convert::unpack(&batch.actions, count * ACTION_LEN, "actions.actions")?;
    let mut seen: Vec<u64> = batch.npc_ids.clone();
    seen.sort_unstable();
    if let Some(pair) = seen.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(Status::invalid_argument(format!("actions.npc_ids names npc {} twice", pair[0])));
    }
    let actions = values.as_chunks::<ACTION_LEN>().0.iter().enumerate().map(|(idx, row)| {
        Action::from_array(*row)
            .map_err(|error| Status::invalid_argument(format!("npc {}: {error}", batch.npc_ids[idx])))
    });
    let waypoints = batch.waypoints.iter().map(|waypoint| {
        Ok((waypoint.npc_id, convert::point(waypoint.position.as_ref(), "actions.waypoints.position")?))
    });
    Ok(Answer {
        tick: batch.tick,
        npc_ids: batch.npc_ids.clone(),
        actions: actions.collect::<Result<_, Status>>()?,
        waypoints: waypoints.collect::<Result<_, FieldError>>()?,
        gave_up: batch.gave_up.clone(),
    })
}

/// The introduction of a worker that expects what this server sends.
///
/// # Errors
/// If the message is another one, a field is out of range, or the worker expects other observations.
pub fn check_hello(hello: Option<&wire::WorkRequest>) -> Result<wire::Hello, Status> {
    let Some(wire::work_request::Message::Hello(hello)) = hello.and_then(|request| request.message.as_ref()) else {
        return Err(Status::invalid_argument("the first message must be hello"));
    };
    convert::in_range(f64::from(hello.capacity), 1.0, MAX_CAPACITY, "hello.capacity")?;
    if hello.name.len() > MAX_NAME {
        return Err(Status::invalid_argument(format!(
            "hello.name is {} bytes long, allowed are {MAX_NAME}",
            hello.name.len()
        )));
    }
    let (len, version) = (hello.observation_len as usize, hello.observation_version);
    if (len, version) != (OBSERVATION_LEN, OBSERVATION_VERSION) {
        return Err(Status::failed_precondition(format!(
            "hello expects observations of {len} values, version {version}; this server sends {OBSERVATION_LEN}, version {OBSERVATION_VERSION}: update the worker"
        )));
    }
    Ok(hello.clone())
}
