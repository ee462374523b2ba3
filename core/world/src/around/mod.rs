//! Walks around what bars the straight way: a search over places to stand, pulled taut.

mod places;

use crate::Vec3;
use crate::arrival;
use crate::character::CharacterProfile;
use crate::float::horizontal;
use crate::map::Map;
use places::{CELL_M, PlaceId, Places, STEPS};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Most places from which a search goes on.
const MAX_PLACES: usize = 300;
/// Longest walk, as a multiple of the distance between its ends, and what is added to that, m.
const LONGEST: f32 = 2.5;
const LONGER_M: f32 = 6.0;
/// Weight of the distance that is left in the cost of a walk: more than 1, so that fewer places are tried.
const EAGER: f32 = 1.5;

/// The corners of a short walk from one place on a map to another, m, and its end; `None` if there is none nearby.
/// It leads over dry ground without devices, and does not consider movers. The map keeps the places that were found,
/// so later walks nearby take less time.
pub fn walk_around(map: &Map, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> Option<Vec<Vec3>> {
    let search = Search { map, profile, to, longest: LONGEST * from.distance(to) + LONGER_M };
    let places = places::on(map, profile, |places| search.run(from, places))?;
    Some(pulled_taut(map, profile, &places))
}

/// A place that a search has reached.
#[derive(Debug, Clone, Copy)]
struct Reached {
    feet: Vec3,
    /// Length of the walk there, m.
    length: f32,
    /// The place before it; `None` where the walk begins.
    before: Option<PlaceId>,
    is_done: bool,
}

/// A place from which a search may go on: the cost of a walk through it, the length of the walk there, and its number.
/// Lengths are not negative, so that their bits have the order of their values; the least cost comes first.
type Open = (Reverse<u32>, u32, PlaceId);

fn open(cost: f32, length: f32, place: PlaceId) -> Open {
    (Reverse(cost.to_bits()), length.to_bits(), place)
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
    fn run(&self, from: Vec3, places: &mut Places<'_>) -> Option<Vec<Vec3>> {
        let (mut reached, mut waiting) = (BTreeMap::new(), BinaryHeap::new());
        for (place, feet) in places.around(from) {
            self.note((place, feet), from.distance(feet), None, (&mut reached, &mut waiting));
        }
        let mut left = MAX_PLACES;
        while let Some((.., place)) = waiting.pop() {
            let here = reached.get_mut(&place)?;
            if std::mem::replace(&mut here.is_done, true) {
                continue;
            }
            let here = *here;
            if self.is_there(here.feet) {
                return Some(walk_to(from, place, &reached, self.to));
            }
            left = left.checked_sub(1)?;
            for step in 0..STEPS.len() {
                if let Some((next, feet)) = places.step(place, step) {
                    let length = here.length + horizontal(feet - here.feet);
                    self.note((next, feet), length, Some(place), (&mut reached, &mut waiting));
                }
            }
        }
        None
    }

    /// Notes a walk of `length` metres to a place, if it is the shortest so far and not too long.
    fn note(
        &self,
        (place, feet): (PlaceId, Vec3),
        length: f32,
        before: Option<PlaceId>,
        (reached, waiting): (&mut BTreeMap<PlaceId, Reached>, &mut BinaryHeap<Open>),
    ) {
        let left = horizontal(self.to - feet);
        let is_longer = reached.get(&place).is_some_and(|other| other.is_done || other.length <= length);
        if !is_longer && length + left <= self.longest {
            reached.insert(place, Reached { feet, length, before, is_done: false });
            waiting.push(open(length + EAGER * left, length, place));
        }
    }

    /// Whether the walk ends at the next place.
    fn is_there(&self, feet: Vec3) -> bool {
        horizontal(self.to - feet) <= CELL_M && arrival::walks_straight(self.map, self.profile, feet, self.to)
    }
}

/// The places of a walk from `from` to `place`, and its end `to`, m.
fn walk_to(from: Vec3, place: PlaceId, reached: &BTreeMap<PlaceId, Reached>, to: Vec3) -> Vec<Vec3> {
    let mut places = vec![to];
    let mut next = Some(place);
    while let Some(place) = next {
        let here = reached[&place];
        places.push(here.feet);
        next = here.before;
    }
    places.push(from);
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
