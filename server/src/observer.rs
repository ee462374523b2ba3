//! What others in the process see of a server: whether its worlds are restored, how many there are, and which of them
//! stand still.
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
    /// NPCs on all of them. A world that stands still counts with those that it had before.
    pub npc_count: usize,
    /// Worlds whose threads have been silent for longer than the observer's patience, ascending.
    pub stalled: Vec<WorldId>,
}

/// Looks at a running server. Clones look at the same one.
#[derive(Debug, Clone)]
pub struct Observer {
    worlds: Worlds,
    ready: watch::Receiver<bool>,
    /// How long a world's thread may be silent until it counts as stalled.
    patience: Duration,
}

impl Observer {
    /// Observes `worlds`, which are restored once `ready` is true.
    pub(crate) fn new(worlds: Worlds, ready: watch::Receiver<bool>) -> Self {
        Self { worlds, ready, patience: Duration::from_secs(5) }
    }

    /// The observer with another patience; by default it is 5 s.
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Whether saved worlds are restored and calls are accepted.
    pub fn is_ready(&self) -> bool {
        *self.ready.borrow()
    }

    /// Keeps the thread of a world busy for `time`: tests show with it that other worlds are not affected.
    ///
    /// # Errors
    /// If there is no such world, or its thread does not accept the call.
    pub async fn stall(&self, world: WorldId, time: Duration) -> Result<(), WorldsError> {
        Ok(self.worlds.handle(world)?.sim.call(move |_| std::thread::sleep(time)).await?)
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
