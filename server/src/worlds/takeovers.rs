//! Worlds that the store of a fleet assigns to this server and that do not run: those that are being restored, and
//! those that failed and wait for a pause. All others are restored after the next claim.

use crate::ids::WorldId;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;

/// Worlds that are restored at the same time. The save of each is in memory.
const RESTORED_AT_A_TIME: usize = 2;
/// Pause after the first failure, and the longest pause. Each further failure doubles it.
const PAUSES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(60)];

/// Worlds of this server that do not run.
#[derive(Debug)]
pub(super) struct Takeovers {
    /// Turns of worlds that are restored.
    pub turns: Semaphore,
    entries: Mutex<Entries>,
}

#[derive(Debug, Default)]
struct Entries {
    restoring: BTreeSet<WorldId>,
    failures: BTreeMap<WorldId, Failure>,
}

#[derive(Debug, Clone, Copy)]
struct Failure {
    pause: Duration,
    until: Instant,
}

impl Failure {
    /// Whether a failure now counts as a further one.
    fn is_recent(&self, now: Instant) -> bool {
        now < self.until + PAUSES[1]
    }
}

impl Default for Takeovers {
    fn default() -> Self {
        Self { turns: Semaphore::new(RESTORED_AT_A_TIME), entries: Mutex::default() }
    }
}

impl Takeovers {
    /// Notes that a world is being restored, until [`end`](Self::end).
    pub fn begin(&self, id: WorldId) {
        self.entries.lock().restoring.insert(id);
    }

    /// Notes that a world is no longer being restored.
    pub fn end(&self, id: WorldId) {
        self.entries.lock().restoring.remove(&id);
    }

    /// Begins a pause for a world that cannot be restored here, or has panicked.
    pub fn note_failure(&self, id: WorldId) {
        let now = Instant::now();
        let mut entries = self.entries.lock();
        entries.failures.retain(|_, failure| failure.is_recent(now));
        let pause = entries.failures.get(&id).map_or(PAUSES[0], |failure| (failure.pause * 2).min(PAUSES[1]));
        entries.failures.insert(id, Failure { pause, until: now + pause });
    }

    /// Worlds that are being restored, or wait for a pause.
    pub fn ids(&self) -> BTreeSet<WorldId> {
        let now = Instant::now();
        let entries = self.entries.lock();
        let paused = entries.failures.iter().filter(|(_, failure)| now < failure.until).map(|(&id, _)| id);
        entries.restoring.iter().copied().chain(paused).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_world_that_fails_again_is_left_alone_for_longer() {
        let takeovers = Takeovers::default();
        let pause = |id| takeovers.entries.lock().failures[&WorldId(id)].pause;
        for expected in [1, 2, 4, 8, 16, 32, 60, 60] {
            takeovers.note_failure(WorldId(7));
            assert_eq!(pause(7), Duration::from_secs(expected));
        }
        takeovers.begin(WorldId(8));
        takeovers.note_failure(WorldId(9));
        assert_eq!(pause(9), PAUSES[0], "worlds fail by themselves");
        assert_eq!(takeovers.ids(), [7, 8, 9].map(WorldId).into());
        takeovers.end(WorldId(8));
        let long_ago = Failure { pause: PAUSES[1], until: Instant::now() };
        takeovers.entries.lock().failures.insert(WorldId(7), long_ago);
        assert_eq!(takeovers.ids(), [WorldId(9)].into());
        takeovers.note_failure(WorldId(7));
        assert_eq!(pause(7), PAUSES[1], "a pause that has just ended counts");
    }
}
