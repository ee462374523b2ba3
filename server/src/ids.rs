//! Ids of worlds, NPCs and workers. Ids of worlds and NPCs are never reused, even after a restart.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::{Duration, SystemTime};

/// Id of a world, below 2^36.
///
/// An id is at least the time of its creation, in units of [`ID_PERIOD`] since the year 2026, and ids are created no
/// faster than time passes. So the ids of a restarted server exceed all earlier ones, without any state on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct WorldId(pub u64);

/// Id of an NPC: the world's id in the upper 36 bits, the NPC's number in that world in the lower 28.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NpcId(pub u64);

impl NpcId {
    /// Bits of the number, below the world's id.
    const SERIAL_BITS: u32 = 28;
    /// Greatest number of an NPC in its world.
    pub const MAX_SERIAL: u32 = (1 << Self::SERIAL_BITS) - 1;

    /// Returns the id of the NPC with number `serial`, at most [`MAX_SERIAL`](Self::MAX_SERIAL), in `world`.
    pub fn new(world: WorldId, serial: u32) -> Self {
        debug_assert!(serial <= Self::MAX_SERIAL);
        Self(world.0 << Self::SERIAL_BITS | u64::from(serial))
    }

    /// Returns the number of the NPC in its world.
    pub fn serial(self) -> u32 {
        self.0 as u32 & Self::MAX_SERIAL
    }

    /// Returns the world that the NPC belongs to.
    pub fn world(self) -> WorldId {
        WorldId(self.0 >> Self::SERIAL_BITS)
    }
}

/// Least time between two ids of worlds: 256 ids per second, which last for eight years.
pub const ID_PERIOD: Duration = Duration::from_nanos(1_000_000_000 / 256);
/// Start of ids: 2026-01-01 00:00 UTC, s since 1970.
const ID_BEGIN: Duration = Duration::from_secs(1_767_225_600);

impl WorldId {
    /// Returns the smallest id that may be created at `now`.
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
