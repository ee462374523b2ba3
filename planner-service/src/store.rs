//! The embedded store: one redb file with graphs, live evidence and layers.
//!
//! A damaged entry is logged and treated as absent, so that its graph is built again; a damaged file is renamed and replaced.
//! A wrong graph is never served. The least recently used graphs are evicted to make room for others; layers never are,
//! because they cannot be rebuilt.

use redb::{Database, Durability, ReadableDatabase, ReadableTable, TableDefinition};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use surefoot_planner::Built;
use surefoot_planner::edits::Layer;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::settings::GraphId;
use surefoot_planner::store::{
    GraphStore, LevelId, StoreError, decode_entry, decode_layer, decode_live, encode_entry, encode_layer, encode_live,
};
use tracing::{info, warn};

type Blobs = TableDefinition<'static, &'static [u8], &'static [u8]>;

const GRAPHS: Blobs = TableDefinition::new("graphs");
const LIVE: Blobs = TableDefinition::new("live");
const LAYERS: Blobs = TableDefinition::new("layers");
/// For each graph: the number of its last use, counted over all graphs, and its size in bytes.
const USES: TableDefinition<'static, &'static [u8], (u64, u64)> = TableDefinition::new("uses");

/// Default for the total size of the stored graphs, in bytes.
pub const DEFAULT_LIMIT_BYTES: u64 = 1 << 30;

/// A store in one redb file.
#[derive(Debug)]
pub struct DiskStore {
    path: PathBuf,
    database: Database,
    limit_bytes: u64,
}

impl DiskStore {
    /// Opens or creates `graphs.redb` in `folder`, for graphs of about `limit_bytes` in total. A damaged file is renamed to
    /// `graphs.redb.damaged` and replaced by an empty one.
    ///
    /// # Errors
    /// If the folder or file cannot be created or renamed, or another process has the file open.
    pub fn open(folder: &Path, limit_bytes: u64) -> Result<Self, StoreError> {
        let path = folder.join("graphs.redb");
        let fail = |reason: String| StoreError { place: path.display().to_string(), reason };
        std::fs::create_dir_all(folder).map_err(|error| fail(error.to_string()))?;
        // redb verifies its file, but some damage makes it panic.
        let opened = catch_unwind(AssertUnwindSafe(|| Database::create(&path)));
        let database = match opened {
            Ok(Ok(database)) => database,
            Ok(Err(redb::DatabaseError::DatabaseAlreadyOpen)) => {
                return Err(fail(
                    "another process has the file open: stop that process, or choose another cache folder".to_owned(),
                ));
            }
            broken => {
                let reason = match broken {
                    Ok(Err(error)) => error.to_string(),
                    _ => "the file cannot be read".to_owned(),
                };
                let aside = path.with_extension("redb.damaged");
                warn!(path = %path.display(), aside = %aside.display(), reason, "graph cache is damaged; renamed it and started with an empty one");
                std::fs::rename(&path, &aside).map_err(|error| fail(error.to_string()))?;
                Database::create(&path).map_err(|error| fail(error.to_string()))?
            }
        };
        Ok(Self { path, database, limit_bytes })
    }

    /// Runs one access to the file, and turns a panic of redb on damaged data into an error.
    fn guarded<T>(&self, access: impl FnOnce() -> Result<T, redb::Error>) -> Result<T, StoreError> {
        let fail = |reason: String| StoreError { place: self.path.display().to_string(), reason };
        match catch_unwind(AssertUnwindSafe(access)) {
            Ok(result) => result.map_err(|error| fail(error.to_string())),
            Err(_) => Err(fail("the file is damaged: stop all processes that use it and delete it".to_owned())),
        }
    }

    /// Reads and decodes an entry. A damaged entry is logged and treated as absent.
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
                warn!(path = %self.path.display(), what, reason, "ignored a damaged entry of the graph cache");
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

    /// Records a use of a graph, without waiting for the disk.
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
            warn!(%error, "use of a graph could not be recorded");
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
                    info!(path = %self.path.display(), bytes = size, "evicted the least recently used graph");
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
                    warn!(path = %self.path.display(), reason, "ignored a damaged layer")
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
