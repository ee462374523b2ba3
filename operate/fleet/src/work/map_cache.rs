//! Maps of jobs: how a job names its map, and the maps that a prover keeps.

use super::job::Refusal;
use crate::blobs::{BlobId, Blobs};
use crate::error::FleetError;
use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use surefoot_world::{Map, MapSpec};
use tokio::runtime::Handle;

/// Number of maps that a prover keeps. Jobs of one build follow each other.
const KEPT: usize = 2;
/// Number of tries to read a blob.
const TRIES: u32 = 3;
/// Pause between tries.
const PAUSE: Duration = Duration::from_millis(500);

/// What a map is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum MapRef {
    /// It is generated.
    Spec(MapSpec),
    /// It is stored as a blob.
    Saved {
        /// Hash of the map.
        map: [u8; 32],
        /// Name of the blob.
        blob: [u8; 32],
    },
}

impl MapRef {
    /// Stores a map for provers.
    pub async fn save(map: &Map, blobs: Option<&Blobs>) -> Result<Self, FleetError> {
        let blobs = blobs.ok_or_else(|| FleetError::new("--blobs", "imported levels need a store"))?;
        let blob = blobs.put(surefoot_levels::encode(map)).await?;
        Ok(Self::Saved { map: map.hash().0, blob: blob.0 })
    }
}

/// The maps that a prover used last.
#[derive(Debug)]
pub struct MapCache {
    blobs: Option<Blobs>,
    runtime: Handle,
    kept: Mutex<VecDeque<(MapRef, Arc<Map>)>>,
}

impl MapCache {
    /// Creates an empty cache. Stored maps come from `blobs`. Call this on a tokio runtime.
    pub fn new(blobs: Option<Blobs>) -> Self {
        Self { blobs, runtime: Handle::current(), kept: Mutex::default() }
    }

    /// Returns the store of maps.
    pub fn blobs(&self) -> Option<&Blobs> {
        self.blobs.as_ref()
    }

    /// Returns the runtime that waits for blobs.
    pub fn runtime(&self) -> &Handle {
        &self.runtime
    }

    /// Returns a map. One thread generates it while others wait: they mostly want the same map.
    pub fn map(&self, name: &MapRef) -> Result<Arc<Map>, Refusal> {
        let mut kept = self.kept.lock();
        if let Some(at) = kept.iter().position(|(known, _)| known == name) {
            let found = kept.remove(at).expect("just found");
            kept.push_back(found);
        } else {
            // Evicts first: large maps take gigabytes.
            while kept.len() >= KEPT {
                kept.pop_front();
            }
            let map = match name {
                MapRef::Spec(spec) => Arc::new(surefoot_generate::generate(spec)),
                MapRef::Saved { map, blob } => Arc::new(self.load(*map, BlobId(*blob))?),
            };
            kept.push_back((name.clone(), map));
        }
        Ok(kept.back().expect("just put there").1.clone())
    }

    fn load(&self, map: [u8; 32], blob: BlobId) -> Result<Map, Refusal> {
        let bytes = self.fetch(blob)?;
        let found =
            surefoot_levels::decode(&bytes).map_err(|error| Refusal::impossible(format!("blob {blob}: {error}")))?;
        if found.hash().0 != map {
            return Err(Refusal::impossible(format!("blob {blob} is another map than its job says")));
        }
        Ok(found)
    }

    /// Returns the bytes of a blob.
    pub fn fetch(&self, blob: BlobId) -> Result<Vec<u8>, Refusal> {
        let blobs = self.blobs.as_ref().ok_or_else(|| Refusal::unable("this process has no --blobs"))?;
        let mut last = String::new();
        for _ in 0..TRIES {
            match self.runtime.block_on(blobs.get(blob)) {
                Ok(Some(bytes)) => return Ok(bytes),
                Ok(None) => return Err(Refusal::unable(format!("{} has no blob {blob}", blobs.place()))),
                Err(error) => last = error.to_string(),
            }
            std::thread::sleep(PAUSE);
        }
        Err(Refusal::unable(last))
    }
}
