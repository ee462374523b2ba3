//! Worlds that change hands while answers of the database are late, memory is short, versions differ, or clients flood
//! the directory.

use crate::chronicle::{client_of, locate};
use crate::relay::{Relay, Trap};
use crate::services::{Ground, Postgres};
use crate::worlds::{Fleet, create_world, small_map};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use surefoot_fleet::blobs::{BlobId, Blobs};
use surefoot_processes::{Surefoot, wait_until};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::directory_service_client::DirectoryServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use tonic::Status;
use tonic::transport::Channel;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// A fleet without servers, whose database is also behind a relay.
fn fleet_behind_a_relay() -> (Fleet, Relay) {
    let ground = Ground::new();
    let postgres = Postgres::start(&ground);
    let relay = Relay::to(postgres.address);
    (Fleet { ground, postgres, servers: Vec::new() }, relay)
}

fn add_behind(fleet: &mut Fleet, relay: &Relay, lease: &str) {
    let blobs = fleet.ground.blobs();
    fleet.add(&Postgres::url_at(relay.address), &blobs, &[], lease);
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_whose_claim_is_answered_too_late_are_restored_all_the_same() {
    let (mut fleet, relay) = fleet_behind_a_relay();
    fleet.add_with(&[], "60");
    add_behind(&mut fleet, &relay, "60");
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let mut worlds = Vec::new();
    for _ in 0..3 {
        worlds.push(create_world(&mut client).await);
    }
    // What PostgreSQL says after the claim of three worlds.
    relay.trap(b"UPDATE 3\0", Trap::Hold);
    fleet.servers[0].process.signal("TERM");
    assert!(fleet.servers[0].process.wait().success());
    wait_until("the claim is made, and its answer held back", || async { relay.has_sprung() }).await;
    let owners = || fleet.postgres.query("SELECT DISTINCT owner FROM worlds");
    let owner = owners();
    for &world_id in &worlds {
        client_of(&uris[1..], world_id).await;
    }
    assert_eq!(owners(), owner, "they never had another owner");
    assert_eq!(fleet.living_count(), 1, "and it never lost its lease");
    let counted = || fleet.servers[1].metric("surefoot_worlds_taken_over_total");
    wait_until("each is taken over once", || async { counted() == Some(3.0) }).await;
    // They are its own in all respects.
    let mut there = fleet.client(1).await;
    for &world_id in &worlds {
        there.drop_world(wire::DropWorldRequest { world_id }).await.expect("it has the world");
    }
    assert_eq!(fleet.postgres.query("SELECT count(*) FROM worlds"), ["0"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_world_whose_database_is_made_but_not_answered_runs_in_the_end() {
    let (mut fleet, relay) = fleet_behind_a_relay();
    add_behind(&mut fleet, &relay, "60");
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    relay.trap(b"INSERT 0 1\0", Trap::Lose);
    let request = wire::CreateWorldRequest {
        map: Some(small_map(3)),
        mode: wire::TimeMode::Realtime.into(),
        ..Default::default()
    };
    let unsure = client.create_world(request).await.expect_err("the answer was lost");
    assert!(relay.has_sprung(), "{unsure}");
    assert_eq!(Reason::of(&unsure), Some(Reason::NotConfirmed), "{unsure}");
    let ids = fleet.postgres.query("SELECT id FROM worlds");
    let world_id: u64 = ids[0].parse().expect("its row is there");
    client_of(&uris, world_id).await;
    let listed = client.list_worlds(wire::ListWorldsRequest::default()).await.expect("a list").into_inner().worlds;
    assert_eq!(listed.iter().map(|world| world.world_id).collect::<Vec<_>>(), [world_id]);
    let next = create_world(&mut client).await;
    for world_id in [world_id, next] {
        client.drop_world(wire::DropWorldRequest { world_id }).await.expect("its own");
    }
}

/// Worlds of the fleet, each on a map of its own that takes 55 MB to generate.
const LARGE: u64 = 10;
/// Memory budget of the small server, MB: two such maps at a time.
const SMALL: u64 = 120;

#[tokio::test(flavor = "multi_thread")]
async fn a_takeover_keeps_to_the_memory_budget_and_what_does_not_fit_goes_to_others() {
    let mut fleet = Fleet::start(1, "2");
    let mut client = fleet.client(0).await;
    let mut worlds = Vec::new();
    for seed in 0..LARGE {
        let size = wire::MapSize { width: 250, height: 80, depth: 250 };
        let map = wire::MapSpec { size: Some(size), ..small_map(seed) };
        let request =
            wire::CreateWorldRequest { map: Some(map), mode: wire::TimeMode::Realtime.into(), ..Default::default() };
        let world = client.create_world(request).await.expect("a world").into_inner().world.expect("a description");
        worlds.push(world.world_id);
    }
    fleet.add_with(&["--max-memory", &SMALL.to_string()], "2");
    fleet.client(1).await;
    let before = fleet.servers[1].process.peak_memory_bytes();
    fleet.servers[0].process.kill();
    let restored = || fleet.servers[1].metric("surefoot_worlds_taken_over_total");
    wait_until("it has what fits, and hands back the rest", || async {
        let handed = "SELECT count(*) FROM worlds JOIN members ON members.id = owner WHERE expires_at = '-infinity'";
        restored() > Some(0.0) && fleet.postgres.query(handed)[0] != "0"
    })
    .await;
    fleet.add_with(&[], "2");
    let left = fleet.uris().split_off(1);
    let mut small_count = 0;
    for &world_id in &worlds {
        client_of(&left, world_id).await;
        small_count += u64::from(locate(&left, world_id).await.as_ref() == Some(&left[0]));
    }
    let grown = (fleet.servers[1].process.peak_memory_bytes() - before) / 1_000_000;
    println!("{small_count} of {LARGE} worlds within {SMALL} MB: the server grew by {grown} MB at most");
    assert!((1..LARGE).contains(&small_count), "{small_count}");
    // The threads of worlds, and what the allocator keeps, come on top.
    assert!(grown < SMALL + 60, "{grown} MB");
}

/// The number of another version of the format of saves.
const OTHER_VERSION: u32 = 99;

#[tokio::test(flavor = "multi_thread")]
async fn a_world_that_another_version_saved_is_left_for_a_server_that_reads_it() {
    let mut fleet = Fleet::start(1, "60");
    let mut client = fleet.client(0).await;
    let world_id = create_world(&mut client).await;
    fleet.servers[0].process.signal("TERM");
    assert!(fleet.servers[0].process.wait().success());
    let blobs = Blobs::open(&fleet.ground.blobs()).expect("a folder");
    let name = fleet.postgres.query("SELECT encode(blob, 'hex') FROM worlds").remove(0);
    let id: BlobId = name.parse().expect("a name");
    let mut bytes = blobs.get(id).await.expect("a blob").expect("it is there");
    // The magic, the version.
    bytes[8..12].copy_from_slice(&OTHER_VERSION.to_le_bytes());
    let other = blobs.put(bytes).await.expect("a blob");
    let point_to = |name: &str| format!("UPDATE worlds SET blob = decode('{name}', 'hex')");
    fleet.postgres.query(&point_to(&other.to_string()));
    fleet.add_with(&[], "60");
    let there = fleet.uris().split_off(1);
    fleet.client(1).await;
    let handed = "SELECT count(*) FROM worlds JOIN members ON members.id = owner WHERE expires_at = '-infinity'";
    wait_until("it is handed back", || async {
        let log = fleet.servers[1].process.log();
        log.contains(&format!("was written by version {OTHER_VERSION} of this format"))
            && fleet.postgres.query(handed) == ["1"]
    })
    .await;
    assert!(!fleet.servers[1].process.log().contains("damaged"));
    let mut client = fleet.client(1).await;
    let moving = client.get_world(wire::GetWorldRequest { world_id }).await.expect_err("it runs nowhere");
    assert_eq!(Reason::of(&moving), Some(Reason::WorldMoving), "{moving}");
    // As after the downgrade, or as a server of that version would see it.
    fleet.postgres.query(&point_to(&name));
    client_of(&there, world_id).await;
}

/// Look-ups of the flood; `SUREFOOT_FLEET_LOOKUPS` sets more.
fn lookup_count() -> u64 {
    std::env::var("SUREFOOT_FLEET_LOOKUPS").map_or(60_000, |count| count.parse().expect("a number"))
}

/// Connections of the flood, and calls at a time on each.
const FLOOD: [usize; 2] = [8, 64];

/// Asks for what does not exist, until `count` questions were asked; returns how many were refused.
async fn flood(channel: Channel, asked: Arc<AtomicU64>, count: u64) -> u64 {
    let is_refusal = |status: Status| match Reason::of(&status) {
        Some(Reason::WorldNotFound | Reason::NpcNotFound) => false,
        Some(Reason::Busy | Reason::NotConfirmed) => true,
        other => panic!("{other:?}: {status}"),
    };
    let mut directory = DirectoryServiceClient::new(channel.clone());
    let mut worlds = WorldServiceClient::new(channel);
    let mut refused_count = 0;
    loop {
        let turn = asked.fetch_add(1, Ordering::Relaxed);
        if turn >= count {
            return refused_count;
        }
        // No two are equal, and none exists.
        let id = (1 << 62) + turn.wrapping_mul(0x9e37_79b9_7f4a_7c15) % (1 << 62);
        let refused = match turn % 8 {
            0 => worlds.get_npc(wire::GetNpcRequest { npc_id: id, ..Default::default() }).await.map(drop),
            1 => worlds.get_world(wire::GetWorldRequest { world_id: id }).await.map(drop),
            2 => directory.list_servers(wire::ListServersRequest {}).await.map(drop),
            _ => directory.locate_world(wire::LocateWorldRequest { world_id: id }).await.map(drop),
        };
        refused_count += u64::from(refused.is_err_and(is_refusal));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_of_look_ups_costs_no_server_its_lease() {
    let fleet = Fleet::start(2, "2");
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let world_id = create_world(&mut client).await;
    let owner = fleet.row(world_id);
    let members = || fleet.postgres.query("SELECT id FROM members WHERE expires_at > '-infinity' ORDER BY id");
    let joined = members();
    let (asked, count) = (Arc::new(AtomicU64::new(0)), lookup_count());
    let since = Instant::now();
    let mut floods = tokio::task::JoinSet::new();
    for connection in 0..FLOOD[0] {
        let channel = fleet.servers[connection % 2].connect().await;
        for _ in 0..FLOOD[1] {
            floods.spawn(flood(channel.clone(), asked.clone(), count));
        }
    }
    let refused_count: u64 = floods.join_all().await.into_iter().sum();
    let rate = count as f64 / since.elapsed().as_secs_f64();
    println!("{count} look-ups of what does not exist: {rate:.0} a second, {refused_count} refused");
    assert_eq!(fleet.row(world_id), owner, "the world was not moved");
    assert_eq!((members(), fleet.living_count()), (joined, 2), "no server had to join again");
    for server in &fleet.servers {
        assert!(!server.process.log().contains("stopped serving"), "{}", server.process.log());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_process_that_has_lost_its_lease_is_not_ready_but_lives() {
    let (mut fleet, relay) = fleet_behind_a_relay();
    add_behind(&mut fleet, &relay, "2");
    fleet.client(0).await;
    let (url, blobs) = (Postgres::url_at(relay.address), fleet.ground.blobs());
    let args = ["plan", "--insecure", "--store", &url, "--blobs", &blobs, "--lease", "2"];
    let planner = Surefoot::start(&args, &[], &fleet.ground.path("planner.log"));
    let services = [
        (fleet.servers[0].connect().await, "surefoot.world.v1.WorldService"),
        (planner.connect().await, "surefoot.planner.v1.PlannerService"),
    ];
    let health = async |channel: &Channel, service: &str| {
        let request = HealthCheckRequest { service: service.to_owned() };
        HealthClient::new(channel.clone()).check(request).await.expect("an answer").into_inner().status()
    };
    for (channel, service) in &services {
        wait_until("it serves", || async { health(channel, service).await == ServingStatus::Serving }).await;
    }
    relay.cut();
    for (channel, service) in &services {
        let lost = || async { health(channel, service).await == ServingStatus::NotServing };
        wait_until("its lease is lost", lost).await;
        assert_eq!(health(channel, "").await, ServingStatus::Serving, "a restart would not help");
    }
    relay.mend();
    for (channel, service) in &services {
        let back = || async { health(channel, service).await == ServingStatus::Serving };
        wait_until("it serves again", back).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_says_that_it_is_ready_once_it_has_joined_its_fleet() {
    let (mut fleet, relay) = fleet_behind_a_relay();
    relay.cut();
    add_behind(&mut fleet, &relay, "60");
    // Without the database it cannot join, and ends.
    assert!(!fleet.servers[0].process.wait().success());
    assert!(!fleet.servers[0].process.log().contains("world server ready"));
}
