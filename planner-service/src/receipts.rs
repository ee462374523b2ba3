//! Receipts in the cache file: a repeated call with a request id gets its first answer, also after a restart.
//!
//! Layers are files of their own, so a layer and its receipt are not one transaction. The receipt is written first,
//! with the content that the layer will have ([`Expected`]). It counts once the layer has that content. When the file
//! is opened, receipts whose layers never got it are dropped.

use redb::{Error, ReadTransaction, ReadableTable, TableDefinition, TableError, WriteTransaction};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::time::{SystemTime, UNIX_EPOCH};
use surefoot_planner::edits::Layer;
use surefoot_planner::store::{Call, LevelId, MAX_RECEIPTS, RECEIPTS_KEPT_FOR, Receipt, encode_layer};

/// By client and request id.
const RECEIPTS: TableDefinition<'static, (&'static str, &'static str), &'static [u8]> =
    TableDefinition::new("receipts");
/// Client, microseconds since 1970 and request id of all receipts.
const BY_AGE: TableDefinition<'static, (&'static str, u64, &'static str), ()> = TableDefinition::new("receipts by age");

/// The content of a layer once it is stored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Expected {
    pub level: [u8; 32],
    pub layer: String,
    /// Hash of the encoded layer; `None` if it is removed.
    content: Option<[u8; 32]>,
}

impl Expected {
    /// The content of `layer` once it is stored.
    pub fn of(level: &LevelId, layer: &Layer) -> Self {
        Self { level: level.0, layer: layer.name.clone(), content: content_of(Some(layer)) }
    }

    /// Whether the layer of this name, if there is one, has this content.
    pub fn is_met_by(&self, layer: Option<&Layer>) -> bool {
        self.content == content_of(layer)
    }
}

fn content_of(layer: Option<&Layer>) -> Option<[u8; 32]> {
    layer.filter(|layer| !layer.edits.is_empty()).map(|layer| *blake3::hash(&encode_layer(layer)).as_bytes())
}

#[derive(Serialize, Deserialize)]
struct Entry {
    request: [u8; 32],
    answer: Vec<u8>,
    written_us: u64,
    expected: Option<Expected>,
}

fn now_us() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros() as u64
}

fn is_old(written_us: u64) -> bool {
    u128::from(now_us().saturating_sub(written_us)) >= RECEIPTS_KEPT_FOR.as_micros()
}

/// Writes receipts, in place of those of the same calls, and drops those of their clients that are too old or too many.
pub(crate) fn put(
    transaction: &WriteTransaction,
    receipts: &[Receipt],
    expected: Option<&Expected>,
) -> Result<(), Error> {
    let written_us = now_us();
    for Receipt { call: Call { client, id, request }, answer } in receipts {
        remove(transaction, client, id)?;
        let entry = Entry { request: *request, answer: answer.clone(), written_us, expected: expected.cloned() };
        let bytes = postcard::to_stdvec(&entry).expect("plain data");
        transaction.open_table(RECEIPTS)?.insert((client.as_str(), id.as_str()), bytes.as_slice())?;
        transaction.open_table(BY_AGE)?.insert((client.as_str(), written_us, id.as_str()), ())?;
    }
    let clients: BTreeSet<&str> = receipts.iter().map(|receipt| receipt.call.client.as_str()).collect();
    clients.into_iter().try_for_each(|client| drop_surplus(transaction, client))
}

/// Drops the receipts of a client that are too old, and the oldest beyond [`MAX_RECEIPTS`].
fn drop_surplus(transaction: &WriteTransaction, client: &str) -> Result<(), Error> {
    let mut ages = Vec::new();
    for age in transaction.open_table(BY_AGE)?.range((client, 0u64, "")..(client, u64::MAX, ""))? {
        let (key, _) = age?;
        let (_, written_us, id) = key.value();
        ages.push((written_us, id.to_owned()));
    }
    let surplus = ages.len().saturating_sub(MAX_RECEIPTS);
    for (idx, (written_us, id)) in ages.iter().enumerate() {
        if idx < surplus || is_old(*written_us) {
            remove(transaction, client, id)?;
        }
    }
    Ok(())
}

/// Removes the receipt of a call, if there is one.
pub(crate) fn remove(transaction: &WriteTransaction, client: &str, id: &str) -> Result<(), Error> {
    let removed = transaction.open_table(RECEIPTS)?.remove((client, id))?.and_then(|bytes| decode(bytes.value()));
    if let Some(Entry { written_us, .. }) = removed {
        transaction.open_table(BY_AGE)?.remove((client, written_us, id))?;
    }
    Ok(())
}

/// Returns the receipt of a call, and the content of its layer that it requires to count.
pub(crate) fn get(
    transaction: &ReadTransaction,
    client: &str,
    id: &str,
) -> Result<Option<(Receipt, Option<Expected>)>, Error> {
    let table = match transaction.open_table(RECEIPTS) {
        Ok(table) => table,
        Err(TableError::TableDoesNotExist(_)) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let entry = table.get((client, id))?.and_then(|bytes| decode(bytes.value()));
    Ok(entry.filter(|entry| !is_old(entry.written_us)).map(|Entry { request, answer, expected, .. }| {
        let call = Call { client: client.to_owned(), id: id.to_owned(), request };
        (Receipt { call, answer }, expected)
    }))
}

/// Returns the receipts that are too old, and those that a crash may have left open, with what they require.
pub(crate) fn unsettled(transaction: &ReadTransaction) -> Result<Vec<(Receipt, Option<Expected>)>, Error> {
    let table = match transaction.open_table(RECEIPTS) {
        Ok(table) => table,
        Err(TableError::TableDoesNotExist(_)) => return Ok(Vec::new()),
        Err(error) => return Err(error.into()),
    };
    let mut found = Vec::new();
    for entry in table.iter()? {
        let (key, bytes) = entry?;
        let (client, id) = key.value();
        let Some(Entry { request, answer, written_us, expected }) = decode(bytes.value()) else { continue };
        let expected = expected.filter(|_| !is_old(written_us));
        if is_old(written_us) || expected.is_some() {
            let call = Call { client: client.to_owned(), id: id.to_owned(), request };
            found.push((Receipt { call, answer }, expected));
        }
    }
    Ok(found)
}

/// `None` if the entry is damaged: the call then counts as new.
fn decode(bytes: &[u8]) -> Option<Entry> {
    postcard::from_bytes(bytes).ok()
}
