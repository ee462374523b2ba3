//! `surefoot graph export`.

use super::{Loaded, Target};
use crate::commands::{core_count, parse_share};
use crate::terminal::{print_json, progress_bar, with_spinner};
use anyhow::{Context, bail};
use serde::Serialize;
use std::path::PathBuf;
use surefoot_planner::assets::{AssetFormat, Connected, LinkSet, ShapedEdge};
use surefoot_planner::export::{About, Format, export_about};
use surefoot_planner::links::{DEFAULT_MAX_DETOUR, NavMesh};
use surefoot_rollout::shape;
use surefoot_world::reach::Reach;

/// Write a graph for other programs.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot graph export 2000 --format graphml --out map.graphml\n  \
        surefoot graph export 2000 --format json > map.json   # networkx.node_link_graph(json.load(f), \
        edges=\"edges\")\n  \
        surefoot graph export 2000 --format detour --out links.json\n  \
        surefoot graph export level.glb --format godot --out links.tscn")]
pub struct Args {
    #[command(flatten)]
    target: Target,
    /// Format of the graph: graphml or json (node-link, for networkx and `graph diff`); or of links for a NavMesh:
    /// detour, godot, unity, unreal, landmass or links (JSON with all that is known)
    #[arg(long, value_name = "NAME", value_parser = Output::parse)]
    format: Output,
    /// Omit links that other links, or the NavMesh alone, replace in at most RATIO times their time
    #[arg(long, value_name = "RATIO", default_value_t = DEFAULT_MAX_DETOUR, value_parser = parse_ratio)]
    max_detour: f64,
    /// Write a link wherever more than walking is needed
    #[arg(long, conflicts_with = "max_detour")]
    all_links: bool,
    /// Omit links on which a plain scripted controller succeeds in a smaller share of its tries, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = parse_share::<f32>)]
    min_driven: f32,
    /// File to write; default: standard output
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// With --out and links: print what they connect as one JSON document
    #[arg(long, requires = "out")]
    json: bool,
}

/// What is written.
#[derive(Debug, Clone, Copy)]
enum Output {
    Graph(Format),
    Links(AssetFormat),
}

impl Output {
    fn parse(name: &str) -> Result<Self, String> {
        let graph = Format::ALL.iter().map(|&format| (format.name(), Self::Graph(format)));
        let links = AssetFormat::ALL.iter().map(|&format| (format.name(), Self::Links(format)));
        let all: Vec<(&str, Self)> = graph.chain(links).collect();
        let names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        let found = all.iter().find(|(known, _)| *known == name).map(|(_, output)| *output);
        found.ok_or_else(|| format!("known are {}", names.join(", ")))
    }
}

fn parse_ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse::<f64>().ok().filter(|ratio| *ratio > 1.0 && ratio.is_finite());
    ratio.ok_or_else(|| "must be a number above 1".to_owned())
}

/// What the links connect, for output.
#[derive(Serialize)]
struct Summary {
    links: usize,
    /// Edges that need a link, but along which no run arrived again, or the scripted controller failed too often.
    left_out: usize,
    /// Shares of the ordered pairs of vertices between which the NavMesh leads, without and with the links.
    connected: Connected,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    if matches!(args.format, Output::Graph(_)) && args.json {
        bail!("--json is only for links");
    }
    let loaded = args.target.load(None)?;
    match args.format {
        Output::Graph(format) => {
            let frame = args.target.source.frame_of(&loaded.context.map);
            let about = About { frame, body: Some(loaded.context.profile.clone()) };
            args.write(&export_about(&loaded.graph, format, about))
        }
        Output::Links(format) => {
            let (set, summary) = links(args, &loaded);
            args.write(&format.write(&set))?;
            args.report(&summary)
        }
    }
}

impl Args {
    fn write(&self, text: &str) -> anyhow::Result<()> {
        match &self.out {
            Some(path) => std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display())),
            None => {
                print!("{text}");
                Ok(())
            }
        }
    }

    /// Prints what the links connect: on stdout, or on stderr if the links themselves go to stdout.
    fn report(&self, summary: &Summary) -> anyhow::Result<()> {
        if self.json {
            return print_json(summary);
        }
        let Summary { links, left_out, connected } = summary;
        let percent = |share: f64| 100.0 * share;
        let text = format!(
            "{links} links ({left_out} edges left out): {:.1} % of pairs of vertices are connected, {:.1} % without \
             links",
            percent(connected.with),
            percent(connected.without)
        );
        if self.out.is_some() {
            println!("{text}")
        } else {
            eprintln!("{text}")
        }
        Ok(())
    }
}

/// Measures the edges that the NavMesh cannot walk, and makes links of those that shorten paths.
fn links(args: &Args, loaded: &Loaded) -> (LinkSet, Summary) {
    let (graph, context) = (&loaded.graph, &loaded.context);
    let reach = with_spinner("surveying the level", || Reach::survey(&context.map, &context.profile, core_count()));
    let island_at = |at| Some(reach.ground.at(at)?.island);
    let islands: Vec<Option<u32>> = graph.vertices().map(|vertex| island_at(graph.position(vertex))).collect();
    let profile = &context.profile;
    let nav_mesh = NavMesh { radius: profile.radius, speed: profile.forward_speed, islands: &islands };
    let needed: Vec<_> = graph.edges().filter(|edge| nav_mesh.needs_link(graph, edge)).collect();
    let bar = progress_bar(needed.len() as u64, "measuring leaps");
    let shapes = shape::measure(context, (graph, &reach.ground), &needed, core_count(), &|| bar.inc(1));
    bar.finish_and_clear();
    let shaped = needed.iter().zip(shapes).filter_map(|(&edge, shape)| Some(ShapedEdge { edge, shape: shape? }));
    let shaped: Vec<ShapedEdge<'_>> = shaped.filter(|it| it.shape.driven() >= args.min_driven).collect();
    let max_detour = (!args.all_links).then_some(args.max_detour);
    let frame = args.target.source.frame_of(&context.map);
    let set = LinkSet { frame, ..LinkSet::of(graph, &shaped, nav_mesh, max_detour, &island_at) };
    let left_out = needed.len() - shaped.len();
    let summary = Summary { links: set.links.len(), left_out, connected: set.connected };
    (set, summary)
}
