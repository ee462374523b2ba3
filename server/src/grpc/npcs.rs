//! The calls about NPCs. In a batch, each item has its own result.

use super::{Call, Reply, WorldApi, frame_on};
use crate::hosted::{GoalOrder, GoalSet, HostedWorld, NpcError, NpcState, Pursuit, SpawnOrder, Target};
use crate::ids::{NpcId, WorldId};
use crate::wire::{finite, no_worker_to_wire, npc_to_wire, region as convert_region};
use crate::worlds::{NpcAccess, WorldsError};
use std::sync::{Arc, OnceLock};
use surefoot_net::idempotency::Repeatable;
use surefoot_net::paging::{PageSize, page_by_id};
use surefoot_net::serving::Caller;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::{CallFrame, Coordinates, Place};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::zones;
use surefoot_world::map::LevelFrame;
use surefoot_world::{Arrival, PlayerSlot, Vec3};
use tonic::Status;

/// Most items in a batch.
const MAX_ITEMS: usize = 4096;
/// Highest speed of a goal that moves, m/s.
const MAX_TARGET_SPEED: f64 = 100.0;
/// Page size of ListNpcs.
const NPC_PAGE: PageSize = PageSize { default: 1000, max: 4096 };

/// Checks the number of items in a batch.
pub(super) fn check_count(count: usize, field: &str) -> Result<(), Status> {
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

pub async fn spawn_npc(api: &WorldApi, call: Call<wire::SpawnNpcRequest>) -> Reply<wire::SpawnNpcResponse> {
    let (caller, request) = call;
    let world = WorldId(request.world_id);
    let frame = frame_on(&api.worlds.handle(world)?, request.coordinates)?;
    let wire::SpawnNpcRequest { position, yaw, body, tags, gait, .. } = frame.to_map(request.clone());
    let order = spawn_order(&wire::Spawn { position, yaw, goal: None, body, tags, gait })?;
    let (worlds, owner) = (api.worlds.clone(), caller.clone());
    let spawn = async move { Ok(worlds.spawn(&owner, world, order).await?) };
    let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes: 0 };
    let npc = api.spawned.once(call, &request, spawn).await?;
    Ok(wire::SpawnNpcResponse { npc_id: npc.0, warning: warning_about(api, &caller, [npc]).await })
}

pub async fn batch_spawn_npcs(
    api: &WorldApi,
    call: Call<wire::BatchSpawnNpcsRequest>,
) -> Reply<wire::BatchSpawnNpcsResponse> {
    let (caller, request) = call;
    let count = request.spawns.len();
    check_count(count, "spawns")?;
    let frame = api.frame(request.coordinates, request.world_id)?;
    let orders = request.spawns.iter().map(|spawn| Ok(spawn_order(&frame.to_map(spawn.clone()))?)).collect();
    let (worlds, owner, world) = (api.worlds.clone(), caller.clone(), WorldId(request.world_id));
    // The call that spawns also answers with the messages of errors, which are too large to be kept.
    let full = Arc::new(OnceLock::new());
    let answer = full.clone();
    let spawn = async move {
        let results = worlds.spawn_many(&owner, world, orders).await?;
        let (kept, results): (Vec<_>, Vec<_>) = results.into_iter().map(spawn_result).unzip();
        // The call runs at most once.
        let _ = answer.set(results);
        Ok(kept.into())
    };
    let answer_bytes = count * size_of::<Spawned>();
    let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes };
    let kept = api.spawned_batches.once(call, &request, spawn).await?;
    let full = Arc::try_unwrap(full).ok().and_then(OnceLock::into_inner);
    let warning = warning_about(api, &caller, kept.iter().filter_map(|npc| npc.as_ref().ok().copied())).await;
    let results = full.unwrap_or_else(|| kept.iter().map(kept_result).collect());
    Ok(wire::BatchSpawnNpcsResponse { results, warning })
}

pub async fn despawn_npc(api: &WorldApi, call: Call<wire::DespawnNpcRequest>) -> Reply<wire::DespawnNpcResponse> {
    let (caller, wire::DespawnNpcRequest { npc_id }) = call;
    let npc = NpcId(npc_id);
    api.worlds.with_npc(&caller, NpcAccess::Change, npc, move |world| world.despawn(npc)).await?;
    Ok(wire::DespawnNpcResponse {})
}

pub async fn batch_despawn_npcs(
    api: &WorldApi,
    call: Call<wire::BatchDespawnNpcsRequest>,
) -> Reply<wire::BatchDespawnNpcsResponse> {
    let (caller, wire::BatchDespawnNpcsRequest { npc_ids }) = call;
    let items = ids("npc_ids", npc_ids)?;
    let despawn = |world: &mut HostedWorld, npc, ()| world.despawn(npc);
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, despawn).await;
    Ok(wire::BatchDespawnNpcsResponse { results: results.into_iter().map(item_result).collect() })
}

pub async fn set_goal(api: &WorldApi, call: Call<wire::SetGoalRequest>) -> Reply<wire::SetGoalResponse> {
    let (caller, request) = call;
    let (npc, order) = goal_of(&request)?;
    let set = move |world: &mut HostedWorld| set_goal_on(world, npc, order);
    let set = api.worlds.with_npc(&caller, NpcAccess::Change, npc, set).await?;
    Ok(goal_response(set, warning_about(api, &caller, [npc]).await))
}

/// Converts a goal that was set.
pub(super) fn goal_response(
    (GoalSet { attempt, goal, moved_by_m }, frame): (GoalSet, CallFrame),
    warning: Option<wire::Warning>,
) -> wire::SetGoalResponse {
    let goal_used = Some(convert::to_wire(goal));
    frame.to_level(wire::SetGoalResponse { attempt, goal_used, moved_by_m, warning })
}

pub async fn batch_set_goals(
    api: &WorldApi,
    call: Call<wire::BatchSetGoalsRequest>,
) -> Reply<wire::BatchSetGoalsResponse> {
    let (caller, wire::BatchSetGoalsRequest { goals }) = call;
    check_count(goals.len(), "goals")?;
    let items = goals.iter().map(|goal| Ok(goal_of(goal)?)).collect();
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, set_goal_on).await;
    let set = goals.iter().zip(&results).filter(|(_, result)| result.is_ok());
    let warning = warning_about(api, &caller, set.map(|(goal, _)| NpcId(goal.npc_id))).await;
    Ok(wire::BatchSetGoalsResponse { results: results.into_iter().map(goal_result).collect(), warning })
}

/// Converts the result of an item that sets a goal.
pub(super) fn goal_result(result: Result<(GoalSet, CallFrame), WorldsError>) -> wire::SetGoalResult {
    use wire::set_goal_result::Result as Kind;
    match result {
        Ok((GoalSet { attempt, goal, moved_by_m }, frame)) => frame.to_level(wire::SetGoalResult {
            result: Some(Kind::Attempt(attempt)),
            goal_used: Some(convert::to_wire(goal)),
            moved_by_m,
        }),
        Err(error) => {
            wire::SetGoalResult { result: Some(Kind::Error(item_error(error))), ..wire::SetGoalResult::default() }
        }
    }
}

pub async fn move_targets(api: &WorldApi, call: Call<wire::MoveTargetsRequest>) -> Reply<wire::MoveTargetsResponse> {
    let (caller, wire::MoveTargetsRequest { moves }) = call;
    check_count(moves.len(), "moves")?;
    let items = moves.into_iter().map(|target| Ok(target_move(target)?)).collect();
    let move_to = |world: &mut HostedWorld, npc, (coordinates, target): (Coordinates, wire::TargetMove)| {
        let wire::TargetMove { position, velocity, .. } = coordinates.on(world.map().frame()).to_map(target);
        let [position, velocity] =
            [position, velocity].map(|it| it.map_or(Vec3::ZERO, |it| Vec3::new(it.x, it.y, it.z)));
        world.move_target(npc, position, velocity)
    };
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, move_to).await;
    Ok(wire::MoveTargetsResponse { results: results.into_iter().map(item_result).collect() })
}

pub async fn clear_goals(api: &WorldApi, call: Call<wire::ClearGoalsRequest>) -> Reply<wire::ClearGoalsResponse> {
    let (caller, wire::ClearGoalsRequest { npc_ids }) = call;
    let items = ids("npc_ids", npc_ids)?;
    let clear = |world: &mut HostedWorld, npc, ()| world.clear_goal(npc);
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, clear).await;
    Ok(wire::ClearGoalsResponse { results: results.into_iter().map(item_result).collect() })
}

pub async fn teleport_npc(api: &WorldApi, call: Call<wire::TeleportNpcRequest>) -> Reply<wire::TeleportNpcResponse> {
    let (caller, request) = call;
    let (npc, place) = teleport_of(&request)?;
    api.worlds.with_npc(&caller, NpcAccess::Change, npc, move |world| teleport_on(world, npc, place)).await?;
    Ok(wire::TeleportNpcResponse {})
}

pub async fn batch_teleport_npcs(
    api: &WorldApi,
    call: Call<wire::BatchTeleportNpcsRequest>,
) -> Reply<wire::BatchTeleportNpcsResponse> {
    let (caller, wire::BatchTeleportNpcsRequest { teleports }) = call;
    check_count(teleports.len(), "teleports")?;
    let items = teleports.iter().map(|teleport| Ok(teleport_of(teleport)?)).collect();
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, teleport_on).await;
    Ok(wire::BatchTeleportNpcsResponse { results: results.into_iter().map(item_result).collect() })
}

pub async fn get_npc(api: &WorldApi, call: Call<wire::GetNpcRequest>) -> Reply<wire::GetNpcResponse> {
    let (caller, wire::GetNpcRequest { npc_id, coordinates }) = call;
    let (npc, coordinates) = (NpcId(npc_id), Coordinates::read(coordinates)?);
    let get = move |world: &mut HostedWorld| npc_on(world, npc, ());
    let (state, frame) = api.worlds.with_npc(&caller, NpcAccess::Read, npc, get).await?;
    let (npc, gait) = (Some(npc_to_wire(&state)), Some(convert::gait_to_wire(state.gait)));
    let look_at = state.looks_at.and_then(look_to_wire);
    Ok(coordinates.on(&frame).to_level(wire::GetNpcResponse { npc, gait, look_at }))
}

pub async fn batch_get_npcs(
    api: &WorldApi,
    call: Call<wire::BatchGetNpcsRequest>,
) -> Reply<wire::BatchGetNpcsResponse> {
    use wire::get_npc_result::Result as Kind;
    let (caller, wire::BatchGetNpcsRequest { npc_ids, coordinates }) = call;
    let (items, coordinates) = (ids("npc_ids", npc_ids)?, Coordinates::read(coordinates)?);
    let results = api.worlds.with_npcs(&caller, NpcAccess::Read, items, npc_on).await;
    let npc = |(npc, frame): (NpcState, LevelFrame)| Kind::Npc(coordinates.on(&frame).to_level(npc_to_wire(&npc)));
    let results = results.into_iter().map(|result| wire::GetNpcResult {
        result: Some(result.map_or_else(|error| Kind::Error(item_error(error)), npc)),
    });
    Ok(wire::BatchGetNpcsResponse { results: results.collect() })
}

pub async fn list_npcs(api: &WorldApi, call: Call<wire::ListNpcsRequest>) -> Reply<wire::ListNpcsResponse> {
    let (caller, wire::ListNpcsRequest { world_id, region, page_size, page_token, coordinates }) = call;
    let handle = api.worlds.handle_for(&caller, WorldId(world_id))?;
    let frame = frame_on(&handle, coordinates)?;
    let region = convert_region(frame.to_map(region).as_ref())?;
    let (tick, npcs) = handle
        .sim
        .call(|state| (state.world.tick(), state.world.npcs().map(NpcState::without_movement).collect::<Vec<_>>()))
        .await?;
    let npcs = npcs.into_iter().filter(|npc| region.is_none_or(|region| region.holds(npc.position)));
    let page = page_by_id(npcs, |npc| npc.id.0, NPC_PAGE, page_size, &page_token)?;
    let npcs = page.items.iter().map(npc_to_wire).collect();
    Ok(frame.to_level(wire::ListNpcsResponse { npcs, next_page_token: page.next_token, tick: tick.0 }))
}

/// The warning about those of `npcs` that have no worker; `None` if all have one.
pub(super) async fn warning_about(
    api: &WorldApi,
    caller: &Caller,
    npcs: impl IntoIterator<Item = NpcId>,
) -> Option<wire::Warning> {
    // As long as a worker has room, all NPCs get one.
    let full = api.worlds.full_workers()?;
    let lacks = |world: &mut HostedWorld, npc, ()| Ok(world.npc(npc)?.worker.is_none());
    let items = npcs.into_iter().map(|npc| Ok((npc, ()))).collect();
    let results = api.worlds.with_npcs(caller, NpcAccess::Read, items, lacks).await;
    let lacking = results.iter().filter(|result| matches!(result, Ok(true))).count();
    (lacking > 0).then(|| no_worker_to_wire(lacking, full))
}

/// An item of a batch that consists of ids.
pub(super) type IdItem = Result<(NpcId, ()), WorldsError>;

/// The items of a batch that consists of ids.
pub(super) fn ids(field: &str, ids: Vec<u64>) -> Result<Vec<IdItem>, Status> {
    check_count(ids.len(), field)?;
    Ok(ids.into_iter().map(|id| Ok((NpcId(id), ()))).collect())
}

fn spawn_order(spawn: &wire::Spawn) -> Result<SpawnOrder, FieldError> {
    let wire::Spawn { position, yaw, goal, body, tags, gait } = spawn;
    Ok(SpawnOrder {
        position: convert::point(position.as_ref(), "position")?,
        yaw: finite(*yaw, "yaw")?,
        goal: goal.map(|goal| convert::point(Some(&goal), "goal")).transpose()?,
        body: body.as_ref().map(|body| convert::body(Some(body))).transpose()?,
        tags: zones::tags(tags, "tags")?,
        gait: gait.as_ref().map(convert::gait).transpose()?.unwrap_or_default(),
    })
}

/// The NPC, and where its goal moves.
fn target_move(target: wire::TargetMove) -> Result<(NpcId, (Coordinates, wire::TargetMove)), FieldError> {
    convert::point(target.position.as_ref(), "position")?;
    if let Some(velocity) = &target.velocity {
        let speed = convert::point(Some(velocity), "velocity")?.length();
        convert::in_range(f64::from(speed), 0.0, MAX_TARGET_SPEED, "velocity")?;
    }
    Ok((NpcId(target.npc_id), (Coordinates::read(target.coordinates)?, target)))
}

/// The NPC and its goal.
pub(super) fn goal_of(request: &wire::SetGoalRequest) -> Result<(NpcId, WireGoal), FieldError> {
    use wire::set_goal_request::Target as Kind;
    let target = request.target.as_ref().map(|target| match *target {
        Kind::TargetNpcId(npc) => Target::Npc(NpcId(npc)),
        Kind::TargetPlayerId(player) => Target::Player(PlayerSlot(player)),
    });
    let place = match target {
        Some(_) => None,
        None => Some(Place::read(request.goal.as_ref(), request.coordinates, "goal")?),
    };
    let usual = Pursuit::default();
    let radius = radius_or(request.radius, usual.radius, 0.3, "radius")?;
    let facing = facing(request.facing, "facing")?;
    let snap = request.snap.unwrap_or(usual.snap);
    convert::in_range(f64::from(snap), 0.0, 10.0, "snap")?;
    let coordinates = Coordinates::read(request.coordinates)?;
    let arrival = if request.touch { Arrival::Pass } else { usual.arrival };
    let (keeps, stops) = (request.keep, request.stop);
    let pursuit = Pursuit { target, radius, keeps, snap, facing, arrival, stops, ..usual };
    Ok((NpcId(request.npc_id), WireGoal { place, coordinates, pursuit }))
}

/// Reads a distance within which an NPC is at a place, from `least` to 50 m; 0 means `usual`.
pub(super) fn radius_or(radius: f32, usual: f32, least: f64, field: &'static str) -> Result<f32, FieldError> {
    let radius = if radius == 0.0 { usual } else { radius };
    convert::in_range(f64::from(radius), least, 50.0, field)?;
    Ok(radius)
}

/// Reads a heading, rad.
pub(super) fn facing(yaw: Option<f32>, field: &'static str) -> Result<Option<f32>, FieldError> {
    yaw.map(|yaw| Ok(finite(yaw, field)? % std::f32::consts::TAU)).transpose()
}

/// A goal in the coordinates of its request.
#[derive(Debug, Clone, Copy)]
pub(super) struct WireGoal {
    /// `None` if the goal is a target.
    place: Option<Place>,
    pub coordinates: Coordinates,
    pub pursuit: Pursuit,
}

/// The NPC, its position, and its heading, rad.
fn teleport_of(request: &wire::TeleportNpcRequest) -> Result<(NpcId, (Place, f32)), FieldError> {
    let position = Place::read(request.position.as_ref(), request.coordinates, "position")?;
    Ok((NpcId(request.npc_id), (position, finite(request.yaw, "yaw")?)))
}

// Only the world of an NPC knows the frame of its map.

pub(super) fn set_goal_on(
    world: &mut HostedWorld,
    npc: NpcId,
    goal: WireGoal,
) -> Result<(GoalSet, CallFrame), NpcError> {
    let frame = *world.map().frame();
    let order = GoalOrder { goal: goal.place.map(|place| place.on_map(&frame)), pursuit: goal.pursuit };
    Ok((world.set_goal(npc, order)?, goal.coordinates.on(&frame)))
}

fn teleport_on(world: &mut HostedWorld, npc: NpcId, (position, yaw): (Place, f32)) -> Result<(), NpcError> {
    let position = position.on_map(world.map().frame());
    world.teleport(npc, position, yaw)
}

/// The state of an NPC, and the frame of its map.
pub(super) fn npc_on(world: &mut HostedWorld, npc: NpcId, (): ()) -> Result<(NpcState, LevelFrame), NpcError> {
    Ok((world.npc(npc)?, *world.map().frame()))
}

/// Converts what an NPC looks at, whose place stays as it is.
fn look_to_wire(target: Target) -> Option<wire::LookTarget> {
    use wire::look_target::Target as Kind;
    let target = match target {
        Target::Npc(npc) => Kind::NpcId(npc.0),
        Target::Player(player) => Kind::PlayerId(player.0),
        Target::Moving { from, .. } => Kind::Position(convert::to_wire(from)),
        // NPCs do not look at places in groups.
        Target::Rank(_) => return None,
    };
    Some(wire::LookTarget { target: Some(target) })
}

/// Converts the error of an item: code, reason and message are those of the single call.
pub(super) fn item_error(error: WorldsError) -> wire::ItemError {
    let status = Status::from(error);
    wire::ItemError {
        code: status.code().into(),
        reason: Reason::of(&status).map(|reason| reason.name().to_owned()).unwrap_or_default(),
        message: status.message().to_owned(),
    }
}

/// Converts the result of an item that returns nothing but success or an error.
pub(super) fn item_result(result: Result<(), WorldsError>) -> wire::ItemResult {
    wire::ItemResult { error: result.err().map(item_error) }
}

/// The part of an item's result in BatchSpawnNpcs that is kept for repeated calls.
pub(super) type Spawned = Result<NpcId, Reason>;

/// Converts the result of an item of BatchSpawnNpcs: the part that is kept, and the whole.
fn spawn_result(result: Result<NpcId, WorldsError>) -> (Spawned, wire::SpawnResult) {
    use wire::spawn_result::Result as Kind;
    match result {
        Ok(npc) => (Ok(npc), wire::SpawnResult { result: Some(Kind::NpcId(npc.0)) }),
        Err(error) => {
            let error = item_error(error);
            let kept = Err(error.reason.parse().unwrap_or(Reason::Internal));
            (kept, wire::SpawnResult { result: Some(Kind::Error(error)) })
        }
    }
}

/// The result of an item of a repeated BatchSpawnNpcs. The code and reason of an error are those of the first call.
fn kept_result(kept: &Spawned) -> wire::SpawnResult {
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
