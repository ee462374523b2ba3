//! Crates: who moves them, where they end up, and that nothing of it depends on how a world came to its state.

use crate::stage::{FORWARD, STAND, feet, run};
use std::sync::Arc;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Mover, MoverKind, MoverStop, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::player::{Player, PlayerContact};
use surefoot_world::replay::Recording;
use surefoot_world::{Action, CharacterProfile, Map, MoverId, MoverOrder, NpcSlot, StopIdx, TaskConfig, Vec3, World};

/// Height of the table on which all begins, 20 m long, m, and of the floor around it.
const TABLE: f32 = 5.0;
const FLOOR: f32 = 1.0;

fn mover(name: &str, kind: MoverKind, low: Vec3, size: Vec3) -> Mover {
    Mover {
        name: name.to_owned(),
        kind,
        triangles: cuboid(low, low + size),
        pivot: low + size * Vec3::new(0.5, 0.0, 0.5),
        stops: vec![MoverStop { offset: Vec3::ZERO, yaw: 0.0, is_there: true }],
        start: StopIdx(0),
        travel_s: 2.0,
        dwell_s: 1.0,
        cycles: false,
        belt: Vec3::ZERO,
    }
}

/// A crate whose side is `side` metres, with the middle of its bottom at (`x`, `z`) on the table.
fn crate_at(name: &str, x: f32, z: f32, side: f32) -> Mover {
    mover(name, MoverKind::Crate, Vec3::new(x - 0.5 * side, TABLE, z - 0.5 * side), Vec3::splat(side))
}

fn world(movers: Vec<Mover>) -> World {
    let floor = cuboid(Vec3::new(0.0, 0.0, 0.0), Vec3::new(40.0, FLOOR, 40.0));
    let table = cuboid(Vec3::new(10.0, FLOOR, 5.0), Vec3::new(30.0, TABLE, 25.0));
    let triangles = floor.into_iter().chain(table).filter_map(|corners| Triangle::new(corners, Surface::Ground));
    let map = Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, triangles.collect(), Placed::default());
    let map = Arc::new(map.with_movers(movers).expect("valid movers"));
    World::new(map, CharacterProfile::default(), TaskConfig::default())
}

/// How far a crate lies from where it began, m.
fn shift(world: &World, idx: usize) -> Vec3 {
    world.movers()[idx].crate_state.expect("a crate").offset
}

#[test]
fn a_body_pushes_a_crate_before_it_at_half_its_speed_and_no_further_than_it_walks() {
    let mut world = world(vec![crate_at("it", 20.0, 10.0, 1.0)]);
    world.spawn(Vec3::new(20.0, TABLE, 7.0), 0.0);
    run(&mut world, STAND, 6);
    assert!(shift(&world, 0).length() < 0.02, "it lies still: {}", shift(&world, 0));
    run(&mut world, FORWARD, 20);
    let (pushed, npc) = (shift(&world, 0), feet(&world));
    assert!(pushed.z > 3.0 && pushed.x.abs() < 0.3 && pushed.y.abs() < 0.05, "{pushed}");
    let radius = CharacterProfile::default().radius;
    let gap = 10.0 - 0.5 + pushed.z - (npc.z + radius);
    assert!((-0.02..0.3).contains(&gap), "the body is right behind it: {gap}");
    let speed = world.movers()[0].crate_state.expect("a crate").velocity.z;
    assert!((0.3..0.6).contains(&(speed / CharacterProfile::default().forward_speed)), "{speed}");
    run(&mut world, STAND, 20);
    let rest = shift(&world, 0);
    run(&mut world, STAND, 20);
    assert_eq!(shift(&world, 0), rest, "it sleeps");
    assert!(rest.z - pushed.z < 2.5, "friction stops it");
}

#[test]
fn one_body_does_not_move_what_is_too_heavy_and_two_do() {
    let heavy = || world(vec![crate_at("it", 20.0, 10.0, 1.5)]);
    let places = [Vec3::new(19.6, TABLE, 8.6), Vec3::new(20.4, TABLE, 8.6)];
    let push = |count: usize| {
        let mut world = heavy();
        places[..count].iter().for_each(|place| _ = world.spawn(*place, 0.0));
        for _ in 0..30 {
            (0..count as u32).for_each(|slot| world.decide(NpcSlot(slot), FORWARD));
            world.tick_decision();
        }
        shift(&world, 0).z
    };
    let (one, two) = (push(1), push(2));
    assert!(one.abs() < 0.1, "{one}");
    assert!(two > 1.0, "{two}");
}

#[test]
fn a_crate_falls_off_a_table_lands_level_and_carries_who_stands_on_it() {
    let mut world = world(vec![crate_at("it", 20.0, 23.0, 1.0)]);
    world.spawn(Vec3::new(20.0, TABLE, 21.5), 0.0);
    run(&mut world, FORWARD, 14);
    run(&mut world, Action { forward: -1.0, ..STAND }, 4);
    run(&mut world, STAND, 12);
    let fallen = shift(&world, 0);
    assert!((fallen.y - (FLOOR - TABLE)).abs() < 0.05, "{fallen}");
    let top = Vec3::new(20.0, FLOOR + 1.0, 23.0) + Vec3::new(fallen.x, 0.0, fallen.z);
    let rider = world.spawn(top + Vec3::Y * 0.1, 0.0);
    run(&mut world, STAND, 4);
    let body = &world.npc(rider).expect("the rider").body;
    assert!(body.is_grounded() && (body.feet.y - top.y).abs() < 0.05, "{}", body.feet);
}

#[test]
fn a_crate_rides_on_a_lift() {
    let mut lift = mover("lift", MoverKind::Lift, Vec3::new(18.0, TABLE, 8.0), Vec3::new(4.0, 0.2, 4.0));
    lift.stops.push(MoverStop { offset: Vec3::Y * 6.0, ..lift.stops[0] });
    let mut load = crate_at("load", 20.0, 10.0, 1.0);
    load.triangles.iter_mut().flatten().for_each(|corner| corner.y += 0.2);
    let mut world = world(vec![lift, load]);
    world.spawn(Vec3::new(14.0, TABLE, 10.0), 0.0);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(1)));
    run(&mut world, STAND, 30);
    assert_eq!(world.movers()[0].at(), Some(StopIdx(1)));
    assert!((shift(&world, 1).y - 6.0).abs() < 0.05, "{}", shift(&world, 1));
}

#[test]
fn crates_stack_and_what_rests_on_one_falls_when_it_is_pushed_away() {
    let mut upper = crate_at("upper", 20.0, 10.0, 0.8);
    upper.triangles.iter_mut().flatten().for_each(|corner| corner.y += 1.0);
    let mut world = world(vec![crate_at("lower", 20.0, 10.0, 1.0), upper]);
    world.spawn(Vec3::new(14.0, TABLE, 10.0), 0.0);
    run(&mut world, STAND, 30);
    assert!(shift(&world, 1).length() < 0.05, "it rests on the other: {}", shift(&world, 1));
    let mut player = Player {
        feet: Vec3::new(18.9, TABLE, 10.0),
        velocity: Vec3::X * 4.0,
        radius: 0.4,
        height: 0.9,
        contact: PlayerContact::Block,
    };
    let slot = world.spawn_player(player);
    for _ in 0..90 {
        player.feet.x += 2.0 / 60.0;
        world.move_player(slot, player.feet, player.velocity);
        world.tick();
    }
    assert!(shift(&world, 0).x > 1.0, "the player pushes: {}", shift(&world, 0));
    assert!(shift(&world, 1).y > -0.1 || shift(&world, 1).y < -0.9, "on the other or on the table");
}

#[test]
fn a_crate_that_is_held_stays_and_one_that_is_told_so_goes_back() {
    let mut world = world(vec![crate_at("it", 20.0, 10.0, 1.0)]);
    world.spawn(Vec3::new(20.0, TABLE, 8.5), 0.0);
    world.order(MoverId(0), MoverOrder::Pace(0.0));
    run(&mut world, FORWARD, 12);
    assert_eq!(shift(&world, 0), Vec3::ZERO);
    world.order(MoverId(0), MoverOrder::Pace(1.0));
    run(&mut world, FORWARD, 12);
    assert!(shift(&world, 0).z > 1.0);
    assert_eq!(world.movers()[0].at(), None, "who relies on it at its place must know");
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(0)));
    assert_eq!((world.movers()[0].at(), shift(&world, 0)), (Some(StopIdx(0)), Vec3::ZERO));
}

#[test]
fn a_crate_that_leaves_the_map_is_gone_until_it_is_called_back() {
    let mut edge = crate_at("it", 20.0, 39.0, 1.0);
    edge.triangles.iter_mut().flatten().for_each(|corner| corner.y += FLOOR - TABLE);
    let mut world = world(vec![edge]);
    world.spawn(Vec3::new(20.0, FLOOR, 37.5), 0.0);
    run(&mut world, FORWARD, 14);
    assert!(!world.movers()[0].crate_state.expect("a crate").is_there);
    run(&mut world, Action { forward: -1.0, ..STAND }, 8);
    world.order(MoverId(0), MoverOrder::GoTo(StopIdx(0)));
    run(&mut world, STAND, 5);
    assert!(world.movers()[0].crate_state.expect("a crate").is_there);
}

#[test]
fn nobody_is_crushed_between_a_crate_and_a_wall() {
    let wall = mover("wall", MoverKind::Conveyor, Vec3::new(18.0, TABLE, 12.0), Vec3::new(4.0, 4.0, 0.5));
    let mut world = world(vec![crate_at("it", 20.0, 10.0, 1.0), wall]);
    world.spawn(Vec3::new(20.0, TABLE, 8.6), 0.0);
    let between = world.spawn(Vec3::new(20.0, TABLE, 11.4), 0.0);
    run(&mut world, FORWARD, 40);
    let radius = CharacterProfile::default().radius;
    let body = &world.npc(between).expect("the one between").body;
    assert!(body.feet.z + radius < 12.05, "{}", body.feet);
    let front = 10.5 + shift(&world, 0).z;
    assert!(body.feet.z - radius > front - 0.1 || (body.feet.x - 20.0).abs() > 0.7, "{} {front}", body.feet);
}

/// Three crates, one on another, and three NPCs that push them about.
fn busy() -> World {
    let mut upper = crate_at("c", 20.0, 10.0, 0.7);
    upper.triangles.iter_mut().flatten().for_each(|corner| corner.y += 1.0);
    let mut world = world(vec![crate_at("a", 20.0, 10.0, 1.0), crate_at("b", 21.2, 12.0, 0.8), upper]);
    for (x, z) in [(20.0, 8.0), (21.2, 10.6), (18.0, 11.0)] {
        world.spawn(Vec3::new(x, TABLE, z), 0.0);
    }
    world
}

fn wander(world: &mut World, decisions: std::ops::Range<u32>) {
    for decision in decisions {
        for slot in (0..3).map(NpcSlot) {
            let turn = (((decision * 5 + slot.0 * 3) % 7) as f32 / 3.0 - 1.0) * 0.4;
            world.decide(slot, Action { forward: 0.9, strafe: 0.0, turn, jump: -1.0 });
        }
        world.tick_decision();
    }
}

#[test]
fn equal_inputs_give_equal_bits_also_from_a_state_that_was_restored_or_recorded() {
    let (mut one, mut other) = (busy(), busy());
    one.start_recording();
    wander(&mut one, 0..120);
    wander(&mut other, 0..50);
    let state = other.save();
    let mut restored = busy();
    restored.restore(state);
    wander(&mut restored, 50..120);
    assert_eq!(one.save().hash(), restored.save().hash());
    let shifts = [0, 1, 2].map(|idx| shift(&one, idx));
    assert!(shifts.iter().all(|shift| shift.length() > 0.05), "all were pushed: {shifts:?}");
    let recording = one.finish_recording().expect("it records");
    let read = Recording::decode(&recording.encode()).expect("what was just written");
    assert_eq!(read.replay(one.map().clone(), None).expect("the same bits").hash(), one.save().hash());
}

#[test]
fn states_that_no_crate_can_have_are_refused() {
    let world = world(vec![crate_at("it", 20.0, 10.0, 1.0)]);
    let states = world.movers().to_vec();
    let packed = surefoot_world::MoverState::pack(&states);
    assert_eq!(surefoot_world::MoverState::unpack(&packed, world.map()), Some(states.clone()));
    let spoil = |change: fn(&mut surefoot_world::CrateState)| {
        let mut spoilt = states.clone();
        change(spoilt[0].crate_state.as_mut().expect("a crate"));
        surefoot_world::MoverState::unpack(&surefoot_world::MoverState::pack(&spoilt), world.map())
    };
    assert_eq!(spoil(|it| it.offset.x = f32::NAN), None);
    assert_eq!(spoil(|it| it.velocity.y = f32::INFINITY), None);
    assert_eq!(spoil(|it| it.spin = 1.0e9), None);
    assert_eq!(spoil(|it| it.yaw = f32::NAN), None);
    let mut none = states;
    none[0].crate_state = None;
    assert_eq!(surefoot_world::MoverState::unpack(&surefoot_world::MoverState::pack(&none), world.map()), None);
}
