//! `MapService`: decode, call, encode.

use super::store::{Level, LevelError, LevelFormat, LevelStore, MapSource, read};
use crate::memory::MemoryError;
use crate::paging::{PageSize, page};
use crate::serving::Caller;
use crate::status;
use std::sync::Arc;
use surefoot_proto::convert;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_server::MapService;
use surefoot_world::exchange;
use tonic::{Request, Response, Status};

/// Longest name of a level, bytes.
const MAX_NAME: f64 = 128.0;

impl From<LevelError> for Status {
    fn from(error: LevelError) -> Self {
        let message = error.to_string();
        match error {
            LevelError::Memory(error) => error.into(),
            LevelError::OtherName(_) => status::failure(Reason::NotOwner, message),
            LevelError::Full(_) => status::quota(Reason::TooManyMaps, "server", message),
            LevelError::Unknown(map_hash) => status::not_found(Reason::MapNotFound, "map", map_hash, message),
            LevelError::File(_) => status::invalid("file", message),
        }
    }
}

impl From<MemoryError> for Status {
    fn from(error: MemoryError) -> Self {
        status::quota(Reason::OutOfMemory, "server", error.to_string())
    }
}

/// The map that a request names: by spec or by the hash of a kept one.
///
/// # Errors
/// INVALID_ARGUMENT if it names none or both, or the spec is out of range; NOT_FOUND if it is not kept.
pub fn source(levels: &LevelStore, spec: Option<&wire::MapSpec>, map_hash: &str) -> Result<MapSource, Status> {
    match (spec, map_hash) {
        (Some(_), hash) if !hash.is_empty() => {
            Err(status::invalid("map_hash", "map and map_hash are both set: one of them names the map"))
        }
        (None, hash) if !hash.is_empty() => Ok(MapSource::Level(levels.get(hash)?)),
        (spec, _) => Ok(MapSource::Spec(convert::map_spec(spec)?)),
    }
}

fn level_to_wire(level: &Level) -> wire::KeptMap {
    wire::KeptMap {
        map_hash: level.map.hash().to_hex(),
        name: level.name.clone(),
        size: Some(convert::map_size_to_wire(level.map.size())),
    }
}

fn format(format: wire::MapFormat) -> Result<LevelFormat, Status> {
    match format {
        wire::MapFormat::Saved => Ok(LevelFormat::Saved),
        wire::MapFormat::Gltf => Ok(LevelFormat::Gltf),
        wire::MapFormat::Obj => Ok(LevelFormat::Obj),
        wire::MapFormat::Unspecified => Err(status::invalid("format", "format is not set")),
    }
}

#[tonic::async_trait]
impl MapService for LevelStore {
    async fn import_map(
        &self,
        request: Request<wire::ImportMapRequest>,
    ) -> Result<Response<wire::ImportMapResponse>, Status> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        convert::in_range(request.name.len() as f64, 1.0, MAX_NAME, "the length of name")?;
        let format = format(request.format())?;
        let wire::ImportMapRequest { name, file, sidecar, .. } = request;
        let turn = self.turn().await;
        let memory = self.reserve(&caller, file.len() + sidecar.len())?;
        let task = tokio::task::spawn_blocking(move || {
            // The caller may be gone: turn and memory are released when the work is done.
            let _held = (turn, memory);
            let sidecar = (!sidecar.is_empty()).then_some(sidecar.as_str());
            read(format, &file, sidecar)
        });
        let (map, warnings) =
            task.await.map_err(|error| status::failure(Reason::Internal, format!("the import failed: {error}")))??;
        let level = self.put(&caller, name, Arc::new(map))?;
        Ok(Response::new(wire::ImportMapResponse { map: Some(level_to_wire(&level)), warnings }))
    }

    async fn get_map(&self, request: Request<wire::GetMapRequest>) -> Result<Response<wire::GetMapResponse>, Status> {
        let level = self.get(&request.into_inner().map_hash)?;
        let map = Some(level_to_wire(&level));
        let task = tokio::task::spawn_blocking(move || exchange::encode(&level.map));
        let file = task
            .await
            .map_err(|error| status::failure(Reason::Internal, format!("the map cannot be saved: {error}")))?;
        Ok(Response::new(wire::GetMapResponse { map, file }))
    }

    async fn list_maps(
        &self,
        request: Request<wire::ListMapsRequest>,
    ) -> Result<Response<wire::ListMapsResponse>, Status> {
        let wire::ListMapsRequest { page_size, page_token } = request.into_inner();
        let hash = |level: &Arc<Level>| level.map.hash().to_hex();
        let page = page(self.all(), hash, PageSize::USUAL, page_size, &page_token)?;
        let maps = page.items.iter().map(|level| level_to_wire(level)).collect();
        Ok(Response::new(wire::ListMapsResponse { maps, next_page_token: page.next_token }))
    }
}
