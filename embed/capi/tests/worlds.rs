//! Worlds through the C functions: a rollback repeats itself to the bit.
#![expect(unsafe_code, reason = "calls C functions")]

use crate::stage::{agents, at, fails, graph, handle, map, ok, state, step, world};
use std::mem::offset_of;
use std::ptr::{null, null_mut};
use surefoot::abi::{Action, Hit, Locomotion, Outcome, RAY_COUNT, State, Vec3};
use surefoot::exports::*;
use surefoot::{Agents, Follower, Graph, Snapshot, World};

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

/// NPCs that follow plans in a world of the library, with the agents and the followers that decide for them.
struct Crowd {
    world: *mut Handle<World>,
    snapshot: *mut Handle<Snapshot>,
    graph: *mut Shared<Graph>,
    agents: *mut Handle<Agents>,
    followers: Vec<[*mut Handle<Follower>; 2]>,
    saved: Vec<Vec<u8>>,
}

impl Crowd {
    fn new(count: u32) -> Self {
        let (world, graph) = (world(&map()), graph());
        let mut followers = Vec::new();
        let agents = agents(count);
        for npc in 0..count {
            let (start, goal) = (Vec3 { y: 60.0, ..at(20.0 + npc as f32, 20.0) }, at(80.0, 10.0 * npc as f32 + 20.0));
            let mut slot = 9;
            ok(|error| unsafe { sf_world_spawn(world, start, 0.0, &mut slot, error) });
            assert_eq!(slot, npc);
            ok(|error| unsafe { sf_world_set_goal(world, npc, goal, error) });
            ok(|error| unsafe { sf_agents_begin(agents, npc, 5, error) });
            let pair = [(); 2].map(|()| handle(|out, error| unsafe { sf_follower_create(goal, out, error) }));
            ok(|error| unsafe { sf_follower_plan(pair[0], graph, start, 1.0, 0, &mut step(), error) });
            followers.push(pair);
        }
        let snapshot = handle(|out, error| unsafe { sf_snapshot_create(out, error) });
        Self { world, snapshot, graph, agents, followers, saved: Vec::new() }
    }

    /// Runs one decision of all NPCs, and returns what can be seen of them.
    fn decide(&mut self) -> Vec<[u32; 6]> {
        let mut seen = Vec::new();
        let ids: Vec<u32> = (0..self.followers.len() as u32).collect();
        let states: Vec<State> = ids.iter().map(|npc| state_of(self.world, *npc)).collect();
        let mut hits = vec![Hit::default(); states.len() * RAY_COUNT];
        for (npc, hits) in ids.iter().zip(hits.chunks_mut(RAY_COUNT)) {
            ok(|error| unsafe { sf_world_look(self.world, *npc, hits.as_mut_ptr(), RAY_COUNT, error) });
        }
        let mut actions = vec![Action::default(); states.len()];
        let count = states.len();
        for ((npc, state), [follower, _]) in ids.iter().zip(&states).zip(&self.followers) {
            let mut next = step();
            ok(|error| unsafe { sf_follower_advance(*follower, state.feet, 0, &mut next, error) });
            if next.kind == 2 {
                ok(|error| unsafe { sf_follower_plan(*follower, self.graph, state.feet, 1.0, 0, &mut next, error) });
            }
            ok(|error| unsafe { sf_agents_set_goal(self.agents, *npc, state.feet, next.waypoint, error) });
            seen.push([next.kind as u32, next.leg, next.plans, 0, 0, 0]);
        }
        ok(|error| unsafe {
            sf_agents_observe(self.agents, ids.as_ptr(), states.as_ptr(), hits.as_ptr(), count, error)
        });
        ok(|error| unsafe { sf_agents_decide(self.agents, ids.as_ptr(), count, 1.0, actions.as_mut_ptr(), error) });
        let mut outcomes = vec![Outcome::default(); count];
        ok(|error| unsafe {
            sf_world_step(self.world, ids.as_ptr(), actions.as_ptr(), outcomes.as_mut_ptr(), count, error)
        });
        for (npc, seen) in ids.iter().zip(&mut seen) {
            let Vec3 { x, y, z } = state_of(self.world, *npc).feet;
            [seen[3], seen[4], seen[5]] = [x, y, z].map(f32::to_bits);
        }
        seen
    }

    fn save(&mut self) {
        ok(|error| unsafe { sf_world_save(self.world, self.snapshot, error) });
        self.saved.clear();
        for (npc, [follower, copy]) in (0..).zip(&self.followers) {
            let (mut bytes, mut size) = (vec![0u8; 1 << 14], 0);
            let room = bytes.len();
            ok(|error| unsafe { sf_agents_save(self.agents, npc, bytes.as_mut_ptr().cast(), room, &mut size, error) });
            bytes.truncate(size);
            self.saved.push(bytes);
            ok(|error| unsafe { sf_follower_copy(*follower, *copy, error) });
        }
    }

    fn restore(&mut self) {
        ok(|error| unsafe { sf_world_restore(self.world, self.snapshot, error) });
        for ((npc, [follower, copy]), bytes) in (0..).zip(&self.followers).zip(&self.saved) {
            ok(|error| unsafe { sf_agents_restore(self.agents, npc, bytes.as_ptr().cast(), bytes.len(), error) });
            ok(|error| unsafe { sf_follower_copy(*copy, *follower, error) });
        }
    }
}

impl Drop for Crowd {
    fn drop(&mut self) {
        unsafe {
            self.followers.iter().flatten().for_each(|follower| sf_follower_destroy(*follower));
            sf_agents_destroy(self.agents);
            sf_graph_destroy(self.graph);
            sf_snapshot_destroy(self.snapshot);
            sf_world_destroy(self.world);
        }
    }
}

#[test]
fn npcs_with_their_attempts_repeat_themselves_after_a_rollback() {
    let mut crowd = Crowd::new(6);
    // Some lack progress for long, and take another plan.
    (0..30).for_each(|_| _ = crowd.decide());
    crowd.save();
    let first: Vec<_> = (0..60).map(|_| crowd.decide()).collect();
    crowd.restore();
    let again: Vec<_> = (0..60).map(|_| crowd.decide()).collect();
    assert_eq!(first, again);
    let (begin, end) = (&first[0], &first[59]);
    assert!(begin.iter().zip(end).any(|(begin, end)| begin[2] < end[2]), "some plan again: {end:?}");
    let moving = begin.iter().zip(end).filter(|(begin, end)| begin[3..] != end[3..]);
    assert!(moving.count() >= 3, "most move: {begin:?} {end:?}");
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
