//! Ride stops: the places on lifts and platforms where an NPC stands, one at each stop of a mover.
//!
//! Ride stops are vertices like any other. Edges to and from a ride stop are proved while the mover is held at that
//! stop, and the edge between two ride stops of a mover is the ride.

use crate::needs::Ride;
use crate::settings::Site;
use std::collections::HashMap;
use surefoot_world::character::{MoveScratch, is_clear};
use surefoot_world::map::{Mover, MoverKind};
use surefoot_world::reliance::Reliance;
use surefoot_world::{
    CharacterProfile, DECISION_SECONDS, Decisions, Map, MoverAt, MoverId, MoverState, StopIdx, TICKS_PER_DECISION,
    TICKS_PER_SECOND, Vec3,
};

/// Distance within which a position is a ride stop, m.
const SAME_M: f32 = 0.01;
/// Side of the cells in which ride stops are looked up, m.
const CELL_M: f32 = 0.04;
/// Distance that vertices keep from the paths of movers, m.
const CLEARANCE_M: f32 = 0.4;
/// Overlap of a body with static geometry that a ride stop may have, m.
const CLEAR_SLOP_M: f32 = 0.1;

/// The ride stops of a map.
#[derive(Debug, Clone, Default)]
pub struct RideStops {
    stops: Vec<(Vec3, MoverAt)>,
    /// Indices of the ride stops in each cell that has any, in ascending order.
    by_cell: HashMap<[i32; 3], Vec<u32>>,
}

impl RideStops {
    /// The stops of all lifts and platforms of a map at which this body fits.
    pub fn on(map: &Map, profile: &CharacterProfile) -> Self {
        let mut stops = Vec::new();
        let mut scratch = MoveScratch::default();
        for (id, mover) in (0..).map(MoverId).zip(map.movers()).filter(|(_, mover)| mover.kind.is_ridden()) {
            for stop in 0..mover.stops.len() {
                let place = top(mover, stop).filter(|place| {
                    let inside = !map.is_outside(*place) && place.y <= map.extent().y;
                    inside && is_clear(map.mesh(), profile, *place, CLEAR_SLOP_M, &mut scratch)
                });
                stops.extend(place.map(|place| (place, MoverAt { mover: id, stop: StopIdx(stop as u8) })));
            }
        }
        let mut by_cell: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (idx, (place, _)) in (0..).zip(&stops) {
            by_cell.entry(cell(*place)).or_default().push(idx);
        }
        Self { stops, by_cell }
    }

    /// All positions, m.
    pub fn places(&self) -> impl ExactSizeIterator<Item = Vec3> {
        self.stops.iter().map(|(place, _)| *place)
    }

    /// The first ride stop at `place`.
    pub fn at(&self, place: Vec3) -> Option<MoverAt> {
        self.near(place).min().map(|idx| self.stops[idx as usize].1)
    }

    /// The ride stop of each vertex. A ride stop belongs to one vertex. Where several ride stops share a position, each
    /// vertex there gets one of its own, as long as there are any.
    pub fn of_vertices(&self, vertices: &[Vec3]) -> Vec<Option<MoverAt>> {
        let mut is_taken = vec![false; self.stops.len()];
        let free = vertices.iter().map(|at| {
            let idx = self.near(*at).filter(|idx| !is_taken[*idx as usize]).min()?;
            is_taken[idx as usize] = true;
            Some(self.stops[idx as usize].1)
        });
        free.collect()
    }

    /// Indices of the ride stops at `place`.
    fn near(&self, place: Vec3) -> impl Iterator<Item = u32> {
        let ([left, low, back], [right, high, front]) =
            (cell(place - Vec3::splat(SAME_M)), cell(place + Vec3::splat(SAME_M)));
        (left..=right)
            .flat_map(move |x| (low..=high).flat_map(move |y| (back..=front).map(move |z| [x, y, z])))
            .filter_map(|cell| self.by_cell.get(&cell))
            .flatten()
            .copied()
            .filter(move |idx| self.stops[*idx as usize].0.distance_squared(place) < SAME_M * SAME_M)
    }
}

/// The cell in which a ride stop is looked up.
fn cell(place: Vec3) -> [i32; 3] {
    (place / CELL_M).floor().to_array().map(|value| value as i32)
}

/// The states of movers in which edges are proved. Doors are open, floors are there, crates are held where they began,
/// and lifts and platforms stand at their first stop. The mover `held` stands at the given stop instead.
pub fn states_for_proof(map: &Map, held: Option<MoverAt>) -> Vec<MoverState> {
    let state = |(id, mover): (MoverId, &Mover)| {
        let usual = if mover.kind == MoverKind::Door { mover.stops.len() as u8 - 1 } else { 0 };
        let stop = held.filter(|held| held.mover == id).map_or(StopIdx(usual), |held| held.stop);
        let pace = if mover.kind == MoverKind::Crate { 0.0 } else { 1.0 };
        MoverState { from: stop, to: stop, ordered_stop: Some(stop), progress: 0.0, pace, ..MoverState::new(mover) }
    };
    (0..).map(MoverId).zip(map.movers()).map(state).collect()
}

/// The boarding of a mover that is held at a stop for probes.
#[derive(Debug, Clone, Copy)]
pub struct Boarding {
    ride_stop: Vec3,
    wait: u32,
}

impl Boarding {
    /// The boarding of a mover that is held; `None` if none is, or the map has no such ride stop.
    pub fn of(map: &Map, held: Option<MoverAt>) -> Option<Self> {
        let MoverAt { mover, stop } = held?;
        let mover = map.movers().get(mover.idx()).filter(|mover| stop.idx() < mover.stops.len())?;
        Some(Self { ride_stop: top(mover, stop.idx())?, wait: mean_wait(mover).0 as u32 })
    }

    /// Decisions for which NPCs on their way from `start` wait on average before they board: 0 if they are aboard.
    pub fn wait_from(&self, start: Vec3) -> u32 {
        if self.ride_stop.distance_squared(start) < SAME_M * SAME_M { 0 } else { self.wait }
    }
}

/// The paths of movers. A body waiting in a mover's path would block it, so vertices keep away.
#[derive(Debug)]
pub(crate) struct Clearance<'a> {
    reliance: Reliance,
    profile: &'a CharacterProfile,
}

impl<'a> Clearance<'a> {
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

/// How long an NPC that wants to board a mover waits on average until the mover stands at the stop.
pub fn mean_wait(mover: &Mover) -> Decisions {
    let journeys = (mover.stops.len() - 1) as f32;
    let seconds = if mover.cycles {
        // There and back, with a stay at each stop. NPCs that come during the stay do not wait.
        let round = 2.0 * journeys * (mover.travel_s + mover.dwell_s);
        let away = round - mover.dwell_s;
        0.5 * away * away / round.max(f32::MIN_POSITIVE)
    } else {
        0.5 * journeys * mover.travel_s
    };
    Decisions(f64::from(seconds / DECISION_SECONDS))
}

/// Longest duration of a ride, stops on the way included, in ticks.
pub fn longest_ride_ticks(mover: &Mover, ride: Ride) -> u32 {
    let journeys = f32::from(ride.from.0.abs_diff(ride.to.0)).max(1.0) * 2.0 * mover.stops.len() as f32;
    (journeys * (mover.travel_s + mover.dwell_s) * TICKS_PER_SECOND as f32) as u32 + 10 * TICKS_PER_DECISION
}
