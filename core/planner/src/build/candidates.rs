//! Selects candidate edges: the pairs of vertices that are worth probing.
//!
//! In the paper, each vertex is paired with its nearest neighbours. Special moves join vertices that are farther
//! apart: a pad and its landing, the ends of a zip line, the top and foot of a cliff. [`by_features`] adds such pairs
//! from the map's devices and ledges, so that they do not depend on chance.

use crate::grid::PointGrid;
use crate::ids::EdgeKey;
use crate::needs::Ride;
use crate::ride_stops::RideStops;
use crate::settings::{BuildSettings, Site};
use std::collections::{BTreeMap, BTreeSet};
use surefoot_world::crossings::crossings;
use surefoot_world::float::hypot;
use surefoot_world::map::DeviceKind;
use surefoot_world::{CharacterProfile, Map, MoverAt, MoverId, Vec3};

/// A candidate edge: an ordered pair of vertices.
pub type Candidate = EdgeKey;

/// Number of vertices at a device's entrance, and at its exit, that are paired.
const BESIDE: usize = 3;
/// Greatest horizontal distance of such a vertex from the device, m.
const BESIDE_M: f32 = 14.0;
/// Number of landings that are considered for a pad or jetpack.
const LANDINGS: usize = 5;
/// Greatest horizontal distance from a pad to a landing, m: a flight at 11 m/s that ends high up.
const THROW_M: f32 = 20.0;
/// Greatest horizontal distance from a jetpack to a landing, m.
const JETPACK_M: f32 = 40.0;
/// Least rise of a landing, m; two jumps reach lower ones without a pad or jetpack.
const JUMP_RISE_M: f32 = 3.0;
/// Number of lower vertices that each vertex is paired with for drops.
const DROPS: usize = 2;
/// Least height of such a drop, m; lower drops are found among the nearest neighbours.
const DROP_M: f32 = 4.0;
/// Greatest horizontal distance that a character covers while dropping, m.
const DROP_REACH_M: f32 = 16.0;

/// Number of vertices that each ride stop is paired with.
const BOARDINGS: usize = 10;
/// Greatest distance of such a vertex from the ride stop, m.
const BOARD_M: f32 = 14.0;

/// Vertices in a column of the grid in which neighbours are looked up, on average.
const VERTICES_PER_COLUMN: f32 = 4.0;
/// Error of distances, m.
const ROUNDING_M: f32 = 0.01;

/// Finds the candidate edges from each vertex to its nearest neighbours, to and from ride stops and, if the settings
/// include special moves, at devices and ledges. Also returns the number of the latter.
pub fn find(site: &Site, settings: &BuildSettings, vertices: &[Vec3]) -> (Vec<Candidate>, u64) {
    find_of(0..vertices.len() as u32, site, settings, vertices)
}

/// Like [`find`], with the nearest neighbours of some vertices only.
pub(crate) fn find_of(
    some: impl Iterator<Item = u32>,
    site: &Site,
    settings: &BuildSettings,
    vertices: &[Vec3],
) -> (Vec<Candidate>, u64) {
    let mut candidates = nearest_of(some, vertices, settings.neighbours);
    let ride_stops = RideStops::on(&site.map, &site.profile).of_vertices(vertices);
    if ride_stops.iter().any(Option::is_some) {
        // NPCs do not leap from one mover to another.
        candidates.retain(|key| match (ride_stops[key.from.idx()], ride_stops[key.to.idx()]) {
            (Some(from), Some(to)) => Ride::between(from, to).is_some(),
            _ => true,
        });
        candidates.extend(by_ride_stops(&ride_stops, vertices, &candidates));
    }
    if !settings.special_moves {
        return (candidates, 0);
    }
    let special = by_features(&site.map, &site.profile, vertices, &candidates);
    candidates.extend(&special);
    (candidates, special.len() as u64)
}

/// Pairs some vertices with their `neighbours` nearest vertices, in the order of the vertices, nearest first.
fn nearest_of(some: impl Iterator<Item = u32>, vertices: &[Vec3], neighbours: usize) -> Vec<Candidate> {
    let grid = PointGrid::spread(vertices, VERTICES_PER_COLUMN);
    let of = |from: u32| {
        let near = grid.nearest(vertices, vertices[from as usize], neighbours, |to| to != from);
        near.into_iter().map(move |to| EdgeKey::new(from, to))
    };
    some.flat_map(of).collect()
}

/// Keeps the `count` nearest of some vertices, nearest first; of equally near ones, the first.
fn keep_nearest(vertices: &mut Vec<(f32, u32)>, count: usize) {
    let by_distance = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if vertices.len() > count {
        vertices.select_nth_unstable_by(count, by_distance);
        vertices.truncate(count);
    }
    vertices.sort_unstable_by(by_distance);
}

/// Finds the candidate edges at the map's devices and ledges that are not in `known`, in ascending order.
pub fn by_features(map: &Map, profile: &CharacterProfile, vertices: &[Vec3], known: &[Candidate]) -> Vec<Candidate> {
    let mut found = BTreeSet::new();
    let grid = PointGrid::new(vertices, BESIDE_M);
    let beside = |point: Vec3| closest(&grid, vertices, point, BESIDE_M, BESIDE, |_| true);
    let mut join = |sources: &[u32], targets: &[u32]| {
        let pairs = sources.iter().flat_map(|&from| targets.iter().map(move |&to| EdgeKey::new(from, to)));
        found.extend(pairs.filter(|key| key.from != key.to));
    };
    for device in map.placed().devices().filter(|device| profile.uses(device.kind)) {
        let Some(rise) = profile.rise_by(device) else {
            device.entrances().for_each(|way| join(&beside(way.from), &beside(way.exit())));
            continue;
        };
        let reach = if device.kind == DeviceKind::Pad { THROW_M } else { JETPACK_M };
        let landings = closest(&grid, vertices, device.from, reach, LANDINGS, |at| {
            (JUMP_RISE_M..=rise).contains(&(at.y - device.from.y))
        });
        join(&beside(device.from), &landings);
    }
    for crossing in crossings(map, profile) {
        join(&beside(crossing.from), &beside(crossing.to));
    }
    for (from, &ledge) in (0..).zip(vertices) {
        let below = closest(&grid, vertices, ledge, DROP_REACH_M, DROPS, |at| ledge.y - at.y > DROP_M);
        join(&[from], &below);
    }
    known.iter().for_each(|candidate| {
        found.remove(candidate);
    });
    found.into_iter().collect()
}

/// Finds the candidate edges at ride stops that are not in `known`, in ascending order: the rides, and the legs to and
/// from the nearest vertices that are not ride stops. `ride_stops` has the ride stop of each vertex.
pub fn by_ride_stops(ride_stops: &[Option<MoverAt>], vertices: &[Vec3], known: &[Candidate]) -> Vec<Candidate> {
    let mut found = BTreeSet::new();
    let mut stops: BTreeMap<MoverId, Vec<u32>> = BTreeMap::new();
    let (mut on_movers, mut others) = (Vec::new(), Vec::new());
    for (vertex, ride_stop) in (0..).zip(ride_stops) {
        match ride_stop {
            Some(MoverAt { mover, .. }) => {
                stops.entry(*mover).or_default().push(vertex);
                on_movers.push(vertex);
            }
            None => others.push(vertex),
        }
    }
    for stops in stops.values() {
        let rides = stops.iter().flat_map(|&from| stops.iter().map(move |&to| EdgeKey::new(from, to)));
        found.extend(rides.filter(|ride| ride.from != ride.to));
    }
    let places: Vec<Vec3> = others.iter().map(|&vertex| vertices[vertex as usize]).collect();
    let grid = PointGrid::new(&places, BOARD_M);
    for ride_stop in on_movers {
        let at = vertices[ride_stop as usize];
        let near = grid.within(at, BOARD_M + ROUNDING_M).map(|idx| (places[idx as usize], others[idx as usize]));
        let near = near.filter(|(place, _)| place.distance(at) <= BOARD_M);
        let mut near: Vec<(f32, u32)> = near.map(|(place, other)| (place.distance_squared(at), other)).collect();
        keep_nearest(&mut near, BOARDINGS);
        for (_, other) in near {
            found.extend([EdgeKey::new(ride_stop, other), EdgeKey::new(other, ride_stop)]);
        }
    }
    known.iter().for_each(|candidate| {
        found.remove(candidate);
    });
    found.into_iter().collect()
}

/// Returns up to `count` vertices within `reach` metres of `point` on the plane whose position satisfies `fits`,
/// nearest first.
fn closest(
    grid: &PointGrid,
    vertices: &[Vec3],
    point: Vec3,
    reach: f32,
    count: usize,
    fits: impl Fn(Vec3) -> bool,
) -> Vec<u32> {
    let mut near: Vec<(f32, u32)> = grid
        .within(point, reach)
        .filter_map(|idx| {
            let at = vertices[idx as usize];
            let distance = hypot(at.x - point.x, at.z - point.z);
            (distance <= reach && fits(at)).then_some((distance, idx))
        })
        .collect();
    keep_nearest(&mut near, count);
    near.into_iter().map(|(_, idx)| idx).collect()
}
