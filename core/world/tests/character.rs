//! How a body moves on simple geometry.

use crate::stage::{FORWARD, NPC, STAND, feet};
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;
use surefoot_world::map::{Jetpack, Liquid, MapSize, Outline, Pad, Placed, Pool, Teleporter, ZipLine};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{
    Action, CharacterProfile, End, Map, NpcSlot, ProfileIdx, RawCharacterProfile, TaskConfig, Vec3, World, WorldConfig,
};

const GROUND: f32 = 10.0;
const MIDDLE: Vec3 = Vec3::new(30.0, GROUND, 30.0);
const SIZE: MapSize = MapSize { width: 60, height: 80, depth: 60 };

fn quad(corners: [Vec3; 4]) -> Vec<Triangle> {
    let [a, b, c, d] = corners;
    [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
}

/// A floor whose height is a function of z, in strips along x.
fn profile_along_z(heights: &[(f32, f32)]) -> Vec<Triangle> {
    heights
        .windows(2)
        .flat_map(|pair| {
            let [(z0, y0), (z1, y1)] = [pair[0], pair[1]];
            quad([Vec3::new(0.0, y0, z0), Vec3::new(0.0, y1, z1), Vec3::new(60.0, y1, z1), Vec3::new(60.0, y0, z0)])
        })
        .collect()
}

fn flat() -> Vec<Triangle> {
    profile_along_z(&[(0.0, GROUND), (60.0, GROUND)])
}

fn world(triangles: Vec<Triangle>, placed: Placed) -> World {
    let map = Map::from_parts(SIZE, triangles, placed);
    World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default())
}

/// Runs decisions and returns the highest point of the feet.
fn run(world: &mut World, actions: &[Action]) -> f32 {
    let mut top = f32::NEG_INFINITY;
    for action in actions {
        world.decide(NPC, *action);
        for _ in 0..10 {
            world.tick();
            top = top.max(feet(world).y);
        }
    }
    top
}

fn on(triangles: Vec<Triangle>, at: Vec3) -> World {
    let mut world = world(triangles, Placed::default());
    world.spawn(at, 0.0);
    run(&mut world, &[STAND; 2]);
    world
}

#[test]
fn runs_at_eleven_metres_a_second_and_backs_up_at_sixty_percent() {
    let mut ahead = on(flat(), MIDDLE);
    run(&mut ahead, &[FORWARD; 6]);
    assert!((ahead.npc(NPC).unwrap().body.velocity.z - 11.0).abs() < 0.05);
    let mut back = on(flat(), MIDDLE);
    run(&mut back, &[Action { forward: -1.0, ..STAND }; 6]);
    assert!((back.npc(NPC).unwrap().body.velocity.z + 6.6).abs() < 0.05);
    let mut right = on(flat(), MIDDLE);
    run(&mut right, &[Action { strafe: 1.0, ..STAND }; 6]);
    assert!((right.npc(NPC).unwrap().body.velocity.x + 6.6).abs() < 0.05, "right of an NPC that faces +z is -x");
}

#[test]
fn a_jump_rises_two_and_a_half_metres_and_a_double_jump_five() {
    let jump = Action { jump: 1.0, ..STAND };
    let single = run(&mut on(flat(), MIDDLE), &[jump, STAND, STAND, STAND]) - GROUND;
    assert!((single - 2.5).abs() < 0.15, "{single}");
    let double = run(&mut on(flat(), MIDDLE), &[jump, STAND, STAND, jump, STAND, STAND, STAND]) - GROUND;
    assert!((double - 5.0).abs() < 0.2, "{double}");
    let triple = run(&mut on(flat(), MIDDLE), &[jump, STAND, STAND, jump, STAND, STAND, jump, STAND, STAND]) - GROUND;
    assert!(triple <= double + 0.01, "a third jump lifted to {triple}");
}

#[test]
fn a_wall_gives_no_further_jump() {
    for lean in [0.0, 0.05, 0.5] {
        let wall = quad([
            Vec3::new(60.0, GROUND, 40.0),
            Vec3::new(0.0, GROUND, 40.0),
            Vec3::new(0.0, GROUND + 30.0, 40.0 + 20.0 * lean),
            Vec3::new(60.0, GROUND + 30.0, 40.0 + 20.0 * lean),
        ]);
        // From each place, the body comes to rest at another height of its jumps.
        for far in 0..20 {
            let mut jumping = on([flat(), wall.clone()].concat(), Vec3::new(30.3, GROUND, 36.0 + 0.18 * far as f32));
            let jump = Action { jump: 1.0, ..FORWARD };
            let top = run(&mut jumping, &[jump; 12]) - GROUND;
            assert!(top < 5.2, "rose {top} m at a wall that leans by {lean}");
        }
    }
}

#[test]
fn walks_slopes_of_thirty_degrees_and_slides_on_fifty() {
    let ramp = |degrees: f32| {
        let rise = 20.0 * libm::tanf(degrees.to_radians());
        profile_along_z(&[(0.0, GROUND), (30.0, GROUND), (50.0, GROUND + rise), (60.0, GROUND + rise)])
    };
    let mut gentle = on(ramp(30.0), MIDDLE - Vec3::new(0.0, 0.0, 4.0));
    run(&mut gentle, &[FORWARD; 15]);
    assert!(feet(&gentle).y > GROUND + 5.0, "stuck at {:?}", feet(&gentle));
    let mut steep = on(ramp(50.0), MIDDLE - Vec3::new(0.0, 0.0, 4.0));
    run(&mut steep, &[FORWARD; 30]);
    assert!(feet(&steep).y < GROUND + 1.0, "climbed to {:?}", feet(&steep));
    let mut sliding = world(ramp(50.0), Placed::default());
    sliding.spawn(Vec3::new(30.0, GROUND + 18.0, 44.0), 0.0);
    run(&mut sliding, &[STAND; 30]);
    assert!(feet(&sliding).y < GROUND + 1.0, "hangs at {:?}", feet(&sliding));
}

#[test]
fn does_not_creep_on_a_slope_it_can_stand_on() {
    let slope = profile_along_z(&[(0.0, 0.5), (60.0, 0.5 + 60.0 * libm::tanf(30.0f32.to_radians()))]);
    let mut standing = on(slope, Vec3::new(30.0, 18.0, 30.0));
    let before = feet(&standing);
    run(&mut standing, &[STAND; 60]);
    assert!(before.distance(feet(&standing)) < 0.02, "crept from {before:?} to {:?}", feet(&standing));
}

#[test]
fn stays_on_the_ground_when_running_downhill() {
    let slope = profile_along_z(&[(0.0, 40.0), (60.0, 40.0 - 60.0 * libm::tanf(30.0f32.to_radians()))]);
    let mut running = on(slope, Vec3::new(30.0, 37.2, 5.0));
    for _ in 0..20 {
        running.decide(NPC, FORWARD);
        for _ in 0..10 {
            running.tick();
            assert!(running.npc(NPC).unwrap().body.is_grounded(), "took off at {:?}", feet(&running));
        }
    }
}

#[test]
fn walks_over_a_low_step_and_is_stopped_by_a_high_one() {
    let step = |height: f32| {
        profile_along_z(&[(0.0, GROUND), (35.0, GROUND), (35.0, GROUND + height), (60.0, GROUND + height)])
    };
    let mut low = on(step(0.09), MIDDLE);
    run(&mut low, &[FORWARD; 6]);
    assert!(feet(&low).z > 37.0, "stopped at {:?}", feet(&low));
    let mut high = on(step(0.6), MIDDLE);
    run(&mut high, &[FORWARD; 12]);
    assert!(feet(&high).z < 35.0, "walked through to {:?}", feet(&high));
}

#[test]
fn the_fastest_fall_does_not_pass_through_a_floor() {
    let mut falling = world(flat(), Placed::default());
    falling.spawn(Vec3::new(30.3, 79.0, 30.7), 0.0);
    run(&mut falling, &[STAND; 30]);
    assert!((feet(&falling).y - GROUND).abs() < 0.01, "{:?}", feet(&falling));
}

#[test]
fn a_pad_throws_as_high_as_its_speed_says() {
    let speed = (2.0f32 * 20.0 * 14.0).sqrt();
    let mut padded = world(flat(), Placed { pads: vec![Pad { centre: MIDDLE, speed }], ..Placed::default() });
    padded.spawn(MIDDLE - Vec3::new(0.0, 0.0, 3.0), 0.0);
    run(&mut padded, &[FORWARD; 1]);
    let top = run(&mut padded, &[FORWARD, FORWARD, STAND, STAND, STAND, STAND, STAND, STAND]) - GROUND;
    assert!((top - 14.0).abs() < 0.5, "{top}");
    assert!(padded.npc(NPC).unwrap().body.feet.y > GROUND);
}

fn pool(liquid: Liquid) -> World {
    let pool =
        Pool { centre: MIDDLE + Vec3::new(0.0, 1.0, 0.0), outline: Outline::Round { radius: 8.0 }, depth: 1.5, liquid };
    let mut world = world(flat(), Placed { pools: vec![pool], ..Placed::default() });
    world.spawn(MIDDLE, 0.0);
    world.set_waypoint(NPC, Vec3::new(5.0, GROUND, 5.0));
    world
}

fn ticks_until_end(world: &mut World) -> (u32, End) {
    world.decide(NPC, STAND);
    for tick in 1..2000 {
        world.tick();
        if let Some(end) = world.npc(NPC).unwrap().episode.unwrap().end {
            return (tick, end);
        }
    }
    panic!("nothing happened");
}

#[test]
fn lava_burns_at_once_and_water_drowns_after_five_seconds() {
    assert_eq!(ticks_until_end(&mut pool(Liquid::Lava)), (1, End::Burnt));
    assert_eq!(ticks_until_end(&mut pool(Liquid::Water)), (300, End::Drowned));
}

#[test]
fn whoever_leaves_the_map_fell_and_stays_where_that_happened() {
    let mut leaving = on(flat(), Vec3::new(30.0, GROUND, 57.0));
    leaving.set_waypoint(NPC, MIDDLE);
    run(&mut leaving, &[FORWARD; 5]);
    assert_eq!(leaving.npc(NPC).unwrap().episode.unwrap().end, Some(End::Fell));
    let there = feet(&leaving);
    run(&mut leaving, &[FORWARD; 5]);
    assert_eq!(feet(&leaving), there);
    leaving.teleport(NPC, MIDDLE, 0.0);
    run(&mut leaving, &[FORWARD; 1]);
    assert!(feet(&leaving).z > MIDDLE.z, "a teleport revives");
}

#[test]
fn the_goal_is_reached_on_the_tick_that_comes_within_a_metre() {
    let mut running = on(flat(), MIDDLE);
    running.set_waypoint(NPC, MIDDLE + Vec3::new(0.0, 0.0, 5.0));
    let mut rewards = Vec::new();
    for _ in 0..10 {
        running.decide(NPC, FORWARD);
        running.tick_decision();
        let outcome = running.close_decision(NPC).unwrap();
        rewards.push(outcome.reward);
        if outcome.end.is_some() {
            assert_eq!(outcome.end, Some(End::Reached));
            break;
        }
    }
    let total: f32 = rewards.iter().sum();
    let expected = 1.0 + 4.0 / 20.0 - 0.0005 * rewards.len() as f32;
    assert!((total - expected).abs() < 0.02, "{total} against {expected}");
}

#[test]
fn no_progress_for_the_whole_patience_cuts_the_attempt_off() {
    let mut standing = on(flat(), MIDDLE);
    standing.set_waypoint(NPC, MIDDLE + Vec3::new(0.0, 0.0, 20.0));
    for decision in 1..=300 {
        standing.decide(NPC, STAND);
        standing.tick_decision();
        let end = standing.close_decision(NPC).unwrap().end;
        assert_eq!(end, (decision == 300).then_some(End::NoProgress), "decision {decision}");
    }
    assert!(End::NoProgress.is_truncation());
    assert!(End::ALL.iter().all(|end| !end.is_truncation() || end.reward() == 0.0));
}

#[test]
fn actions_that_are_not_numbers_are_refused_and_large_ones_clamped() {
    assert_eq!(Action::from_array([0.0, f32::NAN, 0.0, 0.0]).unwrap_err().index, 1);
    assert_eq!(Action::from_array([0.0, 0.0, 0.0, f32::INFINITY]).unwrap_err().index, 3);
    assert_eq!(Action::from_array([7.0, -7.0, 0.5, 0.0]).unwrap().to_array(), [1.0, -1.0, 0.5, 0.0]);
}

#[test]
fn a_mirrored_observation_mirrored_again_is_itself() {
    let mut world = on(flat(), MIDDLE);
    world.set_waypoint(NPC, MIDDLE + Vec3::new(4.0, 0.0, 9.0));
    run(&mut world, &[Action { strafe: 0.4, turn: 0.2, ..FORWARD }; 3]);
    let mut row = vec![0.0; surefoot_world::OBSERVATION_LEN];
    assert!(world.observe(NPC, &mut row));
    let mut mirrored = row.clone();
    surefoot_world::sense::mirror_observation(&mut mirrored);
    assert_ne!(row, mirrored);
    surefoot_world::sense::mirror_observation(&mut mirrored);
    assert_eq!(row, mirrored);
}

#[test]
fn a_zip_line_carries_to_its_lower_end_and_lets_go() {
    let line = ZipLine { from: Vec3::new(30.0, 30.0, 10.0), to: Vec3::new(30.0, GROUND, 40.0) };
    let tower = quad([
        Vec3::new(26.0, 30.0, 6.0),
        Vec3::new(26.0, 30.0, 12.0),
        Vec3::new(34.0, 30.0, 12.0),
        Vec3::new(34.0, 30.0, 6.0),
    ]);
    let triangles = [flat(), tower].concat();
    let mut riding = world(triangles, Placed { zip_lines: vec![line], ..Placed::default() });
    riding.spawn(Vec3::new(30.0, 30.0, 7.5), 0.0);
    run(&mut riding, &[FORWARD; 2]);
    let npc = riding.npc(NPC).unwrap();
    assert!(npc.body.ride.is_some(), "not riding at {:?}", npc.body.feet);
    run(&mut riding, &[STAND; 20]);
    let body = riding.npc(NPC).unwrap().body;
    assert!(body.ride.is_none() && body.is_grounded());
    assert!((body.feet - line.to).length() < 3.0, "let go at {:?}", body.feet);
}

#[test]
fn a_jump_lets_go_of_a_zip_line() {
    let line = ZipLine { from: MIDDLE, to: MIDDLE + Vec3::new(0.0, -4.0, 25.0) };
    let mut riding = world(flat(), Placed { zip_lines: vec![line], ..Placed::default() });
    riding.spawn(MIDDLE, 0.0);
    run(&mut riding, &[STAND; 3]);
    assert!(riding.npc(NPC).unwrap().body.ride.is_some());
    run(&mut riding, &[Action { jump: 1.0, ..STAND }]);
    assert!(riding.npc(NPC).unwrap().body.ride.is_none());
}

#[test]
fn characters_that_cannot_use_zip_lines_walk_past() {
    let line = ZipLine { from: MIDDLE, to: MIDDLE + Vec3::new(0.0, -4.0, 25.0) };
    let map = Map::from_parts(SIZE, flat(), Placed { zip_lines: vec![line], ..Placed::default() });
    let profile = CharacterProfile::default().with(|it| it.uses_zip_lines = false).unwrap();
    let mut walking = World::new(Arc::new(map), profile, TaskConfig::default());
    walking.spawn(MIDDLE, 0.0);
    run(&mut walking, &[FORWARD; 3]);
    assert!(walking.npc(NPC).unwrap().body.ride.is_none());
}

/// Steps of 0.3 x 0.3 m from z = 32 m on, up to 3 m.
fn stairs() -> Vec<Triangle> {
    let mut heights = vec![(0.0, GROUND)];
    for step in 0..10u8 {
        let (z, y) = (32.0 + 0.3 * f32::from(step), GROUND + 0.3 * f32::from(step));
        heights.extend([(z, y), (z, y + 0.3)]);
    }
    heights.push((60.0, GROUND + 3.0));
    profile_along_z(&heights)
}

#[test]
fn stairs_are_walked_at_any_speed_by_bodies_that_step_high_enough() {
    let climb = |step_height: f32, radius: f32, forward: f32| {
        let change = |it: &mut RawCharacterProfile| (it.step_height, it.radius) = (step_height, radius);
        let profile = CharacterProfile::default().with(change).unwrap();
        let map = Map::from_parts(SIZE, stairs(), Placed::default());
        let mut world = World::new(Arc::new(map), profile, TaskConfig::default());
        world.spawn(MIDDLE, 0.0);
        run(&mut world, &[STAND; 2]);
        let mut in_air = 0;
        for _ in 0..((6.0 / forward) as u32).max(6) {
            world.decide(NPC, Action { forward, ..Action::default() });
            for _ in 0..10 {
                world.tick();
                in_air += u32::from(!world.npc(NPC).unwrap().body.is_grounded());
            }
        }
        (feet(&world).y - GROUND, in_air)
    };
    for (radius, forward) in [(0.2, 1.0), (0.3, 1.0), (0.3, 0.3), (0.3, 0.05), (0.4, 0.5)] {
        let (rise, in_air) = climb(0.35, radius, forward);
        assert!((rise - 3.0).abs() < 0.02, "radius {radius}, forward {forward}: {rise} m");
        assert_eq!(in_air, 0, "radius {radius}, forward {forward}");
    }
    for step_height in [0.1, 0.25] {
        assert!(climb(step_height, 0.3, 1.0).0 < 0.1);
    }
}

#[test]
fn a_one_way_teleporter_leads_there_and_a_two_way_one_back_after_stepping_off() {
    let there = Vec3::new(10.0, GROUND, 50.0);
    for two_way in [false, true] {
        let teleporter = Teleporter { from: MIDDLE, to: there, two_way };
        let mut world = world(flat(), Placed { teleporters: vec![teleporter], ..Placed::default() });
        world.spawn(MIDDLE - Vec3::new(0.0, 0.0, 3.0), 0.0);
        run(&mut world, &[FORWARD, FORWARD, STAND, STAND]);
        assert!(feet(&world).distance(there) < 4.0, "at {:?}", feet(&world));
        // The NPC steps onto the far disc again: only a two-way teleporter leads back.
        world.teleport(NPC, there - Vec3::new(0.0, 0.0, 3.0), 0.0);
        run(&mut world, &[FORWARD, FORWARD, STAND, STAND]);
        let is_back = feet(&world).distance(MIDDLE) < 4.0;
        assert_eq!(is_back, two_way, "at {:?}", feet(&world));
    }
}

#[test]
fn a_jetpack_lifts_higher_than_two_jumps_until_its_fuel_is_gone() {
    let jetpack = Jetpack { centre: MIDDLE, fuel: 2.0 };
    let mut flying = world(flat(), Placed { jetpacks: vec![jetpack], ..Placed::default() });
    flying.spawn(MIDDLE, 0.0);
    run(&mut flying, &[STAND]);
    assert_eq!(flying.npc(NPC).unwrap().body.fuel, 2.0);
    flying.teleport(NPC, MIDDLE + Vec3::new(0.0, 0.0, 8.0), 0.0);
    assert_eq!(flying.npc(NPC).unwrap().body.fuel, 0.0, "a teleported NPC starts afresh");
    flying.teleport(NPC, MIDDLE, 0.0);
    let top = run(&mut flying, &[Action { jump: 1.0, ..STAND }; 24]) - GROUND;
    assert!((12.0..22.0).contains(&top), "rose {top} m");
    assert!(flying.npc(NPC).unwrap().body.fuel < 0.02 + 2.0);
}

#[test]
fn a_body_slides_down_from_what_is_too_steep_to_stand_on() {
    let slope = profile_along_z(&[(0.0, 50.0), (60.0, 50.0 - 60.0 * libm::tanf(45.0f32.to_radians()) * 0.8)]);
    let mut sliding = on(slope, Vec3::new(30.0, 26.5, 30.0));
    run(&mut sliding, &[STAND; 12]);
    assert!(feet(&sliding).z > 36.0, "stuck at {:?}", feet(&sliding));
}

#[test]
fn bodies_do_not_stick_to_the_seams_of_a_finely_cut_floor() {
    let mut triangles = Vec::new();
    for i in 0..120 {
        for k in 0..120 {
            let (x, z) = (i as f32 * 0.5, k as f32 * 0.5);
            let at = |x: f32, z: f32| Vec3::new(x, GROUND, z);
            triangles.extend(quad([at(x, z), at(x, z + 0.5), at(x + 0.5, z + 0.5), at(x + 0.5, z)]));
        }
    }
    let mut running = on(triangles, Vec3::new(7.3, GROUND, 5.1));
    let direction = 0.7;
    running.teleport(NPC, Vec3::new(7.3, GROUND, 5.1), direction);
    run(&mut running, &[FORWARD; 2]);
    let mut last = feet(&running);
    for _ in 0..120 {
        running.decide(NPC, FORWARD);
        running.tick();
        let moved = feet(&running).distance(last);
        assert!((moved - 11.0 / 60.0).abs() < 0.002, "moved {moved} m at {:?}", feet(&running));
        last = feet(&running);
    }
}

#[test]
fn thrown_and_flying_bodies_do_not_pass_through_ceilings() {
    let ceiling = |y: f32| {
        quad([Vec3::new(0.0, y, 0.0), Vec3::new(60.0, y, 0.0), Vec3::new(60.0, y, 60.0), Vec3::new(0.0, y, 60.0)])
    };
    for (idx, speed) in [14.0, 20.0, 26.0, 32.0, 45.0].into_iter().enumerate() {
        let height = GROUND + 4.0 + 0.37 * idx as f32;
        let triangles = [flat(), ceiling(height)].concat();
        let mut thrown = world(triangles, Placed { pads: vec![Pad { centre: MIDDLE, speed }], ..Placed::default() });
        thrown.spawn(MIDDLE, 0.0);
        let top = run(&mut thrown, &[STAND; 6]);
        assert!(top + 1.8 < height + 0.01, "{top} under a ceiling at {height}");
    }
}

#[test]
fn npcs_push_each_other_aside_only_where_the_world_says_so() {
    for npc_collision in [false, true] {
        let map = Arc::new(Map::from_parts(SIZE, flat(), Placed::default()));
        let profiles = vec![CharacterProfile::default()];
        let config = WorldConfig { profiles, task: TaskConfig::default(), npc_collision };
        let mut crowd = World::with_config(map, config);
        for idx in 0..9 {
            crowd.spawn(MIDDLE + Vec3::new(0.05 * (idx % 3) as f32, 0.0, 0.05 * (idx / 3) as f32), 0.0);
        }
        (0..120).for_each(|_| crowd.tick());
        let places: Vec<Vec3> = crowd.npcs().map(|(_, npc)| npc.body.feet).collect();
        let closest = (0..9).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| places[a].distance(places[b]));
        let closest = closest.fold(f32::INFINITY, f32::min);
        assert_eq!(closest > 0.58, npc_collision, "{closest} m apart");
        assert!(places.iter().all(|place| (place.y - GROUND).abs() < 0.02));
    }
}

/// A world whose NPCs get in each other's way, on a deck from 15 to 25 m on both axes with nothing below.
fn solid_world_on_a_deck() -> World {
    let corners = [(15.0, 15.0), (15.0, 25.0), (25.0, 25.0), (25.0, 15.0)];
    let deck = quad(corners.map(|(x, z)| Vec3::new(x, GROUND, z)));
    let map = Arc::new(Map::from_parts(SIZE, deck, Placed::default()));
    let profiles = vec![CharacterProfile::default()];
    World::with_config(map, WorldConfig { profiles, task: TaskConfig::default(), npc_collision: true })
}

#[test]
fn nobody_is_pushed_off_a_ledge() {
    let mut world = solid_world_on_a_deck();
    // One stands with its back to the edge; others run into it from the middle of the deck, and stop when they are
    // beside it.
    let stands = world.spawn(Vec3::new(24.8, GROUND, 20.0), 0.0);
    let runners: Vec<NpcSlot> =
        (0..6).map(|idx| world.spawn(Vec3::new(18.0 + idx as f32 * 0.7, GROUND, 20.0), FRAC_PI_2)).collect();
    for _ in 0..60 {
        for &runner in &runners {
            let at = world.npc(runner).unwrap().body.feet.x;
            world.decide(runner, if at < 24.6 { FORWARD } else { STAND });
        }
        (0..10).for_each(|_| world.tick());
    }
    let npc = world.npc(stands).unwrap();
    assert_eq!((npc.harm, npc.body.is_grounded()), (None, true), "{:?}", npc.body);
    assert!(npc.body.feet.distance(Vec3::new(24.8, GROUND, 20.0)) < 3.0, "{:?}", npc.body.feet);
}

#[test]
fn solid_npcs_do_not_run_through_each_other_and_pass_where_they_meet() {
    let mut world = solid_world_on_a_deck();
    let ends = [Vec3::new(17.0, GROUND, 20.0), Vec3::new(23.0, GROUND, 20.0)];
    let slots = [world.spawn(ends[0], FRAC_PI_2), world.spawn(ends[1], -FRAC_PI_2)];
    let mut closest = f32::INFINITY;
    let mut passed = false;
    for _ in 0..60 {
        slots.iter().for_each(|&slot| world.decide(slot, Action { forward: 0.3, ..FORWARD }));
        for _ in 0..10 {
            world.tick();
            let [one, other] = slots.map(|slot| world.npc(slot).unwrap().body.feet);
            closest = closest.min(one.distance(other));
            passed |= one.x > other.x + 0.5;
        }
        if passed {
            break;
        }
    }
    assert!(passed, "they stand before each other");
    assert!(closest > 0.4, "{closest} m apart");
}

#[test]
fn characters_of_several_profiles_share_a_world() {
    let map = Arc::new(Map::from_parts(SIZE, flat(), Placed::default()));
    let slow = CharacterProfile::default()
        .with(|it| {
            it.forward_speed = 3.0;
            it.height = 1.2
        })
        .unwrap();
    let profiles = vec![CharacterProfile::default(), slow];
    let config = WorldConfig { profiles, task: TaskConfig::default(), npc_collision: false };
    let mut world = World::with_config(map, config);
    let start = Vec3::new(10.0, GROUND, 10.0);
    let (fast, slow) = (world.spawn(start, 0.0), world.spawn_as(ProfileIdx(1), start, 0.0));
    for _ in 0..6 {
        world.decide(fast, FORWARD);
        world.decide(slow, FORWARD);
        world.tick_decision();
    }
    let z = |slot| world.npc(slot).unwrap().body.feet.z - start.z;
    assert!((z(fast) - 11.0).abs() < 1.2 && (z(slow) - 3.0).abs() < 0.3, "{} and {} m", z(fast), z(slow));
}

#[test]
fn profiles_out_of_range_are_refused_by_the_name_of_the_field() {
    let field = |change: fn(&mut RawCharacterProfile)| CharacterProfile::default().with(change).unwrap_err().field();
    assert!(CharacterProfile::try_from(RawCharacterProfile::default()).is_ok());
    assert_eq!(field(|profile| profile.radius = f32::NAN), "radius");
    assert_eq!(field(|profile| profile.height = 0.3), "height");
    assert_eq!(field(|profile| profile.gravity = 0.0), "gravity");
    assert_eq!(field(|profile| profile.jetpack_acceleration = -1.0), "jetpack_acceleration");
}
