//! What names worlds and NPCs on a server, for good: ids are never used again, not even after a restart.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::{Duration, SystemTime};

/// A world, below 2^36.
///
/// An id is at least the time of its making in units of [`ID_PERIOD`] since the year 2026, and ids are made no faster than time
/// passes: so a server that restarts makes greater ids than it ever did, with nothing kept on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct WorldId(pub u64);

/// An NPC: its world's id in the upper 36 bits, its number on that world in the lower 28.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NpcId(pub u64);

impl NpcId {
    /// Bits below the world's id.
    const SERIAL_BITS: u32 = 28;
    /// Greatest number on a world.
    pub const MAX_SERIAL: u32 = (1 << Self::SERIAL_BITS) - 1;

    /// The NPC of a number on a world, at most [`MAX_SERIAL`](Self::MAX_SERIAL).
    pub fn new(world: WorldId, serial: u32) -> Self {
        debug_assert!(serial <= Self::MAX_SERIAL);
        Self(world.0 << Self::SERIAL_BITS | u64::from(serial))
    }

    /// The world that it belongs to.
    pub fn world(self) -> WorldId {
        WorldId(self.0 >> Self::SERIAL_BITS)
    }
}

/// From one id of a world to the next at the least: 256 worlds a second, for eight years.
pub const ID_PERIOD: Duration = Duration::from_nanos(1_000_000_000 / 256);
/// When ids began: 2026-01-01 00:00 UTC.
const ID_BEGIN: Duration = Duration::from_secs(1_767_225_600);

impl WorldId {
    /// The smallest id that may be made at `now`.
    pub fn at(now: SystemTime) -> Self {
        let since = now.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().saturating_sub(ID_BEGIN);
        Self((since.as_nanos() / ID_PERIOD.as_nanos()) as u64)
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
