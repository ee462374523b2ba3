//! Probes over the queue: how many a second 1 to 4 provers run, compared with this process by itself, and what they weigh.

use super::Figure;

/// Needs what a fleet is built with.
#[cfg(not(feature = "fleet"))]
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    anyhow::bail!("bench queue needs a program that was built with --features fleet")
}

#[cfg(feature = "fleet")]
pub use measured::figures;

#[cfg(feature = "fleet")]
mod measured {
    use super::Figure;
    use crate::commands::core_count;
    use crate::commands::fleet::Shared;
    use crate::commands::processes::{self, Process, free_address};
    use anyhow::{Context, ensure};
    use std::cell::Cell;
    use std::process::{Child, Command, Stdio};
    use std::sync::Arc;
    use std::time::Instant;
    use surefoot_fleet::work::ground::MapRef;
    use surefoot_fleet::work::probes::{QueuedProbes, result_bytes};
    use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
    use surefoot_planner::{BuildSettings, Built, Probing, Progress, RawBuildSettings};
    use surefoot_policy::Policy;
    use surefoot_rollout::graphs::build_by;
    use surefoot_rollout::probe::{InProcess, ProbeContext};
    use surefoot_world::{Map, MapSpec};

    /// Side of the map, m.
    const SIDE_M: u32 = 100;
    /// Most provers.
    const MAX_PROVERS: usize = 4;
    /// Names of the figures of 1, 2 and more provers.
    const NAMES: [&str; MAX_PROVERS] =
        ["probes_per_s_1_prover", "probes_per_s_2_provers", "probes_per_s_3_provers", "probes_per_s_4_provers"];

    /// A NATS server, killed on drop.
    struct Nats(Child);

    impl Drop for Nats {
        fn drop(&mut self) {
            // It may have ended already.
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// Runs probes of another executor, and adds up what they would weigh as messages.
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

    /// All probes of all candidates: pauses between rounds are not the queue's.
    fn settings(seed: u64) -> anyhow::Result<BuildSettings> {
        let raw = RawBuildSettings { vertices: 500, repeats: 3, seed, probing: Probing::Exhaustive, ..Default::default() };
        Ok(raw.try_into()?)
    }

    /// Builds a graph, and returns it with its probes per second.
    fn probe(executor: &dyn ProbeExecutor, context: &ProbeContext, seed: u64) -> anyhow::Result<(Built, f64)> {
        let started = Instant::now();
        let built = build_by(executor, context, &settings(seed)?, core_count(), &Progress::default())?;
        let rate = built.stats.probes as f64 / started.elapsed().as_secs_f64();
        Ok((built, rate))
    }

    pub fn figures() -> anyhow::Result<Vec<Figure>> {
        let folder = tempfile::tempdir()?;
        let address = free_address()?;
        let mut command = Command::new("nats-server");
        command.args(["--addr", "127.0.0.1", "--port", &address.port().to_string(), "--jetstream", "--store_dir"]);
        command.arg(folder.path()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let _nats = Nats(command.spawn().context("nats-server cannot be started: is it installed?")?);
        let url = format!("nats://{address}");
        let policy = Policy::shipped()?;
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        let shared = runtime.block_on(Shared::open(&url, None, &policy))?;
        let spec = MapSpec::with_side(7, SIDE_M)?;
        let context = ProbeContext::new(Arc::new(Map::generate(&spec)), policy);
        let queue = shared.provers(0);
        // One thread stands by, for a queue that fails; while provers answer, it does nothing.
        let queued = queue.probes(context.clone(), MapRef::Spec(spec), 1);

        let alone = |thread_count| InProcess { context: context.clone(), thread_count };
        let (job_bytes, result_bytes) = (Cell::new(0), Cell::new(0));
        let weighing = Weighing { inner: alone(1), queued: &queued, job_bytes, result_bytes };
        let (expected, _) = probe(&weighing, &context, 0)?;
        let (_, one) = probe(&alone(1), &context, 0)?;
        let (_, all) = probe(&alone(core_count()), &context, 0)?;
        let mut figures = vec![
            Figure::new("probes_per_s_one_thread", one, "1/s"),
            Figure::new("probes_per_s_all_threads", all, "1/s"),
        ];
        let mut provers: Vec<Process> = Vec::new();
        for (idx, name) in NAMES.into_iter().enumerate() {
            let listen = free_address()?.to_string();
            provers.push(processes::start(&["prove", "--nats", &url, "--threads", "1", "--listen", &listen])?);
            // Until they are there and have made the map.
            for seed in 1..=2 {
                probe(&queued, &context, 100 * idx as u64 + seed)?;
            }
            // Results are kept for a while: what is measured must not be among them.
            let seed = 1000 + idx as u64;
            let (built, rate) = probe(&queued, &context, seed)?;
            let (again, _) = probe(&alone(core_count()), &context, seed)?;
            ensure!(built.graph.to_data() == again.graph.to_data(), "provers built another graph");
            figures.push(Figure::new(name, rate, "1/s").with_reference("one thread in process", one, true));
        }
        let probes = expected.stats.probes as f64;
        figures.push(Figure::new("job_bytes_per_probe", weighing.job_bytes.get() as f64 / probes, "B"));
        figures.push(Figure::new("result_bytes_per_probe", weighing.result_bytes.get() as f64 / probes, "B"));
        Ok(figures)
    }
}
