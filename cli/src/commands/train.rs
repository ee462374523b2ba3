//! `surefoot train`.

use anyhow::Context;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use surefoot_agent::train::{self, TrainConfig};

/// Train the reactive SAC agent. Ctrl-C or SIGTERM writes a checkpoint and ends; --resume continues exactly.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot train runs/first\n  surefoot train runs/first --resume\n  surefoot train runs/mine --config my.json --updates 50000\n  tensorboard --logdir runs"
)]
pub struct Args {
    /// Folder of the run: config.json, state.bin, best/, last/, tensorboard/
    folder: PathBuf,
    /// Continue the run in the folder
    #[arg(long, conflicts_with_all = ["config", "updates", "seed"])]
    resume: bool,
    /// Start from this configuration (a config.json of another run) instead of the defaults
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Stop after so many updates
    #[arg(long, value_name = "N")]
    updates: Option<u64>,
    /// Seed of weights, noise, maps and goals
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let mut config = match &args.config {
        Some(path) => {
            let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
            serde_json::from_slice(&text)
                .with_context(|| format!("{} is not a training configuration", path.display()))?
        }
        None => TrainConfig::default(),
    };
    config.total_updates = args.updates.unwrap_or(config.total_updates);
    config.seed = args.seed.unwrap_or(config.seed);
    let stop = Arc::new(AtomicBool::new(false));
    stop_on_signal(stop.clone())?;
    train::run(config, &args.folder, args.resume, &stop, |line| println!("{line}"))?;
    Ok(())
}

/// Sets `stop` at the first Ctrl-C or SIGTERM.
fn stop_on_signal(stop: Arc<AtomicBool>) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        runtime.block_on(surefoot_server::shutdown_signal());
        stop.store(true, Ordering::Relaxed);
    })?;
    Ok(())
}
