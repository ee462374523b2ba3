//! NPCs that follow goals which move, over real sockets.

use e2e::stage::{level, start_planning_worker, world_of};
use e2e::{distance, spawn, start_planner, start_server, watch, watch_until};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;

/// Speed of the target, m/s, and how long it is chased, ticks.
const SPEED: f32 = 3.0;
const TICKS: u64 = 1500;

/// Two rooms of 20 x 20 m, joined by a doorway 3 m wide.
fn rooms() -> Vec<u8> {
    level(&[
        ("floor", [0.0, -1.0, 0.0], [41.0, 0.0, 20.0]),
        ("wall_a", [20.0, 0.0, -14.0], [21.0, 9.0, 8.5]),
        ("wall_b", [20.0, 0.0, 11.5], [21.0, 9.0, 34.0]),
    ])
}

/// Where the target is after so many ticks: it walks round and round through both rooms.
fn place(ticks: u64) -> [f32; 3] {
    let way =
        [[5.0, 4.0], [17.0, 10.0], [24.0, 10.0], [36.0, 4.0], [36.0, 16.0], [24.0, 10.0], [17.0, 10.0], [5.0, 16.0]];
    let legs = || (0..way.len()).map(|leg| (way[leg], way[(leg + 1) % way.len()]));
    let length = |([x, z], [to_x, to_z]): ([f32; 2], [f32; 2])| (to_x - x).hypot(to_z - z);
    let round: f32 = legs().map(length).sum();
    let mut left = SPEED * ticks as f32 / 60.0 % round;
    for leg in legs() {
        let share = left / length(leg);
        if share <= 1.0 {
            let ([x, z], [to_x, to_z]) = leg;
            return [x + share * (to_x - x), 0.0, z + share * (to_z - z)];
        }
        left -= length(leg);
    }
    [way[0][0], 0.0, way[0][1]]
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_whose_goal_is_set_in_every_frame_stays_at_its_target() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, rooms(), wire::TimeMode::Realtime).await;
    let start = stage.at([36.0, 0.0, 16.0]);
    let npc_id = spawn(&mut stage.client, stage.world_id, start).await;
    watch_until(&mut stage.client, stage.world_id, |snapshot| snapshot.npcs.iter().all(|npc| npc.worker_id != 0)).await;

    let mut snapshots = watch(&mut stage.client, stage.world_id, 60.0).await;
    let mut begun = None;
    let (mut calls, mut near, mut since_contact) = (0, 0, 0);
    let last = loop {
        let snapshot = snapshots.next().await.expect("an endless stream").unwrap();
        let ticks = snapshot.tick - *begun.get_or_insert(snapshot.tick);
        let Some(npc) = snapshot.npcs.first().copied() else { continue };
        let target = stage.at(place(ticks));
        let gap = distance(npc.position.unwrap(), target);
        if gap <= 3.0 || since_contact > 0 {
            since_contact += 1;
            near += usize::from(gap <= 4.0);
        }
        if ticks >= TICKS {
            break npc;
        }
        let goal = wire::SetGoalRequest { npc_id, goal: Some(target), ..Default::default() };
        stage.client.set_goal(goal).await.unwrap();
        calls += 1;
    };
    assert!(last.status() != wire::NpcStatus::Down && calls > 200, "{last:?} after {calls} calls");
    assert!(since_contact > calls / 2, "in contact for {since_contact} of {calls} frames");
    assert!(10 * near >= 8 * since_contact, "near in {near} of {since_contact} frames");
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}
