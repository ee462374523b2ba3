//! What followers see of the movers of a world, and what they do about them: wait, ride, call.

use surefoot_planner::needs::{Need, Needs, Ride, all_stops_ahead};
use surefoot_world::float::hypot;
use surefoot_world::map::Mover;
use surefoot_world::{Map, MoverState, TICKS_PER_DECISION, Vec3};

/// How far from where it waits for a mover an NPC may stand, m, and how far from the middle of a mover that it rides.
const WAIT_WITHIN_M: f32 = 0.8;
const RIDE_WITHIN_M: f32 = 0.3;
/// How near the middle of a mover an NPC must be to set it going, m.
const BOARDED_M: f32 = 0.9;
/// Difference in height to the place where it would stand, m, and distance aside, from which on an NPC has missed the mover.
const MISSED_M: f32 = 0.9;
const MISSED_ASIDE_M: f32 = 3.0;
/// Distance from the place where it would stand up to which an NPC jumps on a mover that leaves, m.
const TURN_BACK_M: f32 = 1.6;
/// Ticks that are left for a leg, besides those that it is expected to take, before the mover leaves.
const SPARE_TICKS: u32 = 20;

/// The movers of a world at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The map.
    pub map: &'a Map,
    /// What its movers do, in the order of the map.
    pub states: &'a [MoverState],
}

/// What an NPC does about the movers that its leg hangs on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Conduct {
    /// It runs its leg.
    Go,
    /// It stays about there until the mover is where the leg needs it.
    Stay {
        /// The place, m.
        at: Vec3,
        /// How far from there it may stand, m.
        within: f32,
    },
}

/// A lift or platform that an NPC wants at a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Call {
    /// Index of the mover on the map.
    pub mover: u16,
    /// Index of the stop.
    pub stop: u8,
}

impl Scene<'_> {
    fn mover(&self, idx: u16) -> Option<(&Mover, &MoverState)> {
        self.map.movers().get(usize::from(idx)).zip(self.states.get(usize::from(idx)))
    }

    /// The stops at which each mover stands sooner or later, see [`Query::stops`](surefoot_planner::Query::stops).
    pub(crate) fn stops_ahead(&self) -> Vec<u16> {
        all_stops_ahead(self.map, self.states)
    }

    /// What an NPC with its feet at `feet` does about a ride, of which `end` is the place where it ends, m.
    pub(crate) fn ride(&self, ride: Ride, feet: Vec3, end: Vec3) -> Conduct {
        // A plan that names what the map does not have is followed like any other.
        let Some((mover, state)) = self.mover(ride.mover) else { return Conduct::Go };
        let Some(last) = mover.stops.get(usize::from(ride.to)) else { return Conduct::Go };
        let middle = end - last.offset + state.pose(mover).offset;
        if state.at() == Some(ride.to) && feet.distance(end) < BOARDED_M {
            return Conduct::Go;
        }
        Conduct::Stay { at: middle, within: RIDE_WITHIN_M }
    }

    /// Whether an NPC at `feet` that wants to ride has missed the mover, and may be in its way. `end` is the place where the ride ends, m.
    pub(crate) fn is_missed(&self, ride: Ride, feet: Vec3, end: Vec3) -> bool {
        let Conduct::Stay { at, .. } = self.ride(ride, feet, end) else { return false };
        (at.y - feet.y).abs() > MISSED_M || hypot(at.x - feet.x, at.z - feet.z) > MISSED_ASIDE_M
    }

    /// Whether an NPC on its way to board a mover has to turn back, since that is gone.
    pub(crate) fn is_gone(&self, needs: &Needs, feet: Vec3, berth: Vec3) -> bool {
        feet.distance(berth) > TURN_BACK_M && !needs.iter().all(|need| self.is_met(need, 0))
    }

    /// The call of an NPC that rides, once it stands on the mover.
    pub(crate) fn call_of_ride(&self, ride: Ride, feet: Vec3, end: Vec3) -> Option<Call> {
        let Conduct::Stay { at, .. } = self.ride(ride, feet, end) else { return None };
        let (_, state) = self.mover(ride.mover)?;
        (state.at() != Some(ride.to) && feet.distance(at) < BOARDED_M)
            .then_some(Call { mover: ride.mover, stop: ride.to })
    }

    /// What an NPC at `feet` does that is about to begin a leg which is expected to take so many ticks.
    pub(crate) fn gate(&self, needs: &Needs, feet: Vec3, leg_ticks: u32) -> Conduct {
        let is_met = |need: Need| self.is_met(need, leg_ticks);
        if needs.iter().all(is_met) { Conduct::Go } else { Conduct::Stay { at: feet, within: WAIT_WITHIN_M } }
    }

    /// The call of an NPC that waits for a lift or platform.
    pub(crate) fn call_of_gate(&self, needs: &Needs) -> Option<Call> {
        let is_missing = |need: &Need| !self.is_met(*need, 0);
        let calls = |need: &Need| self.mover(need.mover).is_some_and(|(mover, _)| mover.kind.is_ridden());
        let need = needs.iter().filter(calls).find(is_missing)?;
        Some(Call { mover: need.mover, stop: need.stops.trailing_zeros() as u8 })
    }

    fn is_met(&self, need: Need, leg_ticks: u32) -> bool {
        let Some((mover, state)) = self.mover(need.mover) else { return true };
        let Some(at) = state.at().filter(|at| need.stops & 1 << at != 0) else { return false };
        // One that waits to leave, or is told to go elsewhere, has left.
        match state.ordered_stop {
            Some(told) => told == at,
            None => {
                let left = mover.dwell_ticks().saturating_sub(state.stood);
                // A mover that stays for a moment only gives no more than that.
                left >= (leg_ticks + SPARE_TICKS).min(mover.dwell_ticks().saturating_sub(TICKS_PER_DECISION))
            }
        }
    }
}
