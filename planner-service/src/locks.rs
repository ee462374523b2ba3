//! The invariant of the service's locks, and the locks of levels.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, Weak};
use surefoot_planner::store::LevelId;

/// Panic message for a poisoned lock. Locks are never poisoned, because no code panics while holding one.
pub(crate) const POISON: &str = "no holder of this lock panics";

/// One lock for each level: held while its layers are stored and published, never while edges are proved.
#[derive(Debug, Default)]
pub(crate) struct LevelLocks(Mutex<HashMap<LevelId, Weak<Mutex<()>>>>);

impl LevelLocks {
    /// Returns the lock of a level.
    pub fn of(&self, level: &LevelId) -> Arc<Mutex<()>> {
        let mut locks = self.0.lock().expect(POISON);
        locks.retain(|_, lock| lock.strong_count() > 0);
        if let Some(lock) = locks.get(level).and_then(Weak::upgrade) {
            return lock;
        }
        let lock = Arc::default();
        locks.insert(*level, Arc::downgrade(&lock));
        lock
    }
}
