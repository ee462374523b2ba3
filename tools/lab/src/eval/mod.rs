//! `surefoot eval`.

mod args;
mod measure;
mod plain;
mod provenance;
mod results;
mod suites;
mod tables;

pub use args::Args;
use measure::measure;
use std::sync::Arc;
use std::time::Instant;
use surefoot_eval::record::Record;

pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(folder) = &args.check {
        return provenance::check(args, folder);
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
    let (start, started) = (provenance::Start::now(), Instant::now());
    let record = Arc::new(Record::new());
    let results = measure(args, Some(record.clone()))?;
    start.write(folder, &results, &record, started.elapsed())?;
    results.print(args.json)
}
