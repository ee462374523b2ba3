//! What a worker must be sent before its next observations.

use crate::ids::NpcId;
use crate::messages::AttemptEnd;
use std::collections::BTreeSet;

/// Messages that a worker must get before its next observations. Releases are sent before assignments.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub released: Vec<NpcId>,
    pub assigned: BTreeSet<NpcId>,
    pub ended: Vec<AttemptEnd>,
    /// NPCs whose tags have changed.
    pub tagged: BTreeSet<NpcId>,
}

impl Outbox {
    /// Assigns an NPC to the worker.
    pub fn assign(&mut self, npc: NpcId) {
        self.assigned.insert(npc);
    }

    /// Releases an NPC from the worker. An assignment that has not been sent is withdrawn.
    pub fn release(&mut self, npc: NpcId) {
        self.tagged.remove(&npc);
        if !self.assigned.remove(&npc) {
            self.released.push(npc);
        }
    }
}
