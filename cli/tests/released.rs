//! Files of released versions, which this version must still read (docs/reference/compatibility.md).
//!
//! `released/VERSION` holds a world of two NPCs on an imported level, a recording, and a graph, which programs of that
//! version wrote.

use std::path::{Path, PathBuf};
use surefoot_processes::{Process, free_address, output, surefoot, wait_until};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;

fn files(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
}

/// The folders of all released versions.
fn versions() -> Vec<PathBuf> {
    let versions = files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/released"));
    assert!(!versions.is_empty());
    versions
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_of_released_versions_go_on() {
    for version in versions() {
        // The server locks and changes its folder.
        let state = tempfile::tempdir().unwrap();
        let is_world = |path: &PathBuf| path.extension().is_some_and(|suffix| suffix == "world");
        let saved = files(&version).into_iter().find(is_world).expect("a world");
        std::fs::copy(&saved, state.path().join(saved.file_name().unwrap())).unwrap();
        let address = free_address();
        let state = state.path().to_str().unwrap();
        let _server = Process::spawn_silent(surefoot(&["serve", "--listen", &address.to_string(), "--state", state]));
        let mut client = WorldServiceClient::new(surefoot_processes::connect(address).await);
        let listed = async || {
            let listed = client.clone().list_worlds(wire::ListWorldsRequest::default()).await;
            listed.unwrap().into_inner().worlds
        };
        // The server listens before it has restored its worlds.
        wait_until("the world is restored", async || !listed().await.is_empty()).await;
        let request = wire::WatchWorldRequest { world_id: listed().await[0].world_id, ..Default::default() };
        let mut snapshots = client.watch_world(request).await.unwrap().into_inner();
        let npcs = snapshots.message().await.unwrap().unwrap().npcs;
        assert_eq!(npcs.len(), 2, "{}", version.display());
        assert_eq!(npcs.iter().filter(|npc| npc.goal.is_some()).count(), 1, "{npcs:?}");
    }
}

#[test]
fn recordings_and_graphs_of_released_versions_are_read() {
    for version in versions() {
        let path = |name: &str| version.join(name).to_str().unwrap().to_owned();
        let (recording, graph) = (path("run.sfreplay"), path("graph.json"));
        let read = output(&["map", "replay", &recording]);
        assert!(String::from_utf8_lossy(&read.stdout).starts_with("700 ticks"), "{read:?}");
        let same = output(&["graph", "diff", &graph, &graph, "--fail-on-loss"]);
        assert!(same.status.success(), "{same:?}");
    }
}
