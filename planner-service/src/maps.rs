//! The maps of graphs. The latest are kept: edits, loads and probes of one map follow each other.

use parking_lot::Mutex;
use std::collections::VecDeque;
use std::sync::Arc;
use surefoot_net::levels::{MapPool, MapSource, SharedMap};
use surefoot_world::Map;
use tokio::runtime::Handle;

/// Maximum number of maps that are kept although no graph needs them.
const MAX_RECENT: usize = 2;
/// Maps that are kept take at most this part of the memory budget: a quarter.
const RECENT_SHARE: u64 = 4;

/// The maps of graphs.
pub(crate) struct RecentMaps {
    pool: MapPool,
    /// Maps without pieces, the latest last.
    recent: Mutex<VecDeque<Arc<SharedMap>>>,
}

impl RecentMaps {
    /// Creates a cache of maps from `pool`.
    pub fn new(pool: MapPool) -> Self {
        Self { pool, recent: Mutex::default() }
    }

    /// Returns the map of a source. Without room for it in memory, the map is not kept. Call this from a thread that
    /// may block.
    pub fn get(&self, source: &MapSource) -> Arc<Map> {
        let Ok(shared) = Handle::current().block_on(self.pool.get("graphs", source.base())) else {
            return source.map();
        };
        let mut recent = self.recent.lock();
        recent.retain(|other| !Arc::ptr_eq(other.map(), shared.map()));
        recent.push_back(shared.clone());
        let limit = self.pool.memory().limit_bytes() / RECENT_SHARE;
        let bytes = |recent: &VecDeque<Arc<SharedMap>>| -> u64 {
            recent.iter().map(|shared| shared.map().memory_bytes() as u64).sum()
        };
        while recent.len() > MAX_RECENT || bytes(&recent) > limit {
            recent.pop_front();
        }
        drop(recent);
        source.finish(shared.map())
    }
}
