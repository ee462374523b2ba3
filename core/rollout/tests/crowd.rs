//! A crowd of solid NPCs that has to get through one door.

use super::stage::of_boxes;
use std::sync::Arc;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{AttemptResult, Goal, ProbeContext, Rollout};
use surefoot_world::map::MapSize;
use surefoot_world::{CharacterProfile, End, Map, TaskConfig, Vec3};

const FLOOR: f32 = 10.0;

/// Two rooms of 20 x 22 m, with doors of 1.2 m between them whose middles are at these z.
fn rooms(doors: &[f32]) -> Arc<Map> {
    let mut boxes = vec![
        ([2.0, -1.0, 2.0], [44.0, 0.0, 24.0]),
        ([1.0, -1.0, 1.0], [45.0, 9.0, 2.0]),
        ([1.0, -1.0, 24.0], [45.0, 9.0, 25.0]),
        ([1.0, -1.0, 2.0], [2.0, 9.0, 24.0]),
        ([44.0, -1.0, 2.0], [45.0, 9.0, 24.0]),
    ];
    let begins = std::iter::once(2.0).chain(doors.iter().map(|z| z + 0.6));
    let ends = doors.iter().map(|z| z - 0.6).chain([24.0]);
    boxes.extend(begins.zip(ends).map(|(begin, end)| ([22.8, -1.0, begin], [23.2, 9.0, end])));
    let up = |corner: [f32; 3]| Vec3::from(corner) + Vec3::Y * FLOOR;
    of_boxes(MapSize { width: 46, height: 60, depth: 26 }, boxes.into_iter().map(|(low, high)| [up(low), up(high)]))
}

/// Eight rows of eight in each room; the first NPC has its goal in the last place.
fn goals() -> Vec<Goal> {
    let place = |x: f32, idx: usize| Vec3::new(x + (idx % 8) as f32 * 1.7, FLOOR, 6.0 + (idx / 8) as f32 * 1.7);
    (0..64).map(|idx| Goal { start: place(4.0, idx), yaw: idx as f32, goal: place(28.0, 63 - idx) }).collect()
}

/// The map, what its NPCs go by, and plans on it.
fn prepare(doors: &[f32]) -> (Arc<Map>, Policy, Router) {
    let (map, policy) = (rooms(doors), Policy::shipped().unwrap());
    let context = ProbeContext::new(map.clone(), policy.clone());
    let graph = build(&context, &BuildSettings::default(), 2, &Progress::default()).unwrap().graph;
    (map, policy, Router::new(graph, 1000, 2))
}

#[test]
fn a_crowd_gets_through_a_door_and_no_npc_is_stuck_beside_it() {
    let (map, policy, router) = prepare(&[13.0]);
    let last = |solid: bool| {
        let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        rollout.solid = solid;
        let attempts: Vec<AttemptResult> = rollout.live(&policy, &router, &goals(), |_, _| {});
        let arrived = attempts.iter().filter(|attempt| attempt.end == End::Reached).count();
        assert_eq!(arrived, 64, "solid: {solid}");
        attempts.iter().map(|attempt| attempt.decisions).max().unwrap()
    };
    let (solid, ghosts) = (last(true), last(false));
    assert!(solid < 2 * ghosts + 20, "the last one after {solid} decisions, {ghosts} as ghosts");
}

#[test]
fn a_crowd_shares_two_doors() {
    let (map, policy, router) = prepare(&[8.0, 20.0]);
    // All are nearer to the first door.
    let goals: Vec<Goal> =
        goals().into_iter().map(|goal| Goal { goal: goal.goal.with_z(5.0), ..goal }).take(40).collect();
    let through_far_door = |solid: bool| {
        let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        rollout.solid = solid;
        let mut passed = std::collections::BTreeSet::new();
        let attempts = rollout.live(&policy, &router, &goals, |world, _| {
            let at_door = |feet: Vec3| (feet.x - 23.0).abs() < 1.5 && (feet.z - 20.0).abs() < 1.0;
            passed.extend(world.npcs().filter(|(_, npc)| at_door(npc.body.feet)).map(|(slot, _)| slot));
        });
        assert!(attempts.iter().all(|attempt| attempt.end == End::Reached), "solid: {solid}");
        passed.len()
    };
    let (solid, ghosts) = (through_far_door(true), through_far_door(false));
    assert!(ghosts <= 1 && solid >= 4, "{solid} of 40 take the farther door, {ghosts} as ghosts");
}
