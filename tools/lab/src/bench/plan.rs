//! The planner: builds, and plans in this process and over gRPC, compared with petgraph's searches.

use super::edits::edits;
use super::many;
use super::tiles::tiled;
use super::{Figure, median, timed, timed_with};
use crate::processes::await_build;
use anyhow::Context;
use petgraph::algo::{astar, dijkstra};
use petgraph::graph::{DiGraph, NodeIndex};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use surefoot_cli::commands::core_count;
use surefoot_net::serving::{Endpoint, Shutdown};
use surefoot_planner::Progress;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::store::GraphStore;
use surefoot_planner::{Aabb, BuildSettings, Built, NavGraph, Query, Router, Rule, Shape, Stop, VertexId, Zone, Zones};
use surefoot_planner_service::store::{DEFAULT_LIMIT_BYTES, DiskStore};
use surefoot_planner_service::{self as service, PlannerConfig};
use surefoot_policy::Policy;
use surefoot_proto::convert;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::plans::settings_to_wire;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::graphs;
use surefoot_world::{CharacterProfile, MapSpec, Vec3, navigable};
use tonic::transport::Channel;

/// Number of queries that are timed one by one.
const QUERIES: usize = 4000;
/// How often each query is timed.
const PASSES: usize = 5;
/// How many of the queries petgraph's searches answer as well.
const REFERENCE_QUERIES: usize = 500;
/// Width of the map whose graph is laid side by side, m, and the number of copies along each side.
const TILE_M: f32 = 1000.0;
const TILES: u32 = 8;
/// Number of plans in the in-process batch.
const BATCH: usize = 200_000;
/// Number of clients of the service.
const CLIENTS: usize = 64;
/// Requests per second that all clients send together.
const REQUESTS_PER_S: u32 = 2000;
/// How long the clients send requests, s.
const LOAD_S: u32 = 10;
/// Number of queries in one batch over gRPC.
const WIRE_BATCH: usize = 2000;

/// All figures of `bench plan`.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let settings = BuildSettings::default().with(|it| {
        it.vertices = 800;
        it.neighbours = 20;
    })?;
    let context = |spec: &MapSpec| -> anyhow::Result<ProbeContext> {
        Ok(ProbeContext {
            map: Arc::new(surefoot_generate::generate(spec)),
            profile: CharacterProfile::default(),
            policy: Policy::shipped()?,
        })
    };
    let (small, small_interim) = build_watched(&context(&MapSpec::new(1000))?, &settings)?;
    let spec = MapSpec::with_side(3000, TILE_M as u32)?;
    let settings = settings.with(|it| it.vertices = 1600)?;
    let context = context(&spec)?;
    let (big, big_interim) = build_watched(&context, &settings)?;
    let exhaustive = |vertices: f64| vertices * 20.0 * 2.0;
    let saved = |probes: u64, vertices: f64| 100.0 * (1.0 - probes as f64 / exhaustive(vertices));
    let mut figures = vec![
        Figure::new("build_800_s", small.stats.seconds, "s").at_most(15.0),
        Figure::new("build_800_probes_saved", saved(small.stats.probes, 800.0), "%"),
        Figure::new("build_1600_s", big.stats.seconds, "s").at_most(60.0),
        Figure::new("build_1600_probes_saved", saved(big.stats.probes, 1600.0), "%"),
        Figure::new("interim_800_s", small_interim.map_or(f64::NAN, |(seconds, _)| seconds), "s"),
        Figure::new("interim_1600_s", big_interim.as_ref().map_or(f64::NAN, |(seconds, _)| *seconds), "s"),
    ];
    let (router, fill) = timed_with(|| Router::new(big.graph.clone(), DEFAULT_LABEL_LIMIT, core_count()));
    figures.push(Figure::new("plan_labels_s", fill, "s"));
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let points = navigable::sample_many(&context.map, &context.profile, 2000, &mut rng)?;
    let mut draw = || points[rng.random_range(0..points.len())];
    let queries: Vec<Query> = (0..QUERIES).map(|_| Query::new(draw(), draw())).collect();
    if let Some((_, graph)) = big_interim {
        let router = Router::new(graph, 0, core_count());
        let found = queries.iter().filter(|query| router.find_path(query).no_path.is_none()).count();
        figures.push(Figure::new("interim_1600_found", 100.0 * found as f64 / queries.len() as f64, "%"));
    }
    figures.extend(searches(&big.graph, &router, &queries));
    figures.extend(many::figures(&router, &context, &points));
    figures.extend(in_zones(&router, &queries, &points));
    figures.extend(far_away(&big.graph, &points)?);
    figures.push(batch(&router, &queries));
    let folder = std::env::temp_dir().join(format!("surefoot-bench-{}", std::process::id()));
    let store = DiskStore::open(&folder, DEFAULT_LIMIT_BYTES)?;
    store.put(&graphs::id_of(&context, &settings), &big)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let served = runtime.block_on(over_grpc(context.policy.clone(), store, &spec, &settings, &queries));
    runtime.shutdown_timeout(Duration::from_secs(2));
    std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    figures.extend(served?);
    Ok(figures)
}

/// Builds a graph. Also returns its first interim graph, with the time from the start of the build to it,
/// s; `None` if the build ended before.
fn build_watched(context: &ProbeContext, settings: &BuildSettings) -> anyhow::Result<(Built, Option<(f64, NavGraph)>)> {
    let progress = Progress::default();
    let is_over = AtomicBool::new(false);
    let started = Instant::now();
    let watch = || {
        while !is_over.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(25));
            if let Some(graph) = progress.interim.graph(&context.map, settings.threshold) {
                return Some((started.elapsed().as_secs_f64(), graph));
            }
        }
        None
    };
    std::thread::scope(|scope| {
        let watching = scope.spawn(watch);
        let built = graphs::build(context, settings, core_count(), &progress);
        is_over.store(true, Ordering::Relaxed);
        Ok((built?, watching.join().expect("watching does not panic")))
    })
}

/// The same queries to goals that no vertex leads to: as far above ground as no character jumps.
fn out_of_reach(queries: &[Query]) -> Vec<Query> {
    queries.iter().map(|query| Query { goal: query.goal + Vec3::Y * 100.0, ..query.clone() }).collect()
}

fn micros(work: impl FnMut()) -> f64 {
    timed(work) * 1.0e6
}

/// Times plans one by one and compares them with petgraph's searches between the same vertices.
fn searches(graph: &NavGraph, router: &Router, queries: &[Query]) -> Vec<Figure> {
    let plans: Vec<_> = queries.iter().map(|query| router.find_path(query)).collect();
    let passes = (0..PASSES).flat_map(|_| queries);
    let ours = median(passes.map(|query| micros(|| drop(black_box(router.find_path(query))))).collect());
    let (reachable_us, unreachable_us) = (least_times(router, queries), least_times(router, &out_of_reach(queries)));
    let slowest = |times: &[f64]| times.iter().copied().fold(0.0, f64::max);
    let ends = plans.iter().filter(|plan| plan.legs.len() > 2).filter_map(|plan| {
        match (plan.legs[0].key.to, plan.legs[plan.legs.len() - 1].key.from) {
            (Stop::Vertex(from), Stop::Vertex(to)) => Some((from, to)),
            _ => None,
        }
    });
    let ends: Vec<(VertexId, VertexId)> = ends.take(REFERENCE_QUERIES).collect();
    let node = |vertex: VertexId| NodeIndex::new(vertex.idx());
    let mut petgraph = DiGraph::new();
    graph.positions().iter().for_each(|at| _ = petgraph.add_node(*at));
    graph.edges().for_each(|edge| _ = petgraph.add_edge(node(edge.key.from), node(edge.key.to), *edge));
    let petgraph = &petgraph;
    let cost = |edge: petgraph::graph::EdgeReference<'_, surefoot_planner::Edge>| edge.weight().evidence.cost();
    // The rate, in metres per unit of cost, that makes straight-line distance a lower bound of the remaining cost.
    let rate = graph
        .edges()
        .map(|edge| {
            f64::from(graph.position(edge.key.from).distance(graph.position(edge.key.to))) / edge.evidence.cost()
        })
        .fold(f64::MIN_POSITIVE, f64::max);
    let by_dijkstra =
        ends.iter().map(|&(from, to)| micros(|| drop(black_box(dijkstra(petgraph, node(from), Some(node(to)), cost)))));
    let by_dijkstra = median(by_dijkstra.collect());
    let by_astar = ends.iter().map(|&(from, to)| {
        let goal = graph.position(to);
        let remaining = |at: NodeIndex| f64::from(petgraph[at].distance(goal)) / rate;
        micros(|| drop(black_box(astar(petgraph, node(from), |at| at == node(to), cost, remaining))))
    });
    let by_astar = median(by_astar.collect());
    let our_search =
        median(ends.iter().map(|&(from, to)| micros(|| drop(black_box(router.search(from, to))))).collect());
    let look_up = median(ends.iter().map(|&(from, to)| micros(|| drop(black_box(router.look_up(from, to))))).collect());
    let lengths = median(plans.iter().map(|plan| plan.legs.len() as f64).collect());
    vec![
        Figure::new("plan_us_median", ours, "us").at_most(5.0).with_reference(
            "petgraph's A* between two vertices",
            by_astar,
            false,
        ),
        Figure::new("plan_us_slowest", slowest(&reachable_us), "us"),
        Figure::new("plan_unreachable_us_median", median(unreachable_us.clone()), "us"),
        Figure::new("plan_unreachable_us_slowest", slowest(&unreachable_us), "us"),
        Figure::new("plan_legs_median", lengths, "legs"),
        Figure::new("look_up_us_median", look_up, "us").with_reference("petgraph's Dijkstra", by_dijkstra, false),
        Figure::new("search_us_median", our_search, "us").with_reference("petgraph's A*", by_astar, false),
    ]
}

/// Number of zones in queries.
const ZONES: usize = 64;

/// Times plans with many zones, half of them closed to the NPC, and compares them with the same plans without zones.
fn in_zones(router: &Router, queries: &[Query], points: &[Vec3]) -> Vec<Figure> {
    let zone = |(idx, &at): (usize, &Vec3)| {
        let size = 4.0 + (idx % 8) as f32 * 4.0;
        let bottom = at - Vec3::Y * 4.0;
        let shape = if idx % 2 == 0 {
            Shape::Cylinder { bottom, radius: size, height: 12.0 }
        } else {
            Shape::Box(Aabb { low: bottom - Vec3::new(size, 0.0, size), high: bottom + Vec3::new(size, 12.0, size) })
        };
        let rule = match idx % 4 {
            0 | 1 => Rule::Price(0.5 + idx as f32 * 0.1),
            2 => Rule::Never,
            _ => Rule::OnlyWith("key".to_owned()),
        };
        Zone { name: format!("zone {idx}"), shape, rule, concerns: Default::default() }
    };
    let zones = Zones::new(points.iter().enumerate().take(ZONES).map(zone));
    let with_zones: Vec<Query> = queries.iter().map(|query| Query { zones: zones.clone(), ..query.clone() }).collect();
    let first = micros(|| drop(black_box(router.find_path(&with_zones[0]))));
    let searched = median(least_times(router, &with_zones));
    let labels = timed(|| router.prepare_zone_labels(core_count()));
    let (free, zoned) = (median(least_times(router, queries)), median(least_times(router, &with_zones)));
    let plan = |query: &Query| router.find_path(query).waypoints;
    let diverted = queries.iter().zip(&with_zones).filter(|(free, zoned)| plan(free) != plan(zoned)).count();
    vec![
        Figure::new("plan_zones_first_us", first, "us"),
        Figure::new("plan_zones_searched_us_median", searched, "us"),
        Figure::new("plan_zones_labels_s", labels, "s"),
        Figure::new("plan_zones_us_median", zoned, "us"),
        Figure::new("plan_zones_ratio", zoned / free, "times").at_most(1.5),
        Figure::new("plan_zones_diverted", 100.0 * diverted as f64 / queries.len() as f64, "%"),
    ]
}

/// Plans in a world of many tiles, each with the graph and the `points` of a square kilometre.
fn far_away(graph: &NavGraph, points: &[Vec3]) -> anyhow::Result<Vec<Figure>> {
    let graph = tiled(graph, TILE_M, TILES)?;
    let router = Router::new(graph, DEFAULT_LABEL_LIMIT, core_count());
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut draw = || {
        let [x, z] = [(); 2].map(|()| rng.random_range(0..TILES) as f32 * TILE_M);
        points[rng.random_range(0..points.len())] + Vec3::new(x, 0.0, z)
    };
    let queries: Vec<Query> = (0..QUERIES / 2).map(|_| Query::new(draw(), draw())).collect();
    let searched: Vec<f64> = queries[..REFERENCE_QUERIES / 10]
        .iter()
        .map(|query| micros(|| drop(black_box(router.find_path(query)))))
        .collect();
    let prepared = timed(|| router.prepare_labels(core_count()));
    let times = least_times(&router, &queries);
    let legs = median(queries.iter().map(|query| router.find_path(query).legs.len() as f64).collect());
    Ok(vec![
        Figure::new("tiled_vertices", router.graph().vertex_count() as f64, "vertices"),
        Figure::new("tiled_prepare_s", prepared, "s"),
        Figure::new("tiled_labels_mb", router.labels_bytes() as f64 / 1.0e6, "MB").at_most(1000.0),
        Figure::new("tiled_plan_us_median", median(times.clone()), "us").at_most(50.0).with_reference(
            "A* with the same attachments",
            median(searched),
            false,
        ),
        Figure::new("tiled_plan_us_slowest", times.into_iter().fold(0.0, f64::max), "us"),
        Figure::new("tiled_unreachable_us_median", median(least_times(&router, &out_of_reach(&queries))), "us"),
        Figure::new("tiled_legs_median", legs, "legs"),
    ])
}

/// What each plan costs, us: the least of several passes, without what else the machine did meanwhile.
fn least_times(router: &Router, queries: &[Query]) -> Vec<f64> {
    let time = |query: &Query| micros(|| drop(black_box(router.find_path(query))));
    queries.iter().map(|query| (0..PASSES).map(|_| time(query)).fold(f64::MAX, f64::min)).collect()
}

/// Plans per second on all cores.
fn batch(router: &Router, queries: &[Query]) -> Figure {
    let find = |idx: usize| drop(black_box(router.find_path(&queries[idx % queries.len()])));
    let seconds = timed(|| (0..BATCH).into_par_iter().for_each(find));
    Figure::new("plan_batch_s", BATCH as f64 / seconds, "plans/s").at_least(200_000.0)
}

/// Times plans over loopback gRPC; clients and server share the cores.
async fn over_grpc(
    policy: Policy,
    store: DiskStore,
    spec: &MapSpec,
    settings: &BuildSettings,
    queries: &[Query],
) -> anyhow::Result<Vec<Figure>> {
    let endpoint = Endpoint::bind(([127, 0, 0, 1], 0).into())?;
    let uri = format!("http://{}", endpoint.address());
    let shutdown = Shutdown::default();
    let config = PlannerConfig::default();
    let serving = tokio::spawn(service::serve(endpoint, config, policy, Box::new(store), shutdown.clone()));
    let connect = || async {
        let channel = Channel::from_shared(uri.clone())?.tcp_nodelay(true).connect().await?;
        anyhow::Ok(PlannerServiceClient::new(channel).max_decoding_message_size(64 << 20))
    };
    let mut client = connect().await?;
    let request = wire::StartBuildRequest {
        map: Some(convert::map_spec_to_wire(spec)),
        settings: Some(settings_to_wire(settings)),
        ..Default::default()
    };
    let build = client.start_build(request.clone()).await?.into_inner().build.unwrap_or_default();
    let graph_id = await_build(&mut client, build).await?.graph_id;
    let inside = 10.0..TILE_M - 10.0;
    let is_inside = |place: &Vec3| inside.contains(&place.x) && inside.contains(&place.z);
    let places: Vec<Vec3> = queries.iter().map(|query| query.goal).filter(is_inside).collect();
    let edited = edits(&mut client, request, &places).await?;
    let point = |point: Vec3| Some(convert::to_wire(point));
    let wire_queries: Vec<wire::PathQuery> = queries
        .iter()
        .map(|query| wire::PathQuery { start: point(query.start), goal: point(query.goal), ..Default::default() })
        .collect();
    let batch = wire::FindPathsRequest {
        graph_id: graph_id.clone(),
        queries: wire_queries[..WIRE_BATCH].to_vec(),
        traffic: None,
        ..Default::default()
    };
    client.find_paths(batch.clone()).await?;
    let started = Instant::now();
    for _ in 0..5 {
        black_box(client.find_paths(batch.clone()).await?);
    }
    let batch_rate = 5.0 * WIRE_BATCH as f64 / started.elapsed().as_secs_f64();
    let mut clients = Vec::new();
    for _ in 0..CLIENTS {
        clients.push(connect().await?);
    }
    let (mut times, seconds) = query_at_rate(clients, &graph_id, &wire_queries).await?;
    shutdown.trigger();
    serving.await??;
    times.sort_unstable_by(f64::total_cmp);
    let quantile = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    let mut figures = vec![
        Figure::new("plan_rpc_p50_ms", quantile(0.5), "ms"),
        Figure::new("plan_rpc_p99_ms", quantile(0.99), "ms").at_most(1.0),
        Figure::new("plan_rpc_rate", times.len() as f64 / seconds, "requests/s").at_least(f64::from(REQUESTS_PER_S)),
        Figure::new("plan_rpc_batch_s", batch_rate, "plans/s"),
    ];
    figures.extend(edited);
    Ok(figures)
}

/// Sends [`REQUESTS_PER_S`] queries per second from all clients together. Returns the duration of each query, ms, and
/// of the whole run, s.
async fn query_at_rate(
    clients: Vec<PlannerServiceClient<Channel>>,
    graph_id: &str,
    queries: &[wire::PathQuery],
) -> anyhow::Result<(Vec<f64>, f64)> {
    let period = Duration::from_secs(CLIENTS as u64) / REQUESTS_PER_S;
    let begin = tokio::time::Instant::now() + Duration::from_millis(200);
    let mut running = Vec::with_capacity(clients.len());
    for (idx, mut client) in clients.into_iter().enumerate() {
        let (graph_id, queries) = (graph_id.to_owned(), queries.to_vec());
        running.push(tokio::spawn(async move {
            let count = LOAD_S * REQUESTS_PER_S / CLIENTS as u32;
            let mut times = Vec::with_capacity(count as usize);
            for turn in 0..count {
                // The requests of all clients are spread over the period, and each client keeps its own schedule.
                tokio::time::sleep_until(begin + period * turn + period * idx as u32 / CLIENTS as u32).await;
                let query = queries[(turn as usize * CLIENTS + idx) % queries.len()].clone();
                let request =
                    wire::FindPathRequest { graph_id: graph_id.clone(), query: Some(query), ..Default::default() };
                let sent = Instant::now();
                client.find_path(request).await?;
                times.push(sent.elapsed().as_secs_f64() * 1.0e3);
            }
            anyhow::Ok((times, begin.elapsed().as_secs_f64()))
        }));
    }
    let mut times = Vec::new();
    let mut seconds: f64 = 0.0;
    for client in running {
        let (own, ended) = client.await??;
        times.extend(own);
        seconds = seconds.max(ended);
    }
    Ok((times, seconds))
}
