//! Calls for many NPCs: each item has its own result.

use crate::hosted::SpawnOrder;
use crate::ids::NpcId;
use crate::wire::finite;
use crate::worlds::WorldsError;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_world::Vec3;
use tonic::Status;

/// Most items in a batch.
const MAX_ITEMS: usize = 4096;

/// Checks the number of items in a batch.
///
/// # Errors
/// OUT_OF_RANGE if there are more than 4096.
pub fn check_count(count: usize, field: &str) -> Result<(), Status> {
    if count > MAX_ITEMS {
        let message = format!("{field} has {count} items, at most {MAX_ITEMS} are allowed in one call");
        return Err(status::too_large(field, message));
    }
    Ok(())
}

impl From<FieldError> for WorldsError {
    fn from(error: FieldError) -> Self {
        WorldsError::BadItem(error.field(), error.to_string())
    }
}

/// Reads an item of BatchSpawnNpcs, or the request of SpawnNpc.
pub fn spawn(spawn: &wire::Spawn) -> Result<SpawnOrder, FieldError> {
    let wire::Spawn { position, yaw, goal, body } = spawn;
    Ok(SpawnOrder {
        position: convert::point(position.as_ref(), "position")?,
        yaw: finite(*yaw, "yaw")?,
        goal: goal.map(|goal| convert::point(Some(&goal), "goal")).transpose()?,
        body: body.as_ref().map(|body| convert::body(Some(body))).transpose()?,
    })
}

/// Reads an item of BatchSetGoals, or the request of SetGoal: the NPC and its goal, m.
pub fn goal(request: &wire::SetGoalRequest) -> Result<(NpcId, Vec3), FieldError> {
    Ok((NpcId(request.npc_id), convert::point(request.goal.as_ref(), "goal")?))
}

/// Reads an item of BatchTeleportNpcs, or the request of TeleportNpc: the NPC, its position, m, and its heading, rad.
pub fn teleport(request: &wire::TeleportNpcRequest) -> Result<(NpcId, (Vec3, f32)), FieldError> {
    let position = convert::point(request.position.as_ref(), "position")?;
    Ok((NpcId(request.npc_id), (position, finite(request.yaw, "yaw")?)))
}

/// Converts the error of an item: code, reason and message are those of the single call.
pub fn item_error(error: WorldsError) -> wire::ItemError {
    let status = Status::from(error);
    wire::ItemError {
        code: status.code().into(),
        reason: Reason::of(&status).map(|reason| reason.name().to_owned()).unwrap_or_default(),
        message: status.message().to_owned(),
    }
}

/// What is kept of an item of BatchSpawnNpcs for repeated calls.
pub type Spawned = Result<NpcId, Reason>;

/// Converts the result of an item of BatchSpawnNpcs: what is kept of it, and the whole.
pub fn spawn_result(result: Result<NpcId, WorldsError>) -> (Spawned, wire::SpawnResult) {
    use wire::spawn_result::Result as Kind;
    match result {
        Ok(npc) => (Ok(npc), wire::SpawnResult { result: Some(Kind::NpcId(npc.0)) }),
        Err(error) => {
            let error = item_error(error);
            let reason = Reason::ALL.iter().find(|reason| reason.name() == error.reason);
            let kept = Err(reason.copied().unwrap_or(Reason::Internal));
            (kept, wire::SpawnResult { result: Some(Kind::Error(error)) })
        }
    }
}

/// The result of an item of a repeated BatchSpawnNpcs: of an error, code and reason are those of the first call.
pub fn kept_result(kept: &Spawned) -> wire::SpawnResult {
    use wire::spawn_result::Result as Kind;
    let result = match kept {
        Ok(npc) => Kind::NpcId(npc.0),
        Err(reason) => Kind::Error(wire::ItemError {
            code: reason.code().into(),
            reason: reason.name().to_owned(),
            message: format!("the first call with this request_id was refused: {}", reason.meaning()),
        }),
    };
    wire::SpawnResult { result: Some(result) }
}

/// Converts the result of an item that returns nothing but success or an error.
pub fn item_result(result: Result<(), WorldsError>) -> wire::ItemResult {
    wire::ItemResult { error: result.err().map(item_error) }
}
