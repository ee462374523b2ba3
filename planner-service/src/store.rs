//! The store on disk: one redb file, the cache, with graphs, live evidence and receipts (`receipts`), and beside it a
//! folder with the layers of designers (`layer_files`).
//!
//! A damaged graph is logged and treated as absent, so that it is built again. A damaged cache file is renamed, never
//! over an earlier one, and replaced. Every other failure to open it ends the start, because the file may be intact:
//! no permission, no space, another process, another format. The least recently used graphs are evicted to make room
//! for others. Layers are not part of the cache.

use crate::layer_files::LayerFiles;
use crate::receipts::{self, Expected};
use redb::{Database, DatabaseError, Durability, ReadableDatabase, ReadableTable, StorageError, TableDefinition};
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use surefoot_planner::Built;
use surefoot_planner::edits::Layer;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::settings::GraphId;
use surefoot_planner::store::{
    GraphStore, LevelId, LevelLayers, Receipt, StoreError, StoreErrorKind, decode_entry, decode_live, encode_entry,
    encode_live,
};
use tracing::{info, warn};

type Blobs = TableDefinition<'static, &'static [u8], &'static [u8]>;

const GRAPHS: Blobs = TableDefinition::new("graphs");
const LIVE: Blobs = TableDefinition::new("reports");
/// Live evidence without reporters, as 0.1.0 stored it.
const OLD_LIVE: Blobs = TableDefinition::new("live");
/// Layers, as 0.1.0 stored them.
const OLD_LAYERS: Blobs = TableDefinition::new("layers");
/// For each graph: the number of its last use, counted over all graphs, and its size in bytes.
const USES: TableDefinition<'static, &'static [u8], (u64, u64)> = TableDefinition::new("uses");

/// Default for the total size of the stored graphs, in bytes.
pub const DEFAULT_LIMIT_BYTES: u64 = 1 << 30;

/// A store in one folder.
#[derive(Debug)]
pub struct DiskStore {
    path: PathBuf,
    database: Database,
    limit_bytes: u64,
    layers: LayerFiles,
}

/// Why a cache file cannot be opened.
enum Refusal {
    /// The file is damaged.
    Damaged(String),
    /// The file may be intact.
    Other(String),
}

impl From<DatabaseError> for Refusal {
    fn from(error: DatabaseError) -> Self {
        let text = error.to_string();
        match error {
            DatabaseError::DatabaseAlreadyOpen => Self::Other(
                "another process, such as `surefoot up`, has the file open: stop it, or pass another folder to --cache"
                    .to_owned(),
            ),
            DatabaseError::UpgradeRequired(_) => Self::Other(format!(
                "{text}: open it with the version of surefoot that wrote it, \
                 or move it away to start with an empty cache"
            )),
            // redb does not tell a newer format from damage otherwise.
            DatabaseError::Storage(StorageError::Corrupted(reason)) if reason.contains("file format version") => {
                Self::Other(format!(
                    "a newer version of surefoot wrote the file ({reason}): use that version, \
                     or move the file away to start with an empty cache"
                ))
            }
            DatabaseError::Storage(StorageError::Corrupted(_)) => Self::Damaged(text),
            DatabaseError::Storage(StorageError::Io(io)) => match io.kind() {
                // Not a redb file, or one that was cut off.
                ErrorKind::InvalidData | ErrorKind::UnexpectedEof => Self::Damaged(text),
                _ => Self::Other(format!("{text}: check the permissions of the file and the space on its disk")),
            },
            _ => Self::Other(text),
        }
    }
}

impl DiskStore {
    /// Opens or creates `graphs.redb` in `folder`, for graphs of about `limit_bytes` in total, and the folder `layers`
    /// beside it. A damaged cache file is renamed to `graphs.redb.damaged` (or `.damaged-2`, and so on) and replaced
    /// by an empty one. Layers that 0.1.0 stored in the cache file are moved to the folder.
    pub fn open(folder: &Path, limit_bytes: u64) -> Result<Self, StoreError> {
        let path = folder.join("graphs.redb");
        let fail = |reason| StoreError { place: path.display().to_string(), reason, kind: StoreErrorKind::Refused };
        std::fs::create_dir_all(folder).map_err(|error| fail(error.to_string()))?;
        let database = match open_file(&path) {
            Ok(database) => database,
            Err(Refusal::Other(reason)) => return Err(fail(reason)),
            Err(Refusal::Damaged(reason)) => {
                let aside =
                    set_aside(&path).map_err(|error| fail(format!("{reason}; it cannot be renamed: {error}")))?;
                let (damaged, renamed) = (path.display(), aside.display());
                warn!(%damaged, %renamed, reason, "graph cache: the file is damaged; started an empty one");
                open_file(&path).map_err(|(Refusal::Damaged(reason) | Refusal::Other(reason))| fail(reason))?
            }
        };
        let store = Self { path, database, limit_bytes, layers: LayerFiles::open(folder)? };
        store.move_layers()?;
        store.settle_receipts()?;
        Ok(store)
    }

    /// Drops receipts that are too old, and those whose layers were not stored. The others count from now on.
    fn settle_receipts(&self) -> Result<(), StoreError> {
        let unsettled = self.guarded(|| receipts::unsettled(&self.database.begin_read()?))?;
        if unsettled.is_empty() {
            return Ok(());
        }
        self.guarded(|| {
            let transaction = self.database.begin_write()?;
            for (receipt, expected) in &unsettled {
                match expected.as_ref().is_some_and(|it| self.is_met(it)) {
                    true => receipts::put(&transaction, std::slice::from_ref(receipt), None)?,
                    false => receipts::remove(&transaction, &receipt.call.client, &receipt.call.id)?,
                }
            }
            transaction.commit()?;
            Ok(())
        })
    }

    /// Moves the layers that 0.1.0 stored in the cache file to files of their own, unchanged, damaged or not. A layer
    /// that has a file already keeps it.
    fn move_layers(&self) -> Result<(), StoreError> {
        let entries = self.guarded(|| {
            let transaction = self.database.begin_read()?;
            let table = match transaction.open_table(OLD_LAYERS) {
                Ok(table) => table,
                Err(redb::TableError::TableDoesNotExist(_)) => return Ok(None),
                Err(error) => return Err(error.into()),
            };
            let mut entries = Vec::new();
            for entry in table.iter()? {
                let (key, value) = entry?;
                entries.push((key.value().to_vec(), value.value().to_vec()));
            }
            Ok(Some(entries))
        })?;
        let Some(entries) = entries else { return Ok(()) };
        for (key, bytes) in &entries {
            let (level, name) = key.split_first_chunk().ok_or_else(|| StoreError {
                place: self.path.display().to_string(),
                reason:
                    "a layer of an earlier version belongs to no level: move the file away to begin with an empty cache"
                        .to_owned(),
                kind: StoreErrorKind::Refused,
            })?;
            self.layers.add(&LevelId(*level), name, bytes)?;
        }
        self.guarded(|| {
            let transaction = self.database.begin_write()?;
            transaction.delete_table(OLD_LAYERS)?;
            transaction.delete_table(OLD_LIVE)?;
            transaction.commit()?;
            Ok(())
        })?;
        let (path, layers) = (self.path.display(), entries.len());
        info!(%path, layers, "graph cache: moved the layers to files of their own");
        Ok(())
    }

    /// Runs one access to the file, and turns a panic of redb on damaged data into an error.
    fn guarded<T>(&self, access: impl FnOnce() -> Result<T, redb::Error>) -> Result<T, StoreError> {
        let fail = |kind, reason| StoreError { place: self.path.display().to_string(), reason, kind };
        match catch_unwind(AssertUnwindSafe(access)) {
            Ok(result) => result.map_err(|error| fail(StoreErrorKind::Refused, error.to_string())),
            Err(_) => {
                let reason = "the file is damaged: stop all processes that use it and delete it".to_owned();
                Err(fail(StoreErrorKind::Lost, reason))
            }
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
                warn!(path = %self.path.display(), what, reason, "graph cache: ignored a damaged entry");
                None
            }
        }))
    }

    /// Whether the layer of a receipt has the content that the receipt requires.
    fn is_met(&self, expected: &Expected) -> bool {
        let layers = self.layers.read(&LevelId(expected.level)).unwrap_or_default();
        expected.is_met_by(layers.layers.iter().find(|layer| layer.name == expected.layer))
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
            warn!(%error, "graph cache: cannot record the use of a graph");
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
                    let path = self.path.display();
                    info!(%path, bytes = size, "graph cache: evicted the least recently used graph");
                }
            }
            transaction.commit()?;
            Ok(())
        })
    }

    fn live(&self, id: &GraphId) -> Result<LiveEvidence, StoreError> {
        Ok(self.read(LIVE, &id.0, "live evidence", decode_live)?.unwrap_or_default())
    }

    fn put_live(&self, id: &GraphId, live: &LiveEvidence, receipts: &[Receipt]) -> Result<(), StoreError> {
        self.guarded(|| {
            let transaction = self.database.begin_write()?;
            transaction.open_table(LIVE)?.insert(id.0.as_slice(), encode_live(live).as_slice())?;
            receipts::put(&transaction, receipts, None)?;
            transaction.commit()?;
            Ok(())
        })
    }

    fn layers(&self, level: &LevelId) -> Result<LevelLayers, StoreError> {
        self.layers.read(level)
    }

    fn put_layer(&self, level: &LevelId, layer: &Layer) -> Result<(), StoreError> {
        self.layers.put(level, layer)
    }

    fn replace_layer(
        &self,
        level: &LevelId,
        _: u64,
        layer: &Layer,
        receipt: Option<&Receipt>,
    ) -> Result<bool, StoreError> {
        let Some(receipt) = receipt else { return self.layers.put(level, layer).map(|()| true) };
        let note = |expected| {
            self.guarded(|| {
                let transaction = self.database.begin_write()?;
                receipts::put(&transaction, std::slice::from_ref(receipt), expected)?;
                transaction.commit()?;
                Ok(())
            })
        };
        let expected = Expected::of(level, layer);
        note(Some(&expected))?;
        self.layers.put(level, layer)?;
        // From now on, the receipt counts whatever happens to the layer.
        if let Err(error) = note(None) {
            warn!(%error, "graph cache: cannot confirm a receipt; a repeat of this change may be applied twice");
        }
        Ok(true)
    }

    fn receipt(&self, client: &str, id: &str) -> Result<Option<Receipt>, StoreError> {
        let found = self.guarded(|| receipts::get(&self.database.begin_read()?, client, id))?;
        Ok(found.and_then(|(receipt, expected)| expected.is_none_or(|it| self.is_met(&it)).then_some(receipt)))
    }
}

/// Opens or creates a cache file. redb verifies its file, but some damage makes it panic.
fn open_file(path: &Path) -> Result<Database, Refusal> {
    match catch_unwind(AssertUnwindSafe(|| Database::create(path))) {
        Ok(opened) => opened.map_err(Refusal::from),
        Err(_) => Err(Refusal::Damaged("the file cannot be read".to_owned())),
    }
}

/// Renames a damaged cache file to a name that no file has, and returns that name.
fn set_aside(path: &Path) -> std::io::Result<PathBuf> {
    let mut number = 1;
    loop {
        let aside =
            path.with_extension(if number == 1 { "redb.damaged".to_owned() } else { format!("redb.damaged-{number}") });
        // Reserve the name, so that the renaming overwrites only our own empty file.
        match std::fs::File::create_new(&aside) {
            Ok(_) => return std::fs::rename(path, &aside).map(|()| aside),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            Err(error) => return Err(error),
        }
    }
}
