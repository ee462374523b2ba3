//! Selects candidate edges: the pairs of vertices that are worth probing.
//!
//! In the paper, each vertex is paired with its nearest neighbours. Special moves join vertices that are farther apart: a
//! pad and its landing, the ends of a zip line, the top and foot of a cliff. [`by_features`] adds such pairs from the
//! map's devices and ledges, so that they do not depend on chance.

use crate::grid::PointGrid;
use crate::ids::EdgeKey;
use crate::needs::Berths;
use std::collections::BTreeSet;
use surefoot_world::float::hypot;
use surefoot_world::{CharacterProfile, Map, Vec3};

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

/// Number of vertices that each berth is paired with, and their greatest distance, m.
const BOARDINGS: usize = 10;
const BOARD_M: f32 = 14.0;

/// Pairs each vertex with its `neighbours` nearest vertices, in the order of the vertices, nearest first.
pub fn nearest(vertices: &[Vec3], neighbours: usize) -> Vec<Candidate> {
    nearest_of(0..vertices.len() as u32, vertices, neighbours)
}

/// The same for some of the vertices.
pub fn nearest_of(some: impl Iterator<Item = u32>, vertices: &[Vec3], neighbours: usize) -> Vec<Candidate> {
    let mut candidates = Vec::with_capacity(some.size_hint().0 * neighbours);
    let mut others: Vec<(f32, u32)> = Vec::with_capacity(vertices.len());
    for from in some {
        let position = vertices[from as usize];
        others.clear();
        others.extend(
            (0..)
                .zip(vertices)
                .filter(|&(to, _)| to != from)
                .map(|(to, other)| (position.distance_squared(*other), to)),
        );
        let by_distance = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if others.len() > neighbours {
            others.select_nth_unstable_by(neighbours, by_distance);
            others.truncate(neighbours);
        }
        others.sort_unstable_by(by_distance);
        candidates.extend(others.iter().map(|&(_, to)| EdgeKey::new(from, to)));
    }
    candidates
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
    let placed = map.placed();
    for pad in &placed.pads {
        let rise = 0.5 * pad.speed * pad.speed / profile.gravity + 2.0;
        let landings = closest(&grid, vertices, pad.centre, THROW_M, LANDINGS, |at| {
            (JUMP_RISE_M..=rise).contains(&(at.y - pad.centre.y))
        });
        join(&beside(pad.centre), &landings);
    }
    if profile.uses_jetpacks {
        for jetpack in &placed.jetpacks {
            let rise = profile.jetpack_climb_speed * jetpack.fuel;
            let landings = closest(&grid, vertices, jetpack.centre, JETPACK_M, LANDINGS, |at| {
                (JUMP_RISE_M..=rise).contains(&(at.y - jetpack.centre.y))
            });
            join(&beside(jetpack.centre), &landings);
        }
    }
    if profile.uses_zip_lines {
        for line in &placed.zip_lines {
            join(&beside(line.from), &beside(line.path()[2]));
        }
    }
    for teleporter in &placed.teleporters {
        join(&beside(teleporter.from), &beside(teleporter.to));
        if teleporter.two_way {
            join(&beside(teleporter.to), &beside(teleporter.from));
        }
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

/// Finds the candidate edges of berths that are not in `known`, in ascending order: the rides, and the ways to and from the nearest vertices
/// that are no berths.
pub fn by_berths(berths: &Berths, vertices: &[Vec3], known: &[Candidate]) -> Vec<Candidate> {
    let mut found = BTreeSet::new();
    let moored: Vec<bool> = vertices.iter().map(|at| berths.at(*at).is_some()).collect();
    for (berth, &at) in (0..).zip(vertices).filter(|(idx, _)| moored[*idx as usize]) {
        let mut others: Vec<(f32, u32)> = Vec::new();
        for (other, &place) in (0..).zip(vertices).filter(|(other, _)| *other != berth) {
            if berths.ride(at, place).is_some() {
                found.insert(EdgeKey::new(berth, other));
            } else if !moored[other as usize] && place.distance(at) <= BOARD_M {
                others.push((place.distance_squared(at), other));
            }
        }
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, other) in others.into_iter().take(BOARDINGS) {
            found.extend([EdgeKey::new(berth, other), EdgeKey::new(other, berth)]);
        }
    }
    known.iter().for_each(|candidate| {
        found.remove(candidate);
    });
    found.into_iter().collect()
}

/// Returns up to `count` vertices within `reach` metres of `point` on the plane whose position satisfies `fits`, nearest
/// first.
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
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().take(count).map(|(_, idx)| idx).collect()
}
