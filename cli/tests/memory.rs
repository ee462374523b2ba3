//! What requests can grow is paid for from the memory budget: one test for each kind drives a server to its budget, and
//! compares the peak of the process's resident memory with it.
#![cfg(target_os = "linux")]

use std::io::{Read, Write};
use std::net::TcpStream;
use surefoot_processes::Surefoot;
use surefoot_proto::convert::map_spec_to_wire;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_world::{MapSpec, Seed};
use tokio::task::JoinSet;
use tokio_stream::StreamExt;
use tonic::Status;
use tonic::transport::Channel;

/// The budget of the servers, MB.
const BUDGET_MB: u64 = 96;
/// What a server may take beside its budget and what it took when it had started, MB: threads, buffers of connections,
/// and what the allocator keeps for later.
const ALLOWANCE_MB: u64 = 160;
const MB: u64 = 1_000_000;

/// A server with its log.
struct Server {
    service: Surefoot,
    address: String,
    /// Peak of its resident memory when it had started, MB.
    start_mb: u64,
    _folder: tempfile::TempDir,
}

impl Server {
    fn start(flags: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let budget = BUDGET_MB.to_string();
        let args = [&["serve", "--max-memory", &budget][..], flags].concat();
        let service = Surefoot::start(&args, &[], &folder.path().join("log"));
        service.wait_until_it_listens();
        let address = service.address.to_string();
        let mut server = Self { service, address, start_mb: 0, _folder: folder };
        server.start_mb = server.peak_mb();
        server
    }

    /// Peak of the resident memory of the process so far, MB.
    fn peak_mb(&self) -> u64 {
        self.service.process.peak_memory_bytes() / MB
    }

    #[track_caller]
    fn assert_within_budget(&self) {
        let (peak, limit) = (self.peak_mb(), self.start_mb + BUDGET_MB + ALLOWANCE_MB);
        assert!(peak <= limit, "the peak is {peak} MB, but {limit} MB were allowed");
    }

    async fn channel(&self) -> Channel {
        self.service.connect().await
    }
}

fn small_map(seed: u64, side: u32) -> wire::MapSpec {
    map_spec_to_wire(&MapSpec::with_side(seed, side).expect("a valid spec"))
}

async fn create_world(client: &mut WorldServiceClient<Channel>, map: wire::MapSpec, request_id: &str) -> u64 {
    let request_id = request_id.to_owned();
    let request = wire::CreateWorldRequest { map: Some(map), request_id, ..Default::default() };
    client.create_world(request).await.expect("a world").into_inner().world.expect("a description").world_id
}

fn is_out_of_memory(status: &Status) -> bool {
    Reason::of(status) == Some(Reason::OutOfMemory)
}

/// An OBJ file of a floor of so many squares a side, and so many bytes of comments.
fn floor(side: usize, comment_bytes: usize) -> Vec<u8> {
    let mut text = String::with_capacity(side * side * 60 + comment_bytes);
    text.push_str("o floor\n");
    for idx in 0..=side * (side + 2) {
        let (x, z) = (idx % (side + 1), idx / (side + 1));
        text.push_str(&format!("v {} 0 {}\n", x as f32 * 0.5, z as f32 * 0.5));
    }
    for idx in 0..side * side {
        let corner = 1 + idx % side + idx / side * (side + 1);
        text.push_str(&format!("f {} {} {} {}\n", corner, corner + side + 1, corner + side + 2, corner + 1));
    }
    while text.len() < comment_bytes {
        text.push_str("# nothing but bytes that the server has to hold while the file waits for its turn\n");
    }
    text.into_bytes()
}

fn import_of(name: &str, file: Vec<u8>, upload_id: &str) -> wire::ImportMapRequest {
    let format = wire::MapFormat::Obj.into();
    wire::ImportMapRequest {
        name: name.to_owned(),
        format,
        file,
        upload_id: upload_id.to_owned(),
        ..Default::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn answers_that_are_kept_for_repeated_calls() {
    let server = Server::start(&[]);
    let channel = server.channel().await;
    let mut client = WorldServiceClient::new(channel.clone());
    let world_id = create_world(&mut client, small_map(1, 50), "first").await;
    let spawn = move |id: usize| wire::BatchSpawnNpcsRequest {
        world_id,
        spawns: vec![wire::Spawn::default(); 4096],
        request_id: id.to_string(),
        ..Default::default()
    };
    let first = client.batch_spawn_npcs(spawn(0)).await.unwrap().into_inner().results;
    let again = client.batch_spawn_npcs(spawn(0)).await.unwrap().into_inner().results;
    let reasons = |results: &[wire::SpawnResult]| -> Vec<(i32, String)> {
        let error = |result: &wire::SpawnResult| match &result.result {
            Some(wire::spawn_result::Result::Error(error)) => (error.code, error.reason.clone()),
            other => panic!("{other:?}"),
        };
        results.iter().map(error).collect()
    };
    assert_eq!(reasons(&first), reasons(&again), "a repeated call has the results of the first");
    let mut calls = JoinSet::new();
    for lane in 0..8 {
        let mut client = WorldServiceClient::new(channel.clone());
        calls.spawn(async move {
            for number in 1..=100 {
                client.batch_spawn_npcs(spawn(1000 * lane + number)).await.expect("an answer");
            }
        });
    }
    calls.join_all().await;
    // Answers must not hold the maps of worlds that were dropped.
    for seed in 0..24 {
        let world_id = create_world(&mut client, small_map(seed, 200), &format!("world {seed}")).await;
        client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap();
    }
    assert_eq!(create_world(&mut client, small_map(1, 50), "first").await, world_id, "small answers are still kept");
    server.assert_within_budget();
}

#[tokio::test(flavor = "multi_thread")]
async fn imports_that_wait_for_their_turn() {
    const CHUNK: usize = 2 << 20;
    let server = Server::start(&[]);
    let channel = server.channel().await;
    let mut imports = JoinSet::new();
    let mut import = |request: wire::ImportMapRequest| {
        let mut client = MapServiceClient::new(channel.clone());
        imports.spawn(async move { client.import_map(request).await.map(drop) });
    };
    import(import_of("slow", floor(260, 0), ""));
    for number in 0..40 {
        import(import_of(&number.to_string(), floor(4, 4 << 20), ""));
    }
    // More than the budget holds, one after the other: each takes the place of an upload that is being imported.
    let (file, mut client) = (floor(4, 15 << 20), MapServiceClient::new(channel.clone()));
    let mut refused = Vec::new();
    for number in 0..24 {
        let id = format!("upload {number}");
        for (idx, chunk) in file.chunks(CHUNK).enumerate() {
            let (upload_id, offset) = (id.clone(), (idx * CHUNK) as u64);
            let part = wire::UploadChunkRequest { upload_id, offset, data: chunk.to_vec() };
            if let Err(status) = client.upload_chunk(part).await {
                refused.push(status);
                break;
            }
        }
        import(import_of(&id, Vec::new(), &id));
    }
    refused.extend(imports.join_all().await.into_iter().filter_map(Result::err));
    assert!(refused.iter().any(is_out_of_memory), "the budget was reached: {refused:?}");
    server.assert_within_budget();
}

#[tokio::test(flavor = "multi_thread")]
async fn levels_that_many_read_and_some_do_not_read_on() {
    let server = Server::start(&["--reader-patience", "0.5"]);
    let file = floor(200, 0);
    let mut client = MapServiceClient::new(server.channel().await);
    let kept =
        client.import_map(import_of("floor", file, "")).await.expect("there is memory").into_inner().map.unwrap();
    let figures = exchange(&server.address, "GET", "/metrics", b"");
    let level = figures.lines().find(|line| line.starts_with("surefoot_memory_budget_bytes ")).expect("a figure");
    let level = format!("\n{level}\n");
    let mut streams = Vec::new();
    for _ in 0..8 {
        // Connections of their own: each has a window that the server fills.
        let mut client = MapServiceClient::new(server.channel().await);
        for _ in 0..40 {
            match client.get_map(wire::GetMapRequest { map_hash: kept.map_hash.clone() }).await {
                Ok(stream) => streams.push((client.clone(), stream.into_inner())),
                Err(status) => assert!(is_out_of_memory(&status), "{status}"),
            }
        }
    }
    assert!(streams.len() >= 16, "{} streams", streams.len());
    // All that is left is the level.
    while !exchange(&server.address, "GET", "/metrics", b"").contains(&level) {
        tokio::task::yield_now().await;
    }
    let mut reading = JoinSet::new();
    for (client, mut stream) in streams {
        // At the same time: those that share a connection share its window.
        reading.spawn(async move {
            let mut end = None;
            while let Some(message) = stream.next().await {
                end = message.err();
            }
            drop(client);
            end
        });
    }
    let ends: Vec<Status> = reading.join_all().await.into_iter().flatten().collect();
    assert!(ends.iter().all(|end| Reason::of(end) == Some(Reason::ReaderTooSlow)), "{ends:?}");
    assert!(!ends.is_empty(), "readers that do not read are cut off");
    server.assert_within_budget();
}

/// Makes a request of HTTP; returns the answer with its headers.
fn exchange(address: &str, method: &str, path: &str, json: &[u8]) -> String {
    let mut socket = TcpStream::connect(address).expect("the server accepts");
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\
         Content-Type: application/json\r\nContent-Length: {}\r\n\r\n",
        json.len()
    );
    // What is refused early is not read to its end, so that both may fail.
    let _ = socket.write_all(head.as_bytes()).and_then(|()| socket.write_all(json));
    let mut answer = Vec::new();
    let _ = socket.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

fn post(address: &str, path: &str, json: &[u8]) -> String {
    exchange(address, "POST", path, json)
}

#[test]
fn requests_in_json() {
    let server = Server::start(&[]);
    let ids = |count: usize| format!("{{\"npcIds\":[{}1]}}", "1,".repeat(count)).into_bytes();
    let goals = format!("{{\"goals\":[{}{{}}]}}", "{\"goal\":{}},".repeat(250_000)).into_bytes();
    let path = "/surefoot.world.v1.WorldService/";
    // As large as it may be, larger, and one whose objects take far more than its text.
    let bodies = [("BatchGetNpcs", ids(2_000_000)), ("BatchGetNpcs", ids(3_000_000)), ("BatchSetGoals", goals)];
    let answers: Vec<String> = std::thread::scope(|scope| {
        let calls: Vec<_> = (0..48)
            .map(|idx| {
                let ((method, body), address) = (&bodies[idx % bodies.len()], &server.address);
                scope.spawn(move || post(address, &format!("{path}{method}"), body))
            })
            .collect();
        calls.into_iter().map(|call| call.join().expect("no panic")).collect()
    });
    assert!(answers.iter().any(|answer| answer.contains("TOO_LARGE")), "{answers:?}");
    assert!(answers.iter().any(|answer| answer.contains("OUT_OF_MEMORY")), "{answers:?}");
    let served = post(&server.address, &format!("{path}BatchGetNpcs"), &ids(4095));
    assert!(served.contains("NPC_NOT_FOUND"), "{served}");
    server.assert_within_budget();
}

#[tokio::test(flavor = "multi_thread")]
async fn environments_of_trainers() {
    let server = Server::start(&["--max-envs", "1000", "--max-envs-per-client", "1000"]);
    let channel = server.channel().await;
    let mut client = EnvServiceClient::new(channel.clone());
    let mut refused = None;
    let mut made = 0;
    while refused.is_none() {
        let request = wire::CreateEnvRequest {
            map: Some(small_map(1, 50)),
            npc_count: 1024,
            seed: Seed(made).0,
            request_id: format!("env {made}"),
            ..Default::default()
        };
        match client.create_env(request).await {
            Ok(_) => made += 1,
            Err(status) => refused = Some(status),
        }
    }
    assert!(made >= 4 && refused.as_ref().is_some_and(is_out_of_memory), "{made} environments, then {refused:?}");
    server.assert_within_budget();
}
