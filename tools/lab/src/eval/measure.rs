//! Runs an evaluation or a suite.

use super::args::{Args, Suite};
use super::results::Results;
use super::{suites, tables};
use anyhow::bail;
use std::sync::Arc;
use surefoot_cli::commands::load_policy;
use surefoot_cli::terminal::with_bar;
use surefoot_eval::record::Record;
use surefoot_eval::{EvalConfig, evaluate};
use surefoot_policy::Policy;

/// With `--nats`, lets provers run the units. They are saved in the folder of the configuration, or in the temporary
/// folder that is returned.
#[cfg(feature = "fleet")]
fn share(args: &Args, policy: &Policy, config: EvalConfig) -> anyhow::Result<(EvalConfig, Option<tempfile::TempDir>)> {
    use surefoot_cli::commands::fleet::{Shared, units};
    use surefoot_cli::terminal::progress_bar;
    use surefoot_fleet::work::dispatch::Threads;

    let is_checked = config.record.as_ref().is_some_and(|record| record.is_checked());
    let Some(nats) = args.nats.nats.as_deref().filter(|_| !is_checked) else { return Ok((config, None)) };
    let folder = if config.keep_in.is_none() { Some(tempfile::tempdir()?) } else { None };
    let keep_in = folder.as_ref().map(|folder| folder.path().to_owned()).or_else(|| config.keep_in.clone());
    let config = EvalConfig { keep_in, ..config };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let shared = runtime.block_on(Shared::open(nats, args.blobs.blobs.as_deref(), policy))?;
    let grounds = runtime.block_on(async { shared.maps() });
    let bar = progress_bar((config.maps.len() * config.seeds.len()) as u64, "maps and seeds");
    let threads = Threads { beside_provers: 1, alone: config.thread_count };
    units::gather((&shared.dispatcher(), &grounds), policy, &config, threads, &|| bar.inc(1))?;
    bar.finish_and_clear();
    Ok((config, folder))
}

/// This build has no queue.
#[cfg(not(feature = "fleet"))]
fn share(args: &Args, _: &Policy, config: EvalConfig) -> anyhow::Result<(EvalConfig, Option<tempfile::TempDir>)> {
    let _ = &args.blobs.blobs;
    Ok((config, None))
}

/// Runs the evaluation or suite. Attempts are added to the record; if the record is being checked, they are read from
/// it.
pub fn measure(args: &Args, record: Option<Arc<Record>>) -> anyhow::Result<Results> {
    let config = EvalConfig { record, ..args.config()? };
    if args.model.is_some() && !matches!(args.suite, None | Some(Suite::Dial | Suite::Kinds)) {
        bail!("this suite takes its models from --models, not from --model");
    }
    match args.suite {
        Some(Suite::Paper) => suites::paper(args, &config),
        Some(Suite::Ablation) => suites::ablation(args, &config),
        Some(Suite::Sweep) => suites::sweep(args, &config),
        Some(Suite::BigMap) => suites::big_map(args, &config),
        Some(Suite::Living) => suites::living(args, &config),
        Some(Suite::Seeds) => tables::seeds(args, &config),
        Some(Suite::Dial) => tables::dial(args, &config),
        Some(Suite::Kinds) => tables::kinds(args, &config),
        None => {
            let model = args.model.clone().or_else(|| args.rules.faithful.then(|| args.models.join("general-lstm")));
            let policy = args.rules.apply(load_policy(model.as_deref())?);
            let (config, _folder) = share(args, &policy, config)?;
            let report =
                with_bar("evaluating", |bar| evaluate(&policy, &config, |done, total| bar("evaluating", done, total)))?;
            Ok(Results::Plain(Box::new(report)))
        }
    }
}
