//! Levels as files, for those that read them: encoded once for all that read a level at the same time.

use crate::memory::{MemoryBudget, MemoryError, Reservation};
use crate::reader::{Reader, ReaderStream};
use std::sync::Arc;
use std::time::Duration;
use surefoot_world::{Map, exchange};

/// Largest chunk of a file that is sent, bytes.
const CHUNK_BYTES: usize = 1 << 18;
/// Chunks that one reader holds at a time: one that waits, one that is encoded, and the transport's copies.
const CHUNKS_PER_READER: u64 = 4;
/// Bytes that encoding a map takes at most for each byte of the map.
const ENCODE_FACTOR: u64 = 2;

/// A level as a file (`.sfmap`). Its memory is returned with the last reader.
#[derive(Debug)]
pub(super) struct LevelFile {
    bytes: Vec<u8>,
    _memory: Reservation,
}

impl LevelFile {
    /// What a client needs for encoding a map.
    ///
    /// # Errors
    /// If there is not enough left.
    pub fn reserve(memory: &MemoryBudget, client: &str, map: &Map) -> Result<Reservation, MemoryError> {
        memory.reserve(client, ENCODE_FACTOR * map.memory_bytes() as u64)
    }

    /// Encodes a map with the memory that is reserved for it.
    pub fn encode(map: &Map, mut memory: Reservation) -> Self {
        let bytes = exchange::encode(map);
        // Less than encoding it took: it always fits.
        let _ = memory.resize(bytes.capacity() as u64);
        Self { bytes, _memory: memory }
    }
}

/// What pays for a stream, and how long its reader may read nothing.
pub(super) struct Terms<'a> {
    pub memory: &'a MemoryBudget,
    pub client: &'a str,
    pub patience: Duration,
}

/// Streams a file in chunks. `message` makes a message of where a chunk begins, the length of the file, and the chunk.
///
/// # Errors
/// If there is no memory for what the reader holds at a time.
pub(super) fn send<M: Send + 'static>(
    terms: &Terms<'_>,
    file: Arc<LevelFile>,
    message: impl Fn(usize, usize, &[u8]) -> M + Send + 'static,
) -> Result<ReaderStream<M>, MemoryError> {
    let memory = terms.memory.reserve(terms.client, CHUNKS_PER_READER * CHUNK_BYTES as u64)?;
    let (mut reader, stream) = Reader::new(terms.patience);
    tokio::spawn(async move {
        let _memory = memory;
        for (idx, chunk) in file.bytes.chunks(CHUNK_BYTES).enumerate() {
            match reader.send(message(idx * CHUNK_BYTES, file.bytes.len(), chunk)).await {
                Some(still) => reader = still,
                None => return,
            }
        }
    });
    Ok(stream)
}
