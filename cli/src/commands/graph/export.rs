//! `surefoot graph export`.

use super::Target;
use anyhow::Context;
use std::path::PathBuf;
use surefoot_planner::export::{Format, export};

/// Write a graph for other programs.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot graph export 2000 --format graphml --out map.graphml\n  surefoot graph export 2000 --format json > map.json   # networkx.node_link_graph(json.load(f), edges=\"edges\")\n  surefoot graph export 2000 --format detour --out links.json"
)]
pub struct Args {
    #[command(flatten)]
    target: Target,
    /// graphml, dot, json (node-link, for networkx and `graph diff`) or detour (off-mesh links)
    #[arg(long, value_name = "NAME", value_parser = parse_format)]
    format: Format,
    /// Where to write it; default: standard output
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

fn parse_format(name: &str) -> Result<Format, String> {
    let names = Format::ALL.map(Format::name).join(", ");
    Format::ALL.into_iter().find(|format| format.name() == name).ok_or_else(|| format!("known are {names}"))
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let loaded = args.target.load(None)?;
    let text = export(&loaded.graph, args.format, loaded.context.profile.radius);
    match &args.out {
        Some(path) => std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display())),
        None => {
            print!("{text}");
            Ok(())
        }
    }
}
