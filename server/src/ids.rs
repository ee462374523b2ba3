//! What names worlds and NPCs on a server.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A world on this server; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct WorldId(pub u64);

/// An NPC on this server: its world's id in the upper half, its number on that world in the lower; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NpcId(pub u64);

impl NpcId {
    /// Bits below the world's id.
    const SERIAL_BITS: u32 = 32;

    /// The NPC of a number on a world.
    pub fn new(world: WorldId, serial: u32) -> Self {
        Self(world.0 << Self::SERIAL_BITS | u64::from(serial))
    }

    /// The world that it belongs to.
    pub fn world(self) -> WorldId {
        WorldId(self.0 >> Self::SERIAL_BITS)
    }
}

impl fmt::Display for WorldId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for NpcId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Id of a connected worker on this server; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WorkerId(pub u64);
