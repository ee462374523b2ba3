//! What happened on a world, in order: a bounded log that readers follow at their own pace.

use crate::ids::NpcId;
use std::collections::VecDeque;
use std::time::SystemTime;
use surefoot_world::{Ability, End, Seconds, Tick, Vec3};

/// Events that a world keeps; the oldest are forgotten first.
pub const KEPT_EVENTS: usize = 65_536;

/// Something that happened to an NPC.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NpcEvent {
    /// Grows by one from event to event.
    pub sequence: u64,
    /// Tick at which it happened.
    pub tick: Tick,
    /// Time of the server's clock.
    pub time: SystemTime,
    /// The NPC.
    pub npc: NpcId,
    /// What happened.
    pub kind: EventKind,
}

/// What happened. Positions are those of the feet, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EventKind {
    /// It was added.
    Spawned {
        /// Position of the feet, m.
        position: Vec3,
    },
    /// An attempt began.
    AttemptBegan {
        /// Number of the attempt.
        attempt: u32,
        /// The goal, m.
        goal: Vec3,
    },
    /// An attempt ended.
    AttemptEnded {
        /// Number of the attempt.
        attempt: u32,
        /// The outcome; `None` if the attempt was replaced.
        end: Option<End>,
        /// The goal, m.
        goal: Option<Vec3>,
        /// Duration of the attempt.
        seconds: Seconds,
    },
    /// It jumped, from the ground or in the air.
    Jumped {
        /// [`Ability::Jump`] or [`Ability::DoubleJump`].
        ability: Ability,
        /// Position of the feet, m.
        position: Vec3,
    },
    /// It came down on ground.
    Landed {
        /// Position of the feet, m.
        position: Vec3,
        /// Downward speed just before, m/s.
        impact_speed: f32,
    },
    /// A device took it.
    Rode {
        /// The ability that the device gives.
        ability: Ability,
        /// Position of the feet, m.
        position: Vec3,
    },
    /// It came to harm.
    Died {
        /// What harmed it.
        cause: End,
        /// The attempt that this ended, if there was one.
        attempt: Option<u32>,
        /// Position of the feet, m.
        position: Vec3,
    },
    /// A client teleported it.
    Teleported {
        /// The new position, m.
        position: Vec3,
    },
    /// It was removed.
    Removed,
}

/// Events that a reader asked for are no longer kept, or never were.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("events after {after} are not kept: the oldest is {oldest}, the latest {latest}")]
pub struct EventsLost {
    after: u64,
    oldest: u64,
    latest: u64,
}

/// The latest events of a world.
#[derive(Debug, Default)]
pub struct EventLog {
    latest: u64,
    kept: VecDeque<NpcEvent>,
}

impl EventLog {
    /// Sequence number of the latest event; 0 before the first.
    pub fn latest(&self) -> u64 {
        self.latest
    }

    /// Adds an event.
    pub(super) fn push(&mut self, tick: Tick, time: SystemTime, npc: NpcId, kind: EventKind) {
        if self.kept.len() == KEPT_EVENTS {
            self.kept.pop_front();
        }
        self.latest += 1;
        self.kept.push_back(NpcEvent { sequence: self.latest, tick, time, npc, kind });
    }

    /// Events after a sequence number, at most `limit`; with 0 from the oldest kept on.
    ///
    /// # Errors
    /// If some of them are no longer kept, or the number is yet to come.
    pub fn after(&self, after: u64, limit: usize) -> Result<Vec<NpcEvent>, EventsLost> {
        let oldest = self.latest + 1 - self.kept.len() as u64;
        let next = if after == 0 { oldest } else { after + 1 };
        if next < oldest || after > self.latest {
            return Err(EventsLost { after, oldest, latest: self.latest });
        }
        Ok(self.kept.iter().skip((next - oldest) as usize).take(limit).copied().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::WorldId;

    #[test]
    fn readers_get_every_event_once_or_are_told_that_some_are_gone() {
        let mut log = EventLog::default();
        let npc = NpcId::new(WorldId(1), 1);
        let numbers = |found: Vec<NpcEvent>| found.iter().map(|event| event.sequence).collect::<Vec<_>>();
        assert!(log.after(0, 10).unwrap().is_empty() && log.after(1, 10).is_err());
        (0..10).for_each(|tick| log.push(Tick(tick), SystemTime::UNIX_EPOCH, npc, EventKind::Removed));
        assert_eq!(numbers(log.after(7, 10).unwrap()), [8, 9, 10]);
        assert_eq!(numbers(log.after(0, 2).unwrap()), [1, 2]);
        assert!(log.after(10, 10).unwrap().is_empty() && log.after(11, 10).is_err());
        (0..KEPT_EVENTS as u64).for_each(|tick| log.push(Tick(tick), SystemTime::UNIX_EPOCH, npc, EventKind::Removed));
        assert!(log.after(9, 1).is_err(), "the tenth is gone");
        assert_eq!(numbers(log.after(10, 1).unwrap()), [11]);
        assert_eq!(numbers(log.after(0, 1).unwrap()), [11]);
    }
}
