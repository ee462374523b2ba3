//! NPC workers: who is connected, who carries how many NPCs, and the bounded queues to them.

use std::collections::BTreeMap;
use std::sync::Mutex;
use surefoot_proto::world::v1::WorkResponse;
use tokio::sync::mpsc::Sender;
use tonic::Status;

/// Id of a connected worker on this server; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WorkerId(pub u64);

/// A message to a worker, or the status that ends its stream.
pub type ToWorker = Result<WorkResponse, Status>;

#[derive(Debug)]
struct Entry {
    capacity: u32,
    carried: u32,
    queue: Sender<ToWorker>,
}

/// All connected workers.
#[derive(Debug, Default)]
pub struct Registry {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    last_id: u64,
    workers: BTreeMap<WorkerId, Entry>,
}

impl Registry {
    fn inner(&self) -> std::sync::MutexGuard<'_, Inner> {
        self.inner.lock().expect("no holder of this lock panics")
    }

    /// Adds a worker that carries at most `capacity` NPCs.
    pub fn join(&self, capacity: u32, queue: Sender<ToWorker>) -> WorkerId {
        let mut inner = self.inner();
        inner.last_id += 1;
        let id = WorkerId(inner.last_id);
        inner.workers.insert(id, Entry { capacity, carried: 0, queue });
        id
    }

    /// Forgets a worker.
    pub fn leave(&self, id: WorkerId) {
        self.inner().workers.remove(&id);
    }

    /// Takes a place with the worker that has the smallest share of its capacity in use.
    pub fn assign(&self) -> Option<WorkerId> {
        let mut inner = self.inner();
        let share = |entry: &Entry| f64::from(entry.carried) / f64::from(entry.capacity);
        let (&id, entry) = inner
            .workers
            .iter_mut()
            .filter(|(_, entry)| entry.carried < entry.capacity)
            .min_by(|(_, a), (_, b)| share(a).total_cmp(&share(b)))?;
        entry.carried += 1;
        Some(id)
    }

    /// Gives a place back.
    pub fn release(&self, id: WorkerId) {
        if let Some(entry) = self.inner().workers.get_mut(&id) {
            entry.carried = entry.carried.saturating_sub(1);
        }
    }

    /// Queues a message; false if the worker is gone or its queue is full (the message is then lost).
    pub fn send(&self, id: WorkerId, message: WorkResponse) -> bool {
        let queue = self.inner().workers.get(&id).map(|entry| entry.queue.clone());
        queue.is_some_and(|queue| queue.try_send(Ok(message)).is_ok())
    }

    /// Connected workers and the NPCs they carry.
    pub fn load(&self) -> (usize, u32) {
        let inner = self.inner();
        (inner.workers.len(), inner.workers.values().map(|entry| entry.carried).sum())
    }
}
