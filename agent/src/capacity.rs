//! A worker's capacity: free capacity is offered to all its servers in equal parts.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use tokio::sync::watch;

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
