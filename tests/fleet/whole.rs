//! A whole fleet: failures of all its parts at random moments, a network that falls apart, and an upgrade under load.

use crate::relay::Relay;
use crate::services::{Ground, Nats, Postgres, S3};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use surefoot_net::client::Credentials;
use surefoot_net::replicas::{ReplicaLink, Replicas};
use surefoot_processes::{LIMIT, Surefoot, program, wait_until};
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1 as world;
use tokio_stream::StreamExt;
use tonic::{Code, Status};

/// Time after which a silent process is taken for dead, s.
const LEASE: &str = "2";
const PLANNERS: usize = 3;
const PROVERS: usize = 2;
/// Layer that the tests edit.
const LAYER: &str = "designers";

/// How often something fails (`SUREFOOT_FLEET_ROUNDS`).
fn rounds() -> u64 {
    std::env::var("SUREFOOT_FLEET_ROUNDS").map_or(6, |rounds| rounds.parse().expect("SUREFOOT_FLEET_ROUNDS"))
}

/// Draws what fails and when; the same every time.
struct Draws(u64);

impl Draws {
    fn below(&mut self, count: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % count
    }

    fn moment(&mut self) -> Duration {
        Duration::from_millis(self.below(1500))
    }
}

fn request(seed: u64) -> plan::StartBuildRequest {
    let size = world::MapSize { width: 100, height: 80, depth: 100 };
    let settings = plan::BuildSettings { vertices: 60, neighbours: 6, ..Default::default() };
    plan::StartBuildRequest {
        map: Some(world::MapSpec { seed, size: Some(size), ..Default::default() }),
        settings: Some(settings),
        ..Default::default()
    }
}

/// A client of the planners at these addresses, for calls about what `key` names.
fn client_of<'a>(planners: impl IntoIterator<Item = &'a Surefoot>, key: &str) -> PlannerServiceClient<ReplicaLink> {
    let uris: Vec<String> = planners.into_iter().map(Surefoot::uri).collect();
    let links = Replicas::dial(&Credentials::default(), &uris).expect("URIs").connect_lazy();
    PlannerServiceClient::new(links.for_key(key))
}

/// Builds a graph, whatever fails meanwhile: a caller asks again. The id of the graph.
async fn build(client: &mut PlannerServiceClient<ReplicaLink>, seed: u64) -> String {
    let since = Instant::now();
    loop {
        match try_build(client, seed).await {
            Ok(graph_id) => return graph_id,
            Err(status) => assert!(since.elapsed() < LIMIT, "no graph: {status}"),
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

async fn try_build(client: &mut PlannerServiceClient<ReplicaLink>, seed: u64) -> Result<String, Status> {
    let build = client.start_build(request(seed)).await?.into_inner().build.expect("a build");
    let request = plan::WatchBuildRequest { build_id: build.build_id };
    let mut states = client.watch_build(request).await?.into_inner();
    let mut last = None;
    while let Some(state) = states.next().await {
        last = state?.build;
    }
    let last = last.ok_or_else(|| Status::unavailable("the stream ended"))?;
    match last.stage() {
        plan::BuildStage::Done => Ok(last.graph_id),
        _ => Err(Status::unavailable(format!("{:?}", last.failure))),
    }
}

/// What a graph is, without how long it took to build it.
#[derive(Debug, PartialEq)]
struct Graph {
    vertices: Vec<world::Vec3>,
    islands: Vec<u32>,
    edges: Vec<plan::Edge>,
}

async fn graph_of(planner: &Surefoot, graph_id: &str) -> Graph {
    let mut client = PlannerServiceClient::new(planner.connect().await).max_decoding_message_size(1 << 26);
    let since = Instant::now();
    loop {
        match client.get_graph(plan::GetGraphRequest { graph_id: graph_id.to_owned(), ..Default::default() }).await {
            Ok(answer) => {
                let plan::GetGraphResponse { vertices, islands, edges, .. } = answer.into_inner();
                return Graph { vertices, islands, edges };
            }
            Err(status) => {
                let is_passing = matches!(status.code(), Code::Unavailable | Code::Unknown | Code::Internal);
                assert!(is_passing && since.elapsed() < LIMIT, "graph {graph_id}: {status}");
            }
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// The graphs that one process builds, which shares nothing.
async fn alone(ground: &Ground, seeds: impl Iterator<Item = u64>) -> Vec<(String, Graph)> {
    let cache = ground.path("alone");
    let args = ["plan", "--cache", cache.to_str().expect("a plain name")];
    let planner = Surefoot::start(&args, &[], &ground.path("alone.log"));
    planner.connect().await;
    let mut client = client_of([&planner], "");
    let mut graphs = Vec::new();
    for seed in seeds {
        let id = build(&mut client, seed).await;
        let graph = graph_of(&planner, &id).await;
        graphs.push((id, graph));
    }
    graphs
}

/// Planners, provers and what they share. Every planner reaches the database through a relay of its own, and all the
/// blobs through one.
struct Fleet {
    planners: Vec<Surefoot>,
    provers: Vec<Surefoot>,
    links: Vec<Relay>,
    to_s3: Relay,
    nats: Nats,
    postgres: Postgres,
    _s3: S3,
}

impl Fleet {
    fn start(ground: &Ground, program: &std::path::Path) -> Self {
        let (postgres, nats, s3) = (Postgres::start(ground), Nats::start(ground), S3::start(ground));
        let to_s3 = Relay::to(s3.address);
        let env = S3::env(to_s3.address);
        let links: Vec<Relay> = (0..PLANNERS).map(|_| Relay::to(postgres.address)).collect();
        let nats_url = nats.url();
        let planner = |(idx, link): (usize, &Relay)| {
            let store = Postgres::url_at(link.address);
            let args = [
                "plan",
                "--store",
                &store,
                "--blobs",
                S3::BLOBS,
                "--nats",
                &nats_url,
                "--lease",
                LEASE,
                "--threads",
                "1",
            ];
            Surefoot::start_version(program, &args, &env, &ground.path(&format!("planner-{idx}.log")))
        };
        let planners = links.iter().enumerate().map(planner).collect();
        let prover = |idx| {
            let args = ["prove", "--nats", &nats_url, "--blobs", S3::BLOBS, "--threads", "1"];
            Surefoot::start_version(program, &args, &env, &ground.path(&format!("prover-{idx}.log")))
        };
        let provers = (0..PROVERS).map(prover).collect();
        Self { planners, provers, links, to_s3, nats, postgres, _s3: s3 }
    }

    async fn wait(&self) {
        for planner in &self.planners {
            planner.connect().await;
        }
    }

    fn client(&self, key: &str) -> PlannerServiceClient<ReplicaLink> {
        client_of(&self.planners, key)
    }

    /// Lets something fail for a while; what it was.
    async fn fail(&mut self, draws: &mut Draws) -> String {
        tokio::time::sleep(draws.moment()).await;
        let pause = draws.moment();
        let victim = draws.below(PLANNERS as u64) as usize;
        match draws.below(8) {
            0..=2 => {
                self.planners[victim].restart();
                format!("planner {victim} was killed")
            }
            3 => {
                let prover = victim % PROVERS;
                self.provers[prover].restart();
                format!("prover {prover} was killed")
            }
            4 => {
                // Longer than its lease: others have taken over when it goes on.
                self.planners[victim].process.signal("STOP");
                tokio::time::sleep(Duration::from_secs(3)).await;
                self.planners[victim].process.signal("CONT");
                format!("planner {victim} was silent")
            }
            5 => {
                self.postgres.kill();
                tokio::time::sleep(pause).await;
                self.postgres.start_again();
                "PostgreSQL was killed".to_owned()
            }
            6 => {
                self.nats.kill();
                tokio::time::sleep(pause).await;
                self.nats.start_again();
                "NATS was killed".to_owned()
            }
            _ => {
                self.to_s3.refuse();
                tokio::time::sleep(pause).await;
                self.to_s3.mend();
                "S3 refused".to_owned()
            }
        }
    }
}

/// Forbids the first edge of a graph. Whether the planners have acknowledged it.
async fn forbid(client: &mut PlannerServiceClient<ReplicaLink>, graph_id: &str, graph: &Graph) -> Result<(), Status> {
    let edge = graph.edges.first().expect("an edge");
    let place = |vertex: u32| Some(graph.vertices[vertex as usize]);
    let ends = plan::EdgeEdit { from: place(edge.from), to: place(edge.to) };
    let edit = plan::Edit { edit: Some(plan::edit::Edit::ForbidEdge(ends)) };
    let request = plan::AppendEditsRequest {
        graph_id: graph_id.to_owned(),
        layer: LAYER.to_owned(),
        edits: vec![edit],
        ..Default::default()
    };
    client.append_edits(request).await.map(|_| ())
}

/// Number of edits of the level of a graph, as this planner knows them; `None` while it cannot say.
async fn edits_at(planner: &Surefoot, graph_id: &str) -> Option<usize> {
    let mut client = PlannerServiceClient::new(planner.connect().await);
    let layers = client
        .get_layers(plan::GetLayersRequest { graph_id: graph_id.to_owned(), ..Default::default() })
        .await
        .ok()?
        .into_inner();
    Some(layers.layers.iter().map(|layer| layer.edits.len()).sum())
}

#[tokio::test(flavor = "multi_thread")]
async fn whatever_fails_graphs_are_those_of_one_process() {
    let ground = Ground::new();
    let expected = alone(&ground, 0..rounds()).await;
    let mut fleet = Fleet::start(&ground, &program("surefoot"));
    fleet.wait().await;
    let mut draws = Draws(7);
    for (seed, (id, graph)) in (0..).zip(&expected) {
        let mut client = fleet.client(id);
        let building = tokio::spawn(async move { build(&mut client, seed).await });
        let what = fleet.fail(&mut draws).await;
        assert_eq!(&building.await.expect("it does not panic"), id, "round {seed}: {what}");
        for planner in &fleet.planners {
            assert!(&graph_of(planner, id).await == graph, "round {seed}: {what}: another graph at {}", planner.uri());
        }
        // A second failure, while edits are made.
        let mut client = fleet.client(id);
        let (at, of) = (id.clone(), graph.edges.len().min(1));
        let shape = Graph { vertices: graph.vertices.clone(), islands: Vec::new(), edges: graph.edges[..of].to_vec() };
        let editing = tokio::spawn(async move {
            let (mut acknowledged, mut tried) = (0, 0);
            while acknowledged < 3 {
                tried += 1;
                acknowledged += usize::from(forbid(&mut client, &at, &shape).await.is_ok());
            }
            (acknowledged, tried)
        });
        let then = fleet.fail(&mut draws).await;
        let limited = tokio::time::timeout(LIMIT, editing);
        let (acknowledged, tried) = limited.await.expect("edits are taken again").expect("it does not panic");
        for planner in &fleet.planners {
            let what = format!("round {seed}: {then}: {acknowledged} edits of {tried} are known at {}", planner.uri());
            wait_until(&what, || async {
                edits_at(planner, id).await.is_some_and(|edits| (acknowledged..=tried).contains(&edits))
            })
            .await;
        }
        eprintln!("round {seed}: {what}, then {then}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_that_is_cut_off_goes_on_with_what_it_has_and_catches_up() {
    let ground = Ground::new();
    let fleet = Fleet::start(&ground, &program("surefoot"));
    fleet.wait().await;
    let id = build(&mut fleet.client("a map"), 0).await;
    for planner in &fleet.planners {
        graph_of(planner, &id).await;
    }
    let graph = graph_of(&fleet.planners[1], &id).await;
    let mut connected = fleet.client("a map");
    fleet.links[0].cut();
    let mut alone = PlannerServiceClient::new(fleet.planners[0].connect().await);
    let query = plan::PathQuery {
        start: Some(graph.vertices[0]),
        goal: Some(graph.vertices[graph.vertices.len() - 1]),
        ..Default::default()
    };
    let request = plan::FindPathRequest { graph_id: id.clone(), query: Some(query), ..Default::default() };
    alone.find_path(request.clone()).await.expect("plans on what is in memory go on");
    let ends = plan::EdgeEdit {
        from: Some(graph.vertices[graph.edges[0].from as usize]),
        to: Some(graph.vertices[graph.edges[0].to as usize]),
    };
    let edit = plan::AppendEditsRequest {
        graph_id: id.clone(),
        layer: "cut off".to_owned(),
        edits: vec![plan::Edit { edit: Some(plan::edit::Edit::ForbidEdge(ends)) }],
        ..Default::default()
    };
    let refused = alone.append_edits(edit).await.expect_err("what is not durable is not acknowledged");
    assert!(matches!(refused.code(), Code::Unavailable | Code::DeadlineExceeded), "{refused}");
    // The others notice that its connection hangs and go on without it.
    let since = Instant::now();
    while let Err(status) = forbid(&mut connected, &id, &graph).await {
        assert!(since.elapsed() < LIMIT, "the others take edits: {status}");
    }
    build(&mut connected, 1).await;
    alone.find_path(request).await.expect("plans on what is in memory still go on");
    fleet.links[0].mend();
    wait_until("it has caught up", || async {
        edits_at(&fleet.planners[0], &id).await.is_some_and(|edits| edits >= 1)
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upgrade_of_one_planner_after_the_other_fails_no_plan() {
    let ground = Ground::new();
    let before = std::env::var_os("SUREFOOT_BEFORE").map_or_else(|| program("surefoot"), PathBuf::from);
    let mut fleet = Fleet::start(&ground, &before);
    fleet.wait().await;
    let id = build(&mut fleet.client("a map"), 0).await;
    let graph = graph_of(&fleet.planners[0], &id).await;
    let is_over = Arc::new(AtomicBool::new(false));
    let longest_ms = Arc::new(AtomicU64::new(0));
    let callers: Vec<_> = (0..4u32)
        .map(|caller| {
            // Callers of one key would all call the same planner.
            let mut client = fleet.client(&format!("map {caller}"));
            let (id, vertices) = (id.clone(), graph.vertices.clone());
            let (is_over, longest_ms) = (is_over.clone(), longest_ms.clone());
            tokio::spawn(async move {
                let mut plans = 0u64;
                while !is_over.load(Ordering::Relaxed) {
                    let at = |idx: u64| Some(vertices[(idx % vertices.len() as u64) as usize]);
                    let query = plan::PathQuery { start: at(plans), goal: at(plans / 7 + 3), ..Default::default() };
                    let started = Instant::now();
                    let request =
                        plan::FindPathRequest { graph_id: id.clone(), query: Some(query), ..Default::default() };
                    client.find_path(request).await.unwrap_or_else(|status| panic!("plan {plans} failed: {status}"));
                    longest_ms.fetch_max(started.elapsed().as_millis() as u64, Ordering::Relaxed);
                    plans += 1;
                }
                plans
            })
        })
        .collect();
    for planner in &mut fleet.planners {
        planner.upgrade();
        let channel = planner.connect().await;
        // As an orchestrator does, it goes on when the new one is ready.
        let mut client = PlannerServiceClient::new(channel);
        let request = plan::GetGraphRequest { graph_id: id.clone(), ..Default::default() };
        client.get_graph(request).await.expect("the new one loads the graph");
    }
    is_over.store(true, Ordering::Relaxed);
    let mut plans = 0;
    for caller in callers {
        plans += caller.await.expect("no plan fails");
    }
    eprintln!("{plans} plans, the longest took {} ms", longest_ms.load(Ordering::Relaxed));
    assert!(plans > 0);
}
