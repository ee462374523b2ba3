//! Maps that services were given: the shelf that keeps them, its gRPC face, and maps as requests name them.

use crate::convert::{self, FieldError};
use crate::status;
use crate::world::v1 as wire;
use crate::world::v1::map_service_server::MapService;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use surefoot_world::exchange::{self, ImportOptions};
use surefoot_world::{Map, MapSpec};
use tonic::{Request, Response, Status};

/// Longest name of a level, bytes.
const MAX_NAME: f64 = 128.0;
/// Maps that a service keeps unless told otherwise.
pub const DEFAULT_MAX_MAPS: usize = 16;

/// A map made elsewhere, with the name of its level.
#[derive(Debug)]
pub struct Level {
    /// What edits belong to.
    pub name: String,
    /// The map.
    pub map: Arc<Map>,
}

/// Where a map comes from.
#[derive(Debug, Clone)]
pub enum MapSource {
    /// It is generated.
    Spec(MapSpec),
    /// It was imported.
    Level(Arc<Level>),
}

impl MapSource {
    /// The map; generating it takes a while.
    ///
    /// # Errors
    /// If the spec is out of range.
    pub fn map(&self) -> Result<Arc<Map>, FieldError> {
        match self {
            MapSource::Spec(spec) => Ok(Arc::new(Map::generate(spec)?)),
            MapSource::Level(level) => Ok(level.map.clone()),
        }
    }

    /// Tells it from other sources.
    pub fn key(&self) -> String {
        match self {
            MapSource::Spec(spec) => format!("{spec:?}"),
            MapSource::Level(level) => level.map.hash().to_hex(),
        }
    }
}

/// The maps that a service keeps; clones share them.
#[derive(Debug, Clone)]
pub struct MapShelf {
    limit: usize,
    /// By hash, with when they were last asked for.
    kept: Arc<Mutex<Kept>>,
}

#[derive(Debug, Default)]
struct Kept {
    uses: u64,
    levels: BTreeMap<String, (u64, Arc<Level>)>,
}

impl MapShelf {
    /// Keeps at most `limit` maps.
    pub fn new(limit: usize) -> Self {
        Self { limit, kept: Arc::default() }
    }

    fn kept(&self) -> std::sync::MutexGuard<'_, Kept> {
        self.kept.lock().expect("no holder of this lock panics")
    }

    /// Keeps a level, in place of the longest unused if there is no room.
    ///
    /// # Errors
    /// RESOURCE_EXHAUSTED if all kept maps are in use.
    pub fn put(&self, name: String, map: Arc<Map>) -> Result<Arc<Level>, Status> {
        let mut kept = self.kept();
        kept.uses += 1;
        let (uses, hash) = (kept.uses, map.hash().to_hex());
        if kept.levels.len() >= self.limit && !kept.levels.contains_key(&hash) {
            let is_idle = |level: &Arc<Level>| Arc::strong_count(level) == 1 && Arc::strong_count(&level.map) == 1;
            let idle = kept.levels.iter().filter(|(_, (_, level))| is_idle(level));
            let oldest = idle.min_by_key(|(_, (used, _))| *used).map(|(hash, _)| hash.clone());
            let oldest = oldest.ok_or_else(|| {
                status::exhausted(format!("{} maps are kept and in use, the most allowed (--max-maps)", self.limit))
            })?;
            kept.levels.remove(&oldest);
        }
        let level = Arc::new(Level { name, map });
        kept.levels.insert(hash, (uses, level.clone()));
        Ok(level)
    }

    /// A kept map.
    ///
    /// # Errors
    /// NOT_FOUND.
    pub fn get(&self, map_hash: &str) -> Result<Arc<Level>, Status> {
        let mut kept = self.kept();
        kept.uses += 1;
        let uses = kept.uses;
        let found = kept.levels.get_mut(map_hash).map(|(used, level)| {
            *used = uses;
            level.clone()
        });
        found.ok_or_else(|| {
            status::not_found("map", map_hash, format!("map {map_hash} is not kept here: call ImportMap first"))
        })
    }

    /// The name that a kept map was given.
    pub fn name_of(&self, map: &Map) -> Option<String> {
        self.kept().levels.get(&map.hash().to_hex()).map(|(_, level)| level.name.clone())
    }

    /// The map that a request names: by spec or by the hash of a kept one.
    ///
    /// # Errors
    /// INVALID_ARGUMENT if it names none or both, or the spec is out of range; NOT_FOUND if it is not kept.
    pub fn source(&self, spec: Option<&wire::MapSpec>, map_hash: &str) -> Result<MapSource, Status> {
        match (spec, map_hash) {
            (Some(_), hash) if !hash.is_empty() => {
                Err(status::invalid("map_hash", "map and map_hash are both set: one of them names the map"))
            }
            (None, hash) if !hash.is_empty() => Ok(MapSource::Level(self.get(hash)?)),
            (spec, _) => Ok(MapSource::Spec(convert::map_spec(spec)?)),
        }
    }
}

fn describe(level: &Level) -> wire::KeptMap {
    wire::KeptMap {
        map_hash: level.map.hash().to_hex(),
        name: level.name.clone(),
        size: Some(convert::map_size_to_wire(level.map.size())),
    }
}

/// The map of a file, and what is odd about it.
fn read(format: wire::MapFormat, file: &[u8], sidecar: &str) -> Result<(Map, Vec<String>), String> {
    let sidecar = (!sidecar.is_empty()).then_some(sidecar);
    let options = ImportOptions::default();
    let imported = match format {
        wire::MapFormat::Saved => {
            return exchange::decode(file).map(|map| (map, Vec::new())).map_err(|error| error.to_string());
        }
        wire::MapFormat::Gltf => exchange::import_gltf(file, sidecar, &options),
        wire::MapFormat::Obj => exchange::import_obj(file, sidecar, &options),
        wire::MapFormat::Unspecified => return Err("format is not set".to_owned()),
    };
    let imported = imported.map_err(|error| error.to_string())?;
    Ok((imported.map, imported.warnings.iter().map(ToString::to_string).collect()))
}

#[tonic::async_trait]
impl MapService for MapShelf {
    async fn import_map(
        &self,
        request: Request<wire::ImportMapRequest>,
    ) -> Result<Response<wire::ImportMapResponse>, Status> {
        let request = request.into_inner();
        convert::in_range(request.name.len() as f64, 1.0, MAX_NAME, "the length of name")?;
        let (format, name) = (request.format(), request.name.clone());
        let task = tokio::task::spawn_blocking(move || read(format, &request.file, &request.sidecar));
        let read = task.await.map_err(|error| Status::internal(format!("the import failed: {error}")))?;
        let (map, warnings) = read.map_err(|message| status::invalid("file", message))?;
        let level = self.put(name, Arc::new(map))?;
        Ok(Response::new(wire::ImportMapResponse { map: Some(describe(&level)), warnings }))
    }

    async fn get_map(&self, request: Request<wire::GetMapRequest>) -> Result<Response<wire::GetMapResponse>, Status> {
        let level = self.get(&request.into_inner().map_hash)?;
        let map = Some(describe(&level));
        let task = tokio::task::spawn_blocking(move || exchange::encode(&level.map));
        let file = task.await.map_err(|error| Status::internal(format!("the map cannot be saved: {error}")))?;
        Ok(Response::new(wire::GetMapResponse { map, file }))
    }

    async fn list_maps(&self, _: Request<wire::ListMapsRequest>) -> Result<Response<wire::ListMapsResponse>, Status> {
        let maps = self.kept().levels.values().map(|(_, level)| describe(level)).collect();
        Ok(Response::new(wire::ListMapsResponse { maps }))
    }
}
