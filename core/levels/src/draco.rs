//! Meshes that Draco compressed: the extension `KHR_draco_mesh_compression`, decoded by draco-core.
//!
//! The bytes are not trusted. draco-core checks its reads; here its output is bounded before it starts.

use draco_core::{DataType, DecodeLimits, DecoderBuffer, DracoError, ErrorKind, GeometryMetadata, Mesh, MeshDecoder};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Version of the bitstream that the extension uses.
const VERSION: [u8; 2] = [2, 2];
/// Most triangles for each byte of compressed data. A flat grid takes a few bits for a hundred.
const MOST_PER_BYTE: usize = 512;
/// Flag of a header that metadata follows.
const HAS_METADATA: u16 = 0x8000;
/// Most bytes of the attributes of a mesh: normals and colours are decoded with the positions. Decoding attributes of
/// single bytes takes several times as much memory.
const MAX_DECODED_BYTES: u64 = 128 << 20;
const DAMAGED: &str =
    "Draco-compressed data that cannot be decoded: the file is damaged; export it again, or without compression";
const OTHER_KIND: &str =
    "Draco-compressed data that is no mesh of Draco 2.2: export the level again, or without compression";
const TOO_LARGE: &str = "more Draco-compressed triangles than a level may have: split the level";
const NO_ATTRIBUTE: &str =
    "an attribute that its Draco-compressed data lacks: export the level again, or without compression";
const NO_NUMBERS: &str =
    "a Draco-compressed attribute of 64-bit integers or truth values: export the level without compression";

/// How a primitive is compressed.
#[derive(Debug, Deserialize)]
pub(super) struct Draco {
    /// View of the compressed bytes.
    #[serde(rename = "bufferView")]
    pub view: usize,
    /// Ids of the attributes in the compressed data, by their names in the primitive.
    #[serde(default)]
    pub attributes: BTreeMap<String, u32>,
}

/// A decoded mesh. It consists of single triangles, even if its primitive is a strip.
#[derive(Debug)]
pub(super) struct DracoMesh {
    /// Vertices of the triangles.
    pub indices: Vec<u32>,
    /// For each requested attribute the numbers of each vertex, at most 4, followed by zeros. Integers are as they were
    /// stored, even if the primitive's accessor is normalized.
    pub attributes: Vec<Vec<[f32; 4]>>,
    /// Bytes that were read, and those of the triangles and of all attributes, requested or not: the work it took.
    pub work: usize,
}

/// Decodes a mesh of at most `most` triangles, and the attributes with these ids.
///
/// # Errors
/// What is wrong with the bytes.
pub(super) fn decode(bytes: &[u8], ids: &[u32], most: usize) -> Result<DracoMesh, &'static str> {
    let most = most.min(MOST_PER_BYTE.saturating_mul(bytes.len()));
    check_header(bytes, most as u64)?;
    let limits = DecodeLimits::default().with_max_faces(most as u64).with_max_decoded_bytes(MAX_DECODED_BYTES);
    let mut mesh = Mesh::new();
    let decoded = MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh);
    decoded.map_err(|error| if error.kind() == ErrorKind::LimitExceeded { TOO_LARGE } else { DAMAGED })?;
    let attribute = |id: &u32| {
        let attribute = mesh.attribute_by_unique_id(*id).ok_or(NO_ATTRIBUTE)?;
        if matches!(attribute.data_type(), DataType::Int64 | DataType::Uint64 | DataType::Bool) {
            return Err(NO_NUMBERS);
        }
        Ok(attribute.read_f32s(mesh.num_points(), 4).as_chunks::<4>().0.to_vec())
    };
    let attributes = ids.iter().map(attribute).collect::<Result<_, _>>()?;
    let indices: Vec<u32> = mesh.faces().as_flattened().iter().map(|vertex| vertex.0).collect();
    let strides = (0..mesh.num_attributes()).map(|idx| mesh.attribute(idx).byte_stride() as usize);
    let work = bytes.len() + size_of::<u32>() * indices.len() + mesh.num_points() * strides.sum::<usize>();
    Ok(DracoMesh { indices, attributes, work })
}

/// Checks the kind of the data, and the numbers of triangles and vertices that it states.
fn check_header(bytes: &[u8], most: u64) -> Result<(), &'static str> {
    let (header, content) = bytes.split_first_chunk::<11>().ok_or(DAMAGED)?;
    let &[b'D', b'R', b'A', b'C', b'O', major, minor, kind, method, flags @ ..] = header else { return Err(DAMAGED) };
    if [major, minor] != VERSION || kind != 1 {
        return Err(OTHER_KIND);
    }
    let has_metadata = u16::from_le_bytes(flags) & HAS_METADATA != 0;
    let counts = counts(&mut DecoderBuffer::new(content), has_metadata, method == 1).map_err(|_| DAMAGED)?;
    // Each triangle may have vertices of its own.
    if counts.into_iter().any(|count| count > most.saturating_mul(3)) { Err(TOO_LARGE) } else { Ok(()) }
}

/// The numbers of triangles and vertices, in no particular order. They follow the metadata and, if the method is
/// EdgeBreaker, a byte that names its variant.
fn counts(content: &mut DecoderBuffer<'_>, has_metadata: bool, is_edge_breaker: bool) -> Result<[u64; 2], DracoError> {
    if has_metadata {
        GeometryMetadata::decode(content)?;
    }
    if is_edge_breaker {
        content.decode_u8()?;
    }
    Ok([content.decode_varint()?, content.decode_varint()?])
}
