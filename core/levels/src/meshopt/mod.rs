//! Views that meshoptimizer compressed: the extensions `EXT_meshopt_compression` and `KHR_meshopt_compression`.
//!
//! The formats are those of the latter's specification: attributes, triangles and indices of versions 0 and 1, and the
//! filters of numbers and rotations. Normals and colours have filters of their own, but are no part of a level. Every
//! read is checked, because the bytes are not trusted.

mod attributes;
mod bytes;
mod filters;
mod indices;

use crate::meshopt::attributes::attributes;
use crate::meshopt::filters::{apply_exponent, restore_rotation};
use crate::meshopt::indices::{indices, triangles};
use serde::Deserialize;

const NEWER: &str = "vertices that a newer meshoptimizer compressed: use KHR_meshopt_compression \
                     (gltfpack -c, -cc or -cz), or no compression";
const DAMAGED: &str =
    "compressed data that cannot be decoded: the file is damaged; export it again, or without compression";
const UNKNOWN: &str = "compressed data of an unknown kind: export the level without compression";
const OTHER_FILTER: &str = "numbers that were compressed like normals or colours: export the level without compression";

/// How a view is compressed.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compression {
    /// Buffer of the compressed bytes.
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
    #[serde(other)]
    Unknown,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Exponential,
    Quaternion,
    /// The filters of normals and colours, and unknown ones.
    #[serde(other)]
    Other,
}

impl Compression {
    /// Number of bytes before compression.
    pub fn decoded_len(&self) -> usize {
        self.count.saturating_mul(self.byte_stride)
    }

    /// The elements as they were before compression. Takes [`decoded_len`](Self::decoded_len) bytes of memory.
    ///
    /// # Errors
    /// What is wrong with the bytes or their description.
    pub fn decode(&self, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
        match (self.mode, self.byte_stride) {
            (Mode::Attributes, stride) => {
                if matches!(bytes.first(), Some(0xa2..=0xaf)) {
                    return Err(NEWER);
                }
                let mut decoded = attributes(self.count, stride, bytes).ok_or(DAMAGED)?;
                match (self.filter, stride) {
                    (Filter::None, _) => {}
                    (Filter::Exponential, _) => decoded.as_chunks_mut().0.iter_mut().for_each(apply_exponent),
                    (Filter::Quaternion, 8) => decoded.as_chunks_mut().0.iter_mut().for_each(restore_rotation),
                    (Filter::Quaternion, _) => return Err(DAMAGED),
                    (Filter::Other, _) => return Err(OTHER_FILTER),
                }
                Ok(decoded)
            }
            (Mode::Triangles, stride @ (2 | 4)) if self.count.is_multiple_of(3) => {
                triangles(self.count / 3, stride, bytes).ok_or(DAMAGED)
            }
            (Mode::Indices, stride @ (2 | 4)) => indices(self.count, stride, bytes).ok_or(DAMAGED),
            (Mode::Triangles | Mode::Indices, _) => Err(DAMAGED),
            (Mode::Unknown, _) => Err(UNKNOWN),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// What meshoptimizer compressed, and a checksum of what its own decoder makes of it (`tests/fixtures/make.mjs`).
    #[derive(Deserialize)]
    struct Stream {
        name: String,
        #[serde(flatten)]
        how: Compression,
        bytes: String,
        checksum: Option<u32>,
        /// Instead of a checksum, because decoders may round differently.
        rotations: Option<Vec<[f32; 4]>>,
    }

    fn streams() -> Vec<(Stream, Vec<u8>)> {
        let streams = serde_json::from_str::<Vec<Stream>>(include_str!("../../tests/fixtures/streams.json"));
        let decoded = |stream: Stream| {
            let bytes = STANDARD.decode(&stream.bytes).expect("base64");
            (stream, bytes)
        };
        streams.expect("a list of streams").into_iter().map(decoded).collect()
    }

    #[test]
    fn streams_are_decoded_as_by_meshoptimizer() {
        for (Stream { name, how, checksum, rotations, .. }, bytes) in streams() {
            let decoded = how.decode(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(decoded.len(), how.decoded_len(), "{name}");
            // FNV-1a.
            let sum =
                decoded.iter().fold(0x811c_9dc5_u32, |sum, byte| (sum ^ u32::from(*byte)).wrapping_mul(0x100_0193));
            assert!(checksum.is_none_or(|checksum| checksum == sum), "{name}");
            for (element, rotation) in decoded.as_chunks::<8>().0.iter().zip(rotations.into_iter().flatten()) {
                let part = |at: usize| f32::from(i16::from_le_bytes([element[2 * at], element[2 * at + 1]])) / 32767.0;
                let likeness: f32 = (0..4).map(|at| part(at) * rotation[at]).sum();
                // A rotation and its negative are the same.
                assert!((likeness.abs() - 1.0).abs() < 1.0e-3, "{element:?} is not {rotation:?}");
            }
        }
    }

    #[test]
    fn damaged_streams_give_elements_or_an_error() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (mut decoded, mut refused) = (0, 0);
        for (Stream { mut how, .. }, bytes) in streams() {
            let len = how.count;
            for _ in 0..2000 {
                let mut bytes = bytes.clone();
                for _ in 0..rng.random_range(0..4) {
                    let at = rng.random_range(0..bytes.len());
                    bytes[at] = rng.random_range(0..=255);
                }
                bytes.truncate(bytes.len() - [0, 1, bytes.len() / 2][rng.random_range(0..3)]);
                how.count = [len, len + 1, len / 2, 70_000, usize::MAX][rng.random_range(0..5)];
                match how.decode(&bytes) {
                    Ok(elements) => {
                        assert_eq!(elements.len(), how.decoded_len());
                        decoded += 1;
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(decoded > 1000 && refused > 1000, "{decoded} decoded, {refused} refused");
    }

    #[test]
    fn what_cannot_be_decoded_says_so() {
        let parsed = |mode: &str, filter: &str| {
            let how = serde_json::json!({
                "buffer": 0, "byteLength": 41, "byteStride": 8, "count": 1, "mode": mode, "filter": filter
            });
            serde_json::from_value::<Compression>(how).expect("unknown names are parsed")
        };
        let element = [&[0xa0, 0, 0, 0, 0, 0, 0, 0, 0][..], &[0; 32]].concat();
        assert_eq!(parsed("ATTRIBUTES", "NONE").decode(&element), Ok(vec![0; 8]));
        assert_eq!(parsed("ATTRIBUTES", "OCTAHEDRAL").decode(&element), Err(OTHER_FILTER));
        assert_eq!(parsed("MESHLETS", "NONE").decode(&element), Err(UNKNOWN));
        assert_eq!(parsed("ATTRIBUTES", "NONE").decode(&[&[0xa2], &element[1..]].concat()), Err(NEWER));
        assert_eq!(parsed("ATTRIBUTES", "NONE").decode(&element[..40]), Err(DAMAGED));
    }
}
