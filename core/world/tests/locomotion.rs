//! How bodies move, as animations need it.

use crate::stage::{FORWARD, NPC, STAND};
use std::sync::Arc;
use surefoot_world::character::bodies::BODIES;
use surefoot_world::character::{Ride, Support};
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{
    Ability, AbilitySet, Action, Body, CharacterProfile, Locomotion, Map, MovePhase, Pace, TakeOff, TaskConfig,
    Trajectory, Vec3, World,
};

const GROUND: f32 = 10.0;

/// A world with an NPC on a floor of 400 x 400 m.
fn world() -> World {
    let [a, b, c, d] = [(0.0, 0.0), (0.0, 400.0), (400.0, 400.0), (400.0, 0.0)].map(|(x, z)| Vec3::new(x, GROUND, z));
    let floor = [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground));
    let map = Map::from_parts(MapSize { width: 400, height: 80, depth: 400 }, floor.collect(), Placed::default());
    let mut world = World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default());
    world.spawn(Vec3::new(200.0, GROUND, 10.0), 0.0);
    world
}

/// Lets the NPC act for some decisions, and returns its states, tick by tick.
fn follow(world: &mut World, locomotion: &mut Locomotion, action: Action, decisions: u32) -> Vec<Locomotion> {
    let mut states = Vec::new();
    for _ in 0..decisions {
        world.decide(NPC, action);
        for _ in 0..10 {
            world.tick();
            let npc = world.npc(NPC).unwrap();
            locomotion.advance(&npc.body, world.profile_of(npc), &npc.action, world.used_in_tick(NPC));
            states.push(*locomotion);
        }
    }
    states
}

/// The different values, in order.
fn sequence<T: PartialEq>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut values: Vec<T> = values.into_iter().collect();
    values.dedup();
    values
}

#[test]
fn a_body_stands_turns_walks_runs_and_stops() {
    let (mut world, mut locomotion) = (world(), Locomotion::default());
    follow(&mut world, &mut locomotion, STAND, 3);
    let mut paces = |action, decisions| {
        sequence(follow(&mut world, &mut locomotion, action, decisions).iter().map(|state| state.pace))
    };
    assert_eq!(paces(STAND, 2), [Pace::Idle]);
    assert_eq!(paces(Action { turn: 0.5, ..STAND }, 2), [Pace::Turn]);
    assert_eq!(paces(Action { forward: 0.15, ..STAND }, 4), [Pace::Walk]);
    assert_eq!(paces(FORWARD, 4), [Pace::Run]);
    assert_eq!(paces(STAND, 4), [Pace::Stop, Pace::Idle]);
}

#[test]
fn a_jump_has_a_flight_and_a_landing_and_one_in_the_air_another_ability() {
    let (mut world, mut locomotion) = (world(), Locomotion::default());
    follow(&mut world, &mut locomotion, STAND, 3);
    let mut states = follow(&mut world, &mut locomotion, Action { jump: 1.0, ..FORWARD }, 3);
    states.extend(follow(&mut world, &mut locomotion, FORWARD, 12));
    let phases = sequence(states.iter().map(|state| (state.phase, state.ability)));
    let flight = Some(MovePhase::Flight);
    let expected = [
        (flight, Ability::JUMP),
        (flight, Ability::DOUBLE_JUMP),
        (Some(MovePhase::Landing), Ability::DOUBLE_JUMP),
        (None, Ability::WALK),
    ];
    assert_eq!(phases, expected);
    assert_eq!(states.iter().filter(|state| state.has_landed()).count(), 1);
    let landing = states.iter().filter(|state| state.phase == Some(MovePhase::Landing)).count();
    assert_eq!(landing, 13, "the tick in which it lands, and 0.2 s");
}

#[test]
fn strides_are_as_long_as_those_of_people_and_their_phase_follows_the_way() {
    let (mut world, mut locomotion) = (world(), Locomotion::default());
    let walk = Action { forward: 0.127, ..STAND };
    follow(&mut world, &mut locomotion, walk, 12);
    let (before, from) = (locomotion, world.npc(NPC).unwrap().body.feet.z);
    assert!((before.stride_m - 1.35).abs() < 0.15, "{} m at 1.4 m/s", before.stride_m);
    let states = follow(&mut world, &mut locomotion, walk, 60);
    let strides = states.windows(2).filter(|pair| pair[1].stride_phase < pair[0].stride_phase).count();
    let way = world.npc(NPC).unwrap().body.feet.z - from;
    assert!((strides as f32 - way / before.stride_m).abs() <= 1.0, "{strides} strides over {way} m");
    let states = follow(&mut world, &mut locomotion, FORWARD, 12);
    let longest = states.iter().map(|state| state.stride_m).fold(0.0, f32::max);
    assert!((longest - 4.7).abs() < 0.3, "{longest} m at 11 m/s");
}

#[test]
fn all_bodies_begin_to_run_at_the_same_froude_number() {
    for named in BODIES {
        let profile = named.profile();
        let pace_at = |froude: f32| {
            let speed = (froude * 9.81 * 0.53 * profile.height).sqrt();
            let velocity = Vec3::new(0.0, 0.0, speed);
            let mut body = Body::default();
            (body.support, body.velocity) = (Support::Ground, velocity);
            let mut locomotion = Locomotion::default();
            locomotion.advance(&body, &profile, &FORWARD, AbilitySet::default());
            locomotion.pace
        };
        assert_eq!([0.004, 0.4, 0.6].map(pace_at), [Pace::Idle, Pace::Walk, Pace::Run], "{}", named.name);
    }
}

#[test]
fn a_body_winds_up_before_it_leaves_the_ground() {
    let take_off = Some(TakeOff { ticks: 50, ability: Ability::JUMP });
    let trajectory = Trajectory { take_off, ..Trajectory::default() };
    assert_eq!([0, 29, 30, 60].map(|age| trajectory.winds_up_for(age).is_some()), [false, false, true, true]);
    let standing = Locomotion::default().winding_up(Ability::JUMP);
    assert_eq!((standing.phase, standing.ability), (Some(MovePhase::WindUp), Ability::JUMP));
    let flying = Locomotion { phase: Some(MovePhase::Flight), ..Locomotion::default() };
    assert_eq!(flying.winding_up(Ability::JUMP), flying);
}

/// A world whose NPC stands before a flight of so many steps, each 0.3 m high and so deep, m, or a slope as steep.
fn flight(depth: f32, is_slope: bool) -> World {
    const COUNT: u8 = 10;
    let mut edges = vec![(5.0, GROUND), (20.0, GROUND)];
    for step in 0..COUNT {
        let (z, y) = (20.0 + depth * f32::from(step), GROUND + 0.3 * f32::from(step));
        let rises = if is_slope { vec![(z + depth, y + 0.3)] } else { vec![(z, y + 0.3), (z + depth, y + 0.3)] };
        edges.extend(rises);
    }
    edges.push((60.0, GROUND + 0.3 * f32::from(COUNT)));
    let strip = |pair: &[(f32, f32)]| {
        let [(from, low), (to, high)] = [pair[0], pair[1]];
        let corner = |x: f32, z: f32, y: f32| Vec3::new(x, y, z);
        let [a, b, c, d] =
            [corner(5.0, from, low), corner(5.0, to, high), corner(15.0, to, high), corner(15.0, from, low)];
        [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground))
    };
    let triangles = edges.windows(2).flat_map(strip).collect();
    let map = Map::from_parts(MapSize { width: 20, height: 30, depth: 70 }, triangles, Placed::default());
    let mut world = World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default());
    world.spawn(Vec3::new(10.0, GROUND, 18.0), 0.0);
    world
}

/// The greatest changes of height in a tick, m, of the feet and of what is drawn, and the greatest offset, m.
fn changes(world: &mut World, forward: f32, decisions: u32) -> [f32; 3] {
    let (mut locomotion, mut most) = (Locomotion::default(), [0.0f32; 3]);
    follow(world, &mut locomotion, STAND, 2);
    let height = |world: &World| world.npc(NPC).unwrap().body.feet.y;
    let mut before = [height(world), height(world) + locomotion.steps.offset_m];
    for _ in 0..decisions {
        world.decide(NPC, Action { forward, ..STAND });
        for _ in 0..10 {
            world.tick();
            let npc = world.npc(NPC).unwrap();
            locomotion.advance(&npc.body, world.profile_of(npc), &npc.action, world.used_in_tick(NPC));
            let offset = locomotion.steps.offset_m;
            let now = [height(world), height(world) + offset];
            let seen = [now[0] - before[0], now[1] - before[1], offset];
            most.iter_mut().zip(seen).for_each(|(most, seen)| *most = most.max(seen.abs()));
            before = now;
        }
    }
    assert_eq!(locomotion.steps.offset_m, 0.0, "it has decayed");
    most
}

#[test]
fn what_is_drawn_of_a_body_rises_smoothly_over_steps() {
    // At 11 m/s the stairs rise by 0.18 m in each tick.
    for (forward, decisions, bound) in [(0.1, 60, 0.06), (0.2, 30, 0.12), (0.4, 20, 0.12), (1.0, 12, 0.2)] {
        let [feet, drawn, offset] = changes(&mut flight(0.3, false), forward, decisions);
        assert!(feet > 0.25 && drawn < bound, "forward {forward}: the feet by {feet} m, what is drawn by {drawn} m");
        assert!((0.2..=0.35).contains(&offset), "forward {forward}: offset {offset} m");
        let [feet, drawn, offset] = changes(&mut flight(0.6, true), forward, decisions);
        assert_eq!((drawn, offset), (feet, 0.0), "forward {forward}: slopes are not smoothed");
    }
}

#[test]
fn what_is_drawn_of_a_body_is_where_its_feet_are_after_a_teleport_and_on_rides() {
    let mut locomotion = Locomotion::default();
    let mut body = Body::at(Vec3::new(10.0, GROUND, 10.0), 0.0);
    body.support = Support::Ground;
    let mut offset_at = |body: &Body| {
        locomotion.advance(body, &CharacterProfile::default(), &STAND, AbilitySet::default());
        locomotion.steps.offset_m
    };
    offset_at(&body);
    body.feet.y += 0.3;
    assert!((-0.3..-0.2).contains(&offset_at(&body)), "a step");
    body.feet.y += 4.0;
    assert_eq!(offset_at(&body), 0.0, "a teleport");
    body.feet.y -= 0.3;
    assert!((0.2..0.3).contains(&offset_at(&body)), "a step down");
    (body.support, body.ride) = (Support::Air, Some(Ride { line_idx: 0, distance: 0.0 }));
    assert_eq!(offset_at(&body), 0.0, "a ride");
    // A lift takes the body along.
    (body.support, body.ride) = (Support::Ground, None);
    let most = (0..60).fold(0.0f32, |most, _| {
        body.feet.y += 0.05;
        most.max(offset_at(&body).abs())
    });
    assert!(most < 0.05, "a lift: {most} m");
}
