//! Probes over the queue: the rate of 1 to 4 provers, compared with this process alone, and the size of their messages.

use super::Figure;

/// Refuses: this build has no fleet.
#[cfg(not(feature = "fleet"))]
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    anyhow::bail!("bench queue needs a program that was built with --features fleet")
}

#[cfg(feature = "fleet")]
pub use measured::figures;

#[cfg(feature = "fleet")]
mod measured {
    use super::super::median;
    use super::Figure;
    use crate::processes::{self, Process, cpu_s, free_address};
    use anyhow::{Context, ensure};
    use std::cell::Cell;
    use std::process::{Command, Stdio};
    use std::sync::Arc;
    use std::time::Instant;
    use surefoot_cli::commands::core_count;
    use surefoot_cli::commands::fleet::Shared;
    use surefoot_fleet::work::map_cache::MapRef;
    use surefoot_fleet::work::probes::{QueuedProbes, result_bytes};
    use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
    use surefoot_planner::{BuildSettings, Built, Probing, Progress, RawBuildSettings};
    use surefoot_policy::Policy;
    use surefoot_rollout::graphs::build_by;
    use surefoot_rollout::probe::{InProcess, ProbeContext};
    use surefoot_world::MapSpec;

    /// Side of the map, m.
    const SIDE_M: u32 = 100;
    /// Largest number of provers.
    const MAX_PROVERS: u64 = 4;
    /// Pairs of builds, one in this process and one by provers. The median counts, because other work slows both
    /// builds.
    const PAIRS: u64 = 3;

    /// Runs probes with another executor, and adds up the sizes of their messages.
    struct Weighing<'a> {
        inner: InProcess,
        queued: &'a QueuedProbes,
        job_bytes: Cell<usize>,
        result_bytes: Cell<usize>,
    }

    impl ProbeExecutor for Weighing<'_> {
        fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
            let outcomes = self.inner.run(trials, seed, watch)?;
            self.job_bytes.set(self.job_bytes.get() + self.queued.job_bytes(trials, seed));
            self.result_bytes.set(self.result_bytes.get() + result_bytes(&outcomes));
            Some(outcomes)
        }
    }

    /// Probes all candidates exhaustively, so that no pauses between rounds are measured.
    fn settings(seed: u64) -> anyhow::Result<BuildSettings> {
        let raw =
            RawBuildSettings { vertices: 300, repeats: 3, seed, probing: Probing::Exhaustive, ..Default::default() };
        Ok(raw.try_into()?)
    }

    /// The cost of a build.
    struct Measured {
        built: Built,
        probes_per_s: f64,
        /// CPU time of this process and of all provers for a probe, us.
        cpu_us: f64,
    }

    /// Builds a graph, and measures the cost.
    fn probe(
        executor: &dyn ProbeExecutor,
        context: &ProbeContext,
        provers: &[Process],
        seed: u64,
    ) -> anyhow::Result<Measured> {
        let cpu = || -> anyhow::Result<f64> {
            let there: anyhow::Result<Vec<f64>> = provers.iter().map(Process::cpu_s).collect();
            Ok(cpu_s("self")? + there?.iter().sum::<f64>())
        };
        let (started, before) = (Instant::now(), cpu()?);
        let built = build_by(executor, context, &settings(seed)?, 1, &Progress::default())?;
        let (seconds, probes) = (started.elapsed().as_secs_f64(), built.stats.probes as f64);
        Ok(Measured { built, probes_per_s: probes / seconds, cpu_us: 1.0e6 * (cpu()? - before) / probes })
    }

    pub fn figures() -> anyhow::Result<Vec<Figure>> {
        let folder = tempfile::tempdir()?;
        let address = free_address()?;
        let mut command = Command::new("nats-server");
        command.args(["--addr", "127.0.0.1", "--port", &address.port().to_string(), "--jetstream", "--store_dir"]);
        let _nats = Process::spawn(command.arg(folder.path()), Stdio::null())
            .context("cannot start nats-server: is it installed?")?;
        let url = format!("nats://{address}");
        let policy = Policy::shipped()?;
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        let shared = runtime.block_on(Shared::open(&url, None, &policy))?;
        let spec = MapSpec::with_side(7, SIDE_M)?;
        let context = ProbeContext::new(Arc::new(surefoot_generate::generate(&spec)), policy);
        let queue = shared.provers(0);
        // One thread takes over if the queue fails; it is idle while provers answer.
        let queued = queue.probes(context.clone(), MapRef::Spec(spec), 1);

        let alone = |thread_count| InProcess { context: context.clone(), thread_count };
        let (job_bytes, result_bytes) = (Cell::new(0), Cell::new(0));
        let weighing = Weighing { inner: alone(1), queued: &queued, job_bytes, result_bytes };
        let weighed = probe(&weighing, &context, &[], 0)?;
        let all = probe(&alone(core_count()), &context, &[], 0)?;
        let mut figures = vec![Figure::new("probes_per_s_all_threads", all.probes_per_s, "1/s")];
        let mut provers: Vec<Process> = Vec::new();
        let mut cpu_here = Vec::new();
        for idx in 0..MAX_PROVERS {
            let listen = free_address()?.to_string();
            provers.push(processes::start(&["prove", "--nats", &url, "--threads", "1", "--listen", &listen])?);
            // Waits until the provers have generated the map.
            probe(&queued, &context, &[], 100 + idx)?;
            let (mut here, mut there, mut ratios, mut cpu) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            for pair in 0..PAIRS {
                // The queue keeps results for a while, so each measurement needs a new seed.
                let seed = 1000 + PAIRS * idx + pair;
                let one = probe(&alone(1), &context, &[], seed)?;
                let shared = probe(&queued, &context, &provers, seed)?;
                ensure!(one.built.graph.to_data() == shared.built.graph.to_data(), "provers built another graph");
                ratios.push(shared.probes_per_s / one.probes_per_s);
                there.push(shared.probes_per_s);
                here.push(one.probes_per_s);
                cpu.push(shared.cpu_us);
                cpu_here.push(one.cpu_us);
            }
            let (here, ratio) = (median(here), median(ratios));
            let count = if idx == 0 { "1_prover".to_owned() } else { format!("{}_provers", idx + 1) };
            let figure = Figure::new(format!("probes_per_s_{count}"), median(there), "1/s").with_reference(
                "one thread in process",
                here,
                true,
            );
            figures.push(Figure { ratio: Some(ratio), ..figure });
            figures.push(Figure::new(format!("cpu_us_per_probe_{count}"), median(cpu), "us"));
        }
        figures.push(Figure::new("cpu_us_per_probe_in_process", median(cpu_here), "us"));
        let probes = weighed.built.stats.probes as f64;
        figures.push(Figure::new("job_bytes_per_probe", weighing.job_bytes.get() as f64 / probes, "B"));
        figures.push(Figure::new("result_bytes_per_probe", weighing.result_bytes.get() as f64 / probes, "B"));
        Ok(figures)
    }
}
