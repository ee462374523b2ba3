//! Connected NPC workers: their numbers of NPCs, and the bounded queues of their messages.

use crate::ids::WorkerId;
use crate::messages::{Hello, ToWorker};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_world::sense::observation_len;
use tokio::sync::Notify;
use tokio::sync::mpsc::Sender;
use tracing::warn;

/// Time for which a worker that left observations unanswered gets NPCs only if no other worker has room.
const DISTRUST: Duration = Duration::from_secs(30);

/// A worker that has just joined.
#[derive(Debug)]
pub struct Joined {
    /// Id of the worker.
    pub id: WorkerId,
    /// Notified when the worker must be disconnected because it does not read.
    pub cut: Arc<Notify>,
}

/// A worker and its load, for metrics.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WorkerLoad {
    /// Id of the worker.
    pub id: WorkerId,
    /// Name from its hello.
    pub name: String,
    /// Policy from its hello.
    pub policy: String,
    /// Most NPCs that the worker can decide for.
    pub capacity: u32,
    /// NPCs that are assigned to the worker.
    pub npc_count: u32,
    /// Messages that the worker has not read yet.
    pub queued: usize,
}

#[derive(Debug)]
struct Entry {
    hello: Hello,
    npc_count: u32,
    queue: Sender<ToWorker>,
    cut: Arc<Notify>,
    /// Until then it gets NPCs only if no other worker has room, because it left observations unanswered.
    distrusted_until: Option<Instant>,
}

impl Entry {
    fn is_distrusted(&self) -> bool {
        self.distrusted_until.is_some_and(|until| Instant::now() < until)
    }

    /// Share of the capacity that `npc_count` NPCs take.
    fn share(&self, npc_count: u32) -> f64 {
        // A worker without capacity gets no NPCs, and its NPCs move to other workers.
        f64::from(npc_count) / f64::from(self.hello.capacity.max(1))
    }
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

impl Inner {
    /// Returns the worker with room whose share would be the smallest with one more NPC, and that share.
    fn least_loaded(&self) -> Option<(WorkerId, f64)> {
        let with_one_more = |entry: &Entry| (entry.is_distrusted(), entry.share(entry.npc_count + 1));
        let open = self.workers.iter().filter(|(_, entry)| entry.npc_count < entry.hello.capacity);
        let open = open.map(|(&id, entry)| (id, with_one_more(entry)));
        let (id, (_, share)) = open.min_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
        Some((id, share))
    }
}

impl Registry {
    /// Adds a worker.
    pub fn join(&self, hello: Hello, queue: Sender<ToWorker>) -> Joined {
        let mut inner = self.inner.lock();
        inner.last_id += 1;
        let (id, cut) = (WorkerId(inner.last_id), Arc::new(Notify::new()));
        inner.workers.insert(id, Entry { hello, npc_count: 0, queue, cut: cut.clone(), distrusted_until: None });
        Joined { id, cut }
    }

    /// Length of the observations that a worker expects; without others if it has left.
    pub fn observation_len(&self, id: WorkerId) -> usize {
        observation_len(self.inner.lock().workers.get(&id).is_some_and(|entry| entry.hello.sees_others))
    }

    /// Changes the capacity of a worker, which keeps its NPCs. Returns whether the capacity grows.
    pub fn set_capacity(&self, id: WorkerId, capacity: u32) -> bool {
        self.inner.lock().workers.get_mut(&id).is_some_and(|entry| {
            let before = std::mem::replace(&mut entry.hello.capacity, capacity);
            before < capacity
        })
    }

    /// Removes a worker.
    pub fn leave(&self, id: WorkerId) {
        self.inner.lock().workers.remove(&id);
    }

    /// Reserves a place for an NPC with the least loaded worker, by share of its capacity; `None` if no worker has
    /// room.
    pub fn assign(&self) -> Option<WorkerId> {
        let mut inner = self.inner.lock();
        let (id, _) = inner.least_loaded()?;
        inner.workers.get_mut(&id)?.npc_count += 1;
        Some(id)
    }

    /// Number of workers if none has room; `None` if some worker has room.
    pub fn full_count(&self) -> Option<usize> {
        let inner = self.inner.lock();
        let is_full = inner.workers.values().all(|entry| entry.npc_count >= entry.hello.capacity);
        is_full.then_some(inner.workers.len())
    }

    /// Moves the place of an NPC from `from` to another worker, if that worker is then not more loaded than `from`.
    pub fn move_to_less_loaded(&self, from: WorkerId) -> Option<WorkerId> {
        let mut inner = self.inner.lock();
        let (to, share) = inner.least_loaded().filter(|(to, _)| !inner.workers[to].is_distrusted())?;
        let entry = inner.workers.get_mut(&from)?;
        if to == from || share > entry.share(entry.npc_count.saturating_sub(1)) {
            return None;
        }
        entry.npc_count -= 1;
        inner.workers.get_mut(&to)?.npc_count += 1;
        Some(to)
    }

    /// Gives NPCs to `id` only if no other worker has room, for 30 s: it does not answer.
    pub fn distrust(&self, id: WorkerId) {
        if let Some(entry) = self.inner.lock().workers.get_mut(&id) {
            entry.distrusted_until = Some(Instant::now() + DISTRUST);
        }
    }

    /// Moves a place from a silent worker to one that answers and has room.
    pub fn move_from_silent(&self, silent: WorkerId) -> Option<WorkerId> {
        let mut inner = self.inner.lock();
        let (next, _) = inner.least_loaded().filter(|(next, _)| !inner.workers[next].is_distrusted())?;
        inner.workers.get_mut(&next)?.npc_count += 1;
        if let Some(entry) = inner.workers.get_mut(&silent) {
            entry.npc_count = entry.npc_count.saturating_sub(1);
        }
        Some(next)
    }

    /// Takes the place of an NPC again whose move from `id` is cancelled.
    pub fn retake(&self, id: WorkerId) {
        if let Some(entry) = self.inner.lock().workers.get_mut(&id) {
            entry.npc_count += 1;
        }
    }

    /// Returns a place of a worker.
    pub fn release(&self, id: WorkerId) {
        if let Some(entry) = self.inner.lock().workers.get_mut(&id) {
            entry.npc_count = entry.npc_count.saturating_sub(1);
        }
    }

    /// Queues observations. If the queue is full, they are dropped, and the decisions count as missed.
    pub fn try_observe(&self, id: WorkerId, message: ToWorker) {
        let queue = self.inner.lock().workers.get(&id).map(|entry| entry.queue.clone());
        if let Some(queue) = queue {
            // Also dropped if the worker has left.
            let _ = queue.try_send(message);
        }
    }

    /// Queues a message that a worker must not miss. If the queue is full, the worker is disconnected, and its NPCs
    /// move to other workers.
    pub fn send_or_cut(&self, id: WorkerId, message: ToWorker) {
        let inner = self.inner.lock();
        let Some(entry) = inner.workers.get(&id) else { return };
        if entry.queue.try_send(message).is_err() {
            warn!(worker = id.0, name = entry.hello.name, "worker does not read its messages; disconnected");
            entry.cut.notify_one();
        }
    }

    /// Returns all workers, ordered by id.
    pub fn load(&self) -> Vec<WorkerLoad> {
        let load = |(&id, entry): (&WorkerId, &Entry)| WorkerLoad {
            id,
            name: entry.hello.name.clone(),
            policy: entry.hello.policy.clone(),
            capacity: entry.hello.capacity,
            npc_count: entry.npc_count,
            queued: entry.queue.max_capacity() - entry.queue.capacity(),
        };
        self.inner.lock().workers.iter().map(load).collect()
    }
}
