//! Pending messages to workers.

use crate::ids::NpcId;
use crate::messages::AttemptEnd;

/// What must be sent to a worker before its next observations. Releases are sent before assignments.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub released: Vec<NpcId>,
    pub assigned: Vec<NpcId>,
    pub ended: Vec<AttemptEnd>,
}

impl Outbox {
    /// The worker decides for an NPC from now on.
    pub fn assign(&mut self, npc: NpcId) {
        self.assigned.push(npc);
    }

    /// The worker no longer decides for an NPC. An assignment that it has not been sent is withdrawn.
    pub fn release(&mut self, npc: NpcId) {
        let assigned_count = self.assigned.len();
        self.assigned.retain(|assigned| *assigned != npc);
        if self.assigned.len() == assigned_count {
            self.released.push(npc);
        }
    }
}
