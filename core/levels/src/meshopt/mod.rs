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
