//! A service's memory budget: the bytes that each client holds. Requests are refused before they allocate.

use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

/// Fits a machine with 4 GB, beside the rest of the process and one import at a time.
pub const DEFAULT_MAX_MEMORY_BYTES: u64 = 2_000_000_000;
const MB: f64 = 1.0e6;

/// The memory budget of a service; clones share it. It counts maps, environments, kept answers and large requests.
#[derive(Debug, Clone)]
pub struct MemoryBudget {
    limit_bytes: u64,
    used: Arc<Mutex<BTreeMap<Arc<str>, u64>>>,
    caches: Arc<Mutex<Vec<Weak<dyn Cache>>>>,
}

/// Memory that is held only to save work.
pub trait Cache: std::fmt::Debug + Send + Sync {
    /// Drops everything. It is called before a request is refused.
    fn clear(&self);
}

/// Bytes that a client holds; dropping it returns them.
#[derive(Debug)]
pub struct Reservation {
    budget: MemoryBudget,
    client: Arc<str>,
    bytes: u64,
}

/// A request that exceeds the rest of the budget.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "this needs about {:.0} MB, but {:.0} of {:.0} MB are in use ({}): drop worlds, close environments or raise \
     --max-memory",
    *needed as f64 / MB, *used as f64 / MB, *limit as f64 / MB, by_client(holders)
)]
pub struct MemoryError {
    needed: u64,
    used: u64,
    limit: u64,
    /// The largest first.
    holders: Vec<(Arc<str>, u64)>,
}

/// Number of clients that an error names.
const NAMED: usize = 4;

fn by_client(holders: &[(Arc<str>, u64)]) -> String {
    let mut parts: Vec<String> =
        holders.iter().take(NAMED).map(|(client, bytes)| format!("{client}: {:.0} MB", *bytes as f64 / MB)).collect();
    let rest: u64 = holders.iter().skip(NAMED).map(|(_, bytes)| bytes).sum();
    if rest > 0 {
        parts.push(format!("others: {:.0} MB", rest as f64 / MB));
    }
    if parts.is_empty() { "by no client".to_owned() } else { parts.join(", ") }
}

impl MemoryBudget {
    /// A budget of `limit_bytes`.
    pub fn new(limit_bytes: u64) -> Self {
        Self { limit_bytes, used: Arc::default(), caches: Arc::default() }
    }

    /// Clears `cache` whenever the budget is exhausted, for as long as the cache lives.
    pub fn clear_when_exhausted(&self, cache: &Arc<impl Cache + 'static>) {
        let cache = Arc::downgrade(cache);
        self.caches.lock().push(cache);
    }

    /// Most bytes in use.
    pub fn limit_bytes(&self) -> u64 {
        self.limit_bytes
    }

    /// Bytes in use.
    pub fn used_bytes(&self) -> u64 {
        self.used.lock().values().sum()
    }

    /// Reserves memory for a client.
    pub fn reserve(&self, client: &str, bytes: u64) -> Result<Reservation, MemoryError> {
        let mut used = self.room_for(bytes)?;
        Ok(self.add(&mut used, client, bytes))
    }

    /// Reserves memory even beyond the limit, as for worlds that are restored.
    pub fn grant(&self, client: &str, bytes: u64) -> Reservation {
        self.add(&mut self.used.lock(), client, bytes)
    }

    /// Locks the budget with room for so many bytes more.
    fn room_for(&self, bytes: u64) -> Result<MutexGuard<'_, BTreeMap<Arc<str>, u64>>, MemoryError> {
        let used = self.used.lock();
        if self.check(&used, bytes).is_ok() {
            return Ok(used);
        }
        // What caches drop returns its memory to this budget.
        drop(used);
        self.caches.lock().retain(|cache| cache.upgrade().inspect(|cache| cache.clear()).is_some());
        let used = self.used.lock();
        self.check(&used, bytes)?;
        Ok(used)
    }

    fn check(&self, used: &BTreeMap<Arc<str>, u64>, needed: u64) -> Result<(), MemoryError> {
        let total: u64 = used.values().sum();
        if total.saturating_add(needed) <= self.limit_bytes {
            return Ok(());
        }
        let mut holders: Vec<_> = used.iter().map(|(client, bytes)| (client.clone(), *bytes)).collect();
        holders.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
        Err(MemoryError { needed, used: total, limit: self.limit_bytes, holders })
    }

    fn add(&self, used: &mut BTreeMap<Arc<str>, u64>, client: &str, bytes: u64) -> Reservation {
        let client: Arc<str> = client.into();
        *used.entry(client.clone()).or_default() += bytes;
        Reservation { budget: self.clone(), client, bytes }
    }
}

impl Reservation {
    /// Replaces an estimate by the bytes that are really held. If the increase exceeds the rest of the budget, the
    /// reservation does not change.
    pub fn resize(&mut self, bytes: u64) -> Result<(), MemoryError> {
        let mut used = self.budget.room_for(bytes.saturating_sub(self.bytes))?;
        if let Some(held) = used.get_mut(&self.client) {
            *held = *held - self.bytes + bytes;
        }
        self.bytes = bytes;
        Ok(())
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        let mut used = self.budget.used.lock();
        if let Some(held) = used.get_mut(&self.client) {
            *held -= self.bytes;
            if *held == 0 {
                used.remove(&self.client);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Default)]
    struct Kept(Mutex<Vec<Reservation>>);

    impl Cache for Kept {
        fn clear(&self) {
            self.0.lock().clear();
        }
    }

    #[test]
    fn caches_give_way_to_requests_and_only_to_those_that_need_their_memory() {
        let budget = MemoryBudget::new(100);
        let kept = Arc::new(Kept::default());
        budget.clear_when_exhausted(&kept);
        kept.0.lock().push(budget.reserve("cache", 60).unwrap());
        let mut held = budget.reserve("world", 40).unwrap();
        assert_eq!(budget.used_bytes(), 100);
        held.resize(41).unwrap();
        assert_eq!(budget.used_bytes(), 41);

        kept.0.lock().push(budget.reserve("cache", 59).unwrap());
        drop(kept);
        let error = budget.reserve("world", 60).unwrap_err();
        assert!(error.to_string().contains("world: 0 MB"), "{error}");
        assert_eq!(budget.used_bytes(), 41);
    }
}
