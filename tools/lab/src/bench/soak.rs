//! All services under a mixed load for a long time. Leaks, slowdowns and crashes show in memory, descriptors, threads
//! and tick times.
//!
//! Beside the crowds of `serve`, clients come and go: worlds, imports, builds, edits, watchers and remote environments.

use super::serve::Scene;
use super::{Args, Figure, line_through};
use crate::processes::{Process, Setup, await_build, connect, metric};
use anyhow::Context;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use surefoot_proto::convert::map_spec_to_wire;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_world::MapSpec;
use surefoot_world::character::ACTION_LEN;
use tokio::task::JoinSet;
use tonic::Status;
use tonic::transport::Channel;

const DEFAULT_NPCS: usize = 256;
/// Number of samples over the whole measurement.
const SAMPLES: u32 = 36;
/// Share of the samples that count as warm-up: caches fill, pools grow.
const WARM_UP_SHARE: f64 = 1.0 / 6.0;
/// Seeds of the clients' maps, which belong to no split.
const FIRST_SEED: u64 = 7000;
/// Side of these maps, m.
const SIDE_M: u32 = 60;
/// Pause between two rounds of a client.
const PAUSE: Duration = Duration::from_millis(500);
/// Targets: growth of memory, MiB per minute, and of the 99th percentile of tick times over the first samples.
const MAX_SLOPE_MIB: f64 = 1.0;
const MAX_P99_RATIO: f64 = 1.2;
/// Event logs and caches still fill in runs shorter than this, min. Only much faster growth counts there, MiB per
/// minute.
const LONG_MIN: f64 = 30.0;
const MAX_SHORT_SLOPE_MIB: f64 = 20.0;
/// Least tolerated growth of a service's descriptors and threads, from the first third of the samples to the last.
const MAX_GROWTH: f64 = 16.0;

/// What the system reports about a process.
#[derive(Debug, Clone, Copy, Default)]
struct Usage {
    memory_mib: f64,
    descriptors: f64,
    threads: f64,
}

impl Usage {
    fn of(process: &Process) -> anyhow::Result<Self> {
        let pid = process.id().to_string();
        Ok(Self {
            memory_mib: process.memory_mib()?,
            descriptors: std::fs::read_dir(format!("/proc/{pid}/fd"))?.count() as f64,
            threads: super::process_status(&pid, "Threads").context("the system does not report threads")?,
        })
    }
}

/// What happened over one sample.
struct Sample {
    minutes: f64,
    /// Of server, planner and workers.
    usage: Vec<Usage>,
    p99_ms: f64,
}

pub fn figures(args: &Args) -> anyhow::Result<Vec<Figure>> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let cache = surefoot_cli::commands::services::CacheArgs::default_folder()?.join("bench-soak");
    let figures = runtime.block_on(soak(args, &cache));
    runtime.shutdown_timeout(Duration::from_secs(1));
    figures
}

async fn soak(args: &Args, cache: &Path) -> anyhow::Result<Vec<Figure>> {
    let mut scene = Scene::start(Setup::new(args.npcs.unwrap_or(DEFAULT_NPCS), cache)).await?;
    let done = Arc::new(AtomicU64::new(0));
    let mut clients = JoinSet::new();
    let of_server = [Client::Worlds, Client::Environments, Client::Levels, Client::Watchers];
    let of_planner = [Client::Levels, Client::Graphs];
    for (uri, kinds) in [(&scene.services.server_uri, &of_server[..]), (&scene.services.planner_uri, &of_planner[..])] {
        for kind in kinds {
            clients.spawn(repeat(*kind, connect(uri).await?, done.clone()));
        }
    }
    let span = Duration::from_secs_f64(args.minutes * 60.0 / f64::from(SAMPLES));
    let (started, mut samples) = (Instant::now(), Vec::new());
    for _ in 0..SAMPLES {
        let measured = scene.measure(span).await?;
        while let Some(ended) = clients.try_join_next() {
            ended.context("a client panicked")??;
        }
        for (idx, process) in scene.services.processes.iter_mut().enumerate() {
            anyhow::ensure!(process.is_running(), "process {idx} (server, planner, workers) has ended");
        }
        let usage: Vec<Usage> = scene.services.processes.iter().map(Usage::of).collect::<anyhow::Result<_>>()?;
        let sample = Sample { minutes: started.elapsed().as_secs_f64() / 60.0, usage, p99_ms: measured.p99_ms() };
        let memory: Vec<String> = sample.usage.iter().map(|usage| format!("{:.0}", usage.memory_mib)).collect();
        eprintln!(
            "{:>6.1} min  memory {} MiB  tick p99 {:.2} ms  {} rounds",
            sample.minutes,
            memory.join(" "),
            sample.p99_ms,
            done.load(Ordering::Relaxed)
        );
        samples.push(sample);
    }
    let panics = metric(&scene.services.server_uri, "surefoot_worlds_failed_total").await?;
    clients.shutdown().await;
    Ok(summary(&samples, panics, done.load(Ordering::Relaxed)))
}

fn summary(samples: &[Sample], panics: f64, rounds: u64) -> Vec<Figure> {
    let warm = (samples.len() as f64 * WARM_UP_SHARE).ceil() as usize;
    let (first, rest) = samples.split_at(warm);
    let slope = |idx: usize| {
        let points = rest.iter().map(|sample| [sample.minutes, sample.usage[idx].memory_mib]);
        line_through(&points.collect::<Vec<_>>())[1]
    };
    let third = rest.len() / 3;
    let growth = |value: fn(&Usage) -> f64| {
        // Pools grow and shrink with the load. Leaked memory is never returned, so it raises the minimum.
        let least = |samples: &[Sample], idx: usize| {
            samples.iter().map(|sample| value(&sample.usage[idx])).fold(f64::INFINITY, f64::min)
        };
        let of = |idx| least(&rest[rest.len() - third..], idx) - least(&rest[..third], idx);
        (0..rest[0].usage.len()).map(of).fold(f64::NEG_INFINITY, f64::max)
    };
    let p99 = |samples: &[Sample]| super::median(samples.iter().map(|sample| sample.p99_ms).collect());
    let minutes = samples[samples.len() - 1].minutes;
    let is_long = minutes >= LONG_MIN * 0.99;
    let max_slope = if is_long { MAX_SLOPE_MIB } else { MAX_SHORT_SLOPE_MIB };
    let p99_ratio = Figure::new("tick_p99_ratio", p99(rest) / p99(first), "");
    let worker_slope = (2..rest[0].usage.len()).map(slope).fold(f64::NEG_INFINITY, f64::max);
    vec![
        Figure::new("soak_minutes", minutes, "min"),
        Figure::new("client_rounds", rounds as f64, "rounds"),
        Figure::new("server_mib_per_min", slope(0), "MiB/min").at_most(max_slope),
        Figure::new("planner_mib_per_min", slope(1), "MiB/min").at_most(max_slope),
        Figure::new("worker_mib_per_min", worker_slope, "MiB/min").at_most(max_slope),
        Figure::new("descriptors_growth", growth(|usage| usage.descriptors), "").at_most(MAX_GROWTH),
        Figure::new("threads_growth", growth(|usage| usage.threads), "").at_most(MAX_GROWTH),
        Figure::new("worlds_panicked", panics, "").at_most(0.0),
        if is_long { p99_ratio.at_most(MAX_P99_RATIO) } else { p99_ratio },
    ]
}

/// What a client does, round after round.
#[derive(Debug, Clone, Copy)]
enum Client {
    /// Creates a world with NPCs that seek goals, and drops it.
    Worlds,
    /// Creates a remote environment, steps it, and closes it.
    Environments,
    /// Imports a level, in parts, and downloads it.
    Levels,
    /// Watches worlds, and disconnects without closing its streams.
    Watchers,
    /// Builds graphs, cancels some, queries and edits them.
    Graphs,
}

async fn repeat(client: Client, channel: Channel, done: Arc<AtomicU64>) -> anyhow::Result<()> {
    for idx in 0.. {
        let result = match client {
            Client::Worlds => worlds(&channel, idx).await,
            Client::Environments => environments(&channel, idx).await,
            Client::Levels => levels(&channel, idx).await,
            Client::Watchers => watchers(&channel).await,
            Client::Graphs => graphs(&channel, idx).await,
        };
        match result {
            Ok(()) => _ = done.fetch_add(1, Ordering::Relaxed),
            // A busy service is part of the test; anything else is a failure.
            Err(status) if is_expected(&status) => {}
            Err(status) => return Err(anyhow::Error::from(status).context(format!("{client:?}"))),
        }
        tokio::time::sleep(PAUSE).await;
    }
    Ok(())
}

fn is_expected(status: &Status) -> bool {
    let expected = [Reason::Busy, Reason::TooManyBuilds, Reason::OutOfMemory, Reason::DeadlineExceeded];
    Reason::of(status).is_some_and(|reason| expected.contains(&reason))
}

fn map(idx: u64) -> MapSpec {
    MapSpec::with_side(FIRST_SEED + idx % 50, SIDE_M).expect("a valid side")
}

async fn worlds(channel: &Channel, idx: u64) -> Result<(), Status> {
    let mut client = WorldServiceClient::new(channel.clone());
    let request = wire::CreateWorldRequest { map: Some(map_spec_to_wire(&map(idx))), ..Default::default() };
    let world = client.create_world(request).await?.into_inner().world.unwrap_or_default();
    let world_id = world.world_id;
    let request = wire::SampleGroundRequest { world_id, count: 16, seed: idx, body: None, ..Default::default() };
    let points = client.sample_ground(request).await?.into_inner().points;
    let spawn =
        |pair: &[wire::Vec3]| wire::Spawn { position: Some(pair[0]), goal: Some(pair[1]), ..Default::default() };
    let spawns = points.chunks_exact(2).map(spawn).collect();
    client.batch_spawn_npcs(wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() }).await?;
    tokio::time::sleep(Duration::from_secs(2)).await;
    client.drop_world(wire::DropWorldRequest { world_id }).await.map(drop)
}

async fn environments(channel: &Channel, idx: u64) -> Result<(), Status> {
    const NPCS: u32 = 8;
    let mut client = EnvServiceClient::new(channel.clone());
    let map = Some(map_spec_to_wire(&map(idx + 10)));
    let request = wire::CreateEnvRequest { map, npc_count: NPCS, ..Default::default() };
    let env_id = client.create_env(request).await?.into_inner().env_id;
    let actions = surefoot_proto::convert::pack(vec![0.5; NPCS as usize * ACTION_LEN]);
    for _ in 0..50 {
        let actions = Some(wire::EnvActions { actions: actions.clone(), ..Default::default() });
        client.step_env(wire::StepEnvRequest { env_id, actions }).await?;
    }
    client.close_env(wire::CloseEnvRequest { env_id }).await.map(drop)
}

async fn levels(channel: &Channel, idx: u64) -> Result<(), Status> {
    const PART: usize = 200_000;
    let mut client = MapServiceClient::new(channel.clone());
    let map =
        tokio::task::spawn_blocking(move || surefoot_levels::encode(&surefoot_generate::generate(&map(idx + 20))));
    let file = map.await.map_err(|error| Status::internal(error.to_string()))?;
    let upload_id = format!("soak-{idx}");
    for (part_idx, part) in file.chunks(PART).enumerate() {
        let offset = (part_idx * PART) as u64;
        let request = wire::UploadChunkRequest { upload_id: upload_id.clone(), offset, data: part.to_vec() };
        client.upload_chunk(request).await?;
    }
    let request = wire::ImportMapRequest {
        name: format!("soak {}", idx % 50),
        format: wire::MapFormat::Saved.into(),
        upload_id,
        ..Default::default()
    };
    let kept = client.import_map(request).await?.into_inner().map.unwrap_or_default();
    let mut chunks = client.get_map(wire::GetMapRequest { map_hash: kept.map_hash }).await?.into_inner();
    while chunks.message().await?.is_some() {}
    Ok(())
}

async fn watchers(channel: &Channel) -> Result<(), Status> {
    let mut client = WorldServiceClient::new(channel.clone());
    let worlds = client.list_worlds(wire::ListWorldsRequest::default()).await?.into_inner().worlds;
    for wire::World { world_id, .. } in worlds {
        let watch = client.watch_world(wire::WatchWorldRequest { world_id, rate_hz: 30.0, ..Default::default() }).await;
        // The world may have been dropped since.
        let Ok(snapshots) = watch else { continue };
        let mut snapshots = snapshots.into_inner();
        for _ in 0..10 {
            if snapshots.message().await.is_err() {
                break;
            }
        }
        let events = client.watch_events(wire::WatchEventsRequest { world_id, ..Default::default() }).await;
        if let Ok(events) = events {
            // The first message marks the start of the stream; then the watcher disconnects.
            let _ = events.into_inner().message().await;
        }
    }
    Ok(())
}

async fn graphs(channel: &Channel, idx: u64) -> Result<(), Status> {
    let mut client = PlannerServiceClient::new(channel.clone());
    let settings =
        plan::BuildSettings { vertices: 40, neighbours: 6, repeats: 1, threshold: 0.5, ..Default::default() };
    let map = Some(map_spec_to_wire(&map(idx + 30)));
    let request = plan::StartBuildRequest { map, settings: Some(settings), ..Default::default() };
    let build = client.start_build(request).await?.into_inner().build.unwrap_or_default();
    if idx % 4 == 3 {
        client.cancel_build(plan::CancelBuildRequest { build_id: build.build_id.clone() }).await?;
    }
    let graph_id = await_build(&mut client, build).await?.graph_id;
    if graph_id.is_empty() {
        return Ok(());
    }
    let graph = client
        .get_graph(plan::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() })
        .await?
        .into_inner();
    let Some(edge) = graph.edges.first() else { return Ok(()) };
    let (from, to) = (graph.vertices[edge.from as usize], graph.vertices[edge.to as usize]);
    let query = Some(plan::PathQuery { start: Some(from), goal: Some(to), ..Default::default() });
    client.find_path(plan::FindPathRequest { graph_id: graph_id.clone(), query, ..Default::default() }).await?;
    let forbid = plan::edit::Edit::ForbidEdge(plan::EdgeEdit { from: Some(from), to: Some(to) });
    let edits = vec![plan::Edit { edit: Some(forbid) }];
    let layer = Some(plan::Layer { name: "soak".to_owned(), edits });
    client.put_layer(plan::PutLayerRequest { graph_id: graph_id.clone(), layer, ..Default::default() }).await?;
    let empty = Some(plan::Layer { name: "soak".to_owned(), ..Default::default() });
    client.put_layer(plan::PutLayerRequest { graph_id, layer: empty, ..Default::default() }).await.map(drop)
}
