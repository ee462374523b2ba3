//! The saved-map format: a header with a checksum, then the content of a map.
//!
//! ```text
//! header   magic 8 | format version u32 | payload length u64 | BLAKE3 of the payload 32
//! payload  map hash 32 | description length u32 | description (postcard: spec, size, placed, movers,
//!          pieces, frame)
//!          | vertex count u32 | triangle count u32
//!          | vertices 3 x f32 | corners 3 x u32 for each triangle | surfaces u8 for each triangle
//! ```
//!
//! Numbers are little-endian. Corners with equal bits share a vertex, so a decoded map has exactly the same corners.
//! The grid is not stored: building it takes less time than reading it would.

use crate::load::{Overload, check_load, is_allowed};
use std::collections::HashMap;
use surefoot_world::Vec3;
use surefoot_world::map::spec::{MAX_HEIGHT_M, MAX_SIDE_M};
use surefoot_world::map::spot::is_tag;
use surefoot_world::map::{
    CollisionMap, Features, LevelFrame, Map, MapHash, MapSize, MapSpec, Mover, MoverError, Piece, PieceError, Placed,
    RawMapSpec, SpecError, Spot,
};
use surefoot_world::mesh::{Surface, Triangle};

/// The last bytes reveal transfers that rewrite line endings.
const MAGIC: [u8; 8] = *b"SFMAP\r\n\x1a";
const VERSION: u32 = 7;
/// The version before spots.
const VERSION_WITHOUT_SPOTS: u32 = 6;
/// Without the frame of a level.
const VERSION_WITHOUT_FRAME: u32 = 5;
/// Release 0.2.0 (commit b43d94c) wrote it. Its specs have no kind, movers and choice of repair, and its maps neither
/// movers nor pieces. No release wrote formats 2 to 4.
const VERSION_OF_0_2: u32 = 1;
const HEADER_LEN: usize = MAGIC.len() + 4 + 8 + blake3::OUT_LEN;
const VERTEX_LEN: usize = 12;
const CORNERS_LEN: usize = 12;
/// Largest magnitude of a coordinate or other number of a map, m.
const FARTHEST_M: f32 = 10_000.0;

/// Why bytes are not a saved map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileError {
    /// The first bytes are not those of a saved map.
    #[error(
        "this is not a saved map: save one with `surefoot map generate`, or import a level with `surefoot map import`"
    )]
    NotAMap,
    /// The map was saved in another format version.
    #[error("the map is saved in format {found}, this program reads format {VERSION}: save or import it again")]
    Version {
        /// Format version of the file.
        found: u32,
    },
    /// The file is shorter than its header says.
    #[error("the saved map is cut off: {len} of {expected} bytes are there; copy it again")]
    CutOff {
        /// Length of the file, bytes.
        len: usize,
        /// Length that the header calls for, bytes.
        expected: u64,
    },
    /// The file is longer than its header says.
    #[error("the saved map is followed by {count} bytes that do not belong to it; copy it again")]
    TrailingBytes {
        /// Number of extra bytes.
        count: u64,
    },
    /// The checksum does not match.
    #[error("the saved map is damaged: its checksum does not match; copy it again")]
    Damaged,
    /// The counts of vertices and triangles contradict the length of the file.
    #[error("the saved map claims {claimed} bytes of geometry, but has {len}; save it again")]
    Counts {
        /// Length that the counts call for, bytes.
        claimed: u64,
        /// Length of the geometry, bytes.
        len: usize,
    },
    /// The spec, the size and the features cannot be read.
    #[error("the description in the saved map cannot be read ({0}); save it again")]
    Description(String),
    /// The size is out of range.
    #[error(
        "the saved map is {} x {} x {} m, but must be 1 x 1 x 1 to {MAX_SIDE_M} x {MAX_HEIGHT_M} x {MAX_SIDE_M} m",
        .0.width, .0.height, .0.depth
    )]
    Size(MapSize),
    /// The spec is out of range.
    #[error("the spec in the saved map is not valid: {0}")]
    Spec(#[from] SpecError),
    /// The spec has another size than the map.
    #[error("the spec in the saved map has another size than the map; save it again")]
    SpecSize,
    /// A number is infinite, not a number, or too large.
    #[error("{what} {idx} of the saved map has the value {value}, but must be -{FARTHEST_M} to {FARTHEST_M}")]
    Number {
        /// Kind of the item that has the number.
        what: &'static str,
        /// Index of the item.
        idx: usize,
        /// The rejected value.
        value: f32,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} of the saved map refers to vertex {vertex}, but there are {count}")]
    VertexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the vertex.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A triangle has an unknown surface.
    #[error("triangle {triangle} of the saved map has the unknown surface {surface}")]
    UnknownSurface {
        /// Index of the triangle.
        triangle: usize,
        /// Number of the surface.
        surface: u8,
    },
    /// A triangle has no area.
    #[error("triangle {triangle} of the saved map has no area")]
    NoArea {
        /// Index of the triangle.
        triangle: usize,
    },
    /// A mover cannot be part of a map.
    #[error("the saved map is not valid: {0}")]
    Mover(#[from] MoverError),
    /// A piece is not valid.
    #[error("the saved map is not valid: {0}")]
    Piece(#[from] PieceError),
    /// The map is too large to index.
    #[error("the saved map cannot be indexed: {0}")]
    Overload(#[from] Overload),
    /// The hash of the content differs from the saved one.
    #[error("the saved map holds {found}, but was saved as {saved}; save it again")]
    Hash {
        /// Hash of the content.
        found: MapHash,
        /// Hash in the file.
        saved: MapHash,
    },
}

/// Encodes a map; the same map gives the same bytes.
pub fn encode(map: &Map) -> Vec<u8> {
    let (triangles, mut placed) = map.without_pieces();
    let spots = std::mem::take(&mut placed.spots);
    let description = ((map.spec(), map.size(), placed, map.movers(), map.pieces(), map.frame()), spots);
    let description = postcard::to_stdvec(&description).expect("plain data");
    let (vertices, corners) = numbered(triangles.iter().flat_map(Triangle::corners));
    let geometry_len = vertices.len() * VERTEX_LEN + triangles.len() * (CORNERS_LEN + 1);
    let mut payload = Vec::with_capacity(64 + description.len() + geometry_len);
    payload.extend(map.hash().0);
    payload.extend((description.len() as u32).to_le_bytes());
    payload.extend(description);
    payload.extend((vertices.len() as u32).to_le_bytes());
    payload.extend((triangles.len() as u32).to_le_bytes());
    vertices.iter().for_each(|vertex| payload.extend(vertex.to_array().map(f32::to_le_bytes).as_flattened()));
    corners.iter().for_each(|corner| payload.extend(corner.to_le_bytes()));
    payload.extend(triangles.iter().map(|triangle| triangle.surface() as u8));

    let mut bytes = Vec::with_capacity(HEADER_LEN + payload.len());
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((payload.len() as u64).to_le_bytes());
    bytes.extend(blake3::hash(&payload).as_bytes());
    bytes.extend(payload);
    bytes
}

/// The vertices of triangles, and the number of the vertex at each corner. Corners with equal bits share a vertex.
pub(super) fn numbered(corners: impl Iterator<Item = Vec3>) -> (Vec<Vec3>, Vec<u32>) {
    let (mut vertices, mut numbers) = (Vec::new(), HashMap::new());
    let number = |corner: Vec3| {
        *numbers.entry(corner.to_array().map(f32::to_bits)).or_insert_with(|| {
            vertices.push(corner);
            vertices.len() as u32 - 1
        })
    };
    let corners = corners.map(number).collect();
    (vertices, corners)
}

/// Decodes a map that [`encode`] wrote; the map has the same hash.
///
/// # Errors
/// If the bytes are not a complete, undamaged saved map in this format version.
pub fn decode(bytes: &[u8]) -> Result<Map, FileError> {
    let (version, payload) = checked_payload(bytes)?;
    let mut payload = Reader(payload);
    let saved = MapHash(*payload.array()?);
    let description_len = payload.number()?;
    let Description { spec, size, placed, movers, pieces, frame } =
        read_description(payload.bytes(description_len as usize)?, version)?;
    let (vertex_count, triangle_count) = (payload.number()?, payload.number()?);
    let claimed = u64::from(vertex_count) * VERTEX_LEN as u64 + u64::from(triangle_count) * (CORNERS_LEN as u64 + 1);
    if claimed != payload.0.len() as u64 {
        return Err(FileError::Counts { claimed, len: payload.0.len() });
    }
    let vertices = read_vertices(payload.bytes(vertex_count as usize * VERTEX_LEN)?)?;
    let corners = payload.bytes(triangle_count as usize * CORNERS_LEN)?;
    let triangles = read_triangles(&vertices, corners, payload.0)?;
    check_load(size, &triangles, &placed)?;
    let map = Map::new(CollisionMap::new(spec, size, triangles, placed)).with_frame(frame).with_movers(movers)?;
    let map = if pieces.is_empty() { map } else { map.with_pieces(pieces)? };
    if map.hash() == saved { Ok(map) } else { Err(FileError::Hash { found: map.hash(), saved }) }
}

/// Checks the header and returns the format version and the payload.
fn checked_payload(bytes: &[u8]) -> Result<(u32, &[u8]), FileError> {
    if !bytes.starts_with(&MAGIC) {
        let is_beginning = !bytes.is_empty() && MAGIC.starts_with(bytes);
        let cut_off = FileError::CutOff { len: bytes.len(), expected: HEADER_LEN as u64 };
        return Err(if is_beginning { cut_off } else { FileError::NotAMap });
    }
    let mut header = Reader(&bytes[MAGIC.len()..]);
    let too_short = |_| FileError::CutOff { len: bytes.len(), expected: HEADER_LEN as u64 };
    let found = header.number().map_err(too_short)?;
    if ![VERSION_OF_0_2, VERSION_WITHOUT_FRAME, VERSION_WITHOUT_SPOTS, VERSION].contains(&found) {
        return Err(FileError::Version { found });
    }
    let payload_len = u64::from_le_bytes(*header.array().map_err(too_short)?);
    let checksum: &[u8; blake3::OUT_LEN] = header.array().map_err(too_short)?;
    let payload = header.0;
    let len = payload.len() as u64;
    if len < payload_len {
        return Err(FileError::CutOff { len: bytes.len(), expected: payload_len.saturating_add(HEADER_LEN as u64) });
    }
    if len > payload_len {
        return Err(FileError::TrailingBytes { count: len - payload_len });
    }
    if blake3::hash(payload).as_bytes() == checksum { Ok((found, payload)) } else { Err(FileError::Damaged) }
}

/// What a saved map says besides its triangles.
struct Description {
    spec: Option<MapSpec>,
    size: MapSize,
    placed: Placed,
    movers: Vec<Mover>,
    pieces: Vec<Piece>,
    frame: LevelFrame,
}

fn read_description(bytes: &[u8], version: u32) -> Result<Description, FileError> {
    type Of02 = (Option<(u64, MapSize, Features)>, MapSize, Placed);
    type WithoutFrame = (Option<RawMapSpec>, MapSize, Placed, Vec<Mover>, Vec<Piece>);
    type WithoutSpots = (Option<RawMapSpec>, MapSize, Placed, Vec<Mover>, Vec<Piece>, LevelFrame);
    type Present = (WithoutSpots, Vec<Spot>);
    let complete = |((spec, size, placed), rest): (Of02, _)| -> (Present, _) {
        let spec = spec.map(|(seed, size, features)| RawMapSpec { size, features, ..RawMapSpec::new(seed) });
        (((spec, size, placed, Vec::new(), Vec::new(), LevelFrame::default()), Vec::new()), rest)
    };
    let framed = |((spec, size, placed, movers, pieces), rest): (WithoutFrame, _)| -> (Present, _) {
        (((spec, size, placed, movers, pieces, LevelFrame::default()), Vec::new()), rest)
    };
    let read = match version {
        VERSION_OF_0_2 => postcard::take_from_bytes::<Of02>(bytes).map(complete),
        VERSION_WITHOUT_FRAME => postcard::take_from_bytes::<WithoutFrame>(bytes).map(framed),
        VERSION_WITHOUT_SPOTS => {
            postcard::take_from_bytes::<WithoutSpots>(bytes).map(|(saved, rest)| ((saved, Vec::new()), rest))
        }
        _ => postcard::take_from_bytes::<Present>(bytes),
    };
    let (((spec, size, placed, movers, pieces, frame), spots), rest) =
        read.map_err(|error| FileError::Description(error.to_string()))?;
    if !(frame.origin.is_finite() && frame.scale > 0.0 && frame.scale.is_finite()) {
        return Err(FileError::Description("the frame of its level is not finite".to_owned()));
    }
    if !rest.is_empty() {
        return Err(FileError::Description(format!("{} bytes too long", rest.len())));
    }
    if !is_allowed(size) {
        return Err(FileError::Size(size));
    }
    let spec = spec.map(MapSpec::try_from).transpose()?;
    if spec.is_some_and(|spec| spec.size != size) {
        return Err(FileError::SpecSize);
    }
    let placed = Placed { spots, ..placed };
    check_placed(&placed)?;
    Ok(Description { spec, size, placed, movers, pieces, frame })
}

fn read_vertices(bytes: &[u8]) -> Result<Vec<Vec3>, FileError> {
    let (values, _) = bytes.as_chunks::<4>();
    let (points, _) = values.as_chunks::<3>();
    let vertices: Vec<Vec3> = points.iter().map(|point| point.map(f32::from_le_bytes).into()).collect();
    match vertices.iter().position(|vertex| !vertex.to_array().into_iter().all(is_sane)) {
        None => Ok(vertices),
        Some(idx) => check_numbers("vertex", idx, vertices[idx].to_array()).map(|()| vertices),
    }
}

fn read_triangles(vertices: &[Vec3], corners: &[u8], surfaces: &[u8]) -> Result<Vec<Triangle>, FileError> {
    let mut triangles = Vec::with_capacity(surfaces.len());
    let (corners, _) = corners.as_chunks::<4>();
    for (idx, (corners, &surface)) in corners.as_chunks::<3>().0.iter().zip(surfaces).enumerate() {
        let mut points = [Vec3::ZERO; 3];
        for (point, vertex) in points.iter_mut().zip(corners) {
            let vertex = u32::from_le_bytes(*vertex);
            let out_of_range = || FileError::VertexOutOfRange { triangle: idx, vertex, count: vertices.len() };
            *point = *vertices.get(vertex as usize).ok_or_else(out_of_range)?;
        }
        let unknown = || FileError::UnknownSurface { triangle: idx, surface };
        let surface = *Surface::ALL.get(usize::from(surface)).ok_or_else(unknown)?;
        triangles.push(Triangle::new(points, surface).ok_or(FileError::NoArea { triangle: idx })?);
    }
    Ok(triangles)
}

fn check_placed(placed: &Placed) -> Result<(), FileError> {
    for (idx, pool) in placed.pools.iter().enumerate() {
        let (half_x, half_z) = pool.outline.half_extents();
        check_numbers("pool", idx, pool.centre.to_array().into_iter().chain([half_x, half_z, pool.depth]))?;
    }
    for device in placed.devices() {
        check_numbers(device.kind.name(), device.idx as usize, device.numbers())?;
    }
    for (idx, spot) in placed.spots.iter().enumerate() {
        if !is_tag(&spot.tag) {
            return Err(FileError::Description(format!("spot {idx} has an invalid tag")));
        }
        check_numbers("spot", idx, spot.ends().flat_map(|end| end.to_array()))?;
    }
    for (idx, building) in placed.buildings.iter().enumerate() {
        let measures = [building.half[0], building.half[1], building.yaw, building.height];
        check_numbers("building", idx, building.base.to_array().into_iter().chain(measures))?;
    }
    for (idx, plateau) in placed.plateaus.iter().enumerate() {
        check_numbers("plateau", idx, plateau.top.to_array().into_iter().chain([plateau.radius]))?;
    }
    for (idx, ravine) in placed.ravines.iter().enumerate() {
        let points = ravine.path.iter().flat_map(|point| point.to_array());
        check_numbers("ravine", idx, points.chain([ravine.width]))?;
    }
    for (idx, cave) in placed.caves.iter().enumerate() {
        let points = [cave.from, cave.to].into_iter().flat_map(|point| point.to_array());
        check_numbers("cave", idx, points.chain([cave.radius]))?;
    }
    Ok(())
}

fn check_numbers(what: &'static str, idx: usize, values: impl IntoIterator<Item = f32>) -> Result<(), FileError> {
    match values.into_iter().find(|&value| !is_sane(value)) {
        None => Ok(()),
        Some(value) => Err(FileError::Number { what, idx, value }),
    }
}

fn is_sane(value: f32) -> bool {
    // This is also false for NaN.
    value.abs() <= FARTHEST_M
}

/// Reads bytes from the front of a slice.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, len: usize) -> Result<&'a [u8], FileError> {
        let counts = FileError::Counts { claimed: len as u64, len: self.0.len() };
        let (head, rest) = self.0.split_at_checked(len).ok_or(counts)?;
        self.0 = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<&'a [u8; N], FileError> {
        let counts = FileError::Counts { claimed: N as u64, len: self.0.len() };
        let (head, rest) = self.0.split_first_chunk().ok_or(counts)?;
        self.0 = rest;
        Ok(head)
    }

    fn number(&mut self) -> Result<u32, FileError> {
        Ok(u32::from_le_bytes(*self.array()?))
    }
}
