//! `surefoot graph export`.

use super::Target;
use crate::commands::core_count;
use anyhow::Context;
use std::path::PathBuf;
use surefoot_planner::export::{Format, export};
use surefoot_planner::links::{DEFAULT_MAX_DETOUR, NavMesh};
use surefoot_world::reach::Reach;

/// Write a graph for other programs.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot graph export 2000 --format graphml --out map.graphml\n  surefoot graph export 2000 --format json > map.json   # networkx.node_link_graph(json.load(f), edges=\"edges\")\n  surefoot graph export 2000 --format detour --out links.json"
)]
pub struct Args {
    #[command(flatten)]
    target: Target,
    /// Format: graphml, dot, json (node-link, for networkx and `graph diff`) or detour (off-mesh links)
    #[arg(long, value_name = "NAME", value_parser = parse_format)]
    format: Format,
    /// With detour: omit links that other links, or the NavMesh alone, replace in at most RATIO times their time
    #[arg(long, value_name = "RATIO", default_value_t = DEFAULT_MAX_DETOUR, value_parser = parse_ratio)]
    max_detour: f64,
    /// With detour: write every edge that needs more than walking
    #[arg(long, conflicts_with = "max_detour")]
    all_links: bool,
    /// File to write; default: standard output
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

fn parse_format(name: &str) -> Result<Format, String> {
    let names = Format::ALL.map(Format::name).join(", ");
    Format::ALL.into_iter().find(|format| format.name() == name).ok_or_else(|| format!("known are {names}"))
}

fn parse_ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse::<f64>().ok().filter(|ratio| *ratio > 1.0 && ratio.is_finite());
    ratio.ok_or_else(|| "must be a number above 1".to_owned())
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let loaded = args.target.load(None)?;
    let (graph, profile) = (&loaded.graph, loaded.context.profile);
    // Only off-mesh links depend on what is connected on foot.
    let survey = (args.format == Format::Detour).then(|| Reach::survey(&loaded.context.map, &profile, core_count()));
    let island = |vertex| Some(survey.as_ref()?.ground.at(graph.position(vertex))?.island);
    let islands: Vec<Option<u32>> = graph.vertices().map(island).collect();
    let nav_mesh = NavMesh { radius: profile.radius, speed: profile.forward_speed, islands: &islands };
    let text = export(graph, args.format, nav_mesh, (!args.all_links).then_some(args.max_detour));
    match &args.out {
        Some(path) => std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display())),
        None => {
            print!("{text}");
            Ok(())
        }
    }
}
