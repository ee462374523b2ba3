//! What somebody beside the server sees of it: whether its worlds stand, how many there are, and whether their threads answer.
//!
//! An observer asks every world's thread once at a time and changes nothing, so that it can neither fill inboxes nor wait for long.

use crate::ids::WorldId;
use crate::sim::SimHandle;
use crate::worlds::Worlds;
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::sync::oneshot::{self, Receiver, error::TryRecvError};
use tokio::sync::watch;
use tokio::time::Instant;

/// What [`Observer::look`] found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Vitals {
    /// Number of running worlds.
    pub world_count: usize,
    /// NPCs on all of them. Of a world that does not answer, those that it had when it last did.
    pub npc_count: usize,
    /// Worlds whose threads have not answered for longer than the observer's patience, ascending.
    pub stalled: Vec<WorldId>,
}

/// Looks at a running server.
#[derive(Debug)]
pub struct Observer {
    worlds: Worlds,
    ready: watch::Receiver<bool>,
    /// How long a world's thread may leave a call unanswered until it counts as stalled.
    patience: Duration,
    known: BTreeMap<WorldId, Known>,
}

/// What is known of a world.
#[derive(Debug, Default)]
struct Known {
    npc_count: usize,
    /// When the question that has no answer yet was asked, and where its answer comes; there is none while the inbox is full.
    asked: Option<(Instant, Option<Receiver<usize>>)>,
}

impl Known {
    /// Takes in the answer, if there is one, and otherwise asks, if nothing is asked.
    fn ask(&mut self, sim: &SimHandle, now: Instant) {
        if let Some((_, Some(answer))) = &mut self.asked {
            match answer.try_recv() {
                Ok(npc_count) => *self = Self { npc_count, asked: None },
                // The world has just ended.
                Err(TryRecvError::Closed) => self.asked = None,
                Err(TryRecvError::Empty) => return,
            }
        }
        let since = self.asked.as_ref().map_or(now, |(since, _)| *since);
        let (reply, answer) = oneshot::channel();
        let sent = sim.cast(move |state| {
            // The observer may be gone.
            let _ = reply.send(state.world.npc_count());
        });
        self.asked = Some((since, sent.is_ok().then_some(answer)));
    }
}

impl Observer {
    /// Observes `worlds`, which are restored once `ready` is true.
    pub(crate) fn new(worlds: Worlds, ready: watch::Receiver<bool>) -> Self {
        Self { worlds, ready, patience: Duration::from_secs(5), known: BTreeMap::new() }
    }

    /// The observer with another patience; by default it is 5 s.
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Whether saved worlds are restored and calls are accepted.
    pub fn is_ready(&self) -> bool {
        *self.ready.borrow()
    }

    /// Asks all worlds, and reports what they answered to the question before. Never waits for them.
    pub fn look(&mut self) -> Vitals {
        let now = Instant::now();
        let sims = self.worlds.running();
        self.known.retain(|id, _| sims.contains_key(id));
        for (id, sim) in &sims {
            self.known.entry(*id).or_default().ask(sim, now);
        }
        let late = |known: &Known| known.asked.as_ref().is_some_and(|(since, _)| now - *since > self.patience);
        Vitals {
            world_count: sims.len(),
            npc_count: self.known.values().map(|known| known.npc_count).sum(),
            stalled: self.known.iter().filter(|(_, known)| late(known)).map(|(id, _)| *id).collect(),
        }
    }
}
