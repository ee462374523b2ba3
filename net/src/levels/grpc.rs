//! `MapService`: decode, call, encode.

use super::file::LevelFile;
use super::report;
use super::store::{BaseMap, Level, LevelError, LevelFormat, LevelStore, MapSource, PARSE_FACTOR, read};
use super::uploads::UploadError;
use crate::memory::{MemoryBudget, MemoryError, Reservation};
use crate::paging::{PageSize, page};
use crate::reader::{self, ReaderStream, Source};
use crate::serving::Caller;
use crate::status::{self, Answer};
use std::sync::Arc;
use std::time::Duration;
use surefoot_levels::{ImportOptions, Imported, UpAxis, unpacked_bytes};
use surefoot_proto::convert;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::map_service_server::MapService;
use surefoot_world::map::PieceError;
use tonic::{Request, Response, Status};

/// Largest chunk of a file that is sent, bytes.
const CHUNK_BYTES: usize = 1 << 18;
/// Chunks that one reader holds at a time: one that waits, one that is encoded, and the transport's copies.
const CHUNKS_PER_READER: u64 = 4;
/// Longest name of a level, bytes.
const MAX_NAME: f64 = 128.0;
/// Typical time for which an archive is unavailable.
const RETRY_AFTER: Duration = Duration::from_secs(2);

impl From<LevelError> for Status {
    fn from(error: LevelError) -> Self {
        let message = error.to_string();
        match error {
            LevelError::Memory(error) => error.into(),
            LevelError::OtherName(_) | LevelError::OtherFrame(_) => status::failure(Reason::NotOwner, message),
            LevelError::Full(_) => status::quota(Reason::TooManyMaps, "server", message),
            LevelError::Unknown(map_hash) => status::not_found(Reason::MapNotFound, "map", map_hash, message),
            LevelError::File(_) => status::invalid("file", message),
            LevelError::Unavailable(_) => status::retry(Reason::StoreUnavailable, RETRY_AFTER, message),
        }
    }
}

impl From<MemoryError> for Status {
    fn from(error: MemoryError) -> Self {
        status::quota(Reason::OutOfMemory, "server", error.to_string())
    }
}

impl From<UploadError> for Status {
    fn from(error: UploadError) -> Self {
        let message = error.to_string();
        match error {
            UploadError::Id(_) => status::invalid("upload_id", message),
            UploadError::Offset { .. } => status::too_large("offset", message),
            UploadError::TooLarge => status::too_large("data", message),
            UploadError::TooMany => status::quota(Reason::TooManyUploads, "client", message),
            UploadError::Memory(error) => error.into(),
            UploadError::Unknown(id) => status::not_found(Reason::UploadNotFound, "upload", id, message),
        }
    }
}

/// The base map of a request: a spec, or the hash of a kept map.
pub fn source(levels: &LevelStore, spec: Option<&wire::MapSpec>, map_hash: &str) -> Result<BaseMap, Status> {
    match (spec, map_hash) {
        (Some(_), hash) if !hash.is_empty() => {
            Err(status::invalid("map_hash", "map and map_hash are both set: set only one of them"))
        }
        (None, hash) if !hash.is_empty() => Ok(BaseMap::Level(levels.get(hash)?)),
        (spec, _) => Ok(BaseMap::Spec(convert::map_spec(spec)?)),
    }
}

/// The base map of a request with the request's pieces.
pub fn with_pieces(base: BaseMap, pieces: &[wire::Piece]) -> Result<MapSource, Status> {
    let pieces = surefoot_proto::pieces::pieces(pieces, "pieces")?;
    MapSource::from(base).with_pieces(pieces).map_err(|error| piece_error(&error, "pieces"))
}

/// The status for invalid pieces in `field`.
pub fn piece_error(error: &PieceError, field: &'static str) -> Status {
    match error {
        PieceError::TooMany(_) => status::quota(Reason::TooManyPieces, "map", error.to_string()),
        _ => status::invalid(field, error.to_string()),
    }
}

fn level_to_wire(level: &Level) -> wire::KeptMap {
    wire::KeptMap { map_hash: level.map.hash().to_hex(), name: level.name.clone(), size: Some(level.map.size().into()) }
}

fn format(format: wire::MapFormat) -> Result<LevelFormat, Status> {
    match format {
        wire::MapFormat::Saved => Ok(LevelFormat::Saved),
        wire::MapFormat::Gltf => Ok(LevelFormat::Gltf),
        wire::MapFormat::Obj => Ok(LevelFormat::Obj),
        wire::MapFormat::Unspecified => Err(status::invalid("format", "format is not set")),
    }
}

/// The import options of a request.
fn import_options(request: &wire::ImportMapRequest) -> Result<ImportOptions, Status> {
    let up = match wire::UpAxis::try_from(request.up) {
        Ok(wire::UpAxis::Unspecified | wire::UpAxis::Y) => UpAxis::Y,
        Ok(wire::UpAxis::Z) => UpAxis::Z,
        Err(_) => return Err(status::invalid("up", format!("up has the unknown value {}", request.up))),
    };
    let scale = match request.scale {
        0.0 => 1.0,
        // The import refuses invalid scales. 0.01 is meant as 0.01, not as the nearest number of 32 bits.
        scale => scale.to_string().parse().unwrap_or(f64::from(scale)),
    };
    Ok(ImportOptions {
        scale,
        up,
        keep_sides: request.keep_sides,
        ignore_names: request.ignore_names,
        all_scenes: request.all_scenes,
    })
}

/// The chunks of a file for one reader.
struct Chunks {
    map: Option<wire::KeptMap>,
    file: Arc<LevelFile>,
    sent_bytes: usize,
    _memory: Reservation,
}

impl Chunks {
    /// The chunks of `file`; the first one carries `map`.
    fn new(memory: &MemoryBudget, client: &str, map: wire::KeptMap, file: Arc<LevelFile>) -> Result<Self, MemoryError> {
        let memory = memory.reserve(client, CHUNKS_PER_READER * CHUNK_BYTES as u64)?;
        Ok(Self { map: Some(map), file, sent_bytes: 0, _memory: memory })
    }
}

impl Source for Chunks {
    type Message = wire::GetMapResponse;

    async fn next(&mut self) -> Option<Result<Vec<wire::GetMapResponse>, Status>> {
        let rest = self.file.bytes().get(self.sent_bytes..).filter(|rest| !rest.is_empty())?;
        let chunk = rest[..rest.len().min(CHUNK_BYTES)].to_vec();
        let file_bytes = if self.sent_bytes == 0 { self.file.bytes().len() as u64 } else { 0 };
        self.sent_bytes += chunk.len();
        Some(Ok(vec![wire::GetMapResponse { map: self.map.take(), chunk, file_bytes }]))
    }
}

#[tonic::async_trait]
impl MapService for LevelStore {
    async fn import_map(&self, request: Request<wire::ImportMapRequest>) -> Answer<wire::ImportMapResponse> {
        let caller = Caller::of(&request);
        let request = request.into_inner();
        convert::in_range(request.name.len() as f64, 1.0, MAX_NAME, "the length of name")?;
        let (format, options) = (format(request.format())?, import_options(&request)?);
        let wire::ImportMapRequest { name, file, sidecar, upload_id, .. } = request;
        if !upload_id.is_empty() && !file.is_empty() {
            let message = "file and upload_id are both set: one of them holds the level";
            return Err(status::invalid("upload_id", message));
        }
        let turn = self.turn().await;
        // An upload stays where it is until its turn comes and there is memory to read it.
        let (file, memory) = if upload_id.is_empty() {
            let memory = self.reserve(&caller.name, file.len() + sidecar.len())?;
            (file, memory)
        } else {
            let needed = |len: usize| PARSE_FACTOR * (len + sidecar.len()) as u64;
            let upload = self.uploads().take(&caller.name, &upload_id, needed)?;
            (upload.bytes, upload.memory)
        };
        let levels = self.clone();
        let task = tokio::task::spawn_blocking(move || {
            // The caller may disconnect; turn and memory are released when the work is done.
            let _held = (turn, memory);
            let sidecar = (!sidecar.is_empty()).then_some(sidecar.as_str());
            let unpacked = unpacked_bytes(&file).map_err(|error| LevelError::File(error.to_string()))?;
            let _unpacked = levels.memory().reserve(&caller.name, PARSE_FACTOR.saturating_mul(unpacked))?;
            let Imported { map, warnings, nodes, geometry } = read(format, &file, sidecar, &options)?;
            drop(file);
            let origin = map.frame().origin;
            let level = levels.put(&caller, name, Arc::new(map))?;
            levels.archive(&level)?;
            Ok::<_, LevelError>(wire::ImportMapResponse {
                map: Some(level_to_wire(&level)),
                warnings: warnings.iter().map(ToString::to_string).collect(),
                origin: Some(report::point(origin)),
                nodes: nodes.into_iter().map(report::node).collect(),
                geometry: Some(report::geometry(&geometry)),
            })
        });
        let failed = |error| status::failure(Reason::Internal, format!("the import failed: {error}"));
        Ok(Response::new(task.await.map_err(failed)??))
    }

    async fn upload_chunk(&self, request: Request<wire::UploadChunkRequest>) -> Answer<wire::UploadChunkResponse> {
        let caller = Caller::of(&request);
        let wire::UploadChunkRequest { upload_id, offset, data } = request.into_inner();
        let received = self.uploads().append(&caller.name, &upload_id, offset, &data)?;
        Ok(Response::new(wire::UploadChunkResponse { received }))
    }

    type GetMapStream = ReaderStream<wire::GetMapResponse>;

    async fn get_map(&self, request: Request<wire::GetMapRequest>) -> Answer<Self::GetMapStream> {
        let caller = Caller::of(&request);
        let level = self.fetch(&request.into_inner().map_hash).await?;
        let map = level_to_wire(&level);
        let file = self.file_of(&caller.name, level).await?;
        let chunks = Chunks::new(self.memory(), &caller.name, map, file)?;
        Ok(Response::new(reader::stream(chunks, self.patience(), None)))
    }

    async fn list_maps(&self, request: Request<wire::ListMapsRequest>) -> Answer<wire::ListMapsResponse> {
        let wire::ListMapsRequest { page_size, page_token } = request.into_inner();
        let hash = |level: &Arc<Level>| level.map.hash().to_hex();
        let page = page(self.all(), hash, PageSize::USUAL, page_size, &page_token)?;
        let maps = page.items.iter().map(|level| level_to_wire(level)).collect();
        Ok(Response::new(wire::ListMapsResponse { maps, next_page_token: page.next_token }))
    }
}
