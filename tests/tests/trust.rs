//! Tests that no caller can do harm: workers that fall silent, floods, full memory, other callers' property, damaged
//! files.

use e2e::{
    LIMIT, Running, build_to_end, create_world, ground, metrics, planner_client, set_goal, small_map, spawn, start_of,
    start_planner, start_server, start_server_at, start_worker, start_worker_as, start_worker_with, stats_until,
    until_metrics_say, watch_until, world_client,
};
use std::sync::Arc;
use std::time::Duration;
use surefoot_agent::WorkError;
use surefoot_net::client::{ClientTlsFiles, Credentials, Link};
use surefoot_net::levels::MapPool;
use surefoot_net::secret::Secret;
use surefoot_net::serving::tokens::Tokens;
use surefoot_net::serving::{EndpointConfig, Limits, Security};
use surefoot_planner_service::PlannerConfig;
use surefoot_policy::Policy;
use surefoot_proto::convert;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::work_request::Message as Request;
use surefoot_proto::world::v1::work_response::Message as Response;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_rollout::rehearse::Rehearsal;
use surefoot_server::ServerConfig;
use surefoot_world::sense::OBSERVATION_VERSION;
use surefoot_world::{CharacterProfile, MapSpec, Npc, OBSERVATION_LEN, TaskConfig};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;
use tonic::{Code, Status};
use tonic_types::StatusExt;

fn reason(status: &Status) -> Option<Reason> {
    Reason::of(status)
}

/// A worker that a test plays by hand.
struct Puppet {
    requests: mpsc::Sender<wire::WorkRequest>,
    responses: tonic::Streaming<wire::WorkResponse>,
}

impl Puppet {
    async fn join(server: &Running, capacity: u32) -> Self {
        let mut client = world_client(server).await;
        let (requests, stream) = mpsc::channel(64);
        let hello = wire::Hello {
            name: "puppet".to_owned(),
            capacity,
            observation_len: OBSERVATION_LEN as u32,
            observation_version: OBSERVATION_VERSION,
            policy: "by hand".to_owned(),
        };
        requests.send(wire::WorkRequest { message: Some(Request::Hello(hello)) }).await.unwrap();
        let mut responses = client.work(ReceiverStream::new(stream)).await.unwrap().into_inner();
        let first = responses.next().await.unwrap().unwrap().message;
        assert!(matches!(first, Some(Response::Welcome(_))));
        Self { requests, responses }
    }

    /// The next batch of observations.
    async fn observations(&mut self) -> wire::ObservationBatch {
        let next = async {
            loop {
                let response = self.responses.next().await.expect("the session goes on").expect("the session goes on");
                if let Some(Response::Observations(batch)) = response.message {
                    return batch;
                }
            }
        };
        tokio::time::timeout(LIMIT, next).await.expect("in time")
    }

    async fn answer(&self, batch: &wire::ObservationBatch, row: [f32; 4]) {
        self.answer_and_observe(batch, row, false).await;
    }

    /// Answers, and says whether it observes the NPCs itself from now on.
    async fn answer_and_observe(&self, batch: &wire::ObservationBatch, row: [f32; 4], observes: bool) {
        let rows = vec![row; batch.npc_ids.len()];
        let answer = wire::ActionBatch {
            world_id: batch.world_id,
            tick: batch.tick,
            npc_ids: batch.npc_ids.clone(),
            attempts: batch.attempts.clone(),
            actions: rows.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(),
            observes,
            ..Default::default()
        };
        self.requests.send(wire::WorkRequest { message: Some(Request::Actions(answer)) }).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_decided_on_many_worlds_still_gets_plans_on_the_next() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let server = start_server(ServerConfig::default());
    let worker = start_worker(&server, Some(&planner), 64);
    let mut client = world_client(&server).await;
    for _ in 0..150 {
        let world = create_world(&mut client, 1000, wire::TimeMode::Realtime).await;
        let places = ground(&mut client, world.world_id, 2).await;
        let npc = spawn(&mut client, world.world_id, places[0]).await;
        set_goal(&mut client, npc, places[1]).await;
        client.drop_world(wire::DropWorldRequest { world_id: world.world_id }).await.unwrap();
    }
    let world = create_world(&mut client, 1000, wire::TimeMode::Realtime).await;
    let places = ground(&mut client, world.world_id, 2).await;
    let npc = spawn(&mut client, world.world_id, places[0]).await;
    set_goal(&mut client, npc, places[1]).await;
    let request = wire::FollowNpcRequest { npc_id: npc, rate_hz: 60.0, rays: false, ..Default::default() };
    let mut looks = client.follow_npc(request).await.unwrap().into_inner();
    let planned = async {
        while let Some(look) = looks.next().await {
            if look.unwrap().plan.is_some_and(|plan| !plan.waypoints.is_empty()) {
                return;
            }
        }
        panic!("the stream ended");
    };
    tokio::time::timeout(LIMIT, planned).await.expect("a plan");
    let text = metrics(&server, "").await;
    assert!(
        text.contains("surefoot_worker_npcs{worker=\"1\",name=\"e2e\"} 1\n"),
        "every other place was released: {text}"
    );
    worker.stop().await;
    server.stop().await;
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_that_never_answers_stops_no_world_and_is_counted() {
    // Accepts connections and says nothing.
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let silent = tokio::spawn(async move {
        let mut sockets = Vec::new();
        while let Ok((socket, _)) = listener.accept().await {
            sockets.push(socket);
        }
    });
    let server = start_server(ServerConfig::default());
    let worker = start_worker_to(&server, &uri);
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await;
    let places = ground(&mut client, world.world_id, 2).await;
    let npc = spawn(&mut client, world.world_id, places[0]).await;
    set_goal(&mut client, npc, places[1]).await;
    let figures = stats_until(&mut client, world.world_id, |stats| stats.plans_failed > 0).await;
    assert!(figures.plans_failed > 0);
    watch_until(&mut client, world.world_id, |snapshot| snapshot.tick > 60).await;
    worker.abort();
    server.stop().await;
    silent.abort();
}

/// A worker with a planner at any address.
fn start_worker_to(server: &Running, planner: &str) -> tokio::task::JoinHandle<Result<(), WorkError>> {
    let config = surefoot_agent::WorkConfig {
        servers: vec![server.uri.clone()],
        is_of_fleet: false,
        planners: vec![planner.to_owned()],
        credentials: Credentials::default(),
        capacity: 64,
        name: "e2e".to_owned(),
        graph: surefoot_planner::BuildSettings::default(),
        noise_share: surefoot_rollout::DEFAULT_NOISE_SHARE,
        rehearses: true,
        composes: true,
        maps: MapPool::default(),
    };
    tokio::spawn(surefoot_agent::work(config, Policy::shipped().unwrap(), Default::default()))
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_of_a_worker_that_is_connected_but_silent_go_to_another() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let mut silent = Puppet::join(&server, 64).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Realtime).await;
    let places = ground(&mut client, world.world_id, 8).await;
    for pair in places.chunks(2) {
        let npc = spawn(&mut client, world.world_id, pair[0]).await;
        set_goal(&mut client, npc, pair[1]).await;
    }
    assert!(!silent.observations().await.npc_ids.is_empty());
    // It answers pings, reads its messages, and decides nothing.
    let reading = tokio::spawn(async move { while silent.responses.next().await.is_some() {} });
    let is_neglected = |npc: &wire::Npc| npc.standing() == wire::Standing::SilentWorker;
    watch_until(&mut client, world.world_id, |snapshot| snapshot.npcs.iter().any(is_neglected)).await;
    let worker = start_worker(&server, None, 64);
    watch_until(&mut client, world.world_id, |snapshot| {
        snapshot.npcs.len() == 4 && snapshot.npcs.iter().all(|npc| npc.worker_id == 2 || npc.attempts_ended > 0)
    })
    .await;
    assert!(!reading.is_finished(), "the silent worker stays connected");
    worker.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_decision_that_is_not_finite_is_counted_and_its_worker_goes_on() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let mut puppet = Puppet::join(&server, 64).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await;
    let places = ground(&mut client, world.world_id, 2).await;
    let npc = spawn(&mut client, world.world_id, places[0]).await;
    set_goal(&mut client, npc, places[1]).await;
    let first = puppet.observations().await;
    puppet.answer(&first, [f32::NAN, 0.0, 0.0, 0.0]).await;
    let second = puppet.observations().await;
    assert!(second.tick > first.tick, "the world goes on");
    puppet.answer(&second, [1.0, 0.0, 0.0, 0.0]).await;
    puppet.observations().await;
    let figures = stats_until(&mut client, world.world_id, |stats| stats.decisions_answered >= 1).await;
    assert_eq!(figures.answers_invalid, 1);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_observes_itself_sees_what_the_server_would_have_sent() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let mut puppet = Puppet::join(&server, 64).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await;
    let places = ground(&mut client, world.world_id, 2).await;
    let npc = spawn(&mut client, world.world_id, places[0]).await;
    set_goal(&mut client, npc, places[1]).await;
    let spec = convert::map_spec(world.map.as_ref()).unwrap();
    let (map, policy) = (Arc::new(surefoot_generate::generate(&spec)), Policy::shipped().unwrap());
    let mut copy = Rehearsal::new(map, CharacterProfile::default(), TaskConfig::default(), &policy);
    for decision in 0..20 {
        let sent = puppet.observations().await;
        let state = Npc::from_bytes(&sent.states[0], 1, 0).expect("a state");
        assert_eq!(convert::pack(copy.observe(&[state], &[])), sent.observations, "decision {decision}");
        puppet.answer_and_observe(&sent, [1.0, 0.5, 0.2, 0.0], true).await;
        let unsent = puppet.observations().await;
        assert_eq!((unsent.npc_ids.len(), unsent.states.len(), unsent.observations.len()), (1, 1, 0));
        puppet.answer_and_observe(&unsent, [1.0, 0.5, -0.2, 0.0], false).await;
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_of_calls_is_refused_as_busy_and_no_worker_is_cut_off() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let mut puppet = Puppet::join(&server, 64).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Realtime).await;
    let places = ground(&mut client, world.world_id, 2).await;
    let npc_id = spawn(&mut client, world.world_id, places[0]).await;
    set_goal(&mut client, npc_id, places[1]).await;
    puppet.observations().await;
    // Nothing is taken from the inbox for a second.
    let stalled = tokio::spawn(server.stall(world.world_id, Duration::from_secs(1)));
    let mut calls = tokio::task::JoinSet::new();
    for _ in 0..12 {
        // A connection has 128 streams.
        let client = world_client(&server).await;
        for _ in 0..120 {
            let mut client = client.clone();
            calls.spawn(async move { client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await });
        }
    }
    let (mut answered, mut busy) = (0, 0);
    while let Some(result) = calls.join_next().await {
        match result.unwrap() {
            Ok(_) => answered += 1,
            Err(status) => {
                assert_eq!((status.code(), reason(&status)), (Code::Unavailable, Some(Reason::Busy)), "{status}");
                assert!(status.get_details_retry_info().is_some_and(|info| info.retry_delay.is_some()));
                busy += 1;
            }
        }
    }
    stalled.await.unwrap();
    assert!(busy > 0 && answered > 0, "{answered} answered, {busy} busy");
    let batch = puppet.observations().await;
    puppet.answer(&batch, [1.0, 0.0, 0.0, 0.0]).await;
    let text = metrics(&server, "").await;
    assert!(text.lines().any(|line| line == "surefoot_workers 1"), "the worker is still there");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_drain_ends_although_every_world_is_stalled() {
    let state = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    let mut stalls = tokio::task::JoinSet::new();
    for _ in 0..8 {
        let world = create_world(&mut client, 1000, wire::TimeMode::Realtime).await;
        for _ in 0..60 {
            stalls.spawn(server.stall(world.world_id, Duration::from_secs(1)));
        }
    }
    // A minute of stalls waits in every world. Their callers leave when the server stops, as clients do.
    server.begin_stop();
    stalls.abort_all();
    tokio::time::timeout(Duration::from_secs(20), server.stop()).await.expect("the server ends");
}

#[tokio::test(flavor = "multi_thread")]
async fn saved_worlds_that_cannot_be_read_keep_their_files_and_ids_and_a_folder_has_one_server() {
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    // A second server must not write over the first one's files.
    let second = surefoot_net::serving::Endpoint::bind(([127, 0, 0, 1], 0).into()).unwrap();
    let refused = surefoot_server::serve(second, config(), Default::default()).await.unwrap_err();
    let refused = std::error::Error::source(&refused).expect("a reason").to_string();
    assert!(refused.contains("used by another server") && refused.contains("--state"), "{refused}");
    server.stop().await;
    let file = state.path().join(format!("{world_id}.world"));
    let later = state.path().join(format!("{}.world", world_id + (1 << 20)));
    std::fs::rename(&file, &later).unwrap();
    let mut bytes = std::fs::read(&later).unwrap();
    // As a newer program would write it.
    bytes[8] ^= 0xff;
    std::fs::write(&later, &bytes).unwrap();
    let server = start_server(config());
    let mut client = world_client(&server).await;
    let next = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    assert!(next > world_id + (1 << 20), "the id of the unreadable world is taken");
    server.stop().await;
    assert_eq!(std::fs::read(&later).unwrap(), bytes, "its file is as it was");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_busy_world_that_is_dropped_does_not_come_back() {
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig {
        state: Some(state.path().to_owned()),
        save_every: Duration::from_millis(20),
        ..ServerConfig::default()
    };
    let server = start_server(config());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    let file = state.path().join(format!("{world_id}.world"));
    let saved = async {
        while !file.exists() {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(LIMIT, saved).await.unwrap();
    let stalled = tokio::spawn(server.stall(world_id, Duration::from_secs(1)));
    client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    let _ = stalled.await;
    server.stop().await;
    let server = start_server(config());
    let mut client = world_client(&server).await;
    let worlds = client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap().into_inner().worlds;
    assert!(worlds.is_empty(), "{worlds:?}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_starting_server_says_so_and_stops_when_it_is_told_to() {
    let state = tempfile::tempdir().unwrap();
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config());
    let mut client = world_client(&server).await;
    // Large enough that restoring it takes a while.
    let large = wire::MapSpec { size: Some(wire::MapSize { width: 600, height: 80, depth: 600 }), ..small_map(1000) };
    let request = wire::CreateWorldRequest { map: Some(large), ..Default::default() };
    client.create_world(request).await.unwrap();
    server.stop().await;
    let server = start_server(config());
    let mut client = WorldServiceClient::connect(server.uri.clone()).await.unwrap();
    let refused = client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap_err();
    assert_eq!((refused.code(), reason(&refused)), (Code::Unavailable, Some(Reason::Starting)));
    let channel = Channel::from_shared(server.uri.clone()).unwrap().connect().await.unwrap();
    let mut health = tonic_health::pb::health_client::HealthClient::new(channel);
    let check = tonic_health::pb::HealthCheckRequest::default();
    let status = health.check(check).await.unwrap().into_inner().status();
    assert_eq!(status, tonic_health::pb::health_check_response::ServingStatus::NotServing);
    tokio::time::timeout(LIMIT, server.stop()).await.expect("the server ends");
}

#[tokio::test(flavor = "multi_thread")]
async fn memory_is_refused_before_it_is_used_and_equal_maps_are_paid_for_once() {
    // A map of 100 x 80 x 100 m takes 12 MB to generate, by the estimate.
    let config = ServerConfig { maps: MapPool::within(16_000_000), ..ServerConfig::default() };
    let server = start_server(config);
    let mut client = world_client(&server).await;
    let first = create_world(&mut client, 1, wire::TimeMode::Realtime).await;
    create_world(&mut client, 1, wire::TimeMode::Realtime).await;
    let mut refused = None;
    for seed in 2..20 {
        let request = wire::CreateWorldRequest { map: Some(small_map(seed)), ..Default::default() };
        if let Err(status) = client.create_world(request).await {
            refused = Some(status);
            break;
        }
    }
    let refused = refused.expect("the budget has an end");
    assert_eq!((refused.code(), reason(&refused)), (Code::ResourceExhausted, Some(Reason::OutOfMemory)));
    for words in ["127.0.0.1: ", " of 16 MB", "--max-memory"] {
        assert!(refused.message().contains(words), "{refused}");
    }
    let env = wire::CreateEnvRequest { map: Some(small_map(30)), npc_count: 4096, ..Default::default() };
    let refused = EnvServiceClient::connect(server.uri.clone()).await.unwrap().create_env(env).await.unwrap_err();
    assert_eq!(reason(&refused), Some(Reason::OutOfMemory));
    // The worlds go on.
    client.get_world(wire::GetWorldRequest { world_id: first.world_id }).await.unwrap();
    let worlds = client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap().into_inner().worlds;
    for world in worlds {
        client.drop_world(wire::DropWorldRequest { world_id: world.world_id }).await.unwrap();
    }
    until_metrics_say(&server, "surefoot_memory_budget_bytes 0").await;
    server.stop().await;
}

fn credentials(name: &str) -> Credentials {
    Credentials::load(Some(&Secret::new(secret(name))), &ClientTlsFiles::default()).unwrap()
}

fn secret(name: &str) -> String {
    format!("the-secret-of-{name}-is-long")
}

/// Two clients, a designer, a worker and an admin.
fn guarded(limits: Limits) -> EndpointConfig {
    let roles = [("ann", "client"), ("bob", "client"), ("dora", "designer"), ("will", "worker"), ("root", "admin")];
    let entry = |(name, role): (&str, &str)| {
        format!("[[token]]\nname = \"{name}\"\nrole = \"{role}\"\nsecret = \"{}\"\n", secret(name))
    };
    let tokens = Tokens::parse(&roles.map(entry).concat()).unwrap();
    EndpointConfig { limits, security: Security { tokens: Some(tokens), ..Security::default() } }
}

async fn link(server: &Running, name: &str) -> Link {
    credentials(name).dial(&server.uri).unwrap().connect().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_npcs_environments_and_levels_belong_to_who_made_them() {
    let server = start_server_at(guarded(Limits::default()), ServerConfig::default());
    let mut ann = WorldServiceClient::new(link(&server, "ann").await);
    let mut bob = WorldServiceClient::new(link(&server, "bob").await);
    let mut dora = WorldServiceClient::new(link(&server, "dora").await);
    let mut root = WorldServiceClient::new(link(&server, "root").await);
    let request = wire::CreateWorldRequest { map: Some(small_map(1)), ..Default::default() };
    let world_id = ann.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let places = ann
        .sample_ground(wire::SampleGroundRequest { world_id, count: 2, seed: 1, body: None, ..Default::default() })
        .await
        .unwrap();
    let place = places.into_inner().points[0];
    let spawn = wire::SpawnNpcRequest { world_id, position: Some(place), ..Default::default() };
    let npc_id = ann.spawn_npc(spawn.clone()).await.unwrap().into_inner().npc_id;
    let goal = wire::SetGoalRequest { npc_id, goal: Some(place), ..Default::default() };
    let refusals = [
        bob.drop_world(wire::DropWorldRequest { world_id }).await.unwrap_err(),
        bob.spawn_npc(spawn.clone()).await.unwrap_err(),
        bob.set_goal(goal).await.unwrap_err(),
        bob.despawn_npc(wire::DespawnNpcRequest { npc_id }).await.unwrap_err(),
        dora.set_goal(goal).await.unwrap_err(),
        dora.drop_world(wire::DropWorldRequest { world_id }).await.unwrap_err(),
    ];
    for refused in refusals {
        assert_eq!((refused.code(), reason(&refused)), (Code::PermissionDenied, Some(Reason::NotOwner)), "{refused}");
    }
    let batch = wire::BatchSetGoalsRequest { goals: vec![goal] };
    let results = bob.batch_set_goals(batch).await.unwrap().into_inner().results;
    assert!(
        matches!(&results[0].result, Some(wire::set_goal_result::Result::Error(error)) if error.reason == "NOT_OWNER")
    );
    // Anybody may look, and a designer may add an NPC of her own.
    bob.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.unwrap();
    let guest = dora.spawn_npc(spawn).await.unwrap().into_inner().npc_id;
    dora.set_goal(wire::SetGoalRequest { npc_id: guest, goal: Some(place), ..Default::default() }).await.unwrap();
    ann.despawn_npc(wire::DespawnNpcRequest { npc_id: guest }).await.expect("it is her world");

    let mut ann_envs = EnvServiceClient::new(link(&server, "ann").await);
    let mut bob_envs = EnvServiceClient::new(link(&server, "bob").await);
    let request = wire::CreateEnvRequest { map: Some(small_map(1)), npc_count: 1, ..Default::default() };
    let env_id = ann_envs.create_env(request).await.unwrap().into_inner().env_id;
    let refused = bob_envs.close_env(wire::CloseEnvRequest { env_id }).await.unwrap_err();
    assert_eq!(reason(&refused), Some(Reason::NotOwner));
    ann_envs.close_env(wire::CloseEnvRequest { env_id }).await.unwrap();

    let file = surefoot_levels::encode(&surefoot_generate::generate(&MapSpec::with_side(3, 50).unwrap()));
    let import = |name: &str| wire::ImportMapRequest {
        name: name.to_owned(),
        format: wire::MapFormat::Saved.into(),
        file: file.clone(),
        ..Default::default()
    };
    let mut ann_maps = MapServiceClient::new(link(&server, "ann").await);
    let mut bob_maps = MapServiceClient::new(link(&server, "bob").await);
    ann_maps.import_map(import("arena")).await.unwrap();
    bob_maps.import_map(import("arena")).await.expect("the same level again");
    let refused = bob_maps.import_map(import("mine")).await.unwrap_err();
    assert!(reason(&refused) == Some(Reason::NotOwner) && refused.message().contains("arena"), "{refused}");
    let named = ann_maps.import_map(import("hall")).await.unwrap().into_inner().map.unwrap().name;
    assert_eq!(named, "hall", "its owner may rename it");

    root.drop_world(wire::DropWorldRequest { world_id }).await.expect("an admin may do everything");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn idle_connections_without_a_token_make_room_for_a_client_with_one() {
    let limits = Limits { max_connections: 8, ..Limits::default() };
    let server = start_server_at(guarded(limits), ServerConfig::default());
    let mut idle = Vec::new();
    for _ in 0..8 {
        let mut socket = tokio::net::TcpStream::connect(server.address()).await.unwrap();
        // The preface and empty settings of HTTP/2, and then silence.
        socket.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").await.unwrap();
        let mut answer = [0; 9];
        socket.read_exact(&mut answer).await.unwrap();
        idle.push(socket);
    }
    let mut ann = WorldServiceClient::new(link(&server, "ann").await);
    let request = wire::CreateWorldRequest { map: Some(small_map(1)), ..Default::default() };
    let world_id =
        ann.create_world(request).await.expect("the oldest idle one is cut off").into_inner().world.unwrap().world_id;
    // Known clients stay however many strangers come.
    for _ in 0..20 {
        let mut socket = tokio::net::TcpStream::connect(server.address()).await.unwrap();
        socket.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").await.unwrap();
        idle.push(socket);
    }
    ann.get_world(wire::GetWorldRequest { world_id }).await.unwrap();
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_and_a_planner_with_different_policies_do_not_go_together() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let server = start_server(ServerConfig::default());
    let lstm = Policy::shipped_named("general-lstm").expect("it is shipped").unwrap();
    let worker = start_worker_with(lstm, &server, Some(&planner), 8);
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Realtime).await;
    let places = ground(&mut client, world.world_id, 2).await;
    let npc = spawn(&mut client, world.world_id, places[0]).await;
    set_goal(&mut client, npc, places[1]).await;
    let ended = tokio::time::timeout(LIMIT, worker.task).await.expect("the worker ends").unwrap();
    let error = ended.unwrap_err();
    assert!(matches!(error, WorkError::OtherPolicy(_)), "{error}");
    assert!(error.to_string().contains("general-reactive") && error.to_string().contains("--model"), "{error}");
    server.stop().await;
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_with_a_token_works_where_tokens_are_required() {
    let server = start_server_at(guarded(Limits::default()), ServerConfig::default());
    let worker = start_worker_as(credentials("will"), Policy::shipped().unwrap(), &server, None, 8);
    let mut ann: WorldServiceClient<Link> = WorldServiceClient::new(link(&server, "ann").await);
    let request = wire::CreateWorldRequest { map: Some(small_map(1)), ..Default::default() };
    let world_id = ann.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
    let places = ann
        .sample_ground(wire::SampleGroundRequest { world_id, count: 1, seed: 1, body: None, ..Default::default() })
        .await
        .unwrap();
    let place = places.into_inner().points[0];
    let spawns = wire::Spawn { position: Some(place), goal: Some(place), ..Default::default() };
    let batch = wire::BatchSpawnNpcsRequest { world_id, spawns: vec![spawns], ..Default::default() };
    ann.batch_spawn_npcs(batch).await.unwrap();
    let request = wire::WatchStatsRequest { world_id, period_s: 0.1 };
    let mut figures = ann.watch_stats(request).await.unwrap().into_inner();
    let reached = async {
        while let Some(message) = figures.next().await {
            if message.unwrap().stats.unwrap().reached > 0 {
                return;
            }
        }
    };
    tokio::time::timeout(LIMIT, reached).await.expect("its goal is where it stands");
    worker.stop().await;
    server.stop().await;
}

/// Everything that happens on a lockstep world with a real worker up to a tick, NPCs by the order in which they were
/// spawned.
///
/// All NPCs get their next places and goals together, once all attempts have ended: until then the world stands still.
async fn history_of_lockstep_world(
    server: &Running,
    seed: u64,
    until_tick: u64,
) -> Vec<(u64, u64, wire::npc_event::Event)> {
    const NPCS: usize = 4;
    let mut client = world_client(server).await;
    let world_id = create_world(&mut client, seed, wire::TimeMode::Lockstep).await.world_id;
    let points = ground(&mut client, world_id, 64).await;
    let mut places = points.iter().copied().cycle();
    let spawns =
        places.by_ref().take(NPCS).map(|at| wire::Spawn { position: Some(at), ..Default::default() }).collect();
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() };
    let spawned = client.batch_spawn_npcs(request).await.unwrap().into_inner().results;
    let id = |spawned: &wire::SpawnResult| match &spawned.result {
        Some(wire::spawn_result::Result::NpcId(npc_id)) => *npc_id,
        other => panic!("every place is free: {other:?}"),
    };
    let npc_ids: Vec<u64> = spawned.iter().map(id).collect();
    let after = Some(wire::EventCursor { epoch: 0, sequence: 0 });
    let mut events = client
        .watch_events(wire::WatchEventsRequest { world_id, after, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    let mut history = Vec::new();
    let mut open = 0;
    loop {
        if open == 0 {
            // Some may have died.
            let place =
                |(&npc_id, at)| wire::TeleportNpcRequest { npc_id, position: Some(at), yaw: 0.0, ..Default::default() };
            let teleports = npc_ids.iter().zip(places.by_ref()).map(place).collect();
            client.batch_teleport_npcs(wire::BatchTeleportNpcsRequest { teleports }).await.unwrap();
            let goal = |(&npc_id, goal)| wire::SetGoalRequest { npc_id, goal: Some(goal), ..Default::default() };
            let goals: Vec<_> = npc_ids.iter().zip(places.by_ref()).map(goal).collect();
            open = goals.len();
            client.batch_set_goals(wire::BatchSetGoalsRequest { goals }).await.unwrap();
        }
        let message = tokio::time::timeout(LIMIT, events.next()).await.expect("in time").unwrap().unwrap();
        for event in message.events {
            let kind = event.event.unwrap();
            open -= usize::from(matches!(kind, wire::npc_event::Event::AttemptEnded(_)));
            history.push((message.tick, event.npc_id % (1 << 28), kind));
        }
        if message.tick >= until_tick {
            client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
            history.retain(|(tick, ..)| *tick <= until_tick);
            return history;
        }
    }
}

/// A number from the environment, for runs that are longer than those of every day.
fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().expect("a number"))
}

#[tokio::test(flavor = "multi_thread")]
async fn lockstep_worlds_with_a_worker_repeat_themselves() {
    let (worlds, ticks) = (setting("SUREFOOT_REPLAY_WORLDS", 4), setting("SUREFOOT_REPLAY_TICKS", 2400));
    let server = start_server(ServerConfig::default());
    let worker = start_worker(&server, None, 64);
    for seed in 1000..1000 + worlds {
        let first = history_of_lockstep_world(&server, seed, ticks).await;
        let second = history_of_lockstep_world(&server, seed, ticks).await;
        assert!(first.len() as u64 > ticks / 150, "something happens: {} events", first.len());
        assert_eq!(first, second);
    }
    worker.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn two_hundred_requests_for_a_graph_over_eight_connections_are_one_build() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut requests = tokio::task::JoinSet::new();
    for _ in 0..8 {
        let client = planner_client(&planner).await;
        for _ in 0..25 {
            let mut client = client.clone();
            requests.spawn(async move { build_to_end(&mut client, start_of(1000)).await });
        }
    }
    let mut ids = std::collections::BTreeSet::new();
    let mut graphs = std::collections::BTreeSet::new();
    while let Some(build) = requests.join_next().await {
        let build = build.unwrap();
        ids.insert(build.build_id);
        graphs.insert(build.graph_id);
    }
    assert_eq!(graphs.len(), 1);
    let builds = planner_client(&planner)
        .await
        .list_builds(surefoot_proto::planner::v1::ListBuildsRequest::default())
        .await
        .unwrap()
        .into_inner()
        .builds;
    let probed = builds.iter().filter(|build| build.probes_done > 0).count();
    assert_eq!(probed, 1, "one build ran probes; {} requests came after it and found the graph", ids.len() - 1);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lack_of_progress_has_no_reward_of_its_own() {
    let server = start_server(ServerConfig::default());
    let mut client = EnvServiceClient::connect(server.uri.clone()).await.unwrap();
    let request =
        wire::CreateEnvRequest { map: Some(small_map(1000)), npc_count: 1, goal_min_m: 20.0, ..Default::default() };
    let env_id = client.create_env(request).await.unwrap().into_inner().env_id;
    let stand_still = Some(wire::EnvActions { actions: vec![0; 16], ..Default::default() });
    for _ in 0..1000 {
        let request = wire::StepEnvRequest { env_id, actions: stand_still.clone() };
        let results = client.step_env(request).await.unwrap().into_inner().results.unwrap();
        let reward = f32::from_le_bytes(results.rewards[..4].try_into().unwrap());
        // Nothing but the penalty of a decision, and what little it may slide towards the goal.
        assert!(reward > -0.1, "{reward}");
        if let Some(end) = results.ends.first() {
            assert_eq!(end.outcome(), wire::Outcome::NoProgress);
            server.stop().await;
            return;
        }
    }
    panic!("it stands still for ever");
}

/// A frame of HTTP/2.
fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let len = (payload.len() as u32).to_be_bytes();
    [&len[1..], &[kind, flags], &stream.to_be_bytes(), payload].concat()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rapid_reset_of_streams_ends_its_own_connection_and_nobody_elses() {
    let server = start_server(ServerConfig::default());
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    let mut socket = tokio::net::TcpStream::connect(server.address()).await.unwrap();
    socket.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").await.unwrap();
    socket.write_all(&frame(4, 0, 0, &[])).await.unwrap();
    // `:method POST`, `:scheme http`, `:path /`, all from the static table.
    let headers = [0x83, 0x86, 0x84];
    let (mut reader, mut writer) = socket.into_split();
    let flood = tokio::spawn(async move {
        for idx in 0..100_000 {
            let stream = 2 * idx + 1;
            let both = [frame(1, 0x4, stream, &headers), frame(3, 0, stream, &8u32.to_be_bytes())].concat();
            if writer.write_all(&both).await.is_err() {
                return;
            }
        }
        panic!("100,000 streams were reset, and the connection still stands");
    });
    let mut rest = Vec::new();
    let closed = tokio::time::timeout(LIMIT, reader.read_to_end(&mut rest)).await.expect("the server closes it");
    // Closed or reset: both are an end.
    drop(closed);
    flood.await.unwrap();
    client.get_world(wire::GetWorldRequest { world_id }).await.expect("others go on");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn one_clients_flood_takes_no_answers_and_no_levels_from_another() {
    let config = ServerConfig { max_maps: 4, maps: MapPool::within(200_000_000), ..ServerConfig::default() };
    let server = start_server_at(guarded(Limits::default()), config);
    let mut ann = WorldServiceClient::new(link(&server, "ann").await);
    let mut bob = WorldServiceClient::new(link(&server, "bob").await);
    let create = |request_id: &str| wire::CreateWorldRequest {
        map: Some(small_map(1)),
        request_id: request_id.to_owned(),
        ..Default::default()
    };
    let first = bob.create_world(create("bob's")).await.unwrap().into_inner();
    let world_id = ann.create_world(create("ann's")).await.unwrap().into_inner().world.unwrap().world_id;
    // 4,096 errors each: their messages alone would be 75 MB.
    for number in 0..150 {
        let spawns = vec![wire::Spawn::default(); 4096];
        let request =
            wire::BatchSpawnNpcsRequest { world_id, spawns, request_id: number.to_string(), ..Default::default() };
        ann.batch_spawn_npcs(request).await.expect("a flood is answered");
    }
    assert_eq!(bob.create_world(create("bob's")).await.unwrap().into_inner(), first, "the first answer is kept");

    let file = |seed| surefoot_levels::encode(&surefoot_generate::generate(&MapSpec::with_side(seed, 50).unwrap()));
    let import = |seed: u64| wire::ImportMapRequest {
        name: format!("level {seed}"),
        format: wire::MapFormat::Saved.into(),
        file: file(seed),
        ..Default::default()
    };
    let mut ann_maps = MapServiceClient::new(link(&server, "ann").await);
    let mut bob_maps = MapServiceClient::new(link(&server, "bob").await);
    for seed in 0..3 {
        bob_maps.import_map(import(seed)).await.unwrap();
    }
    for seed in 3..9 {
        ann_maps.import_map(import(seed)).await.unwrap();
    }
    let kept = bob_maps.list_maps(wire::ListMapsRequest::default()).await.unwrap().into_inner().maps;
    let mut names: Vec<&str> = kept.iter().map(|map| map.name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["level 1", "level 2", "level 7", "level 8"], "each has its share, and keeps its latest");
    server.stop().await;
}
