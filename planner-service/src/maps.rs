//! The maps of graphs. The latest are kept while nothing else needs their memory: edits, loads and probes of one map
//! follow each other.

use parking_lot::Mutex;
use std::collections::VecDeque;
use std::sync::Arc;
use surefoot_net::levels::{MapPool, MapSource, SharedMap};
use surefoot_net::memory::Cache;
use surefoot_world::Map;
use tokio::runtime::Handle;

/// Maximum number of maps that are kept although no graph needs them.
const MAX_RECENT: usize = 2;

/// The maps of graphs.
#[derive(Debug)]
pub(crate) struct RecentMaps {
    pool: MapPool,
    /// Maps without pieces, the latest last.
    recent: Mutex<VecDeque<Arc<SharedMap>>>,
}

impl RecentMaps {
    /// Creates a cache of maps from `pool`, which gives way to all else that needs the pool's memory.
    pub fn new(pool: MapPool) -> Arc<Self> {
        let maps = Arc::new(Self { pool, recent: Mutex::default() });
        maps.pool.memory().clear_when_exhausted(&maps);
        maps
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
        if recent.len() > MAX_RECENT {
            recent.pop_front();
        }
        drop(recent);
        source.finish(shared.map())
    }
}

impl Cache for RecentMaps {
    fn clear(&self) {
        let dropped = std::mem::take(&mut *self.recent.lock());
        drop(dropped);
    }
}
