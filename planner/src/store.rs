//! Where graphs, layers and live evidence are remembered: the trait that every store implements, and the entries it keeps.
//!
//! Every entry begins with a checksum of its content, so that a damaged one is noticed wherever it was kept; what an entry
//! says is checked besides, since a checksum makes bytes whole, not true.

use crate::build::{BuildStats, Built};
use crate::edits::Layer;
use crate::graph::{GraphData, NavGraph};
use crate::live::LiveEvidence;
use crate::settings::GraphId;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Identity of a level, whatever its graphs are built with: layers belong to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LevelId(pub [u8; 32]);

impl LevelId {
    /// The level that is made from these bytes: a map's spec, or its file.
    pub fn of(source: &[u8]) -> Self {
        Self(*blake3::hash(source).as_bytes())
    }

    /// The level that a spec generates.
    pub fn of_spec(spec: &surefoot_world::MapSpec) -> Self {
        Self::of(&postcard::to_stdvec(spec).expect("a spec is plain data"))
    }
}

/// Where finished graphs are remembered.
pub trait GraphStore: Send + Sync {
    /// A graph that was stored under `id`; damaged entries read as absent.
    ///
    /// # Errors
    /// If the store itself cannot be read.
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError>;

    /// Remembers a graph; others that were not used for longest may make room.
    ///
    /// # Errors
    /// If the store cannot be written.
    fn put(&self, id: &GraphId, built: &Built) -> Result<(), StoreError>;

    /// What was reported of a graph's edges; nothing if that is damaged.
    ///
    /// # Errors
    /// If the store itself cannot be read.
    fn live(&self, id: &GraphId) -> Result<LiveEvidence, StoreError>;

    /// Remembers what was reported of a graph's edges.
    ///
    /// # Errors
    /// If the store cannot be written.
    fn put_live(&self, id: &GraphId, live: &LiveEvidence) -> Result<(), StoreError>;

    /// The layers of a level, by name; damaged ones are left out with a warning.
    ///
    /// # Errors
    /// If the store itself cannot be read.
    fn layers(&self, level: &LevelId) -> Result<Vec<Layer>, StoreError>;

    /// Remembers a layer in place of the one of that name; one without edits is forgotten.
    ///
    /// # Errors
    /// If the store cannot be written.
    fn put_layer(&self, level: &LevelId, layer: &Layer) -> Result<(), StoreError>;
}

/// A store that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("graph cache {place}: {reason}")]
pub struct StoreError {
    /// Its file or address.
    pub place: String,
    /// What went wrong.
    pub reason: String,
}

/// What an entry holds.
#[derive(Serialize, Deserialize)]
struct Entry {
    graph: GraphData,
    stats: BuildStats,
}

/// A graph as the bytes of an entry.
pub fn encode_entry(built: &Built) -> Vec<u8> {
    seal(&Entry { graph: built.graph.to_data(), stats: built.stats })
}

/// The graph that [`encode_entry`] turned into `bytes`.
///
/// # Errors
/// Says why they are not a whole, undamaged entry with a graph that makes sense.
pub fn decode_entry(bytes: &[u8]) -> Result<Built, String> {
    let Entry { graph, stats } = unseal(bytes)?;
    let graph = NavGraph::check(graph).map_err(|error| error.to_string())?;
    Ok(Built { graph, stats })
}

/// What was reported of a graph's edges as the bytes of an entry.
pub fn encode_live(live: &LiveEvidence) -> Vec<u8> {
    seal(live)
}

/// The evidence that [`encode_live`] turned into `bytes`.
///
/// # Errors
/// Says why they are not whole, undamaged evidence.
pub fn decode_live(bytes: &[u8]) -> Result<LiveEvidence, String> {
    let live: LiveEvidence = unseal(bytes)?;
    if live.is_sound() { Ok(live) } else { Err("its evidence contradicts itself".to_owned()) }
}

/// A layer as the bytes of an entry.
pub fn encode_layer(layer: &Layer) -> Vec<u8> {
    seal_bytes(serde_json::to_vec(layer).expect("a layer is plain data"))
}

/// The layer that [`encode_layer`] turned into `bytes`.
///
/// # Errors
/// Says why they are not a whole, undamaged layer with sensible edits.
pub fn decode_layer(bytes: &[u8]) -> Result<Layer, String> {
    // Layers are stored as JSON, whose edits postcard cannot tell apart.
    let layer: Layer = serde_json::from_slice(content(bytes)?).map_err(|error| error.to_string())?;
    layer.validate().map_err(|error| error.to_string())?;
    Ok(layer)
}

/// Checksum, then content.
fn seal_bytes(content: Vec<u8>) -> Vec<u8> {
    let mut bytes = blake3::hash(&content).as_bytes().to_vec();
    bytes.extend(content);
    bytes
}

fn seal<T: Serialize>(value: &T) -> Vec<u8> {
    seal_bytes(postcard::to_stdvec(value).expect("plain data"))
}

fn content(bytes: &[u8]) -> Result<&[u8], String> {
    let (hash, content) = bytes.split_first_chunk::<32>().ok_or("it is cut off")?;
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
