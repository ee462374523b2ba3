//! The calls about worlds and their maps.

use super::{Call, Reply, WorldApi, frame_on};
use crate::hosted::TimeMode;
use crate::ids::WorldId;
use crate::wire::map::{MAX_CUT_OFF, MAX_SURVEYED, features_to_wire, survey_to_wire};
use crate::wire::world_to_wire;
use crate::worlds::WorldSettings;
use std::time::{Duration, SystemTime};
use surefoot_net::idempotency::Repeatable;
use surefoot_net::levels::{BaseMap, grpc as levels};
use surefoot_net::paging::{PageSize, page_by_id};
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::coordinates::CallFrame;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::zones;
use surefoot_world::character::bodies::BODIES;
use surefoot_world::sense::OBSERVATION_VERSION;
use surefoot_world::{CharacterProfile, OBSERVATION_LEN, Seed, TICKS_PER_DECISION, TICKS_PER_SECOND};

/// Most bytes of the description of a world that has just been created.
const WORLD_BYTES: usize = 1024;
/// Time without a sign of a world's thread after which ListWorlds says that the world is silent.
const SILENCE: Duration = Duration::from_millis(500);

pub async fn get_server(api: &WorldApi, _: Call<wire::GetServerRequest>) -> Reply<wire::GetServerResponse> {
    let config = api.worlds.config();
    Ok(wire::GetServerResponse {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        epoch: api.worlds.epoch(),
        server_time: Some(SystemTime::now().into()),
        ticks_per_second: TICKS_PER_SECOND,
        ticks_per_decision: TICKS_PER_DECISION,
        max_worlds: config.max_worlds as u32,
        max_npcs_per_world: config.max_npcs_per_world as u32,
        observation_len: OBSERVATION_LEN as u32,
        observation_version: OBSERVATION_VERSION,
        body_presets: BODIES.map(|body| body.name.to_owned()).to_vec(),
    })
}

pub async fn create_world(api: &WorldApi, call: Call<wire::CreateWorldRequest>) -> Reply<wire::CreateWorldResponse> {
    let (caller, request) = call;
    let base = levels::source(api.worlds.levels(), request.map.as_ref(), &request.map_hash)?;
    let frame = frame_on_base(&base, request.coordinates)?;
    let source = levels::with_pieces(base, &frame.to_map(request.pieces.clone()))?;
    let mode = convert::enum_or(request.mode, TimeMode::Realtime, "mode")?;
    let settings = WorldSettings {
        mode,
        body: convert::body(request.body.as_ref())?,
        solid_npcs: request.solid_npcs.unwrap_or(mode == TimeMode::Realtime),
        zones: zones::list(&frame.to_map(request.zones.clone()), "zones")?,
    };
    let (worlds, owner) = (api.worlds.clone(), caller.clone());
    // The kept answer must not hold the map.
    let create = async move { Ok(world_to_wire(&worlds.create(&owner, source, settings).await?)) };
    let call = Repeatable { client: &caller.name, request_id: &request.request_id, answer_bytes: WORLD_BYTES };
    let world = api.created_worlds.once(call, &request, create).await?;
    Ok(wire::CreateWorldResponse { world: Some(world) })
}

pub async fn get_world(api: &WorldApi, call: Call<wire::GetWorldRequest>) -> Reply<wire::GetWorldResponse> {
    let (caller, wire::GetWorldRequest { world_id }) = call;
    let world = api.worlds.describe(&caller, WorldId(world_id)).await?;
    Ok(wire::GetWorldResponse { world: Some(world_to_wire(&world)) })
}

pub async fn list_worlds(api: &WorldApi, call: Call<wire::ListWorldsRequest>) -> Reply<wire::ListWorldsResponse> {
    let (_, wire::ListWorldsRequest { page_size, page_token }) = call;
    // Worlds that may be moving to another server are left out.
    let here = api.worlds.figures().into_iter().filter(|world| api.worlds.handle(world.summary.id).is_ok());
    let page = page_by_id(here, |world| world.summary.id.0, PageSize::USUAL, page_size, &page_token)?;
    let silent = page.items.iter().filter(|world| world.age() > SILENCE);
    Ok(wire::ListWorldsResponse {
        silent_world_ids: silent.map(|world| world.summary.id.0).collect(),
        worlds: page.items.iter().map(|world| world_to_wire(&world.summary)).collect(),
        next_page_token: page.next_token,
    })
}

pub async fn drop_world(api: &WorldApi, call: Call<wire::DropWorldRequest>) -> Reply<wire::DropWorldResponse> {
    let (caller, wire::DropWorldRequest { world_id }) = call;
    api.worlds.drop_world(&caller, WorldId(world_id)).await?;
    Ok(wire::DropWorldResponse {})
}

pub async fn sample_ground(api: &WorldApi, call: Call<wire::SampleGroundRequest>) -> Reply<wire::SampleGroundResponse> {
    let (caller, wire::SampleGroundRequest { world_id, count, seed, body, coordinates }) = call;
    // An unknown world is reported before a bad count.
    let frame = frame_on(&api.worlds.handle(WorldId(world_id))?, coordinates)?;
    convert::in_range(f64::from(count), 1.0, 10_000.0, "count")?;
    let body = body.map(|body| convert::body(Some(&body))).transpose()?;
    let points = api.worlds.sample_ground(&caller, WorldId(world_id), body, count as usize, Seed(seed)).await?;
    let points = points.into_iter().map(convert::to_wire).collect();
    Ok(frame.to_level(wire::SampleGroundResponse { points }))
}

pub async fn survey_map(api: &WorldApi, call: Call<wire::SurveyMapRequest>) -> Reply<wire::SurveyMapResponse> {
    let (caller, wire::SurveyMapRequest { map, map_hash, bodies, max_cut_off, pieces, coordinates }) = call;
    let base = levels::source(api.worlds.levels(), map.as_ref(), &map_hash)?;
    let frame = frame_on_base(&base, coordinates)?;
    let source = levels::with_pieces(base, &frame.to_map(pieces))?;
    convert::in_range(bodies.len() as f64, 0.0, MAX_SURVEYED, "the number of bodies")?;
    convert::in_range(f64::from(max_cut_off), 0.0, MAX_CUT_OFF, "max_cut_off")?;
    let bodies: Vec<_> = bodies.iter().map(|body| convert::body(Some(body))).collect::<Result<_, _>>()?;
    let bodies = if bodies.is_empty() { vec![CharacterProfile::default()] } else { bodies };
    let surveys = api.worlds.survey(&caller, source, bodies, max_cut_off as usize).await?;
    Ok(frame.to_level(wire::SurveyMapResponse { surveys: surveys.iter().map(survey_to_wire).collect() }))
}

pub async fn get_features(api: &WorldApi, call: Call<wire::GetFeaturesRequest>) -> Reply<wire::GetFeaturesResponse> {
    let (_, wire::GetFeaturesRequest { world_id, coordinates }) = call;
    let handle = api.worlds.handle(WorldId(world_id))?;
    Ok(frame_on(&handle, coordinates)?.to_level(features_to_wire(&handle.shown.get())))
}

/// The frame of a call about a map without a world.
fn frame_on_base(base: &BaseMap, coordinates: i32) -> Result<CallFrame, FieldError> {
    CallFrame::of(coordinates, || Ok(base.frame()))
}
