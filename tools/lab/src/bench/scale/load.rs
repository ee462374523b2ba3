//! The recorded load: the CPU time and traffic of server, workers and planner under a crowd, each in its own process on
//! this machine.

use super::record_load::RecordLoad;
use crate::bench::link::Link;
use crate::bench::serve::{Scene, WORLDS};
use crate::processes::Setup;
use serde::{Deserialize, Serialize};
use std::time::Duration;
use surefoot_cli::commands::{machine, services::CacheArgs};

/// Recorded numbers of NPCs, all small enough that no process waits long for a core.
const NPCS: [usize; 4] = [256, 512, 768, 1024];
const WARM_UP: Duration = Duration::from_secs(10);
const SPAN: Duration = Duration::from_secs(30);
/// Number of recorded quantiles of the tick time, from 0 to 1.
const STEPS: usize = 200;

/// A recorded load.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Load {
    /// Processors of the machine.
    pub machine: String,
    /// Number of cores.
    pub cores: usize,
    /// One entry for each number of NPCs.
    pub rungs: Vec<Rung>,
    /// The load on the database and the object store, if it was measured.
    #[serde(default)]
    pub record: RecordLoad,
}

/// The load of a crowd over a span of time.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Rung {
    /// Number of NPCs, on `worlds` worlds.
    pub npcs: usize,
    /// Number of worlds.
    pub worlds: usize,
    /// Length of the span, s.
    pub seconds: f64,
    /// CPU time of the server, of the workers together, and of the planner, s.
    pub cpu_s: [f64; 3],
    /// Decisions in the span.
    pub decisions: u64,
    /// Plans in the span.
    pub plans: f64,
    /// Bytes from the workers to the server and back, and from the workers to the planner and back.
    pub bytes: [[u64; 2]; 2],
    /// Quantiles of the tick time of all worlds, us: those that a share of 1 / 200, 2 / 200, … of ticks stays below.
    pub tick_quantiles_us: Vec<f32>,
    /// Median and 99th percentile of the worst world, ms, and the share of late ticks, for comparison.
    pub tick_p50_ms: f64,
    pub tick_p99_ms: f64,
    pub late_share: f64,
}

impl Rung {
    /// Share of `cores` that all parts took, 0 to 1.
    pub fn busy_share(&self, cores: usize) -> f64 {
        self.cpu_s.iter().sum::<f64>() / self.seconds / cores as f64
    }
}

impl Load {
    /// Records the load of crowds on this machine, which should be idle otherwise. The load on a database and an object
    /// store is recorded if they are given.
    pub fn record(fleet: Option<[&str; 2]>) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        let of_fleet = match fleet {
            #[cfg(feature = "fleet")]
            Some([store, blobs]) => runtime.block_on(super::record::measure(store, blobs))?,
            #[cfg(not(feature = "fleet"))]
            Some(_) => anyhow::bail!("--store needs a program that was built with --features fleet"),
            None => RecordLoad::default(),
        };
        // The fleet comes first, so that an unusable database is refused before minutes of measuring.
        let rungs = NPCS.iter().map(|npcs| runtime.block_on(record(*npcs))).collect::<anyhow::Result<_>>()?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self { machine: machine(), cores, rungs, record: of_fleet })
    }
}

async fn record(npcs: usize) -> anyhow::Result<Rung> {
    let cache = CacheArgs::default_folder()?.join("bench-serve");
    // Links without delay: they only count bytes.
    let [to_server, to_planner] = [(); 2].map(|()| Link::new(Duration::ZERO, f64::INFINITY));
    let scene = Scene::start(Setup { links: Some([&to_server, &to_planner]), ..Setup::new(npcs, &cache) }).await?;
    scene.measure(WARM_UP).await?;
    let bytes = || [to_server.carried(), to_planner.carried()];
    let (cpu_before, bytes_before, plans_before) = (scene.cpu_s()?, bytes(), scene.plans().await?);
    let started = std::time::Instant::now();
    let measured = scene.measure(SPAN).await?;
    let seconds = started.elapsed().as_secs_f64();
    let (cpu, bytes, plans) = (scene.cpu_s()?, bytes(), scene.plans().await?);
    let counts = measured.times.iter().fold(Vec::new(), |mut sum: Vec<u64>, times| {
        sum.resize(times.counts().len(), 0);
        sum.iter_mut().zip(times.counts()).for_each(|(sum, count)| *sum += count);
        sum
    });
    let all = surefoot_server::times::TickTimes::from_counts(&counts);
    let rung = Rung {
        npcs,
        worlds: WORLDS as usize,
        seconds,
        cpu_s: [0, 1, 2].map(|part| cpu[part] - cpu_before[part]),
        decisions: measured.answered,
        plans: plans - plans_before,
        bytes: [0, 1].map(|link| [0, 1].map(|way| bytes[link][way] - bytes_before[link][way])),
        tick_quantiles_us: (1..=STEPS).map(|step| all.quantile_us(step as f64 / STEPS as f64)).collect(),
        tick_p50_ms: measured.p50_ms(),
        tick_p99_ms: measured.p99_ms(),
        late_share: measured.late_share(),
    };
    eprintln!(
        "{npcs:>5} NPCs: CPU of server {:.1} %, workers {:.1} %, planner {:.1} % of a core; {:.0} decisions/s, {:.1} \
         plans/s",
        100.0 * rung.cpu_s[0] / seconds,
        100.0 * rung.cpu_s[1] / seconds,
        100.0 * rung.cpu_s[2] / seconds,
        rung.decisions as f64 / seconds,
        rung.plans / seconds,
    );
    Ok(rung)
}
