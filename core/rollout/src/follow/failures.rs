//! The legs that failed in an attempt, which its further plans avoid.

use surefoot_planner::{EdgeKey, LegKey, Stop};

/// Legs to the goal that fail, each from another vertex, until the goal counts as unreachable.
const MAX_FAILED_ARRIVALS: u32 = 5;
/// Same as [`MAX_FAILED_ARRIVALS`] for legs that failed in rehearsals, which cost no time.
const MAX_REHEARSED_ARRIVALS: u32 = 12;
/// How many of them a doubtful leg counts for.
const DOUBTFUL_WEIGHT: u32 = 2;
/// Doubtful legs from the start that fail in rehearsals until the goal counts as unreachable.
const MAX_DOUBTFUL_DEPARTURES: u32 = 6;
/// How often legs without progress are tried again when no other way is left.
const MAX_CHANCES: u32 = 3;
/// Most edges of which an attempt reports failed rehearsals.
const MAX_REPORTED: usize = 64;
/// Most failed legs kept for an attempt; the oldest is dropped first.
const MAX_FAILED_LEGS: usize = 48;

/// A leg that failed.
#[derive(Debug, Clone, Copy)]
struct FailedLeg {
    key: LegKey,
    /// Whether the NPC came to harm, in the world or in a rehearsal; otherwise it made no progress.
    is_harm: bool,
}

/// The failed legs of one attempt.
#[derive(Debug, Clone, Default)]
pub(super) struct Failures {
    legs: Vec<FailedLeg>,
    /// Legs to the goal itself that failed.
    arrivals: u32,
    /// Doubtful legs from the start that failed in rehearsals.
    departures: u32,
    chances: u32,
    /// Edges of which a failed rehearsal was reported.
    reported: Vec<EdgeKey>,
}

impl Failures {
    /// The failed legs, the oldest first.
    pub fn keys(&self) -> Vec<LegKey> {
        self.legs.iter().map(|leg| leg.key).collect()
    }

    /// Number of failed legs that no proof covers.
    pub fn unproved_count(&self) -> usize {
        self.legs.iter().filter(|leg| leg.key.edge().is_none()).count()
    }

    /// How often legs without progress got another chance.
    pub fn chances_given(&self) -> u32 {
        self.chances
    }

    /// Forgets the legs without progress, if there are any and chances are left; returns whether it did.
    pub fn give_another_chance(&mut self) -> bool {
        self.give_chance(|leg| leg.is_harm)
    }

    /// Keeps only some legs, if that forgets any and chances are left; returns whether it did.
    fn give_chance(&mut self, keeps: impl Fn(&FailedLeg) -> bool) -> bool {
        let is_given = self.chances < MAX_CHANCES && !self.legs.iter().all(&keeps);
        if is_given {
            self.legs.retain(keeps);
            self.chances += 1;
        }
        is_given
    }

    /// Forgets the legs without progress.
    pub fn forget_stalls(&mut self) {
        self.legs.retain(|leg| leg.is_harm);
    }

    /// Forgets the legs without progress, and that legs to the goal failed: the movers have changed.
    pub fn forgive(&mut self) {
        self.forget_stalls();
        (self.arrivals, self.departures) = (0, 0);
    }

    /// Adds a leg without progress; true if too many legs to the goal have failed.
    pub fn add_run(&mut self, key: LegKey) -> bool {
        self.add(key, false);
        self.arrivals += u32::from(key.to == Stop::Goal);
        self.arrivals >= MAX_FAILED_ARRIVALS
    }

    /// Adds a leg that failed in a rehearsal; true if the goal counts as unreachable. A leg is doubtful if no proof
    /// covers it, and it is neither a walk nor a leap over one gap.
    pub fn add_rehearsed(&mut self, key: LegKey, is_harm: bool, is_doubtful: bool) -> bool {
        self.add(key, is_harm);
        let are_used_up = if key.to == Stop::Goal {
            self.arrivals += if is_doubtful { DOUBTFUL_WEIGHT } else { 1 };
            self.arrivals >= MAX_REHEARSED_ARRIVALS
        } else if key.from == Stop::Start && is_doubtful {
            self.departures += 1;
            self.departures >= MAX_DOUBTFUL_DEPARTURES
        } else {
            false
        };
        are_used_up && !self.give_edges_another_chance()
    }

    /// Forgets the edges without progress, if there are any and chances are left; returns whether it did. What has been
    /// proved once is worth more tries than what never was.
    fn give_edges_another_chance(&mut self) -> bool {
        self.give_chance(|leg| leg.is_harm || leg.key.edge().is_none())
    }

    /// Adds a leg, which moves to the end if it failed before.
    pub fn add(&mut self, key: LegKey, is_harm: bool) {
        let is_harm = is_harm || self.legs.iter().any(|leg| leg.key == key && leg.is_harm);
        self.legs.retain(|leg| leg.key != key);
        self.legs.push(FailedLeg { key, is_harm });
        if self.legs.len() > MAX_FAILED_LEGS {
            self.legs.remove(0);
        }
    }

    /// Whether no failed rehearsal of an edge was reported before. Later calls for the edge return false.
    pub fn is_first_report(&mut self, edge: EdgeKey) -> bool {
        let is_first = self.reported.len() < MAX_REPORTED && !self.reported.contains(&edge);
        self.reported.extend(is_first.then_some(edge));
        is_first
    }
}
