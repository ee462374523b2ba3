//! World servers of a fleet: killed, stopped, cut off and ended while NPCs are under way.

use crate::chronicle::{Attempt, Chronicle, client_of, dial, locate};
use crate::relay::Relay;
use crate::services::{Ground, Postgres, S3};
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;
use std::time::{Duration, Instant};
use surefoot_processes::{LIMIT, Process, Surefoot, wait_until};
use surefoot_proto::reason::{Reason, address_of};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::directory_service_client::DirectoryServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use tonic::transport::Channel;
use tonic::{Code, Status};

/// NPCs of the world whose server is killed.
const NPC_COUNT: u32 = 512;
/// Longest goal from where an NPC stands, m.
const NEAR: f32 = 12.0;

/// A fleet of servers.
pub struct Fleet {
    pub servers: Vec<Surefoot>,
    pub postgres: Postgres,
    pub ground: Ground,
}

impl Fleet {
    /// Starts as many servers, with a lease of so many seconds.
    pub fn start(count: usize, lease: &str) -> Self {
        let ground = Ground::new();
        let postgres = Postgres::start(&ground);
        let mut fleet = Self { ground, postgres, servers: Vec::new() };
        for _ in 0..count {
            fleet.add_with(&[], lease);
        }
        fleet
    }

    pub fn add(&mut self, url: &str, blobs: &str, env: &[(String, String)], lease: &str) {
        let log = self.ground.path(&format!("server-{}.log", self.servers.len()));
        let args = ["serve", "--insecure", "--store", url, "--blobs", blobs, "--lease", lease];
        self.servers.push(Surefoot::start(&args, env, &log));
    }

    /// Adds a server with further flags.
    pub fn add_with(&mut self, flags: &[&str], lease: &str) {
        let log = self.ground.path(&format!("server-{}.log", self.servers.len()));
        let (url, blobs) = (self.postgres.url(), self.ground.blobs());
        let mut args = vec!["serve", "--insecure", "--store", &*url, "--blobs", &*blobs, "--lease", lease];
        args.extend(flags);
        self.servers.push(Surefoot::start(&args, &[], &log));
    }

    /// A worker of all servers.
    fn add_worker(&self, npc_count: u32, number: u32) -> Process {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surefoot"));
        let seeds = self.uris().join(",");
        command.args(["work", "--fleet", "--no-planner", "--server", &seeds, "--npcs", &npc_count.to_string()]);
        Process::spawn(command, &self.ground.path(&format!("worker-{number}.log")))
    }

    pub fn uris(&self) -> Vec<String> {
        self.servers.iter().map(Surefoot::uri).collect()
    }

    /// The server that has a world, and the others.
    async fn owner_of(&self, world_id: u64) -> usize {
        let address = locate(&self.uris(), world_id).await.expect("a server has it");
        self.servers.iter().position(|server| server.uri() == address).expect("one of ours")
    }

    pub async fn client(&self, idx: usize) -> WorldServiceClient<Channel> {
        let mut client = WorldServiceClient::new(self.servers[idx].connect().await);
        wait_until("the server is ready", || {
            let mut client = client.clone();
            async move { client.get_server(wire::GetServerRequest {}).await.is_ok() }
        })
        .await;
        client.get_server(wire::GetServerRequest {}).await.expect("it is ready");
        client
    }

    /// Members that hold a lease.
    pub fn living_count(&self) -> usize {
        self.postgres.query("SELECT id FROM members WHERE expires_at > now()").len()
    }

    /// Transactions of the database since it was created.
    fn commit_count(&self) -> f64 {
        let count = "SELECT xact_commit FROM pg_stat_database WHERE datname = 'surefoot'";
        self.postgres.query(count)[0].parse().expect("a number")
    }

    /// What the row of a world says: owner and token.
    pub fn row(&self, world_id: u64) -> Vec<String> {
        self.postgres.query(&format!("SELECT owner, token FROM worlds WHERE id = {world_id}"))
    }
}

pub fn small_map(seed: u64) -> wire::MapSpec {
    wire::MapSpec { seed, size: Some(wire::MapSize { width: 100, height: 80, depth: 100 }), ..Default::default() }
}

pub async fn create_world(client: &mut WorldServiceClient<Channel>) -> u64 {
    let request = wire::CreateWorldRequest {
        map: Some(small_map(3)),
        mode: wire::TimeMode::Realtime.into(),
        solid_npcs: Some(false),
        ..Default::default()
    };
    client.create_world(request).await.expect("a world").into_inner().world.expect("a description").world_id
}

/// A game on one world: it knows where NPCs can stand, sends them there, and remembers which attempts it was promised.
struct Game {
    world_id: u64,
    places: Vec<wire::Vec3>,
    set: BTreeSet<Attempt>,
    turn: usize,
}

fn distance(a: wire::Vec3, b: wire::Vec3) -> f32 {
    ((a.x - b.x).powi(2) + (a.y - b.y).powi(2) + (a.z - b.z).powi(2)).sqrt()
}

impl Game {
    async fn begin(client: &mut WorldServiceClient<Channel>, npc_count: u32) -> Self {
        let world_id = create_world(client).await;
        let sample =
            wire::SampleGroundRequest { world_id, count: npc_count.max(64), seed: 1, body: None, ..Default::default() };
        let places = client.sample_ground(sample).await.expect("ground").into_inner().points;
        let mut game = Self { world_id, places, set: BTreeSet::new(), turn: 0 };
        for idx in 0..npc_count as usize {
            let position = game.places[idx];
            let goal = game.near(position);
            let spawn = wire::Spawn { position: Some(position), goal: Some(goal), ..Default::default() };
            game.spawn(client, spawn).await;
        }
        game
    }

    async fn spawn(&mut self, client: &mut WorldServiceClient<Channel>, spawn: wire::Spawn) -> u64 {
        let request =
            wire::BatchSpawnNpcsRequest { world_id: self.world_id, spawns: vec![spawn], ..Default::default() };
        let results = client.batch_spawn_npcs(request).await.expect("an answer").into_inner().results;
        let Some(wire::spawn_result::Result::NpcId(npc_id)) = results[0].result else {
            panic!("not spawned: {results:?}")
        };
        self.set.insert((npc_id, 1));
        npc_id
    }

    /// A place near `from`, another one each time.
    fn near(&mut self, from: wire::Vec3) -> wire::Vec3 {
        for _ in 0..self.places.len() {
            self.turn = (self.turn + 7) % self.places.len();
            let place = self.places[self.turn];
            if (1.5..NEAR).contains(&distance(from, place)) {
                return place;
            }
        }
        from
    }

    /// NPCs by their ids.
    async fn npcs(&self, client: &mut WorldServiceClient<Channel>) -> BTreeMap<u64, wire::Npc> {
        let request = wire::ListNpcsRequest { world_id: self.world_id, page_size: 4096, ..Default::default() };
        let npcs = client.list_npcs(request).await.expect("a list").into_inner().npcs;
        npcs.into_iter().map(|npc| (npc.npc_id, npc)).collect()
    }

    /// Gives goals to all NPCs that have none, or stops all; returns how many were given.
    async fn send(&mut self, client: &mut WorldServiceClient<Channel>, is_last: bool) -> Result<usize, Status> {
        let request = wire::ListNpcsRequest { world_id: self.world_id, page_size: 4096, ..Default::default() };
        let npcs = client.list_npcs(request).await?.into_inner().npcs;
        let mut goals = Vec::new();
        for npc in npcs {
            let (Some(position), npc_id) = (npc.position, npc.npc_id) else { continue };
            match npc.status() {
                wire::NpcStatus::Idle if !is_last => {
                    goals.push(wire::SetGoalRequest { npc_id, goal: Some(self.near(position)), ..Default::default() });
                }
                // The goal that it has is replaced, and the new one reached at once.
                wire::NpcStatus::Seeking if is_last => {
                    goals.push(wire::SetGoalRequest { npc_id, goal: Some(position), ..Default::default() });
                }
                _ => {}
            }
        }
        let count = goals.len();
        let asked = goals.clone();
        let results = client.batch_set_goals(wire::BatchSetGoalsRequest { goals }).await?.into_inner().results;
        for (goal, result) in asked.iter().zip(results) {
            if let Some(wire::set_goal_result::Result::Attempt(attempt)) = result.result {
                self.set.insert((goal.npc_id, attempt));
            }
        }
        Ok(count)
    }

    /// Gives goals to one NPC, and measures how long each call takes.
    async fn time_calls(&mut self, client: &mut WorldServiceClient<Channel>, count: usize) -> Vec<Duration> {
        let npc_id = self.spawn_one(client).await;
        let mut waits = Vec::with_capacity(count);
        for _ in 0..count {
            let order = wire::SetGoalRequest { npc_id, goal: Some(self.places[1]), ..Default::default() };
            let since = Instant::now();
            let attempt = client.set_goal(order).await.expect("an answer").into_inner().attempt;
            waits.push(since.elapsed());
            self.set.insert((npc_id, attempt));
        }
        waits
    }

    async fn spawn_one(&mut self, client: &mut WorldServiceClient<Channel>) -> u64 {
        let spawn = wire::Spawn { position: Some(self.places[0]), goal: Some(self.places[1]), ..Default::default() };
        self.spawn(client, spawn).await
    }

    /// Plays until that many more attempts have ended.
    async fn play(&mut self, uris: &[String], chronicle: &Chronicle, more: usize) {
        let goal = chronicle.ended_count() + more;
        let since = Instant::now();
        while chronicle.ended_count() < goal {
            assert!(since.elapsed() < LIMIT, "only {} attempts have ended", chronicle.ended_count());
            let mut client = client_of(uris, self.world_id).await;
            // A server that dies just now answers nothing.
            let _ = tokio::time::timeout(Duration::from_secs(2), self.send(&mut client, false)).await;
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Ends all attempts, and checks that each has ended once.
    async fn end(&mut self, uris: &[String], chronicle: &Chronicle) {
        let since = Instant::now();
        loop {
            let mut client = client_of(uris, self.world_id).await;
            let left = self.send(&mut client, true).await.expect("an answer");
            let open = chronicle.read(|told| told.began.keys().filter(|it| !told.ended.contains_key(it)).count());
            if left == 0 && open == 0 {
                break;
            }
            assert!(since.elapsed() < LIMIT, "{left} NPCs go on, {open} attempts are open");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        chronicle.check(&self.set);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_killed_under_512_npcs_is_replaced_and_each_attempt_ends_once() {
    let mut fleet = Fleet::start(2, "3");
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let _workers = [fleet.add_worker(NPC_COUNT / 2, 0), fleet.add_worker(NPC_COUNT / 2, 1)];
    let mut game = Game::begin(&mut client, NPC_COUNT).await;
    let chronicle = Chronicle::follow(&uris, game.world_id);
    let (commits, since) = (fleet.commit_count(), Instant::now());
    game.play(&uris, &chronicle, 600).await;
    let commits_per_s = (fleet.commit_count() - commits) / since.elapsed().as_secs_f64();
    let mut waits = game.time_calls(&mut client, 200).await;
    waits.sort();
    game.play(&uris, &chronicle, 100).await;
    let before: Vec<u64> = game.npcs(&mut client).await.into_keys().collect();
    let seen = chronicle.read(|told| told.sequences.len());
    fleet.servers[0].process.kill();
    let killed = Instant::now();
    let mut client = client_of(&uris, game.world_id).await;
    let restored = killed.elapsed();
    game.send(&mut client, false).await.expect("an answer");
    wait_until("events go on", || async { chronicle.read(|told| told.sequences.len()) > seen + 20 }).await;
    let resumed = killed.elapsed();
    let after: Vec<u64> = game.npcs(&mut client).await.into_keys().collect();
    assert_eq!(before, after, "the ids of NPCs");
    game.play(&uris, &chronicle, 300).await;
    game.end(&uris, &chronicle).await;
    println!(
        "killed under {NPC_COUNT} NPCs: on the other server after {restored:?}, events after {resumed:?}; \
         {} attempts, each ended once; before, {commits_per_s:.0} commits/s for both servers, \
         a goal was confirmed after {:?} (median), {:?} (p99)",
        chronicle.ended_count(),
        waits[waits.len() / 2],
        waits[waits.len() * 99 / 100],
    );
    assert!(resumed < Duration::from_secs(10), "{resumed:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_was_stopped_past_its_lease_neither_writes_nor_serves() {
    let fleet = Fleet::start(2, "2");
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let _worker = fleet.add_worker(64, 0);
    let mut game = Game::begin(&mut client, 32).await;
    let chronicle = Chronicle::follow(&uris, game.world_id);
    game.play(&uris, &chronicle, 40).await;
    fleet.servers[0].process.signal("STOP");
    let other = vec![uris[1].clone()];
    let mut there = client_of(&other, game.world_id).await;
    game.play(&other, &chronicle, 40).await;
    let row = fleet.row(game.world_id);
    let npc_id = *game.npcs(&mut there).await.keys().next().expect("an NPC");
    fleet.servers[0].process.signal("CONT");
    // The connection is the old one: what it is asked first, it is asked as it wakes.
    let order = wire::SetGoalRequest { npc_id, goal: Some(game.places[0]), ..Default::default() };
    let refused = client.set_goal(order).await.expect_err("it is not its world any more");
    let reason = Reason::of(&refused);
    assert!(matches!(reason, Some(Reason::WorldElsewhere | Reason::WorldMoving | Reason::NotConfirmed)), "{refused}");
    wait_until("it says where the world is", || {
        let mut client = client.clone();
        let there = &uris[1];
        async move {
            let refused =
                client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.expect_err("not its world");
            refused.code() == Code::NotFound && address_of(&refused).as_ref() == Some(there)
        }
    })
    .await;
    wait_until("it is a server again, without worlds", || async { fleet.living_count() == 2 }).await;
    assert_eq!(fleet.row(game.world_id), row, "no other server took the world meanwhile");
    game.play(&uris, &chronicle, 40).await;
    assert_eq!(fleet.row(game.world_id), row);
    game.end(&uris, &chronicle).await;
    // As any other, it takes over worlds.
    fleet.servers[1].process.signal("TERM");
    wait_until("it has the world again", || async {
        locate(&uris[..1], game.world_id).await.is_some_and(|address| address == uris[0])
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_ends_hands_its_worlds_over_at_once() {
    // Who waited for the lease would wait for longer than the test does.
    let mut fleet = Fleet::start(3, "600");
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    fleet.client(2).await;
    let _worker = fleet.add_worker(64, 0);
    let mut game = Game::begin(&mut client, 32).await;
    let mut others = Vec::new();
    for _ in 0..5 {
        others.push(create_world(&mut client).await);
    }
    let chronicle = Chronicle::follow(&uris, game.world_id);
    game.play(&uris, &chronicle, 40).await;
    fleet.servers[0].process.signal("TERM");
    let since = Instant::now();
    assert!(fleet.servers[0].process.wait().success());
    let (left, ended) = (&uris[1..], since.elapsed());
    client_of(left, game.world_id).await;
    println!("SIGTERM: ended after {ended:?}, on another server after {:?}", since.elapsed());
    let mut counts = BTreeMap::new();
    for world_id in others.into_iter().chain([game.world_id]) {
        client_of(left, world_id).await;
        *counts.entry(locate(left, world_id).await.expect("a server has it")).or_insert(0) += 1;
    }
    assert!(counts.values().all(|count| (2..=4).contains(count)), "shared fairly: {counts:?}");
    game.play(left, &chronicle, 40).await;
    game.end(left, &chronicle).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_server_knows_where_worlds_are_and_no_id_is_given_twice() {
    let fleet = Fleet::start(2, "600");
    let uris = fleet.uris();
    let clients = [fleet.client(0).await, fleet.client(1).await];
    let create = |mut client: WorldServiceClient<Channel>| {
        tokio::spawn(async move {
            let mut ids = Vec::new();
            for _ in 0..8 {
                ids.push(create_world(&mut client).await);
            }
            ids
        })
    };
    let [here, there] = [create(clients[0].clone()), create(clients[1].clone())];
    let (here, there) = (here.await.expect("worlds"), there.await.expect("worlds"));
    let all: BTreeSet<u64> = here.iter().chain(&there).copied().collect();
    assert_eq!(all.len(), 16);
    for (ids, owner) in [(&here, 0), (&there, 1)] {
        for &world_id in ids {
            for asked in 0..2 {
                let found = locate(&uris[asked..=asked], world_id).await;
                assert_eq!(found.as_ref(), Some(&uris[owner]));
            }
            let wrong = clients[1 - owner].clone().get_world(wire::GetWorldRequest { world_id }).await.unwrap_err();
            assert_eq!((wrong.code(), Reason::of(&wrong)), (Code::NotFound, Some(Reason::WorldElsewhere)));
            assert_eq!(address_of(&wrong).as_ref(), Some(&uris[owner]));
        }
    }
    for uri in &uris {
        let mut directory = DirectoryServiceClient::new(dial(uri).await.expect("a server"));
        let servers = directory.list_servers(wire::ListServersRequest {}).await.expect("a list").into_inner().servers;
        let listed: BTreeSet<_> = servers.iter().map(|it| (it.address.clone(), it.world_count)).collect();
        assert_eq!(listed, uris.iter().map(|uri| (uri.clone(), 8)).collect());
        assert!(servers.iter().all(|server| server.is_this == (server.address == *uri)));
        let unknown = directory.locate_world(wire::LocateWorldRequest { world_id: 7 }).await.unwrap_err();
        assert_eq!(Reason::of(&unknown), Some(Reason::WorldNotFound));
    }
    // A world that is dropped is gone everywhere, and its blob too.
    let world_id = here[0];
    clients[0].clone().drop_world(wire::DropWorldRequest { world_id }).await.expect("its owner may");
    wait_until("the other server knows that it is gone, too", || {
        let mut there = clients[1].clone();
        async move {
            let gone = there.get_world(wire::GetWorldRequest { world_id }).await.unwrap_err();
            Reason::of(&gone) == Some(Reason::WorldNotFound)
        }
    })
    .await;
    assert_eq!(fleet.postgres.query("SELECT count(*) FROM worlds"), ["15"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_alone_answers_for_itself() {
    let ground = Ground::new();
    let server = Surefoot::start(&["serve", "--insecure"], &[], &ground.path("server.log"));
    let mut client = WorldServiceClient::new(server.connect().await);
    let world_id = create_world(&mut client).await;
    let mut directory = DirectoryServiceClient::new(server.connect().await);
    let found = directory.locate_world(wire::LocateWorldRequest { world_id }).await.expect("its world").into_inner();
    assert_eq!(found.server, Some(wire::ServerInfo { address: String::new(), is_this: true, world_count: 1 }));
    let unknown = directory.locate_world(wire::LocateWorldRequest { world_id: 7 }).await.unwrap_err();
    assert_eq!(Reason::of(&unknown), Some(Reason::WorldNotFound));
    let mut command = Command::new(env!("CARGO_BIN_EXE_surefoot"));
    command.args(["work", "--fleet", "--no-planner", "--server", &server.uri(), "--npcs", "8"]);
    let _worker = Process::spawn(command, &ground.path("worker.log"));
    wait_until("a worker of the fleet serves it", || async { server.metric("surefoot_workers") == Some(1.0) }).await;
    let missing = Command::new(env!("CARGO_BIN_EXE_surefoot"))
        .args([
            "serve",
            "--insecure",
            "--listen",
            "127.0.0.1:0",
            "--store",
            "postgres://nobody:secret@127.0.0.1:1/none",
        ])
        .output()
        .expect("it runs");
    let said = String::from_utf8_lossy(&missing.stderr).into_owned();
    assert!(!missing.status.success() && said.contains("--store needs --blobs"), "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_go_on_while_the_database_restarts_and_nobody_takes_them() {
    let mut fleet = Fleet::start(2, "60");
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let _worker = fleet.add_worker(64, 0);
    let mut game = Game::begin(&mut client, 32).await;
    let world_id = game.world_id;
    let chronicle = Chronicle::follow(&uris, world_id);
    game.play(&uris, &chronicle, 40).await;
    let row = fleet.row(world_id);
    let tick = async |client: &mut WorldServiceClient<Channel>| {
        client.get_world(wire::GetWorldRequest { world_id }).await.expect("it runs").into_inner().world.unwrap().tick
    };
    fleet.postgres.kill();
    let (told, at) = (chronicle.read(|told| told.sequences.len()), tick(&mut client).await);
    wait_until("it steps without the database", || {
        let mut client = client.clone();
        async move { tick(&mut client).await > at + 120 }
    })
    .await;
    let npc_id = *game.npcs(&mut client).await.keys().next().expect("an NPC");
    let order = wire::SetGoalRequest { npc_id, goal: Some(game.places[1]), ..Default::default() };
    let unconfirmed = client.set_goal(order).await.expect_err("the change is not durable");
    assert_eq!(Reason::of(&unconfirmed), Some(Reason::NotConfirmed), "{unconfirmed}");
    fleet.postgres.start_again();
    wait_until("events arrive again", || async { chronicle.read(|told| told.sequences.len()) > told }).await;
    game.play(&uris, &chronicle, 40).await;
    assert_eq!(fleet.row(world_id), row, "the same server has it all the time");
    game.end(&uris, &chronicle).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn worlds_go_on_while_the_object_store_refuses_and_are_saved_afterwards() {
    let ground = Ground::new();
    let postgres = Postgres::start(&ground);
    let s3 = S3::start(&ground);
    let relay = Relay::to(s3.address);
    let mut fleet = Fleet { ground, postgres, servers: Vec::new() };
    let url = fleet.postgres.url();
    for address in [relay.address, s3.address] {
        fleet.add(&url, S3::BLOBS, &S3::env(address), "4");
    }
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let _worker = fleet.add_worker(64, 0);
    let mut game = Game::begin(&mut client, 32).await;
    let chronicle = Chronicle::follow(&uris, game.world_id);
    game.play(&uris, &chronicle, 40).await;
    let saved = |fleet: &Fleet| fleet.postgres.query("SELECT through FROM worlds")[0].parse::<u64>().expect("a number");
    relay.refuse();
    wait_until("a save fails", || async {
        fleet.servers[0].metric("surefoot_saves_failed_total").is_some_and(|count| count > 0.0)
    })
    .await;
    let before = saved(&fleet);
    game.play(&uris, &chronicle, 40).await;
    assert_eq!(saved(&fleet), before, "nothing is saved");
    relay.mend();
    wait_until("it is saved again", || async { saved(&fleet) > before }).await;
    // What happened since the last save is not lost with the server, even if that was long ago.
    relay.refuse();
    game.play(&uris, &chronicle, 40).await;
    fleet.servers[0].process.kill();
    game.play(&uris, &chronicle, 40).await;
    assert_eq!(fleet.owner_of(game.world_id).await, 1);
    game.end(&uris, &chronicle).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_cut_off_from_the_database_stops_its_worlds_before_others_take_them() {
    let ground = Ground::new();
    let postgres = Postgres::start(&ground);
    let relay = Relay::to(postgres.address);
    let mut fleet = Fleet { ground, postgres, servers: Vec::new() };
    let blobs = fleet.ground.blobs();
    for url in [Postgres::url_at(relay.address), fleet.postgres.url()] {
        fleet.add(&url, &blobs, &[], "3");
    }
    let uris = fleet.uris();
    let mut client = fleet.client(0).await;
    fleet.client(1).await;
    let _worker = fleet.add_worker(64, 0);
    let mut game = Game::begin(&mut client, 32).await;
    let chronicle = Chronicle::follow(&uris[1..], game.world_id);
    game.play(&uris, &chronicle, 40).await;
    let row = fleet.row(game.world_id);
    relay.cut();
    let world_id = game.world_id;
    wait_until("the other one has the world", || async { fleet.row(world_id) != row }).await;
    let refused = client.get_world(wire::GetWorldRequest { world_id }).await.expect_err("it has stopped before");
    assert!(matches!(Reason::of(&refused), Some(Reason::WorldMoving | Reason::NotConfirmed)), "{refused}");
    game.play(&uris[1..], &chronicle, 40).await;
    relay.mend();
    wait_until("it is a server again", || async { fleet.living_count() == 2 }).await;
    game.play(&uris, &chronicle, 20).await;
    assert_eq!(fleet.owner_of(world_id).await, 1);
    game.end(&uris, &chronicle).await;
}
