//! The calls about movers, players and pieces.

use super::{WorldApi, parts};
use crate::hosted::{HostedWorld, LivingError, MapEdit, MapEdited};
use crate::ids::WorldId;
use crate::sim::SimHandle;
use crate::wire::living;
use crate::worlds::WorldsError;
use surefoot_net::serving::Caller;
use surefoot_net::status;
use surefoot_proto::pieces::{piece_to_wire, pieces};
use surefoot_proto::world::v1 as wire;
use surefoot_world::PlayerSlot;
use surefoot_world::player::MAX_PLAYERS;
use tonic::{Request, Status};

/// The thread of a world that the caller may change.
fn thread_to_change(api: &WorldApi, caller: &Caller, world: u64) -> Result<SimHandle, WorldsError> {
    api.worlds.handle_to_change(caller, WorldId(world)).map(|handle| handle.sim)
}

pub(super) async fn list_movers(
    api: &WorldApi,
    request: Request<wire::ListMoversRequest>,
) -> Result<wire::ListMoversResponse, Status> {
    let (caller, wire::ListMoversRequest { world_id }) = parts(request);
    let handle = api.worlds.handle_for(&caller, WorldId(world_id))?;
    let (tick, states) = handle.sim.call(|state| (state.world.tick(), state.world.mover_states().to_vec())).await?;
    let map = handle.shown.get();
    let movers = map.movers();
    let each = movers.iter().zip(&states).enumerate();
    let states = each.map(|(idx, (mover, state))| living::mover_state_to_wire(idx, state, state.pose(mover)));
    Ok(wire::ListMoversResponse {
        states: states.collect(),
        movers: movers.iter().map(living::mover_to_wire).collect(),
        tick: tick.0,
    })
}

pub(super) async fn set_mover(
    api: &WorldApi,
    request: Request<wire::SetMoverRequest>,
) -> Result<wire::SetMoverResponse, Status> {
    let (caller, request) = parts(request);
    let destination = living::destination(&request)?;
    let sim = thread_to_change(api, &caller, request.world_id)?;
    let set = move |world: &mut HostedWorld| {
        let (idx, state) = world.set_mover(&request.name, destination, request.pace)?;
        Ok::<_, LivingError>(living::mover_state_to_wire(idx, &state, state.pose(&world.movers()[idx])))
    };
    let state = sim.call(move |state| set(&mut state.world)).await??;
    Ok(wire::SetMoverResponse { state: Some(state) })
}

pub(super) async fn edit_map(
    api: &WorldApi,
    request: Request<wire::EditMapRequest>,
) -> Result<wire::EditMapResponse, Status> {
    let (caller, wire::EditMapRequest { world_id, put, remove, clear }) = parts(request);
    let edit = MapEdit { put: pieces(&put, "put")?, remove, clear };
    let edited = api.worlds.edit(&caller, WorldId(world_id), edit).await?;
    let MapEdited { revision, tick, piece_count, moved } = edited;
    Ok(wire::EditMapResponse {
        map_revision: revision,
        tick: tick.0,
        piece_count: piece_count as u32,
        moved_npc_ids: moved.into_iter().map(|npc| npc.0).collect(),
    })
}

pub(super) async fn list_pieces(
    api: &WorldApi,
    request: Request<wire::ListPiecesRequest>,
) -> Result<wire::ListPiecesResponse, Status> {
    let (caller, wire::ListPiecesRequest { world_id }) = parts(request);
    let sim = api.worlds.handle_for(&caller, WorldId(world_id))?.sim;
    let (map_revision, map) = sim.call(|state| (state.world.map_revision(), state.world.map().clone())).await?;
    Ok(wire::ListPiecesResponse {
        pieces: map.pieces().iter().map(piece_to_wire).collect(),
        map_revision,
        edited_map_hash: map.hash().to_hex(),
    })
}

pub(super) async fn spawn_player(
    api: &WorldApi,
    request: Request<wire::SpawnPlayerRequest>,
) -> Result<wire::SpawnPlayerResponse, Status> {
    let (caller, request) = parts(request);
    let player = living::player(&request)?;
    let sim = thread_to_change(api, &caller, request.world_id)?;
    let slot = sim.call(move |state| state.world.spawn_player(player)).await??;
    Ok(wire::SpawnPlayerResponse { player_id: slot.0 })
}

pub(super) async fn move_players(
    api: &WorldApi,
    request: Request<wire::MovePlayersRequest>,
) -> Result<wire::MovePlayersResponse, Status> {
    let (caller, wire::MovePlayersRequest { world_id, moves }) = parts(request);
    if moves.len() > MAX_PLAYERS {
        let message = format!("moves has {} items, but a world has at most {MAX_PLAYERS} players", moves.len());
        return Err(status::invalid("moves", message));
    }
    let moves = moves.iter().map(living::player_move).collect::<Result<Vec<_>, _>>()?;
    let sim = thread_to_change(api, &caller, world_id)?;
    let call = move |world: &mut HostedWorld| world.move_players(&moves).map(|()| world.tick());
    let tick = sim.call(move |state| call(&mut state.world)).await??;
    Ok(wire::MovePlayersResponse { tick: tick.0 })
}

pub(super) async fn remove_player(
    api: &WorldApi,
    request: Request<wire::RemovePlayerRequest>,
) -> Result<wire::RemovePlayerResponse, Status> {
    let (caller, wire::RemovePlayerRequest { world_id, player_id }) = parts(request);
    let sim = thread_to_change(api, &caller, world_id)?;
    sim.call(move |state| state.world.remove_player(PlayerSlot(player_id))).await??;
    Ok(wire::RemovePlayerResponse {})
}
