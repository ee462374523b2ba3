//! What moves in a world besides NPCs, as a game client sees it: doors, lifts and players.

use e2e::stage::{Stage, level, start_planning_worker, world_of};
use e2e::{create_world, distance, set_goal, spawn, start_planner, start_server, watch_until, world_client};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::set_mover_request::Where;
use surefoot_server::ServerConfig;

/// Two rooms of 16 x 16 m with a door between them, and walls around and over which no NPC leaps.
fn rooms() -> Vec<u8> {
    level(&[
        ("floor", [0.0, -1.0, 0.0], [33.0, 0.0, 16.0]),
        ("wall_a", [16.0, 0.0, -14.0], [17.0, 20.0, 7.0]),
        ("wall_b", [16.0, 0.0, 9.0], [17.0, 20.0, 30.0]),
        ("lintel", [16.0, 3.0, 7.0], [17.0, 20.0, 9.0]),
        ("Door_1", [16.3, 0.0, 7.0], [16.7, 3.0, 9.0]),
    ])
}

/// A floor and a deck 9 m above it, with a lift between them.
fn deck() -> Vec<u8> {
    level(&[
        ("floor", [0.0, -1.0, 0.0], [36.0, 0.0, 26.0]),
        ("deck", [20.0, 0.0, 6.0], [34.0, 9.0, 20.0]),
        ("lift_1", [16.9, -0.1, 11.0], [19.95, 0.1, 15.0]),
        ("lift_1:path", [16.9, 8.85, 11.0], [19.95, 9.05, 15.0]),
    ])
}

#[tokio::test(flavor = "multi_thread")]
async fn a_door_bars_the_way_while_it_is_shut() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, rooms(), wire::TimeMode::Lockstep).await;
    let (here, there) = (stage.at([4.0, 0.0, 4.0]), stage.at([29.0, 0.0, 12.0]));
    let npc = spawn(&mut stage.client, stage.world_id, here).await;

    // As it was modelled, the door is shut, and no way leads around it.
    set_goal(&mut stage.client, npc, there).await;
    let (outcome, place) = stage.end_of(1).await;
    assert_eq!(outcome, wire::Outcome::Unreachable, "at {place:?}");
    assert!(place.x < stage.at([16.6, 0.0, 0.0]).x, "{place:?}");
    let request = wire::FollowNpcRequest { npc_id: npc, ..Default::default() };
    let first = stage.client.follow_npc(request).await.unwrap().into_inner().message().await.unwrap().unwrap();
    assert_eq!(first.history[0].no_path, "no path joins the islands of start and goal");

    let state = stage.order("Door_1", Where::Open(true)).await;
    assert_eq!((state.from_stop, state.to_stop, state.told_stop), (0, 0, Some(1)));
    set_goal(&mut stage.client, npc, there).await;
    assert_eq!(stage.end_of(2).await.0, wire::Outcome::Reached);

    // An NPC that waits in front of it goes on once it opens.
    stage.order("Door_1", Where::Open(false)).await;
    set_goal(&mut stage.client, npc, here).await;
    let tick = |snapshot: &wire::WatchWorldResponse| snapshot.tick;
    let begun = tick(&watch_until(&mut stage.client, stage.world_id, |_| true).await);
    let waiting = watch_until(&mut stage.client, stage.world_id, |snapshot| snapshot.tick > begun + 900).await;
    assert!(waiting.movers.is_empty() || waiting.movers[0].from_stop == 0);
    stage.order("Door_1", Where::Stop(1)).await;
    let (outcome, place) = stage.end_of(3).await;
    assert_eq!(outcome, wire::Outcome::Reached, "{place:?}");
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_takes_the_lift_and_comes_down_again() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, deck(), wire::TimeMode::Lockstep).await;
    let (floor, deck) = (stage.at([4.0, 0.0, 4.0]), stage.at([30.0, 9.0, 16.0]));
    let npc = spawn(&mut stage.client, stage.world_id, floor).await;
    set_goal(&mut stage.client, npc, deck).await;
    let (outcome, place) = stage.end_of(1).await;
    assert_eq!(outcome, wire::Outcome::Reached, "{place:?}");
    // From now on it goes where it is called.
    stage.order("lift_1", Where::Stop(0)).await;
    set_goal(&mut stage.client, npc, floor).await;
    assert_eq!(stage.end_of(2).await.0, wire::Outcome::Reached);
    set_goal(&mut stage.client, npc, deck).await;
    assert_eq!(stage.end_of(3).await.0, wire::Outcome::Reached);
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn movers_are_listed_watched_and_still_where_they_were_after_a_restart() {
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config());
    let mut stage = world_of(&server, rooms(), wire::TimeMode::Realtime).await;
    let list = wire::ListMoversRequest { world_id: stage.world_id, ..Default::default() };
    let listed = stage.client.list_movers(list).await.unwrap().into_inner();
    let [door] = &listed.movers[..] else { panic!("one mover, not {}", listed.movers.len()) };
    assert_eq!((door.name.as_str(), door.kind(), door.stops.len()), ("Door_1", wire::MoverKind::Door, 2));
    assert_eq!(door.positions.len(), 12 * 9 * 4);
    stage.order("Door_1", Where::Open(true)).await;
    let open = |snapshot: &wire::WatchWorldResponse| {
        snapshot.movers.first().is_some_and(|mover| (mover.from_stop, mover.to_stop) == (1, 1))
    };
    let seen = watch_until(&mut stage.client, stage.world_id, open).await;
    let shift = seen.movers[0].pose.unwrap().offset.unwrap();
    assert!((distance(shift, wire::Vec3::default()) - 1.92).abs() < 0.01, "{shift:?}");
    server.stop().await;

    let server = start_server(config());
    let mut client = world_client(&server).await;
    let listed = client.list_movers(list).await.unwrap().into_inner();
    assert_eq!((listed.states[0].from_stop, listed.states[0].told_stop), (1, Some(1)));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn orders_that_make_no_sense_are_refused_by_name() {
    let server = start_server(ServerConfig::default());
    let Stage { mut client, world_id, .. } = world_of(&server, deck(), wire::TimeMode::Realtime).await;
    let request = |name: &str, r#where, pace| wire::SetMoverRequest {
        world_id,
        name: name.to_owned(),
        r#where,
        pace,
        ..Default::default()
    };
    let cases = [
        (request("lift_9", Some(Where::Stop(0)), None), Reason::MoverNotFound, "lift_9"),
        (request("lift_1", Some(Where::Stop(2)), None), Reason::InvalidField, "no stop 2"),
        (request("lift_1", Some(Where::Open(true)), None), Reason::InvalidField, "neither a door nor a floor"),
        (request("lift_1", Some(Where::Cycle(false)), None), Reason::InvalidField, "cycle must be true"),
        (request("lift_1", None, Some(f32::NAN)), Reason::InvalidField, "pace"),
        (request("lift_1", None, Some(5.0)), Reason::InvalidField, "pace"),
        (wire::SetMoverRequest { world_id: 99, ..request("lift_1", None, None) }, Reason::WorldNotFound, "99"),
    ];
    for (request, reason, says) in cases {
        let status = client.set_mover(request).await.unwrap_err();
        assert_eq!(Reason::of(&status), Some(reason), "{status}");
        assert!(status.message().contains(says), "{status}");
    }
    let halted = client.set_mover(request("lift_1", None, Some(0.0))).await.unwrap().into_inner().state.unwrap();
    assert_eq!((halted.pace, halted.told_stop), (0.0, None));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn players_push_npcs_and_are_seen_and_refused_by_name() {
    let server = start_server(ServerConfig::default());
    let (file, mode) = (level(&[("floor", [0.0, -1.0, 0.0], [30.0, 0.0, 30.0])]), wire::TimeMode::Realtime);
    let stage = world_of(&server, file, mode).await;
    let place = stage.at([15.0, 0.0, 15.0]);
    let Stage { mut client, world_id, .. } = stage;
    spawn(&mut client, world_id, place).await;
    let contact = wire::PlayerContact::Push.into();
    let beside = wire::Vec3 { x: place.x - 2.0, ..place };
    let request = wire::SpawnPlayerRequest { world_id, position: Some(beside), contact, ..Default::default() };
    let player_id = client.spawn_player(request).await.unwrap().into_inner().player_id;
    let seen = watch_until(&mut client, world_id, |snapshot| !snapshot.players.is_empty()).await;
    assert_eq!((seen.players[0].radius, seen.players[0].contact()), (0.3, wire::PlayerContact::Push));
    let moves = |x: f32, player_id: u32| wire::MovePlayersRequest {
        world_id,
        moves: vec![wire::PlayerMove { player_id, position: Some(wire::Vec3 { x, ..place }), velocity: None }],
        ..Default::default()
    };
    // At 3 m/s.
    let begun = client.move_players(moves(beside.x, player_id)).await.unwrap().into_inner().tick;
    let mut ticks = 0;
    while ticks < 80 {
        let x = beside.x + 0.05 * ticks as f32;
        ticks = client.move_players(moves(x, player_id)).await.unwrap().into_inner().tick - begun;
    }
    watch_until(&mut client, world_id, |snapshot| snapshot.npcs[0].position.unwrap().x > place.x + 1.5).await;

    let tiny = wire::SpawnPlayerRequest { radius: 0.01, ..request };
    let low = wire::SpawnPlayerRequest { radius: 0.9, height: 1.0, ..request };
    let outside = wire::SpawnPlayerRequest { position: Some(wire::Vec3 { x: -5.0, ..place }), ..request };
    for (request, says) in [(tiny, "radius"), (low, "height"), (outside, "outside the map")] {
        let status = client.spawn_player(request).await.unwrap_err();
        assert_eq!(Reason::of(&status), Some(Reason::InvalidField), "{status}");
        assert!(status.message().contains(says), "{status}");
    }
    let nowhere = client.move_players(moves(f32::NAN, player_id)).await.unwrap_err();
    assert_eq!(Reason::of(&nowhere), Some(Reason::InvalidField), "{nowhere}");
    let unknown = client.move_players(moves(place.x, 7)).await.unwrap_err();
    assert_eq!(Reason::of(&unknown), Some(Reason::PlayerNotFound), "{unknown}");
    let remove = wire::RemovePlayerRequest { world_id, player_id };
    client.remove_player(remove).await.unwrap();
    assert_eq!(Reason::of(&client.remove_player(remove).await.unwrap_err()), Some(Reason::PlayerNotFound));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_without_movers_has_none() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 7, wire::TimeMode::Realtime).await;
    let listed = client
        .list_movers(wire::ListMoversRequest { world_id: world.world_id, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert!(listed.movers.is_empty() && listed.states.is_empty());
    server.stop().await;
}
