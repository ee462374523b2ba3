//! Pending messages to workers.

use crate::ids::NpcId;
use crate::messages::AttemptEnd;
use std::collections::BTreeSet;

/// What must be sent to a worker before its next observations. Releases are sent before assignments.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub released: Vec<NpcId>,
    pub assigned: BTreeSet<NpcId>,
    pub ended: Vec<AttemptEnd>,
}

impl Outbox {
    /// The worker decides for an NPC from now on.
    pub fn assign(&mut self, npc: NpcId) {
        self.assigned.insert(npc);
    }

    /// The worker no longer decides for an NPC. An assignment that it has not been sent is withdrawn.
    pub fn release(&mut self, npc: NpcId) {
        if !self.assigned.remove(&npc) {
            self.released.push(npc);
        }
    }
}
