//! The bounded, ordered log of a world's events. Readers follow it at their own pace.

use super::itinerary::RouteKind;
use super::pursuit::Pursuit;
use super::snapshot::Standing;
use crate::ids::NpcId;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::SystemTime;
use surefoot_world::{Ability, End, Seconds, Tick, Vec3};

/// Most events that a world keeps; the oldest are dropped first.
pub const KEPT_EVENTS: usize = 65_536;

/// Something that happened to an NPC.
#[derive(Debug, Clone, PartialEq)]
pub struct NpcEvent {
    /// Sequence number: consecutive, from 1.
    pub sequence: u64,
    /// Tick at which it happened.
    pub tick: Tick,
    /// Time of the server's clock when it happened.
    pub time: SystemTime,
    /// The NPC.
    pub npc: NpcId,
    /// What happened.
    pub kind: EventKind,
}

/// Kind of an event, with its data.
#[derive(Debug, Clone, PartialEq)]
pub enum EventKind {
    /// The NPC was added.
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
        /// How the NPC goes there.
        pursuit: Pursuit,
    },
    /// An NPC that keeps to its target has arrived there.
    TargetReached {
        /// Number of the attempt.
        attempt: u32,
        /// Where the target is, m.
        goal: Vec3,
    },
    /// The target was removed or is down.
    TargetLost {
        /// Number of the attempt.
        attempt: u32,
    },
    /// An NPC that keeps to its target has no way to it.
    TargetUnreachable {
        /// Number of the attempt.
        attempt: u32,
        /// Why, for people.
        no_path: Arc<str>,
    },
    /// An NPC that had no way to its target has one again, or is there.
    TargetReachable {
        /// Number of the attempt.
        attempt: u32,
    },
    /// The route was set, or cleared.
    RouteSet {
        /// Its kind; `None` if it was cleared.
        kind: Option<RouteKind>,
    },
    /// An NPC has arrived at a stop of its patrol.
    StopReached {
        /// Number of the attempt that ended there.
        attempt: u32,
        /// Index of the stop.
        stop: u32,
    },
    /// An attempt ended.
    AttemptEnded {
        /// Number of the attempt.
        attempt: u32,
        /// The outcome; `None` if the attempt was replaced.
        end: Option<End>,
        /// The goal, m.
        goal: Option<Vec3>,
        /// Distance of the feet from it, m.
        distance_m: f32,
        /// Duration of the attempt.
        seconds: Seconds,
        /// Why the goal is unreachable, for people; empty for other outcomes.
        no_path: Arc<str>,
    },
    /// The NPC jumped, from the ground or in the air.
    Jumped {
        /// [`Ability::JUMP`] or [`Ability::DOUBLE_JUMP`].
        ability: Ability,
        /// Position of the feet, m.
        position: Vec3,
    },
    /// The NPC landed on the ground.
    Landed {
        /// Position of the feet, m.
        position: Vec3,
        /// Downward speed just before, m/s.
        impact_speed: f32,
    },
    /// The NPC used a device: a pad, a zip line, a teleporter or a jetpack.
    Rode {
        /// The ability that the device gives.
        ability: Ability,
        /// Position of the feet, m.
        position: Vec3,
    },
    /// The NPC died.
    Died {
        /// How it died: fell, burnt or drowned.
        cause: End,
        /// Number of the attempt that this ended, if one was under way.
        attempt: Option<u32>,
        /// Position of the feet, m.
        position: Vec3,
    },
    /// A client teleported the NPC.
    Teleported {
        /// The new position, m.
        position: Vec3,
    },
    /// The NPC was removed.
    Removed,
    /// The NPC has a goal, but stands.
    Stands {
        /// Why it stands.
        reason: Standing,
        /// Time for which it has stood.
        seconds: Seconds,
        /// Position of the feet, m.
        position: Vec3,
    },
}

/// Requested events are no longer kept, or have not happened yet.
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
    written: u64,
    /// Sequence number of the last event that was dropped.
    dropped: u64,
    /// Sequence number of the last event that readers may see; `None`: all.
    confirmed: Option<u64>,
    kept: VecDeque<NpcEvent>,
}

impl EventLog {
    /// The log of a restored world, with the events `kept` after the number `dropped`. All are confirmed. The next
    /// event follows the number `written`.
    pub(super) fn resumed(dropped: u64, kept: impl IntoIterator<Item = NpcEvent>, written: u64) -> Self {
        let mut log = Self { written, dropped, confirmed: Some(written), kept: kept.into_iter().collect() };
        log.drop_beyond(KEPT_EVENTS);
        log
    }

    /// Returns the sequence number of the latest event that readers may see; 0 if there is none yet.
    pub fn latest(&self) -> u64 {
        self.confirmed.unwrap_or(self.written)
    }

    /// Returns the sequence number of the latest event.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Returns the sequence number of the last event that was dropped.
    pub(super) fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Hides events from readers until they are confirmed.
    pub(super) fn await_confirmation(&mut self) {
        self.confirmed.get_or_insert(self.written);
    }

    /// Lets readers see events up to the number `through`.
    pub(super) fn confirm(&mut self, through: u64) {
        if let Some(confirmed) = &mut self.confirmed {
            *confirmed = (*confirmed).max(through.min(self.written));
        }
    }

    /// Events after the number `after`, including unconfirmed ones.
    pub(super) fn since(&self, after: u64) -> impl Iterator<Item = &NpcEvent> {
        self.kept.range(self.kept.partition_point(|event| event.sequence <= after)..)
    }

    /// Drops all but the latest `count` events.
    fn drop_beyond(&mut self, count: usize) {
        let surplus = self.kept.len().saturating_sub(count);
        self.dropped = self.kept.drain(..surplus).next_back().map_or(self.dropped, |event| event.sequence);
    }

    /// Appends an event.
    pub(super) fn push(&mut self, tick: Tick, time: SystemTime, npc: NpcId, kind: EventKind) {
        self.drop_beyond(KEPT_EVENTS - 1);
        self.written += 1;
        self.kept.push_back(NpcEvent { sequence: self.written, tick, time, npc, kind });
    }

    /// Returns the events after the sequence number `after`, at most `limit`; 0 means from the oldest event kept. Fails
    /// if some of these events are no longer kept, or `after` is greater than the latest number that readers may see.
    pub fn after(&self, after: u64, limit: usize) -> Result<Vec<NpcEvent>, EventsLost> {
        let latest = self.latest();
        if after != 0 && after < self.dropped || after > latest {
            return Err(EventsLost { after, oldest: self.dropped + 1, latest });
        }
        Ok(self.since(after).take_while(|event| event.sequence <= latest).take(limit).cloned().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::WorldId;

    #[test]
    fn readers_get_every_event_once_or_an_error_if_some_are_gone() {
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

    #[test]
    fn what_is_not_confirmed_is_not_seen() {
        let mut log = EventLog::default();
        let npc = NpcId::new(WorldId(1), 1);
        log.await_confirmation();
        (0..4).for_each(|tick| log.push(Tick(tick), SystemTime::UNIX_EPOCH, npc, EventKind::Removed));
        assert!(log.after(0, 10).unwrap().is_empty() && log.after(1, 10).is_err());
        assert_eq!((log.latest(), log.written()), (0, 4));
        log.confirm(3);
        log.confirm(2);
        assert_eq!(log.after(1, 10).unwrap().len(), 2);
        // Restored without the second event, which described motion, and with a later one that was not kept.
        let kept: Vec<NpcEvent> = log.since(0).filter(|event| event.sequence != 2).take(2).cloned().collect();
        let mut resumed = EventLog::resumed(0, kept, 5);
        assert_eq!(resumed.after(1, 10).unwrap().len(), 1);
        assert!(resumed.after(5, 10).unwrap().is_empty());
        resumed.push(Tick(9), SystemTime::UNIX_EPOCH, npc, EventKind::Removed);
        resumed.confirm(6);
        assert_eq!(resumed.after(3, 10).unwrap()[0].sequence, 6);
    }
}
