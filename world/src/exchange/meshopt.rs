//! Views that meshoptimizer compressed: the extensions `EXT_meshopt_compression` and `KHR_meshopt_compression`, as far as positions and
//! indices need them.

use gltf::json::buffer::View;
use meshopt_rs::index::buffer::decode_index_buffer;
use meshopt_rs::index::sequence::decode_index_sequence;
use meshopt_rs::vertex::DecodeError;
use meshopt_rs::vertex::buffer::decode_vertex_buffer;
use meshopt_rs::vertex::filter::decode_filter_exp;
use serde::Deserialize;
use std::panic::catch_unwind;

/// Names of the extension.
pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// Longest element that is decoded, bytes.
const MAX_STRIDE: usize = 64;
const NEWER: &str = "vertices that a newer meshoptimizer compressed: use EXT_meshopt_compression (gltfpack -c or -cc), or no compression";
const DAMAGED: &str =
    "compressed data that cannot be decoded: the file is damaged; export it again, or without compression";

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
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Exponential,
    /// Those of directions, colours and rotations.
    #[serde(other)]
    Other,
}

impl Compression {
    /// How a view is compressed; `None` if it is not.
    ///
    /// # Errors
    /// What is wrong with the description.
    pub fn of(view: &View) -> Result<Option<Self>, &'static str> {
        let Some(extensions) = &view.extensions else { return Ok(None) };
        let Some(found) = EXTENSIONS.iter().find_map(|name| extensions.others.get(*name)) else { return Ok(None) };
        let parsed = Self::deserialize(found);
        parsed.map(Some).map_err(|_| "compressed data of an unknown kind: export the level without compression")
    }

    /// Number of bytes before compression.
    pub fn decoded_len(&self) -> usize {
        self.count.saturating_mul(self.byte_stride)
    }

    /// The elements as they were before compression. Takes twice [`decoded_len`](Self::decoded_len) bytes of memory.
    ///
    /// # Errors
    /// What is wrong with the bytes or their description.
    pub fn decode(&self, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
        // The decoder checks most of what it reads, but not all.
        catch_unwind(|| self.decode_unchecked(bytes)).unwrap_or(Err(DAMAGED))
    }

    fn decode_unchecked(&self, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
        match (self.mode, self.byte_stride) {
            (Mode::Attributes, stride) => {
                let mut decoded = attributes(self.count, stride, bytes)?;
                match self.filter {
                    Filter::None => {}
                    Filter::Exponential => {
                        let (words, _) = decoded.as_chunks_mut::<4>();
                        let mut values: Vec<u32> = words.iter().map(|word| u32::from_le_bytes(*word)).collect();
                        decode_filter_exp(&mut values);
                        words.iter_mut().zip(values).for_each(|(word, value)| *word = value.to_le_bytes());
                    }
                    Filter::Other => {
                        return Err(
                            "positions that were compressed like directions: export the level without compression",
                        );
                    }
                }
                Ok(decoded)
            }
            (Mode::Triangles | Mode::Indices, stride @ (2 | 4)) => {
                let mut indices = vec![0_u32; self.count];
                let decoded = match self.mode {
                    Mode::Triangles if !self.count.is_multiple_of(3) => return Err(DAMAGED),
                    Mode::Triangles => decode_index_buffer(&mut indices, bytes),
                    _ => decode_index_sequence(&mut indices, bytes),
                };
                decoded.map_err(|_| DAMAGED)?;
                Ok(indices.into_iter().flat_map(|index| index.to_le_bytes().into_iter().take(stride)).collect())
            }
            _ => Err(DAMAGED),
        }
    }
}

/// Decodes `count` elements of `stride` bytes each.
fn attributes(count: usize, stride: usize, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
    /// The decoder knows the length of elements by their type.
    fn of_length<const N: usize>(count: usize, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
        let mut elements = vec![[0_u8; N]; count];
        decode_vertex_buffer(&mut elements, bytes).map_err(|error| match error {
            DecodeError::UnsupportedVersion => NEWER,
            _ => DAMAGED,
        })?;
        Ok(elements.into_flattened())
    }
    macro_rules! by_length {
        ($($length:literal)*) => {
            match stride {
                $($length => of_length::<$length>(count, bytes),)*
                _ if stride > MAX_STRIDE => Err("compressed vertices of more than 64 bytes: export the level without compression"),
                _ => Err(DAMAGED),
            }
        };
    }
    by_length!(4 8 12 16 20 24 28 32 36 40 44 48 52 56 60 64)
}
