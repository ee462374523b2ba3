//! What the tests of the C functions share: calls that must succeed or fail, a level, and a graph.
#![expect(unsafe_code, reason = "calls C functions")]

use std::ffi::{CStr, c_void};
use std::mem::zeroed;
use surefoot::abi::{self, Vec3};
use surefoot::exports::*;
use surefoot::{Agents, Graph, Map as LevelMap, Policy, World};
use surefoot_levels::encode;
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::export::{About, Format, export_about};
use surefoot_planner::graph::GraphData;
use surefoot_planner::{Edge, EdgeKey, NavGraph};
use surefoot_world::character::OwnMove;
use surefoot_world::map::{LevelFrame, MapSize};
use surefoot_world::{Ability, Map, MapSpec, RawMapSpec};

/// Makes a call that must succeed.
pub fn ok(call: impl FnOnce(*mut abi::Error) -> i32) {
    let (status, text) = outcome(call);
    assert_eq!(status, 0, "{text}");
}

/// Makes a call that must fail so, with a text that contains `part`.
pub fn fails(expected: i32, part: &str, call: impl FnOnce(*mut abi::Error) -> i32) {
    let (status, text) = outcome(call);
    assert_eq!(status, expected, "{text}");
    assert!(text.contains(part), "{text:?} does not mention {part:?}");
}

fn outcome(call: impl FnOnce(*mut abi::Error) -> i32) -> (i32, String) {
    let mut error = abi::Error { code: 0, message: [0; abi::MESSAGE_LEN] };
    let status = call(&mut error);
    assert_eq!(error.code, status);
    let text = unsafe { CStr::from_ptr(error.message.as_ptr()) };
    (status, text.to_str().expect("UTF-8").to_owned())
}

/// Makes a handle.
pub fn handle<T>(make: impl FnOnce(*mut *mut T, *mut abi::Error) -> i32) -> *mut T {
    let mut handle = std::ptr::null_mut();
    ok(|error| make(&mut handle, error));
    handle
}

/// The policy that ships.
pub fn policy() -> *mut Policy {
    handle(|out, error| unsafe { sf_policy_shipped(std::ptr::null(), out, error) })
}

/// Agents of that policy.
pub fn agents(count: u32) -> *mut Handle<Agents> {
    let policy = policy();
    let agents = handle(|out, error| unsafe { sf_agents_create(policy, std::ptr::null(), count, out, error) });
    unsafe { sf_policy_destroy(policy) };
    agents
}

/// A small map with all features.
pub fn map() -> Map {
    let size = MapSize { width: 100, height: 80, depth: 100 };
    let spec = RawMapSpec { size, ..RawMapSpec::new(7) };
    surefoot_generate::generate(&MapSpec::try_from(spec).expect("a spec"))
}

/// That map, as a level.
pub fn level(map: &Map) -> *mut LevelMap {
    let bytes = encode(map);
    handle(|out, error| unsafe { sf_map_load_memory(bytes.as_ptr().cast::<c_void>(), bytes.len(), out, error) })
}

/// A world on that map.
pub fn world(map: &Map) -> *mut Handle<World> {
    let level = level(map);
    let world = handle(|out, error| unsafe { sf_world_create(level, std::ptr::null(), out, error) });
    unsafe { sf_map_destroy(level) };
    world
}

/// A state of which the size is set.
pub fn state() -> abi::State {
    let mut state: abi::State = unsafe { zeroed() };
    (state.struct_size, state.flags) = (size_of::<abi::State>() as u32, abi::GROUNDED);
    state
}

/// A step of which the size is set.
pub fn step() -> abi::Step {
    abi::Step { struct_size: size_of::<abi::Step>() as u32, ..abi::Step::default() }
}

/// A query of a careful plan.
pub fn query(start: Vec3, goal: Vec3) -> abi::Query {
    let struct_size = size_of::<abi::Query>() as u32;
    abi::Query { struct_size, without: 0, start, goal, caution: 1.0, avoid_count: 0, avoid: std::ptr::null() }
}

/// A vector.
pub fn at(x: f32, z: f32) -> Vec3 {
    Vec3 { x, y: 0.0, z }
}

/// A ladder of vertices, 30 m apart along x and 40 m along z, as a file: two ways from 0 to 3.
///
/// ```text
/// 0 --- 1 --- 2 --- 3     walking
/// |                 |     walking
/// 4 === 5 === 6 === 7     by jump pads
/// ```
pub fn graph_text() -> String {
    graph_text_of(None)
}

/// This graph, for a level with this frame.
pub fn graph_text_of(frame: Option<LevelFrame>) -> String {
    graph_text_with(frame, &[])
}

/// This graph, for a body with these moves of its own.
pub fn graph_text_with(frame: Option<LevelFrame>, moves: &[OwnMove]) -> String {
    let place = |idx: u32| surefoot_world::Vec3::new((idx % 4) as f32 * 30.0, 0.0, (idx / 4) as f32 * 40.0);
    let mut edges = Vec::new();
    let ways = [(0, 1), (1, 2), (2, 3), (0, 4), (4, 5), (5, 6), (6, 7), (7, 3)];
    for (from, to) in ways {
        let ability = if from >= 4 && to >= 4 { Ability::PAD } else { Ability::WALK };
        for (from, to) in [(from, to), (to, from)] {
            let mut evidence = Evidence::default();
            (0..20).for_each(|_| evidence.note(TryEnd::Arrived, 20, ability));
            [from, to].map(place).into_iter().for_each(|end| evidence.widen_bounds(end));
            edges.push(Edge { key: EdgeKey::new(from, to), evidence });
        }
    }
    let data = GraphData { vertices: (0..8).map(place).collect(), edges, ..GraphData::default() };
    let graph = NavGraph::check(data).expect("a sound graph").with_moves(moves.into());
    export_about(&graph, Format::Json, About { frame, body: None })
}

/// That graph.
pub fn graph() -> *mut Shared<Graph> {
    load_graph(&graph_text())
}

/// A graph in a file.
pub fn load_graph(text: &str) -> *mut Shared<Graph> {
    handle(|out, error| unsafe { sf_graph_load_memory(text.as_ptr().cast::<c_void>(), text.len(), out, error) })
}
