//! NPCs that follow goals which move, over real sockets.

use e2e::stage::{level, start_planning_worker, world_of};
use e2e::{LIMIT, distance, spawn, start_planner, start_server, watch, watch_until};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::npc_event::Event;
use surefoot_proto::world::v1::set_goal_request::Target;
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

/// Reads events until one `is_wanted`, and returns it.
async fn event_until(
    events: &mut tonic::Streaming<wire::WatchEventsResponse>,
    is_wanted: impl Fn(&Event) -> bool,
) -> Event {
    let reading = async {
        loop {
            let message = events.next().await.expect("an endless stream").unwrap();
            if let Some(event) = message.events.into_iter().filter_map(|it| it.event).find(&is_wanted) {
                return event;
            }
        }
    };
    tokio::time::timeout(LIMIT, reading).await.expect("in time")
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_keeps_to_a_player_until_its_goal_is_cleared() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, rooms(), wire::TimeMode::Realtime).await;
    let (world_id, start, first) = (stage.world_id, stage.at([5.0, 0.0, 10.0]), stage.at([12.0, 0.0, 10.0]));
    let npc_id = spawn(&mut stage.client, world_id, start).await;
    let request = wire::WatchEventsRequest { world_id, ..Default::default() };
    let mut events = stage.client.watch_events(request).await.unwrap().into_inner();
    let request = wire::SpawnPlayerRequest { world_id, position: Some(first), ..Default::default() };
    let player_id = stage.client.spawn_player(request).await.unwrap().into_inner().player_id;

    let (target, radius) = (Some(Target::TargetPlayerId(player_id)), 2.0);
    let request = wire::SetGoalRequest { npc_id, target, radius, keep: true, ..Default::default() };
    let attempt = stage.client.set_goal(request).await.unwrap().into_inner().attempt;
    let has_reached = |event: &Event| matches!(event, Event::TargetReached(_));
    assert!(matches!(event_until(&mut events, has_reached).await, Event::TargetReached(it) if it.attempt == attempt));

    // Through the doorway to the other room.
    let second = stage.at([33.0, 0.0, 12.0]);
    let moves = vec![wire::PlayerMove { player_id, position: Some(second), ..Default::default() }];
    stage.client.move_players(wire::MovePlayersRequest { world_id, moves, ..Default::default() }).await.unwrap();
    let Event::TargetReached(reached) = event_until(&mut events, has_reached).await else { unreachable!() };
    assert_eq!(reached.attempt, attempt, "the same attempt goes on");
    assert!(distance(reached.goal.unwrap(), second) < 0.5);

    stage.client.remove_player(wire::RemovePlayerRequest { world_id, player_id }).await.unwrap();
    event_until(&mut events, |event| matches!(event, Event::TargetLost(it) if it.attempt == attempt)).await;
    let cleared = stage.client.clear_goals(wire::ClearGoalsRequest { npc_ids: vec![npc_id] }).await.unwrap();
    assert_eq!(cleared.into_inner().results, [wire::ItemResult { error: None }]);
    let Event::AttemptEnded(ended) = event_until(&mut events, |it| matches!(it, Event::AttemptEnded(_))).await else {
        unreachable!()
    };
    assert_eq!((ended.attempt, ended.outcome()), (attempt, wire::Outcome::Unspecified));

    let npc_move = wire::TargetMove { npc_id, position: Some(first), ..Default::default() };
    let moved = stage.client.move_targets(wire::MoveTargetsRequest { moves: vec![npc_move] }).await.unwrap();
    let error = moved.into_inner().results[0].error.clone().expect("there is no goal to move");
    assert_eq!(error.reason, Reason::NoGoal.name());
    let request = wire::SetGoalRequest { npc_id, target, ..Default::default() };
    let refused = stage.client.set_goal(request).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::PlayerNotFound));
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_batch_of_moves_leads_npcs_that_keep_their_attempts() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, rooms(), wire::TimeMode::Realtime).await;
    let npc_id = {
        let start = stage.at([5.0, 0.0, 10.0]);
        spawn(&mut stage.client, stage.world_id, start).await
    };
    let goal = Some(stage.at([15.0, 0.0, 10.0]));
    let request = wire::SetGoalRequest { npc_id, goal, keep: true, ..Default::default() };
    let attempt = stage.client.set_goal(request).await.unwrap().into_inner().attempt;
    // Farther than a goal that SetGoal takes for the same.
    let place = stage.at([35.0, 0.0, 16.0]);
    let moves = vec![wire::TargetMove { npc_id, position: Some(place), ..Default::default() }];
    let moved = stage.client.move_targets(wire::MoveTargetsRequest { moves }).await.unwrap().into_inner();
    assert_eq!(moved.results, [wire::ItemResult { error: None }]);
    let is_there = |snapshot: &wire::WatchWorldResponse| {
        snapshot.npcs.iter().all(|npc| distance(npc.position.unwrap(), place) <= 1.0)
    };
    let npc = watch_until(&mut stage.client, stage.world_id, is_there).await.npcs[0];
    assert_eq!((npc.attempts_begun, npc.attempts_ended, npc.status()), (attempt, 0, wire::NpcStatus::Seeking));

    // A goal with a velocity moves on for a second.
    let at_speed = |x| {
        let velocity = Some(wire::Vec3 { x, y: 0.0, z: 0.0 });
        let moves = vec![wire::TargetMove { npc_id, position: Some(place), velocity, ..Default::default() }];
        wire::MoveTargetsRequest { moves }
    };
    stage.client.move_targets(at_speed(-3.0)).await.unwrap();
    let end = wire::Vec3 { x: place.x - 3.0, ..place };
    let is_there = |snapshot: &wire::WatchWorldResponse| {
        let is_at = |at: Option<wire::Vec3>, radius| at.is_some_and(|at| distance(at, end) <= radius);
        snapshot.npcs.iter().all(|npc| is_at(npc.goal, 0.2) && is_at(npc.position, 1.0))
    };
    let npc = watch_until(&mut stage.client, stage.world_id, is_there).await.npcs[0];
    assert_eq!((npc.attempts_begun, npc.attempts_ended), (attempt, 0));
    let refused = stage.client.move_targets(at_speed(200.0)).await.unwrap().into_inner();
    let error = refused.results[0].error.clone().expect("no target is so fast");
    assert!(error.message.contains("velocity"), "{}", error.message);
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_tells_when_there_is_no_way_to_its_target_and_when_there_is_one_again() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let divided =
        level(&[("floor", [0.0, -1.0, 0.0], [41.0, 0.0, 20.0]), ("wall", [20.0, 0.0, -14.0], [21.0, 12.0, 34.0])]);
    let mut stage = world_of(&server, divided, wire::TimeMode::Realtime).await;
    let (world_id, start) = (stage.world_id, stage.at([5.0, 0.0, 10.0]));
    let (here, beyond) = (stage.at([12.0, 0.0, 10.0]), stage.at([33.0, 0.0, 10.0]));
    let npc_id = spawn(&mut stage.client, world_id, start).await;
    let request = wire::WatchEventsRequest { world_id, ..Default::default() };
    let mut events = stage.client.watch_events(request).await.unwrap().into_inner();
    let request = wire::SpawnPlayerRequest { world_id, position: Some(beyond), ..Default::default() };
    let player_id = stage.client.spawn_player(request).await.unwrap().into_inner().player_id;

    let target = Some(Target::TargetPlayerId(player_id));
    let request = wire::SetGoalRequest { npc_id, target, keep: true, ..Default::default() };
    stage.client.set_goal(request).await.unwrap();
    let is_news = |event: &Event| {
        matches!(event, Event::TargetUnreachable(_) | Event::TargetReachable(_) | Event::TargetReached(_))
    };
    let Event::TargetUnreachable(told) = event_until(&mut events, is_news).await else { panic!("there is no way") };
    assert!(!told.no_path.is_empty());
    // A further attempt does not tell it again.
    let began = |event: &Event| is_news(event) || matches!(event, Event::AttemptBegan(it) if it.attempt > told.attempt);
    assert!(matches!(event_until(&mut events, began).await, Event::AttemptBegan(_)));

    let moves = vec![wire::PlayerMove { player_id, position: Some(here), ..Default::default() }];
    stage.client.move_players(wire::MovePlayersRequest { world_id, moves, ..Default::default() }).await.unwrap();
    assert!(matches!(event_until(&mut events, is_news).await, Event::TargetReachable(_)));
    assert!(matches!(event_until(&mut events, is_news).await, Event::TargetReached(_)));
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}
