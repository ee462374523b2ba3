//! Blobs that are lost or damaged, and claims that are cleared away while others are made.

use crate::planners::{Fleet, build, client, graph, request, turn};
use crate::relay::Relay;
use crate::services::Postgres;
use std::path::PathBuf;
use std::time::Duration;
use surefoot_fleet::blobs::Blobs;
use surefoot_fleet::database::Database;
use surefoot_fleet::planners::FleetPlanner;
use surefoot_planner::GraphId;
use surefoot_planner_service::BuildId;
use surefoot_planner_service::replicas::ClaimOutcome;
use surefoot_processes::wait_until;

/// The file of the blob of a graph.
fn blob_of(fleet: &Fleet, graph_id: &str) -> PathBuf {
    let row = format!("SELECT encode(blob, 'hex') FROM graphs WHERE encode(id, 'hex') = '{graph_id}'");
    let blob = fleet.postgres.query(&row).remove(0);
    fleet.ground.path("blobs").join(&blob[..2]).join(blob)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_graph_whose_blob_is_lost_or_damaged_is_built_again() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let first = fleet.planner("first", &[]);
    let mut builds = client(&first).await;
    let id = build(&mut builds, &request(300)).await.unwrap();
    let whole = graph(&mut builds, &id).await;
    let file = blob_of(&fleet, &id);
    let bytes = std::fs::read(&file).unwrap();
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 1;
    for (name, content) in [("second", None), ("third", Some(damaged)), ("fourth", Some(Vec::new()))] {
        match content {
            Some(content) => std::fs::write(&file, content).unwrap(),
            None => std::fs::remove_file(&file).unwrap(),
        }
        let planner = fleet.planner(name, &[]);
        let mut loads = client(&planner).await;
        assert_eq!(build(&mut loads, &request(300)).await.unwrap(), id, "{name}");
        assert!(graph(&mut loads, &id).await == whole, "{name}");
        assert_eq!(planner.metric("surefoot_graphs_built_total"), Some(1.0), "{name}");
        assert_eq!(std::fs::read(blob_of(&fleet, &id)).unwrap(), bytes, "{name}: the blob is whole again");
    }
    let last = fleet.planner("last", &[]);
    build(&mut client(&last).await, &request(300)).await.unwrap();
    assert_eq!(last.metric("surefoot_graphs_built_total"), Some(0.0), "it loads what was stored again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_claim_that_is_made_while_others_are_cleared_away_stays() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let relay = Relay::to(fleet.postgres.address);
    let database = Database::open(&Postgres::url_at(relay.address)).await.unwrap();
    let blobs = Blobs::open(&fleet.ground.blobs()).unwrap();
    relay.hold(b"DELETE FROM claims");
    let address = "http://127.0.0.1:1".to_owned();
    let joined = FleetPlanner::join(database, blobs, address, Duration::from_secs(600)).await.unwrap();
    wait_until("claims are about to be cleared away", || async { relay.is_sprung() }).await;
    let replicas = joined.into_stores().replicas.unwrap();
    let claimed = tokio::task::spawn_blocking(move || {
        let claim = replicas.claim(&GraphId([7; 32]), BuildId::of_bits(1)).unwrap();
        (claim, replicas)
    });
    let (claim, replicas) = claimed.await.unwrap();
    assert!(matches!(claim, ClaimOutcome::Ours(_)), "{claim:?}");
    relay.mend();
    // What is done after it.
    let cleared = "pg_stat_activity WHERE query LIKE 'DELETE FROM operations%' OR query LIKE 'DELETE FROM members%'";
    wait_until("they are cleared away", || async { fleet.count(cleared) > 0 }).await;
    assert_eq!(fleet.count("claims"), 1);
    drop(replicas);
}
