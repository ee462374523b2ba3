//! Rehearsals through the C functions: in a game, NPCs arrive as on a server, and move as calmly.
#![expect(unsafe_code, reason = "calls C functions")]

use crate::stage::{agents, fails, handle, level, load_graph, map, ok, policy, state, step, world};
use std::ptr::null;
use std::sync::Arc;
use surefoot::abi::{Action, Block, Body, Gait, Hit, RAY_COUNT, State, Vec3};
use surefoot::exports::*;
use surefoot::{Agents, Follower, Graph, Rehearsals, World};
use surefoot_levels::{ImportOptions, NoFiles};
use surefoot_planner::export::{About, Format, export_about};
use surefoot_planner::{BuildSettings, Progress};
use surefoot_policy::Policy;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::graphs::build;
use surefoot_world::map::{Piece, PieceShape};
use surefoot_world::{CharacterProfile, Map};

/// Places are on the map.
const ORIGIN: Vec3 = Vec3 { x: 0.0, y: 0.0, z: 0.0 };
/// Goals that are walked to.
const GOALS: usize = 8;

/// A level with its graph, a world on it as the game, and one NPC.
struct Game {
    world: *mut Handle<World>,
    graph: *mut Shared<Graph>,
    agents: *mut Handle<Agents>,
    rehearsals: Option<*mut Rehearsals>,
    vertices: Vec<Vec3>,
}

/// 60 by 20 m of level floor.
fn floor() -> Map {
    let text = "v 0 0 0\nv 60 0 0\nv 60 0 20\nv 0 0 20\nf 4 3 2 1\n";
    surefoot_levels::read_level(text.as_bytes(), None, &ImportOptions::default(), &NoFiles).expect("a level").map
}

/// What was seen of all walks.
#[derive(Debug, Default, PartialEq)]
struct Seen {
    arrived: usize,
    decisions: u32,
    jumps: u32,
    /// Angles by which the NPC turned, rad.
    turned: f32,
}

fn rehearsals_on(map: &Map, thread_count: u32) -> *mut Rehearsals {
    let (policy, level) = (policy(), level(map));
    let made = handle(|out, error| unsafe { sf_rehearsals_create(policy, level, null(), thread_count, out, error) });
    unsafe {
        sf_map_destroy(level);
        sf_policy_destroy(policy);
    }
    made
}

impl Game {
    fn new(thread_count: Option<u32>) -> Self {
        Self::on(map(), thread_count)
    }

    fn on(map: Map, thread_count: Option<u32>) -> Self {
        let map = Arc::new(map);
        let policy = Policy::shipped_named("general-reactive").expect("it ships").expect("sound weights");
        let context = ProbeContext { map: map.clone(), profile: CharacterProfile::default(), policy };
        let settings = BuildSettings::default().with(|raw| raw.vertices = 100).expect("in range");
        let built = build(&context, &settings, 2, &Progress::default()).expect("a graph");
        let text = export_about(&built.graph, Format::Json, About { frame: None, body: None });
        let vertices = built.graph.vertices().map(|vertex| built.graph.position(vertex).into()).collect();
        let rehearsals = thread_count.map(|count| rehearsals_on(&map, count));
        Self { world: world(&map), graph: load_graph(&text), agents: agents(1), rehearsals, vertices }
    }

    /// Walks to all goals.
    fn walk(&self) -> Seen {
        let mut seen = Seen::default();
        for idx in 0..GOALS {
            let places = [idx * 7, idx * 7 + self.vertices.len() / 2].map(|at| self.vertices[at % self.vertices.len()]);
            seen.arrived += usize::from(self.walk_to(places, None, &mut seen));
        }
        seen
    }

    fn state(&self, npc: u32) -> State {
        let mut state = state();
        ok(|error| unsafe { sf_world_state(self.world, npc, &mut state, error) });
        state
    }

    /// Walks from one place to another, and returns whether the NPC arrived.
    fn walk_to(&self, [start, goal]: [Vec3; 2], gait: Option<Gait>, seen: &mut Seen) -> bool {
        let follower: *mut Handle<Follower> = handle(|out, error| unsafe { sf_follower_create(goal, out, error) });
        let mut npc = 9;
        ok(|error| unsafe { sf_world_spawn(self.world, start, 0.0, &mut npc, error) });
        ok(|error| unsafe { sf_agents_begin(self.agents, 0, 3, error) });
        let (mut next, mut reached, mut has_arrived) = (step(), false, false);
        if let Some(gait) = gait {
            ok(|error| unsafe { sf_follower_set_gait(follower, &gait, &mut next, error) });
        }
        for _ in 0..1200 {
            let state = self.state(npc);
            if distance(state.feet, goal) <= 1.0 && state.flags & 1 != 0 {
                has_arrived = true;
                break;
            }
            ok(|error| unsafe { sf_follower_advance(follower, state.feet, reached.into(), &mut next, error) });
            if !self.prepare(follower, &state, &mut next) {
                break;
            }
            let action = self.decide(npc, &state);
            seen.decisions += 1;
            seen.jumps += u32::from(action.jump > 0.0);
            seen.turned += action.turn.abs();
            reached = self.act(npc, action, &next);
        }
        ok(|error| unsafe { sf_world_despawn(self.world, npc, error) });
        unsafe { sf_follower_destroy(follower) };
        has_arrived
    }

    /// Does what the steps say until the next decision is prepared, and returns whether the attempt goes on.
    fn prepare(&self, follower: *mut Handle<Follower>, state: &State, next: &mut surefoot::abi::Step) -> bool {
        let mut is_prepared = false;
        while !is_prepared || next.kind != 0 {
            if next.kind >= 3 {
                return false;
            }
            if next.kind == 2 {
                ok(|error| unsafe { sf_follower_plan(follower, self.graph, state.feet, 1.0, 0, next, error) });
            }
            if next.kind == 1 {
                ok(|error| unsafe { sf_agents_set_goal(self.agents, 0, state.feet, next.waypoint, error) });
            }
            is_prepared = true;
            let Some(rehearsals) = self.rehearsals else { break };
            ok(|error| unsafe {
                sf_follower_prepare(follower, rehearsals, self.agents, 0, state, ORIGIN, next, error)
            });
        }
        true
    }

    fn decide(&self, npc: u32, state: &State) -> Action {
        let (mut hits, mut action) = ([Hit::default(); RAY_COUNT], Action::default());
        ok(|error| unsafe { sf_world_look(self.world, npc, hits.as_mut_ptr(), RAY_COUNT, error) });
        ok(|error| unsafe { sf_agents_observe(self.agents, null(), state, hits.as_ptr(), 1, error) });
        ok(|error| unsafe { sf_agents_decide(self.agents, null(), 1, 0.5, &mut action, error) });
        action
    }

    /// Runs the ticks of a decision, and returns whether the NPC came to its waypoint.
    fn act(&self, npc: u32, action: Action, next: &surefoot::abi::Step) -> bool {
        let mut reached = false;
        ok(|error| unsafe { sf_world_decide(self.world, npc, action, error) });
        for _ in 0..10 {
            ok(|error| unsafe { sf_world_tick(self.world, std::ptr::null_mut(), error) });
            let state = self.state(npc);
            let stands = next.stands == 0 || state.flags & 1 != 0;
            reached |= stands && distance(state.feet, next.waypoint) <= 1.0;
            if reached && next.stands != 0 {
                break;
            }
        }
        reached
    }
}

impl Drop for Game {
    fn drop(&mut self) {
        unsafe {
            self.rehearsals.into_iter().for_each(|rehearsals| sf_rehearsals_destroy(rehearsals));
            sf_agents_destroy(self.agents);
            sf_graph_destroy(self.graph);
            sf_world_destroy(self.world);
        }
    }
}

fn distance(a: Vec3, b: Vec3) -> f32 {
    ((a.x - b.x).powi(2) + (a.y - b.y).powi(2) + (a.z - b.z).powi(2)).sqrt()
}

#[test]
fn npcs_that_rehearse_arrive_and_turn_and_jump_less() {
    let free = Game::new(None).walk();
    let game = Game::new(Some(0));
    let rehearsed = game.walk();
    assert_eq!(rehearsed, game.walk(), "rehearsals in calls repeat themselves");
    assert_eq!(rehearsed.arrived, GOALS, "{rehearsed:?}");
    let per_decision = |count: f32, seen: &Seen| count / seen.decisions as f32;
    let jumps = [&free, &rehearsed].map(|seen| per_decision(seen.jumps as f32, seen));
    assert!(jumps[1] < 0.5 * jumps[0], "{free:?} {rehearsed:?}");
    let turns = [&free, &rehearsed].map(|seen| per_decision(seen.turned, seen));
    assert!(turns[1] < 0.7 * turns[0], "{free:?} {rehearsed:?}");
}

#[test]
fn an_npc_walks_as_its_gait_says() {
    let game = Game::on(floor(), Some(0));
    let mut walk = Gait::default();
    ok(|error| unsafe { sf_gait_named(c"walk".as_ptr(), &mut walk, error) });
    let (mut runs, mut walks) = (Seen::default(), Seen::default());
    let along = |a: &Vec3, b: &Vec3| a.x.total_cmp(&b.x);
    let ends = [game.vertices.iter().copied().min_by(along), game.vertices.iter().copied().max_by(along)];
    let ends = ends.map(|end| end.expect("a vertex"));
    assert!(game.walk_to(ends, None, &mut runs) && game.walk_to(ends, Some(walk), &mut walks), "{runs:?} {walks:?}");
    assert!(walks.decisions > 3 * runs.decisions, "{runs:?} {walks:?}");

    fails(3, "there is no gait sneak: use walk, jog, run", |error| unsafe {
        sf_gait_named(c"sneak".as_ptr(), &mut walk, error)
    });
    let follower = handle(|out, error| unsafe { sf_follower_create(ORIGIN, out, error) });
    walk.speed = 1.5;
    fails(1, "gait.speed is 1.5, but must be 0.05 to 1", |error| unsafe {
        sf_follower_set_gait(follower, &walk, &mut step(), error)
    });
    unsafe { sf_follower_destroy(follower) };
}

/// A wall across the floor with a gap at its end.
const WALL: Block = Block { foot: Vec3 { x: 30.0, y: 0.0, z: 7.0 }, width: 1.0, depth: 14.0, height: 6.0, yaw: 0.0 };

#[test]
fn npcs_avoid_blocks_that_a_game_adds() {
    let mut game = Game::on(floor(), Some(0));
    let foot = Vec3 { y: game.vertices[0].y, ..WALL.foot };
    let shape = PieceShape::Block { foot: [foot.x, foot.y, foot.z].into(), half: [0.5, 7.0], height: 6.0, yaw: 0.0 };
    let walled = floor().with_pieces(vec![Piece { name: "wall".to_owned(), shape }]).expect("a valid piece");
    unsafe { sf_world_destroy(game.world) };
    game.world = world(&Arc::new(walled));
    let at = |x: f32| Vec3 { x, y: foot.y, z: 7.0 };
    let rehearsals = game.rehearsals.expect("rehearsals");
    let (mut ignorant, mut aware) = (Seen::default(), Seen::default());
    game.walk_to([at(5.0), at(55.0)], None, &mut ignorant);
    let wall = Block { foot, ..WALL };
    ok(|error| unsafe { sf_rehearsals_set_blocks(rehearsals, &wall, 1, error) });
    assert!(game.walk_to([at(5.0), at(55.0)], None, &mut aware), "{aware:?}");
    assert!(aware.decisions < ignorant.decisions, "{ignorant:?} {aware:?}");
    assert!(aware.turned < 0.5 * ignorant.turned, "{ignorant:?} {aware:?}");

    // Refused blocks change nothing, and removed ones no longer stop rehearsals.
    let flat = Block { height: 0.0, ..wall };
    fails(1, "the height of the piece `blocks[1]` is 0", |error| unsafe {
        sf_rehearsals_set_blocks(rehearsals, [wall, flat].as_ptr(), 2, error)
    });
    let mut again = Seen::default();
    assert!(game.walk_to([at(5.0), at(55.0)], None, &mut again));
    assert_eq!(again, aware, "the wall is still there");
    ok(|error| unsafe { sf_rehearsals_set_blocks(rehearsals, null(), 0, error) });
    let mut forgotten = Seen::default();
    game.walk_to([at(5.0), at(55.0)], None, &mut forgotten);
    assert_eq!(forgotten, ignorant);
}

#[test]
fn npcs_arrive_by_rehearsals_on_threads() {
    let seen = Game::new(Some(2)).walk();
    assert!(seen.arrived + 1 >= GOALS, "{seen:?}");
}

#[test]
fn what_is_wrong_with_a_rehearsal_is_said() {
    let map = map();
    let (policy, level) = (policy(), level(&map));
    let mut none = std::ptr::null_mut();
    fails(1, "thread_count is 65", |error| unsafe {
        sf_rehearsals_create(policy, level, null(), 65, &mut none, error)
    });
    fails(1, "map is NULL", |error| unsafe { sf_rehearsals_create(policy, null(), null(), 0, &mut none, error) });
    let mut slow: Body = unsafe { std::mem::zeroed() };
    ok(|error| unsafe { sf_body_default(&mut slow, error) });
    slow.forward_speed = 4.0;
    let of_slow = handle(|out, error| unsafe { sf_rehearsals_create(policy, level, &slow, 0, out, error) });
    let rehearsals = rehearsals_on(&map, 0);
    let (agents, state, mut next) = (agents(1), state(), step());
    let follower = handle(|out, error| unsafe { sf_follower_create(state.feet, out, error) });
    fails(1, "another policy or body", |error| unsafe {
        sf_follower_prepare(follower, of_slow, agents, 0, &state, ORIGIN, &mut next, error)
    });
    fails(6, "set_goal first", |error| unsafe {
        sf_follower_prepare(follower, rehearsals, agents, 0, &state, ORIGIN, &mut next, error)
    });
    fails(1, "agent 4 does not exist", |error| unsafe {
        sf_follower_prepare(follower, rehearsals, agents, 4, &state, ORIGIN, &mut next, error)
    });
    ok(|error| unsafe { sf_agents_set_goal(agents, 0, state.feet, state.feet, error) });
    ok(|error| unsafe { sf_follower_prepare(follower, rehearsals, agents, 0, &state, ORIGIN, &mut next, error) });
    assert_eq!(next.kind, 2, "it needs a plan first");
    let nowhere = Vec3 { x: f32::NAN, ..ORIGIN };
    fails(1, "origin", |error| unsafe {
        sf_follower_prepare(follower, rehearsals, agents, 0, &state, nowhere, &mut next, error)
    });
    unsafe {
        sf_follower_destroy(follower);
        [rehearsals, of_slow].into_iter().for_each(|rehearsals| sf_rehearsals_destroy(rehearsals));
        sf_agents_destroy(agents);
        sf_map_destroy(level);
        sf_policy_destroy(policy);
    }
}
