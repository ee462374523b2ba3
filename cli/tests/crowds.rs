//! NPCs of clients beside the crowd of `surefoot up`.

use std::collections::BTreeSet;
use surefoot_processes::{Surefoot, wait_until};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;

/// NPCs of the client, far more than the crowd.
const NPCS: usize = 100;

#[tokio::test]
async fn npcs_of_a_client_get_workers_beside_a_crowd_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let scene = ["up", "--npcs", "1", "--maps", "1", "--vertices", "10", "--neighbours", "2"];
    let place = ["--planner-listen", "127.0.0.1:0", "--cache", cache.to_str().unwrap()];
    let up = Surefoot::start(&[&scene[..], &place[..]].concat(), &[], &folder.path().join("log"));
    let client = WorldServiceClient::new(up.connect().await);
    let list = async || {
        let worlds = client.clone().list_worlds(wire::ListWorldsRequest::default()).await;
        worlds.map(|worlds| worlds.into_inner().worlds).unwrap_or_default()
    };
    wait_until("a world", async || !list().await.is_empty()).await;
    let world_id = list().await[0].world_id;
    let request = wire::SampleGroundRequest { world_id, count: NPCS as u32, ..Default::default() };
    let places = client.clone().sample_ground(request).await.unwrap().into_inner().points;
    let spawns = places.into_iter().map(|place| wire::Spawn { position: Some(place), ..Default::default() }).collect();
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() };
    client.clone().batch_spawn_npcs(request).await.unwrap();
    let list_npcs = async || {
        let request = wire::ListNpcsRequest { world_id, ..Default::default() };
        client.clone().list_npcs(request).await.unwrap().into_inner().npcs
    };
    wait_until("a worker for each NPC", async || {
        let workers: Vec<u64> = list_npcs().await.iter().map(|npc| npc.worker_id).collect();
        workers.len() > NPCS && !workers.contains(&0)
    })
    .await;
    let workers: BTreeSet<u64> = list_npcs().await.iter().map(|npc| npc.worker_id).collect();
    assert_eq!(workers.len(), 2, "the workers share the NPCs");
}
