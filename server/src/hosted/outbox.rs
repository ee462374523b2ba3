//! Pending messages to workers.

use crate::ids::NpcId;
use crate::messages::AttemptEnd;

/// What must be sent to a worker before its next observations.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub released: Vec<NpcId>,
    pub assigned: Vec<NpcId>,
    pub ended: Vec<AttemptEnd>,
}
