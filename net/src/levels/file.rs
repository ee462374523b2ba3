//! Levels as files for readers: a level is encoded once for all clients that read it at the same time.

use crate::memory::{MemoryBudget, MemoryError, Reservation};
use surefoot_world::Map;

/// Bytes that encoding a map takes at most for each byte of the map.
const ENCODE_FACTOR: u64 = 2;

/// A level as a file (`.sfmap`). Its memory is returned with the last reader.
#[derive(Debug)]
pub(super) struct LevelFile {
    bytes: Vec<u8>,
    _memory: Reservation,
}

impl LevelFile {
    /// Reserves what a client needs for encoding a map.
    pub fn reserve(memory: &MemoryBudget, client: &str, map: &Map) -> Result<Reservation, MemoryError> {
        memory.reserve(client, ENCODE_FACTOR * map.memory_bytes() as u64)
    }

    /// Encodes a map with the memory that is reserved for it.
    pub fn encode(map: &Map, mut memory: Reservation) -> Self {
        let bytes = surefoot_levels::encode(map);
        // Less than the estimate: it always fits.
        let _ = memory.resize(bytes.capacity() as u64);
        Self { bytes, _memory: memory }
    }

    /// The file's content.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}
