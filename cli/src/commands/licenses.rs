//! `surefoot licenses`: the notices of all third-party packages in a release.

use crate::terminal::print_json;
use std::io::{ErrorKind, Write};

/// The notices, written by `cargo run -p e2e --example notices`.
const NOTICES: &str = include_str!("../../THIRD_PARTY_NOTICES.md");

/// Print the licences of Surefoot and of all crates in its programs.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot licenses | less\n  surefoot licenses --json")]
pub struct Args {
    /// Print names, versions and licences as one JSON document
    #[arg(long)]
    json: bool,
}

/// Prints the notices.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if !args.json {
        // A pager that closes early is not an error.
        return match std::io::stdout().lock().write_all(NOTICES.as_bytes()) {
            Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
            _ => Ok(()),
        };
    }
    let list = NOTICES.split("\n## ").find(|part| part.starts_with("In the programs\n")).unwrap_or_default();
    let crates = list.lines().filter_map(|line| {
        let (name, rest) = line.strip_prefix("- ")?.split_once(' ')?;
        let (version, license) = rest.split_once(" (")?;
        Some(serde_json::json!({ "name": name, "version": version, "license": license.strip_suffix(')')? }))
    });
    print_json(&serde_json::json!({ "license": "MIT OR Apache-2.0", "crates": crates.collect::<Vec<_>>() }))
}
