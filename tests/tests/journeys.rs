//! NPCs reach their goals, over real sockets.

use e2e::{
    build_graph, create_world, distance, ground, planner_client, set_goal, spawn, start_planner, start_server,
    start_worker, start_worker_with, stats, stats_until, watch_until, world_client,
};
use surefoot_planner_service::PlannerConfig;
use surefoot_policy::Policy;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_server::ServerConfig;

#[tokio::test(flavor = "multi_thread")]
async fn npcs_reach_far_goals_by_plan_in_lockstep() {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let (_, summary) = build_graph(&mut planner_client(&planner).await, 1000).await;
    assert!(summary.edges > 50, "the worker's plans come from a proved graph");
    let worker = start_worker(&server, Some(&planner), 64);
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await;
    let points = ground(&mut client, world.world_id, 40).await;
    // Until the worker has the graph, its NPCs head straight for their goals, so goals are kept away from the rim of
    // the map, over which they could run.
    let inner: Vec<wire::Vec3> = points[8..]
        .iter()
        .copied()
        .filter(|point| (15.0..85.0).contains(&point.x) && (15.0..85.0).contains(&point.z))
        .collect();
    let mut sent = Vec::new();
    for (idx, start) in points.iter().enumerate().take(8) {
        let goal = *inner.iter().max_by(|a, b| distance(*start, **a).total_cmp(&distance(*start, **b))).unwrap();
        let npc = spawn(&mut client, world.world_id, *start).await;
        set_goal(&mut client, npc, goal).await;
        sent.push((npc, goal, idx));
    }
    let end =
        watch_until(&mut client, world.world_id, |snapshot| snapshot.npcs.iter().all(|npc| npc.last_outcome != 0))
            .await;
    let arrived = end.npcs.iter().filter(|npc| npc.last_outcome() == wire::Outcome::Reached).count();
    assert!(
        arrived >= 6,
        "only {arrived} of 8 arrived: {:?}",
        end.npcs.iter().map(wire::Npc::last_outcome).collect::<Vec<_>>()
    );
    let stats = stats(&mut client, world.world_id).await;
    assert_eq!(stats.reached as usize, arrived);
    assert_eq!(stats.decisions_missed, 0, "a lockstep world waits for every answer");
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_of_a_killed_worker_go_on_with_another() {
    let server = start_server(ServerConfig::default());
    let first = start_worker(&server, None, 16);
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 1001, wire::TimeMode::Realtime).await;
    let points = ground(&mut client, world.world_id, 12).await;
    let mut npcs = Vec::new();
    for start in &points[..6] {
        npcs.push(spawn(&mut client, world.world_id, *start).await);
    }
    let carried = watch_until(&mut client, world.world_id, |snapshot| set_worker_of(snapshot).is_some()).await;
    let before = set_worker_of(&carried).unwrap();
    let second = start_worker(&server, None, 16);
    for (npc, goal) in npcs.iter().zip(&points[6..]) {
        set_goal(&mut client, *npc, *goal).await;
    }
    stats_until(&mut client, world.world_id, |stats| stats.decisions_answered > 10).await;
    first.kill();
    watch_until(&mut client, world.world_id, |snapshot| set_worker_of(snapshot).is_some_and(|worker| worker != before))
        .await;
    let answered = stats(&mut client, world.world_id).await.decisions_answered;
    let ends = |stats: &wire::WorldStats| stats.reached + stats.fell + stats.burnt + stats.drowned + stats.no_progress;
    let end =
        stats_until(&mut client, world.world_id, |stats| stats.decisions_answered > answered + 60 || ends(stats) == 6)
            .await;
    assert!(end.decisions_answered > answered || ends(&end) == 6);
    second.stop().await;
    server.stop().await;
}

/// The worker that decides for every NPC of the snapshot, if there is one.
fn set_worker_of(snapshot: &wire::WatchWorldResponse) -> Option<u64> {
    let worker = snapshot.npcs.first()?.worker_id;
    (worker != 0 && snapshot.npcs.len() == 6 && snapshot.npcs.iter().all(|npc| npc.worker_id == worker))
        .then_some(worker)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_starts_before_the_server_finds_it() {
    let placeholder = start_server(ServerConfig::default());
    let uri = placeholder.uri.clone();
    let worker = start_worker(&placeholder, None, 4);
    placeholder.stop().await;
    let address = uri.trim_start_matches("http://").parse().unwrap();
    let (endpoint, shutdown) =
        (surefoot_net::serving::Endpoint::bind(address).unwrap(), surefoot_net::serving::Shutdown::default());
    let serving = tokio::spawn(surefoot_server::serve(endpoint, ServerConfig::default(), shutdown.clone()));
    let mut client = WorldServiceClient::connect(uri).await.unwrap();
    let world = create_world(&mut client, 1002, wire::TimeMode::Realtime).await;
    let start = ground(&mut client, world.world_id, 1).await[0];
    spawn(&mut client, world.world_id, start).await;
    watch_until(&mut client, world.world_id, |snapshot| snapshot.npcs.iter().all(|npc| npc.worker_id != 0)).await;
    worker.stop().await;
    shutdown.trigger();
    serving.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_restart_the_planner_answers_from_its_cache() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let (id, built) = build_graph(&mut planner_client(&planner).await, 7).await;
    assert!(!built.cached && built.probes > 0 && built.candidates >= 50 * 8);
    planner.stop().await;
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (same, cached) = build_graph(&mut client, 7).await;
    assert!(cached.cached && same == id);
    assert_eq!((cached.edges, cached.islands), (built.edges, built.islands));
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn many_requests_for_one_graph_share_one_build() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig { max_builds: 1, ..PlannerConfig::default() });
    let client = planner_client(&planner).await;
    let requests: Vec<_> = (0..200)
        .map(|_| {
            let mut client = client.clone();
            tokio::spawn(async move { build_graph(&mut client, 8).await })
        })
        .collect();
    let mut ids = std::collections::BTreeSet::new();
    for request in requests {
        ids.insert(request.await.unwrap().0);
    }
    assert_eq!(ids.len(), 1, "with room for only one build, it answers all two hundred requests");
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_with_a_memory_reach_near_goals() {
    let server = start_server(ServerConfig::default());
    let policy = Policy::shipped_named("general-lstm").expect("a shipped name").unwrap();
    assert!(policy.memory_len() > 0);
    let worker = start_worker_with(policy, &server, None, 64);
    let mut client = world_client(&server).await;
    let world = create_world(&mut client, 1000, wire::TimeMode::Lockstep).await;
    let points = ground(&mut client, world.world_id, 60).await;
    for start in &points[..8] {
        let far_enough = |point: &&wire::Vec3| distance(*start, **point) > 4.0;
        let nearest =
            points.iter().filter(far_enough).min_by(|a, b| distance(*start, **a).total_cmp(&distance(*start, **b)));
        let npc = spawn(&mut client, world.world_id, *start).await;
        set_goal(&mut client, npc, *nearest.unwrap()).await;
    }
    let end =
        watch_until(&mut client, world.world_id, |snapshot| snapshot.npcs.iter().all(|npc| npc.last_outcome != 0))
            .await;
    let arrived = end.npcs.iter().filter(|npc| npc.last_outcome() == wire::Outcome::Reached).count();
    assert!(arrived >= 6, "only {arrived} of 8 arrived");
    worker.stop().await;
    server.stop().await;
}
