//! Walks around what bars the straight way.

use std::sync::Arc;
use surefoot_world::around::walk_around;
use surefoot_world::arrival::{RUN_UP_M, Rims, rims, walks_straight};
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, Map, Vec3};

const FLOOR: f32 = 2.0;

fn at(x: f32, z: f32) -> Vec3 {
    Vec3::new(x, FLOOR, z)
}

fn map(boxes: &[[Vec3; 2]]) -> Arc<Map> {
    let faces = boxes.iter().flat_map(|[low, high]| cuboid(*low, *high));
    let triangles = faces.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    Arc::new(Map::from_parts(MapSize { width: 24, height: 20, depth: 24 }, triangles, Placed::default()))
}

fn slab(from: f32, to: f32, height: f32) -> [Vec3; 2] {
    [Vec3::new(from, 0.0, 0.0), Vec3::new(to, FLOOR + height, 24.0)]
}

fn wall(from: f32, to: f32) -> [Vec3; 2] {
    [Vec3::new(11.5, FLOOR, from), Vec3::new(12.5, 12.0, to)]
}

#[test]
fn a_body_walks_around_the_end_of_a_wall_and_through_a_door() {
    let body = CharacterProfile::default();
    let ends = [at(8.0, 8.0), at(16.0, 8.0)];
    let cases = [
        ("the end of a wall", vec![wall(0.0, 11.0)], 14.0),
        ("a door of 1 m", vec![wall(0.0, 11.0), wall(12.0, 24.0)], 14.0),
    ];
    for (name, walls, longest) in cases {
        let map = map(&[vec![slab(0.0, 24.0, 0.0)], walls].concat());
        let way = walk_around(&map, &body, ends).expect(name);
        assert_eq!(way.last(), Some(&ends[1]), "{name}");
        let places = [&ends[..1], &way].concat();
        let length: f32 = places.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        assert!(way.len() > 1 && length < longest, "{name}: {length} m, {way:?}");
        let is_walked = |pair: &[Vec3]| walks_straight(&map, &body, pair[0], pair[1]);
        assert!(places.windows(2).all(is_walked), "{name}: {way:?}");
        assert_eq!(walk_around(&map, &body, ends), Some(way), "{name}: the same way again");
    }
}

#[test]
fn what_a_map_keeps_of_earlier_walks_changes_no_later_one() {
    let boxes = [slab(0.0, 24.0, 0.0), wall(0.0, 11.0), wall(12.0, 24.0)];
    let (body, wide) = (CharacterProfile::default(), NamedBody::find("godot").expect("a named body").profile());
    let searched = map(&boxes);
    let pairs = [[at(16.0, 10.3), at(7.2, 14.0)], [at(8.1, 8.3), at(16.0, 8.0)], [at(9.0, 13.0), at(15.0, 11.0)]];
    for ends in pairs {
        for body in [&wide, &body] {
            assert_eq!(walk_around(&searched, body, ends), walk_around(&map(&boxes), body, ends), "{ends:?}");
        }
    }
    assert!(pairs.iter().all(|ends| walk_around(&searched, &body, *ends).is_some()), "through the door");
}

#[test]
fn there_is_no_walk_where_none_is_short_or_the_ground_ends() {
    let body = CharacterProfile::default();
    let ends = [at(10.0, 2.0), at(14.0, 2.0)];
    let cases = [
        ("a wall without a door", vec![slab(0.0, 24.0, 0.0), wall(0.0, 24.0)]),
        ("a wall with a far end", vec![slab(0.0, 24.0, 0.0), wall(0.0, 20.0)]),
        ("a door too narrow", vec![slab(0.0, 24.0, 0.0), wall(0.0, 4.0), wall(4.5, 24.0)]),
        ("a gap", vec![slab(0.0, 11.0, 0.0), slab(13.0, 24.0, 0.0)]),
        ("a ledge", vec![slab(0.0, 12.0, 0.0), slab(12.0, 24.0, 1.5)]),
    ];
    for (name, boxes) in cases {
        let lift = if name == "a ledge" { Vec3::Y * 1.5 } else { Vec3::ZERO };
        assert_eq!(walk_around(&map(&boxes), &body, [ends[0], ends[1] + lift]), None, "{name}");
    }
}

#[test]
fn a_gap_and_a_ledge_have_two_rims_and_other_ways_have_none() {
    let body = CharacterProfile::default();
    let gap = map(&[slab(0.0, 10.0, 0.0), slab(13.0, 24.0, -0.5)]);
    let Rims { take_off: near, landing: far, run_up_m } =
        rims(&gap, &body, [at(4.0, 8.0), at(20.0, 8.0) - Vec3::Y * 0.5]).expect("a gap");
    assert!((near.x - 10.0).abs() < 0.3 && (far.x - 13.0).abs() < 0.3, "{near} {far}");
    assert_eq!(run_up_m, RUN_UP_M);
    let ledge = map(&[slab(0.0, 12.0, 0.0), slab(12.0, 24.0, 1.5)]);
    let Rims { take_off: near, landing: far, .. } =
        rims(&ledge, &body, [at(4.0, 8.0), at(20.0, 8.0) + Vec3::Y * 1.5]).expect("a ledge");
    assert!((near.x - 12.0).abs() < 0.8 && (far.x - 12.0).abs() < 0.3, "{near} {far}");
    assert_eq!(far.y - near.y, 1.5);
    let flat = map(&[slab(0.0, 24.0, 0.0)]);
    assert_eq!(rims(&flat, &body, [at(4.0, 8.0), at(20.0, 8.0)]), None);
    let wall = map(&[slab(0.0, 24.0, 0.0), wall(0.0, 24.0)]);
    assert_eq!(rims(&wall, &body, [at(4.0, 8.0), at(20.0, 8.0)]), None, "no body jumps over a wall of 10 m");
}
