//! A crowd of solid NPCs that has to get through one door.

use std::sync::Arc;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{Attempt, Goal, ProbeContext, Rollout};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, End, Map, TaskConfig, Vec3};

const FLOOR: f32 = 10.0;

/// Two rooms of 20 x 22 m with a door of 1.2 m between them.
fn rooms() -> Map {
    let boxes = [
        ([2.0, -1.0, 2.0], [44.0, 0.0, 24.0]),
        ([1.0, -1.0, 1.0], [45.0, 9.0, 2.0]),
        ([1.0, -1.0, 24.0], [45.0, 9.0, 25.0]),
        ([1.0, -1.0, 2.0], [2.0, 9.0, 24.0]),
        ([44.0, -1.0, 2.0], [45.0, 9.0, 24.0]),
        ([22.8, -1.0, 2.0], [23.2, 9.0, 12.4]),
        ([22.8, -1.0, 13.6], [23.2, 9.0, 24.0]),
    ];
    let up = |corner: [f32; 3]| Vec3::from(corner) + Vec3::Y * FLOOR;
    let faces = boxes.into_iter().flat_map(|(low, high)| cuboid(up(low), up(high)));
    let triangles = faces.filter_map(|face| Triangle::new(face, Surface::Ground)).collect();
    Map::from_parts(MapSize { width: 46, height: 60, depth: 26 }, triangles, Placed::default())
}

/// Eight rows of eight in each room; who stands first has its goal last.
fn goals() -> Vec<Goal> {
    let place = |x: f32, idx: usize| Vec3::new(x + (idx % 8) as f32 * 1.7, FLOOR, 6.0 + (idx / 8) as f32 * 1.7);
    (0..64).map(|idx| Goal { start: place(4.0, idx), yaw: idx as f32, goal: place(28.0, 63 - idx) }).collect()
}

#[test]
fn a_crowd_gets_through_a_door_without_anybody_stuck_beside_it() {
    let policy = Policy::shipped().unwrap();
    let map = Arc::new(rooms());
    let settings = BuildSettings::default();
    let context = ProbeContext::new(map.clone(), policy.clone());
    let graph = build(&context, &settings, 2, &Progress::default()).unwrap().graph;
    let router = Router::new(graph, 1000, 2);
    let last = |solid: bool| {
        let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        rollout.solid = solid;
        let attempts: Vec<Attempt> = rollout.live(&policy, &router, &goals(), |_, _| {});
        let arrived = attempts.iter().filter(|attempt| attempt.end == End::Reached).count();
        assert_eq!(arrived, 64, "solid: {solid}");
        attempts.iter().map(|attempt| attempt.decisions).max().unwrap()
    };
    let (solid, ghosts) = (last(true), last(false));
    assert!(solid < 2 * ghosts + 20, "the last one after {solid} decisions, {ghosts} as ghosts");
}
