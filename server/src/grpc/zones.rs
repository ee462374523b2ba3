//! The calls about zones.

use super::{Call, Reply, WorldApi, frame_on};
use crate::hosted::ZonesEdit;
use crate::ids::WorldId;
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
