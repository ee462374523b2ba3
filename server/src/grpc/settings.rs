//! The calls that change lasting properties of NPCs: tags, gaits, and what they look at.

use super::npcs::{check_count, item_result};
use super::{Call, Reply, WorldApi};
use crate::hosted::{HostedWorld, NpcError, Target};
use crate::ids::{NpcId, WorldId};
use crate::worlds::NpcAccess;
use std::collections::BTreeSet;
use surefoot_net::serving::Caller;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::Place;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::zones;
use surefoot_world::PlayerSlot;

pub async fn set_npc_tags(api: &WorldApi, call: Call<wire::SetNpcTagsRequest>) -> Reply<wire::SetNpcTagsResponse> {
    let (caller, wire::SetNpcTagsRequest { npcs }) = call;
    let item = |npc: wire::NpcTags| Ok((NpcId(npc.npc_id), zones::tags(&npc.tags, "npcs.tags")?));
    let items = npcs.into_iter().map(item).collect();
    Ok(wire::SetNpcTagsResponse { results: change_all(api, &caller, items, HostedWorld::set_tags).await? })
}

pub async fn set_gaits(api: &WorldApi, call: Call<wire::SetGaitsRequest>) -> Reply<wire::SetGaitsResponse> {
    let (caller, wire::SetGaitsRequest { npcs }) = call;
    let item = |npc: wire::NpcGait| {
        Ok((NpcId(npc.npc_id), npc.gait.as_ref().map(convert::gait).transpose()?.unwrap_or_default()))
    };
    let items = npcs.into_iter().map(item).collect();
    Ok(wire::SetGaitsResponse { results: change_all(api, &caller, items, HostedWorld::set_gait).await? })
}

pub async fn look_at(api: &WorldApi, call: Call<wire::LookAtRequest>) -> Reply<wire::LookAtResponse> {
    let (caller, wire::LookAtRequest { npcs }) = call;
    let item = |npc: wire::NpcLook| Ok((NpcId(npc.npc_id), look(&npc)?));
    let items = npcs.into_iter().map(item).collect();
    // Only the world of an NPC knows the frame of its map.
    let look_at = |world: &mut HostedWorld, npc, look: Option<Look>| {
        let target = look.map(|look| match look {
            Look::Body(body) => body,
            Look::Place(place) => Target::at(place.on_map(world.map().frame())),
        });
        world.look_at(npc, target)
    };
    Ok(wire::LookAtResponse { results: change_all(api, &caller, items, look_at).await? })
}

/// Changes a property of NPCs: each item, an NPC and the new value, has its own result. Journals leave these changes
/// out, so that worlds in a fleet are saved before this returns.
async fn change_all<T: Send + 'static>(
    api: &WorldApi,
    caller: &Caller,
    items: Vec<Result<(NpcId, T), FieldError>>,
    change: impl Fn(&mut HostedWorld, NpcId, T) -> Result<(), NpcError> + Clone + Send + 'static,
) -> Reply<Vec<wire::ItemResult>> {
    check_count(items.len(), "npcs")?;
    let worlds: Vec<Option<WorldId>> = items.iter().map(|item| Some(item.as_ref().ok()?.0.world())).collect();
    let items = items.into_iter().map(|item| Ok(item?)).collect();
    let results = api.worlds.with_npcs(caller, NpcAccess::Change, items, change).await;
    let changed = worlds.into_iter().zip(&results).filter_map(|(world, result)| world.filter(|_| result.is_ok()));
    for world in changed.collect::<BTreeSet<_>>() {
        api.worlds.save_in_fleet(world).await?;
    }
    Ok(results.into_iter().map(item_result).collect())
}

/// What an NPC looks at, as a request names it.
#[derive(Debug, Clone, Copy)]
enum Look {
    Body(Target),
    Place(Place),
}

fn look(npc: &wire::NpcLook) -> Result<Option<Look>, FieldError> {
    use wire::look_target::Target as Kind;
    let Some(target) = &npc.target else { return Ok(None) };
    Ok(Some(match target.target.as_ref().ok_or(FieldError::Missing("npcs.target.target"))? {
        Kind::NpcId(npc) => Look::Body(Target::Npc(NpcId(*npc))),
        Kind::PlayerId(player) => Look::Body(Target::Player(PlayerSlot(*player))),
        Kind::Position(at) => Look::Place(Place::read(Some(at), npc.coordinates, "npcs.target.position")?),
    }))
}
