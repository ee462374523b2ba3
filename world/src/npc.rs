//! What a world holds: NPCs, what they are run with, and all of it as plain data.

use crate::character::{Action, Body, CharacterProfile, TickEvents};
use crate::sense::LastDecision;
use crate::task::{End, Episode, TaskConfig};
use serde::{Deserialize, Serialize};

/// Index of an NPC's place in its world's arrays; reused after the NPC is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NpcSlot(pub u32);

/// Index of one of a world's character profiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct ProfileIdx(pub u8);

/// What a world is run with, besides its map.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldConfig {
    /// The kinds of characters that may be spawned, 1 to 256.
    pub profiles: Vec<CharacterProfile>,
    /// Constants of the task.
    pub task: TaskConfig,
    /// Whether NPCs push each other aside; off for training.
    pub npc_collision: bool,
}

/// One NPC: its body, its running decision and its episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Npc {
    /// What kind of character it is.
    pub profile: ProfileIdx,
    /// Position and motion.
    pub body: Body,
    /// The action that is held.
    pub action: Action,
    /// The attempt under way; an NPC without one stands still.
    pub episode: Option<Episode>,
    /// What the running decision started from.
    pub last: LastDecision,
    /// What happened since the running decision began.
    pub events: TickEvents,
    /// The hazard it came to; it stays where that happened until it is teleported.
    pub harm: Option<End>,
}

/// Beyond this a counted tick or decision of a stored NPC cannot be, and counting on might overflow.
const MAX_COUNT: u32 = 1 << 30;

/// Everything about a world that changes while it is stepped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldState {
    pub(crate) tick: u64,
    pub(crate) npcs: Vec<Option<Npc>>,
}

impl WorldState {
    /// Ticks stepped when it was saved.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Whether a world with so many profiles, on a map with so many zip lines, can have been in it.
    pub fn fits(&self, profile_count: usize, zip_line_count: usize) -> bool {
        self.npcs.iter().flatten().all(|npc| {
            let counts = [
                Some(npc.last.ticks_in_water),
                npc.episode.map(|episode| episode.decisions),
                npc.episode.map(|episode| episode.stalled_decisions),
            ];
            usize::from(npc.profile.0) < profile_count
                && npc.body.is_sound(zip_line_count)
                && counts.into_iter().flatten().all(|count| count <= MAX_COUNT)
        })
    }

    /// Slots that NPCs stand in, in order.
    pub fn slots(&self) -> impl Iterator<Item = NpcSlot> {
        (0..).zip(&self.npcs).filter(|(_, npc)| npc.is_some()).map(|(slot, _)| NpcSlot(slot))
    }

    /// Hash of every bit of it.
    pub fn hash(&self) -> [u8; 32] {
        *blake3::hash(&postcard::to_stdvec(self).expect("plain data")).as_bytes()
    }
}
