//! Doors, lifts, floors that vanish and conveyors: what levels say of them, how they move, and what they do to bodies
//! and rays.

use crate::stage::{FORWARD, NPC, STAND, feet, run};
use std::sync::Arc;
use surefoot_levels::{ImportOptions, NoFiles};
use surefoot_world::character::{Body, Support};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Mover, MoverKind, MoverStop, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::Reach;
use surefoot_world::{
    Action, CharacterProfile, Map, MoverId, MoverOrder, MoverState, NpcSlot, StopIdx, StopSet, TaskConfig, Tick, Vec3,
    World,
};

const GROUND: f32 = 1.0;

/// A floor of 40 x 40 m.
fn floor() -> Vec<Triangle> {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 40.0], [40.0, 40.0], [40.0, 0.0]].map(|[x, z]| Vec3::new(x, GROUND, z));
    [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
}

fn mover(kind: MoverKind, low: Vec3, high: Vec3, offsets: &[Vec3]) -> Mover {
    let here = MoverStop { offset: Vec3::ZERO, yaw: 0.0, is_there: true };
    let stops = offsets.iter().map(|offset| MoverStop { offset: *offset, ..here });
    Mover {
        name: "it".to_owned(),
        kind,
        triangles: cuboid(low, high),
        pivot: low,
        stops: std::iter::once(here).chain(stops).collect(),
        start: StopIdx(0),
        travel_s: 2.0,
        dwell_s: 1.0,
        cycles: false,
        belt: Vec3::ZERO,
    }
}

fn world(movers: Vec<Mover>) -> World {
    let map = Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, floor(), Placed::default());
    let map = map.with_movers(movers).expect("valid movers");
    World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default())
}

/// A wall across the way at z = 20 m, as a gate that goes up.
fn door() -> Mover {
    mover(MoverKind::Door, Vec3::new(0.0, GROUND, 20.0), Vec3::new(40.0, 13.0, 20.2), &[Vec3::Y * 12.0])
}

#[test]
fn a_closed_door_stops_a_body_and_rays_and_an_open_one_does_neither() {
    let mut world = world(vec![door()]);
    world.spawn(Vec3::new(15.0, GROUND, 17.0), 0.0);
    let nearest = |world: &World| {
        let sight = world.sight(NPC);
        sight.ends.iter().filter(|(end, _)| (end.x - 15.0).abs() < 14.0).map(|(end, _)| end.z).fold(0.0, f32::max)
    };
    assert!(nearest(&world) < 20.01, "no ray passes the door");
    run(&mut world, FORWARD, 12);
    assert!((19.4..19.8).contains(&feet(&world).z), "{}", feet(&world));
    assert!(world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1))));
    run(&mut world, STAND, 13);
    assert_eq!(world.movers()[0].at(), Some(StopIdx(1)));
    assert!(nearest(&world) > 25.0);
    run(&mut world, FORWARD, 12);
    assert!(feet(&world).z > 25.0);
}

#[test]
fn a_door_does_not_crush_who_stands_in_it_and_goes_on_once_they_are_gone() {
    let (low, high) = (Vec3::new(10.0, GROUND, 19.0), Vec3::new(20.0, 5.0, 21.0));
    let mut door = mover(MoverKind::Door, low, high, &[Vec3::X * 10.0]);
    door.start = StopIdx(1);
    // The body cannot be pushed out of the way: the door closes against a post.
    let post = cuboid(Vec3::new(9.0, GROUND, 19.0), Vec3::new(10.1, 5.0, 21.0));
    let triangles: Vec<Triangle> =
        floor().into_iter().chain(post.into_iter().filter_map(|it| Triangle::new(it, Surface::Ground))).collect();
    let map = Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, triangles, Placed::default());
    let map = Arc::new(map.with_movers(vec![door]).unwrap());
    let mut world = World::new(map, CharacterProfile::default(), TaskConfig::default());
    world.spawn(Vec3::new(10.6, GROUND, 20.1), 0.0);
    assert!(world.order(MoverId(0), MoverOrder::GoTo(StopIdx(0))));
    run(&mut world, STAND, 20);
    let state = world.movers()[0];
    assert!(state.at().is_none() && state.blocked > 10, "{state:?}");
    assert!(world.npc(NPC).unwrap().harm.is_none());
    assert!((feet(&world) - Vec3::new(10.6, GROUND, 20.1)).length() < 0.3, "{}", feet(&world));
    run(&mut world, FORWARD, 15);
    assert_eq!(world.movers()[0].at(), Some(StopIdx(0)));
}

#[test]
fn a_door_that_is_told_otherwise_turns_round_on_the_way() {
    let mut world = world(vec![door()]);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1)));
    (0..30).for_each(|_| world.tick());
    let opening = world.movers()[0];
    assert!((opening.progress - 0.25).abs() < 1.0e-4, "{opening:?}");
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(0)));
    (0..29).for_each(|_| world.tick());
    assert_eq!(world.movers()[0].at(), None);
    (0..2).for_each(|_| world.tick());
    assert_eq!(world.movers()[0].at(), Some(StopIdx(0)));
}

#[test]
fn a_lift_carries_a_body_up_and_down_again() {
    let mut lift = mover(
        MoverKind::Lift,
        Vec3::new(14.0, GROUND - 0.1, 14.0),
        Vec3::new(17.0, GROUND + 0.1, 17.0),
        &[Vec3::new(0.0, 6.0, 0.0)],
    );
    lift.cycles = true;
    let mut world = world(vec![lift]);
    world.spawn(Vec3::new(15.5, GROUND + 0.1, 15.5), 0.0);
    let mut heights = Vec::new();
    for _ in 0..37 {
        run(&mut world, STAND, 1);
        heights.push(feet(&world).y - GROUND);
        assert!(world.npc(NPC).unwrap().body.is_grounded());
    }
    // A second below, two up, one above, two down.
    assert!(heights[4].abs() < 0.2, "{heights:?}");
    assert!((heights[12] - 3.6).abs() < 0.2, "{heights:?}");
    assert!((heights[20] - 6.1).abs() < 0.05, "{heights:?}");
    assert!(heights[36].abs() < 0.2, "{heights:?}");
    let aside = feet(&world) - Vec3::new(15.5, GROUND, 15.5);
    assert!(Vec3::new(aside.x, 0.0, aside.z).length() < 0.01, "{aside}");
}

#[test]
fn who_jumps_off_a_platform_keeps_its_speed() {
    let low = Vec3::new(14.0, GROUND, 4.0);
    let platform = mover(MoverKind::Platform, low, low + Vec3::new(3.0, 0.2, 3.0), &[Vec3::new(0.0, 0.0, 10.0)]);
    let mut world = world(vec![platform]);
    world.spawn(Vec3::new(15.5, GROUND + 0.2, 5.5), 0.0);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1)));
    run(&mut world, STAND, 4);
    let (before, grounded) = (feet(&world), world.npc(NPC).unwrap().body.is_grounded());
    assert!(grounded && (before.z - 5.5 - 5.0 * 40.0 / 60.0).abs() < 0.2, "carried: {before}");
    world.decide(NPC, Action { jump: 1.0, ..STAND });
    world.tick();
    let velocity = world.npc(NPC).unwrap().body.velocity;
    assert!((velocity.z - 5.0).abs() < 0.1 && velocity.y > 9.0, "{velocity}");
}

#[test]
fn a_floor_that_vanishes_drops_who_stands_on_it_and_waits_until_its_place_is_free() {
    let low = Vec3::new(14.0, 6.0, 14.0);
    let mut floor = mover(MoverKind::Floor, low, low + Vec3::new(3.0, 0.3, 3.0), &[Vec3::ZERO]);
    floor.stops[1].is_there = false;
    let mut world = world(vec![floor]);
    world.spawn(Vec3::new(15.5, 6.3, 15.5), 0.0);
    run(&mut world, STAND, 5);
    assert!((feet(&world).y - 6.3).abs() < 0.01);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1)));
    run(&mut world, STAND, 11);
    assert!((feet(&world).y - 6.3).abs() < 0.01, "it is there until it is gone");
    run(&mut world, STAND, 15);
    assert!((feet(&world).y - GROUND).abs() < 0.05);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(0)));
    run(&mut world, STAND, 14);
    let sky = world.sight(NPC).ends.iter().map(|(end, _)| end.y).fold(0.0, f32::max);
    assert!(sky > 10.0 && world.movers()[0].at() == Some(StopIdx(0)));
}

#[test]
fn a_conveyor_carries_what_stands_on_it_and_stops_with_its_pace() {
    let low = Vec3::new(10.0, GROUND, 4.0);
    let mut belt = mover(MoverKind::Conveyor, low, low + Vec3::new(4.0, 0.1, 30.0), &[]);
    belt.belt = Vec3::new(0.0, 0.0, 3.0);
    let mut world = world(vec![belt]);
    world.spawn(Vec3::new(12.0, GROUND + 0.1, 6.0), 0.0);
    run(&mut world, STAND, 12);
    assert!((feet(&world).z - 12.0).abs() < 0.2, "{}", feet(&world));
    assert!(world.order(MoverId(0), MoverOrder::Pace(0.0)));
    let stopped = feet(&world);
    run(&mut world, STAND, 12);
    assert!(feet(&world).distance(stopped) < 0.1);
}

#[test]
fn a_lift_stops_above_who_stands_under_it() {
    let low = Vec3::new(14.0, 8.0, 14.0);
    let lift = mover(MoverKind::Lift, low, low + Vec3::new(3.0, 0.2, 3.0), &[Vec3::new(0.0, -6.9, 0.0)]);
    let mut world = world(vec![lift]);
    world.spawn(Vec3::new(15.5, GROUND, 15.5), 0.0);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1)));
    run(&mut world, STAND, 30);
    assert!(feet(&world).y > GROUND - 0.1 && world.movers()[0].blocked > 0, "{}", feet(&world));
    run(&mut world, FORWARD, 10);
    run(&mut world, STAND, 10);
    assert_eq!(world.movers()[0].at(), Some(StopIdx(1)));
}

/// A world with one mover of each kind, and four NPCs that move about on them.
fn busy() -> World {
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, GROUND + y, z);
    let mut lift = mover(MoverKind::Lift, at(4.0, -0.1, 4.0), at(7.0, 0.1, 7.0), &[Vec3::Y * 5.0]);
    let mut belt = mover(MoverKind::Conveyor, at(10.0, 0.0, 4.0), at(14.0, 0.1, 20.0), &[]);
    let mut swing = mover(MoverKind::Door, at(20.0, 0.0, 10.0), at(24.0, 3.0, 10.2), &[Vec3::ZERO]);
    let mut floor = mover(MoverKind::Floor, at(28.0, 3.0, 4.0), at(31.0, 3.3, 7.0), &[Vec3::ZERO]);
    (lift.cycles, swing.cycles, floor.cycles) = (true, true, true);
    swing.stops[1].yaw = 1.5;
    floor.stops[1].is_there = false;
    belt.belt = Vec3::new(0.0, 0.0, 2.0);
    for (mover, name) in [&mut lift, &mut belt, &mut swing, &mut floor].into_iter().zip(["a", "b", "c", "d"]) {
        mover.name = name.to_owned();
    }
    let mut world = world(vec![lift, belt, swing, floor]);
    for place in [at(5.5, 0.1, 5.5), at(12.0, 0.1, 6.0), at(22.0, 0.0, 9.0), at(29.5, 3.3, 5.5)] {
        world.spawn(place, 0.4);
    }
    world
}

fn wander(world: &mut World, decisions: std::ops::Range<u32>) {
    for decision in decisions {
        for slot in (0..4).map(NpcSlot) {
            let turn = ((decision * 7 + slot.0 * 3) % 11) as f32 / 5.0 - 1.0;
            world.decide(slot, Action { forward: 0.4, strafe: 0.1, turn, jump: turn - 0.5 });
        }
        if decision % 40 == 20 {
            world.order(MoverId(2), MoverOrder::GoTo(StopIdx((decision / 40 % 2) as u8)));
            world.order(MoverId(0), MoverOrder::Pace(2.0));
        }
        world.tick_decision();
    }
}

#[test]
fn equal_inputs_give_equal_bits_also_from_a_state_that_was_restored_or_recorded() {
    let (mut one, mut other) = (busy(), busy());
    one.start_recording();
    wander(&mut one, 0..150);
    wander(&mut other, 0..70);
    let state = other.save();
    let mut restored = busy();
    restored.restore(state);
    wander(&mut restored, 70..150);
    assert_eq!(one.save().hash(), restored.save().hash());
    assert!(one.movers().iter().zip(busy().movers()).any(|(now, before)| now != before));
    let recording = one.finish_recording().expect("it records");
    let read = surefoot_world::replay::Recording::decode(&recording.encode()).expect("what was just written");
    assert_eq!(read.replay(one.map().clone(), Some(Tick(333))).expect("the same bits").hash(), one.save().hash());
}

#[test]
fn orders_that_no_mover_can_follow_change_nothing() {
    let mut world = busy();
    let before = world.movers().to_vec();
    for (mover, order) in [
        (9, MoverOrder::GoTo(StopIdx(0))),
        (0, MoverOrder::GoTo(StopIdx(2))),
        (1, MoverOrder::Cycle),
        (0, MoverOrder::Pace(-1.0)),
        (0, MoverOrder::Pace(f32::NAN)),
    ] {
        assert!(!world.order(MoverId(mover), order), "{mover} {order:?}");
    }
    assert_eq!(world.movers(), before);
}

#[test]
fn movers_that_cannot_be_are_refused_with_their_names() {
    let place = Vec3::new(4.0, GROUND, 4.0);
    let sound = || mover(MoverKind::Lift, place, place + Vec3::ONE, &[Vec3::Y * 3.0]);
    type Spoil = fn(&mut Mover);
    let cases: [(Spoil, &str); 7] = [
        (|it| it.name.clear(), "needs a name"),
        (|it| it.stops.truncate(1), "2 to 16 stops"),
        (|it| it.start = StopIdx(7), "a start that is one of its stops"),
        (|it| it.stops[1].offset.y = f32::NAN, "out of range"),
        (|it| it.travel_s = -1.0, "out of range"),
        (|it| it.travel_s = 0.01, "at most 10 m/s"),
        (|it| it.triangles.clear(), "no triangle"),
    ];
    for (spoil, expected) in cases {
        let mut spoilt = sound();
        spoil(&mut spoilt);
        let map = Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, floor(), Placed::default());
        let error = map.with_movers(vec![spoilt]).expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    let map = Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, floor(), Placed::default());
    let twice = map.with_movers(vec![sound(), sound()]).unwrap_err().to_string();
    assert!(twice.contains("`it`"), "{twice}");
}

#[test]
fn a_map_with_movers_is_another_map_and_comes_back_from_a_file() {
    let plain = || Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, floor(), Placed::default());
    let moving = plain().with_movers(vec![door()]).unwrap();
    assert_ne!(moving.hash(), plain().hash());
    assert_eq!(plain().with_movers(Vec::new()).unwrap().hash(), plain().hash());
    let back = surefoot_levels::decode(&surefoot_levels::encode(&moving)).expect("what was just saved");
    assert_eq!((back.hash(), back.movers()), (moving.hash(), moving.movers()));
}

/// Vertices and faces of a box as an object of an OBJ file.
fn obj_box(text: &mut String, count: &mut usize, name: &str, low: [f32; 3], high: [f32; 3]) {
    text.push_str(&format!("o {name}\n"));
    for corner in cuboid(low.into(), high.into()).into_iter().flatten() {
        text.push_str(&format!("v {} {} {}\n", corner.x, corner.y, corner.z));
    }
    for face in 0..12 {
        let first = *count + 3 * face + 1;
        text.push_str(&format!("f {} {} {}\n", first, first + 1, first + 2));
    }
    *count += 36;
}

#[test]
fn names_of_nodes_and_the_sidecar_make_movers() {
    let (mut text, mut count) = (String::new(), 0);
    let boxes: [(&str, [f32; 3], [f32; 3]); 7] = [
        ("floor", [-15.0, -1.0, -15.0], [15.0, 0.0, 15.0]),
        ("Door_kitchen", [0.0, 0.0, 5.0], [1.2, 2.2, 5.1]),
        ("door_frame", [-0.2, 0.0, 5.0], [0.0, 2.4, 5.2]),
        ("lift_a", [-8.0, 0.0, -8.0], [-6.0, 0.2, -6.0]),
        ("lift_a:path", [-8.0, 4.0, -8.0], [-6.0, 4.2, -6.0]),
        ("lift_b", [8.0, 0.0, 8.0], [9.0, 0.2, 9.0]),
        ("vanish_1", [4.0, 3.0, -4.0], [6.0, 3.2, -2.0]),
    ];
    for (name, low, high) in boxes {
        obj_box(&mut text, &mut count, name, low, high);
    }
    let sidecar = r#"{"movers": [
        {"name": "belt", "kind": "conveyor", "min": [-5, 0, 0], "max": [-3, 0.2, 6], "velocity": [0, 0, 2]},
        {"name": "gate", "kind": "door", "min": [2, 0, 8], "max": [4, 3, 8.2], "path": [[0, 3, 0]], "seconds": 2,
            "open": true}
    ]}"#;
    let imported =
        surefoot_levels::import_obj(text.as_bytes(), Some(sidecar), &ImportOptions::default()).expect("a level");
    let map = imported.map;
    let origin = map.frame().origin.as_vec3();
    let found: Vec<_> = map.movers().iter().map(|it| (it.name.as_str(), it.kind, it.stops.len(), it.start.0)).collect();
    assert_eq!(
        found,
        [
            ("Door_kitchen", MoverKind::Door, 2, 0),
            ("lift_a", MoverKind::Lift, 2, 0),
            ("vanish_1", MoverKind::Floor, 2, 0),
            ("belt", MoverKind::Conveyor, 1, 0),
            ("gate", MoverKind::Door, 2, 1),
        ]
    );
    let [kitchen, lift, _, belt, gate] = map.movers() else { panic!("five movers") };
    assert!((kitchen.stops[1].offset - Vec3::new(1.152, 0.0, 0.0)).length() < 1.0e-3, "{:?}", kitchen.stops);
    assert!((lift.stops[1].offset - Vec3::Y * 4.0).length() < 1.0e-3 && lift.travel_s == 2.0 && lift.cycles);
    assert_eq!((belt.belt, gate.travel_s), (Vec3::Z * 2.0, 2.0));
    // What is around a door, and a lift that goes nowhere, are solid; the path is not.
    let above = |x: f32, z: f32| {
        let from = Vec3::new(x, 10.0, z) + origin;
        let hit = map.mesh().cast_ray(from, Vec3::new(0.000_31, -0.999_999_9, 0.000_23), 30.0).expect("the floor");
        10.0 - hit.distance
    };
    assert!((above(-0.1, 5.1) - 2.4).abs() < 0.01);
    assert!((above(8.5, 8.5) - 0.2).abs() < 0.01);
    assert!(above(-7.0, -7.0).abs() < 0.01 && above(0.6, 5.05).abs() < 0.01);
    let (low, _) = lift.bounds_at(0);
    assert!((low - origin - Vec3::new(-8.0, 0.0, -8.0)).length() < 1.0e-3, "{low}");
}

#[test]
fn bad_movers_of_a_level_name_what_to_change() {
    let (mut text, mut count) = (String::new(), 0);
    obj_box(&mut text, &mut count, "floor", [-15.0, -1.0, -15.0], [15.0, 0.0, 15.0]);
    let import = |sidecar: &str| {
        surefoot_levels::import_obj(text.as_bytes(), Some(sidecar), &ImportOptions::default())
            .err()
            .map(|it| it.to_string())
    };
    let flat =
        r#"{"movers": [{"name": "a", "kind": "lift", "min": [0, 0, 0], "max": [2, 0, 2], "path": [[0, 3, 0]]}]}"#;
    assert!(import(flat).unwrap().contains("movers[0] of the sidecar"));
    let still = r#"{"movers": [{"name": "a", "kind": "lift", "min": [0, 0, 0], "max": [2, 1, 2]}]}"#;
    assert!(import(still).unwrap().contains("`a` has 1 stops"));
    let kind = r#"{"movers": [{"name": "a", "kind": "boat", "min": [0, 0, 0], "max": [2, 1, 2]}]}"#;
    assert!(import(kind).unwrap().contains("boat"));
}

#[test]
fn two_hundred_movers_only_matter_to_who_is_near() {
    let movers = (0..200).map(|idx| {
        let low = Vec3::new((idx % 20) as f32 * 2.0, 15.0, (idx / 20) as f32 * 4.0);
        let mut it = mover(MoverKind::Lift, low, low + Vec3::new(1.0, 0.2, 1.0), &[Vec3::Y * 4.0]);
        (it.name, it.cycles) = (idx.to_string(), true);
        it
    });
    let (mut with, mut without) = (world(movers.collect()), world(Vec::new()));
    for world in [&mut with, &mut without] {
        world.spawn(Vec3::new(20.0, GROUND, 20.0), 0.0);
        run(world, FORWARD, 15);
    }
    assert_eq!(feet(&with), feet(&without));
    assert_eq!(with.movers().iter().filter(|it: &&MoverState| it.at().is_none()).count(), 200);
}

#[test]
fn an_exported_map_is_imported_with_the_same_movers() {
    let mut swing = mover(MoverKind::Door, Vec3::new(5.0, GROUND, 9.0), Vec3::new(6.0, 3.0, 9.2), &[Vec3::ZERO]);
    (swing.stops[1].yaw, swing.pivot) = (1.5, Vec3::new(5.0, GROUND, 9.1));
    let low = Vec3::new(14.0, GROUND, 14.0);
    let lift = mover(MoverKind::Lift, low, low + Vec3::splat(2.0), &[Vec3::Y * 4.0, Vec3::Y * 8.0]);
    let mut belt = mover(MoverKind::Conveyor, low * 2.0, low * 2.0 + Vec3::splat(2.0), &[]);
    belt.belt = Vec3::X;
    let mut floor = mover(MoverKind::Floor, low * 1.5, low * 1.5 + Vec3::splat(2.0), &[Vec3::ZERO]);
    (floor.stops[1].is_there, floor.cycles) = (false, true);
    let mut gate = door();
    (gate.start, gate.dwell_s) = (StopIdx(1), 2.5);
    let mut movers = vec![swing, lift, belt, floor, gate];
    (0..).zip(&mut movers).for_each(|(idx, mover): (u8, _)| mover.name = format!("it {idx}"));
    let map = world(movers).map().clone();
    let glb = surefoot_levels::export_glb(&map);
    let imported =
        surefoot_levels::import_gltf(&glb, None, &ImportOptions::default(), &NoFiles).expect("what was just exported");
    assert_eq!((imported.map.frame().origin.as_vec3(), imported.map.movers().len()), (Vec3::ZERO, map.movers().len()));
    for (one, other) in map.movers().iter().zip(imported.map.movers()) {
        assert_eq!(
            (&one.name, one.kind, one.stops.len(), one.start, one.travel_s, one.dwell_s, one.cycles, one.belt),
            (
                &other.name,
                other.kind,
                other.stops.len(),
                other.start,
                other.travel_s,
                other.dwell_s,
                other.cycles,
                other.belt
            ),
        );
        for stop in 0..one.stops.len() {
            assert_eq!(one.stops[stop].is_there, other.stops[stop].is_there);
            let (before, after) = (one.bounds_at(stop), other.bounds_at(stop));
            let miss = (before.0 - after.0).length() + (before.1 - after.1).length();
            assert!(miss < 1.0e-3, "{} at stop {stop}: {before:?} and {after:?}", one.name);
        }
    }
}

#[test]
fn a_lift_may_have_sixteen_stops() {
    let low = Vec3::new(14.0, GROUND - 0.1, 14.0);
    let floors: Vec<Vec3> = (1..16).map(|floor| Vec3::Y * floor as f32).collect();
    let lift = mover(MoverKind::Lift, low, low + Vec3::new(3.0, 0.2, 3.0), &floors);
    let mut world = world(vec![lift]);
    world.spawn(Vec3::new(15.5, GROUND + 0.1, 15.5), 0.0);
    assert!(
        world.order(MoverId(0), MoverOrder::GoTo(StopIdx(15)))
            && !world.order(MoverId(0), MoverOrder::GoTo(StopIdx(16)))
    );
    (0..15 * 120 + 15).for_each(|_| world.tick());
    assert_eq!(world.movers()[0].at(), Some(StopIdx(15)));
    assert!((feet(&world).y - 16.1).abs() < 0.01, "{}", feet(&world));
    let npc = world.npc(NPC).unwrap();
    let mut needs = Vec::new();
    let reliance = surefoot_world::reliance::Reliance::on(world.map());
    reliance.find_needs(world.map(), world.movers(), world.profile_of(npc), &npc.body, |mover, stops| {
        needs.push((mover, stops))
    });
    assert_eq!(needs, [(MoverId(0), StopSet::only(StopIdx(15)))]);
}

#[test]
fn a_body_relies_on_the_lift_beneath_it_among_a_hundred() {
    let low = |idx: usize| Vec3::new((idx % 10) as f32 * 4.0, GROUND + 0.2, (idx / 10) as f32 * 4.0);
    let lift = |idx: usize| {
        let up = [Vec3::Y * 8.0];
        Mover { name: format!("lift {idx}"), ..mover(MoverKind::Lift, low(idx), low(idx) + Vec3::splat(2.0), &up) }
    };
    let world = world((0..100).map(lift).collect());
    let reliance = surefoot_world::reliance::Reliance::on(world.map());
    let profile = CharacterProfile::default();
    for idx in 0..100 {
        let aboard = low(idx) + Vec3::new(1.0, 2.0, 1.0);
        let mut noted = Vec::new();
        let mut body = Body::at(aboard, 0.0);
        body.support = Support::Ground;
        reliance.find_needs(world.map(), world.movers(), &profile, &body, |mover, stops| noted.push((mover, stops)));
        assert_eq!(noted, [(MoverId(idx as u16), StopSet::only(StopIdx(0)))]);
        let is_swept = |feet: Vec3| reliance.is_swept(&profile, feet, 0.4);
        assert!(is_swept(aboard + Vec3::Y * 4.0) && is_swept(aboard + Vec3::new(1.6, 4.0, 0.0)), "lift {idx}");
        assert!(!is_swept(aboard + Vec3::Y * 8.0) && !is_swept(aboard + Vec3::new(2.0, 4.0, 2.0)), "lift {idx}");
    }
}

#[test]
fn no_pace_makes_a_mover_so_fast_that_bodies_slip_through() {
    let gate = Vec3::new(0.0, GROUND, 10.0);
    let wall = mover(MoverKind::Door, gate, gate + Vec3::new(40.0, 4.0, 0.3), &[Vec3::Z * 18.0]);
    let mut world = world(vec![wall]);
    world.spawn(Vec3::new(15.0, GROUND, 20.0), 0.0);
    world.order(MoverId(0), MoverOrder::Pace(4.0));
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1)));
    (0..60).for_each(|_| world.tick());
    // 9 m/s at the usual pace, 10 m/s at most.
    assert!((world.movers()[0].progress - 10.0 / 18.0).abs() < 0.01, "{:?}", world.movers()[0]);
    (0..60).for_each(|_| world.tick());
    assert!(feet(&world).z > 28.0, "pushed along: {}", feet(&world));
}

/// A map of boxes, and movers.
fn built(boxes: &[(Vec3, Vec3)], movers: Vec<Mover>) -> Map {
    let faces = boxes.iter().flat_map(|(low, high)| cuboid(*low, *high));
    let triangles = faces.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    let map = Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, triangles, Placed::default());
    map.with_movers(movers).expect("valid movers")
}

/// Share of pairs of places that the survey finds connected.
fn connected(map: &Map) -> f64 {
    Reach::survey(map, &CharacterProfile::default(), 2).share_by(|_| true)
}

#[test]
fn the_survey_rides_lifts() {
    let boxes = [
        (Vec3::new(2.0, 0.0, 2.0), Vec3::new(20.0, GROUND, 38.0)),
        (Vec3::new(20.0, 0.0, 2.0), Vec3::new(38.0, 13.0, 38.0)),
    ];
    let lift = |top: f32| {
        let (low, high) = (Vec3::new(16.5, GROUND, 18.0), Vec3::new(19.5, GROUND + 0.2, 21.0));
        mover(MoverKind::Lift, low, high, &[Vec3::Y * top])
    };
    let without = connected(&built(&boxes, Vec::new()));
    assert!(without < 0.8, "one falls down and does not come up again: {without}");
    assert!(connected(&built(&boxes, vec![lift(11.8)])) > 0.99, "up to the deck");
    assert!((connected(&built(&boxes, vec![lift(6.0)])) - without).abs() < 0.01, "it stops below the deck");
}

#[test]
fn the_survey_walks_over_floors_that_vanish_and_knows_doors_as_open() {
    let banks = [
        (Vec3::new(2.0, 0.0, 2.0), Vec3::new(12.0, 12.0, 38.0)),
        (Vec3::new(28.0, 0.0, 2.0), Vec3::new(38.0, 12.0, 38.0)),
    ];
    let tile = |name: &str, from: f32| {
        let (low, high) = (Vec3::new(from, 11.8, 18.0), Vec3::new(from + 5.3, 12.0, 22.0));
        let mut tile = mover(MoverKind::Floor, low, high, &[Vec3::ZERO]);
        tile.stops[1].is_there = false;
        name.clone_into(&mut tile.name);
        tile
    };
    let tiles = |count: usize| ["a", "b", "c"].into_iter().zip([12.0, 17.3, 22.7]).take(count);
    let map = |count: usize| built(&banks, tiles(count).map(|(name, from)| tile(name, from)).collect());
    assert!(connected(&map(3)) > 0.99);
    assert!(connected(&map(2)) < 0.6, "the third one is missing");
    let door = mover(MoverKind::Door, Vec3::new(12.0, 12.0, 2.0), Vec3::new(12.2, 16.0, 38.0), &[Vec3::Y * 4.0]);
    let mut movers: Vec<Mover> = tiles(3).map(|(name, from)| tile(name, from)).collect();
    movers.push(door);
    assert!(connected(&built(&banks, movers)) > 0.99);
}
