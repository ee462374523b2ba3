//! Agents through the C functions: what they see is what the simulation sees, to the bit, and they allocate nothing.
#![expect(unsafe_code, reason = "calls C functions")]

use crate::stage::{agents, at, fails, handle, map, ok, policy, state, world};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::ffi::c_void;
use std::ptr::{null, null_mut};
use surefoot::abi::{self, Action, Hit, RAY_COUNT, Ray, State, Vec3};
use surefoot::exports::*;
use surefoot::{Agents, Map as LevelMap, World};
use surefoot_levels::encode;
use surefoot_world::character::MoveScratch;
use surefoot_world::navigable::sample;
use surefoot_world::{CharacterProfile, Map, TICKS_PER_DECISION};

/// Places to stand.
fn places(map: &Map, count: usize) -> Vec<Vec3> {
    let (mut rng, mut scratch) = (ChaCha8Rng::seed_from_u64(3), MoveScratch::default());
    let profile = CharacterProfile::default();
    (0..count).map(|_| sample(map, &profile, &mut rng, &mut scratch).expect("ground").into()).collect()
}

/// Tells agents of the devices of a map.
fn tell_devices(agents: *mut Handle<Agents>, map: &Map) {
    let bytes = encode(map);
    let level: *mut LevelMap =
        handle(|out, error| unsafe { sf_map_load_memory(bytes.as_ptr().cast::<c_void>(), bytes.len(), out, error) });
    let (mut devices, mut count) = (vec![abi::Device::default(); 256], 0);
    ok(|error| unsafe { sf_map_devices(level, devices.as_mut_ptr(), devices.len(), &mut count, error) });
    devices.truncate(count);
    assert!(devices.iter().any(|device| device.kind == 4) && devices.iter().any(|device| device.kind > 4));
    ok(|error| unsafe { sf_agents_set_devices(agents, devices.as_ptr(), devices.len(), error) });
    unsafe { sf_map_destroy(level) };
}

fn state_of(world: *const Handle<World>, npc: u32) -> State {
    let mut state = state();
    ok(|error| unsafe { sf_world_state(world, npc, &mut state, error) });
    state
}

fn observation(read: impl FnOnce(*mut f32, usize, *mut usize, *mut abi::Error) -> i32) -> Vec<u32> {
    let (mut row, mut count) = (vec![0.0f32; 369], 0);
    ok(|error| read(row.as_mut_ptr(), row.len(), &mut count, error));
    assert_eq!(count, row.len());
    row.into_iter().map(f32::to_bits).collect()
}

#[test]
fn an_agent_of_the_caller_sees_what_the_simulation_sees_to_the_bit() {
    let map = map();
    let (world, agents) = (world(&map), agents(1));
    tell_devices(agents, &map);
    let places = places(&map, 24);
    let mut in_air = 0;
    for pair in places.chunks_exact(2) {
        let (start, goal) = (pair[0], pair[1]);
        let mut npc = 0;
        ok(|error| unsafe { sf_world_spawn(world, start, 0.4, &mut npc, error) });
        ok(|error| unsafe { sf_world_set_goal(world, npc, goal, error) });
        ok(|error| unsafe { sf_agents_begin(agents, 0, 5, error) });
        ok(|error| unsafe { sf_agents_set_goal(agents, 0, start, goal, error) });
        for _ in 0..40 {
            let (state, mut hits) = (state_of(world, npc), [Hit::default(); RAY_COUNT]);
            in_air += u32::from(state.flags & abi::GROUNDED == 0);
            ok(|error| unsafe { sf_world_look(world, npc, hits.as_mut_ptr(), hits.len(), error) });
            ok(|error| unsafe { sf_agents_observe(agents, null(), &state, hits.as_ptr(), 1, error) });
            let ours = observation(|row, room, count, error| unsafe {
                sf_agents_observation(agents, 0, row, room, count, error)
            });
            let theirs = observation(|row, room, count, error| unsafe {
                sf_world_observation(world, npc, row, room, count, error)
            });
            assert_eq!(ours, theirs);
            let mut action = Action::default();
            ok(|error| unsafe { sf_agents_decide(agents, null(), 1, 0.5, &mut action, error) });
            ok(|error| unsafe { sf_world_decide(world, npc, action, error) });
            for _ in 0..TICKS_PER_DECISION {
                ok(|error| unsafe { sf_world_tick(world, null_mut(), error) });
                let feet = state_of(world, npc).feet;
                ok(|error| unsafe { sf_agents_note(agents, 0, feet, null_mut(), error) });
            }
            let mut outcome = abi::Outcome::default();
            ok(|error| unsafe { sf_world_close_decision(world, npc, &mut outcome, error) });
            if outcome.end != 0 {
                break;
            }
        }
        ok(|error| unsafe { sf_world_despawn(world, npc, error) });
    }
    assert!(in_air > 0, "some of what was seen was seen in the air");
    unsafe {
        sf_agents_destroy(agents);
        sf_world_destroy(world);
    }
}

#[test]
fn rays_cast_by_the_caller_see_nearly_what_the_simulation_sees() {
    let map = map();
    let (world, agents) = (world(&map), agents(1));
    for place in places(&map, 20) {
        let mut npc = 0;
        ok(|error| unsafe { sf_world_spawn(world, place, 1.0, &mut npc, error) });
        let (state, mut rays) = (state_of(world, npc), [Ray::default(); RAY_COUNT]);
        let (mut cast, mut looked) = ([Hit::default(); RAY_COUNT], [Hit::default(); RAY_COUNT]);
        ok(|error| unsafe { sf_agents_rays(agents, &state, 1, rays.as_mut_ptr(), rays.len(), error) });
        ok(|error| unsafe { sf_world_cast_rays(world, rays.as_ptr(), rays.len(), cast.as_mut_ptr(), error) });
        ok(|error| unsafe { sf_world_look(world, npc, looked.as_mut_ptr(), looked.len(), error) });
        let near = |(one, other): (&Hit, &Hit)| (one.distance - other.distance).abs() < 0.05;
        assert!(cast.iter().zip(&looked).filter(|pair| near(*pair)).count() >= RAY_COUNT - 2);
    }
    unsafe {
        sf_agents_destroy(agents);
        sf_world_destroy(world);
    }
}

/// What a character sees that stands on flat ground.
unsafe extern "C" fn cast_at_ground(user: *mut c_void, rays: *const Ray, count: usize, hits: *mut Hit) {
    let (rays, hits) =
        unsafe { (std::slice::from_raw_parts(rays, count), std::slice::from_raw_parts_mut(hits, count)) };
    for (ray, hit) in rays.iter().zip(hits) {
        if ray.direction.y < 0.0 {
            *hit = Hit { distance: -ray.origin.y / ray.direction.y, body_distance: 0.0, surface: 1 };
        }
    }
    if let Some(calls) = unsafe { user.cast::<u32>().as_mut() } {
        *calls += 1;
    }
}

/// Agents on flat ground, with goals around them.
fn on_flat_ground(count: u32) -> (*mut Handle<Agents>, Vec<State>) {
    let agents = agents(count);
    let states: Vec<State> = (0..count).map(|idx| State { feet: at(idx as f32, 0.0), ..state() }).collect();
    for (idx, state) in (0..).zip(&states) {
        let goal = at(idx as f32, 20.0 + idx as f32);
        ok(|error| unsafe { sf_agents_begin(agents, idx, u64::from(idx), error) });
        ok(|error| unsafe { sf_agents_set_goal(agents, idx, state.feet, goal, error) });
    }
    (agents, states)
}

#[test]
fn agents_decide_alike_alone_and_together_and_after_a_rollback() {
    const COUNT: usize = 7;
    let (agents, states) = on_flat_ground(COUNT as u32);
    let mut saved = Vec::new();
    for idx in 0..COUNT as u32 {
        let mut size = 0;
        fails(2, "bytes has room for 0", |error| unsafe {
            sf_agents_save(agents, idx, null_mut(), 0, &mut size, error)
        });
        let mut bytes = vec![0u8; size];
        ok(|error| unsafe { sf_agents_save(agents, idx, bytes.as_mut_ptr().cast(), size, &mut size, error) });
        saved.push(bytes);
    }
    let mut calls = 0u32;
    let user = (&raw mut calls).cast();
    let mut together = [[Action::default(); COUNT]; 3];
    for actions in &mut together {
        ok(|error| unsafe {
            sf_agents_observe_with(agents, null(), states.as_ptr(), COUNT, Some(cast_at_ground), user, error)
        });
        ok(|error| unsafe { sf_agents_decide(agents, null(), COUNT, 0.5, actions.as_mut_ptr(), error) });
    }
    assert_eq!(calls, 3, "one call for all agents");
    assert_ne!(together[0][0], together[1][0], "noise differs from decision to decision");
    for (idx, bytes) in saved.iter().enumerate() {
        let id = idx as u32;
        ok(|error| unsafe { sf_agents_restore(agents, id, bytes.as_ptr().cast(), bytes.len(), error) });
        for actions in &together {
            ok(|error| unsafe {
                sf_agents_observe_with(agents, &id, &states[idx], 1, Some(cast_at_ground), null_mut(), error)
            });
            let mut alone = Action::default();
            ok(|error| unsafe { sf_agents_decide(agents, &id, 1, 0.5, &mut alone, error) });
            assert_eq!(alone, actions[idx], "to the bit");
        }
    }
    unsafe { sf_agents_destroy(agents) };
}

#[test]
fn once_made_agents_allocate_nothing() {
    const COUNT: usize = 64;
    let (agents, states) = on_flat_ground(COUNT as u32);
    let mut rays = vec![Ray::default(); COUNT * RAY_COUNT];
    let (hits, mut actions) = (vec![Hit::default(); COUNT * RAY_COUNT], vec![Action::default(); COUNT]);
    let (mut bytes, mut size, mut arrived) = (vec![0u8; 1 << 12], 0, 0);
    let counted = allocation_counter::measure(|| {
        for _ in 0..3 {
            unsafe {
                let error = null_mut();
                assert_eq!(sf_agents_rays(agents, states.as_ptr(), COUNT, rays.as_mut_ptr(), rays.len(), error), 0);
                assert_eq!(sf_agents_observe(agents, null(), states.as_ptr(), hits.as_ptr(), COUNT, error), 0);
                assert_eq!(sf_agents_decide(agents, null(), COUNT, 0.5, actions.as_mut_ptr(), error), 0);
                assert_eq!(sf_agents_note(agents, 3, at(0.0, 0.0), null_mut(), error), 0);
                assert_eq!(sf_agents_set_goal(agents, 3, at(0.0, 0.0), at(9.0, 9.0), error), 0);
                let (state, goal) = (states.as_ptr(), states[0].feet);
                let status = sf_agents_arrival_rays(agents, state, goal, 1.0, rays.as_mut_ptr(), 2, &mut size, error);
                assert_eq!((status, size), (0, 2));
                assert_eq!(sf_agents_has_arrived(agents, state, goal, 1.0, hits.as_ptr(), &mut arrived, error), 0);
                let cast = Some(cast_at_ground as abi::CastRays);
                assert_eq!(sf_agents_observe_with(agents, null(), states.as_ptr(), COUNT, cast, null_mut(), error), 0);
                assert_eq!(sf_agents_save(agents, 3, bytes.as_mut_ptr().cast(), bytes.len(), &mut size, error), 0);
                assert_eq!(sf_agents_restore(agents, 3, bytes.as_ptr().cast(), size, error), 0);
            }
        }
    });
    assert_eq!(counted.count_total, 0);
    unsafe { sf_agents_destroy(agents) };
}

#[test]
fn a_goal_is_reached_between_decisions_and_progress_is_told() {
    let (agents, states) = on_flat_ground(1);
    let mut reached = 9;
    ok(|error| unsafe { sf_agents_note(agents, 0, at(0.0, 10.0), &mut reached, error) });
    assert_eq!(reached, 0);
    ok(|error| unsafe { sf_agents_note(agents, 0, at(0.5, 19.5), &mut reached, error) });
    assert_eq!(reached, 1);
    let mut progress = abi::Progress { struct_size: size_of::<abi::Progress>() as u32, ..abi::Progress::default() };
    ok(|error| unsafe { sf_agents_progress(agents, 0, &mut progress, error) });
    assert!(progress.reached == 1 && progress.best_distance < 1.0 && progress.decisions == 0);
    ok(|error| unsafe { sf_agents_set_goal(agents, 0, states[0].feet, at(0.0, 50.0), error) });
    ok(|error| unsafe { sf_agents_progress(agents, 0, &mut progress, error) });
    assert!(progress.reached == 0 && progress.best_distance == 50.0);
    unsafe { sf_agents_destroy(agents) };
}

/// Whether a character with these flags and this place of its feet has arrived at a goal, where its rays there end on
/// `hits`; and the number of its rays.
fn arrival(agents: *mut Handle<Agents>, (flags, feet): (u32, Vec3), goal: Vec3, hits: &[Hit]) -> (bool, usize) {
    let state = State { flags, feet, ..state() };
    let (mut rays, mut count, mut arrived) = ([Ray::default(); 2], 9, 9);
    ok(|error| unsafe { sf_agents_arrival_rays(agents, &state, goal, 1.0, rays.as_mut_ptr(), 2, &mut count, error) });
    for (ray, height) in rays.iter().zip([0.45, 1.35]).take(count) {
        assert!((ray.origin.y - feet.y - height).abs() < 1.0e-6, "{ray:?}");
    }
    let hits = if hits.is_empty() { null() } else { hits.as_ptr() };
    ok(|error| unsafe { sf_agents_has_arrived(agents, &state, goal, 1.0, hits, &mut arrived, error) });
    (arrived == 1, count)
}

#[test]
fn a_character_has_arrived_where_it_stands_and_nothing_solid_is_between() {
    let agents = agents(1);
    let above = |height: f32, x: f32| Vec3 { x, y: height, z: 0.0 };
    let goal = above(0.0, 0.0);
    let cases = [
        ("beside the goal", (abi::GROUNDED, above(0.0, 0.9)), (true, 2)),
        ("at the goal", (abi::GROUNDED, goal), (true, 2)),
        ("too far", (abi::GROUNDED, above(0.0, 1.1)), (false, 0)),
        ("in the air", (abi::CAN_JUMP, above(0.0, 0.5)), (false, 0)),
        ("on a crate", (abi::GROUNDED, above(0.8, 0.2)), (false, 0)),
        ("up to where a goal hangs above its ground", (abi::GROUNDED, above(-0.59, 0.0)), (true, 2)),
        ("on a slope", (abi::GROUNDED, above(0.65, 0.7)), (true, 2)),
    ];
    for (case, character, expected) in cases {
        assert_eq!(arrival(agents, character, goal, &[]), expected, "{case}");
    }
    let hit = |distance: f32, surface: i32| Hit { distance, body_distance: 0.1, surface };
    let hits = [
        ("nothing", hit(0.0, 0), true),
        ("a wall", hit(0.5, 1), false),
        ("a wall behind the goal", hit(0.85, 1), true),
        ("water", hit(0.5, 2), true),
    ];
    for (case, hit, expected) in hits {
        for hits in [[hit, Hit::default()], [Hit::default(), hit]] {
            assert_eq!(arrival(agents, (abi::GROUNDED, above(0.0, 0.8)), goal, &hits).0, expected, "{case}");
        }
    }
    let (state, mut arrived) = (state(), 0);
    let mut call = |radius, hits: &[Hit; 2], error| unsafe {
        sf_agents_has_arrived(agents, &state, goal, radius, hits.as_ptr(), &mut arrived, error)
    };
    fails(1, "radius is NaN, but must be 0 to 30", |error| call(f32::NAN, &[Hit::default(); 2], error));
    fails(1, "hits[1].distance is -1", |error| call(1.0, &[Hit::default(), hit(-1.0, 1)], error));
    fails(2, "rays has room for 1", |error| unsafe {
        let (mut ray, mut count) = (Ray::default(), 0);
        sf_agents_arrival_rays(agents, &state, goal, 1.0, &mut ray, 1, &mut count, error)
    });
    unsafe { sf_agents_destroy(agents) };
}

#[test]
fn a_goal_may_move_before_every_decision() {
    let (agents, states) = on_flat_ground(1);
    let observe = |error| unsafe {
        sf_agents_observe_with(agents, null(), &states[0], 1, Some(cast_at_ground), null_mut(), error)
    };
    let mut actions = [Action::default(); 6];
    let decide = |action: &mut Action, error| unsafe { sf_agents_decide(agents, null(), 1, 0.0, action, error) };
    for (decision, action) in (0..).zip(&mut actions) {
        let goal = at(0.2 * decision as f32, 20.0);
        ok(|error| unsafe { sf_agents_set_goal(agents, 0, states[0].feet, goal, error) });
        ok(observe);
        ok(|error| decide(action, error));
    }
    assert!(actions.iter().all(|action| action.forward > 0.5), "{actions:?}");
    ok(observe);
    ok(|error| unsafe { sf_agents_set_goal(agents, 0, states[0].feet, at(1.4, 20.0), error) });
    fails(6, "agent 0 was not observed", |error| decide(&mut actions[0], error));
    ok(observe);
    ok(|error| decide(&mut actions[0], error));
    unsafe { sf_agents_destroy(agents) };
}

#[test]
fn what_is_wrong_with_a_call_is_said() {
    let (agents, states) = on_flat_ground(2);
    let (hits, mut actions) = ([Hit::default(); 2 * RAY_COUNT], [Action::default(); 2]);
    let mut rays = [Ray::default(); 2 * RAY_COUNT];
    let nothing: *const Handle<Agents> = null();
    fails(1, "agents is NULL", |error| unsafe { sf_agents_rays(nothing, null(), 1, rays.as_mut_ptr(), 64, error) });
    fails(1, "states[] is NULL", |error| unsafe { sf_agents_rays(agents, null(), 1, rays.as_mut_ptr(), 64, error) });
    fails(2, "rays has room for 64, but 2 agents", |error| unsafe {
        sf_agents_rays(agents, states.as_ptr(), 2, rays.as_mut_ptr(), 64, error)
    });
    fails(1, "not aligned", |error| unsafe {
        sf_agents_rays(agents, states.as_ptr().byte_add(1), 1, rays.as_mut_ptr(), 64, error)
    });
    fails(1, "count is 3, but there are 2 agents", |error| unsafe {
        sf_agents_observe(agents, null(), states.as_ptr(), hits.as_ptr(), 3, error)
    });
    fails(1, "agent 7 does not exist", |error| unsafe {
        sf_agents_observe(agents, &7, states.as_ptr(), hits.as_ptr(), 1, error)
    });
    fails(1, "cast_rays is NULL", |error| unsafe {
        sf_agents_observe_with(agents, null(), states.as_ptr(), 1, None, null_mut(), error)
    });
    fails(6, "agent 0 was not observed", |error| unsafe {
        sf_agents_decide(agents, null(), 1, 0.5, actions.as_mut_ptr(), error)
    });
    let observe = |states: &[State], hits: &[Hit], error| unsafe {
        sf_agents_observe(agents, null(), states.as_ptr(), hits.as_ptr(), 1, error)
    };
    type Spoil = fn(&mut State, &mut Hit);
    let spoilt: [(&str, Spoil); 9] = [
        ("states[].struct_size is 0", |state, _| state.struct_size = 0),
        ("state.feet is (NaN, 0, 0)", |state, _| state.feet.x = f32::NAN),
        ("state.velocity is", |state, _| state.velocity.y = f32::INFINITY),
        ("state.yaw is", |state, _| state.yaw = f32::NAN),
        ("state.breath_used is 2", |state, _| state.breath_used = 2.0),
        ("state.flags is 64", |state, _| state.flags = 64),
        ("state.other_count is 65", |state, _| state.other_count = 65),
        ("surface is 9", |_, hit| hit.surface = 9),
        ("hits[0].distance is -1", |_, hit| *hit = Hit { distance: -1.0, body_distance: 0.0, surface: 1 }),
    ];
    for (text, spoil) in spoilt {
        let (mut state, mut hits) = (states[0], hits);
        spoil(&mut state, &mut hits[0]);
        fails(1, text, |error| observe(&[state], &hits, error));
    }
    ok(|error| observe(&states, &hits, error));
    fails(1, "noise_share is NaN", |error| unsafe {
        sf_agents_decide(agents, null(), 1, f32::NAN, actions.as_mut_ptr(), error)
    });
    fails(1, "actions is NULL", |error| unsafe { sf_agents_decide(agents, null(), 1, 0.0, null_mut(), error) });
    ok(|error| unsafe { sf_agents_decide(agents, null(), 1, 0.0, actions.as_mut_ptr(), error) });
    ok(|error| unsafe { sf_agents_begin(agents, 1, 0, error) });
    fails(6, "agent 1 has no goal", |error| unsafe {
        sf_agents_observe(agents, &1, states.as_ptr(), hits.as_ptr(), 1, error)
    });
    fails(1, "goal is (inf, 0, 0)", |error| unsafe {
        sf_agents_set_goal(agents, 0, at(0.0, 0.0), at(f32::INFINITY, 0.0), error)
    });
    fails(4, "not an agent", |error| unsafe {
        let mut size = 0;
        sf_agents_save(agents, 0, null_mut(), 0, &mut size, null_mut());
        sf_agents_restore(agents, 0, vec![255u8; size].as_ptr().cast(), size, error)
    });
    // Programs that were compiled with a later header work as long as they do not use what this library lacks.
    let mut later = [states[0]; 2];
    later[0].struct_size = size_of_val(&later) as u32;
    later[1] = unsafe { std::mem::zeroed() };
    ok(|error| observe(&later, &hits, error));
    later[1].flags = 1;
    fails(1, "states[] uses fields of a later version of sf_state", |error| observe(&later, &hits, error));
    ok(|error| unsafe { sf_agents_decide(agents, null(), 1, 0.0, actions.as_mut_ptr(), error) });
    let status = unsafe { sf_agents_decide(agents, null(), 1, 0.0, actions.as_mut_ptr(), null_mut()) };
    assert_eq!(status, 6, "errors without a text are allowed");
    unsafe {
        sf_agents_destroy(agents);
        sf_agents_destroy(null_mut());
    }
}

/// Calls the agents from which it is called.
unsafe extern "C" fn cast_and_call_back(user: *mut c_void, _: *const Ray, _: usize, _: *mut Hit) {
    let agents: *mut Handle<Agents> = user.cast();
    fails(5, "another call with agents is running", |error| unsafe { sf_agents_begin(agents, 0, 0, error) });
}

#[test]
fn a_handle_that_is_in_use_is_busy() {
    let (agents, states) = on_flat_ground(1);
    ok(|error| unsafe {
        sf_agents_observe_with(agents, null(), states.as_ptr(), 1, Some(cast_and_call_back), agents.cast(), error)
    });
    unsafe { sf_agents_destroy(agents) };
}

#[test]
fn policies_are_loaded_from_folders_and_memory_or_refused_with_the_reason() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/general-lstm\0");
    let loaded = handle(|out, error| unsafe { sf_policy_load(folder.as_ptr().cast(), out, error) });
    let (mut observation_len, mut memory_len) = (0, 0);
    ok(|error| unsafe { sf_policy_lengths(loaded, &mut observation_len, &mut memory_len, error) });
    assert!(observation_len == 369 && memory_len > 0);
    let (mut label, mut length) = ([0; 64], 0);
    ok(|error| unsafe { sf_policy_label(loaded, label.as_mut_ptr(), label.len(), &mut length, error) });
    assert!(length > 12 && label[length - 1] == 0);
    unsafe { sf_policy_destroy(loaded) };

    let read =
        |name: &str| std::fs::read(folder.trim_end_matches('\0').to_owned() + "/" + name).expect("a model's file");
    let (manifest, weights) = (read("manifest.json"), read("weights.bpk"));
    let load = |manifest: &[u8], weights: &[u8], error| unsafe {
        let mut policy = null_mut();
        let (manifest, weights) =
            ((manifest.as_ptr().cast(), manifest.len()), (weights.as_ptr().cast(), weights.len()));
        let status = sf_policy_load_memory(manifest.0, manifest.1, weights.0, weights.1, &mut policy, error);
        sf_policy_destroy(policy);
        status
    };
    ok(|error| load(&manifest, &weights, error));
    fails(4, "weights are damaged", |error| load(&manifest, &weights[..weights.len() / 2], error));
    fails(4, "manifest is not", |error| load(&manifest[..40], &weights, error));
    fails(3, "cannot read", |error| unsafe { sf_policy_load(c"nowhere".as_ptr(), &mut null_mut(), error) });
    fails(3, "no policy swimmer", |error| unsafe { sf_policy_shipped(c"swimmer".as_ptr(), &mut null_mut(), error) });
    fails(1, "path is not UTF-8", |error| unsafe { sf_policy_load(c"\xff".as_ptr(), &mut null_mut(), error) });

    let policy = policy();
    let create = |body: *const abi::Body, count, error| unsafe {
        let mut agents = null_mut();
        let status = sf_agents_create(policy, body, count, &mut agents, error);
        sf_agents_destroy(agents);
        status
    };
    let mut body: abi::Body = unsafe { std::mem::zeroed() };
    ok(|error| unsafe { sf_body_default(&mut body, error) });
    ok(|error| create(&body, 1, error));
    fails(1, "max_agents is 0", |error| create(&body, 0, error));
    body.height = f32::NAN;
    fails(1, "body.height is NaN, but must be 0.6 to 4", |error| create(&body, 1, error));
    (body.height, body.extra_jumps) = (1.8, 256);
    fails(1, "body.extra_jumps is 256", |error| create(&body, 1, error));
    body.struct_size = 1;
    fails(1, "body.struct_size is 1: set it to sizeof(sf_body)", |error| create(&body, 1, error));
    unsafe { sf_policy_destroy(policy) };
}
