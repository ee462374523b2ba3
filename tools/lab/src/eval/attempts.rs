//! The attempts behind published figures, and a check that the figures can be reproduced.

use super::args::Args;
use super::measure::measure;
use crate::provenance::{Attempts, PROVENANCE, Provenance, RESULTS};
use anyhow::{Context, bail, ensure};
use clap::Parser;
use serde::Serialize;
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_cli::commands::{core_count, machine};
use surefoot_cli::terminal::print_json;
use surefoot_eval::record::{Comparison, Record};

/// Name of the file of attempts.
const ATTEMPTS: &str = "attempts.jsonl.gz";
/// Largest relative difference of figures that are derived again from the same attempts.
const TOLERANCE: f64 = 1.0e-9;
/// First version of the builder with which the default body steps higher than the paper's.
const BODY_CLIMBS_STAIRS: u32 = 14;

/// Writes the attempts into a folder, if there are any.
pub fn write_attempts(folder: &Path, record: &Record) -> anyhow::Result<Option<Attempts>> {
    if record.is_empty() {
        return Ok(None);
    }
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let path = folder.join(ATTEMPTS);
    let write = || -> anyhow::Result<()> { Ok(record.write(BufWriter::new(File::create(&path)?))?) };
    write().with_context(|| format!("cannot write {}", path.display()))?;
    let (hash, bytes) = hash_file(&path)?;
    Ok(Some(Attempts { file: ATTEMPTS.to_owned(), hash, bytes, units: record.len(), builder: record.builder() }))
}

/// Hash and size of a file.
fn hash_file(path: &Path) -> anyhow::Result<(String, u64)> {
    let mut hasher = blake3::Hasher::new();
    let copied = File::open(path).and_then(|mut file| std::io::copy(&mut file, &mut hasher));
    let bytes = copied.with_context(|| format!("cannot read {}", path.display()))?;
    Ok((hasher.finalize().to_hex().to_string(), bytes))
}

/// Arguments of the command that made a table.
#[derive(Parser)]
#[command(name = "eval", no_binary_name = false)]
struct Stored {
    #[command(flatten)]
    args: Args,
}

/// The result of a check.
#[derive(Serialize)]
struct Outcome {
    folder: PathBuf,
    command: String,
    made_at_commit: String,
    made_on: String,
    checked_on: String,
    /// Whether the figures follow from the attempts on record.
    derived: bool,
    #[serde(flatten)]
    comparison: Comparison,
    /// Chance of a difference as large in success if nothing changed.
    chance: f64,
    agrees: bool,
}

/// Derives a table again from its attempts, and repeats a share of them. With `--maps`, only prints the figures of
/// these maps.
pub fn check(args: &Args, folder: &Path) -> anyhow::Result<()> {
    ensure!((0.0..=1.0).contains(&args.share), "--share is {}, allowed are 0 to 1", args.share);
    let read = |name: &str| {
        let path = folder.join(name);
        std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
    };
    let path = folder.join(PROVENANCE);
    let provenance: Provenance =
        serde_json::from_slice(&read(PROVENANCE)?).with_context(|| format!("{} is damaged", path.display()))?;
    let Some(attempts) = &provenance.attempts else {
        bail!("{} has no recorded attempts: run `surefoot {}` again", folder.display(), provenance.command.join(" "));
    };
    let figures = read(RESULTS)?;
    ensure!(
        blake3::hash(&figures).to_hex().as_str() == provenance.results,
        "{} does not match provenance.json",
        folder.join(RESULTS).display()
    );
    let path = folder.join(&attempts.file);
    ensure!(hash_file(&path)?.0 == attempts.hash, "{} does not match provenance.json", path.display());
    let file = File::open(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let is_part = !args.maps.is_empty();
    let share = if is_part { 0.0 } else { args.share };
    let record = Record::read(BufReader::new(file), share, args.check_seed, attempts.builder)
        .with_context(|| format!("cannot use {}", path.display()))?;
    let stored = Stored::try_parse_from(&provenance.command)
        .context("this version does not accept the command that made the table")?;
    let maps = if is_part { args.maps.clone() } else { stored.args.maps };
    let body = if attempts.builder < BODY_CLIMBS_STAIRS { stored.args.body.or_paper() } else { stored.args.body };
    let threads = Some(args.threads.unwrap_or_else(core_count));
    let made = Args { out: None, maps, body, threads, ..stored.args };
    let record = Arc::new(record);
    let results = measure(&made, Some(record.clone()))?;
    if is_part {
        return results.print(args.json);
    }
    let figures: serde_json::Value = serde_json::from_slice(&figures)?;
    let comparison = record.comparison();
    let outcome = Outcome {
        folder: folder.to_owned(),
        command: format!("surefoot {}", provenance.command.join(" ")),
        made_at_commit: provenance.commit,
        made_on: provenance.machine,
        checked_on: machine(),
        derived: are_close(&figures, &results.json()?),
        chance: comparison.chance(),
        agrees: comparison.agrees(),
        comparison,
    };
    if args.json {
        print_json(&outcome)?;
    } else {
        outcome.print();
    }
    ensure!(outcome.derived, "the figures of {} do not follow from its attempts", folder.display());
    ensure!(outcome.agrees, "the repeated attempts do not agree with the recorded ones");
    Ok(())
}

impl Outcome {
    fn print(&self) {
        let Comparison { units, batches, attempts, identical, lost, gained } = self.comparison;
        println!("{}: made by `{}`", self.folder.display(), self.command);
        println!("at commit {} on {}", self.made_at_commit, self.made_on);
        let follows = if self.derived { "follow" } else { "DO NOT FOLLOW" };
        println!("the figures {follows} from the attempts of {units} recorded units");
        println!(
            "{attempts} attempts of {batches} batches repeated: {identical} identical, {lost} failed that had \
             succeeded, {gained} succeeded that had failed (chance of such a difference: {:.2})",
            self.chance
        );
    }
}

/// Whether a document has all that an older one has, except for the last digits of numbers. What newer versions add is
/// not compared.
fn are_close(one: &serde_json::Value, other: &serde_json::Value) -> bool {
    use serde_json::Value;
    match (one, other) {
        (Value::Number(one), Value::Number(other)) => {
            let [one, other] = [one, other].map(|it| it.as_f64().unwrap_or(f64::NAN));
            (one - other).abs() <= TOLERANCE * one.abs().max(other.abs()).max(1.0)
        }
        (Value::Array(one), Value::Array(other)) => {
            one.len() == other.len() && one.iter().zip(other).all(|(one, other)| are_close(one, other))
        }
        (Value::Object(one), Value::Object(other)) => {
            one.iter().all(|(key, value)| other.get(key).is_some_and(|it| are_close(value, it)))
        }
        _ => one == other,
    }
}
