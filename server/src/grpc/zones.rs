//! The calls about zones, and about the tags of NPCs that zones ask for.

use super::npcs::{check_count, item_result};
use super::{Call, Reply, WorldApi, frame_on};
use crate::hosted::ZonesEdit;
use crate::ids::{NpcId, WorldId};
use crate::worlds::{NpcAccess, WorldsError};
use std::collections::BTreeSet;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::zones;

pub async fn set_zones(api: &WorldApi, call: Call<wire::SetZonesRequest>) -> Reply<wire::SetZonesResponse> {
    let (caller, request) = call;
    let frame = api.frame(request.coordinates, request.world_id)?;
    let wire::SetZonesRequest { world_id, put, remove, clear, .. } = frame.to_map(request);
    let edit = ZonesEdit { put: zones::list(&put, "put")?, remove, clear };
    let (tick, count) = api.worlds.set_zones(&caller, WorldId(world_id), edit).await?;
    Ok(wire::SetZonesResponse { tick: tick.0, zone_count: count as u32 })
}

pub async fn list_zones(api: &WorldApi, call: Call<wire::ListZonesRequest>) -> Reply<wire::ListZonesResponse> {
    let (caller, wire::ListZonesRequest { world_id, coordinates }) = call;
    let handle = api.worlds.handle_for(&caller, WorldId(world_id))?;
    let frame = frame_on(&handle, coordinates)?;
    let zones = handle.sim.call(|state| state.world.zones().map(zones::zone_to_wire).collect()).await?;
    Ok(frame.to_level(wire::ListZonesResponse { zones }))
}

pub async fn set_npc_tags(api: &WorldApi, call: Call<wire::SetNpcTagsRequest>) -> Reply<wire::SetNpcTagsResponse> {
    let (caller, wire::SetNpcTagsRequest { npcs }) = call;
    check_count(npcs.len(), "npcs")?;
    let worlds: BTreeSet<WorldId> = npcs.iter().map(|npc| NpcId(npc.npc_id).world()).collect();
    let item = |npc: &wire::NpcTags| -> Result<_, WorldsError> {
        Ok((NpcId(npc.npc_id), zones::tags(&npc.tags, "npcs.tags")?))
    };
    let items = npcs.iter().map(item).collect();
    let results = api.worlds.with_npcs(&caller, NpcAccess::Change, items, |world, npc, tags| world.set_tags(npc, tags));
    let results = results.await.into_iter().map(item_result).collect();
    for world in worlds {
        api.worlds.save_in_fleet(world).await?;
    }
    Ok(wire::SetNpcTagsResponse { results })
}
