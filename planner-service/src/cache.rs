//! Graphs on disk: an embedded store keyed by everything that decides a graph.
//!
//! Every entry carries a checksum of its content. A damaged entry is named, dropped and built again; a damaged
//! file is set aside under another name. Never is a wrong graph served.

use crate::build::{BuildStats, Built, GraphId};
use crate::graph::{GraphData, NavGraph};
use redb::{Database, ReadableDatabase, TableDefinition};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use tracing::warn;

const GRAPHS: TableDefinition<'_, &[u8; 32], &[u8]> = TableDefinition::new("graphs");

/// Where finished graphs are remembered.
pub trait GraphStore: Send + Sync {
    /// A graph that was stored under `id`; damaged entries read as absent.
    ///
    /// # Errors
    /// If the store itself cannot be read.
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError>;

    /// Remembers a graph.
    ///
    /// # Errors
    /// If the store cannot be written.
    fn put(&self, id: &GraphId, built: &Built) -> Result<(), StoreError>;
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

/// The embedded store: one redb file.
#[derive(Debug)]
pub struct DiskStore {
    path: PathBuf,
    database: Database,
}

impl DiskStore {
    /// Opens or creates `graphs.redb` in `folder`. A damaged file is set aside as `graphs.redb.damaged`.
    ///
    /// # Errors
    /// If the folder or file cannot be used at all, or another process has it open.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let path = folder.join("graphs.redb");
        let fail = |reason: String| StoreError { path: path.clone(), reason };
        std::fs::create_dir_all(folder).map_err(|error| fail(error.to_string()))?;
        let database = match Database::create(&path) {
            Ok(database) => database,
            Err(redb::DatabaseError::DatabaseAlreadyOpen) => {
                return Err(fail("another process has it open: stop it, or choose another cache folder".to_owned()));
            }
            Err(error) => {
                let aside = path.with_extension("redb.damaged");
                warn!(path = %path.display(), aside = %aside.display(), %error, "graph cache is damaged: set aside, starting empty");
                std::fs::rename(&path, &aside).map_err(|error| fail(error.to_string()))?;
                Database::create(&path).map_err(|error| fail(error.to_string()))?
            }
        };
        Ok(Self { path, database })
    }

    fn fail(&self, error: impl std::fmt::Display) -> StoreError {
        StoreError { path: self.path.clone(), reason: error.to_string() }
    }

    fn read(&self, id: &GraphId) -> Result<Option<Vec<u8>>, redb::Error> {
        let transaction = self.database.begin_read()?;
        match transaction.open_table(GRAPHS) {
            Ok(table) => Ok(table.get(&id.0)?.map(|bytes| bytes.value().to_vec())),
            Err(redb::TableError::TableDoesNotExist(_)) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    fn write(&self, id: &GraphId, bytes: &[u8]) -> Result<(), redb::Error> {
        let transaction = self.database.begin_write()?;
        transaction.open_table(GRAPHS)?.insert(&id.0, bytes)?;
        transaction.commit()?;
        Ok(())
    }
}

impl GraphStore for DiskStore {
    fn get(&self, id: &GraphId) -> Result<Option<Built>, StoreError> {
        let Some(bytes) = self.read(id).map_err(|error| self.fail(error))? else { return Ok(None) };
        match decode(&bytes) {
            Ok(built) => Ok(Some(built)),
            Err(reason) => {
                warn!(path = %self.path.display(), %id, reason, "cached graph is damaged: it will be built again");
                Ok(None)
            }
        }
    }

    fn put(&self, id: &GraphId, built: &Built) -> Result<(), StoreError> {
        self.write(id, &encode(built)).map_err(|error| self.fail(error))
    }
}

/// Checksum, then content.
fn encode(built: &Built) -> Vec<u8> {
    let entry = Entry { graph: built.graph.to_data(), stats: built.stats };
    let content = postcard::to_stdvec(&entry).expect("a graph is plain data");
    let mut bytes = blake3::hash(&content).as_bytes().to_vec();
    bytes.extend(content);
    bytes
}

fn decode(bytes: &[u8]) -> Result<Built, String> {
    let (hash, content) = bytes.split_first_chunk::<32>().ok_or("it is cut off")?;
    if blake3::hash(content).as_bytes() != hash {
        return Err("its checksum does not match".to_owned());
    }
    let entry: Entry = postcard::from_bytes(content).map_err(|error| error.to_string())?;
    let graph = NavGraph::check(entry.graph).map_err(|error| error.to_string())?;
    Ok(Built { graph, stats: entry.stats })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Ability, Edge, Evidence};
    use crate::legs::LegModel;
    use surefoot_world::Vec3;

    fn built() -> Built {
        let mut evidence = Evidence::default();
        evidence.note(true, 7, Ability::Jump);
        let vertices = vec![Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0)];
        let graph = NavGraph::check(GraphData { vertices, edges: vec![Edge { from: 0, to: 1, evidence }], legs: LegModel::default() }).unwrap();
        Built { graph, stats: BuildStats { probes: 1, seconds: 0.5, ..BuildStats::default() } }
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        let bytes = encode(&built());
        assert!(decode(&bytes).is_ok());
        for bit in 0..bytes.len() * 8 {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&damaged).is_err(), "bit {bit} flipped unnoticed");
        }
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length]).is_err(), "cut to {length} bytes unnoticed");
        }
    }

    #[test]
    fn a_damaged_entry_reads_as_absent_and_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let store = DiskStore::open(folder.path()).unwrap();
        let (good, bad) = (GraphId([1; 32]), GraphId([2; 32]));
        store.put(&good, &built()).unwrap();
        store.write(&bad, &encode(&built())[..40]).unwrap();
        assert!(store.get(&bad).unwrap().is_none());
        assert_eq!(store.get(&good).unwrap().unwrap().graph.to_data(), built().graph.to_data());
    }

    #[test]
    fn a_file_of_garbage_is_set_aside() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("graphs.redb"), b"not a database, but long enough to be looked at").unwrap();
        let store = DiskStore::open(folder.path()).unwrap();
        store.put(&GraphId([1; 32]), &built()).unwrap();
        assert!(folder.path().join("graphs.redb.damaged").exists());
    }
}
