//! Persistence of graphs, layers and live evidence: the trait that every store implements, and the encoding of its
//! entries. Graphs and live evidence are a cache; layers are the work of designers, which cannot be rebuilt.
//!
//! Every entry begins with a checksum of its content, so that damage is detected wherever the entry was kept. The
//! decoded content is validated as well, because a checksum does not show that the values are valid.

use crate::build::{BuildStats, Built};
use crate::change::edits::Layer;
use crate::change::live::LiveEvidence;
use crate::graph::{Edge, GraphData, NavGraph};
use crate::settings::GraphId;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Identity of a level, independent of the settings of its graphs. Layers belong to a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LevelId(pub [u8; 32]);

impl LevelId {
    /// Returns the level that these bytes identify: a map's encoded spec, or a level's name.
    pub fn of(source: &[u8]) -> Self {
        Self(*blake3::hash(source).as_bytes())
    }

    /// Returns the level that `spec` generates.
    pub fn of_spec(spec: &surefoot_world::MapSpec) -> Self {
        Self::of(&postcard::to_stdvec(spec).expect("a spec is plain data"))
    }
}

/// Stores graphs, live evidence and layers.
pub trait GraphStore: Send + Sync {
    /// Returns the graph that was stored under `id`; `None` if there is none or its entry is damaged.
    ///
    /// # Errors
    /// If the store itself cannot be read.
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError>;

    /// Stores a graph. The least recently used graphs may be evicted to make room.
    ///
    /// # Errors
    /// If the store cannot be written.
    fn put(&self, id: &GraphId, built: &Built) -> Result<(), StoreError>;

    /// Returns the live evidence of a graph; empty if there is none or its entry is damaged.
    ///
    /// # Errors
    /// If the store itself cannot be read.
    fn live(&self, id: &GraphId) -> Result<LiveEvidence, StoreError>;

    /// Stores the live evidence of a graph in place of the previous evidence, with the receipts of the calls that
    /// reported it.
    ///
    /// # Errors
    /// If the store cannot be written.
    fn put_live(&self, id: &GraphId, live: &LiveEvidence, receipts: &[Receipt]) -> Result<(), StoreError>;

    /// Returns the layers of a level by name. A damaged layer is listed as such, and its bytes are kept.
    ///
    /// # Errors
    /// If the layers cannot be read.
    fn layers(&self, level: &LevelId) -> Result<LevelLayers, StoreError>;

    /// Stores a layer in place of the one with the same name, damaged or not; a layer without edits is removed.
    ///
    /// # Errors
    /// If the store cannot be written. The layers are then unchanged.
    fn put_layer(&self, level: &LevelId, layer: &Layer) -> Result<(), StoreError>;

    /// Like [`put_layer`](Self::put_layer), but only if the layers of the level still have this
    /// [`version`](LevelLayers::version) and no receipt of the same call is stored. Returns whether the layer was
    /// stored. The layer and `receipt` are stored together or not at all. A store of one process needs no versions,
    /// because callers hold the lock of the level.
    ///
    /// # Errors
    /// If the store cannot be written. If it became unreachable, the layer may have been stored nevertheless.
    fn replace_layer(
        &self,
        level: &LevelId,
        version: u64,
        layer: &Layer,
        receipt: Option<&Receipt>,
    ) -> Result<bool, StoreError>;

    /// Returns the receipt of a call of `client` with the request id `id`; `None` if there is none or it has expired
    /// ([`RECEIPTS_KEPT_FOR`], [`MAX_RECEIPTS`]).
    ///
    /// # Errors
    /// If the store cannot be read.
    fn receipt(&self, client: &str, id: &str) -> Result<Option<Receipt>, StoreError>;
}

/// Least time for which a receipt is kept, unless its client has [`MAX_RECEIPTS`] newer ones.
pub const RECEIPTS_KEPT_FOR: Duration = Duration::from_secs(600);
/// Most receipts of one client; the oldest are dropped first.
pub const MAX_RECEIPTS: usize = 4096;
/// Greatest length of the answer in a receipt, bytes.
pub const MAX_ANSWER_BYTES: usize = 16 << 10;

/// A call that takes effect once, however often it is sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Call {
    /// Name of the client.
    pub client: String,
    /// The request id, which the client chose.
    pub id: String,
    /// Hash of the request: another request must not have the same id.
    pub request: [u8; 32],
}

/// A call that has taken effect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Receipt {
    /// The call.
    pub call: Call,
    /// Its encoded answer, at most [`MAX_ANSWER_BYTES`].
    pub answer: Vec<u8>,
}

/// The layers of a level.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LevelLayers {
    /// Layers by name.
    pub layers: Vec<Layer>,
    /// Layers that cannot be read, by name.
    pub damaged: Vec<DamagedLayer>,
    /// Number of changes so far, in a store that several processes share; otherwise 0.
    pub version: u64,
}

impl LevelLayers {
    /// Returns all layers.
    ///
    /// # Errors
    /// Returns the first damaged layer: without it, edges that it forbids would be used.
    pub fn whole(self) -> Result<Vec<Layer>, DamagedLayer> {
        self.damaged.into_iter().next().map_or(Ok(self.layers), Err)
    }
}

/// A stored layer that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("layer `{name}` in {place}: {reason}; restore it from a copy, or replace or remove the layer")]
pub struct DamagedLayer {
    /// Name of the layer.
    pub name: String,
    /// File or address of the layer.
    pub place: String,
    /// Why the layer cannot be read.
    pub reason: String,
}

/// A failure of the store.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct StoreError {
    /// File or address of the store.
    pub place: String,
    /// What went wrong.
    pub reason: String,
    /// Kind of the failure.
    pub kind: StoreErrorKind,
}

/// Kind of a failure of the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoreErrorKind {
    /// The store is unreachable now, and may be reachable later.
    Unavailable,
    /// The entry is gone or damaged and has to be made again.
    Lost,
    /// The store refuses the operation: its settings, its permissions or its disk space must be changed.
    Refused,
}

/// Content of a graph's entry.
#[derive(Serialize, Deserialize)]
struct Entry {
    graph: GraphData,
    stats: BuildStats,
}

/// Encodes a graph as an entry.
pub fn encode_entry(built: &Built) -> Vec<u8> {
    seal(&Entry { graph: built.graph.to_data(), stats: built.stats })
}

/// Decodes a graph that [`encode_entry`] encoded.
///
/// # Errors
/// If `bytes` are truncated or damaged, or the graph is invalid.
pub fn decode_entry(bytes: &[u8]) -> Result<Built, String> {
    let Entry { graph, stats } = unseal(bytes)?;
    let graph = NavGraph::check(graph).map_err(|error| error.to_string())?;
    if let Some(Edge { key, .. }) = graph.edges().find(|edge| edge.evidence.is_expected()) {
        return Err(format!("edge {} -> {} has not been tried", key.from, key.to));
    }
    Ok(Built { graph, stats })
}

/// Encodes live evidence as an entry.
pub fn encode_live(live: &LiveEvidence) -> Vec<u8> {
    seal(live)
}

/// Decodes live evidence that [`encode_live`] encoded.
///
/// # Errors
/// If `bytes` are truncated or damaged, or the evidence is inconsistent.
pub fn decode_live(bytes: &[u8]) -> Result<LiveEvidence, String> {
    let live: LiveEvidence = unseal(bytes)?;
    if live.is_sound() { Ok(live) } else { Err("its evidence is inconsistent".to_owned()) }
}

/// Encodes a layer as an entry.
pub fn encode_layer(layer: &Layer) -> Vec<u8> {
    seal_bytes(serde_json::to_vec(layer).expect("a layer is plain data"))
}

/// Decodes a layer that [`encode_layer`] encoded.
///
/// # Errors
/// If `bytes` are truncated or damaged, or the layer is invalid.
pub fn decode_layer(bytes: &[u8]) -> Result<Layer, String> {
    // Layers are stored as JSON: postcard cannot decode internally tagged enums such as `Edit`.
    let layer: Layer = serde_json::from_slice(content(bytes)?).map_err(|error| error.to_string())?;
    layer.validate().map_err(|error| error.to_string())?;
    Ok(layer)
}

/// Prepends the checksum to `content`.
fn seal_bytes(content: Vec<u8>) -> Vec<u8> {
    let mut bytes = blake3::hash(&content).as_bytes().to_vec();
    bytes.extend(content);
    bytes
}

fn seal<T: Serialize>(value: &T) -> Vec<u8> {
    seal_bytes(postcard::to_stdvec(value).expect("plain data"))
}

fn content(bytes: &[u8]) -> Result<&[u8], String> {
    let (hash, content) = bytes.split_first_chunk::<32>().ok_or("it is truncated")?;
    if blake3::hash(content).as_bytes() != hash {
        return Err("its checksum does not match".to_owned());
    }
    Ok(content)
}

fn unseal<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    postcard::from_bytes(content(bytes)?).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        let bytes = seal(&vec![3u32, 70_000, 5]);
        assert_eq!(unseal::<Vec<u32>>(&bytes).unwrap(), [3, 70_000, 5]);
        for bit in 0..bytes.len() * 8 {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(unseal::<Vec<u32>>(&damaged).is_err(), "bit {bit} flipped unnoticed");
        }
        for length in 0..bytes.len() {
            assert!(unseal::<Vec<u32>>(&bytes[..length]).is_err(), "cut to {length} bytes unnoticed");
        }
    }
}
