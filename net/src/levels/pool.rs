//! Generated maps in use. Equal maps are shared; memory for a map is reserved before it is generated.

use super::store::BaseMap;
use crate::memory::{DEFAULT_MAX_MEMORY_BYTES, MemoryBudget, MemoryError, Reservation};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};
use surefoot_world::map::MapSize;
use surefoot_world::{Map, MapSpec};
use tokio::sync::{OwnedMutexGuard, Semaphore};

/// Maps that are generated at the same time. Parts of a generation use all cores.
const GENERATED_AT_A_TIME: usize = 2;

/// A map in use. Its memory is returned with the last user.
#[derive(Debug)]
pub struct SharedMap {
    map: Arc<Map>,
    /// None for an imported level, whose store has the reservation.
    _memory: Option<Reservation>,
}

impl SharedMap {
    /// The map.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }
}

/// Why there is no map.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The memory budget is exhausted.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// Generating it panicked.
    #[error("map generation failed: {0}")]
    Lost(#[from] tokio::task::JoinError),
}

/// A map that may be in use. The task that generates it holds the lock.
type Slot = Arc<tokio::sync::Mutex<Weak<SharedMap>>>;

/// The generated maps of a service; clones share them.
#[derive(Debug, Clone)]
pub struct MapPool {
    memory: MemoryBudget,
    turns: Arc<Semaphore>,
    by_spec: Arc<Mutex<BTreeMap<String, Slot>>>,
}

impl Default for MapPool {
    fn default() -> Self {
        Self::within(DEFAULT_MAX_MEMORY_BYTES)
    }
}

impl MapPool {
    /// An empty pool whose maps count against `memory`.
    pub fn new(memory: MemoryBudget) -> Self {
        Self { memory, turns: Arc::new(Semaphore::new(GENERATED_AT_A_TIME)), by_spec: Arc::default() }
    }

    /// An empty pool with a budget of `max_bytes`.
    pub fn within(max_bytes: u64) -> Self {
        Self::new(MemoryBudget::new(max_bytes))
    }

    /// The memory budget.
    pub fn memory(&self) -> &MemoryBudget {
        &self.memory
    }

    /// The base map. An equal map that is in use or being generated is shared. A generation continues when its caller
    /// disconnects, and holds its memory until it is done.
    pub async fn get(&self, client: &str, source: &BaseMap) -> Result<Arc<SharedMap>, MapError> {
        let spec = match source {
            BaseMap::Level(level) => return Ok(Arc::new(SharedMap { map: level.map.clone(), _memory: None })),
            BaseMap::Spec(spec) => *spec,
        };
        let slot = self.slot(source.key());
        let shared = slot.lock_owned().await;
        if let Some(shared) = shared.upgrade() {
            return Ok(shared);
        }
        // Never closed. Waiting callers hold no memory: a generation needs three times the memory of the map.
        let turn = self.turns.clone().acquire_owned().await.ok();
        let memory = self.memory.reserve(client, generation_bytes(spec.size))?;
        let task = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            generate(&spec, memory, shared)
        });
        Ok(task.await?)
    }

    /// Counts a map that exists already, such as a restored one, even beyond the budget.
    pub fn adopt(&self, client: &str, map: Arc<Map>) -> Arc<SharedMap> {
        let memory = map.spec().is_some().then(|| self.memory.grant(client, map.memory_bytes() as u64));
        Arc::new(SharedMap { map, _memory: memory })
    }

    fn slot(&self, key: String) -> Slot {
        let mut by_spec = self.by_spec.lock();
        // Removes maps that are no longer in use.
        by_spec
            .retain(|_, slot| Arc::strong_count(slot) > 1 || slot.try_lock().is_ok_and(|map| map.strong_count() > 0));
        by_spec.entry(key).or_default().clone()
    }
}

fn generate(spec: &MapSpec, mut memory: Reservation, mut slot: OwnedMutexGuard<Weak<SharedMap>>) -> Arc<SharedMap> {
    let map = Arc::new(surefoot_generate::generate(spec));
    // Less than the estimate: it always fits.
    let _ = memory.resize(map.memory_bytes() as u64);
    let shared = Arc::new(SharedMap { map, _memory: Some(memory) });
    *slot = Arc::downgrade(&shared);
    shared
}

/// Peak memory of a generation, as measured: 54 MB for 250 x 80 x 250 m, 0.78 GB for 1000 x 80 x 1000 m, 0.88 GB for
/// 1000 x 200 x 1000 m.
fn generation_bytes(size: MapSize) -> u64 {
    let area = u64::from(size.width) * u64::from(size.depth);
    4_000_000 + area * (730 + u64::from(size.height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_world::MapSpec;

    fn source(seed: u64) -> BaseMap {
        BaseMap::Spec(MapSpec::with_side(seed, 50).unwrap())
    }

    #[tokio::test]
    async fn equal_maps_are_shared_and_counted_once_until_the_last_user_is_gone() {
        let pool = MapPool::new(MemoryBudget::new(1_000_000_000));
        let source = source(1);
        let (first, second) = tokio::join!(pool.get("a", &source), pool.get("b", &source));
        let (first, second) = (first.unwrap(), second.unwrap());
        assert!(Arc::ptr_eq(first.map(), second.map()));
        assert_eq!(pool.memory().used_bytes(), first.map().memory_bytes() as u64);
        drop((first, second));
        assert_eq!(pool.memory().used_bytes(), 0);
        let again = pool.get("a", &source).await.unwrap();
        assert_eq!(pool.memory().used_bytes(), again.map().memory_bytes() as u64);
    }

    #[tokio::test]
    async fn callers_that_give_up_leave_no_more_generations_than_the_budget_holds() {
        // Room for one map at a time.
        let pool = MapPool::new(MemoryBudget::new(generation_bytes(MapSize { width: 50, height: 80, depth: 50 })));
        let (mut begun, mut refused) = (0, 0);
        for seed in 0..20 {
            let source = source(seed);
            let mut call = Box::pin(pool.get("hasty", &source));
            match std::future::poll_fn(|context| std::task::Poll::Ready(call.as_mut().poll(context))).await {
                std::task::Poll::Ready(Err(MapError::Memory(_))) => refused += 1,
                _ => begun += 1,
            }
        }
        assert!(begun >= 1 && refused >= 1, "{begun} begun, {refused} refused");
        assert!(begun + refused == 20);
    }
}
