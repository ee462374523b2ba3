//! Which pairs of vertices are worth a try.
//!
//! The paper's candidates are each vertex's nearest others. Special moves join places that are not near: a pad's
//! landing, the end of a zip line, the foot of a cliff. [`by_features`] adds those from the map's own devices and
//! ledges, so that no such edge depends on luck.

use crate::grid::PointGrid;
use crate::ids::EdgeKey;
use std::collections::BTreeSet;
use surefoot_world::float::hypot;
use surefoot_world::{CharacterProfile, Map, Vec3};

/// A pair of vertices that is worth a try.
pub type Candidate = EdgeKey;

/// Vertices beside a device's entrance, and beside its exit, that are joined.
const BESIDE: usize = 3;
/// How far a vertex beside a device may be, m.
const BESIDE_M: f32 = 14.0;
/// Landings that a pad or jetpack is tried for.
const LANDINGS: usize = 5;
/// How far a pad throws, m: its flight at 11 m/s until it comes down high up.
const THROW_M: f32 = 20.0;
/// How far a jetpack carries, m.
const JETPACK_M: f32 = 40.0;
/// Rise beyond which two jumps are not enough, m; below, pads are not tried.
const JUMP_RISE_M: f32 = 3.0;
/// Ledges below that each vertex is tried against.
const DROPS: usize = 2;
/// Least height of a drop that counts as special, m; others are found among the nearest.
const DROP_M: f32 = 4.0;
/// How far a character sails while dropping, m.
const DROP_REACH_M: f32 = 16.0;

/// Each vertex with its `neighbours` nearest others, in the order of the vertices, nearest first.
pub fn nearest(vertices: &[Vec3], neighbours: usize) -> Vec<Candidate> {
    let mut candidates = Vec::with_capacity(vertices.len() * neighbours);
    let mut others: Vec<(f32, u32)> = Vec::with_capacity(vertices.len());
    for (from, position) in (0..).zip(vertices) {
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

/// Candidates from the map's devices and ledges that are not among `known`, in ascending order.
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

/// Up to `count` vertices that are nearest to `point` on the plane, among those that `fits` lets through.
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
