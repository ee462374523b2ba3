//! `surefoot prove`: runs jobs that planners, evaluations and map generation send over NATS.

use super::{BlobsArg, NatsArg};
use crate::commands::endpoint::EndpointArgs;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Run a prover until Ctrl-C or SIGTERM: it probes edges, evaluates, and generates maps for jobs that arrive over NATS.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot prove --nats nats://127.0.0.1:4222\n  \
        surefoot prove --nats nats://nats:4222 --blobs s3://surefoot/blobs --threads 4\n  \
        surefoot prove --print-lane")]
pub struct Args {
    /// Address for health checks and GET /metrics
    #[arg(long, default_value = "127.0.0.1:7603", env = "SUREFOOT_LISTEN")]
    listen: SocketAddr,
    #[command(flatten)]
    nats: NatsArg,
    #[command(flatten)]
    blobs: BlobsArg,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Jobs at a time, each on a thread; default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print the lane and exit. The consumer prove-LANE has the jobs for provers with this model, on processors that
    /// compute the same bits
    #[arg(long)]
    print_lane: bool,
    #[command(flatten)]
    endpoint: EndpointArgs,
}

/// Refuses: this build has no fleet.
#[cfg(not(feature = "fleet"))]
pub fn run(args: &Args) -> anyhow::Result<()> {
    let _ =
        (&args.listen, &args.nats.nats, &args.blobs.blobs, &args.model, args.threads, args.print_lane, &args.endpoint);
    anyhow::bail!("surefoot prove needs a program that was built with --features fleet")
}

/// Runs a prover until a signal stops it.
#[cfg(feature = "fleet")]
pub fn run(args: &Args) -> anyhow::Result<()> {
    use super::{Shared, units};
    use crate::commands::endpoint::open;
    use crate::commands::services::run_until_signal;
    use crate::commands::{core_count, load_policy};
    use anyhow::Context;
    use std::sync::Arc;
    use surefoot_fleet::work::compute_class::ComputeClass;
    use surefoot_fleet::work::prover::Prover;
    use tracing::info;

    let policy = load_policy(args.model.as_deref())?;
    if args.print_lane {
        println!("{}", ComputeClass::of(&policy));
        return Ok(());
    }
    let nats = args.nats.nats.as_deref().context("--nats is missing: the URL of the queue")?;
    let thread_count = args.threads.unwrap_or_else(core_count).max(1);
    let config = args.endpoint.config()?;
    run_until_signal(|shutdown| async move {
        let shared = Shared::open(nats, args.blobs.blobs.as_deref(), &policy).await?;
        let endpoint = open("--listen", args.listen, config)?;
        info!(address = %endpoint.address(), lane = %shared.lane, nats = %shared.queue.place(), "prover ready");
        let runner = Arc::new(units::Runner::new(policy, shared.maps()));
        let prover = Prover::new(shared.queue, shared.lane, runner);
        let working = tokio::spawn(prover.clone().run(thread_count, shutdown.clone()));
        let metrics = move || {
            let text = prover.metrics();
            async move { text }
        };
        endpoint.serve(tonic::service::Routes::builder(), &[], metrics, shutdown).await?;
        Ok(working.await?)
    })
}
