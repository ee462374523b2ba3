//! Provenance: how published figures were made.

use anyhow::Context;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;
use surefoot_cli::commands::{machine, revision};
use surefoot_eval::record::Model;

/// Names of the files of figures and of their provenance.
pub const RESULTS: &str = "results.json";
pub const PROVENANCE: &str = "provenance.json";

/// How figures were made.
#[derive(Serialize, Deserialize)]
pub struct Provenance {
    /// Arguments of the command, from the subcommand on.
    pub command: Vec<String>,
    /// Version of Surefoot.
    version: String,
    /// Commit of the checkout that the command ran in, followed by `+` if there were changes; empty outside a checkout.
    pub commit: String,
    /// Processors.
    pub machine: String,
    /// Mean number of runnable processes in the minute before; about 0 on an idle machine. Absent where the system does
    /// not report it.
    load_before: Option<f64>,
    /// Wall time, s; short if finished units were loaded.
    wall_s: f64,
    /// Names of the models with hashes of their weights; empty if other programs' runs were scored.
    models: Vec<Model>,
    /// Hash (BLAKE3) of the figures.
    pub results: String,
    /// The attempts, if they were recorded.
    pub attempts: Option<Attempts>,
}

/// The file of attempts.
#[derive(Serialize, Deserialize)]
pub struct Attempts {
    pub file: String,
    /// Hash (BLAKE3) of the file.
    pub hash: String,
    pub bytes: u64,
    /// Maps and seeds by model and condition.
    pub units: usize,
    /// Version of the builder of their graphs.
    #[serde(default = "first_recorded_builder")]
    pub builder: u32,
}

/// Version of the builder when records did not have it yet.
fn first_recorded_builder() -> u32 {
    11
}

/// The state of the machine and the checkout before figures are made.
pub struct Start {
    at: Instant,
    load_before: Option<f64>,
    commit: String,
}

impl Start {
    pub fn now() -> Self {
        let load = std::fs::read_to_string("/proc/loadavg").ok();
        let load_before = load.and_then(|text| text.split_whitespace().next()?.parse().ok());
        Self { at: Instant::now(), load_before, commit: revision().unwrap_or_default() }
    }

    /// Writes figures, and how the subcommand `subcommand` made them, into a folder.
    pub fn write(
        self,
        folder: &Path,
        subcommand: &str,
        figures: &impl Serialize,
        (models, attempts): (Vec<Model>, Option<Attempts>),
    ) -> anyhow::Result<()> {
        let figures = serde_json::to_string_pretty(figures)? + "\n";
        write_into(folder, RESULTS, &figures)?;
        let arguments: Vec<String> = std::env::args().collect();
        let first = arguments.iter().position(|it| it == subcommand).unwrap_or(0);
        let provenance = Provenance {
            command: arguments[first..].to_vec(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: self.commit,
            machine: machine(),
            load_before: self.load_before,
            wall_s: self.at.elapsed().as_secs_f64(),
            models,
            results: blake3::hash(figures.as_bytes()).to_hex().to_string(),
            attempts,
        };
        write_into(folder, PROVENANCE, &(serde_json::to_string_pretty(&provenance)? + "\n"))
    }
}

/// Writes a file into a folder, which is made if there is none.
pub fn write_into(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let path = folder.join(name);
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}
