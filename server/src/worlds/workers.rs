//! Calls of workers, and calls to all worlds when workers come and go.

use super::Worlds;
use crate::hosted::HostedWorld;
use crate::ids::{WorkerId, WorldId};
use crate::messages::{Answer, Hello, ToWorker};
use crate::registry::Joined;
use tokio::sync::mpsc;
use tracing::{info, warn};

impl Worlds {
    /// Adds a worker. `queue` receives the welcome, then all other messages to the worker.
    pub fn join(&self, hello: Hello, queue: mpsc::Sender<ToWorker>) -> Joined {
        info!(name = hello.name, policy = hello.policy, capacity = hello.capacity, "worker joined");
        let joined = self.inner.registry.join(hello, queue.clone());
        // The queue is new and empty.
        let _ = queue.try_send(ToWorker::Welcome(joined.id));
        self.cast_all(HostedWorld::rebalance);
        joined
    }

    /// Changes the capacity of a worker. Worlds use added capacity at once.
    pub fn set_capacity(&self, worker: WorkerId, capacity: u32) {
        if self.inner.registry.set_capacity(worker, capacity) {
            self.cast_all(HostedWorld::assign_workers);
        }
    }

    /// Number of workers if none has room for another NPC; `None` if some worker has room.
    pub fn full_workers(&self) -> Option<usize> {
        self.inner.registry.full_count()
    }

    /// Removes a worker and assigns its NPCs to others.
    pub fn leave(&self, worker: WorkerId) {
        info!(worker = worker.0, "worker left");
        self.inner.registry.leave(worker);
        self.cast_all(move |world| world.lose_worker(worker));
    }

    /// Hands a worker's answer to its world. If the world cannot take it, the decisions count as missed; other worlds
    /// of the worker are not affected.
    pub fn answer(&self, worker: WorkerId, world: WorldId, answer: Answer) {
        // A world that has just been dropped needs no answers.
        let Ok(handle) = self.handle(world) else { return };
        if let Err(error) = handle.sim.cast(move |state| state.world.answer(worker, answer)) {
            warn!(worker = worker.0, world_id = world.0, %error, "lost an answer; its decisions count as missed");
        }
    }

    /// Runs `call` on every world that is not too busy.
    fn cast_all(&self, call: impl Fn(&mut HostedWorld) + Clone + Send + 'static) {
        for sim in self.running().into_values() {
            let call = call.clone();
            if let Err(error) = sim.cast(move |state| call(&mut state.world)) {
                warn!(%error, "a world is too busy for a change of workers");
            }
        }
    }
}
