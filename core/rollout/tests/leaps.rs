//! Steered leaps over gaps, up ledges and down from them.

use super::stage::of_boxes;
use std::f32::consts::FRAC_PI_2;
use surefoot_rollout::leap::Leap;
use surefoot_rollout::steer::Course;
use surefoot_world::arrival::{RUN_UP_M, Rims};
use surefoot_world::map::MapSize;
use surefoot_world::{Ability, CharacterProfile, Gait, TaskConfig, Vec3, World};

const FLOOR: f32 = 8.0;

/// What a body did on a leap along x.
#[derive(Debug, Default)]
struct Leapt {
    jumps: u32,
    air_jumps: u32,
    /// Where it left the ground, m before the rim.
    took_off: f32,
    has_landed: bool,
    /// The widest angle between its heading and the leap after it has turned, rad.
    widest: f32,
    seconds: f32,
    /// The farthest from the rim before it left the ground, m.
    run_up: f32,
}

/// Lets a body leap from a platform whose rim is at x = 20 m to one that begins `width` metres further, and `rise`
/// metres higher. The body starts `run_up` metres before the rim.
fn leap(profile: &CharacterProfile, width: f32, rise: f32, run_up: f32) -> Leapt {
    let size = MapSize { width: 60, height: 40, depth: 20 };
    let far = Vec3::new(20.0 + width, FLOOR + rise, 10.0);
    let boxes = [
        [Vec3::new(2.0, FLOOR - 1.0, 4.0), Vec3::new(20.0, FLOOR, 16.0)],
        [Vec3::new(far.x, far.y - 4.0, 4.0), Vec3::new(58.0, far.y, 16.0)],
    ];
    let mut world = World::new(of_boxes(size, boxes), profile.clone(), TaskConfig::default());
    let slot = world.spawn(Vec3::new(20.0 - run_up, FLOOR, 10.0), FRAC_PI_2);
    let course = Course { to: far + Vec3::X * 4.0, then: None, cuts: false, gait: Gait::DEFAULT, around: None };
    let (take_off, landing) = (Vec3::new(19.9, FLOOR, 10.0), far + Vec3::X * 0.1);
    let leap = Leap { rims: Rims { take_off, landing, run_up_m: RUN_UP_M }, course };
    let mut leapt = Leapt::default();
    for decision in 0..40 {
        let body = world.npc(slot).unwrap().body;
        if leapt.took_off == 0.0 {
            leapt.run_up = leapt.run_up.max(20.0 - body.feet.x);
        }
        leapt.widest = leapt.widest.max((body.yaw - FRAC_PI_2).abs());
        let is_there = body.is_grounded() && body.feet.x > far.x && (body.feet.y - far.y).abs() < 0.3;
        if is_there {
            leapt.has_landed = true;
            leapt.seconds = decision as f32 / 6.0;
            break;
        }
        world.decide(slot, leap.action(&body, profile));
        world.tick_decision();
        let used = world.npc(slot).unwrap().used_abilities;
        leapt.jumps += u32::from(used.contains(Ability::JUMP));
        leapt.air_jumps += u32::from(used.contains(Ability::DOUBLE_JUMP));
        if body.is_grounded() && !world.npc(slot).unwrap().body.is_grounded() {
            leapt.took_off = 20.0 - body.feet.x;
        }
    }
    leapt
}

#[test]
fn a_body_leaps_once_near_the_rim_and_keeps_its_heading() {
    let profile = CharacterProfile::default();
    // Width of the gap, height of the far rim, run-up, and how often the body jumps from the ground and in the air.
    let cases = [
        (3.0, 0.0, 6.0, 1, 0),
        (6.0, 0.0, 10.0, 1, 0),
        (4.0, 1.5, 6.0, 1, 0),
        (0.4, 2.0, 6.0, 1, 0),
        (5.0, 3.5, 8.0, 1, 1),
        (0.4, 4.2, 8.0, 1, 1),
        (14.0, 0.0, 12.0, 1, 1),
        (1.0, -3.0, 6.0, 0, 0),
        (8.0, -3.0, 10.0, 1, 0),
        (3.0, 0.0, 0.5, 1, 0),
    ];
    for case in cases {
        let (width, rise, run_up, jumps, air_jumps) = case;
        let leapt = leap(&profile, width, rise, run_up);
        assert!(leapt.has_landed, "{case:?}: {leapt:?}");
        assert_eq!((leapt.jumps, leapt.air_jumps), (jumps, air_jumps), "{case:?}: {leapt:?}");
        assert!(leapt.widest < 0.1, "{case:?}: {leapt:?}");
        let top = profile.forward_speed;
        assert!(rise > 1.0 || leapt.took_off < top / 6.0 + 0.2, "{case:?}: {leapt:?}");
    }
}

#[test]
fn a_body_that_cannot_jump_in_the_air_leaps_as_far_as_one_jump_carries_it() {
    let profile = CharacterProfile::default().with(|body| body.extra_jumps = 0).unwrap();
    assert!(leap(&profile, 7.0, 0.0, 12.0).has_landed);
    assert!(!leap(&profile, 16.0, 0.0, 12.0).has_landed, "no body leaps 16 m at 11 m/s within a second");
}

#[test]
fn a_body_that_is_too_near_to_the_rim_goes_back_for_a_run_up() {
    let slow_in_air = CharacterProfile::default().with(|body| (body.extra_jumps, body.air_acceleration) = (0, 4.0));
    let profile = slow_in_air.unwrap();
    let far = leap(&profile, 11.0, 0.0, 0.5);
    assert!(far.has_landed && far.run_up > 1.0, "{far:?}");
    let near = leap(&profile, 2.0, 0.0, 0.5);
    assert!(near.has_landed && near.run_up < 0.6, "no run-up is needed: {near:?}");
}
