//! Worlds through the C functions: a rollback repeats itself to the bit.
#![expect(unsafe_code, reason = "calls C functions")]

use crate::stage::{at, fails, handle, map, ok, state, world};
use std::mem::offset_of;
use std::ptr::{null, null_mut};
use surefoot::abi::{Action, Locomotion, Outcome, State, Vec3};
use surefoot::exports::*;
use surefoot::{Snapshot, World};

fn state_of(world: *const Handle<World>, npc: u32) -> State {
    let mut state = state();
    ok(|error| unsafe { sf_world_state(world, npc, &mut state, error) });
    state
}

#[test]
fn what_follows_a_rollback_is_what_followed_before() {
    let world = world(&map());
    let snapshot: *mut Handle<Snapshot> = handle(|out, error| unsafe { sf_snapshot_create(out, error) });
    fails(6, "the snapshot is empty", |error| unsafe { sf_world_restore(world, snapshot, error) });
    let mut npc = 9;
    let (start, goal) = (Vec3 { x: 50.0, y: 60.0, z: 50.0 }, at(80.0, 80.0));
    ok(|error| unsafe { sf_world_spawn(world, start, 0.0, &mut npc, error) });
    ok(|error| unsafe { sf_world_set_goal(world, npc, goal, error) });
    let run = || {
        let mut seen = Vec::new();
        for round in 0..30 {
            let turn = (round % 3) as f32 - 1.0;
            let action = Action { forward: 1.0, strafe: 0.0, turn, jump: if round % 4 == 0 { 1.0 } else { -1.0 } };
            let mut outcome = Outcome::default();
            ok(|error| unsafe { sf_world_step(world, &npc, &action, &mut outcome, 1, error) });
            let state = state_of(world, npc);
            seen.push((state.feet.x.to_bits(), state.feet.y.to_bits(), state.yaw.to_bits(), outcome.end));
        }
        seen
    };
    run();
    ok(|error| unsafe { sf_world_save(world, snapshot, error) });
    let first = run();
    ok(|error| unsafe { sf_world_restore(world, snapshot, error) });
    assert_eq!(first, run());
    assert_ne!(first.first(), first.last(), "it moves");
    unsafe {
        sf_snapshot_destroy(snapshot);
        sf_world_destroy(world);
    }
}

#[test]
fn a_character_that_jumps_flies_and_lands() {
    let world = world(&map());
    let mut npc = 0;
    ok(|error| unsafe { sf_world_spawn(world, Vec3 { x: 50.0, y: 60.0, z: 50.0 }, 0.0, &mut npc, error) });
    let mut locomotion = Locomotion { struct_size: size_of::<Locomotion>() as u32, ..Locomotion::default() };
    let mut seen = Vec::new();
    for decision in 0..40 {
        let jump = if decision == 24 { 1.0 } else { -1.0 };
        let action = Action { forward: 0.0, strafe: 0.0, turn: 0.0, jump };
        ok(|error| unsafe { sf_world_decide(world, npc, action, error) });
        for tick in 0..10 {
            ok(|error| unsafe { sf_world_tick(world, null_mut(), error) });
            let (state, ability) = (state_of(world, npc), i32::from(decision == 24 && tick == 0));
            ok(|error| unsafe { sf_locomotion_advance(&mut locomotion, null(), &state, &action, ability, error) });
            seen.push((locomotion.phase, locomotion.ability));
        }
    }
    seen.dedup();
    assert_eq!(seen[seen.len() - 4..], [(0, 0), (1, 1), (2, 1), (0, 0)], "{seen:?}");
    // A program that was compiled before steps were smoothed has a shorter struct.
    let (state, action) = (state_of(world, npc), Action::default());
    let mut shorter = Locomotion { struct_size: offset_of!(Locomotion, step_offset) as u32, rise: 7.0, ..locomotion };
    ok(|error| unsafe { sf_locomotion_advance(&mut shorter, null(), &state, &action, 0, error) });
    assert_eq!((shorter.pace, shorter.rise), (0, 7.0), "only its own fields are written");
    let mut damaged = Locomotion { pace: 9, ..locomotion };
    fails(1, "locomotion.pace is 9", |error| unsafe {
        sf_locomotion_advance(&mut damaged, null(), &state, &action, 0, error)
    });
    fails(1, "ability is 15", |error| unsafe {
        sf_locomotion_advance(&mut locomotion, null(), &state, &action, 15, error)
    });
    unsafe { sf_world_destroy(world) };
}

#[test]
fn what_is_wrong_with_a_call_is_said() {
    let world = world(&map());
    let mut npc = 0;
    ok(|error| unsafe { sf_world_spawn(world, at(9.0, 9.0), 0.0, &mut npc, error) });
    let (action, mut outcome) = (Action::default(), Outcome::default());
    fails(6, "NPC 0 has no goal", |error| unsafe { sf_world_step(world, &npc, &action, &mut outcome, 1, error) });
    fails(6, "NPC 0 has no goal", |error| unsafe { sf_world_close_decision(world, npc, &mut outcome, error) });
    fails(3, "no NPC 5", |error| unsafe { sf_world_set_goal(world, 5, at(0.0, 0.0), error) });
    fails(1, "yaw is inf", |error| unsafe { sf_world_spawn(world, at(9.0, 9.0), f32::INFINITY, &mut npc, error) });
    fails(1, "npc is NULL", |error| unsafe { sf_world_spawn(world, at(9.0, 9.0), 0.0, null_mut(), error) });
    fails(1, "action[2] is NaN", |error| unsafe {
        sf_world_decide(world, npc, Action { turn: f32::NAN, ..action }, error)
    });
    fails(2, "an NPC has 64 rays", |error| unsafe { sf_world_look(world, npc, null_mut(), 0, error) });
    let load = |bytes: &[u8], error| unsafe {
        let mut map = null_mut();
        let status = sf_map_load_memory(bytes.as_ptr().cast(), bytes.len(), &mut map, error);
        sf_map_destroy(map);
        status
    };
    fails(4, "cut off", |error| load(&surefoot_levels::encode(&map())[..100], error));
    fails(4, "", |error| load(b"glTF and so on", error));
    fails(4, "", |error| load(b"", error));
    fails(1, "bytes is NULL", |error| unsafe { sf_map_load_memory(null(), 3, &mut null_mut(), error) });
    unsafe { sf_world_destroy(world) };
}
