//! Motion of hosted NPCs, as a game client sees it.

use e2e::{
    LIMIT, create_world, ground, set_goal, spawn, start_planner, start_server, start_worker_of, watch, worker_config,
};
use surefoot_agent::WorkConfig;
use surefoot_planner_service::PlannerConfig;
use surefoot_policy::Policy;
use surefoot_proto::world::v1::{NpcStatus, TimeMode};
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;

/// The angle between facing and motion, rad, in all snapshots of NPCs that move, until none of them seeks its goal any
/// more.
async fn angles(composes: bool) -> Vec<f32> {
    let folder = tempfile::tempdir().unwrap();
    let (server, planner) =
        (start_server(ServerConfig::default()), start_planner(folder.path(), PlannerConfig::default()));
    let config = WorkConfig { composes, ..worker_config(&server, Some(&planner), 64) };
    let worker = start_worker_of(config, Policy::shipped().unwrap());
    let mut client = e2e::world_client(&server).await;
    let world_id = create_world(&mut client, 1000, TimeMode::Lockstep).await.world_id;
    let places = ground(&mut client, world_id, 96).await;
    let mut snapshots = watch(&mut client, world_id, 60.0).await;
    for pair in places.chunks_exact(2) {
        let npc = spawn(&mut client, world_id, pair[0]).await;
        set_goal(&mut client, npc, pair[1]).await;
    }
    let mut angles = Vec::new();
    let watching = async {
        loop {
            let snapshot = snapshots.next().await.unwrap().unwrap();
            let is_seeking = |npc: &surefoot_proto::world::v1::Npc| npc.status() == NpcStatus::Seeking;
            if snapshot.npcs.len() == places.len() / 2 && !snapshot.npcs.iter().any(is_seeking) {
                return;
            }
            for npc in snapshot.npcs.iter().filter(|npc| is_seeking(npc)) {
                let velocity = npc.velocity.unwrap();
                let speed = (velocity.x * velocity.x + velocity.z * velocity.z).sqrt();
                if speed > 0.5 {
                    let along = (velocity.x * npc.yaw.sin() + velocity.z * npc.yaw.cos()) / speed;
                    angles.push(along.clamp(-1.0, 1.0).acos());
                }
            }
        }
    };
    tokio::time::timeout(LIMIT, watching).await.expect("every attempt ends");
    worker.stop().await;
    server.stop().await;
    planner.stop().await;
    angles.sort_unstable_by(f32::total_cmp);
    angles
}

#[tokio::test(flavor = "multi_thread")]
async fn composed_npcs_face_where_they_go() {
    let (composed, free) = (angles(true).await, angles(false).await);
    assert!(composed.len() > 150 && free.len() > 150, "{} and {} angles", composed.len(), free.len());
    let median = |angles: &[f32]| angles[angles.len() / 2].to_degrees();
    assert!(median(&composed) < 0.7 * median(&free), "{} and {} degrees", median(&composed), median(&free));
}
