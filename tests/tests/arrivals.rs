//! When an attempt ends as reached, and where goals lie that no body can stand at, over real sockets.

use e2e::stage::{Services, level, start_planning_worker, start_planning_worker_for, world_of};
use e2e::{distance, spawn, start_planner, start_server, watch_until};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;

/// A floor with a wall of 10 cm at x = 10 m, which leaves a way of 3 m at its end, and a block of 5 m.
fn lanes() -> Vec<u8> {
    level(&[
        ("floor", [0.0, -1.0, 0.0], [30.0, 0.0, 30.0]),
        ("partition", [10.0, 0.0, 0.0], [10.1, 3.0, 27.0]),
        ("block", [20.0, 0.0, 20.0], [25.0, 5.0, 25.0]),
    ])
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_has_not_arrived_behind_a_wall_and_goals_are_moved_to_where_it_can_stand() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, lanes(), wire::TimeMode::Lockstep).await;
    let start = stage.at([9.55, 0.0, 20.0]);
    let npc_id = spawn(&mut stage.client, stage.world_id, start).await;
    // 0.95 m away, on the other side.
    let goal = stage.at([10.5, 0.0, 20.0]);
    stage.client.set_goal(wire::SetGoalRequest { npc_id, goal: Some(goal), ..Default::default() }).await.unwrap();
    let (outcome, place) = stage.end_of(1).await;
    assert_eq!(outcome, wire::Outcome::Reached);
    assert!(place.x > stage.at([10.1, 0.0, 0.0]).x && distance(place, goal) <= 1.0, "{place:?}");

    let set = |at: [f32; 3], snap: Option<f32>| wire::SetGoalRequest {
        npc_id,
        goal: Some(stage.at(at)),
        snap,
        ..Default::default()
    };
    let cases = [
        ("at the hip", set([5.0, 0.9, 5.0], None), Ok([5.0, 0.0, 5.0])),
        ("below the floor", set([5.0, -0.4, 5.0], None), Ok([5.0, 0.0, 5.0])),
        ("too close to the partition", set([9.9, 0.0, 5.0], None), Ok([9.65, 0.0, 5.0])),
        ("on the block", set([22.0, 5.5, 22.0], None), Ok([22.0, 5.0, 22.0])),
        ("in the air", set([5.0, 4.0, 5.0], None), Err(Reason::GoalInAir)),
        ("in the block", set([22.5, 2.0, 22.5], None), Err(Reason::GoalInSolid)),
        ("in the block, near its side", set([24.5, 0.0, 22.5], None), Ok([25.5, 0.0, 22.5])),
        ("with no snap", set([5.0, 0.9, 5.0], Some(0.0)), Err(Reason::GoalInAir)),
    ];
    for (case, request, expected) in cases {
        let asked = request.goal.unwrap();
        match (stage.client.set_goal(request).await, expected) {
            (Ok(response), Ok(place)) => {
                let wire::SetGoalResponse { goal_used, moved_by_m, .. } = response.into_inner();
                let used = goal_used.unwrap();
                assert!(distance(used, stage.at(place)) < 0.3, "{case}: {used:?}");
                assert!((distance(used, asked) - moved_by_m).abs() < 1.0e-3, "{case}: {moved_by_m}");
            }
            (Err(status), Err(reason)) => assert_eq!(Reason::of(&status), Some(reason), "{case}: {status}"),
            (result, expected) => panic!("{case}: {result:?}, expected {expected:?}"),
        }
    }
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_stops_at_its_goal_or_touches_it_if_the_client_says_so() {
    let services = Services::start();
    let mut stage = world_of(&services.server, lanes(), wire::TimeMode::Lockstep).await;
    let start = stage.at([3.0, 0.0, 3.0]);
    let npc_id = spawn(&mut stage.client, stage.world_id, start).await;
    let goal = Some(stage.at([5.0, 0.0, 20.0]));
    let request = wire::SetGoalRequest { npc_id, goal, stop: true, ..Default::default() };
    stage.client.set_goal(request).await.unwrap();
    assert_eq!(stage.end_of(1).await.0, wire::Outcome::Reached);
    let request_of = wire::GetNpcRequest { npc_id, ..Default::default() };
    let npc = stage.client.get_npc(request_of).await.unwrap().into_inner().npc.unwrap();
    let wire::Vec3 { x, y, z } = npc.velocity.unwrap();
    assert!(x.hypot(y).hypot(z) <= 0.3, "it stands when the attempt ends: {npc:?}");

    // Nothing can stand there, but the feet touch it from the floor.
    let goal = stage.at([5.0, 0.95, 5.0]);
    let touch = wire::SetGoalRequest { goal: Some(goal), stop: false, touch: true, ..request };
    let set = stage.client.set_goal(touch).await.unwrap().into_inner();
    assert_eq!((set.goal_used, set.moved_by_m), (Some(goal), 0.0));
    let (outcome, place) = stage.end_of(2).await;
    assert_eq!(outcome, wire::Outcome::Reached);
    assert!(distance(place, goal) <= 1.0, "{place:?}");
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_crowd_at_the_end_of_a_pier_stands_there_and_nobody_falls() {
    const COUNT: u32 = 24;
    let pier =
        level(&[("plaza", [0.0, -1.0, 0.0], [30.0, 0.0, 30.0]), ("pier", [14.0, -1.0, 30.0], [16.0, 0.0, 42.0])]);
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker_for(COUNT, &server, &planner);
    let mut stage = world_of(&server, pier, wire::TimeMode::Realtime).await;
    let goal = Some(stage.at([15.0, 0.0, 41.0]));
    let place = |idx: u32| stage.at([3.0 + 4.0 * (idx % 6) as f32, 0.0, 3.0 + 4.0 * (idx / 6) as f32]);
    let spawns = (0..COUNT).map(|idx| wire::Spawn { position: Some(place(idx)), goal, ..Default::default() });
    let request =
        wire::BatchSpawnNpcsRequest { world_id: stage.world_id, spawns: spawns.collect(), ..Default::default() };
    stage.client.batch_spawn_npcs(request).await.unwrap();
    let have_ended = |snapshot: &wire::WatchWorldResponse| snapshot.npcs.iter().all(|npc| npc.attempts_ended == 1);
    let npcs = watch_until(&mut stage.client, stage.world_id, have_ended).await.npcs;
    let of = |outcome| npcs.iter().filter(|npc| npc.last_outcome() == outcome).count();
    let (reached, near) = (of(wire::Outcome::Reached), of(wire::Outcome::ReachedNear));
    assert_eq!((reached > 0, reached + near), (true, COUNT as usize), "{reached} at the goal, {near} beside it");
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}
