//! Blobs: immutable byte strings in an object store or a folder, named by their hash. Storing the same bytes twice
//! changes nothing. Only damaged blobs are overwritten, so that a process whose lease has expired cannot do harm here.

use crate::error::FleetError;
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::prefix::PrefixStore;
use object_store::{BackoffConfig, ObjectStore, ObjectStoreExt, PutMode, PutOptions, PutPayload, RetryConfig};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;
use surefoot_planner::store::StoreErrorKind;
use tracing::warn;

/// Retries of a call, which fails after 5 s. Callers decide whether they can wait longer.
const RETRIES: RetryConfig = RetryConfig {
    backoff: BackoffConfig { init_backoff: Duration::from_millis(50), max_backoff: Duration::from_secs(1), base: 2.0 },
    max_retries: 8,
    retry_timeout: Duration::from_secs(5),
};

/// Name of a blob: the BLAKE3 hash of its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BlobId(pub [u8; 32]);

impl BlobId {
    /// The name of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The name in a row of the database.
    pub(crate) fn of_row(name: &[u8]) -> Self {
        Self(name.try_into().expect("the tables have hashes of 32 bytes only"))
    }
}

impl fmt::Display for BlobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        blake3::Hash::from_bytes(self.0).fmt(f)
    }
}

impl FromStr for BlobId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let hash = blake3::Hash::from_hex(text).map_err(|_| format!("`{text}` is not 64 hexadecimal digits"))?;
        Ok(Self(*hash.as_bytes()))
    }
}

/// A place for blobs. Clones share it.
#[derive(Debug, Clone)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    place: String,
}

impl Blobs {
    /// Opens `s3://bucket/prefix` or `file:///folder`. The folder is created. For S3, `AWS_ENDPOINT_URL`,
    /// `AWS_REGION`, `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY` set the address, the region and the keys, as for
    /// other clients of S3. `AWS_ALLOW_HTTP=true` allows an endpoint without TLS.
    pub fn open(uri: &str) -> Result<Self, FleetError> {
        let env: Vec<(String, String)> = std::env::vars().filter(|(name, _)| name.starts_with("AWS_")).collect();
        Self::open_with(uri, env.iter().map(|(name, value)| (name.as_str(), value.as_str())))
    }

    /// As [`open`](Self::open), with these variables instead of those of the process.
    pub fn open_with<'a>(uri: &str, env: impl Iterator<Item = (&'a str, &'a str)>) -> Result<Self, FleetError> {
        let fail = |reason: String| FleetError::new(format!("--blobs {uri}"), reason);
        let store: Arc<dyn ObjectStore> = if let Some(folder) = uri.strip_prefix("file://") {
            std::fs::create_dir_all(folder).map_err(|error| fail(error.to_string()))?;
            Arc::new(
                LocalFileSystem::new_with_prefix(folder).map_err(|error| fail(error.to_string()))?.with_fsync(true),
            )
        } else if let Some(place) = uri.strip_prefix("s3://") {
            // It fails if the program has installed a provider, which then serves as well.
            let _ = rustls::crypto::ring::default_provider().install_default();
            let (bucket, prefix) = place.split_once('/').unwrap_or((place, ""));
            // Variables that are not keys of the store are ignored.
            let settings = env.filter_map(|(name, value)| {
                let key = AmazonS3ConfigKey::from_str(&name.to_ascii_lowercase()).ok();
                key.map(|key| (key, value))
            });
            let builder =
                settings.fold(AmazonS3Builder::new(), |builder, (key, value)| builder.with_config(key, value));
            let store = builder.with_bucket_name(bucket).with_retry(RETRIES).build();
            let store = store.map_err(|error| FleetError::caused(format!("--blobs {uri}"), &error))?;
            Arc::new(PrefixStore::new(store, prefix))
        } else {
            return Err(fail("it is s3://bucket/prefix or file:///folder".to_owned()));
        };
        Ok(Self { store, place: uri.to_owned() })
    }

    /// Stores bytes and returns their name once they are durable. If an intact blob of their name exists, nothing
    /// changes; a damaged one is replaced.
    pub async fn put(&self, bytes: Vec<u8>) -> Result<BlobId, FleetError> {
        let (id, payload) = (BlobId::of(&bytes), PutPayload::from(bytes));
        match self.put_as(PutMode::Create, id, payload.clone()).await {
            Err(object_store::Error::AlreadyExists { .. }) => {}
            put => return put.map(|()| id).map_err(|error| self.failed(&error)),
        }
        match self.get(id).await {
            Ok(Some(_)) => return Ok(id),
            Err(error) if error.kind != StoreErrorKind::Lost => return Err(error),
            Ok(None) | Err(_) => warn!(%id, place = self.place, "blobs: replacing a damaged blob"),
        }
        let put = self.put_as(PutMode::Overwrite, id, payload).await;
        put.map(|()| id).map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &object_store::Error) -> FleetError {
        FleetError::caused(self.place.clone(), error)
    }

    async fn put_as(&self, mode: PutMode, id: BlobId, payload: PutPayload) -> Result<(), object_store::Error> {
        let options = PutOptions { mode, ..PutOptions::default() };
        self.store.put_opts(&path(id), payload, options).await.map(drop)
    }

    /// Returns the bytes with this name; `None` if there are none.
    pub async fn get(&self, id: BlobId) -> Result<Option<Vec<u8>>, FleetError> {
        let bytes = match self.store.get(&path(id)).await {
            Ok(found) => found.bytes().await.map_err(|error| self.failed(&error))?,
            Err(object_store::Error::NotFound { .. }) => return Ok(None),
            Err(error) => return Err(self.failed(&error)),
        };
        if BlobId::of(&bytes) != id {
            let reason = format!("blob {id} is damaged: restore it from a copy, or remove it");
            return Err(FleetError::lost(self.place.clone(), reason));
        }
        Ok(Some(bytes.into()))
    }

    /// Removes the bytes with this name, if they exist. Nothing may refer to them any more.
    pub async fn remove(&self, id: BlobId) -> Result<(), FleetError> {
        match self.store.delete(&path(id)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.failed(&error)),
        }
    }

    /// Address of the store.
    pub fn place(&self) -> &str {
        &self.place
    }
}

/// Two levels of folders keep each folder small.
fn path(id: BlobId) -> Path {
    let name = id.to_string();
    Path::from(format!("{}/{name}", &name[..2]))
}
