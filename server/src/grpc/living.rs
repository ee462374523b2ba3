//! The calls about movers, players and pieces.

use super::{Call, Reply, WorldApi, frame_on};
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

/// The thread of a world that the caller may change.
fn thread_to_change(api: &WorldApi, caller: &Caller, world: u64) -> Result<SimHandle, WorldsError> {
    api.worlds.handle_to_change(caller, WorldId(world)).map(|handle| handle.sim)
}

pub async fn list_movers(api: &WorldApi, call: Call<wire::ListMoversRequest>) -> Reply<wire::ListMoversResponse> {
    let (caller, wire::ListMoversRequest { world_id, coordinates }) = call;
    let handle = api.worlds.handle_for(&caller, WorldId(world_id))?;
    let frame = frame_on(&handle, coordinates)?;
    let (tick, states) = handle.sim.call(|state| (state.world.tick(), state.world.mover_states().to_vec())).await?;
    let map = handle.shown.get();
    let movers = map.movers();
    let each = movers.iter().zip(&states).enumerate();
    let states = each.map(|(idx, (mover, state))| living::mover_state_to_wire(idx, state, state.pose(mover)));
    Ok(frame.to_level(wire::ListMoversResponse {
        states: states.collect(),
        movers: movers.iter().map(living::mover_to_wire).collect(),
        tick: tick.0,
    }))
}

pub async fn set_mover(api: &WorldApi, call: Call<wire::SetMoverRequest>) -> Reply<wire::SetMoverResponse> {
    let (caller, request) = call;
    let destination = living::destination(&request)?;
    let frame = api.frame(request.coordinates, request.world_id)?;
    let sim = thread_to_change(api, &caller, request.world_id)?;
    let set = move |world: &mut HostedWorld| {
        let (idx, state) = world.set_mover(&request.name, destination, request.pace)?;
        Ok::<_, LivingError>(living::mover_state_to_wire(idx, &state, state.pose(&world.movers()[idx])))
    };
    let state = sim.call(move |state| set(&mut state.world)).await??;
    Ok(frame.to_level(wire::SetMoverResponse { state: Some(state) }))
}

pub async fn edit_map(api: &WorldApi, call: Call<wire::EditMapRequest>) -> Reply<wire::EditMapResponse> {
    let (caller, wire::EditMapRequest { world_id, put, remove, clear, coordinates }) = call;
    let put = api.frame(coordinates, world_id)?.to_map(put);
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

pub async fn list_pieces(api: &WorldApi, call: Call<wire::ListPiecesRequest>) -> Reply<wire::ListPiecesResponse> {
    let (caller, wire::ListPiecesRequest { world_id, coordinates }) = call;
    let handle = api.worlds.handle_for(&caller, WorldId(world_id))?;
    let frame = frame_on(&handle, coordinates)?;
    let revision_and_map = handle.sim.call(|state| (state.world.map_revision(), state.world.map().clone()));
    let (map_revision, map) = revision_and_map.await?;
    Ok(frame.to_level(wire::ListPiecesResponse {
        pieces: map.pieces().iter().map(piece_to_wire).collect(),
        map_revision,
        edited_map_hash: map.hash().to_hex(),
    }))
}

pub async fn spawn_player(api: &WorldApi, call: Call<wire::SpawnPlayerRequest>) -> Reply<wire::SpawnPlayerResponse> {
    let (caller, request) = call;
    let request = api.frame(request.coordinates, request.world_id)?.to_map(request);
    let player = living::player(&request)?;
    let sim = thread_to_change(api, &caller, request.world_id)?;
    let slot = sim.call(move |state| state.world.spawn_player(player)).await??;
    Ok(wire::SpawnPlayerResponse { player_id: slot.0 })
}

pub async fn move_players(api: &WorldApi, call: Call<wire::MovePlayersRequest>) -> Reply<wire::MovePlayersResponse> {
    let (caller, wire::MovePlayersRequest { world_id, moves, coordinates }) = call;
    if moves.len() > MAX_PLAYERS {
        let message = format!("moves has {} items, but a world has at most {MAX_PLAYERS} players", moves.len());
        return Err(status::invalid("moves", message));
    }
    let moves = api.frame(coordinates, world_id)?.to_map(moves);
    let moves = moves.iter().map(living::player_move).collect::<Result<Vec<_>, _>>()?;
    let sim = thread_to_change(api, &caller, world_id)?;
    let call = move |world: &mut HostedWorld| world.move_players(&moves).map(|()| world.tick());
    let tick = sim.call(move |state| call(&mut state.world)).await??;
    Ok(wire::MovePlayersResponse { tick: tick.0 })
}

pub async fn remove_player(api: &WorldApi, call: Call<wire::RemovePlayerRequest>) -> Reply<wire::RemovePlayerResponse> {
    let (caller, wire::RemovePlayerRequest { world_id, player_id }) = call;
    let sim = thread_to_change(api, &caller, world_id)?;
    sim.call(move |state| state.world.remove_player(PlayerSlot(player_id))).await??;
    Ok(wire::RemovePlayerResponse {})
}
