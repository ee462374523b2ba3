//! What waits to be told to workers.

use crate::ids::NpcId;
use crate::messages::AttemptEnd;

/// What a worker is to be told before its next observations.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub released: Vec<NpcId>,
    pub assigned: Vec<NpcId>,
    pub ended: Vec<AttemptEnd>,
}
