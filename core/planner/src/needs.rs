//! What an edge hangs on: movers that must stand at certain stops while an NPC runs along it, and rides on them.
//!
//! The places on lifts and platforms where an NPC stands, one at each stop, are vertices like any other: berths. Edges to and from a berth
//! are proved while the mover is held at its stop, and the edge between two berths of a mover is the ride.

use crate::site::Site;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use surefoot_world::character::{MoveScratch, is_clear};
use surefoot_world::map::mover::{MAX_MOVERS, MAX_STOPS};
use surefoot_world::map::{Mover, MoverKind};
use surefoot_world::reliance::Reliance;
use surefoot_world::{
    CharacterProfile, DECISION_SECONDS, Decisions, Map, MoverState, TICKS_PER_DECISION, TICKS_PER_SECOND, Vec3,
};

/// Most movers that one edge hangs on; those that were noticed first count.
const MAX_NEEDS: usize = 4;
/// Distance within which a place is a berth, m.
const SAME_M: f32 = 0.01;
/// Side of the cells in which berths are looked up, m.
const CELL_M: f32 = 0.04;
/// Distance from where movers go that vertices keep, m.
const CLEARANCE_M: f32 = 0.4;
/// Overlap of a body with what is static that a berth may have, m.
const CLEAR_SLOP_M: f32 = 0.1;

/// A mover that must stand at one of some stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Need {
    /// Index of the mover on the map.
    pub mover: u16,
    /// Its stops, as bits; none for no need.
    pub stops: u16,
}

/// A ride from one stop of a mover to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ride {
    /// Index of the mover on the map.
    pub mover: u16,
    /// Index of the stop where the ride begins.
    pub from: u8,
    /// Index of the stop where it ends.
    pub to: u8,
}

impl Ride {
    /// The ride from one berth to another, each named by its mover and stop; `None` unless they are stops of one mover.
    pub fn between((mover, from): (u16, u8), (other, to): (u16, u8)) -> Option<Self> {
        (mover == other && from != to).then_some(Self { mover, from, to })
    }
}

/// Everything that an edge hangs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Needs {
    list: [Need; MAX_NEEDS],
    /// The ride that the edge is, if it is one.
    pub ride: Option<Ride>,
}

impl Needs {
    /// What a ride hangs on: that the mover stands where it begins.
    pub fn of_ride(ride: Ride) -> Self {
        let mut needs = Self { ride: Some(ride), ..Self::default() };
        needs.add(Need { mover: ride.mover, stops: 1 << ride.from });
        needs
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ride.is_none() && self.iter().next().is_none()
    }

    /// The movers, each once.
    pub fn iter(&self) -> impl Iterator<Item = Need> {
        self.list.into_iter().filter(|need| need.stops != 0)
    }

    /// Adds a need; one for the same mover is narrowed. Without a stop that would satisfy both, the former need stays.
    pub fn add(&mut self, need: Need) {
        if let Some(known) = self.list.iter_mut().find(|known| known.stops != 0 && known.mover == need.mover) {
            if known.stops & need.stops != 0 {
                known.stops &= need.stops;
            }
        } else if let Some(free) = self.list.iter_mut().find(|known| known.stops == 0) {
            *free = need;
        }
    }

    /// Adds all that another try along the same edge hung on.
    pub fn merge(&mut self, other: &Self) {
        other.iter().for_each(|need| self.add(need));
        self.ride = self.ride.or(other.ride);
    }

    /// Whether a map can have these movers and stops: each mover is listed once, and a ride begins where its mover must stand.
    pub fn are_possible(&self) -> bool {
        let is_mover = |mover: u16| usize::from(mover) < MAX_MOVERS;
        let is_stop = |stop: u8| usize::from(stop) < MAX_STOPS;
        let is_listed_again = |idx: usize, mover: u16| self.iter().skip(idx + 1).any(|other| other.mover == mover);
        let begins =
            |ride: Ride| self.iter().any(|need| need.mover == ride.mover && need.stops & (1 << ride.from) != 0);
        let is_possible = |ride: Ride| is_stop(ride.from) && is_stop(ride.to) && ride.from != ride.to && begins(ride);
        self.iter().enumerate().all(|(idx, need)| is_mover(need.mover) && !is_listed_again(idx, need.mover))
            && self.ride.is_none_or(is_possible)
    }

    /// Whether the edge can be used while each mover stands only at `stops`, in the order of the map; movers that are not listed stand
    /// anywhere. A ride needs both of its stops.
    pub fn are_met(&self, stops: &[u16]) -> bool {
        let of = |mover: u16| stops.get(usize::from(mover)).copied().unwrap_or(u16::MAX);
        self.iter().all(|need| need.stops & of(need.mover) != 0)
            && self.ride.is_none_or(|ride| of(ride.mover) & 1 << ride.to != 0)
    }
}

/// The stops at which a mover stands sooner or later, as bits, if nobody but NPCs tells it otherwise.
pub fn stops_ahead(mover: &Mover, state: &MoverState) -> u16 {
    match (state.ordered_stop, state.at()) {
        (_, at) if mover.kind == MoverKind::Crate => at.map_or(0, |at| 1 << at),
        (_, Some(at)) if state.pace == 0.0 => 1 << at,
        (_, None) if state.pace == 0.0 => 0,
        (Some(told), _) if !mover.kind.is_ridden() => 1 << told,
        _ => mover.all_stops(),
    }
}

/// The same for all movers of a map; empty if each of them stands at all of its stops, or there are none.
pub fn all_stops_ahead(map: &Map, states: &[MoverState]) -> Vec<u16> {
    let ahead: Vec<u16> = map.movers().iter().zip(states).map(|(mover, state)| stops_ahead(mover, state)).collect();
    let is_free = |(mover, stops): (&Mover, &u16)| *stops == mover.all_stops();
    if map.movers().iter().zip(&ahead).all(is_free) { Vec::new() } else { ahead }
}

/// The states in which edges are proved: doors open, floors there, crates held where they began, lifts and platforms at their first stop, but `held` at that of its own.
pub fn states_for_proof(map: &Map, held: Option<(u16, u8)>) -> Vec<MoverState> {
    let state = |(idx, mover): (u16, &Mover)| {
        let usual = if mover.kind == MoverKind::Door { mover.stops.len() as u8 - 1 } else { 0 };
        let stop = held.filter(|(held, _)| *held == idx).map_or(usual, |(_, stop)| stop);
        let pace = if mover.kind == MoverKind::Crate { 0.0 } else { 1.0 };
        MoverState { from: stop, to: stop, ordered_stop: Some(stop), progress: 0.0, pace, ..MoverState::new(mover) }
    };
    (0..).zip(map.movers()).map(state).collect()
}

/// The places on the movers of a map where an NPC stands. A berth is named by its mover and stop.
#[derive(Debug, Clone, Default)]
pub struct Berths {
    places: Vec<(Vec3, u16, u8)>,
    /// Indices of the places in each cell that has any, in ascending order.
    by_cell: HashMap<[i32; 3], Vec<u32>>,
}

impl Berths {
    /// The berths of all lifts and platforms of a map on which this body fits.
    pub fn of(map: &Map, profile: &CharacterProfile) -> Self {
        let mut places = Vec::new();
        let mut scratch = MoveScratch::default();
        for (idx, mover) in (0..).zip(map.movers()) {
            if !mover.kind.is_ridden() {
                continue;
            }
            for stop in 0..mover.stops.len() {
                let place = top(mover, stop).filter(|place| {
                    let inside = !map.is_outside(*place) && place.y <= map.extent().y;
                    inside && is_clear(map.mesh(), profile, *place, CLEAR_SLOP_M, &mut scratch)
                });
                places.extend(place.map(|place| (place, idx, stop as u8)));
            }
        }
        Self::at_places(places)
    }

    fn at_places(places: Vec<(Vec3, u16, u8)>) -> Self {
        let mut by_cell: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (idx, (place, ..)) in (0..).zip(&places) {
            by_cell.entry(cell(*place)).or_default().push(idx);
        }
        Self { places, by_cell }
    }

    /// All places, m.
    pub fn places(&self) -> impl ExactSizeIterator<Item = Vec3> {
        self.places.iter().map(|(place, ..)| *place)
    }

    /// The first berth at `place`.
    pub fn at(&self, place: Vec3) -> Option<(u16, u8)> {
        self.near(place).min().map(|idx| self.name(idx))
    }

    /// The berth at which each vertex is. A berth belongs to one vertex: where several places are one, each vertex there has a berth of
    /// its own, as long as there are any.
    pub fn of_vertices(&self, vertices: &[Vec3]) -> Vec<Option<(u16, u8)>> {
        let mut is_taken = vec![false; self.places.len()];
        let free = vertices.iter().map(|at| {
            let idx = self.near(*at).filter(|idx| !is_taken[*idx as usize]).min()?;
            is_taken[idx as usize] = true;
            Some(self.name(idx))
        });
        free.collect()
    }

    fn name(&self, idx: u32) -> (u16, u8) {
        let (_, mover, stop) = self.places[idx as usize];
        (mover, stop)
    }

    /// Indices of the berths at `place`.
    fn near(&self, place: Vec3) -> impl Iterator<Item = u32> {
        let ([left, low, back], [right, high, front]) =
            (cell(place - Vec3::splat(SAME_M)), cell(place + Vec3::splat(SAME_M)));
        (left..=right)
            .flat_map(move |x| (low..=high).flat_map(move |y| (back..=front).map(move |z| [x, y, z])))
            .filter_map(|cell| self.by_cell.get(&cell))
            .flatten()
            .copied()
            .filter(move |idx| self.places[*idx as usize].0.distance_squared(place) < SAME_M * SAME_M)
    }
}

/// The cell in which a berth is looked up.
fn cell(place: Vec3) -> [i32; 3] {
    (place / CELL_M).floor().to_array().map(|value| value as i32)
}

/// The boarding of a mover that is held at a stop for probes.
#[derive(Debug, Clone, Copy)]
pub struct Boarding {
    berth: Vec3,
    wait: u32,
}

impl Boarding {
    /// The boarding of this mover at its stop; `None` if nothing is held, or the map has no such place.
    pub fn of(map: &Map, held: Option<(u16, u8)>) -> Option<Self> {
        let (mover, stop) = held?;
        let mover = map.movers().get(usize::from(mover)).filter(|mover| usize::from(stop) < mover.stops.len())?;
        Some(Self { berth: top(mover, usize::from(stop))?, wait: mean_wait(mover).0 as u32 })
    }

    /// Decisions for which NPCs wait on average before they board the mover on their way from `start`: none if they are aboard.
    pub fn wait_from(&self, start: Vec3) -> u32 {
        if self.berth.distance_squared(start) < SAME_M * SAME_M { 0 } else { self.wait }
    }
}

/// Where movers go, which vertices keep clear of: who waits there stops them.
#[derive(Debug)]
pub(crate) struct Clearance<'a> {
    reliance: Reliance,
    profile: &'a CharacterProfile,
}

impl<'a> Clearance<'a> {
    /// The clearance of a site.
    pub fn of(site: &'a Site) -> Self {
        Self { reliance: Reliance::on(&site.map), profile: &site.profile }
    }

    /// Whether a body with its feet at `feet` stands clear of all movers.
    pub fn is_clear(&self, feet: Vec3) -> bool {
        !self.reliance.is_swept(self.profile, feet, CLEARANCE_M)
    }
}

/// The middle of the top of a mover at a stop, m.
fn top(mover: &Mover, stop: usize) -> Option<Vec3> {
    let (low, high) = mover.bounds_at(stop);
    let above = Vec3::new(0.5 * (low.x + high.x), high.y + 0.5, 0.5 * (low.z + high.z));
    let triangles = mover.triangles_at(mover.stops[stop]);
    let heights = triangles.iter().filter_map(|triangle| triangle.height_at(above.x, above.z));
    heights.filter(|height| *height <= high.y + 0.01).reduce(f32::max).map(|height| Vec3::new(above.x, height, above.z))
}

/// How long an NPC that wants to board a mover waits on average until it stands at the stop.
pub fn mean_wait(mover: &Mover) -> Decisions {
    let journeys = (mover.stops.len() - 1) as f32;
    let seconds = if mover.cycles {
        // There and back, with a stay at each stop; who comes while it is there does not wait.
        let round = 2.0 * journeys * (mover.travel_s + mover.dwell_s);
        let away = round - mover.dwell_s;
        0.5 * away * away / round.max(f32::MIN_POSITIVE)
    } else {
        0.5 * journeys * mover.travel_s
    };
    Decisions(f64::from(seconds / DECISION_SECONDS))
}

/// Longest duration of a ride, its stops on the way included, in ticks.
pub fn longest_ride_ticks(mover: &Mover, ride: Ride) -> u32 {
    let journeys = f32::from(ride.from.abs_diff(ride.to)).max(1.0) * 2.0 * mover.stops.len() as f32;
    (journeys * (mover.travel_s + mover.dwell_s) * TICKS_PER_SECOND as f32) as u32 + 10 * TICKS_PER_DECISION
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needs_of_the_same_mover_are_narrowed_and_others_are_added() {
        let mut needs = Needs::default();
        assert!(needs.is_empty() && needs.are_met(&[0, 0, 0]));
        needs.add(Need { mover: 1, stops: 0b110 });
        needs.add(Need { mover: 1, stops: 0b011 });
        needs.add(Need { mover: 2, stops: 0b001 });
        assert_eq!(
            needs.iter().collect::<Vec<_>>(),
            [Need { mover: 1, stops: 0b010 }, Need { mover: 2, stops: 0b001 }]
        );
        assert!(needs.are_met(&[]) && needs.are_met(&[0, 0b010, 0b101]));
        assert!(!needs.are_met(&[0, 0b001, 1]) && !needs.are_met(&[0, 0b010, 0b110]));
    }

    #[test]
    fn a_ride_needs_both_of_its_stops() {
        let needs = Needs::of_ride(Ride { mover: 0, from: 0, to: 2 });
        assert!(needs.are_met(&[0b101]) && !needs.are_met(&[0b001]) && !needs.are_met(&[0b100]));
    }

    #[test]
    fn needs_that_no_map_can_have_are_not_possible() {
        let ride = Ride { mover: 2, from: 0, to: 15 };
        let possible = Needs::of_ride(ride);
        assert!(possible.are_possible() && Needs::default().are_possible());
        let mut other_mover = Needs::default();
        other_mover.add(Need { mover: 1023, stops: u16::MAX });
        assert!(other_mover.are_possible());
        let mut twice = possible;
        twice.list[3] = twice.list[0];
        let mut no_mover = possible;
        no_mover.add(Need { mover: 1024, stops: 1 });
        let impossible = [
            twice,
            no_mover,
            Needs { ride: Some(ride), ..Needs::default() },
            Needs { ride: Some(Ride { from: 1, ..ride }), ..possible },
            Needs { ride: Some(Ride { to: 0, ..ride }), ..possible },
            Needs { ride: Some(Ride { to: 16, ..ride }), ..possible },
            Needs { ride: Some(Ride { from: 200, ..ride }), ..possible },
        ];
        assert!(impossible.iter().all(|needs| !needs.are_possible()), "{impossible:?}");
    }

    #[test]
    fn rides_join_stops_of_one_mover() {
        assert_eq!(Ride::between((4, 1), (4, 0)), Some(Ride { mover: 4, from: 1, to: 0 }));
        assert_eq!((Ride::between((4, 1), (5, 0)), Ride::between((4, 1), (4, 1))), (None, None));
    }
}
