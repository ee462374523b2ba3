//! Graphs on disk: an embedded store keyed by everything that decides a graph, with what NPCs reported of it and the
//! layers that designers laid over it.
//!
//! Every entry carries a checksum of its content. A damaged entry is named, dropped and built again; a damaged
//! file is set aside under another name. Never is a wrong graph served. Graphs that have not been used for longest make
//! room for others; layers, which nobody could build again, never do.

use crate::build::{BuildStats, Built, GraphId};
use crate::edits::Layer;
use crate::graph::{GraphData, NavGraph};
use crate::live::LiveEvidence;
use redb::{Database, Durability, ReadableDatabase, ReadableTable, TableDefinition};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use tracing::{info, warn};

type Blobs = TableDefinition<'static, &'static [u8], &'static [u8]>;

const GRAPHS: Blobs = TableDefinition::new("graphs");
const LIVE: Blobs = TableDefinition::new("live");
const LAYERS: Blobs = TableDefinition::new("layers");
/// Of each graph: when it was last used, as a count of uses, and its size in bytes.
const USES: TableDefinition<'static, &'static [u8], (u64, u64)> = TableDefinition::new("uses");

/// Bytes of graphs that are kept unless told otherwise.
pub const DEFAULT_LIMIT_BYTES: u64 = 1 << 30;

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
#[error("graph cache {path}: {reason}")]
pub struct StoreError {
    /// Its file.
    path: PathBuf,
    /// What went wrong.
    reason: String,
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

/// The embedded store: one redb file.
#[derive(Debug)]
pub struct DiskStore {
    path: PathBuf,
    database: Database,
    limit_bytes: u64,
}

impl DiskStore {
    /// Opens or creates `graphs.redb` in `folder`, to hold about `limit_bytes` of graphs. A damaged file is set aside as
    /// `graphs.redb.damaged`.
    ///
    /// # Errors
    /// If the folder or file cannot be used at all, or another process has it open.
    pub fn open(folder: &Path, limit_bytes: u64) -> Result<Self, StoreError> {
        let path = folder.join("graphs.redb");
        let fail = |reason: String| StoreError { path: path.clone(), reason };
        std::fs::create_dir_all(folder).map_err(|error| fail(error.to_string()))?;
        // The format checks itself, but a flipped bit in the wrong place makes its reader panic.
        let opened = catch_unwind(AssertUnwindSafe(|| Database::create(&path)));
        let database = match opened {
            Ok(Ok(database)) => database,
            Ok(Err(redb::DatabaseError::DatabaseAlreadyOpen)) => {
                return Err(fail("another process has it open: stop it, or choose another cache folder".to_owned()));
            }
            broken => {
                let reason = match broken {
                    Ok(Err(error)) => error.to_string(),
                    _ => "it cannot be read".to_owned(),
                };
                let aside = path.with_extension("redb.damaged");
                warn!(path = %path.display(), aside = %aside.display(), reason, "graph cache is damaged: set aside, starting empty");
                std::fs::rename(&path, &aside).map_err(|error| fail(error.to_string()))?;
                Database::create(&path).map_err(|error| fail(error.to_string()))?
            }
        };
        Ok(Self { path, database, limit_bytes })
    }

    /// Runs one access to the file; a reader that trips over damage becomes an error.
    fn guarded<T>(&self, access: impl FnOnce() -> Result<T, redb::Error>) -> Result<T, StoreError> {
        let fail = |reason: String| StoreError { path: self.path.clone(), reason };
        match catch_unwind(AssertUnwindSafe(access)) {
            Ok(result) => result.map_err(|error| fail(error.to_string())),
            Err(_) => Err(fail("it is damaged: stop all that use it and delete it".to_owned())),
        }
    }

    /// An entry as `decode` reads it; a damaged one is named and reads as absent.
    fn read<T>(
        &self,
        table: Blobs,
        key: &[u8],
        what: &str,
        decode: impl Fn(&[u8]) -> Result<T, String>,
    ) -> Result<Option<T>, StoreError> {
        let bytes = self.guarded(|| {
            let transaction = self.database.begin_read()?;
            match transaction.open_table(table) {
                Ok(table) => Ok(table.get(key)?.map(|bytes| bytes.value().to_vec())),
                Err(redb::TableError::TableDoesNotExist(_)) => Ok(None),
                Err(error) => Err(error.into()),
            }
        })?;
        Ok(bytes.and_then(|bytes| match decode(&bytes) {
            Ok(value) => Some(value),
            Err(reason) => {
                warn!(path = %self.path.display(), what, reason, "an entry of the graph cache is damaged: it is passed over");
                None
            }
        }))
    }

    fn write(&self, table: Blobs, key: &[u8], bytes: &[u8]) -> Result<(), StoreError> {
        self.guarded(|| {
            let transaction = self.database.begin_write()?;
            transaction.open_table(table)?.insert(key, bytes)?;
            transaction.commit()?;
            Ok(())
        })
    }

    /// Notes that a graph is being used, without waiting for the disk.
    fn note_use(&self, id: &GraphId) -> Result<(), StoreError> {
        self.guarded(|| {
            let mut transaction = self.database.begin_write()?;
            transaction
                .set_durability(Durability::None)
                .map_err(|error| redb::Error::Io(std::io::Error::other(error)))?;
            {
                let mut uses = transaction.open_table(USES)?;
                let size = uses.get(id.0.as_slice())?.map(|entry| entry.value().1);
                if let Some(size) = size {
                    let next = next_use(&uses)?;
                    uses.insert(id.0.as_slice(), (next, size))?;
                }
            }
            transaction.commit()?;
            Ok(())
        })
    }
}

fn next_use(uses: &impl ReadableTable<&'static [u8], (u64, u64)>) -> Result<u64, redb::Error> {
    let mut last = 0;
    for entry in uses.iter()? {
        last = last.max(entry?.1.value().0);
    }
    Ok(last + 1)
}

impl GraphStore for DiskStore {
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError> {
        let Some(built) = self.read(GRAPHS, &id.0, "graph", decode_entry)? else { return Ok(None) };
        if let Err(error) = self.note_use(id) {
            warn!(%error, "a use is not noted");
        }
        Ok(Some(built))
    }

    fn put(&self, id: &GraphId, built: &Built) -> Result<(), StoreError> {
        let bytes = encode_entry(built);
        self.guarded(|| {
            let transaction = self.database.begin_write()?;
            {
                let mut graphs = transaction.open_table(GRAPHS)?;
                let mut live = transaction.open_table(LIVE)?;
                let mut uses = transaction.open_table(USES)?;
                graphs.insert(id.0.as_slice(), bytes.as_slice())?;
                let next = next_use(&uses)?;
                uses.insert(id.0.as_slice(), (next, bytes.len() as u64))?;
                let mut entries = Vec::new();
                for entry in uses.iter()? {
                    let (key, value) = entry?;
                    entries.push((value.value().0, value.value().1, key.value().to_vec()));
                }
                entries.sort_unstable();
                let mut total: u64 = entries.iter().map(|&(_, size, _)| size).sum();
                for (_, size, key) in entries {
                    if total <= self.limit_bytes || key == id.0 {
                        continue;
                    }
                    total -= size;
                    graphs.remove(key.as_slice())?;
                    live.remove(key.as_slice())?;
                    uses.remove(key.as_slice())?;
                    info!(path = %self.path.display(), bytes = size, "a graph that was not used for long makes room");
                }
            }
            transaction.commit()?;
            Ok(())
        })
    }

    fn live(&self, id: &GraphId) -> Result<LiveEvidence, StoreError> {
        Ok(self.read(LIVE, &id.0, "live evidence", decode_live)?.unwrap_or_default())
    }

    fn put_live(&self, id: &GraphId, live: &LiveEvidence) -> Result<(), StoreError> {
        self.write(LIVE, &id.0, &encode_live(live))
    }

    fn layers(&self, level: &LevelId) -> Result<Vec<Layer>, StoreError> {
        let found = self.guarded(|| {
            let transaction = self.database.begin_read()?;
            let table = match transaction.open_table(LAYERS) {
                Ok(table) => table,
                Err(redb::TableError::TableDoesNotExist(_)) => return Ok(Vec::new()),
                Err(error) => return Err(error.into()),
            };
            let mut found = Vec::new();
            for entry in table.range(level.0.as_slice()..)? {
                let (key, value) = entry?;
                if !key.value().starts_with(&level.0) {
                    break;
                }
                found.push(value.value().to_vec());
            }
            Ok(found)
        })?;
        let mut layers = Vec::new();
        for bytes in found {
            match decode_layer(&bytes) {
                Ok(layer) => layers.push(layer),
                Err(reason) => {
                    warn!(path = %self.path.display(), reason, "a layer of edits is damaged: it is left out")
                }
            }
        }
        Ok(layers)
    }

    fn put_layer(&self, level: &LevelId, layer: &Layer) -> Result<(), StoreError> {
        let key = [level.0.as_slice(), layer.name.as_bytes()].concat();
        if layer.edits.is_empty() {
            return self.guarded(|| {
                let transaction = self.database.begin_write()?;
                transaction.open_table(LAYERS)?.remove(key.as_slice())?;
                transaction.commit()?;
                Ok(())
            });
        }
        self.write(LAYERS, &key, &encode_layer(layer))
    }
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
