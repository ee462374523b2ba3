//! The state of a server for the rest of the process: whether its worlds are restored, their number, and which of them
//! are stalled.
//!
//! An observer reads the figures that the threads of the worlds write. It calls no thread, so it never waits.

use crate::ids::WorldId;
use crate::worlds::{Worlds, WorldsError};
use std::time::Duration;
use tokio::sync::watch;

/// What [`Observer::look`] found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Vitals {
    /// Number of running worlds.
    pub world_count: usize,
    /// NPCs in all of them. A stalled world counts with its last known number.
    pub npc_count: usize,
    /// Worlds whose threads have been silent for longer than the observer's patience, ascending.
    pub stalled: Vec<WorldId>,
}

/// Observes a running server. Clones observe the same one.
#[derive(Debug, Clone)]
pub struct Observer {
    worlds: Worlds,
    ready: watch::Receiver<bool>,
    /// Silence after which a world's thread counts as stalled.
    patience: Duration,
}

impl Observer {
    /// Observes `worlds`, which are restored once `ready` is true.
    pub(crate) fn new(worlds: Worlds, ready: watch::Receiver<bool>) -> Self {
        Self { worlds, ready, patience: Duration::from_secs(5) }
    }

    /// Sets the patience; the default is 5 s.
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Whether saved worlds are restored and calls are accepted.
    pub fn is_ready(&self) -> bool {
        *self.ready.borrow()
    }

    /// Keeps the thread of a world busy for `time`, so that tests can show that other worlds are not affected.
    pub async fn stall(&self, world: WorldId, time: Duration) -> Result<(), WorldsError> {
        let sim = self.worlds.handle(world)?.sim.for_client(&"stall".into());
        Ok(sim.call(move |_| std::thread::sleep(time)).await?)
    }

    /// Reads the latest figures of all worlds.
    pub fn look(&self) -> Vitals {
        let worlds = self.worlds.figures();
        Vitals {
            world_count: worlds.len(),
            npc_count: worlds.iter().map(|world| world.summary.npc_count).sum(),
            stalled: worlds.iter().filter(|it| it.age() > self.patience).map(|it| it.summary.id).collect(),
        }
    }
}
