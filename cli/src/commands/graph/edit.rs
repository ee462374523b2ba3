//! `surefoot graph edit`.

use super::Target;
use anyhow::{Context, bail};
use std::path::PathBuf;
use surefoot_planner::edits::{Edit, Layer};
use surefoot_planner::store::GraphStore;
use surefoot_world::DVec3;
use surefoot_world::map::LevelFrame;

/// Change a graph by hand, in named layers that outlive rebuilds.
#[derive(clap::Args)]
#[command(after_help = "Places are X,Y,Z in metres on the map, or in the level's own coordinates with --coordinates \
        level.\n\
        They refer to the nearest vertex within 3 m.\n\n\
        Examples:\n  \
        surefoot graph edit 2000 --layer night --forbid 31,12,40:45,12,38\n  \
        surefoot graph edit 2000 --layer night --price 31,12,40:45,12,38=4 --add 60,14.5,52\n  \
        surefoot graph edit level.glb --layer night --coordinates level --forbid -31,12,40:-45,12,38\n  \
        surefoot graph edit 2000 --layer night --undo 1\n  \
        surefoot graph edit 2000 --layer night --export night.json\n  \
        surefoot graph edit 2000 --import night.json")]
pub struct Args {
    #[command(flatten)]
    target: Target,
    /// Layer to change; without changes, list all layers
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Forbid an edge
    #[arg(long, value_name = "FROM:TO", allow_hyphen_values = true, requires = "layer")]
    forbid: Vec<String>,
    /// Add an edge that takes SECONDS; without a number, the time is estimated from its geometry
    #[arg(long, value_name = "FROM:TO[=SECONDS]", allow_hyphen_values = true, requires = "layer")]
    force: Vec<String>,
    /// Multiply the cost of an edge by FACTOR, 0.1 to 1000
    #[arg(long, value_name = "FROM:TO=FACTOR", allow_hyphen_values = true, requires = "layer")]
    price: Vec<String>,
    /// Add a vertex
    #[arg(long, value_name = "AT", allow_hyphen_values = true, requires = "layer")]
    add: Vec<String>,
    /// Move a vertex
    #[arg(long = "move", value_name = "FROM:TO", allow_hyphen_values = true, requires = "layer")]
    moves: Vec<String>,
    /// Remove a vertex
    #[arg(long, value_name = "AT", allow_hyphen_values = true, requires = "layer")]
    remove: Vec<String>,
    /// Coordinates of the places in these flags: those of the map, or the level's own, as in the tool that made it
    #[arg(long, default_value = "map", value_name = "NAME")]
    coordinates: Coordinates,
    /// Undo the last N edits of the layer before adding new ones
    #[arg(long, default_value_t = 0, value_name = "N", requires = "layer")]
    undo: usize,
    /// Write the layer as JSON
    #[arg(long, value_name = "FILE", requires = "layer")]
    export: Option<PathBuf>,
    /// Import an exported layer; it replaces the layer with the same name
    #[arg(long, value_name = "FILE", conflicts_with = "layer")]
    import: Option<PathBuf>,
}

/// Coordinates of places on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Coordinates {
    Map,
    Level,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let context = args.target.context(&args.target.source)?;
    let (level, frame) = (args.target.level(&context.map), *context.map.frame());
    let new_edits = args.new_edits(&frame)?;
    {
        let store = args.target.cache.open()?;
        let found = store.layers(&level)?;
        if let Some(path) = &args.import {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            let layer: Layer =
                serde_json::from_str(&text).with_context(|| format!("{} is not a layer of edits", path.display()))?;
            layer.validate()?;
            store.put_layer(&level, &layer)?;
        }
        if let Some(name) = &args.layer {
            if let Some(damaged) = found.damaged.iter().find(|layer| layer.name == *name) {
                bail!("{damaged} (--import)");
            }
            let old = found.layers.iter().find(|layer| layer.name == *name);
            let mut layer = old.cloned().unwrap_or(Layer { name: name.clone(), edits: Vec::new() });
            if args.undo > layer.edits.len() {
                bail!("--undo is {}, layer `{name}` has {} edits", args.undo, layer.edits.len());
            }
            layer.edits.truncate(layer.edits.len() - args.undo);
            layer.edits.extend(&new_edits);
            layer.validate()?;
            if args.undo > 0 || !new_edits.is_empty() {
                store.put_layer(&level, &layer)?;
            }
            if let Some(path) = &args.export {
                let text = serde_json::to_string_pretty(&layer)? + "\n";
                std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
            }
        }
        for layer in store.layers(&level)?.whole()? {
            println!("layer `{}`: {} edits", layer.name, layer.edits.len());
            for (index, edit) in layer.edits.iter().enumerate() {
                println!("  {index}: {}{}", serde_json::to_string(edit)?, in_level(edit, &frame));
            }
        }
    }
    let loaded = args.target.load_in(context, None)?;
    loaded.print_unapplied();
    println!("{} vertices, {} edges with all layers", loaded.graph.vertex_count(), loaded.graph.edge_count());
    Ok(())
}

impl Args {
    /// The edits that the flags describe, kind by kind, on a map with this frame.
    fn new_edits(&self, frame: &LevelFrame) -> anyhow::Result<Vec<Edit>> {
        let place = |text: &str| {
            let place = parse_place(text)?;
            Ok::<_, anyhow::Error>(match self.coordinates {
                Coordinates::Map => place.as_vec3(),
                Coordinates::Level => frame.to_map(place),
            })
        };
        let pair = |text: &str| {
            let (from, to) =
                text.split_once(':').with_context(|| format!("`{text}` is not two places, expected FROM:TO"))?;
            Ok::<_, anyhow::Error>((place(from)?, place(to)?))
        };
        let mut edits = Vec::new();
        for text in &self.forbid {
            let (from, to) = pair(text)?;
            edits.push(Edit::ForbidEdge { from, to });
        }
        for text in &self.force {
            let (ends, seconds) = split_number(text)?;
            let (from, to) = pair(ends)?;
            edits.push(Edit::ForceEdge { from, to, seconds });
        }
        for text in &self.price {
            let (ends, factor) = split_number(text)?;
            let (from, to) = pair(ends)?;
            let factor = factor.with_context(|| format!("`{text}` has no factor, expected FROM:TO=FACTOR"))?;
            edits.push(Edit::PriceEdge { from, to, factor });
        }
        for text in &self.add {
            edits.push(Edit::AddVertex { at: place(text)? });
        }
        for text in &self.moves {
            let (from, to) = pair(text)?;
            edits.push(Edit::MoveVertex { from, to });
        }
        for text in &self.remove {
            edits.push(Edit::RemoveVertex { at: place(text)? });
        }
        Ok(edits)
    }
}

fn parse_place(text: &str) -> anyhow::Result<DVec3> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => bail!("`{text}` is not a place, expected X,Y,Z"),
    }
}

/// The places of an edit in the level's own coordinates, for people; empty if they are those of the map.
fn in_level(edit: &Edit, frame: &LevelFrame) -> String {
    edit.places().into_iter().map(|place| frame.aside(place)).collect()
}

fn split_number(text: &str) -> anyhow::Result<(&str, Option<f32>)> {
    match text.split_once('=') {
        None => Ok((text, None)),
        Some((rest, number)) => {
            Ok((rest, Some(number.parse().with_context(|| format!("`{number}` in `{text}` is not a number"))?)))
        }
    }
}
