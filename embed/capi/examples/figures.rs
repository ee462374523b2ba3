//! Speed of the C functions on this machine: medians, beside the same work by the crates that the services use.
//!
//!     cargo run --release -p surefoot-capi --example figures -- LEVEL GRAPH
#![expect(unsafe_code, reason = "calls C functions")]

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::ffi::CString;
use std::hint::black_box;
use std::ptr::{null, null_mut};
use std::time::Instant;
use surefoot::abi::{Action, Hit, Leg, Query, RAY_COUNT, Ray, State, Step, Vec3};
use surefoot::exports::*;
use surefoot::{Graph, Map, Policy, Rehearsals};
use surefoot_planner::Router;
use surefoot_planner::export::import_json;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;

/// Median duration of a call of `run`, us, over many calls.
fn median_us(mut run: impl FnMut()) -> f64 {
    (0..200).for_each(|_| run());
    let mut times: Vec<f64> = (0..4000)
        .map(|_| {
            let started = Instant::now();
            run();
            started.elapsed().as_secs_f64() * 1.0e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn print(name: &str, us: f64, target: Option<f64>, reference: Option<(&str, f64)>) {
    let target = target.map_or(String::new(), |target| format!(", target {target}"));
    let reference =
        reference.map_or(String::new(), |(name, other)| format!(", {name} {other:.2} us ({:.2} x)", other / us));
    println!("{name:<40} {us:>8.2} us{target}{reference}");
}

fn ok(status: i32) {
    assert_eq!(status, 0, "a call that succeeds");
}

fn handle<T>(make: impl FnOnce(*mut *mut T) -> i32) -> *mut T {
    let mut handle = null_mut();
    ok(make(&mut handle));
    handle
}

/// Decisions of many agents: the network alone, and with what is around it.
fn decisions(name: &str) {
    let text = CString::new(name).expect("a name");
    let policy = handle(|out| unsafe { sf_policy_shipped(text.as_ptr(), out, null_mut()) });
    for count in [1usize, 64] {
        let agents = handle(|out| unsafe { sf_agents_create(policy, null(), count as u32, out, null_mut()) });
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let states: Vec<State> = (0..count).map(|_| state(&mut rng)).collect();
        let hits: Vec<Hit> = (0..count * RAY_COUNT)
            .map(|_| Hit {
                distance: rng.random_range(0.5..40.0),
                body_distance: 0.0,
                surface: 1 + i32::from(rng.random::<f32>() < 0.05),
            })
            .collect();
        for (idx, state) in (0..).zip(&states) {
            let goal = Vec3 { x: rng.random_range(0.0..99.0), ..state.feet };
            ok(unsafe { sf_agents_set_goal(agents, idx, state.feet, goal, null_mut()) });
        }
        let mut rays = vec![Ray::default(); count * RAY_COUNT];
        let mut actions = vec![Action::default(); count];
        let observe =
            || ok(unsafe { sf_agents_observe(agents, null(), states.as_ptr(), hits.as_ptr(), count, null_mut()) });
        let observe_us = median_us(observe);
        let rays_us = median_us(|| {
            ok(unsafe { sf_agents_rays(agents, states.as_ptr(), count, rays.as_mut_ptr(), rays.len(), null_mut()) })
        });
        // Agents decide once for each observation.
        let both_us = median_us(|| {
            observe();
            ok(unsafe { sf_agents_decide(agents, null(), count, 0.5, actions.as_mut_ptr(), null_mut()) });
        });
        let each = count as f64;
        let target = if count == 1 { 50.0 } else { 5.0 };
        let decide_us = (both_us - observe_us) / each;
        print(&format!("{name}: decide, {count}, each"), decide_us, Some(target), None);
        print(&format!("{name}: observe, {count}, each"), observe_us / each, None, None);
        print(&format!("{name}: rays, {count}, each"), rays_us / each, None, None);
        unsafe { sf_agents_destroy(agents) };
    }
    unsafe { sf_policy_destroy(policy) };
}

fn state(rng: &mut ChaCha8Rng) -> State {
    let mut draw = || Vec3 { x: rng.random_range(-5.0..5.0), y: 0.0, z: rng.random_range(-5.0..5.0) };
    State {
        struct_size: size_of::<State>() as u32,
        flags: 1,
        feet: draw(),
        velocity: draw(),
        yaw: draw().x,
        breath_used: 0.0,
        jetpack_seconds: 0.0,
        other_count: 0,
        others: null(),
    }
}

/// Plans between random places.
fn plans(path: &str) {
    let text = std::fs::read_to_string(path).expect("a graph");
    let router = Router::new(import_json(&text).expect("a graph"), DEFAULT_LABEL_LIMIT, 1);
    let path = CString::new(path).expect("a path");
    let graph = handle(|out| unsafe { sf_graph_load(path.as_ptr(), out, null_mut()) });
    let vertices: Vec<Vec3> = router.graph().vertices().map(|vertex| router.graph().position(vertex).into()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut place = || {
        let at = vertices[rng.random_range(0..vertices.len())];
        Vec3 { x: at.x + 2.0, ..at }
    };
    let queries: Vec<(Vec3, Vec3)> = (0..1000).map(|_| (place(), place())).collect();
    let (mut legs, mut count) = (vec![Leg::default(); 1024], 0);
    let mut next = (0..1000).cycle();
    let ours = median_us(|| {
        let (start, goal) = queries[next.next().expect("a cycle")];
        let query = Query {
            struct_size: size_of::<Query>() as u32,
            without: 0,
            start,
            goal,
            caution: 1.0,
            avoid_count: 0,
            avoid: null(),
        };
        ok(unsafe {
            sf_graph_find_path(graph, &query, legs.as_mut_ptr(), legs.len(), &mut count, null_mut(), null_mut())
        });
    });
    let vector = |at: Vec3| surefoot_world::Vec3::new(at.x, at.y, at.z);
    let theirs = median_us(|| {
        let (start, goal) = queries[next.next().expect("a cycle")];
        black_box(router.find_path(&surefoot_planner::Query::new(vector(start), vector(goal))));
    });
    print(&format!("plan, {} vertices", vertices.len()), ours, Some(5.0), Some(("planner", theirs)));
    unsafe { sf_graph_destroy(graph) };
}

/// Ticks that a game with rollback netcode runs again.
const ROLLED_BACK: usize = 8;

/// Rollbacks of NPCs with their agents and attempts.
fn rollbacks(level: &str, graph: &str) {
    let text = std::fs::read_to_string(graph).expect("a graph");
    let graph = import_json(&text).expect("a graph");
    let places: Vec<Vec3> = graph.vertices().map(|vertex| graph.position(vertex).into()).collect();
    let (level, name) = (CString::new(level).expect("a path"), CString::new("general-lstm").expect("a name"));
    let map = handle(|out| unsafe { sf_map_load(level.as_ptr(), out, null_mut()) });
    let policy = handle(|out| unsafe { sf_policy_shipped(name.as_ptr(), out, null_mut()) });
    for (count, target) in [(1u32, None), (64, Some(4000.0))] {
        let world = handle(|out| unsafe { sf_world_create(map, null(), out, null_mut()) });
        let snapshot = handle(|out| unsafe { sf_snapshot_create(out, null_mut()) });
        let agents = handle(|out| unsafe { sf_agents_create(policy, null(), count, out, null_mut()) });
        let (mut followers, mut size) = (Vec::new(), 0);
        for (npc, ends) in (0..count).zip(places.windows(2)) {
            let mut slot = 0;
            ok(unsafe { sf_world_spawn(world, ends[0], 0.0, &mut slot, null_mut()) });
            ok(unsafe { sf_world_set_goal(world, slot, ends[1], null_mut()) });
            ok(unsafe { sf_agents_begin(agents, npc, 1, null_mut()) });
            let action = Action { forward: 1.0, strafe: 0.0, turn: 0.2, jump: -1.0 };
            ok(unsafe { sf_world_decide(world, slot, action, null_mut()) });
            let create = |()| handle(|out| unsafe { sf_follower_create(ends[1], out, null_mut()) });
            followers.push([(); 2].map(create));
            unsafe { sf_agents_save(agents, npc, null_mut(), 0, &mut size, null_mut()) };
        }
        let mut saved = vec![vec![0u8; size]; count as usize];
        let us = median_us(|| {
            ok(unsafe { sf_world_save(world, snapshot, null_mut()) });
            for ((npc, bytes), [follower, copy]) in (0..).zip(&mut saved).zip(&followers) {
                ok(unsafe { sf_agents_save(agents, npc, bytes.as_mut_ptr().cast(), size, &mut size, null_mut()) });
                ok(unsafe { sf_follower_copy(*follower, *copy, null_mut()) });
            }
            (0..ROLLED_BACK).for_each(|_| ok(unsafe { sf_world_tick(world, null_mut(), null_mut()) }));
            ok(unsafe { sf_world_restore(world, snapshot, null_mut()) });
            for ((npc, bytes), [follower, copy]) in (0..).zip(&saved).zip(&followers) {
                ok(unsafe { sf_agents_restore(agents, npc, bytes.as_ptr().cast(), bytes.len(), null_mut()) });
                ok(unsafe { sf_follower_copy(*copy, *follower, null_mut()) });
            }
        });
        print(&format!("save, {ROLLED_BACK} ticks, restore, {count} NPCs"), us, target, None);
        unsafe {
            followers.into_iter().flatten().for_each(|follower| sf_follower_destroy(follower));
            sf_agents_destroy(agents);
            sf_snapshot_destroy(snapshot);
            sf_world_destroy(world);
        }
    }
    unsafe {
        sf_policy_destroy(policy);
        sf_map_destroy(map);
    }
}

/// Walks of an NPC along plans, with rehearsals in the calls and on a thread.
fn rehearsals(level: &str, graph: &str) {
    let (level, path) = (CString::new(level).expect("a path"), CString::new(graph).expect("a path"));
    let text = std::fs::read_to_string(graph).expect("a graph");
    let vertices = import_json(&text).expect("a graph");
    let places: Vec<Vec3> = vertices.vertices().map(|vertex| vertices.position(vertex).into()).collect();
    let map = handle(|out| unsafe { sf_map_load(level.as_ptr(), out, null_mut()) });
    let policy = handle(|out| unsafe { sf_policy_shipped(null(), out, null_mut()) });
    let graph = handle(|out| unsafe { sf_graph_load(path.as_ptr(), out, null_mut()) });
    for thread_count in [0, 1] {
        let rehearsals =
            handle(|out| unsafe { sf_rehearsals_create(policy, map, null(), thread_count, out, null_mut()) });
        let walk = Walk { map, policy, graph, rehearsals, is_paced: thread_count > 0 };
        let (mut decisions, mut legs, mut us) = (0, 0, 0.0);
        for idx in 0..40 {
            let ends = [idx * 7, idx * 7 + places.len() / 2].map(|at| places[at % places.len()]);
            let (more_decisions, more_legs, more_us) = walk.run(ends);
            (decisions, legs, us) = (decisions + more_decisions, legs + more_legs, us + more_us);
        }
        match thread_count {
            0 => print("rehearse in calls, each leg", us / f64::from(legs), Some(1000.0), None),
            _ => print("prepare, rehearsals on a thread, each", us / f64::from(decisions), None, None),
        }
        unsafe { sf_rehearsals_destroy(rehearsals) };
    }
    unsafe {
        sf_graph_destroy(graph);
        sf_policy_destroy(policy);
        sf_map_destroy(map);
    }
}

/// What a walk needs.
struct Walk {
    map: *mut Map,
    policy: *mut Policy,
    graph: *mut Shared<Graph>,
    rehearsals: *mut Rehearsals,
    /// Whether decisions take their time, as in a game.
    is_paced: bool,
}

impl Walk {
    /// Walks for up to 20 s. Returns the number of decisions and of legs, and the time spent on preparing, us.
    fn run(&self, [start, goal]: [Vec3; 2]) -> (u32, u32, f64) {
        let world = handle(|out| unsafe { sf_world_create(self.map, null(), out, null_mut()) });
        let agents = handle(|out| unsafe { sf_agents_create(self.policy, null(), 1, out, null_mut()) });
        let follower = handle(|out| unsafe { sf_follower_create(goal, out, null_mut()) });
        let (mut npc, mut decisions, mut legs, mut us, mut reached) = (0, 0, 0, 0.0, false);
        ok(unsafe { sf_world_spawn(world, start, 0.0, &mut npc, null_mut()) });
        let mut step = Step { struct_size: size_of::<Step>() as u32, ..Step::default() };
        let mut state = state(&mut ChaCha8Rng::seed_from_u64(0));
        while decisions < 120 {
            ok(unsafe { sf_world_state(world, npc, &mut state, null_mut()) });
            ok(unsafe { sf_follower_advance(follower, state.feet, reached.into(), &mut step, null_mut()) });
            legs += u32::from(step.kind == 1);
            let mut is_prepared = false;
            while !is_prepared || step.kind != 0 {
                match step.kind {
                    1 => ok(unsafe { sf_agents_set_goal(agents, 0, state.feet, step.waypoint, null_mut()) }),
                    2 => {
                        ok(unsafe {
                            sf_follower_plan(follower, self.graph, state.feet, 1.0, 0, &mut step, null_mut())
                        });
                        ok(unsafe { sf_agents_set_goal(agents, 0, state.feet, step.waypoint, null_mut()) });
                    }
                    3.. => break,
                    _ => {}
                }
                let started = Instant::now();
                let (origin, by) = (Vec3::default(), self.rehearsals);
                ok(unsafe { sf_follower_prepare(follower, by, agents, 0, &state, origin, &mut step, null_mut()) });
                us += started.elapsed().as_secs_f64() * 1.0e6;
                is_prepared = true;
            }
            if step.kind != 0 || distance(state.feet, goal) <= 1.0 {
                break;
            }
            let (mut hits, mut action) = ([Hit::default(); RAY_COUNT], Action::default());
            ok(unsafe { sf_world_look(world, npc, hits.as_mut_ptr(), RAY_COUNT, null_mut()) });
            ok(unsafe { sf_agents_observe(agents, null(), &state, hits.as_ptr(), 1, null_mut()) });
            ok(unsafe { sf_agents_decide(agents, null(), 1, 0.5, &mut action, null_mut()) });
            ok(unsafe { sf_world_decide(world, npc, action, null_mut()) });
            reached = false;
            for _ in 0..10 {
                ok(unsafe { sf_world_tick(world, null_mut(), null_mut()) });
                ok(unsafe { sf_world_state(world, npc, &mut state, null_mut()) });
                reached |= distance(state.feet, step.waypoint) <= 1.0;
            }
            if self.is_paced {
                std::thread::sleep(std::time::Duration::from_millis(20));
            }
            decisions += 1;
        }
        unsafe {
            sf_follower_destroy(follower);
            sf_agents_destroy(agents);
            sf_world_destroy(world);
        }
        (decisions, legs, us)
    }
}

fn distance(a: Vec3, b: Vec3) -> f32 {
    ((a.x - b.x).powi(2) + (a.y - b.y).powi(2) + (a.z - b.z).powi(2)).sqrt()
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [level, graph] = &arguments[..] else { panic!("usage: figures LEVEL GRAPH") };
    decisions("general-reactive");
    decisions("general-lstm");
    plans(graph);
    rollbacks(level, graph);
    rehearsals(level, graph);
}
