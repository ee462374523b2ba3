//! Why NPCs stand, as clients read it, over real sockets.

use e2e::stage::{Stage, level, start_planning_worker, world_of};
use e2e::{
    LIMIT, create_world, ground, set_goal, spawn, start_planner, start_server, start_worker, start_worker_of,
    until_metrics_say, watch_until, worker_config, world_client,
};
use std::collections::BTreeMap;
use surefoot_agent::WorkConfig;
use surefoot_planner_service::PlannerConfig;
use surefoot_policy::Policy;
use surefoot_proto::world::v1::npc_event::Event;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, Standing, WarningReason};
use surefoot_server::ServerConfig;
use tokio::net::TcpListener;
use tokio_stream::StreamExt;
use tonic::transport::Channel;

type Client = WorldServiceClient<Channel>;

/// The first event about each of `count` NPCs that stand.
async fn stands(client: &mut Client, world_id: u64, count: usize) -> BTreeMap<u64, wire::Stands> {
    let epoch = client.get_server(wire::GetServerRequest {}).await.unwrap().into_inner().epoch;
    let after = Some(wire::EventCursor { epoch, sequence: 0 });
    let request = wire::WatchEventsRequest { world_id, after, ..Default::default() };
    let mut stream = client.watch_events(request).await.unwrap().into_inner();
    let reading = async {
        let mut found = BTreeMap::new();
        while found.len() < count {
            for event in stream.next().await.expect("the stream goes on").unwrap().events {
                if let Some(Event::Stands(stands)) = event.event {
                    found.entry(event.npc_id).or_insert(stands);
                }
            }
        }
        found
    };
    tokio::time::timeout(LIMIT, reading).await.expect("in time")
}

/// Waits until an NPC of the world stands for `reason`.
async fn until_one_stands(client: &mut Client, world_id: u64, reason: Standing) -> wire::Npc {
    let stands = |npc: &&wire::Npc| npc.standing() == reason;
    let snapshot = watch_until(client, world_id, |snapshot| snapshot.npcs.iter().any(|npc| stands(&npc))).await;
    *snapshot.npcs.iter().find(stands).unwrap()
}

fn message(warning: Option<wire::Warning>) -> String {
    let warning = warning.expect("a warning");
    assert_eq!(warning.reason(), WarningReason::NoWorker);
    warning.message
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_without_a_worker_say_so_and_calls_about_them_warn() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 30, wire::TimeMode::Realtime).await.world_id;
    let places = ground(&mut client, world_id, 5).await;
    let goal = Some(places[4]);
    let spawn_at = |place: &wire::Vec3| wire::Spawn { position: Some(*place), goal, ..Default::default() };
    let spawns = places[..3].iter().map(spawn_at).collect();
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() };
    let spawned = client.batch_spawn_npcs(request).await.unwrap().into_inner();
    assert!(message(spawned.warning).starts_with("3 NPCs have no worker, because none is connected"));

    let found = stands(&mut client, world_id, 3).await;
    for stands in found.values() {
        assert_eq!(stands.reason(), Standing::NoWorker);
        assert!(stands.seconds >= 2.0, "{stands:?}");
    }
    until_metrics_say(&server, &format!("surefoot_npcs_standing{{world=\"{world_id}\",reason=\"no_worker\"}} 3")).await;

    let worker = start_worker(&server, None, 3);
    let has_worker = |npc: &wire::Npc| npc.worker_id != 0 && npc.standing() != Standing::NoWorker;
    watch_until(&mut client, world_id, |snapshot| snapshot.npcs.iter().all(has_worker)).await;
    let request = wire::SpawnNpcRequest { world_id, position: Some(places[3]), ..Default::default() };
    let late = client.spawn_npc(request).await.unwrap().into_inner();
    assert!(message(late.warning).starts_with("1 NPC has no worker, because the only one is full"));
    for (npc_id, warns) in [(late.npc_id, true), (*found.keys().next().unwrap(), false)] {
        let request = wire::SetGoalRequest { npc_id, goal, ..Default::default() };
        match client.set_goal(request).await {
            Ok(set) => assert_eq!(set.into_inner().warning.is_some(), warns),
            // NPCs that head straight for their goals may come to harm.
            Err(status) => assert!(status.message().contains("is down"), "{status}"),
        }
    }
    let npc = until_one_stands(&mut client, world_id, Standing::NoWorker).await;
    assert_eq!(npc.npc_id, late.npc_id);
    worker.stop().await;
    server.stop().await;
}

/// Two rooms of 16 x 16 m with a door between them, and walls that nobody leaps around.
async fn rooms(server: &e2e::Running) -> Stage {
    let level = level(&[
        ("floor", [0.0, -1.0, 0.0], [33.0, 0.0, 16.0]),
        ("wall_a", [16.0, 0.0, -14.0], [17.0, 9.0, 7.0]),
        ("wall_b", [16.0, 0.0, 9.0], [17.0, 9.0, 30.0]),
        ("lintel", [16.0, 3.0, 7.0], [17.0, 9.0, 9.0]),
        ("Door_1", [16.3, 0.0, 7.0], [16.7, 3.0, 9.0]),
    ]);
    world_of(server, level, wire::TimeMode::Realtime).await
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_says_that_it_awaits_its_graph_and_that_a_door_bars_its_way() {
    let server = start_server(ServerConfig::default());
    // A planner that accepts connections and never answers.
    let silent = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let planners = vec![format!("http://{}", silent.local_addr().unwrap())];
    let config = WorkConfig { planners, ..worker_config(&server, None, 8) };
    let worker = start_worker_of(config, Policy::shipped().unwrap());
    let mut stage = rooms(&server).await;
    let (here, there) = (stage.at([4.0, 0.0, 4.0]), stage.at([29.0, 0.0, 12.0]));
    let npc_id = spawn(&mut stage.client, stage.world_id, here).await;
    set_goal(&mut stage.client, npc_id, there).await;
    until_one_stands(&mut stage.client, stage.world_id, Standing::AwaitsGraph).await;
    worker.stop().await;

    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let npc = until_one_stands(&mut stage.client, stage.world_id, Standing::Barred).await;
    assert_eq!((npc.npc_id, npc.status()), (npc_id, wire::NpcStatus::Seeking));
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lockstep_world_goes_on_once_another_world_has_left_its_places_at_a_worker() {
    let server = start_server(ServerConfig::default());
    let worker = start_worker(&server, None, 1);
    let mut client = world_client(&server).await;
    let first = create_world(&mut client, 7, wire::TimeMode::Realtime).await.world_id;
    let place = ground(&mut client, first, 1).await[0];
    spawn(&mut client, first, place).await;
    watch_until(&mut client, first, |snapshot| snapshot.npcs.iter().all(|npc| npc.worker_id != 0)).await;

    let second = create_world(&mut client, 7, wire::TimeMode::Lockstep).await.world_id;
    let places = ground(&mut client, second, 2).await;
    let npc_id = spawn(&mut client, second, places[0]).await;
    set_goal(&mut client, npc_id, places[1]).await;
    let npc = client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.unwrap().into_inner().npc;
    assert_eq!(npc.unwrap().standing(), Standing::NoWorker, "the only place is taken");
    client.drop_world(wire::DropWorldRequest { world_id: first }).await.unwrap();
    watch_until(&mut client, second, |snapshot| snapshot.npcs.iter().any(|npc| npc.worker_id != 0)).await;
    worker.stop().await;
    server.stop().await;
}
