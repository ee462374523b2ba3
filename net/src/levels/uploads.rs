//! Files that arrive in parts, before they are imported.

use crate::memory::{MemoryBudget, MemoryError, Reservation};
use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Largest file, bytes.
pub const MAX_FILE_BYTES: u64 = 256 << 20;
/// Most uploads of one client.
const MAX_UPLOADS: usize = 4;
/// Time without a part after which an upload is dropped.
const KEPT_FOR: Duration = Duration::from_secs(300);
/// Longest id, bytes.
const MAX_ID: usize = 64;

/// Why a part is not accepted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum UploadError {
    #[error("upload_id has {0} bytes, but must have 1 to {MAX_ID}")]
    Id(usize),
    #[error("offset is {offset}, but {received} bytes have arrived: send the part that begins there")]
    Offset { offset: u64, received: u64 },
    #[error("the file is larger than {MAX_FILE_BYTES} bytes: simplify the level or split it")]
    TooLarge,
    #[error("this client already has {MAX_UPLOADS} uploads: import them, or wait five minutes")]
    TooMany,
    #[error(transparent)]
    Memory(#[from] MemoryError),
    #[error("there is no upload `{0}`, or it was dropped after five minutes")]
    Unknown(String),
}

/// The received part of a file.
#[derive(Debug)]
pub struct Upload {
    /// Its content.
    pub bytes: Vec<u8>,
    /// Its part of the memory budget.
    pub memory: Reservation,
    latest: Instant,
}

type Key = (Arc<str>, String);

/// All uploads; clones share them.
#[derive(Debug, Clone)]
pub struct Uploads {
    memory: MemoryBudget,
    by_id: Arc<Mutex<BTreeMap<Key, Upload>>>,
}

impl Uploads {
    /// No uploads yet; they count against `memory`.
    pub fn new(memory: MemoryBudget) -> Self {
        Self { memory, by_id: Arc::default() }
    }

    fn by_id(&self) -> MutexGuard<'_, BTreeMap<Key, Upload>> {
        let mut uploads = self.by_id.lock();
        uploads.retain(|_, upload| upload.latest.elapsed() < KEPT_FOR);
        uploads
    }

    /// Adds a part, and returns the number of bytes received. A part that was received before has no effect.
    pub fn append(&self, client: &Arc<str>, id: &str, offset: u64, data: &[u8]) -> Result<u64, UploadError> {
        if !(1..=MAX_ID).contains(&id.len()) {
            return Err(UploadError::Id(id.len()));
        }
        let mut uploads = self.by_id();
        let key = (client.clone(), id.to_owned());
        if !uploads.contains_key(&key) {
            if uploads.keys().filter(|(owner, _)| owner == client).count() >= MAX_UPLOADS {
                return Err(UploadError::TooMany);
            }
            let memory = self.memory.reserve(client, 0)?;
            uploads.insert(key.clone(), Upload { bytes: Vec::new(), memory, latest: Instant::now() });
        }
        let upload = uploads.get_mut(&key).expect("just inserted");
        upload.latest = Instant::now();
        let received = upload.bytes.len() as u64;
        if offset > received {
            return Err(UploadError::Offset { offset, received });
        }
        // The start of the part may have been received before.
        let Some(new) = data.get((received - offset) as usize..) else { return Ok(received) };
        let total = received + new.len() as u64;
        if total > MAX_FILE_BYTES {
            return Err(UploadError::TooLarge);
        }
        if total > upload.bytes.capacity() as u64 {
            // With spare room, or each part would copy all earlier ones.
            let roomy = (total + total / 4).min(MAX_FILE_BYTES);
            let capacity =
                upload.memory.resize(roomy).map(|()| roomy).or_else(|_| upload.memory.resize(total).map(|()| total))?;
            upload.bytes.reserve_exact((capacity - received) as usize);
        }
        upload.bytes.extend_from_slice(new);
        Ok(total)
    }

    /// Takes the file of an upload after its reservation has grown to `needed` bytes of its length. If the memory
    /// budget is exhausted, the upload stays.
    pub fn take(&self, client: &Arc<str>, id: &str, needed: impl Fn(usize) -> u64) -> Result<Upload, UploadError> {
        let (mut uploads, key) = (self.by_id(), (client.clone(), id.to_owned()));
        let upload = uploads.get_mut(&key).ok_or_else(|| UploadError::Unknown(id.to_owned()))?;
        upload.latest = Instant::now();
        upload.memory.resize(needed(upload.bytes.len()))?;
        Ok(uploads.remove(&key).expect("found above"))
    }
}
