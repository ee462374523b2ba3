//! What followers see of the movers of a world: where to wait, whether a ride is missed, which lift to call.

use surefoot_planner::needs::{Need, Needs, Ride, all_stops_ahead};
use surefoot_world::float::hypot;
use surefoot_world::map::Mover;
use surefoot_world::{Map, MoverAt, MoverId, MoverState, StopSet, TICKS_PER_DECISION, Vec3};

/// Distance from its waiting place within which an NPC waits for a mover, m.
const WAIT_WITHIN_M: f32 = 0.8;
/// Distance from the middle of a mover within which an NPC rides, m.
const RIDE_WITHIN_M: f32 = 0.3;
/// Distance from the middle of a mover within which an NPC sets it going, m.
const BOARDED_M: f32 = 0.9;
/// Difference in height to its place on the mover above which an NPC has missed the ride, m.
const MISSED_M: f32 = 0.9;
/// Horizontal distance to its place on the mover above which an NPC has missed the ride, m.
const MISSED_ASIDE_M: f32 = 3.0;
/// Distance to its place on the mover up to which an NPC jumps on a mover that leaves, m.
const TURN_BACK_M: f32 = 1.6;
/// Ticks by which a mover must stay longer than a leg is expected to take.
const SPARE_TICKS: u32 = 20;

/// The movers of a world at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The map.
    pub map: &'a Map,
    /// What its movers do, in the order of the map.
    pub states: &'a [MoverState],
}

/// What an NPC does about the movers that its leg depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum MoverResponse {
    /// It runs its leg.
    Go,
    /// It stays near a place until the mover is where the leg needs it.
    Stay {
        /// The place, m.
        at: Vec3,
        /// How far from there it may stand, m.
        within: f32,
    },
}

impl MoverResponse {
    /// Stays where the NPC stays already, or at `feet`, m.
    pub fn stay_or(self, feet: Vec3, within: f32) -> Self {
        match self {
            Self::Stay { at, .. } => Self::Stay { at, within },
            Self::Go => Self::Stay { at: feet, within },
        }
    }
}

/// The movers as a follower saw them last, and its response.
#[derive(Debug, Clone)]
pub(super) struct MoverWatch {
    /// The stops at which each mover stands sooner or later, as seen last.
    pub stops: Vec<StopSet>,
    pub response: MoverResponse,
    pub call: Option<MoverAt>,
    /// Decisions for which the NPC has stayed on this leg.
    pub stayed: u32,
    /// Whether movers bar all ways.
    pub is_barred: bool,
    /// Decisions for which movers have barred all ways, in the whole attempt.
    pub barred: u32,
}

impl Default for MoverWatch {
    fn default() -> Self {
        let (response, call) = (MoverResponse::Go, None);
        Self { stops: Vec::new(), response, call, stayed: 0, is_barred: false, barred: 0 }
    }
}

impl MoverWatch {
    pub fn start_leg(&mut self) {
        self.stayed = 0;
        self.response = MoverResponse::Go;
    }
}

impl Scene<'_> {
    fn mover(&self, id: MoverId) -> Option<(&Mover, &MoverState)> {
        self.map.movers().get(id.idx()).zip(self.states.get(id.idx()))
    }

    /// The stops at which each mover stands sooner or later, see [`Query::stops`](surefoot_planner::Query::stops).
    pub(super) fn stops_ahead(&self) -> Vec<StopSet> {
        all_stops_ahead(self.map, self.states)
    }

    /// What an NPC with its feet at `feet`, m, does about a ride that ends at the place `end`, m.
    pub(super) fn ride(&self, ride: Ride, feet: Vec3, end: Vec3) -> MoverResponse {
        // A plan may name movers that the map does not have; it is followed like any other.
        let Some((mover, state)) = self.mover(ride.mover) else { return MoverResponse::Go };
        let Some(last) = mover.stops.get(ride.to.idx()) else { return MoverResponse::Go };
        let middle = end - last.offset + state.pose(mover).offset;
        if state.at() == Some(ride.to) && feet.distance(end) < BOARDED_M {
            return MoverResponse::Go;
        }
        MoverResponse::Stay { at: middle, within: RIDE_WITHIN_M }
    }

    /// Whether an NPC at `feet`, m, has missed the mover of a ride that ends at `end`, m, and may be in its way.
    pub(super) fn is_missed(&self, ride: Ride, feet: Vec3, end: Vec3) -> bool {
        let MoverResponse::Stay { at, .. } = self.ride(ride, feet, end) else { return false };
        (at.y - feet.y).abs() > MISSED_M || hypot(at.x - feet.x, at.z - feet.z) > MISSED_ASIDE_M
    }

    /// Whether an NPC on its way to `boarding_place`, m, has to turn back because the mover has left.
    pub(super) fn is_gone(&self, needs: &Needs, feet: Vec3, boarding_place: Vec3) -> bool {
        feet.distance(boarding_place) > TURN_BACK_M && !needs.iter().all(|need| self.is_met(need, 0))
    }

    /// The call of an NPC that rides, once it stands on the mover.
    pub(super) fn call_of_ride(&self, ride: Ride, feet: Vec3, end: Vec3) -> Option<MoverAt> {
        let MoverResponse::Stay { at, .. } = self.ride(ride, feet, end) else { return None };
        let (_, state) = self.mover(ride.mover)?;
        (state.at() != Some(ride.to) && feet.distance(at) < BOARDED_M)
            .then_some(MoverAt { mover: ride.mover, stop: ride.to })
    }

    /// What an NPC at `feet`, m, does before a leg that is expected to take `leg_ticks`.
    pub(super) fn before_leg(&self, needs: &Needs, feet: Vec3, leg_ticks: u32) -> MoverResponse {
        let is_met = |need: Need| self.is_met(need, leg_ticks);
        if needs.iter().all(is_met) {
            MoverResponse::Go
        } else {
            MoverResponse::Stay { at: feet, within: WAIT_WITHIN_M }
        }
    }

    /// The call of an NPC that waits for a lift or platform.
    pub(super) fn call_before_leg(&self, needs: &Needs) -> Option<MoverAt> {
        let is_missing = |need: &Need| !self.is_met(*need, 0);
        let calls = |need: &Need| self.mover(need.mover).is_some_and(|(mover, _)| mover.kind.is_ridden());
        let need = needs.iter().filter(calls).find(is_missing)?;
        Some(MoverAt { mover: need.mover, stop: need.stops.lowest()? })
    }

    fn is_met(&self, need: Need, leg_ticks: u32) -> bool {
        let Some((mover, state)) = self.mover(need.mover) else { return true };
        let Some(at) = state.at().filter(|at| need.stops.contains(*at)) else { return false };
        // A mover about to depart counts as gone.
        match state.ordered_stop {
            Some(ordered) => ordered == at,
            None => {
                let left = mover.dwell_ticks().saturating_sub(state.stood);
                // A mover with a short dwell cannot offer more than its dwell.
                left >= (leg_ticks + SPARE_TICKS).min(mover.dwell_ticks().saturating_sub(TICKS_PER_DECISION))
            }
        }
    }
}
