//! Jobs and their answers as bytes. Both begin with a checksum. The checksum of a job is its name, so that an answer
//! belongs to one job only. Damaged or impossible bytes are an error, never a panic.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Length of a checksum.
const HASH_LEN: usize = 32;

/// Name of a job: the hash of its content.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct JobId([u8; HASH_LEN]);

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        blake3::Hash::from_bytes(self.0).fmt(f)
    }
}

impl fmt::Debug for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "JobId({self})")
    }
}

/// Kind of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum JobKind {
    /// Probes of a build.
    Probes,
    /// A map and seed of an evaluation.
    Unit,
    /// A map to generate.
    Map,
}

/// Bytes that are not a job or an answer, with the reason.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Damage(pub String);

/// Why a job was not done.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// Whether no prover can do it, so that its dispatch fails; otherwise only this prover cannot.
    pub is_final: bool,
    /// Why.
    pub reason: String,
}

impl Refusal {
    /// No prover can do it.
    pub fn impossible(reason: impl fmt::Display) -> Self {
        Self { is_final: true, reason: reason.to_string() }
    }

    /// This prover cannot do it now.
    pub fn unable(reason: impl fmt::Display) -> Self {
        Self { is_final: false, reason: reason.to_string() }
    }
}

/// A job, sealed.
#[derive(Debug, Clone)]
pub struct Job {
    /// Its name.
    pub id: JobId,
    /// The sealed bytes.
    pub bytes: Vec<u8>,
}

/// A job that a prover has opened.
#[derive(Debug, Clone)]
pub struct Opened {
    /// Its name.
    pub id: JobId,
    /// Its kind.
    pub kind: JobKind,
    body: Vec<u8>,
}

impl Job {
    /// Seals a job. Jobs of one dispatch differ in their `place`.
    pub fn new(kind: JobKind, place: u32, body: &impl Serialize) -> Self {
        let mut bytes = vec![0; HASH_LEN];
        bytes.extend(encode(&(kind, place)));
        bytes.extend(encode(body));
        Self { id: JobId(seal(&mut bytes)), bytes }
    }

    /// Opens a job that [`new`](Self::new) sealed.
    pub fn open(bytes: &[u8]) -> Result<Opened, Damage> {
        let (id, content) = unseal(bytes)?;
        let ((kind, _), body): ((JobKind, u32), _) = postcard::take_from_bytes(content).map_err(malformed)?;
        Ok(Opened { id: JobId(id), kind, body: body.to_vec() })
    }
}

impl Opened {
    /// Decodes the content of the job, which is not checked yet.
    pub fn body<T: DeserializeOwned>(&self) -> Result<T, Damage> {
        decode(&self.body)
    }
}

/// Result of a job.
pub type Answer = Result<Vec<u8>, Refusal>;

/// Seals the answer to a job.
pub fn seal_answer(job: JobId, answer: &Answer) -> Vec<u8> {
    let mut bytes = vec![0; HASH_LEN];
    bytes.extend(job.0);
    bytes.extend(encode(answer));
    seal(&mut bytes);
    bytes
}

/// Opens the answer to a job.
pub fn open_answer(job: JobId, bytes: &[u8]) -> Result<Answer, Damage> {
    let (_, content) = unseal(bytes)?;
    let rest = content.strip_prefix(&job.0).ok_or_else(|| Damage("the answer is to another job".to_owned()))?;
    decode(rest)
}

/// Encodes plain data.
pub fn encode(data: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(data).expect("plain data")
}

/// Decodes data that [`encode`] wrote.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Damage> {
    let (data, rest) = postcard::take_from_bytes(bytes).map_err(malformed)?;
    if rest.is_empty() { Ok(data) } else { Err(Damage(format!("{} bytes too many", rest.len()))) }
}

fn malformed(error: postcard::Error) -> Damage {
    Damage(error.to_string())
}

/// Writes the checksum of the rest to the front.
fn seal(bytes: &mut [u8]) -> [u8; HASH_LEN] {
    let hash = *blake3::hash(&bytes[HASH_LEN..]).as_bytes();
    bytes[..HASH_LEN].copy_from_slice(&hash);
    hash
}

fn unseal(bytes: &[u8]) -> Result<([u8; HASH_LEN], &[u8]), Damage> {
    let (hash, content) = bytes.split_first_chunk().ok_or_else(|| Damage(format!("{} bytes only", bytes.len())))?;
    if blake3::hash(content).as_bytes() != hash {
        return Err(Damage("checksum mismatch".to_owned()));
    }
    Ok((*hash, content))
}
