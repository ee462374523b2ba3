//! An NPC that keeps to a goal which moves.

use super::stage::of_boxes;
use std::sync::Arc;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::attempts::Chase;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{Goal, ProbeContext, Rollout};
use surefoot_world::map::MapSize;
use surefoot_world::{CharacterProfile, DECISION_SECONDS, Map, NpcSlot, TaskConfig, Vec3};

const FLOOR: f32 = 10.0;

/// A hall of 44 x 44 m around a block of 24 x 24 m.
fn hall() -> Arc<Map> {
    let boxes = [
        ([2.0, -1.0, 2.0], [46.0, 0.0, 46.0]),
        ([1.0, -1.0, 1.0], [47.0, 20.0, 2.0]),
        ([1.0, -1.0, 46.0], [47.0, 20.0, 47.0]),
        ([1.0, -1.0, 2.0], [2.0, 20.0, 46.0]),
        ([46.0, -1.0, 2.0], [47.0, 20.0, 46.0]),
        ([12.0, -1.0, 12.0], [36.0, 20.0, 36.0]),
    ];
    let up = |corner: [f32; 3]| Vec3::from(corner) + Vec3::Y * FLOOR;
    of_boxes(MapSize { width: 48, height: 60, depth: 48 }, boxes.into_iter().map(|(low, high)| [up(low), up(high)]))
}

/// The place of a runner after `run` metres round the block.
fn runner(run: f32) -> Vec3 {
    let corners = [[7.0, 7.0], [41.0, 7.0], [41.0, 41.0], [7.0, 41.0], [7.0, 7.0]].map(|[x, z]| Vec3::new(x, FLOOR, z));
    let along = run.rem_euclid(136.0);
    let leg = (along / 34.0) as usize;
    corners[leg].lerp(corners[leg + 1], along / 34.0 - leg as f32)
}

/// Distances of an NPC from a runner with this speed, m/s, that starts `ahead_m` ahead of it, before each decision.
fn gaps(speed: f32, ahead_m: f32) -> Vec<f32> {
    let (map, policy) = (hall(), Policy::shipped().unwrap());
    let context = ProbeContext::new(map.clone(), policy.clone());
    let settings = BuildSettings::default().with(|it| it.vertices = 120).unwrap();
    let graph = build(&context, &settings, 2, &Progress::default()).unwrap().graph;
    let router = Router::new(graph, 1000, 1);
    let rollout = Rollout::new(map, CharacterProfile::default(), TaskConfig::default());
    let chase = Chase { rollout: &rollout, policy: &policy, router: &router, radius: 1.5, decisions: 180 };
    let start = Goal { start: runner(-ahead_m), yaw: 0.0, goal: runner(0.0) };
    let mut gaps = Vec::new();
    let chased = chase.run(&[start], |world, decision, errands| {
        errands[0].goal = runner(speed * decision as f32 * DECISION_SECONDS);
        let npc = world.npc(NpcSlot(0));
        gaps.extend(npc.map(|npc| npc.body.feet.distance(errands[0].goal)));
    });
    assert_eq!(chased.harm, [None]);
    assert!(chased.decided > 0);
    gaps
}

#[test]
fn an_npc_stays_with_a_player_that_walks() {
    let gaps = gaps(3.0, 12.0);
    let contact = gaps.iter().position(|gap| *gap <= 3.0).expect("contact");
    let near = gaps[contact..].iter().filter(|gap| **gap <= 3.0).count();
    assert!(100 * near >= 95 * (gaps.len() - contact), "{near} of {}", gaps.len() - contact);
}

#[test]
fn an_npc_goes_to_meet_a_runner_that_comes_round_the_block() {
    assert!(gaps(12.0, 90.0).iter().any(|gap| *gap <= 4.0));
}
