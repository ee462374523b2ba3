//! Services that are killed at any moment, again and again: what was acknowledged is there, and nothing is damaged.
//!
//! The moments are spread over a service's life: while it starts, writes, builds and answers.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};
use surefoot_processes::{LIMIT, Process, connect, free_address, surefoot};
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::planner::v1::{self as plan, BuildStage};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;

/// Kills of each service.
const KILLS: u64 = 100;

fn start(args: &[&str]) -> Process {
    Process::spawn_silent(surefoot(args))
}

/// Moments of a kill: none is far from any other's time, and some are at once.
fn moment(kill: u64) -> Duration {
    Duration::from_micros((kill * 7_919) % 60_000)
}

fn small_map(seed: u64) -> wire::MapSpec {
    wire::MapSpec { seed, size: Some(wire::MapSize { width: 50, height: 40, depth: 50 }), ..Default::default() }
}

fn files(folder: &Path) -> Vec<u64> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let id = |path: std::path::PathBuf| {
        path.extension().is_some_and(|suffix| suffix == "world").then(|| path.file_stem()?.to_str()?.parse().ok())?
    };
    let mut ids: Vec<u64> = entries.filter_map(|entry| id(entry.path())).collect();
    ids.sort_unstable();
    ids
}

#[tokio::test(flavor = "multi_thread")]
async fn every_world_that_was_saved_is_restored_after_any_kill() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().to_str().unwrap();
    let mut next_seed = 1;
    let mut greatest = 0;
    for kill in 0..KILLS {
        let address = free_address();
        let before = files(folder.path());
        let service = start(&["serve", "--listen", &address.to_string(), "--state", state, "--save-every", "0.002"]);
        let mut client = WorldServiceClient::new(connect(address).await);
        let since = Instant::now();
        while let Err(status) = client.get_server(wire::GetServerRequest {}).await {
            assert!(since.elapsed() < LIMIT, "it does not start: {status}");
        }
        let worlds = client.list_worlds(wire::ListWorldsRequest::default()).await.unwrap().into_inner().worlds;
        let ids: Vec<u64> = worlds.iter().map(|world| world.world_id).collect();
        assert_eq!(ids, before, "after kill {kill}: every file is a world again");
        assert!(worlds.iter().all(|world| world.map_hash.len() == 64 && world.npc_count == 2), "with its NPCs");
        if ids.len() >= 3 {
            client.drop_world(wire::DropWorldRequest { world_id: ids[0] }).await.unwrap();
            assert!(!files(folder.path()).contains(&ids[0]), "a dropped world is gone when that is acknowledged");
        }
        if ids.len() < 3 {
            let request = wire::CreateWorldRequest { map: Some(small_map(next_seed)), ..Default::default() };
            next_seed += 1;
            let world_id = client.create_world(request).await.unwrap().into_inner().world.unwrap().world_id;
            assert!(world_id > greatest, "no id is used again");
            greatest = world_id;
            let points = client
                .sample_ground(wire::SampleGroundRequest {
                    world_id,
                    count: 2,
                    seed: 1,
                    body: None,
                    ..Default::default()
                })
                .await
                .unwrap();
            let spawn = |at: &wire::Vec3| wire::Spawn { position: Some(*at), ..Default::default() };
            let spawns = points.into_inner().points.iter().map(spawn).collect();
            // Saved before or after: a world without its NPCs is dropped again.
            client
                .batch_spawn_npcs(wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() })
                .await
                .unwrap();
            let saved = wait_for_save(folder.path(), world_id).await;
            assert!(saved, "it is saved");
        }
        tokio::time::sleep(moment(kill)).await;
        drop(service);
    }
    assert!(next_seed > KILLS / 4, "worlds came and went: {next_seed}");
}

/// Waits until a world has been saved twice since now, so that one of the saves began after now.
async fn wait_for_save(folder: &Path, world_id: u64) -> bool {
    let path = folder.join(format!("{world_id}.world"));
    let stamp = || std::fs::metadata(&path).and_then(|metadata| metadata.modified()).ok();
    let since = Instant::now();
    for _ in 0..2 {
        let before = stamp();
        while stamp() == before || stamp().is_none() {
            if since.elapsed() > LIMIT {
                return false;
            }
            tokio::task::yield_now().await;
        }
    }
    true
}

#[tokio::test(flavor = "multi_thread")]
async fn every_edit_that_was_acknowledged_is_there_after_any_kill_and_the_graph_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().to_str().unwrap();
    let mut expected: BTreeMap<String, usize> = BTreeMap::new();
    let mut edges = None;
    let mut unanswered: Option<plan::AppendEditsRequest> = None;
    for kill in 0..KILLS {
        let address = free_address();
        let service = start(&["plan", "--listen", &address.to_string(), "--cache", cache]);
        let mut client = PlannerServiceClient::new(connect(address).await);
        let settings =
            plan::BuildSettings { vertices: 30, neighbours: 6, repeats: 1, threshold: 0.5, ..Default::default() };
        let request =
            plan::StartBuildRequest { map: Some(small_map(1000)), settings: Some(settings), ..Default::default() };
        if kill % 10 == 9 {
            // While it reads, builds or writes the graph.
            let _ = client.start_build(request.clone()).await;
            tokio::time::sleep(moment(kill)).await;
            drop(service);
            continue;
        }
        let build_id = client.start_build(request).await.unwrap().into_inner().build.unwrap().build_id;
        let mut progress = client.watch_build(plan::WatchBuildRequest { build_id }).await.unwrap().into_inner();
        let mut last = plan::Build::default();
        while let Some(message) = progress.message().await.unwrap() {
            last = message.build.unwrap();
        }
        assert_eq!(last.stage(), BuildStage::Done, "{last:?}");
        let graph_id = last.graph_id;
        let graph = client
            .get_graph(plan::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() })
            .await
            .unwrap()
            .into_inner();
        // Repeated with its id, the edit that was under way at the kill is there once, whether or not it had been
        // stored.
        if let Some(request) = unanswered.take() {
            let name = request.layer.clone();
            client.append_edits(request).await.unwrap();
            *expected.entry(name).or_default() += 1;
        }
        let layers = client
            .get_layers(plan::GetLayersRequest { graph_id: graph_id.clone(), ..Default::default() })
            .await
            .unwrap()
            .into_inner();
        let found: BTreeMap<String, usize> =
            layers.layers.iter().map(|layer| (layer.name.clone(), layer.edits.len())).collect();
        assert_eq!(found, expected, "after kill {kill}");
        // Edits of costs change no edge.
        let ends: Vec<(u32, u32)> = graph.edges.iter().map(|edge| (edge.from, edge.to)).collect();
        assert_eq!(*edges.get_or_insert(ends.clone()), ends, "after kill {kill}: another graph");
        let edge = &graph.edges[0];
        let (from, to) = (graph.vertices[edge.from as usize], graph.vertices[edge.to as usize]);
        let until = Instant::now() + moment(kill);
        let name = format!("layer {}", kill % 5);
        let editing = async {
            for number in 0.. {
                let price = plan::PriceEdge { from: Some(from), to: Some(to), factor: 1.5 };
                let edit = plan::Edit { edit: Some(plan::edit::Edit::PriceEdge(price)) };
                let request = plan::AppendEditsRequest {
                    graph_id: graph_id.clone(),
                    layer: name.clone(),
                    edits: vec![edit],
                    request_id: format!("{kill} {number}"),
                    ..Default::default()
                };
                unanswered = Some(request.clone());
                client.append_edits(request).await.unwrap();
                unanswered = None;
                *expected.entry(name.clone()).or_default() += 1;
            }
        };
        // The kill interrupts a write.
        let _ = tokio::time::timeout_at(until.into(), editing).await;
        drop(service);
    }
    assert!(expected.values().sum::<usize>() > KILLS as usize / 2, "{expected:?}");
}
