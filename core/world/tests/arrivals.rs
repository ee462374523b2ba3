//! When a body has arrived: by touch, in passing, and standing.

use crate::stage::{NPC, STAND, run};
use std::sync::Arc;
use surefoot_world::arrival::lines_to_goal;
use surefoot_world::character::Support;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Mover, MoverKind, MoverStop, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{
    Arrival, Body, CharacterProfile, End, Map, MoverId, MoverOrder, StopIdx, TaskConfig, Vec3, World,
};

const GROUND: f32 = 1.0;
const RADIUS_M: f32 = 1.0;

fn at(x: f32, height: f32, z: f32) -> Vec3 {
    Vec3::new(x, GROUND + height, z)
}

fn boxed(low: Vec3, high: Vec3) -> Vec<Triangle> {
    cuboid(low, high).into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
}

/// A floor with a wall of 10 cm at x = 10 m, a platform of 80 cm at x = 20 m, a gap of 50 cm at x = 30 m and
/// stairs of four steps of 10 cm at x = 35 m.
fn map() -> Map {
    let slab = |from: f32, to: f32| boxed(at(from, -1.0, 0.0), at(to, 0.0, 20.0));
    let stairs =
        (0..4u8).map(f32::from).map(|step| boxed(at(35.0 + 0.3 * step, 0.0, 0.0), at(37.0, 0.1 * (step + 1.0), 20.0)));
    let parts = [
        slab(0.0, 30.0),
        slab(30.5, 40.0),
        boxed(at(10.0, 0.0, 0.0), at(10.1, 3.0, 15.0)),
        boxed(at(20.0, 0.0, 0.0), at(24.0, 0.8, 20.0)),
    ];
    let triangles = parts.into_iter().chain(stairs).flatten().collect();
    Map::from_parts(MapSize { width: 40, height: 20, depth: 20 }, triangles, Placed::default())
}

fn world(map: Map) -> World {
    World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default())
}

/// Whether a body that has come to rest at `feet` has arrived at `goal`, by each rule.
fn arrivals(world: &mut World, feet: Vec3, goal: Vec3) -> [bool; 3] {
    world.clear();
    world.spawn(feet, 0.0);
    run(world, STAND, 3);
    [Arrival::Touch, Arrival::Pass, Arrival::Stand].map(|arrival| world.has_arrived(NPC, goal, RADIUS_M, arrival))
}

#[test]
fn a_body_has_arrived_where_it_stands_and_could_walk_to_the_goal() {
    let mut world = world(map());
    let cases = [
        ("beside the goal", at(5.0, 0.0, 5.0), at(5.9, 0.0, 5.0), [true, true, true]),
        ("at the goal", at(5.0, 0.0, 5.0), at(5.0, 0.0, 5.0), [true, true, true]),
        ("too far", at(5.0, 0.0, 5.0), at(6.2, 0.0, 5.0), [false, false, false]),
        ("behind the wall", at(9.55, 0.0, 5.0), at(10.5, 0.0, 5.0), [true, false, false]),
        ("beyond the end of the wall", at(9.55, 0.0, 17.0), at(10.5, 0.0, 17.0), [true, true, true]),
        ("below a platform", at(19.55, 0.0, 5.0), at(20.05, 0.8, 5.0), [true, true, false]),
        ("beyond a gap", at(29.9, 0.0, 5.0), at(30.7, 0.0, 5.0), [true, true, false]),
        ("below stairs", at(34.8, 0.0, 5.0), at(35.7, 0.3, 5.0), [true, true, true]),
        ("above a goal in the ground", at(5.0, 0.0, 5.0), at(5.0, -0.9, 5.0), [true, false, false]),
    ];
    for (case, feet, goal, expected) in cases {
        assert_eq!(arrivals(&mut world, feet, goal), expected, "{case}");
    }
}

#[test]
fn rays_of_a_game_find_the_same_arrivals_but_over_gaps() {
    let map = map();
    let cases = [
        ("beside the goal", at(5.0, 0.0, 5.0), at(5.9, 0.0, 5.0), true),
        ("at the goal", at(5.0, 0.0, 5.0), at(5.0, 0.0, 5.0), true),
        ("too far", at(5.0, 0.0, 5.0), at(6.2, 0.0, 5.0), false),
        ("behind the wall", at(9.55, 0.0, 5.0), at(10.5, 0.0, 5.0), false),
        ("below a platform", at(19.55, 0.0, 5.0), at(20.05, 0.8, 5.0), false),
        ("beyond a gap", at(29.9, 0.0, 5.0), at(30.7, 0.0, 5.0), true),
        ("below stairs", at(34.8, 0.0, 5.0), at(35.7, 0.3, 5.0), true),
        ("below a goal in the air", at(5.0, 0.0, 5.0), at(5.0, 0.55, 5.0), true),
        ("above a goal in the ground", at(5.0, 0.0, 5.0), at(5.0, -0.9, 5.0), false),
    ];
    for (case, feet, goal, expected) in cases {
        let mut body = Body::at(feet, 0.0);
        let profile = CharacterProfile::default();
        assert_eq!(lines_to_goal(&profile, &body, goal, RADIUS_M), None, "{case}, in the air");
        body.support = Support::Ground;
        let has_arrived = lines_to_goal(&profile, &body, goal, RADIUS_M).is_some_and(|lines| {
            lines.iter().all(|line| map.mesh().cast_ray(line.from, line.direction, line.length).is_none())
        });
        assert_eq!(has_arrived, expected, "{case}");
    }
}

#[test]
fn a_body_in_flight_passes_a_waypoint_but_does_not_arrive_at_a_goal_until_it_stands() {
    let mut world = world(map());
    let goal = at(5.0, 0.0, 5.0);
    let ends = [Arrival::Touch, Arrival::Pass, Arrival::Stand].map(|arrival| {
        world.clear();
        world.spawn(goal + Vec3::Y * 0.95, 0.0);
        world.head_for(NPC, goal, arrival);
        world.tick();
        let in_flight = world.npc(NPC).unwrap().episode.unwrap().end;
        run(&mut world, STAND, 6);
        (in_flight, world.npc(NPC).unwrap().episode.unwrap().end)
    });
    let reached = Some(End::Reached);
    assert_eq!(ends, [(reached, reached), (reached, reached), (None, reached)]);
}

#[test]
fn a_closed_door_lies_between_and_a_lift_is_ground() {
    let here = MoverStop { offset: Vec3::ZERO, yaw: 0.0, is_there: true };
    let mover = |name: &str, kind, (low, high), offset| Mover {
        name: name.to_owned(),
        kind,
        triangles: cuboid(low, high),
        pivot: low,
        stops: vec![here, MoverStop { offset, ..here }],
        start: StopIdx(0),
        travel_s: 0.5,
        dwell_s: 1.0,
        cycles: false,
        belt: Vec3::ZERO,
    };
    let door = mover("door", MoverKind::Door, (at(8.0, 0.0, 0.0), at(8.1, 3.0, 20.0)), Vec3::Y * 4.0);
    let lift = mover("lift", MoverKind::Lift, (at(14.0, 3.8, 4.0), at(17.0, 4.0, 7.0)), Vec3::Y * -2.0);
    let mut world = world(map().with_movers(vec![door, lift]).unwrap());
    let (before, behind) = (at(7.5, 0.0, 5.0), at(8.4, 0.0, 5.0));
    assert_eq!(arrivals(&mut world, before, behind), [true, false, false], "a closed door");
    assert_eq!(arrivals(&mut world, at(15.0, 4.0, 5.0), at(15.8, 4.0, 5.0)), [true, true, true], "on the lift");
    assert!(world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1))));
    run(&mut world, STAND, 6);
    assert_eq!(arrivals(&mut world, before, behind), [true, true, true], "an open door");
}
