//! Work over NATS: processes die, are unreachable, repeat themselves or lie; graphs have the bytes of those of one
//! process.

use crate::raw::Raw;
use crate::services::{Ground, Nats};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;
use surefoot_fleet::work::compute_class::ComputeClass;
use surefoot_fleet::work::dispatch::{Dispatcher, Threads, Work};
use surefoot_fleet::work::job::{Job, JobKind};
use surefoot_fleet::work::queue::Queue;
use surefoot_planner::store::{GraphStore, encode_entry};
use surefoot_planner::{BuildStats, Built, GraphId};
use surefoot_planner_service::store::DiskStore;
use surefoot_policy::Policy;
use surefoot_processes::{Process, Surefoot, wait_until};
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::{ImportMapRequest, MapFormat, MapSize, MapSpec};

/// A subject of jobs that belong to nothing.
const NOWHERE: &str = "00000000000000000000000000000000";

fn lane() -> ComputeClass {
    ComputeClass::of(&Policy::shipped().unwrap())
}

/// A planner of one probing thread. With a queue it shares its probes.
fn planner(ground: &Ground, name: &str, nats: Option<&Nats>) -> Surefoot {
    let (cache, url) = (ground.path(&format!("{name}-cache")), nats.map(Nats::url));
    let blobs = ground.blobs();
    let mut args = vec!["plan", "--threads", "1", "--cache", cache.to_str().unwrap()];
    if let Some(url) = &url {
        args.extend(["--nats", url, "--blobs", &blobs]);
    }
    Surefoot::start(&args, &[], &ground.path(&format!("{name}.log")))
}

fn prover(ground: &Ground, name: &str, nats: &Nats) -> Surefoot {
    let args = ["prove", "--threads", "1", "--nats", &nats.url(), "--blobs", &ground.blobs()];
    Surefoot::start(&args, &[], &ground.path(&format!("{name}.log")))
}

/// The graph of a small map, of which each seed has another one.
fn request(seed: u64, vertices: u32) -> wire::StartBuildRequest {
    let size = Some(MapSize { width: 80, height: 60, depth: 80 });
    let settings = wire::BuildSettings { vertices, neighbours: 10, seed, repeats: 3, ..Default::default() };
    wire::StartBuildRequest {
        map: Some(MapSpec { seed: 7, size, ..Default::default() }),
        settings: Some(settings),
        ..Default::default()
    }
}

/// One that takes some seconds: all probes of all candidates.
fn long_request(seed: u64) -> wire::StartBuildRequest {
    let request = request(seed, 300);
    let settings = request.settings.map(|it| wire::BuildSettings { probing: wire::Probing::Exhaustive.into(), ..it });
    wire::StartBuildRequest { settings, ..request }
}

/// Builds a graph and returns all of it but times as text, in which floats are exact; `None` if the planner goes
/// meanwhile.
async fn try_build(planner: &Surefoot, request: wire::StartBuildRequest) -> Option<String> {
    let mut client = PlannerServiceClient::new(planner.connect().await).max_decoding_message_size(usize::MAX);
    let build_id = client.start_build(request).await.ok()?.into_inner().build?.build_id;
    let mut states = client.watch_build(wire::WatchBuildRequest { build_id }).await.ok()?.into_inner();
    let mut last = wire::Build::default();
    while let Some(state) = states.message().await.ok()? {
        last = state.build?;
    }
    assert_eq!(last.stage(), wire::BuildStage::Done, "{:?}", last.failure);
    let graph = client
        .get_graph(wire::GetGraphRequest { graph_id: last.graph_id.clone(), ..Default::default() })
        .await
        .ok()?
        .into_inner();
    assert!(graph.edges.len() > 20, "a graph worth comparing");
    Some(format!("{} {:?} {:?} {:?}", last.graph_id, graph.vertices, graph.islands, graph.edges))
}

async fn build(planner: &Surefoot, request: wire::StartBuildRequest) -> String {
    try_build(planner, request).await.expect("the planner stays")
}

/// Graphs as a planner that has ended keeps them, without times.
fn entries(cache: &Path, ids: &[GraphId]) -> Vec<Vec<u8>> {
    let store = DiskStore::open(cache, u64::MAX).unwrap();
    let kept = |id: &GraphId| Built { stats: BuildStats::default(), ..store.get(id).unwrap().expect("it is kept") };
    ids.iter().map(|id| encode_entry(&kept(id))).collect()
}

fn done_by(provers: &[Surefoot]) -> f64 {
    provers.iter().filter_map(|prover| prover.metric("surefoot_jobs_done_total")).sum()
}

async fn ready(provers: &[Surefoot]) {
    for prover in provers {
        wait_until("a prover is connected", || async { prover.metric("surefoot_queue_connected") == Some(1.0) }).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_graph_of_two_provers_has_the_bytes_of_one_process() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let sharing = planner(&ground, "sharing", Some(&nats));
    let provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    let mut ids = Vec::new();
    for seed in 0..2 {
        let expected = build(&alone, request(seed, 120)).await;
        assert_eq!(build(&sharing, request(seed, 120)).await, expected, "seed {seed}");
        ids.push(GraphId::parse(&expected[..64]).unwrap());
    }
    // The same bytes are kept, not only shown.
    let kept = [alone, sharing].map(|mut planner| {
        let has_shared = planner.metric("surefoot_jobs_settled_total");
        planner.process.kill();
        has_shared
    });
    assert!(kept[1] > Some(0.0), "the provers' work was used");
    let [alone, sharing] = ["alone-cache", "sharing-cache"].map(|cache| entries(&ground.path(cache), &ids));
    assert!(alone == sharing && alone.iter().all(|entry| entry.len() > 1000));
    assert!(provers.iter().all(|prover| prover.metric("surefoot_jobs_done_total") > Some(0.0)), "both had work");
    assert!(
        provers[0].metric("surefoot_probes_total") > Some(30.0)
            && provers[0].metric("surefoot_job_seconds_total") > Some(0.0)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_build_does_without_provers_and_without_a_queue() {
    let ground = Ground::new();
    let mut nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let sharing = planner(&ground, "sharing", Some(&nats));
    assert_eq!(build(&sharing, request(0, 60)).await, build(&alone, request(0, 60)).await, "no provers");
    nats.kill();
    assert_eq!(build(&sharing, request(1, 60)).await, build(&alone, request(1, 60)).await, "no queue");
    assert_eq!(sharing.metric("surefoot_queue_connected"), Some(0.0));
    assert!(sharing.process.log().contains("NATS is unreachable"), "it says so");
}

/// Imports a map into a planner, under a name of its own.
async fn import(planner: &Surefoot, file: &[u8]) -> String {
    let mut maps = MapServiceClient::new(planner.connect().await);
    let (name, format) = ("level".to_owned(), MapFormat::Saved.into());
    let request = ImportMapRequest { name, format, file: file.to_vec(), ..Default::default() };
    maps.import_map(request).await.unwrap().into_inner().map.unwrap().map_hash
}

#[tokio::test(flavor = "multi_thread")]
async fn imported_levels_reach_provers_through_the_object_store() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let file = ground.path("level.sfmap");
    surefoot(&["map", "generate", "5", "--size", "80", "--out", file.to_str().unwrap()], &ground);
    let file = std::fs::read(file).unwrap();
    let alone = planner(&ground, "alone", None);
    let sharing = planner(&ground, "sharing", Some(&nats));
    let mut with_store = [prover(&ground, "with-store", &nats)];
    ready(&with_store).await;
    let of_level = async |planner: &Surefoot, seed: u64| {
        let map_hash = import(planner, &file).await;
        build(planner, wire::StartBuildRequest { map: None, map_hash, ..request(seed, 120) }).await
    };
    assert_eq!(of_level(&sharing, 0).await, of_level(&alone, 0).await);
    assert!(done_by(&with_store) > 0.0, "it got the level");
    with_store[0].process.kill();
    let args = ["prove", "--threads", "1", "--nats", &nats.url()];
    let without_store = [Surefoot::start(&args, &[], &ground.path("without-store.log"))];
    ready(&without_store).await;
    assert_eq!(of_level(&sharing, 1).await, of_level(&alone, 1).await, "its jobs are done by the planner");
    assert_eq!(done_by(&without_store), 0.0);
}

/// How often processes are killed.
fn rounds() -> u64 {
    std::env::var("SUREFOOT_FLEET_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(3)
}

/// Builds graphs while `kill` is called at random moments.
async fn survive(alone: &Surefoot, sharing: &Surefoot, mut rng: ChaCha8Rng, mut kill: impl FnMut(&mut ChaCha8Rng)) {
    let mut killed = 0;
    for seed in 0..rounds() {
        let expected = build(alone, long_request(seed)).await;
        let building = build(sharing, long_request(seed));
        let mut building = std::pin::pin!(building);
        let found = loop {
            let pause = Duration::from_millis(rng.random_range(100..700));
            tokio::select! {
                found = &mut building => break found,
                () = tokio::time::sleep(pause) => {
                    kill(&mut rng);
                    killed += 1;
                }
            }
        };
        assert_eq!(found, expected, "seed {seed}");
    }
    assert!(killed > 0, "the builds were too short to be disturbed");
}

#[tokio::test(flavor = "multi_thread")]
async fn provers_that_are_killed_at_random_change_no_graph() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let sharing = planner(&ground, "sharing", Some(&nats));
    let mut provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    survive(&alone, &sharing, ChaCha8Rng::seed_from_u64(1), |rng| provers[rng.random_range(0..2)].restart()).await;
    assert!(sharing.metric("surefoot_jobs_settled_total") > Some(0.0), "provers had a share");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_queue_that_is_killed_and_comes_back_changes_no_graph() {
    let ground = Ground::new();
    let mut nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let sharing = planner(&ground, "sharing", Some(&nats));
    let provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    survive(&alone, &sharing, ChaCha8Rng::seed_from_u64(2), |_| {
        nats.kill();
        nats.start_again();
    })
    .await;
    let before = done_by(&provers);
    wait_until("provers work again", || async {
        build(&sharing, request(1000 + done_by(&provers) as u64, 60)).await;
        done_by(&provers) > before
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_that_is_killed_goes_on_with_what_was_proved() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let mut sharing = planner(&ground, "sharing", Some(&nats));
    let provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    let expected = build(&alone, long_request(5)).await;
    let begun = try_build(&sharing, long_request(5));
    tokio::select! {
        _ = begun => panic!("the build is too short to be disturbed"),
        () = wait_until("provers have done something", || async { done_by(&provers) > 3.0 }) => {}
    }
    sharing.restart();
    // The results of provers have no reader yet.
    assert_eq!(build(&sharing, long_request(5)).await, expected);
    assert!(sharing.metric("surefoot_jobs_settled_total") > Some(3.0), "what was proved before was used");
}

/// Most kills of the planner in one build, which could not end otherwise.
const MAX_PLANNER_KILLS: u32 = 3;

#[tokio::test(flavor = "multi_thread")]
async fn whatever_is_killed_at_random_changes_no_graph() {
    let ground = Ground::new();
    let mut nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let mut sharing = planner(&ground, "sharing", Some(&nats));
    let mut provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut kills = [0; 4];
    for seed in 0..rounds() {
        let expected = build(&alone, long_request(seed)).await;
        let mut planner_kills = 0;
        let found = loop {
            let mut building = Box::pin(try_build(&sharing, long_request(seed)));
            let found = loop {
                let pause = Duration::from_millis(rng.random_range(100..700));
                tokio::select! {
                    found = &mut building => break Some(found.expect("the planner stays")),
                    () = tokio::time::sleep(pause) => {}
                }
                let victim = rng.random_range(0..4);
                match victim {
                    0 | 1 => provers[victim].restart(),
                    2 => {
                        nats.kill();
                        nats.start_again();
                    }
                    _ if planner_kills < MAX_PLANNER_KILLS => break None,
                    _ => continue,
                }
                kills[victim] += 1;
            };
            if let Some(found) = found {
                break found;
            }
            drop(building);
            sharing.restart();
            planner_kills += 1;
            kills[3] += 1;
        };
        assert_eq!(found, expected, "seed {seed}");
    }
    println!(
        "{} graphs; killed: provers {} and {}, NATS {}, the planner {}",
        rounds(),
        kills[0],
        kills[1],
        kills[2],
        kills[3]
    );
    assert!(kills.iter().sum::<u32>() > 0, "the builds were too short to be disturbed");
}

/// Repeats every result, sends it to other jobs as well, and damages it, until it is stopped. Returns the number of
/// results.
fn meddle(address: SocketAddr, stop: Arc<AtomicBool>) -> std::thread::JoinHandle<usize> {
    let mut raw = Raw::connect(address);
    raw.subscribe("surefoot.results.>");
    raw.set_patience(Duration::from_millis(100));
    std::thread::spawn(move || {
        let (mut seen, mut before) = (0, Vec::new());
        while !stop.load(Ordering::Relaxed) {
            let Some(result) = raw.next() else { continue };
            seen += 1;
            raw.send(&result.subject, "", &result.payload);
            // A stale one, of another job.
            raw.send(&result.subject, "", &before);
            raw.send(&result.subject, "", &result.payload[..result.payload.len() / 2]);
            before = result.payload;
        }
        seen
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn results_that_are_repeated_stale_or_damaged_change_no_graph() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let alone = planner(&ground, "alone", None);
    let mut sharing = planner(&ground, "sharing", Some(&nats));
    let provers = [prover(&ground, "one", &nats)];
    ready(&provers).await;
    // The streams are there.
    build(&sharing, request(9, 40)).await;
    let stop = Arc::new(AtomicBool::new(false));
    let meddling = meddle(nats.address, stop.clone());
    let expected = build(&alone, request(3, 120)).await;
    assert_eq!(build(&sharing, request(3, 120)).await, expected);
    // What is kept of each result now is the damaged one.
    sharing.process.kill();
    std::fs::remove_dir_all(ground.path("sharing-cache")).unwrap();
    sharing.restart();
    assert_eq!(build(&sharing, request(3, 120)).await, expected);
    stop.store(true, Ordering::Relaxed);
    assert!(meddling.join().unwrap() > 0, "it had something to meddle with");
    assert!(sharing.process.log().contains("ignored a damaged answer"), "the planner saw it");
}

#[tokio::test(flavor = "multi_thread")]
async fn hostile_messages_are_removed_and_provers_go_on() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let mut provers = [prover(&ground, "one", &nats)];
    ready(&provers).await;
    let subject = format!("surefoot.jobs.{}.{NOWHERE}", lane());
    let mut raw = Raw::connect(nats.address);
    let whole = Job::new(JobKind::Probes, 0, &"not probes").bytes;
    let noise: Vec<u8> = (0..5000u32).map(|idx| (idx.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let damaged: [&[u8]; 4] = [b"", b"{}", &noise, &whole[..whole.len() - 1]];
    wait_until("all of them are removed", || {
        damaged.iter().for_each(|bytes| raw.publish(&subject, bytes));
        let count = provers[0].metric("surefoot_jobs_damaged_total");
        async move { count >= Some(4.0) }
    })
    .await;
    // Whole, and nonsense all the same: of each kind, and of a length that nothing has.
    let nonsense = [
        Job::new(JobKind::Probes, 1, &(u64::MAX, u64::MAX, u64::MAX)),
        Job::new(JobKind::Unit, 2, &vec![u32::MAX; 64]),
        Job::new(JobKind::Map, 3, &[255u8; 32]),
    ];
    nonsense.iter().for_each(|job| raw.publish(&subject, &job.bytes));
    raw.publish(&format!("surefoot.jobs.{}.elsewhere", lane()), &whole);
    wait_until("all of them are refused", || async { provers[0].metric("surefoot_jobs_failed_total") >= Some(3.0) })
        .await;
    assert!(provers[0].process.is_running());
    let sharing = planner(&ground, "sharing", Some(&nats));
    build(&sharing, request(0, 120)).await;
    assert!(done_by(&provers) > 0.0, "it works on");
}

/// Jobs that this process does not do.
struct Untouched {
    cancelled: AtomicBool,
}

impl Work for Untouched {
    type Output = Vec<u8>;

    fn run_locally(&self, _: usize, is_settled: &(dyn Fn() -> bool + Sync)) -> Option<Result<Vec<u8>, String>> {
        while !is_settled() {
            std::thread::yield_now();
        }
        None
    }

    fn read(&self, _: usize, result: &[u8]) -> Result<Vec<u8>, String> {
        Ok(result.to_vec())
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_ends_its_provers_fails_whoever_waits_for_it() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    // The first prover makes the consumer, and goes.
    let mut first = [prover(&ground, "first", &nats)];
    ready(&first).await;
    let queue = Queue::open(&nats.url()).await.unwrap();
    let dispatcher = Dispatcher::new(queue, lane());
    let work = Arc::new(Untouched { cancelled: AtomicBool::new(false) });
    let mut raw = Raw::connect(nats.address);
    raw.subscribe("surefoot.test.pulled");
    wait_until("the consumer is there", || {
        raw.send(&format!("$JS.API.CONSUMER.INFO.SUREFOOT_JOBS.prove-{}", lane()), "surefoot.test.pulled", b"");
        let info = raw.next().expect("an answer").payload;
        async move { String::from_utf8_lossy(&info).contains("num_pending") }
    })
    .await;
    first[0].process.kill();
    let threads = Threads { beside_provers: 0, alone: 0 };
    // The thread that waits here has another job, the last.
    let jobs = vec![Job::new(JobKind::Map, 0, &1u8), Job::new(JobKind::Map, 1, &2u8)];
    let poison = jobs[0].bytes.clone();
    let running = {
        let (dispatcher, work) = (dispatcher.clone(), work.clone());
        tokio::task::spawn_blocking(move || dispatcher.run(jobs, &*work, threads))
    };
    // Five provers in a row begin with it and go.
    let mut deliveries = 0;
    while deliveries < 5 {
        raw.send(&format!("$JS.API.CONSUMER.MSG.NEXT.SUREFOOT_JOBS.prove-{}", lane()), "surefoot.test.pulled", b"1");
        let pulled = raw.next().expect("a job");
        let reply = pulled.reply.expect("a place for acknowledgements");
        if pulled.payload == poison {
            deliveries += 1;
            raw.publish(&reply, b"-NAK");
        } else {
            raw.publish(&reply, b"+TERM");
        }
    }
    let _last = prover(&ground, "last", &nats);
    let error = running.await.unwrap().unwrap_err().to_string();
    assert!(error.contains("5 provers in a row ended"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn cancelled_work_leaves_the_queue() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let queue = Queue::open(&nats.url()).await.unwrap();
    let dispatcher = Dispatcher::new(queue, lane());
    let work = Arc::new(Untouched { cancelled: AtomicBool::new(false) });
    let running = {
        let (dispatcher, work) = (dispatcher, work.clone());
        let jobs = (0..8).map(|place| Job::new(JobKind::Map, place, &())).collect();
        let threads = Threads { beside_provers: 0, alone: 0 };
        tokio::task::spawn_blocking(move || dispatcher.run(jobs, &*work, threads))
    };
    let mut raw = Raw::connect(nats.address);
    raw.subscribe("surefoot.test.stream");
    let mut waiting = || {
        raw.send("$JS.API.STREAM.INFO.SUREFOOT_JOBS", "surefoot.test.stream", b"");
        let info = raw.next().map(|info| String::from_utf8_lossy(&info.payload).into_owned()).unwrap_or_default();
        let count = info.split("\"messages\":").nth(1)?;
        count.split(|digit: char| !digit.is_ascii_digit()).next()?.parse::<u32>().ok()
    };
    wait_until("jobs wait", || {
        let count = waiting();
        async move { count >= Some(7) }
    })
    .await;
    work.cancelled.store(true, Ordering::Relaxed);
    assert_eq!(running.await.unwrap().unwrap(), None);
    wait_until("none is left", || {
        let count = waiting();
        async move { count == Some(0) }
    })
    .await;
}

/// Runs a command of ours to its end and returns what it prints.
fn surefoot(args: &[&str], ground: &Ground) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surefoot"));
    command.args(args);
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let log = ground.path(&format!("command-{}.log", COUNT.fetch_add(1, Ordering::Relaxed)));
    let mut process = Process::spawn(command, &log);
    assert!(process.wait().success(), "{args:?}: {}", process.log());
    process.log()
}

/// The files in a folder by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let name = |path: &Path| path.file_name().expect("a name").to_string_lossy().into_owned();
    entries.map(|path| (name(&path), std::fs::read(&path).expect("a file"))).collect()
}

/// The units in a folder, without times.
fn units(folder: &Path) -> BTreeMap<String, serde_json::Value> {
    let timeless = |bytes: Vec<u8>| {
        let mut unit: serde_json::Value = serde_json::from_slice(&bytes).expect("a unit");
        let graph = unit["graph"].as_object_mut().expect("a graph");
        ["build_s", "eval_s", "search_us_median"].iter().for_each(|time| drop(graph.remove(*time)));
        unit
    };
    files(&folder.join("units")).into_iter().map(|(name, bytes)| (name, timeless(bytes))).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_evaluation_by_provers_equals_one_in_one_piece() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    let common = ["eval", "--maps", "3,4", "--size", "60", "--goals", "24", "--vertices", "40", "--neighbours", "6"];
    let here = ground.path("here");
    let there = ground.path("there");
    let (url, blobs) = (nats.url(), ground.blobs());
    let alone = ["--seed", "0..3", "--json", "--out", here.to_str().unwrap()];
    let shared = [
        "--seed",
        "0..3",
        "--json",
        "--threads",
        "1",
        "--out",
        there.to_str().unwrap(),
        "--nats",
        &url,
        "--blobs",
        &blobs,
    ];
    surefoot(&[&common[..], &alone].concat(), &ground);
    surefoot(&[&common[..], &shared].concat(), &ground);
    let (alone, shared) = (units(&here), units(&there));
    assert_eq!(alone.len(), 6);
    assert_eq!(alone, shared);
    assert!(done_by(&provers) > 0.0, "provers had a share");
}

#[tokio::test(flavor = "multi_thread")]
async fn maps_by_provers_are_those_that_are_generated_here() {
    let ground = Ground::new();
    let nats = Nats::start(&ground);
    let provers = ["one", "two"].map(|name| prover(&ground, name, &nats));
    ready(&provers).await;
    let [here, there] = ["here", "there"].map(|name| ground.path(name));
    let (url, blobs) = (nats.url(), ground.blobs());
    let common = ["map", "generate", "0..12", "--size", "100", "--features", "all"];
    surefoot(&[&common[..], &["--out", here.to_str().unwrap()]].concat(), &ground);
    surefoot(&[&common[..], &["--out", there.to_str().unwrap(), "--nats", &url, "--blobs", &blobs]].concat(), &ground);
    let (here, there) = (files(&here), files(&there));
    assert_eq!(here.len(), 12);
    assert!(here == there, "the same maps");
    assert!(done_by(&provers) > 0.0, "provers had a share");
}

#[test]
fn a_prover_says_its_lane() {
    let ground = Ground::new();
    assert_eq!(surefoot(&["prove", "--print-lane"], &ground).trim(), lane().as_str());
    let lstm = surefoot(&["prove", "--print-lane", "--model", "general-lstm"], &ground);
    assert_ne!(lstm.trim(), lane().as_str(), "another model, another lane");
}
