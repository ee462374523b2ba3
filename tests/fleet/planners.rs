//! Planners that share a store: one build over all of them, takeovers, edits and evidence that reach everybody,
//! engines that fail.

use crate::relay::Relay;
use crate::services::{Ground, Postgres, S3};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};
use surefoot_processes::{Surefoot, wait_until};
use surefoot_proto::convert::map_spec;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::planner::v1::{self as wire, BuildStage};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::{BlockPiece, ImportMapRequest, MapFormat, MapSize, MapSpec, Piece, Vec3, piece};
use tokio::sync::{Mutex, MutexGuard};
use tonic::transport::Channel;
use tonic::{Code, Status};

pub(super) type Client = PlannerServiceClient<Channel>;

/// Lease of the planners, s.
const LEASE: f64 = 3.0;

/// A test of planners at a time: each starts many processes, and some measure time.
pub(super) async fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::const_new(());
    TURN.lock().await
}

/// Planners and their engines.
pub(super) struct Fleet {
    pub(super) ground: Ground,
    pub(super) postgres: Postgres,
    pub(super) store: String,
    pub(super) blobs: String,
    lease: f64,
}

impl Fleet {
    pub(super) fn new() -> Self {
        let ground = Ground::new();
        let postgres = Postgres::start(&ground);
        let (store, blobs) = (postgres.url(), ground.blobs());
        Self { ground, postgres, store, blobs, lease: LEASE }
    }

    /// A planner with these variables.
    pub(super) fn planner(&self, name: &str, env: &[(&str, &str)]) -> Surefoot {
        let lease = self.lease.to_string();
        let args = ["plan", "--store", &self.store, "--blobs", &self.blobs, "--lease", &lease];
        let has_failpoint = env.iter().any(|(name, _)| matches!(*name, "SUREFOOT_ABORT_AT" | "SUREFOOT_STOP_AT"));
        assert!(
            !has_failpoint || cfg!(feature = "failpoints"),
            "this test needs the feature failpoints of surefoot-cli"
        );
        let env: Vec<(String, String)> = env.iter().map(|&(name, value)| (name.to_owned(), value.to_owned())).collect();
        Surefoot::start(&args, &env, &self.ground.path(name))
    }

    /// The graph as a planner without a fleet builds it.
    async fn built_alone(&self, request: &wire::StartBuildRequest) -> wire::GetGraphResponse {
        let cache = self.ground.path("alone");
        let alone = Surefoot::start(&["plan", "--cache", cache.to_str().unwrap()], &[], &self.ground.path("alone.log"));
        let mut client = client(&alone).await;
        let graph_id = build(&mut client, request).await.unwrap();
        graph(&mut client, &graph_id).await
    }

    pub(super) fn count(&self, from: &str) -> u64 {
        self.postgres.query(&format!("SELECT count(*) FROM {from}"))[0].parse().unwrap()
    }

    /// How long it takes until a planner has taken over what another one built.
    async fn taken_over_by(&self, planner: &Surefoot) -> Duration {
        let since = Instant::now();
        let query = format!("operations JOIN members ON members.id = member WHERE address = '{}'", planner.uri());
        wait_until("it is taken over", || async { self.count(&query) > 0 }).await;
        since.elapsed()
    }
}

pub(super) async fn client(planner: &Surefoot) -> Client {
    PlannerServiceClient::new(planner.connect().await).max_decoding_message_size(64 << 20)
}

/// A build that takes a second or two.
pub(super) fn request(seed: u64) -> wire::StartBuildRequest {
    wire::StartBuildRequest {
        map: Some(MapSpec { seed, size: Some(MapSize { width: 60, height: 80, depth: 60 }), ..Default::default() }),
        settings: Some(wire::BuildSettings { vertices: 60, neighbours: 8, repeats: 2, ..Default::default() }),
        ..Default::default()
    }
}

/// A build that takes a few seconds, also where nothing else runs: all probes of all candidates.
pub(super) fn large(seed: u64) -> wire::StartBuildRequest {
    let probing = wire::Probing::Exhaustive.into();
    let settings = wire::BuildSettings { vertices: 200, neighbours: 12, repeats: 8, probing, ..Default::default() };
    wire::StartBuildRequest { settings: Some(settings), ..request(seed) }
}

/// Waits for a build, and returns the id of its graph.
pub(super) async fn watch(client: &mut Client, build_id: String) -> Result<String, Status> {
    let mut messages = client.watch_build(wire::WatchBuildRequest { build_id }).await?.into_inner();
    let mut last = wire::Build::default();
    while let Some(message) = messages.message().await? {
        last = message.build.unwrap();
    }
    match last.failure {
        Some(failure) => Err(Status::new(Code::from(failure.code), failure.message)),
        None if last.stage() == BuildStage::Done => Ok(last.graph_id),
        None => Err(Status::cancelled("cancelled")),
    }
}

pub(super) async fn start(client: &mut Client, request: &wire::StartBuildRequest) -> Result<String, Status> {
    Ok(client.start_build(request.clone()).await?.into_inner().build.unwrap().build_id)
}

pub(super) async fn build(client: &mut Client, request: &wire::StartBuildRequest) -> Result<String, Status> {
    let build_id = start(client, request).await?;
    watch(client, build_id).await
}

/// A graph, without what may differ between planners: how long its build took, and whether it was loaded.
pub(super) async fn graph(client: &mut Client, graph_id: &str) -> wire::GetGraphResponse {
    let request = wire::GetGraphRequest { graph_id: graph_id.to_owned(), ..Default::default() };
    let mut graph = client.get_graph(request).await.unwrap().into_inner();
    let summary = graph.summary.as_mut().unwrap();
    (summary.build_s, summary.cached) = (0.0, false);
    graph
}

/// Start and goal of a query on a graph.
pub(super) async fn ends(client: &mut Client, graph_id: &str) -> (Vec3, Vec3) {
    let graph = graph(client, graph_id).await;
    let edge = &graph.edges[0];
    (graph.vertices[edge.from as usize], graph.vertices[edge.to as usize])
}

fn find(graph_id: &str, (start, goal): (Vec3, Vec3)) -> wire::FindPathRequest {
    let query = wire::PathQuery { start: Some(start), goal: Some(goal), ..Default::default() };
    wire::FindPathRequest { graph_id: graph_id.to_owned(), query: Some(query), ..Default::default() }
}

/// An edit that differs from all others by its number.
pub(super) fn edit(number: u32, (from, to): (Vec3, Vec3)) -> wire::Edit {
    let edge = wire::ForceEdge { from: Some(from), to: Some(to), seconds: Some(1.0 + number as f32) };
    wire::Edit { edit: Some(wire::edit::Edit::ForceEdge(edge)) }
}

pub(super) fn append(graph_id: &str, edit: wire::Edit) -> wire::AppendEditsRequest {
    wire::AppendEditsRequest {
        graph_id: graph_id.to_owned(),
        layer: "ways".to_owned(),
        edits: vec![edit],
        ..Default::default()
    }
}

pub(super) async fn layers(client: &mut Client, graph_id: &str) -> wire::GetLayersResponse {
    client
        .get_layers(wire::GetLayersRequest { graph_id: graph_id.to_owned(), ..Default::default() })
        .await
        .unwrap()
        .into_inner()
}

/// The numbers of all edits.
pub(super) async fn edits(client: &mut Client, graph_id: &str) -> Vec<u32> {
    let layers = layers(client, graph_id).await.layers;
    let seconds = layers.iter().flat_map(|layer| &layer.edits).map(|edit| match edit.edit.as_ref().unwrap() {
        wire::edit::Edit::ForceEdge(edge) => edge.seconds,
        other => panic!("{other:?}"),
    });
    seconds.map(|seconds| seconds.unwrap() as u32 - 1).collect()
}

pub(super) fn is_unavailable(status: &Status) -> bool {
    status.code() == Code::Unavailable && Reason::of(status) == Some(Reason::StoreUnavailable)
}

#[tokio::test(flavor = "multi_thread")]
async fn two_hundred_requests_of_three_planners_are_one_build() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let planners = ["a", "b", "c"].map(|name| fleet.planner(name, &[]));
    let mut clients = Vec::new();
    for idx in 0..8 {
        clients.push(client(&planners[idx % 3]).await);
    }
    let requests = (0..200).map(|idx| {
        let mut client = clients[idx % 8].clone();
        tokio::spawn(async move { build(&mut client, &request(1)).await.unwrap() })
    });
    let mut ids = BTreeSet::new();
    for task in requests.collect::<Vec<_>>() {
        ids.insert(task.await.unwrap());
    }
    assert_eq!(ids.len(), 1);
    let id = ids.first().unwrap();
    let built: f64 = planners.iter().map(|planner| planner.metric("surefoot_graphs_built_total").unwrap()).sum();
    assert_eq!((built, fleet.count("graphs"), fleet.count("claims")), (1.0, 1, 0));
    let alone = fleet.built_alone(&request(1)).await;
    for planner in &planners {
        assert!(graph(&mut client(planner).await, id).await == alone, "the bytes of one process");
        assert_eq!(planner.metric("surefoot_lease_held"), Some(1.0));
        assert_eq!(planner.metric("surefoot_stale_publishes_total"), Some(0.0));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_builder_that_is_killed_at_any_step_is_replaced() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let other = fleet.planner("other", &[]);
    let mut loads = client(&other).await;
    for (seed, step) in [(10, "claimed"), (11, "probing"), (12, "built"), (13, "stored"), (14, "published")] {
        let mut builder = fleet.planner("builder", &[("SUREFOOT_ABORT_AT", step)]);
        let mut asks = client(&builder).await;
        let request = if step == "probing" { large(seed) } else { request(seed) };
        let build_id = start(&mut asks, &request).await.unwrap();
        if step == "probing" {
            let probing =
                format!("operations WHERE stage = 3 AND id = {}", u64::from_str_radix(&build_id, 16).unwrap());
            wait_until("it probes", || async { fleet.count(&probing) == 1 }).await;
            builder.process.kill();
        } else {
            builder.process.wait();
        }
        let died = Instant::now();
        let mine = format!(
            "operations JOIN members ON members.id = member WHERE address = '{}' AND operations.id = {}",
            other.uri(),
            u64::from_str_radix(&build_id, 16).unwrap()
        );
        wait_until("it is taken over", || async { fleet.count(&mine) == 1 }).await;
        let took = died.elapsed();
        let graph_id = watch(&mut loads, build_id).await.unwrap();
        println!(
            "killed when {step}: taken over after {:.2} s, served after {:.2} s",
            took.as_secs_f64(),
            died.elapsed().as_secs_f64()
        );
        assert!(took.as_secs_f64() < LEASE + 2.0, "{step}: {took:?}");
        assert!(graph(&mut loads, &graph_id).await == fleet.built_alone(&request).await, "{step}");
        let rows = fleet
            .postgres
            .query(&format!("SELECT count(*), count(blob) FROM graphs WHERE encode(id, 'hex') = '{graph_id}'"));
        assert_eq!(rows, ["1|1"], "{step}");
    }
    assert_eq!(fleet.count("claims"), 0);
    assert_eq!(fleet.postgres.query("SELECT * FROM operations WHERE stage <> 5"), [""; 0]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_builder_that_was_stopped_past_its_lease_publishes_nothing() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    for (seed, step) in [(20, "built"), (21, "stored")] {
        let builder = fleet.planner("builder", &[("SUREFOOT_STOP_AT", step)]);
        let build_id = start(&mut client(&builder).await, &request(seed)).await.unwrap();
        let claimed = fleet.postgres.query("SELECT max(last_value) FROM tokens");
        wait_until("it has stopped", || async { builder.process.is_stopped() }).await;
        let other = fleet.planner("other", &[]);
        let mut loads = client(&other).await;
        let graph_id = watch(&mut loads, build_id.clone()).await.unwrap();
        let row = format!("SELECT token, blob FROM graphs WHERE encode(id, 'hex') = '{graph_id}'");
        let published = fleet.postgres.query(&row);
        assert!(published[0].split('|').next().unwrap().parse::<u64>().unwrap() > claimed[0].parse().unwrap());
        builder.process.signal("CONT");
        wait_until("its graph is refused", || async { builder.metric("surefoot_stale_publishes_total") == Some(1.0) })
            .await;
        let mut late = client(&builder).await;
        assert_eq!(watch(&mut late, build_id).await.unwrap(), graph_id);
        assert!(
            graph(&mut late, &graph_id).await == graph(&mut loads, &graph_id).await,
            "it serves what was published"
        );
        assert_eq!(fleet.postgres.query(&row), published, "nothing stale was stored");
        wait_until("it has joined again", || async { builder.metric("surefoot_lease_held") == Some(1.0) }).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_that_shuts_down_leaves_its_builds_to_others_at_once() {
    let _turn = turn().await;
    let fleet = Fleet { lease: 600.0, ..Fleet::new() };
    let (mut leaving, other) = (fleet.planner("leaving", &[]), fleet.planner("other", &[]));
    let mut loads = client(&other).await;
    let build_id = start(&mut client(&leaving).await, &large(30)).await.unwrap();
    let listed = loads.list_builds(wire::ListBuildsRequest::default()).await.unwrap().into_inner().builds;
    assert_eq!(listed.iter().map(|build| &build.build_id).collect::<Vec<_>>(), [&build_id]);
    wait_until("it builds", || async { fleet.count("claims") == 1 }).await;
    leaving.process.signal("TERM");
    assert!(leaving.process.wait().success());
    let took = fleet.taken_over_by(&other).await;
    println!("left: taken over after {:.2} s", took.as_secs_f64());
    watch(&mut loads, build_id).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn graphs_and_levels_are_loaded_on_a_miss() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let (first, second) = (fleet.planner("first", &[]), fleet.planner("second", &[]));
    let (mut builds, mut loads) = (client(&first).await, client(&second).await);
    let plain = build(&mut builds, &request(40)).await.unwrap();
    let spec = request(41).map.unwrap();
    let file = surefoot_levels::export_glb(&surefoot_generate::generate(&map_spec(Some(&spec)).unwrap()));
    let import =
        ImportMapRequest { name: "arena".to_owned(), format: MapFormat::Gltf.into(), file, ..Default::default() };
    let kept = MapServiceClient::new(first.connect().await).import_map(import).await.unwrap().into_inner();
    let of_level = wire::StartBuildRequest { map: None, map_hash: kept.map.unwrap().map_hash, ..request(41) };
    let imported = build(&mut builds, &of_level).await.unwrap();
    let edge = ends(&mut builds, &imported).await;
    builds.append_edits(append(&imported, edit(7, edge))).await.unwrap();
    for id in [&plain, &imported] {
        let query = ends(&mut builds, id).await;
        let plans = [builds.find_path(find(id, query)).await, loads.find_path(find(id, query)).await];
        let [here, there] = plans.map(|plan| plan.unwrap().into_inner());
        assert!(here == there && there.plan.is_some_and(|plan| !plan.legs.is_empty()));
        assert!(graph(&mut builds, id).await == graph(&mut loads, id).await);
    }
    assert_eq!(edits(&mut loads, &imported).await, [7]);
    assert_eq!(second.metric("surefoot_graphs_built_total"), Some(0.0));
    // A planner that starts later knows the level as well.
    let third = fleet.planner("third", &[]);
    let mut late = client(&third).await;
    assert_eq!(build(&mut late, &of_level).await.unwrap(), imported);
    assert_eq!(edits(&mut late, &imported).await, [7]);
    let absent =
        late.get_graph(wire::GetGraphRequest { graph_id: "0".repeat(64), ..Default::default() }).await.unwrap_err();
    assert_eq!(Reason::of(&absent), Some(Reason::GraphNotFound));
    // What pieces make of a map follows from its graph, on any planner.
    let at = ends(&mut builds, &plain).await.0;
    let block = BlockPiece { foot: Some(at), width: 2.0, depth: 2.0, height: 2.0, yaw: 0.0 };
    let block = Piece { name: "block".to_owned(), shape: Some(piece::Shape::Block(block)) };
    let pieces = wire::StartBuildRequest { pieces: vec![block], ..request(40) };
    let updated = build(&mut builds, &pieces).await.unwrap();
    assert!(graph(&mut builds, &updated).await == graph(&mut loads, &updated).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_reach_the_watchers_of_other_planners() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let (first, second) = (fleet.planner("first", &[]), fleet.planner("second", &[]));
    let (mut editor, mut watcher) = (client(&first).await, client(&second).await);
    let id = build(&mut editor, &request(50)).await.unwrap();
    let edge = ends(&mut editor, &id).await;
    let watched = wire::WatchGraphRequest { graph_id: id.clone() };
    let mut messages = watcher.watch_graph(watched).await.unwrap().into_inner();
    let (mut after_answer, mut after_call) = (Vec::new(), Vec::new());
    for number in 0..200 {
        let called = Instant::now();
        let revision = editor.append_edits(append(&id, edit(number, edge))).await.unwrap().into_inner().revision;
        let answered = Instant::now();
        while messages.message().await.unwrap().unwrap().revision != revision {}
        after_answer.push(answered.elapsed());
        after_call.push(called.elapsed());
    }
    print_times("an edit is seen by a watcher of another planner after the answer", &mut after_answer);
    print_times("an edit is seen by a watcher of another planner after the call", &mut after_call);
    // The median is 4.3 to 9 ms on two cores. A machine that also builds something else is slower.
    assert!(after_call[after_call.len() * 99 / 100] < Duration::from_secs(2));
}

/// Prints the distribution of some times, and sorts them.
fn print_times(what: &str, times: &mut [Duration]) {
    times.sort();
    let ms = |share: f64| times[(share * (times.len() - 1) as f64) as usize].as_secs_f64() * 1e3;
    let (median, most, all) = (ms(0.5), ms(0.99), ms(1.0));
    println!("{what}: p50 {median:.1} ms, p99 {most:.1} ms, max {all:.1} ms, of {}", times.len());
}

#[tokio::test(flavor = "multi_thread")]
async fn planners_that_edit_the_same_layer_lose_nothing() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let planners = ["a", "b", "c"].map(|name| fleet.planner(name, &[]));
    let id = build(&mut client(&planners[0]).await, &request(60)).await.unwrap();
    let edge = ends(&mut client(&planners[0]).await, &id).await;
    let mut tasks = Vec::new();
    for (idx, planner) in planners.iter().enumerate() {
        let (mut client, id) = (client(planner).await, id.clone());
        tasks.push(tokio::spawn(async move {
            let mut aborted = 0;
            for number in 0..25 {
                let request = append(&id, edit(100 * idx as u32 + number, edge));
                while let Err(status) = client.append_edits(request.clone()).await {
                    assert_eq!(Reason::of(&status), Some(Reason::LayersChanged), "{status}");
                    aborted += 1;
                }
            }
            aborted
        }));
    }
    let mut aborted = 0;
    for task in tasks {
        aborted += task.await.unwrap();
    }
    println!("75 edits of three planners on one layer: {aborted} tries aborted");
    for planner in &planners {
        let mut client = client(planner).await;
        wait_until("all planners have all edits", || {
            let (mut client, id) = (client.clone(), id.clone());
            async move { edits(&mut client, &id).await.len() == 75 }
        })
        .await;
        let found: BTreeSet<u32> = edits(&mut client, &id).await.into_iter().collect();
        assert_eq!(found, (0..3).flat_map(|idx| (0..25).map(move |number| 100 * idx + number)).collect());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn evidence_of_all_planners_adds_up() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let planners = ["a", "b"].map(|name| fleet.planner(name, &[]));
    let mut clients = [client(&planners[0]).await, client(&planners[1]).await];
    let id = build(&mut clients[0], &request(70)).await.unwrap();
    let key = graph(&mut clients[0], &id).await.edges[0].clone();
    let failed = wire::Traversal { from: key.from, to: key.to, reached: false, ..Default::default() };
    for (client, count) in clients.iter_mut().zip([3, 5]) {
        let request = wire::ReportTraversalsRequest {
            graph_id: id.clone(),
            traversals: vec![failed; count],
            ..Default::default()
        };
        assert_eq!(client.report_traversals(request).await.unwrap().into_inner().accepted, count as u32);
    }
    for client in &clients {
        wait_until("both know all eight", || {
            let (mut client, request) = (client.clone(), wire::ListReportsRequest { graph_id: id.clone() });
            async move {
                let reports = client.list_reports(request).await.unwrap().into_inner().reports;
                reports.iter().map(|report| (report.traversals, report.failures)).eq([(8, 8)])
            }
        })
        .await;
    }
    assert_eq!(fleet.postgres.query("SELECT tries, successes FROM evidence"), ["8|0"]);
    let [first, second] = &mut clients;
    let mut times = Vec::new();
    // Fewer in all than are halved.
    for count in 9..60 {
        let request =
            wire::ReportTraversalsRequest { graph_id: id.clone(), traversals: vec![failed], ..Default::default() };
        first.report_traversals(request).await.unwrap();
        let reported = Instant::now();
        let listed = wire::ListReportsRequest { graph_id: id.clone() };
        while second.list_reports(listed.clone()).await.unwrap().into_inner().reports[0].traversals < count {
            assert!(reported.elapsed() < surefoot_processes::LIMIT);
        }
        times.push(reported.elapsed());
    }
    print_times("a report counts on another planner after the answer", &mut times);
    let dropped = wire::DropReportsRequest { graph_id: id.clone(), reporter: "127.0.0.1".to_owned() };
    assert_eq!(second.drop_reports(dropped).await.unwrap().into_inner().dropped, 59);
    wait_until("the other one has forgotten them", || {
        let (mut client, request) = (first.clone(), wire::ListReportsRequest { graph_id: id.clone() });
        async move { client.list_reports(request).await.unwrap().into_inner().reports.is_empty() }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn while_the_database_is_away_plans_go_on_and_no_edit_is_acknowledged() {
    let _turn = turn().await;
    let mut fleet = Fleet::new();
    let planners = ["a", "b"].map(|name| fleet.planner(name, &[]));
    let mut clients = [client(&planners[0]).await, client(&planners[1]).await];
    let id = build(&mut clients[0], &request(80)).await.unwrap();
    let edge = ends(&mut clients[0], &id).await;
    clients[0].append_edits(append(&id, edit(1, edge))).await.unwrap();
    ends(&mut clients[1], &id).await;
    let (stop, stopping) = tokio::sync::watch::channel(false);
    let plans: Vec<_> = clients
        .iter()
        .map(|client| {
            let (mut client, id, stopping) = (client.clone(), id.clone(), stopping.clone());
            tokio::spawn(async move {
                let mut count = 0u64;
                while !*stopping.borrow() {
                    client.find_path(find(&id, edge)).await.expect("a graph in memory is planned on");
                    count += 1;
                    tokio::time::sleep(Duration::from_millis(2)).await;
                }
                count
            })
        })
        .collect();
    fleet.postgres.kill();
    let mut unknown = String::new();
    for client in &mut clients {
        unknown = start(client, &request(80)).await.unwrap();
        let refused = client.append_edits(append(&id, edit(2, edge))).await.unwrap_err();
        assert!(is_unavailable(&refused), "{refused}");
        let port = fleet.postgres.address.port().to_string();
        assert!(!refused.message().contains(&port) && !refused.message().contains("postgres"), "{refused}");
        let failed = build(client, &request(81)).await.unwrap_err();
        assert_eq!(failed.code(), Code::Unavailable, "{failed}");
        assert_eq!(build(client, &request(80)).await.unwrap(), id, "it is in memory");
    }
    fleet.postgres.start_again();
    wait_until("edits are taken again", || {
        let (mut client, id) = (clients[1].clone(), id.clone());
        async move { client.append_edits(append(&id, edit(3, edge))).await.is_ok() }
    })
    .await;
    wait_until("the other planner follows again", || {
        let (mut client, id) = (clients[0].clone(), id.clone());
        async move { edits(&mut client, &id).await == [1, 3] }
    })
    .await;
    stop.send_replace(true);
    for plans in plans {
        let count = plans.await.unwrap();
        println!("{count} plans while the database was away and came back, none failed");
    }
    let late = fleet.planner("late", &[]);
    assert_eq!(edits(&mut client(&late).await, &id).await, [1, 3]);
    wait_until("builds of that time are known to all", || {
        let (mut client, unknown) = (clients[0].clone(), unknown.clone());
        async move { watch(&mut client, unknown).await.is_ok() }
    })
    .await;
    build(&mut clients[0], &request(81)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn while_the_blobs_are_away_builds_wait_or_fail_and_nothing_is_published() {
    let _turn = turn().await;
    let mut fleet = Fleet::new();
    let s3 = S3::start(&fleet.ground);
    let relay = Relay::to(s3.address);
    fleet.blobs = S3::BLOBS.to_owned();
    let env = S3::env(relay.address);
    let env: Vec<(&str, &str)> = env.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
    let (first, second) = (fleet.planner("first", &env), fleet.planner("second", &env));
    let (mut builds, mut loads) = (client(&first).await, client(&second).await);
    relay.refuse();
    let failed = build(&mut builds, &request(90)).await.unwrap_err();
    assert_eq!(failed.code(), Code::Unavailable, "{failed}");
    assert_eq!((fleet.count("graphs"), fleet.count("claims")), (0, 0));
    let waiting = start(&mut builds, &request(91)).await.unwrap();
    wait_until("the graph waits to be stored", || async {
        first.process.log().matches("cannot store a graph yet").count() > 3
    })
    .await;
    relay.mend();
    let id = watch(&mut builds, waiting).await.unwrap();
    assert!(graph(&mut loads, &id).await == fleet.built_alone(&request(91)).await);
    relay.refuse();
    let third = fleet.planner("third", &env);
    let refused = client(&third)
        .await
        .get_graph(wire::GetGraphRequest { graph_id: id.clone(), ..Default::default() })
        .await
        .unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable, "{refused}");
    assert_eq!(third.metric("surefoot_graphs_built_total"), Some(0.0), "a graph that exists is not built again");
    let query = ends(&mut loads, &id).await;
    loads.find_path(find(&id, query)).await.expect("a graph in memory is planned on");
    relay.mend();
    assert!(graph(&mut client(&third).await, &id).await == graph(&mut loads, &id).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_that_is_cut_off_serves_what_it_has_and_publishes_nothing() {
    let _turn = turn().await;
    let mut fleet = Fleet::new();
    let inside = fleet.planner("inside", &[]);
    let relay = Relay::to(fleet.postgres.address);
    fleet.store = Postgres::url_at(relay.address);
    let outside = fleet.planner("outside", &[("SUREFOOT_STOP_AT", "built")]);
    let (mut near, mut far) = (client(&inside).await, client(&outside).await);
    let id = build(&mut near, &request(100)).await.unwrap();
    let edge = ends(&mut far, &id).await;
    far.append_edits(append(&id, edit(1, edge))).await.unwrap();
    let build_id = start(&mut far, &request(101)).await.unwrap();
    wait_until("its graph is built", || async { outside.process.is_stopped() }).await;
    relay.cut();
    outside.process.signal("CONT");
    let cut = Instant::now();
    let other = watch(&mut near, build_id.clone()).await.unwrap();
    println!("cut off: its build ended elsewhere after {:.2} s", cut.elapsed().as_secs_f64());
    assert!(cut.elapsed().as_secs_f64() < LEASE + 2.0 + 3.0, "a build of a second or two included");
    near.append_edits(append(&id, edit(2, edge))).await.unwrap();
    let refused = far.append_edits(append(&id, edit(3, edge))).await.unwrap_err();
    assert!(is_unavailable(&refused), "{refused}");
    far.find_path(find(&id, edge)).await.expect("a graph in memory is planned on");
    assert_eq!(edits(&mut far, &id).await, [1], "it cannot know more");
    assert_eq!(outside.metric("surefoot_lease_held"), Some(0.0));
    let row = format!("SELECT token, blob FROM graphs WHERE encode(id, 'hex') = '{other}'");
    let published = fleet.postgres.query(&row);
    relay.mend();
    wait_until("it follows again", || {
        let (mut client, id) = (far.clone(), id.clone());
        async move { edits(&mut client, &id).await == [1, 2] }
    })
    .await;
    assert_eq!(watch(&mut far, build_id).await.unwrap(), other);
    assert_eq!(fleet.postgres.query(&row), published, "nothing stale was stored");
    wait_until("it has joined again", || async { outside.metric("surefoot_lease_held") == Some(1.0) }).await;
    far.append_edits(append(&id, edit(4, edge))).await.unwrap();
    wait_until("all have the same edits", || {
        let (mut client, id) = (near.clone(), id.clone());
        async move { edits(&mut client, &id).await == [1, 2, 4] }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn graphs_are_those_of_one_process_whoever_is_killed() {
    let _turn = turn().await;
    let fleet = Fleet::new();
    let mut planners = ["a", "b", "c"].map(|name| fleet.planner(name, &[]));
    let cache = fleet.ground.path("alone");
    let alone = Surefoot::start(&["plan", "--cache", cache.to_str().unwrap()], &[], &fleet.ground.path("alone.log"));
    let mut reference = client(&alone).await;
    let rounds: u64 = std::env::var("SUREFOOT_FLEET_ROUNDS").map_or(6, |rounds| rounds.parse().unwrap());
    let (mut longest, mut struck) = (Duration::ZERO, 0);
    for round in 0..rounds {
        // The same moments in every run: digits of a hash. Most rounds kill who was asked.
        let dice = (round + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let asked = (dice >> 20) as usize % 3;
        let victim = (asked + usize::from((dice >> 30).is_multiple_of(4))) % 3;
        let wanted = large(1000 + round);
        // The planner that is asked may be killed before it answers.
        let _ = start(&mut client(&planners[asked]).await, &wanted).await;
        tokio::time::sleep(Duration::from_millis((dice >> 40) % 500)).await;
        let killed = Instant::now();
        planners[victim].restart();
        struck += u64::from(victim == asked && fleet.count("claims") > 0);
        let survivor = &planners[(victim + 1) % 3];
        let mut survivor = client(survivor).await;
        let id = build(&mut survivor, &wanted).await.unwrap();
        longest = longest.max(killed.elapsed());
        assert_eq!(build(&mut reference, &wanted).await.unwrap(), id, "round {round}");
        let graphs = [graph(&mut survivor, &id).await, graph(&mut reference, &id).await];
        assert!(graphs[0] == graphs[1], "round {round}");
    }
    println!(
        "{rounds} rounds of kills, {struck} of them of a builder: served after {:.2} s at most",
        longest.as_secs_f64()
    );
    assert!(struck > 0, "no planner was killed during a build");
    assert_eq!((fleet.count("graphs"), fleet.count("graphs WHERE blob IS NULL")), (rounds, 0));
    // Every builder stored the same bytes. Files that a killed process was writing have other names.
    let folders = std::fs::read_dir(fleet.ground.path("blobs")).unwrap().map(|folder| folder.unwrap().path());
    let files = folders.flat_map(|folder| std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().file_name()));
    let blobs: Vec<_> = files.filter(|file| file.len() == 64).collect();
    assert_eq!(blobs.len() as u64, rounds, "{blobs:?}");
}
