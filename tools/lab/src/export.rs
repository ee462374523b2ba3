//! `surefoot export` and `surefoot import`: exchange of weights with other programs.

use anyhow::{Context, bail};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_cli::commands::load_policy;
use surefoot_cli::terminal::print_json;
use surefoot_exchange::{from_safetensors, to_onnx, to_safetensors};
use surefoot_policy::{Manifest, Policy, Weights, checkpoint};
use surefoot_rollout::crowd::{Sample, sample_decisions};
use surefoot_world::MapSpec;

/// Write a model for other programs: ONNX for the runtimes of game engines, safetensors for Python.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot export --onnx policy.onnx\n  \
        surefoot export --model models/general-lstm --onnx lstm.onnx --safetensors lstm.safetensors")]
pub struct ExportArgs {
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Write an ONNX model (opset 13, any number of rows)
    #[arg(long, value_name = "FILE")]
    onnx: Option<PathBuf>,
    /// Write the weights as safetensors
    #[arg(long, value_name = "FILE")]
    safetensors: Option<PathBuf>,
    /// Print N observations and their decisions as JSON, to compare with another runtime. They come in ten successive
    /// steps, across which a recurrent policy keeps its memory
    #[arg(long, value_name = "N")]
    check: Option<usize>,
    /// Has no effect: --check always prints JSON
    #[arg(long)]
    json: bool,
}

/// Convert a safetensors file to a model folder. Names and shapes must be those that export writes.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot import lstm.safetensors runs/mine --name mine")]
pub struct ImportArgs {
    /// The safetensors file
    file: PathBuf,
    /// Folder to write weights and manifest to
    folder: PathBuf,
    /// Name of the model; default: the one in the file, else "imported"
    #[arg(long)]
    name: Option<String>,
}

pub fn export(args: &ExportArgs) -> anyhow::Result<()> {
    if args.onnx.is_none() && args.safetensors.is_none() && args.check.is_none() {
        bail!("nothing to do: give --onnx FILE, --safetensors FILE, or --check N");
    }
    let policy = load_policy(args.model.as_deref())?;
    if let Some(count) = args.check {
        check(&policy, count)?;
    }
    let weights = Weights::from_burnpack(&policy.manifest().actor, policy.weights())?;
    if let Some(path) = &args.onnx {
        write(path, &to_onnx(&weights, policy.manifest()))?;
    }
    if let Some(path) = &args.safetensors {
        write(path, &to_safetensors(&weights, policy.manifest())?)?;
    }
    Ok(())
}

/// Prints decisions of NPCs that act by the policy on a map, in `STEPS` steps.
fn check(policy: &Policy, count: usize) -> anyhow::Result<()> {
    const STEPS: usize = 10;
    let rows = count.div_ceil(STEPS);
    if !(1..=10_000).contains(&rows) {
        bail!("--check is {count}, allowed are 1 to 100000");
    }
    let map = Arc::new(surefoot_generate::generate(&MapSpec::new(0)));
    let samples = sample_decisions(map, policy, rows, STEPS)?;
    let step = |sample: &Sample| serde_json::json!({ "observations": sample.observations, "actions": sample.actions });
    let steps: Vec<_> = samples.iter().map(step).collect();
    print_json(&serde_json::json!({ "rows": rows, "steps": steps }))
}

pub fn import(args: &ImportArgs) -> anyhow::Result<()> {
    let context = || format!("cannot use {}", args.file.display());
    let bytes = std::fs::read(&args.file).with_context(context)?;
    let (weights, config, former) = from_safetensors(&bytes).with_context(context)?;
    let former_name = former.as_ref().map(|manifest| manifest.name.clone());
    let name = args.name.clone().or(former_name).unwrap_or_else(|| "imported".to_owned());
    let training = former.map_or(serde_json::Value::Null, |manifest| manifest.training);
    let weights = weights.to_burnpack();
    let manifest = Manifest::new(&name, config, &weights, training);
    checkpoint::save(&args.folder, &manifest, &weights)?;
    // Fails now rather than later if the written model cannot be loaded.
    Policy::load(&args.folder)?;
    println!("{}: {} with memory {}, weights {}", name, manifest.kind, config.memory_len(), manifest.weights_hash);
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    eprintln!("wrote {} ({} KB)", path.display(), bytes.len() / 1000);
    Ok(())
}
