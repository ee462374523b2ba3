//! The world server under load: server, planner and two workers in separate processes, realtime worlds, and a crowd
//! that never stops seeking goals.

use super::{Args, Figure, streams};
use crate::processes::{Process, Services, Setup, await_build, connect, free_address, metric, start};
use anyhow::{Context, bail};
use std::path::Path;
use std::time::{Duration, Instant};
use surefoot_agent::crowd::Crowd;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::convert::map_spec_to_wire;
use surefoot_proto::planner::v1 as planner;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1::env_service_client::EnvServiceClient;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, WatchStatsResponse, WorldStats};
use surefoot_report::plots;
use surefoot_rollout::env::{Env, Episodes, actions_of};
use surefoot_server::times::TickTimes;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::{CharacterProfile, MapSpec};
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;

/// Number of worlds, on maps that belong to no split.
pub(super) const WORLDS: u64 = 8;
const FIRST_SEED: u64 = 6000;
const DEFAULT_NPCS: usize = 1024;
/// Limits within which a number of NPCs counts as sustained: 99th percentile of the tick time in ms, share of late
/// ticks, and share of decisions answered in time.
pub(super) const TARGET_P99_MS: f64 = 12.0;
pub(super) const TARGET_LATE_SHARE: f64 = 0.001;
pub(super) const TARGET_ON_TIME: f64 = 0.999;
/// Numbers of NPCs that are tried in turn until one is not sustained.
const LADDER: [usize; 8] = [256, 512, 1024, 1536, 2048, 2560, 3072, 4096];
/// Measurement of each number of NPCs, after the warm-up.
const RUNG: Duration = Duration::from_secs(20);
const WARM_UP: Duration = Duration::from_secs(10);
/// Number of readers that never read.
const SLOW_READERS: usize = 50;
/// Number of NPCs and of timed steps of the lockstep figures.
const ENV_NPCS: usize = 256;
const ENV_STEPS: usize = 100;

/// All processes of one measurement, and the crowds on its worlds, which end first.
pub(super) struct Scene {
    worlds: Vec<Watched>,
    pub services: Services,
}

struct Watched {
    world_id: u64,
    latest: watch::Receiver<WatchStatsResponse>,
    crowd: tokio::task::JoinHandle<Result<(), tonic::Status>>,
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.crowd.abort();
    }
}

impl Scene {
    /// Starts services with as many NPCs as they allow, and waits until every world has its graph.
    pub async fn start(setup: Setup<'_>) -> anyhow::Result<Self> {
        let (services, npcs) = (Services::start(setup).await?, setup.npcs);
        let mut worlds = Vec::new();
        for idx in 0..WORLDS {
            let share = npcs / WORLDS as usize + usize::from((idx as usize) < npcs % WORLDS as usize);
            let map = Some(map_spec_to_wire(&MapSpec::new(FIRST_SEED + idx)));
            let request = wire::CreateWorldRequest { map, ..Default::default() };
            let crowd =
                Crowd::start(services.server.clone(), request, share, idx).await.context("cannot populate a world")?;
            let world_id = crowd.world().world_id;
            let (sender, latest) = watch::channel(WatchStatsResponse::default());
            worlds.push(Watched { world_id, latest, crowd: tokio::spawn(crowd.keep_busy(sender)) });
        }
        let scene = Self { worlds, services };
        scene.wait_for_plans().await?;
        scene.wait_for_builds().await?;
        Ok(scene)
    }

    /// Waits until NPCs of every world follow plans.
    async fn wait_for_plans(&self) -> anyhow::Result<()> {
        let mut client = WorldServiceClient::new(self.services.server.clone());
        for world in &self.worlds {
            let world_id = world.world_id;
            let snapshots = client.watch_world(wire::WatchWorldRequest { world_id, ..Default::default() });
            let planned = async {
                let mut snapshots = snapshots.await?.into_inner();
                while let Some(snapshot) = snapshots.message().await? {
                    if snapshot.npcs.iter().any(|npc| npc.waypoint.is_some()) {
                        return Ok(());
                    }
                }
                bail!("world {world_id} ended")
            };
            let planned = tokio::time::timeout(Duration::from_secs(300), planned);
            planned.await.with_context(|| format!("no NPC of world {world_id} follows a plan after 300 s"))??;
        }
        Ok(())
    }

    /// Waits until all builds have ended: NPCs follow plans on interim graphs before that.
    async fn wait_for_builds(&self) -> anyhow::Result<()> {
        let mut client = PlannerServiceClient::new(connect(&self.services.planner_uri).await?);
        for build in client.list_builds(planner::ListBuildsRequest::default()).await?.into_inner().builds {
            await_build(&mut client, build).await?;
        }
        Ok(())
    }

    /// CPU time so far of the server, of the workers together, and of the planner, s.
    pub fn cpu_s(&self) -> anyhow::Result<[f64; 3]> {
        let [server, planner, workers @ ..] = &self.services.processes[..] else { bail!("no server and planner") };
        let workers = workers.iter().map(Process::cpu_s).sum::<anyhow::Result<f64>>()?;
        Ok([server.cpu_s()?, workers, planner.cpu_s()?])
    }

    /// Number of plans so far.
    pub async fn plans(&self) -> anyhow::Result<f64> {
        metric(&self.services.planner_uri, "surefoot_plans_total").await
    }

    /// Resident memory of the server process, MiB.
    fn server_mib(&self) -> anyhow::Result<f64> {
        self.services.processes[0].memory_mib()
    }

    fn stats(&self) -> Vec<WorldStats> {
        self.worlds.iter().map(|world| world.latest.borrow().stats.clone().unwrap_or_default()).collect()
    }

    /// Measures all worlds for `span`.
    pub async fn measure(&self, span: Duration) -> anyhow::Result<Measured> {
        let before = self.stats();
        tokio::time::sleep(span).await;
        if let Some(world) = self.worlds.iter().find(|world| world.crowd.is_finished()) {
            bail!("the crowd of world {} stopped", world.world_id);
        }
        Ok(Measured::between(&before, &self.stats()))
    }
}

/// Figures of all worlds over a span of time.
#[derive(Debug, Default, Clone)]
pub(super) struct Measured {
    pub times: Vec<TickTimes>,
    late: u64,
    dropped: u64,
    pub answered: u64,
    missed: u64,
}

impl Measured {
    fn between(before: &[WorldStats], after: &[WorldStats]) -> Self {
        let sum = |value: fn(&WorldStats) -> u64| {
            after.iter().map(value).sum::<u64>().saturating_sub(before.iter().map(value).sum())
        };
        let times = |stats: &WorldStats| TickTimes::from_counts(&stats.tick_histogram);
        Self {
            times: after.iter().zip(before).map(|(after, before)| times(after).since(&times(before))).collect(),
            late: sum(|stats| stats.ticks_late),
            dropped: sum(|stats| stats.ticks_dropped),
            answered: sum(|stats| stats.decisions_answered),
            missed: sum(|stats| stats.decisions_missed),
        }
    }

    pub fn ticks(&self) -> u64 {
        self.times.iter().map(TickTimes::count).sum()
    }

    /// A quantile of the tick time of the worst world, ms.
    fn quantile_ms(&self, share: f64) -> f64 {
        self.times.iter().map(|times| f64::from(times.quantile_us(share))).fold(0.0, f64::max) / 1000.0
    }

    pub fn p99_ms(&self) -> f64 {
        self.quantile_ms(0.99)
    }

    pub fn p50_ms(&self) -> f64 {
        self.quantile_ms(0.5)
    }

    /// Share of ticks that were late, dropped ones included.
    pub fn late_share(&self) -> f64 {
        (self.late + self.dropped) as f64 / (self.ticks() + self.dropped).max(1) as f64
    }

    pub fn on_time_share(&self) -> f64 {
        self.answered as f64 / (self.answered + self.missed).max(1) as f64
    }

    fn is_sustained(&self) -> bool {
        self.ticks() > 0
            && self.answered > 0
            && self.p99_ms() <= TARGET_P99_MS
            && self.late_share() <= TARGET_LATE_SHARE
            && self.on_time_share() >= TARGET_ON_TIME
    }

    fn print(&self, npcs: usize) {
        eprintln!(
            "{npcs:>5} NPCs: tick p50 {:.2} ms, p99 {:.2} ms, {:.3} % of {} late, {} dropped, {:.3} % of {} decisions \
             on time: {}",
            self.p50_ms(),
            self.p99_ms(),
            100.0 * self.late_share(),
            self.ticks(),
            self.dropped,
            100.0 * self.on_time_share(),
            self.answered + self.missed,
            if self.is_sustained() { "sustained" } else { "not sustained" }
        );
    }
}

pub fn figures(args: &Args) -> anyhow::Result<Vec<Figure>> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let cache = surefoot_cli::commands::services::CacheArgs::default_folder()?.join("bench-serve");
    runtime.block_on(async {
        let mut figures = lockstep().await?;
        let npcs = args.npcs.unwrap_or(DEFAULT_NPCS);
        let scene = Scene::start(Setup::new(npcs, &cache)).await?;
        scene.measure(WARM_UP).await?;
        let measured = scene.measure(Duration::from_secs_f64(args.minutes * 60.0)).await?;
        measured.print(npcs);
        figures.extend([
            Figure::new("tick_p50_ms", measured.p50_ms(), "ms"),
            Figure::new("tick_p99_ms", measured.p99_ms(), "ms").at_most(TARGET_P99_MS),
            Figure::new("ticks_late_share", measured.late_share(), "").at_most(TARGET_LATE_SHARE),
            Figure::new("decisions_on_time_share", measured.on_time_share(), "").at_least(TARGET_ON_TIME),
            Figure::new("decisions_s", measured.answered as f64 / (args.minutes * 60.0), "decisions/s"),
        ]);
        let world_id = scene.worlds[0].world_id;
        figures.extend(streams::figures(WorldServiceClient::new(scene.services.server.clone()), world_id).await?);
        figures.extend(slow_readers(&scene).await?);
        drop(scene);
        let curve = ladder(&cache).await?;
        let most = curve.iter().take_while(|(_, measured)| measured.is_sustained()).last().map_or(0, |(npcs, _)| *npcs);
        figures.push(Figure::new("npcs_held", most as f64, "NPCs").at_least(4096.0));
        if let Some(folder) = &args.out {
            let lines = vec![
                ("median", curve.iter().map(|(npcs, measured)| (*npcs as f64, measured.p50_ms())).collect()),
                ("99th percentile", curve.iter().map(|(npcs, measured)| (*npcs as f64, measured.p99_ms())).collect()),
            ];
            std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
            plots::tick_times(lines, TARGET_P99_MS, &folder.join("tick-time.svg"))?;
        }
        Ok(figures)
    })
}

/// The cost in memory and tick time of clients that watch all NPCs and never read.
async fn slow_readers(scene: &Scene) -> anyhow::Result<Vec<Figure>> {
    let span = Duration::from_secs(20);
    let calm = scene.measure(span).await?;
    let before = scene.server_mib()?;
    let mut readers = Vec::new();
    for idx in 0..SLOW_READERS {
        let world_id = scene.worlds[idx % scene.worlds.len()].world_id;
        let mut client = WorldServiceClient::new(connect(&scene.services.server_uri).await?);
        let request = wire::WatchWorldRequest { world_id, rate_hz: 60.0, ..Default::default() };
        readers.push(client.watch_world(request).await?.into_inner());
    }
    let measured = scene.measure(span).await?;
    let cost = scene.server_mib()? - before;
    drop(readers);
    eprintln!(
        "{SLOW_READERS} readers that never read: {cost:.1} MiB, tick p99 x {:.3}",
        measured.p99_ms() / calm.p99_ms()
    );
    Ok(vec![
        Figure::new("slow_readers_mib", cost, "MiB").at_most(64.0),
        Figure::new("slow_readers_p99_ratio", measured.p99_ms() / calm.p99_ms(), ""),
    ])
}

/// Increases the number of NPCs until it is not sustained.
async fn ladder(cache: &Path) -> anyhow::Result<Vec<(usize, Measured)>> {
    let mut curve = Vec::new();
    for npcs in LADDER {
        let scene = Scene::start(Setup::new(npcs, cache)).await?;
        scene.measure(WARM_UP).await?;
        let measured = scene.measure(RUNG).await?;
        measured.print(npcs);
        let is_sustained = measured.is_sustained();
        curve.push((npcs, measured));
        if !is_sustained {
            break;
        }
    }
    Ok(curve)
}

/// Decisions per second of a remote trainer by call and by stream, compared with the same environment in process.
async fn lockstep() -> anyhow::Result<Vec<Figure>> {
    let address = free_address()?.to_string();
    let _server = start(&["serve", "--listen", &address])?;
    let mut client = EnvServiceClient::new(connect(&format!("http://{address}")).await?)
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let spec = MapSpec::new(FIRST_SEED);
    let request = wire::CreateEnvRequest {
        map: Some(map_spec_to_wire(&spec)),
        npc_count: ENV_NPCS as u32,
        goal_max_m: 40.0,
        ..Default::default()
    };
    let env_id = client.create_env(request).await?.into_inner().env_id;
    // Actions that change from step to step.
    let values = |step: usize| (0..ENV_NPCS * ACTION_LEN).map(move |idx| ((idx * 7 + step * 13) as f32 * 0.37).sin());
    let actions = |step: usize| {
        Some(wire::EnvActions { actions: surefoot_proto::convert::pack(values(step)), ..Default::default() })
    };
    let rate = |started: Instant| (ENV_NPCS * ENV_STEPS) as f64 / started.elapsed().as_secs_f64();

    let episodes = Episodes::Endless { npc_count: ENV_NPCS, band: (0.0, 40.0), seed: 0 };
    let mut env = Env::new(surefoot_generate::generate(&spec).into(), CharacterProfile::default(), false, episodes)?;
    let started = Instant::now();
    for step in 0..ENV_STEPS {
        let actions = actions_of(&values(step).collect::<Vec<f32>>(), |idx| idx as u64).map_err(anyhow::Error::msg)?;
        std::hint::black_box(env.step(&actions));
    }
    let in_process = rate(started);

    let started = Instant::now();
    for step in 0..ENV_STEPS {
        client.step_env(wire::StepEnvRequest { env_id, actions: actions(step) }).await?;
    }
    let by_call = rate(started);

    let (requests, stream) = mpsc::channel(1);
    let mut results = client.stream_env(ReceiverStream::new(stream)).await?.into_inner();
    let started = Instant::now();
    for step in 0..ENV_STEPS {
        requests.send(wire::StreamEnvRequest { env_id, actions: actions(step) }).await?;
        results.message().await?.context("the server ended the stream")?;
    }
    let by_stream = rate(started);
    let compared = |figure: Figure| figure.with_reference("in process", in_process, true);
    Ok(vec![
        compared(Figure::new("lockstep_decisions_s", by_stream, "decisions/s").at_least(0.5 * in_process)),
        compared(Figure::new("lockstep_unary_decisions_s", by_call, "decisions/s")),
    ])
}
