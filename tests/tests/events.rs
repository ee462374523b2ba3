//! Events reach clients in order and without gaps; batch calls; idempotent calls.

use e2e::{LIMIT, create_world, distance, ground, metrics, set_goal, spawn, start_server, start_worker, world_client};
use std::collections::BTreeMap;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::npc_event::Event;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, Outcome};
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;
use tonic::transport::Channel;
use tonic::{Code, Streaming};

type Client = WorldServiceClient<Channel>;

async fn events(
    client: &mut Client,
    world_id: u64,
    after: Option<wire::EventCursor>,
) -> Streaming<wire::WatchEventsResponse> {
    let request = wire::WatchEventsRequest { world_id, after, npc_ids: Vec::new(), ..Default::default() };
    client.watch_events(request).await.unwrap().into_inner()
}

/// Reads events until `done` accepts one; returns all of them and the cursor after the last.
async fn read_until(
    stream: &mut Streaming<wire::WatchEventsResponse>,
    done: impl Fn(&wire::NpcEvent) -> bool,
) -> (Vec<wire::NpcEvent>, wire::EventCursor) {
    let reading = async {
        let mut all = Vec::new();
        loop {
            let message = stream.next().await.expect("the stream goes on").unwrap();
            all.extend(message.events);
            if all.iter().any(&done) {
                return (all, message.cursor.unwrap());
            }
        }
    };
    tokio::time::timeout(LIMIT, reading).await.expect("in time")
}

fn names(events: &[wire::NpcEvent]) -> Vec<&'static str> {
    let name = |event: &wire::NpcEvent| match event.event.as_ref().unwrap() {
        Event::Spawned(_) => "spawned",
        Event::AttemptBegan(_) => "began",
        Event::AttemptEnded(_) => "ended",
        Event::Jumped(_) => "jumped",
        Event::Landed(_) => "landed",
        Event::Rode(_) => "rode",
        Event::Died(_) => "died",
        Event::Teleported(_) => "teleported",
        Event::Removed(_) => "removed",
        Event::TargetReached(_) => "target_reached",
        Event::TargetLost(_) => "target_lost",
        Event::TargetUnreachable(_) => "target_unreachable",
        Event::TargetReachable(_) => "target_reachable",
        Event::RouteSet(_) => "route_set",
        Event::StopReached(_) => "stop_reached",
        Event::Stands(_) => "stands",
    };
    events.iter().map(name).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn every_event_has_a_number_and_a_stream_can_be_resumed_after_any_of_them() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 30, wire::TimeMode::Realtime).await.world_id;
    let points = ground(&mut client, world_id, 16).await;
    let mut stream = events(&mut client, world_id, None).await;
    let begin = stream.next().await.unwrap().unwrap();
    assert!(begin.events.is_empty() && begin.server_time.is_some(), "the stream says where it begins");
    let npc_id = spawn(&mut client, world_id, points[0]).await;
    // A goal elsewhere begins another attempt; the same goal does not.
    let apart = |point: &&wire::Vec3| distance(**point, points[1]);
    let elsewhere = *points.iter().max_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap();
    let mut attempts = Vec::new();
    for goal in [points[1], points[1], elsewhere] {
        let request = wire::SetGoalRequest { npc_id, goal: Some(goal), ..Default::default() };
        attempts.push(client.set_goal(request).await.unwrap().into_inner().attempt);
    }
    assert_eq!(attempts, [1, 1, 2]);
    let teleport = wire::TeleportNpcRequest { npc_id, position: Some(points[1]), yaw: 0.0, ..Default::default() };
    client.teleport_npc(teleport).await.unwrap();
    client.despawn_npc(wire::DespawnNpcRequest { npc_id }).await.unwrap();
    let is_removed = |event: &wire::NpcEvent| matches!(event.event, Some(Event::Removed(_)));
    let (all, cursor) = read_until(&mut stream, is_removed).await;
    let expected = ["spawned", "began", "ended", "began", "ended", "teleported", "removed"];
    // A random point may be on a slope, from which the NPC slides or drops.
    let own: Vec<_> = names(&all).into_iter().filter(|name| !["landed", "died"].contains(name)).collect();
    assert_eq!(own, expected);
    let first = begin.cursor.unwrap().sequence + 1;
    assert!(all.iter().map(|event| event.sequence).eq(first..first + all.len() as u64), "no gaps");
    assert_eq!(cursor.sequence, all.last().unwrap().sequence);
    for event in &all {
        if let Some(Event::AttemptEnded(ended)) = &event.event {
            assert_eq!(ended.outcome(), Outcome::Unspecified, "it was replaced");
        }
    }
    // A stream can be resumed after any event.
    for (idx, event) in all.iter().enumerate() {
        let after = wire::EventCursor { sequence: event.sequence, ..cursor };
        let rest = if idx + 1 == all.len() {
            Vec::new()
        } else {
            read_until(&mut events(&mut client, world_id, Some(after)).await, is_removed).await.0
        };
        assert_eq!(rest, all[idx + 1..]);
    }
    let from_oldest = Some(wire::EventCursor { sequence: 0, ..cursor });
    assert_eq!(read_until(&mut events(&mut client, world_id, from_oldest).await, is_removed).await.0, all);
    for after in [
        wire::EventCursor { sequence: cursor.sequence + 1, ..cursor },
        wire::EventCursor { epoch: cursor.epoch - 1, ..cursor },
    ] {
        let request =
            wire::WatchEventsRequest { world_id, after: Some(after), npc_ids: Vec::new(), ..Default::default() };
        let lost = client.watch_events(request).await.unwrap_err();
        assert_eq!((lost.code(), Reason::of(&lost)), (Code::OutOfRange, Some(Reason::EventsLost)));
    }
    client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    let end = stream.next().await.unwrap().unwrap_err();
    assert_eq!(Reason::of(&end), Some(Reason::WorldNotFound));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn attempts_that_events_tell_of_are_those_that_npcs_count() {
    const NPCS: usize = 24;
    let server = start_server(ServerConfig::default());
    let worker = start_worker(&server, None, 64);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 31, wire::TimeMode::Lockstep).await.world_id;
    let points = ground(&mut client, world_id, 2 * NPCS as u32).await;
    let mut stream = events(&mut client, world_id, None).await;
    let spawns = points.chunks_exact(2).map(|pair| wire::Spawn {
        position: Some(pair[0]),
        goal: Some(pair[1]),
        ..Default::default()
    });
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns: spawns.collect(), ..Default::default() };
    let results = client.batch_spawn_npcs(request).await.unwrap().into_inner().results;
    assert_eq!(results.len(), NPCS);
    let mut ended: BTreeMap<u64, Outcome> = BTreeMap::new();
    let (mut seen, mut died) = (Vec::new(), 0);
    let reading = async {
        while ended.len() < NPCS {
            for event in stream.next().await.unwrap().unwrap().events {
                match event.event.as_ref().unwrap() {
                    Event::AttemptEnded(end) => {
                        assert!(ended.insert(event.npc_id, end.outcome()).is_none(), "an attempt ends once");
                        assert!(end.attempt == 1 && end.seconds >= 0.0);
                    }
                    Event::Died(death) => {
                        assert!(death.attempt == 1 && !ended.contains_key(&event.npc_id), "the death comes first");
                        died += 1;
                    }
                    _ => {}
                }
                seen.push(event);
            }
        }
    };
    tokio::time::timeout(LIMIT, reading).await.expect("in time");
    let names = names(&seen);
    let count = |name| names.iter().filter(|other| **other == name).count();
    assert_eq!([count("spawned"), count("began"), count("ended")], [NPCS; 3]);
    assert!(count("jumped") > 0 && count("landed") > 0, "{names:?}");
    let npcs =
        client.list_npcs(wire::ListNpcsRequest { world_id, ..Default::default() }).await.unwrap().into_inner().npcs;
    assert_eq!(npcs.len(), NPCS);
    for npc in &npcs {
        assert_eq!((npc.attempts_begun, npc.attempts_ended), (1, 1));
        assert_eq!(npc.last_outcome(), ended[&npc.npc_id]);
        let is_down = npc.status() == wire::NpcStatus::Down;
        assert_eq!(is_down, npc.cause() != Outcome::Unspecified);
        assert!(npc.support() != wire::Support::Unspecified && npc.ability() != wire::Ability::Unspecified);
    }
    assert_eq!(died, npcs.iter().filter(|npc| npc.status() == wire::NpcStatus::Down).count());
    worker.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_idle_npc_that_dies_is_an_event_with_a_cause() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let features = wire::Features { lava: 4.0, ..Default::default() };
    let map = wire::MapSpec { features: Some(features), ..e2e::small_map(32) };
    let request = wire::CreateWorldRequest { map: Some(map), ..Default::default() };
    let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let pools = client
        .get_features(wire::GetFeaturesRequest { world_id, ..Default::default() })
        .await
        .unwrap()
        .into_inner()
        .pools;
    let lava = pools.iter().find(|pool| pool.lava).expect("a map with lava").centre.unwrap();
    let start = ground(&mut client, world_id, 1).await[0];
    let npc_id = spawn(&mut client, world_id, start).await;
    let mut stream = events(&mut client, world_id, None).await;
    let above = wire::Vec3 { y: lava.y + 0.5, ..lava };
    client
        .teleport_npc(wire::TeleportNpcRequest { npc_id, position: Some(above), yaw: 0.0, ..Default::default() })
        .await
        .unwrap();
    let is_death = |event: &wire::NpcEvent| matches!(event.event, Some(Event::Died(_)));
    let (all, _) = read_until(&mut stream, is_death).await;
    let Some(Event::Died(death)) = &all.iter().find(|event| is_death(event)).unwrap().event else { unreachable!() };
    assert_eq!((death.cause(), death.attempt), (Outcome::Burnt, 0));
    let npc =
        client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.unwrap().into_inner().npc.unwrap();
    assert_eq!((npc.status(), npc.cause()), (wire::NpcStatus::Down, Outcome::Burnt));
    assert_eq!((npc.last_outcome(), npc.attempts_ended), (Outcome::Unspecified, 0), "it attempted nothing");
    let refused =
        client.set_goal(wire::SetGoalRequest { npc_id, goal: Some(start), ..Default::default() }).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::NpcDown));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_item_of_a_batch_that_fails_leaves_the_others_alone() {
    let server = start_server(ServerConfig { max_npcs_per_world: 3, ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    let mut worlds = Vec::new();
    for seed in [33, 34] {
        worlds.push(create_world(&mut client, seed, wire::TimeMode::Realtime).await.world_id);
    }
    let points = ground(&mut client, worlds[0], 16).await;
    let start = points[0];
    // Without a worker, no NPC gets there.
    let apart = |point: &&wire::Vec3| distance(**point, start);
    let away = *points.iter().max_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap();
    let far = wire::Vec3 { x: 9999.0, ..start };
    let spawn = |position, goal| wire::Spawn { position, goal, ..Default::default() };
    let spawns = vec![
        spawn(Some(start), None),
        spawn(None, None),
        spawn(Some(far), None),
        spawn(Some(start), Some(far)),
        spawn(Some(start), Some(away)),
        spawn(Some(start), None),
        spawn(Some(start), None),
    ];
    let request = wire::BatchSpawnNpcsRequest { world_id: worlds[0], spawns, ..Default::default() };
    let results = client.batch_spawn_npcs(request).await.unwrap().into_inner().results;
    let reason = |result: &wire::SpawnResult| match result.result.as_ref().unwrap() {
        wire::spawn_result::Result::NpcId(_) => String::new(),
        wire::spawn_result::Result::Error(error) => error.reason.clone(),
    };
    let reasons: Vec<String> = results.iter().map(reason).collect();
    let field = "INVALID_FIELD";
    assert_eq!(reasons, ["", field, field, field, "", "", "TOO_MANY_NPCS"]);
    let ids: Vec<u64> = results
        .iter()
        .filter_map(|result| match result.result {
            Some(wire::spawn_result::Result::NpcId(id)) => Some(id),
            _ => None,
        })
        .collect();
    let other = spawn_in(&mut client, worlds[1]).await;

    // One call for NPCs of two worlds and of none; the results are in the order of the items.
    let npc_ids = vec![other, 77, ids[0], u64::MAX, ids[1]];
    let found = client
        .batch_get_npcs(wire::BatchGetNpcsRequest { npc_ids: npc_ids.clone(), ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    let found: Vec<_> = found
        .results
        .iter()
        .map(|result| match result.result.as_ref().unwrap() {
            wire::get_npc_result::Result::Npc(npc) => Ok(npc.npc_id),
            wire::get_npc_result::Result::Error(error) => Err((error.code, error.reason.as_str())),
        })
        .collect();
    let missing = Err((i32::from(Code::NotFound), "NPC_NOT_FOUND"));
    assert_eq!(found, [Ok(other), missing, Ok(ids[0]), missing, Ok(ids[1])]);
    let there = ground(&mut client, worlds[1], 1).await[0];
    let goal = |npc_id| Some(if npc_id == other { there } else { away });
    let goals = npc_ids
        .iter()
        .map(|&npc_id| wire::SetGoalRequest { npc_id, goal: goal(npc_id), ..Default::default() })
        .collect();
    let set = client.batch_set_goals(wire::BatchSetGoalsRequest { goals }).await.unwrap().into_inner().results;
    let attempt = |result: &wire::SetGoalResult| match result.result.as_ref().unwrap() {
        wire::set_goal_result::Result::Attempt(attempt) => Some(*attempt),
        wire::set_goal_result::Result::Error(_) => None,
    };
    assert_eq!(set.iter().map(attempt).collect::<Vec<_>>(), [Some(1), None, Some(1), None, Some(1)]);
    let teleports = npc_ids
        .iter()
        .map(|&npc_id| wire::TeleportNpcRequest { npc_id, position: Some(start), yaw: 0.0, ..Default::default() })
        .collect();
    let moved = client.batch_teleport_npcs(wire::BatchTeleportNpcsRequest { teleports }).await.unwrap().into_inner();
    let went_well = |results: &[wire::ItemResult]| results.iter().map(|it| it.error.is_none()).collect::<Vec<_>>();
    assert_eq!(went_well(&moved.results), [true, false, true, false, true]);
    let removed = client.batch_despawn_npcs(wire::BatchDespawnNpcsRequest { npc_ids }).await.unwrap().into_inner();
    assert_eq!(went_well(&removed.results), [true, false, true, false, true]);

    let many = client
        .batch_get_npcs(wire::BatchGetNpcsRequest { npc_ids: vec![1; 4097], ..Default::default() })
        .await
        .unwrap_err();
    assert_eq!((many.code(), Reason::of(&many)), (Code::OutOfRange, Some(Reason::TooLarge)));
    server.stop().await;
}

async fn spawn_in(client: &mut Client, world_id: u64) -> u64 {
    let start = ground(client, world_id, 1).await[0];
    spawn(client, world_id, start).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_repeated_call_creates_nothing_twice_and_lists_come_in_pages() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let request = wire::CreateWorldRequest {
        map: Some(e2e::small_map(35)),
        request_id: "one and the same".to_owned(),
        ..Default::default()
    };
    // Concurrent calls, as from a client that retries early.
    let calls: Vec<_> = (0..4)
        .map(|_| {
            let (mut client, request) = (client.clone(), request.clone());
            tokio::spawn(
                async move { client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id },
            )
        })
        .collect();
    let mut ids = Vec::new();
    for call in calls {
        ids.push(call.await.unwrap());
    }
    assert!(ids.iter().all(|id| *id == ids[0]), "{ids:?}");
    let other = wire::CreateWorldRequest { map: Some(e2e::small_map(36)), ..request.clone() };
    let reused = client.create_world(other).await.unwrap_err();
    assert_eq!((reused.code(), Reason::of(&reused)), (Code::InvalidArgument, Some(Reason::RequestIdReused)));

    let world_id = ids[0];
    let start = ground(&mut client, world_id, 1).await[0];
    let request = wire::BatchSpawnNpcsRequest {
        world_id,
        spawns: vec![wire::Spawn { position: Some(start), ..Default::default() }; 5],
        request_id: "five".to_owned(),
        ..Default::default()
    };
    let first = client.batch_spawn_npcs(request.clone()).await.unwrap().into_inner();
    assert_eq!(client.batch_spawn_npcs(request).await.unwrap().into_inner(), first);
    let (mut npcs, mut page_token) = (Vec::new(), String::new());
    loop {
        let request = wire::ListNpcsRequest { world_id, page_size: 2, page_token, region: None, ..Default::default() };
        let page = client.list_npcs(request).await.unwrap().into_inner();
        assert!(page.npcs.len() <= 2);
        npcs.extend(page.npcs.into_iter().map(|npc| npc.npc_id));
        page_token = page.next_page_token;
        if page_token.is_empty() {
            break;
        }
    }
    assert_eq!(npcs.len(), 5, "five, not ten");
    for _ in 0..2 {
        create_world(&mut client, 37, wire::TimeMode::Realtime).await;
    }
    let list = |page_size, page_token: &str| wire::ListWorldsRequest { page_size, page_token: page_token.to_owned() };
    let page = client.list_worlds(list(2, "")).await.unwrap().into_inner();
    let rest = client.list_worlds(list(2, &page.next_page_token)).await.unwrap().into_inner();
    assert_eq!((page.worlds.len(), rest.worlds.len(), rest.next_page_token.as_str()), (2, 1, ""));
    let bad = client.list_worlds(list(2, "page two")).await.unwrap_err();
    assert_eq!(Reason::of(&bad), Some(Reason::InvalidPageToken));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ids_of_before_a_restart_name_nothing_afterwards() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let about = client.get_server(wire::GetServerRequest {}).await.unwrap().into_inner();
    assert_eq!((about.ticks_per_second, about.ticks_per_decision), (60, 10));
    let mut worlds = Vec::new();
    for seed in 38..41 {
        worlds.push(create_world(&mut client, seed, wire::TimeMode::Realtime).await.world_id);
    }
    let npc_id = spawn_in(&mut client, worlds[2]).await;
    server.stop().await;
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let epoch = client.get_server(wire::GetServerRequest {}).await.unwrap().into_inner().epoch;
    assert!(epoch > about.epoch, "{epoch} after {}", about.epoch);
    let world_id = create_world(&mut client, 38, wire::TimeMode::Realtime).await.world_id;
    assert!(world_id > worlds[2], "{world_id} after {worlds:?}");
    spawn_in(&mut client, world_id).await;
    assert_eq!(
        client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.unwrap_err().code(),
        Code::NotFound
    );
    set_goal_fails(&mut client, npc_id).await;
    server.stop().await;
}

async fn set_goal_fails(client: &mut Client, npc_id: u64) {
    let goal = Some(wire::Vec3 { x: 1.0, y: 1.0, z: 1.0 });
    let refused = client.set_goal(wire::SetGoalRequest { npc_id, goal, ..Default::default() }).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::NpcNotFound));
}

#[tokio::test(flavor = "multi_thread")]
async fn deltas_say_what_changed_and_nothing_else() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 42, wire::TimeMode::Realtime).await.world_id;
    let npc_id = spawn_in(&mut client, world_id).await;
    let still = spawn_in(&mut client, world_id).await;
    let request = wire::WatchWorldRequest { world_id, rate_hz: 60.0, delta: true, ..Default::default() };
    let mut snapshots = client.watch_world(request).await.unwrap().into_inner();
    let first = snapshots.next().await.unwrap().unwrap();
    assert!(!first.is_delta && first.npcs.len() == 2 && first.server_time.is_some());
    let goal = first.npcs[0].position.unwrap();
    set_goal(&mut client, npc_id, goal).await;
    let reading = async {
        loop {
            let delta = snapshots.next().await.unwrap().unwrap();
            assert!(delta.is_delta && delta.npcs.is_empty() && delta.gone_npc_ids.is_empty());
            assert!(delta.changed.iter().all(|change| change.npc_id != still || change.attempts_begun.is_none()));
            if let Some(change) = delta.changed.into_iter().find(|change| change.attempts_begun.is_some()) {
                return change;
            }
        }
    };
    let change = tokio::time::timeout(LIMIT, reading).await.expect("a change");
    assert_eq!((change.npc_id, change.attempts_begun), (npc_id, Some(1)));
    // The NPC stands on its goal, so the attempt may have ended before the snapshot.
    assert!(change.goal.is_some() || change.last_outcome.is_some());
    assert!(change.worker_id.is_none() && change.cause.is_none() && !change.waypoint_cleared);
    client.despawn_npc(wire::DespawnNpcRequest { npc_id: still }).await.unwrap();
    let leaving = async { while snapshots.next().await.unwrap().unwrap().gone_npc_ids != [still] {} };
    tokio::time::timeout(LIMIT, leaving).await.expect("it leaves");
    server.stop().await;
}

/// An NPC of a new world, a place to teleport it to, and the world.
async fn stage(client: &mut Client, seed: u64, mode: wire::TimeMode) -> (u64, u64, wire::Vec3) {
    let world_id = create_world(client, seed, mode).await.world_id;
    let place = ground(client, world_id, 1).await[0];
    (world_id, spawn(client, world_id, place).await, place)
}

/// Reads a stream until it has shown so many teleports; returns the sequence numbers of all events.
async fn numbers_until(stream: &mut Streaming<wire::WatchEventsResponse>, teleports: usize) -> Vec<u64> {
    let (mut numbers, mut seen) = (Vec::new(), 0);
    let reading = async {
        while seen < teleports {
            for event in stream.next().await.expect("the stream goes on").unwrap().events {
                seen += usize::from(matches!(event.event, Some(Event::Teleported(_))));
                numbers.push(event.sequence);
            }
        }
    };
    tokio::time::timeout(LIMIT, reading).await.expect("in time");
    numbers
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_that_falls_behind_gets_every_event_once() {
    const NPCS: usize = 100;
    const ROUNDS: usize = 300;
    let server = start_server(ServerConfig { reader_patience: LIMIT, ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    // A lockstep world hands events out after each call.
    let (world_id, _, place) = stage(&mut client, 38, wire::TimeMode::Lockstep).await;
    let spawns = vec![wire::Spawn { position: Some(place), ..Default::default() }; NPCS];
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() };
    let results = client.batch_spawn_npcs(request).await.unwrap().into_inner().results;
    let id = |result: wire::SpawnResult| match result.result {
        Some(wire::spawn_result::Result::NpcId(id)) => id,
        other => panic!("{other:?}"),
    };
    let npc_ids: Vec<u64> = results.into_iter().map(id).collect();
    // What this connection has not read stays with the server.
    let small = Channel::from_shared(server.uri.clone()).unwrap();
    let small =
        small.initial_stream_window_size(65_535).initial_connection_window_size(65_535).connect().await.unwrap();
    let mut slow = events(&mut WorldServiceClient::new(small), world_id, None).await;
    let mut quick = events(&mut client, world_id, None).await;
    let begin = slow.next().await.unwrap().unwrap().cursor.unwrap().sequence;
    let of_quick = tokio::spawn(async move { numbers_until(&mut quick, NPCS * ROUNDS).await });
    for _ in 0..ROUNDS {
        let teleport =
            |&npc_id: &u64| wire::TeleportNpcRequest { npc_id, position: Some(place), yaw: 0.0, ..Default::default() };
        let teleports = npc_ids.iter().map(teleport).collect();
        client.batch_teleport_npcs(wire::BatchTeleportNpcsRequest { teleports }).await.unwrap();
    }
    let expected: Vec<u64> = (begin + 1..=begin + (NPCS * ROUNDS) as u64).collect();
    assert!(of_quick.await.unwrap() == expected, "the quick reader misses or repeats events");
    assert!(numbers_until(&mut slow, NPCS * ROUNDS).await == expected, "the slow reader misses or repeats events");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn readers_of_events_do_not_keep_the_thread_of_the_world_busy() {
    const READERS: usize = 40;
    const CHANGES: usize = 30;
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let (world_id, npc_id, place) = stage(&mut client, 39, wire::TimeMode::Realtime).await;
    let calls = async || {
        let name = format!("surefoot_world_calls_total{{world=\"{world_id}\"}} ");
        let text = metrics(&server, "").await;
        text.lines().find_map(|line| line.strip_prefix(&name)?.parse::<usize>().ok()).expect("a figure")
    };
    let mut readers = Vec::new();
    for _ in 0..READERS {
        let mut reader = events(&mut client, world_id, None).await;
        reader.next().await.unwrap().unwrap();
        readers.push(reader);
    }
    let before = calls().await;
    for _ in 0..CHANGES {
        let teleport = wire::TeleportNpcRequest { npc_id, position: Some(place), yaw: 0.0, ..Default::default() };
        client.teleport_npc(teleport).await.unwrap();
    }
    for reader in &mut readers {
        numbers_until(reader, CHANGES).await;
    }
    let called = calls().await - before;
    // Figures are as of the last tick: the calls that opened the streams, and one look of each into the log, may be
    // among these.
    assert!((CHANGES..CHANGES + 3 * READERS).contains(&called), "{called} calls");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_last_events_of_a_world_come_before_its_end() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    for mode in [wire::TimeMode::Realtime, wire::TimeMode::Lockstep] {
        let (world_id, npc_id, place) = stage(&mut client, 40, mode).await;
        let mut stream = events(&mut client, world_id, None).await;
        stream.next().await.unwrap().unwrap();
        // The first events show that the stream has come as far as the present.
        let teleport = wire::TeleportNpcRequest { npc_id, position: Some(place), yaw: 0.0, ..Default::default() };
        client.teleport_npc(teleport).await.unwrap();
        numbers_until(&mut stream, 1).await;
        client.teleport_npc(teleport).await.unwrap();
        client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
        numbers_until(&mut stream, 1).await;
        let end = tokio::time::timeout(LIMIT, stream.filter_map(Result::err).next()).await.unwrap().unwrap();
        assert_eq!(Reason::of(&end), Some(Reason::WorldNotFound));
    }
    server.stop().await;
}
