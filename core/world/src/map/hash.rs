//! [`MapHash`]: identifies a map by its content.

use super::features::Placed;
use super::spec::MapSize;
use crate::mesh::Triangle;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Hash of a map's geometry and features.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MapHash(pub [u8; 32]);

impl MapHash {
    /// All 64 hexadecimal digits; `Display` shows the first 16.
    pub fn to_hex(self) -> String {
        blake3::Hash::from_bytes(self.0).to_hex().to_string()
    }
}

impl fmt::Display for MapHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for byte in &self.0[..8] {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}

impl fmt::Debug for MapHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MapHash({self})")
    }
}

impl MapHash {
    /// Hash of a map without movers and pieces.
    pub(super) fn of_content(size: MapSize, triangles: &[Triangle], placed: &Placed) -> Self {
        let mut hasher = blake3::Hasher::new();
        let mut record = [0u8; 37];
        for triangle in triangles {
            for (bytes, value) in record.chunks_exact_mut(4).zip(triangle.corners().iter().flat_map(|c| c.to_array())) {
                bytes.copy_from_slice(&value.to_bits().to_le_bytes());
            }
            record[36] = triangle.surface() as u8;
            hasher.update(&record);
        }
        hasher.update(&postcard::to_stdvec(&(size, placed)).expect("plain data"));
        if !placed.spots.is_empty() {
            hasher.update(&postcard::to_stdvec(&placed.spots).expect("plain data"));
        }
        Self(*hasher.finalize().as_bytes())
    }

    /// Hash of the map that has this hash, with its movers or pieces added.
    pub(super) fn with(self, added: &(impl Serialize + ?Sized)) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.0).update(&postcard::to_stdvec(added).expect("plain data"));
        Self(*hasher.finalize().as_bytes())
    }
}
