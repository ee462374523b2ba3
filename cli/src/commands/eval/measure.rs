//! Runs an evaluation or a suite.

use super::args::Args;
use super::results::Results;
use super::{suites, tables};
use crate::commands::load_policy;
use crate::terminal::progress_bar;
use anyhow::bail;
use std::sync::Arc;
use surefoot_agent::eval::record::Record;
use surefoot_agent::eval::{EvalConfig, evaluate};

/// Runs what the arguments say. Attempts go to the record, or come from it if it is one to check.
pub fn measure(args: &Args, record: Option<Arc<Record>>) -> anyhow::Result<Results> {
    let config = EvalConfig { record, ..args.config()? };
    if args.model.is_some() && !matches!(args.suite.as_deref(), None | Some("dial" | "kinds")) {
        bail!("this suite takes its models from --models, not from --model");
    }
    match args.suite.as_deref() {
        Some("paper") => suites::paper(args, &config),
        Some("ablation") => suites::ablation(args, &config),
        Some("sweep") => suites::sweep(args, &config),
        Some("big-map") => suites::big_map(args, &config),
        Some("living") => suites::living(args, &config),
        Some("seeds") => tables::seeds(args, &config),
        Some("dial") => tables::dial(args, &config),
        Some("kinds") => tables::kinds(args, &config),
        Some(suite) => bail!("there is no suite {suite}"),
        None => {
            let model = args.model.clone().or_else(|| args.rules.faithful.then(|| args.models.join("general-lstm")));
            let policy = args.rules.apply(load_policy(model.as_deref())?);
            let bar = progress_bar((config.maps.len() * config.seeds.len() * config.goals) as u64, "evaluating");
            let report = evaluate(&policy, &config, |done, _| bar.set_position(done as u64))?;
            bar.finish_and_clear();
            Ok(Results::Plain(Box::new(report)))
        }
    }
}
