//! Candidates are those of searches through all vertices.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_planner::candidates::{Candidate, by_ride_stops, find};
use surefoot_planner::{BuildSettings, EdgeKey, MoverAt, Placement, Site};
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::{Map, MoverId, StopIdx, Vec3};

/// Number of vertices that each ride stop is paired with, and the greatest distance of such a vertex from it, m.
const BOARDINGS: usize = 10;
const BOARD_M: f32 = 14.0;

/// Vertices of several densities: on a plane, stacked, in a line, in two crowds, and many at the same places.
fn vertices(kind: u32, count: usize) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(u64::from(kind));
    let mut within = |side: f32| Vec3::new(rng.random_range(0.0..side), 0.0, rng.random_range(0.0..side));
    let place = |idx: usize| {
        let at = within(200.0);
        match kind {
            0 => at.with_y((idx % 5) as f32 * 3.0),
            1 => Vec3::new(7.0, at.x, 7.0),
            2 => at.with_z(3.0),
            3 => at / 50.0 + if idx.is_multiple_of(9) { Vec3::X * 900.0 } else { Vec3::ZERO },
            _ => (at / 40.0).round() * 40.0,
        }
    };
    (0..count).map(place).collect()
}

#[test]
fn neighbours_are_those_of_a_search_through_all_vertices() {
    let size = MapSize { width: 100, height: 20, depth: 100 };
    let site = Site::new(Arc::new(Map::from_parts(size, Vec::new(), Placed::default())));
    for (kind, count) in (0..5).flat_map(|kind| [2, 7, 60, 500].map(|count| (kind, count))) {
        let vertices = vertices(kind, count);
        for neighbours in [1, 12, 64] {
            let through_all = (0..count as u32).flat_map(|from| {
                let distance = |to: u32| vertices[from as usize].distance_squared(vertices[to as usize]);
                let mut others: Vec<u32> = (0..count as u32).filter(|to| *to != from).collect();
                others.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
                others.into_iter().take(neighbours).map(move |to| EdgeKey::new(from, to))
            });
            let expected: Vec<Candidate> = through_all.collect();
            let settings = BuildSettings::of_paper(Placement::Random).with(|raw| raw.neighbours = neighbours).unwrap();
            let (found, _) = find(&site, &settings, &vertices);
            assert_eq!(found, expected, "kind {kind}, {count} vertices, {neighbours}");
        }
    }
}

#[test]
fn berths_are_joined_to_each_other_by_rides_and_to_the_nearest_ground() {
    let mut vertices = vertices(0, 200);
    vertices.extend([0.0, 4.0, 8.0].map(|height| Vec3::new(100.0, height, 100.0)));
    vertices.push(Vec3::new(103.0, 0.0, 100.0));
    let mut ride_stops = vec![None; 200];
    let at = |(mover, stop)| Some(MoverAt { mover: MoverId(mover), stop: StopIdx(stop) });
    ride_stops.extend([(3, 0), (3, 1), (3, 2), (9, 0)].map(at));
    let found = by_ride_stops(&ride_stops, &vertices, &[EdgeKey::new(200, 202)]);
    let rides: Vec<Candidate> = found.iter().copied().filter(|key| key.from.0.min(key.to.0) >= 200).collect();
    let expected = [(200, 201), (201, 200), (201, 202), (202, 200), (202, 201)];
    assert_eq!(
        rides,
        expected.map(|(from, to)| EdgeKey::new(from, to)),
        "one is known, and none leads to the other lift"
    );
    for ride_stop in 200..204 {
        let at = vertices[ride_stop as usize];
        let mut near: Vec<u32> = (0..200).filter(|idx| vertices[*idx as usize].distance(at) <= BOARD_M).collect();
        near.sort_by(|a, b| vertices[*a as usize].distance(at).total_cmp(&vertices[*b as usize].distance(at)));
        near.truncate(BOARDINGS);
        near.sort_unstable();
        let boards = |key: &&Candidate| key.to.0 == ride_stop && key.from.0 < 200;
        assert_eq!(found.iter().filter(boards).map(|key| key.from.0).collect::<Vec<_>>(), near);
        assert!(near.iter().all(|&to| found.contains(&EdgeKey::new(ride_stop, to))));
    }
}
