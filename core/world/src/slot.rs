//! Slots: the identities of the bodies of a world.

use serde::{Deserialize, Serialize};

/// Index of an NPC in its world; reused after the NPC is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NpcSlot(pub u32);

/// Index of a player in its world; reused after the player is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct PlayerSlot(pub u32);

/// A body of a world. Of two equally near bodies, an observation describes the lesser slot first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum BodySlot {
    Npc(NpcSlot),
    Player(PlayerSlot),
}
