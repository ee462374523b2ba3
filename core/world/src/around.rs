//! Walks around what bars the straight way: a search over places to stand on a local grid, pulled taut.

use crate::Vec3;
use crate::arrival::{self, Place};
use crate::character::{CharacterProfile, MoveScratch, is_clear};
use crate::float::horizontal;
use crate::map::Map;
use crate::movers::Movers;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Distance between two places of the grid, m.
const CELL_M: f32 = 0.5;
/// Most places from which a search goes on.
const MAX_PLACES: usize = 300;
/// Longest walk, as a multiple of the distance between its ends, and what is added to that, m.
const LONGEST: f32 = 2.5;
const LONGER_M: f32 = 6.0;
/// Weight of the distance that is left in the cost of a walk: more than 1, so that fewer places are tried.
const EAGER: f32 = 1.5;
/// Room that a body keeps to walls besides its radius, as a share of its radius.
const ROOM: f32 = 0.25;
/// Height above the ground at which a body is tried, m: a capsule on a slope touches beside its lowest point.
const LIFT_M: f32 = 0.12;
/// Steps from a place, in cells.
const STEPS: [(i32, i32); 8] = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];

/// The corners of a short walk from one place on a map to another, m, and its end; `None` if there is none nearby.
/// It leads over dry ground without devices, and does not consider movers.
pub fn walk_around(map: &Map, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> Option<Vec<Vec3>> {
    let places = Search { map, profile, to, longest: LONGEST * from.distance(to) + LONGER_M }.run(from)?;
    Some(pulled_taut(map, profile, &places))
}

type Cell = (i32, i32);

/// A place that a search has reached.
#[derive(Debug, Clone, Copy)]
struct Reached {
    feet: Vec3,
    /// Length of the walk there, m.
    length: f32,
    before: Cell,
    is_done: bool,
}

/// A place from which a search may go on: the cost of a walk through it, the length of the walk there, and its cell.
/// Lengths are not negative, so that their bits have the order of their values; the least cost comes first.
type Open = (Reverse<u32>, u32, Cell);

fn open(cost: f32, length: f32, cell: Cell) -> Open {
    (Reverse(cost.to_bits()), length.to_bits(), cell)
}

/// A search for a walk by A*.
struct Search<'a> {
    map: &'a Map,
    profile: &'a CharacterProfile,
    to: Vec3,
    /// Length of the longest walk, m.
    longest: f32,
}

impl Search<'_> {
    /// The places of the walk from `from`, m, and its end.
    fn run(&self, from: Vec3) -> Option<Vec<Vec3>> {
        let mut scratch = MoveScratch::default();
        let start = Reached { feet: from, length: 0.0, before: (0, 0), is_done: false };
        let mut reached = BTreeMap::from([((0, 0), start)]);
        let mut waiting = BinaryHeap::from([open(0.0, 0.0, (0, 0))]);
        let mut left = MAX_PLACES;
        while let Some((.., cell)) = waiting.pop() {
            let here = reached.get_mut(&cell)?;
            if std::mem::replace(&mut here.is_done, true) {
                continue;
            }
            let here = *here;
            if self.is_there(here.feet) {
                return Some(walk_to(cell, &reached, self.to));
            }
            left = left.checked_sub(1)?;
            for (x, z) in STEPS {
                let next = (cell.0 + x, cell.1 + z);
                let step = Vec3::new(x as f32, 0.0, z as f32) * CELL_M;
                let length = here.length + horizontal(step);
                let left_m = horizontal(self.to - (here.feet + step));
                let is_longer = reached.get(&next).is_some_and(|other| other.is_done || other.length <= length);
                if is_longer || length + left_m > self.longest {
                    continue;
                }
                if let Some(feet) = self.step(here.feet, step, &mut scratch) {
                    reached.insert(next, Reached { feet, length, before: cell, is_done: false });
                    waiting.push(open(length + EAGER * left_m, length, next));
                }
            }
        }
        None
    }

    /// Whether the walk ends at the next place.
    fn is_there(&self, feet: Vec3) -> bool {
        horizontal(self.to - feet) <= CELL_M && arrival::walks_straight(self.map, self.profile, feet, self.to)
    }

    /// Where a body stands after a step.
    fn step(&self, from: Vec3, step: Vec3, scratch: &mut MoveScratch) -> Option<Vec3> {
        let place = Place { map: self.map, movers: &Movers::default(), profile: self.profile };
        let (walked, feet) = place.walkable(from, step);
        let has_room = |aside: Vec3| is_clear(self.map.mesh(), self.profile, feet + aside, 0.02, scratch);
        let room = step.normalize_or_zero().cross(Vec3::Y) * (ROOM * self.profile.radius);
        let up = Vec3::Y * LIFT_M;
        (walked >= step.length() && [up + room, up - room].into_iter().all(has_room)).then_some(feet)
    }
}

/// The places of a walk to `cell`, and its end `to`, m.
fn walk_to(cell: Cell, reached: &BTreeMap<Cell, Reached>, to: Vec3) -> Vec<Vec3> {
    let mut places = vec![to];
    let mut cell = cell;
    loop {
        let place = reached[&cell];
        places.push(place.feet);
        if place.before == cell {
            break;
        }
        cell = place.before;
    }
    places.reverse();
    places
}

/// The places of a walk after the first one at which it must turn.
fn pulled_taut(map: &Map, profile: &CharacterProfile, places: &[Vec3]) -> Vec<Vec3> {
    let mut corners = Vec::new();
    let mut at = 0;
    while at + 1 < places.len() {
        let is_lane = |next: &usize| arrival::is_lane(map, profile, [places[at], places[*next]], 0.0);
        at = (at + 2..places.len()).take_while(is_lane).last().unwrap_or(at + 1);
        corners.push(places[at]);
    }
    corners
}
