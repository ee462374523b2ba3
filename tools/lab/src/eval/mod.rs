//! `surefoot eval`.

mod args;
mod attempts;
mod measure;
mod plain;
mod results;
mod suites;
mod tables;

use crate::provenance::Start;
pub use args::Args;
use measure::measure;
use std::sync::Arc;
use surefoot_eval::record::Record;

pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(folder) = &args.check {
        return attempts::check(args, folder);
    }
    let Some(folder) = &args.out else {
        return measure(args, None)?.print(args.json);
    };
    if args.shard.is_some() {
        // What a part says of the whole means nothing: only its units are kept.
        measure(args, None)?;
        println!(
            "the units of this shard are in {}; run the command without --shard once all are there",
            folder.display()
        );
        return Ok(());
    }
    let start = Start::now();
    let record = Arc::new(Record::new());
    let results = measure(args, Some(record.clone()))?;
    let attempts = attempts::write_attempts(folder, &record)?;
    start.write(folder, "eval", &results.json()?, (record.models(), attempts))?;
    results.write(folder)?;
    results.print(args.json)
}
