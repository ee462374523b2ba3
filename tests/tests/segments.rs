//! The motion of NPCs and players as segments, as a client that draws them reads it.

use e2e::{LIMIT, create_world, ground, set_goal, spawn, start_server, start_worker, watch, watch_until, world_client};
use prost::Message;
use std::collections::BTreeMap;
use surefoot_proto::segments::{DrawnPose, DrawnWorld};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::segment_start::Who;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;
use tonic::transport::Channel;
use tonic::{Code, Streaming};

/// Most distance of a drawn place from the true one, m.
const BOUND_M: f64 = 0.05;

/// The greatest distance of a drawn place from the true one at the tick of a snapshot, m. All bodies must be drawn.
fn error(world: &DrawnWorld, snapshot: &wire::WatchWorldResponse) -> f64 {
    let drawn: Vec<DrawnPose> = world.at(snapshot.tick).collect();
    let npcs = snapshot.npcs.iter().map(|npc| (Who::NpcId(npc.npc_id), npc.position));
    let players = snapshot.players.iter().map(|player| (Who::PlayerId(player.player_id), player.position));
    let bodies: Vec<(Who, Option<wire::Vec3>)> = npcs.chain(players).collect();
    assert_eq!(drawn.len(), bodies.len(), "at tick {}: {drawn:?} are drawn for {bodies:?}", snapshot.tick);
    let error = |(who, place): &(Who, Option<wire::Vec3>)| {
        let drawn = drawn.iter().find(|drawn| drawn.who == *who).expect("it is drawn");
        let wire::Vec3 { x, y, z } = place.expect("a place");
        let apart = [x, y, z].into_iter().zip(drawn.position).map(|(place, drawn)| (f64::from(place) - drawn).powi(2));
        apart.sum::<f64>().sqrt()
    };
    bodies.iter().map(error).fold(0.0, f64::max)
}

async fn segments(
    client: &mut WorldServiceClient<Channel>,
    request: wire::WatchSegmentsRequest,
) -> Streaming<wire::WatchSegmentsResponse> {
    client.watch_segments(request).await.expect("the world exists").into_inner()
}

async fn next(stream: &mut Streaming<wire::WatchSegmentsResponse>) -> wire::WatchSegmentsResponse {
    tokio::time::timeout(LIMIT, stream.next()).await.expect("in time").expect("an endless stream").unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn drawn_bodies_are_within_five_centimetres_of_the_true_ones_at_every_tick() {
    let server = start_server(ServerConfig::default());
    let worker = start_worker(&server, None, 8);
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 12, wire::TimeMode::Realtime).await.world_id;
    let places = ground(&mut client, world_id, 16).await;
    let mut npcs = Vec::new();
    for place in &places[..8] {
        npcs.push(spawn(&mut client, world_id, *place).await);
    }
    let player = wire::SpawnPlayerRequest { world_id, position: Some(places[0]), ..Default::default() };
    let player_id = client.spawn_player(player).await.unwrap().into_inner().player_id;
    watch_until(&mut client, world_id, |snapshot| snapshot.npcs.iter().all(|npc| npc.worker_id != 0)).await;

    let mut snapshots = watch(&mut client, world_id, 60.0).await;
    let max_ticks = 24;
    let request = wire::WatchSegmentsRequest { world_id, max_ticks, ..Default::default() };
    let mut stream = segments(&mut client, request).await;
    let mut drawn = DrawnWorld::default();
    drawn.take(&next(&mut stream).await);
    let (first, mut moves) = (drawn.tick(), BTreeMap::new());
    for (npc, goal) in npcs.iter().zip(&places[8..]) {
        set_goal(&mut client, *npc, *goal).await;
    }
    // What happens at so many ticks after the first one.
    let mut deeds = [60, 120, 150, 180].into_iter().peekable();
    let (mut pending, mut compared, mut worst) = (BTreeMap::new(), 0, 0.0_f64);
    while compared < 300 {
        tokio::select! {
            snapshot = snapshots.next() => {
                let snapshot = snapshot.expect("an endless stream").unwrap();
                let player_at = wire::Vec3 { x: places[0].x + 0.02 * (snapshot.tick % 100) as f32, ..places[0] };
                pending.insert(snapshot.tick, snapshot);
                let step = wire::PlayerMove { player_id, position: Some(player_at), ..Default::default() };
                let moves = wire::MovePlayersRequest { world_id, moves: vec![step], ..Default::default() };
                client.move_players(moves).await.unwrap();
            }
            message = next(&mut stream) => {
                drawn.take(&message);
                message.bodies.iter().for_each(|body| *moves.entry(*body).or_insert(0) += 1);
            }
        }
        let known = drawn.tick().saturating_sub(u64::from(max_ticks) + 1);
        while let Some((tick, snapshot)) = pending.pop_first() {
            if tick > known {
                pending.insert(tick, snapshot);
                break;
            }
            // A reader that was too slow has forgotten what was before.
            if tick >= drawn.since() {
                worst = worst.max(error(&drawn, &snapshot));
                compared += 1;
                drawn.forget_before(tick);
            }
        }
        if let Some(after) = deeds.next_if(|after| drawn.tick() >= first + after) {
            match after {
                60 => {
                    let position = Some(places[15]);
                    let teleport = wire::TeleportNpcRequest { npc_id: npcs[0], position, ..Default::default() };
                    _ = client.teleport_npc(teleport).await.unwrap();
                }
                120 => _ = client.despawn_npc(wire::DespawnNpcRequest { npc_id: npcs[1] }).await.unwrap(),
                150 => _ = spawn(&mut client, world_id, places[9]).await,
                _ => set_goal(&mut client, npcs[0], places[3]).await,
            }
        }
    }
    assert_eq!(deeds.next(), None);
    println!("worst error {:.2} cm at {compared} ticks", 100.0 * worst);
    assert!(worst <= BOUND_M, "{worst} m");
    assert!(moves.values().filter(|segments| **segments > 5).count() > 4, "most NPCs have gone somewhere: {moves:?}");
    worker.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_at_rest_costs_nothing_until_it_jumps_or_leaves() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 10, wire::TimeMode::Realtime).await.world_id;
    let places = ground(&mut client, world_id, 2).await;
    let npc_id = spawn(&mut client, world_id, places[0]).await;
    let request = wire::WatchSegmentsRequest { world_id, ..Default::default() };
    let mut stream = segments(&mut client, request).await;
    let first = next(&mut stream).await;
    assert!(first.restarts && first.starts.len() == 1 && first.starts[0].who == Some(Who::NpcId(npc_id)), "{first:?}");

    // It comes down first.
    let is_quiet = |message: &wire::WatchSegmentsResponse| message.bodies.is_empty() && message.starts.is_empty();
    while !is_quiet(&next(&mut stream).await) {}
    let before = next(&mut stream).await;
    let quiet = next(&mut stream).await;
    assert!(is_quiet(&before) && is_quiet(&quiet) && quiet.tick == before.tick + 60, "{before:?} {quiet:?}");
    assert!(quiet.encoded_len() <= 4, "{} bytes", quiet.encoded_len());

    let position = Some(places[1]);
    client.teleport_npc(wire::TeleportNpcRequest { npc_id, position, ..Default::default() }).await.unwrap();
    let jumped = loop {
        let message = next(&mut stream).await;
        if !message.starts.is_empty() {
            break message;
        }
    };
    assert!(jumped.starts[0].body == 0 && !jumped.restarts && jumped.bodies.is_empty(), "{jumped:?}");
    assert!(e2e::distance(jumped.starts[0].position.unwrap(), places[1]) < 0.5);
    client.despawn_npc(wire::DespawnNpcRequest { npc_id }).await.unwrap();
    while next(&mut stream).await.gone != [0] {}
    client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    let end = loop {
        match tokio::time::timeout(LIMIT, stream.next()).await.unwrap().expect("a status") {
            Ok(message) => assert!(is_quiet(&message)),
            Err(status) => break status,
        }
    };
    assert_eq!(end.code(), Code::NotFound, "{end}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_gets_the_npcs_of_its_region() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 10, wire::TimeMode::Realtime).await.world_id;
    let mut places = ground(&mut client, world_id, 40).await;
    places.sort_by(|a, b| a.x.total_cmp(&b.x));
    let inside = spawn(&mut client, world_id, places[0]).await;
    let outside = spawn(&mut client, world_id, places[39]).await;
    let border = 0.5 * (places[19].x + places[20].x);
    let corner = |x, y, z| Some(wire::Vec3 { x, y, z });
    let region = Some(wire::Region { low: corner(-1.0, -100.0, -1.0), high: corner(border, 1000.0, 1000.0) });
    let mut stream = segments(&mut client, wire::WatchSegmentsRequest { world_id, region, ..Default::default() }).await;
    let mut drawn = DrawnWorld::default();
    drawn.take(&next(&mut stream).await);
    let mut swapped = [(inside, places[39]), (outside, places[0])].into_iter();
    for npc_id in [inside, outside] {
        while !drawn.at(drawn.tick()).map(|pose| pose.who).eq([Who::NpcId(npc_id)]) {
            drawn.take(&next(&mut stream).await);
        }
        for (npc_id, place) in swapped.by_ref() {
            let position = Some(place);
            client.teleport_npc(wire::TeleportNpcRequest { npc_id, position, ..Default::default() }).await.unwrap();
        }
    }
    let upside_down = Some(wire::Region { low: corner(0.0, 10.0, 0.0), high: corner(10.0, 0.0, 10.0) });
    for (request, code, field) in [
        (
            wire::WatchSegmentsRequest { world_id, max_ticks: 5, ..Default::default() },
            Code::InvalidArgument,
            "max_ticks",
        ),
        (
            wire::WatchSegmentsRequest { world_id, max_ticks: 61, ..Default::default() },
            Code::InvalidArgument,
            "max_ticks",
        ),
        (
            wire::WatchSegmentsRequest { world_id, region: upside_down, ..Default::default() },
            Code::InvalidArgument,
            "region.high.y",
        ),
        (wire::WatchSegmentsRequest { world_id: 99, ..Default::default() }, Code::NotFound, "world 99"),
    ] {
        let refusal = client.watch_segments(request).await.unwrap_err();
        assert!(refusal.code() == code && refusal.message().contains(field), "{refusal}");
    }
    server.stop().await;
}
