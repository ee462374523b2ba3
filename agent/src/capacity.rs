//! A worker's capacity: what the machine can hold, and what each server is offered. Free capacity is offered to all
//! servers in equal parts.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use surefoot_policy::{Batch, Policy};
use surefoot_world::{TICKS_PER_DECISION, TICKS_PER_SECOND};
use tokio::sync::watch;

/// Share of its time that a machine spends on the policy when it holds as many NPCs as it can: worlds, plans and, above
/// all, rehearsals take the rest. On the machine of `docs/guides/scaling.md`, a core holds 950 NPCs with 6 decisions a
/// second each, and the policy alone would decide 176,000 times.
const POLICY_SHARE: f64 = 950.0 * 6.0 / 176_000.0;
/// Rows of a measured batch, and number of batches. The fastest counts, because other programs may delay some.
const MEASURED_ROWS: usize = 256;
const MEASURED_BATCHES: usize = 12;

/// NPCs for which this machine can decide, from the time that the policy takes; at least 1. Takes some 50 ms.
pub fn measure_capacity(policy: &Policy) -> u32 {
    let observations = vec![0.5; MEASURED_ROWS * policy.observation_len()];
    let mut memory = vec![0.0; MEASURED_ROWS * policy.memory_len()];
    let (mut scratch, mut actions) = (policy.scratch(MEASURED_ROWS), Vec::new());
    let mut time = || {
        let started = Instant::now();
        let batch = Batch { observations: &observations, memory: &mut memory, noise: &[] };
        policy.act(batch, &mut scratch, &mut actions);
        started.elapsed()
    };
    let fastest = (0..MEASURED_BATCHES).map(|_| time()).min().unwrap_or(Duration::MAX);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let decisions_per_second = MEASURED_ROWS as f64 / fastest.as_secs_f64() * cores as f64 * POLICY_SHARE;
    let decisions_of_an_npc = f64::from(TICKS_PER_SECOND) / f64::from(TICKS_PER_DECISION);
    ((decisions_per_second / decisions_of_an_npc) as u32).max(1)
}

/// The capacity of a worker.
#[derive(Debug)]
pub(super) struct CapacityShare {
    capacity: u32,
    /// NPCs of each connected server.
    npc_counts: Mutex<BTreeMap<String, u32>>,
    /// Grows with every change.
    version: watch::Sender<u64>,
}

impl CapacityShare {
    /// The capacity of a worker of at most `capacity` NPCs.
    pub fn new(capacity: u32) -> Self {
        Self { capacity, npc_counts: Mutex::default(), version: watch::Sender::new(0) }
    }

    /// Sets the number of NPCs of a server, which is connected from then on.
    pub fn note(&self, server: &str, npc_count: u32) {
        let before = self.npc_counts.lock().insert(server.to_owned(), npc_count);
        if before != Some(npc_count) {
            self.version.send_modify(|version| *version += 1);
        }
    }

    /// Removes a server that has disconnected.
    pub fn leave(&self, server: &str) {
        if self.npc_counts.lock().remove(server).is_some() {
            self.version.send_modify(|version| *version += 1);
        }
    }

    /// Most NPCs that a connected server may assign.
    pub fn offer(&self, server: &str) -> u32 {
        let npc_counts = self.npc_counts.lock();
        let Some(own) = npc_counts.get(server) else { return 0 };
        let free = self.capacity.saturating_sub(npc_counts.values().sum());
        let (count, number) =
            (npc_counts.len() as u32, npc_counts.keys().take_while(|name| *name != server).count() as u32);
        own + free / count + u32::from(number < free % count)
    }

    /// Most NPCs that the next server may assign when it connects.
    pub fn offer_next(&self) -> u32 {
        let npc_counts = self.npc_counts.lock();
        self.capacity.saturating_sub(npc_counts.values().sum()) / (npc_counts.len() as u32 + 1)
    }

    /// Notified when offers may have changed.
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.version.subscribe()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offers_never_exceed_the_capacity_and_leave_nothing_unused() {
        let share = CapacityShare::new(10);
        assert_eq!(share.offer("a"), 0, "not connected");
        assert_eq!(share.offer_next(), 10);
        share.note("a", 0);
        assert_eq!(share.offer("a"), 10);
        assert_eq!(share.offer_next(), 5);
        share.note("b", 0);
        share.note("c", 0);
        let offers = || ["a", "b", "c"].map(|server| share.offer(server));
        assert_eq!(offers(), [4, 3, 3]);
        share.note("b", 3);
        assert_eq!(offers(), [3, 5, 2]);
        share.note("a", 8);
        assert_eq!(offers(), [8, 3, 0], "NPCs beyond the capacity stay");
        share.leave("a");
        assert_eq!(offers(), [0, 7, 3]);
    }
}
