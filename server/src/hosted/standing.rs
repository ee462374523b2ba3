//! Where NPCs stand, and for how long: when events about them are due, and warnings about missing workers.

use super::events::EventKind;
use super::snapshot::Standing;
use surefoot_world::{Seconds, TICKS_PER_SECOND, Tick, Vec3};

/// Ticks for which an NPC has stood when an event says so, and least ticks from one such event to the next.
const STANDS_AFTER: u64 = 2 * TICKS_PER_SECOND as u64;
/// Distance within which an NPC stands, m.
const STANDS_WITHIN_M: f32 = 0.3;
/// Ticks for which NPCs have lacked workers when the log says so.
const SHORTAGE_AFTER: u64 = STANDS_AFTER;
/// Least ticks from one warning about missing workers to the next.
const SHORTAGE_EVERY: u64 = 60 * TICKS_PER_SECOND as u64;

/// Where an NPC with a goal stands, since when, and why.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stand {
    /// The reason that its worker gave with its last answer.
    pub reported: Option<Standing>,
    /// The place, m, from which it has not got away, and the tick at which it was there first.
    place: Option<(Vec3, Tick)>,
    /// The reason and the tick of the last event about this stand.
    logged: Option<(Standing, Tick)>,
}

impl Stand {
    /// Whether the NPC has stood for so long that an event says so.
    pub fn is_long(&self, tick: Tick) -> bool {
        self.place.is_some_and(|(_, since)| tick.since(since) >= STANDS_AFTER)
    }

    /// Follows an NPC with its feet at `feet`, m.
    pub fn follow(&mut self, feet: Vec3, tick: Tick) {
        if self.place.is_none_or(|(place, _)| place.distance(feet) > STANDS_WITHIN_M) {
            *self = Self { place: Some((feet, tick)), ..Self { reported: self.reported, ..Self::default() } };
        }
    }

    /// The event about an NPC that stands for `reason`, if it is due.
    pub fn event(&mut self, reason: Standing, tick: Tick) -> Option<EventKind> {
        let (position, since) = self.place?;
        let is_known = self.logged.is_some_and(|(known, at)| known == reason || tick.since(at) < STANDS_AFTER);
        if is_known || !self.is_long(tick) {
            return None;
        }
        self.logged = Some((reason, tick));
        let seconds = Seconds(tick.since(since) as f32 / TICKS_PER_SECOND as f32);
        Some(EventKind::Stands { reason, seconds, position })
    }
}

/// Since when NPCs have lacked workers, and when the log said so last.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shortage {
    since: Option<Tick>,
    warned: Option<Tick>,
}

impl Shortage {
    /// Whether a warning is due at `tick`. `lacks` is whether NPCs lack workers.
    pub fn is_due(&mut self, lacks: bool, tick: Tick) -> bool {
        self.since = lacks.then(|| self.since.unwrap_or(tick));
        let is_due = self.since.is_some_and(|since| tick.since(since) >= SHORTAGE_AFTER)
            && self.warned.is_none_or(|warned| tick.since(warned) >= SHORTAGE_EVERY);
        if is_due {
            self.warned = Some(tick);
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_about_a_stand_come_after_two_seconds_and_when_the_reason_changes() {
        let mut stand = Stand::default();
        let place = Vec3::new(5.0, 1.0, 5.0);
        let mut at = |tick, offset_m, reason| {
            stand.follow(place + Vec3::X * offset_m, Tick(tick));
            let event = stand.event(reason, Tick(tick))?;
            let EventKind::Stands { reason, seconds, position } = event else { panic!("{event:?}") };
            assert_eq!(position, place);
            Some((reason, seconds.0))
        };
        use Standing::{AwaitsPlan, AwaitsRehearsal, NoWorker};
        assert_eq!(at(0, 0.0, NoWorker), None);
        assert_eq!(at(110, 0.2, NoWorker), None);
        assert_eq!(at(120, 0.2, NoWorker), Some((NoWorker, 2.0)));
        assert_eq!(at(500, 0.0, NoWorker), None, "the reason is known");
        assert_eq!(at(510, 0.0, AwaitsPlan), Some((AwaitsPlan, 8.5)));
        assert_eq!(at(520, 0.0, AwaitsRehearsal), None, "an event came 10 ticks ago");
        assert_eq!(at(630, 0.0, AwaitsRehearsal), Some((AwaitsRehearsal, 10.5)));
        assert_eq!(at(640, 0.5, NoWorker), None, "it has moved");
        assert_eq!(at(770, 0.0, NoWorker), None, "it has moved back");
        assert_eq!(at(890, 0.0, NoWorker), Some((NoWorker, 2.0)));
    }

    #[test]
    fn a_shortage_that_lasts_is_warned_of_once_a_minute() {
        let mut shortage = Shortage::default();
        let warnings = (0..8000).filter(|&tick| shortage.is_due(tick >= 100, Tick(tick)));
        assert_eq!(warnings.collect::<Vec<_>>(), [220, 3820, 7420]);
        let mut shortage = Shortage::default();
        assert!((0..8000).all(|tick| !shortage.is_due(tick % 100 > 0, Tick(tick))), "none lasts");
    }
}
