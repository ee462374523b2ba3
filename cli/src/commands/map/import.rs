//! `surefoot map import`.

use super::levels::{LevelArgs, listing, report, summary, written};
use crate::terminal::print_json;
use std::path::PathBuf;

/// Import a level as a map.
#[derive(clap::Args)]
#[command(after_help = "\
        Nodes named lava*, water*, pad*, zip_line*:from, zip_line*:to, teleporter*:from, teleporter*:to and jetpack* \
        become\n\
        features; a sidecar file can list them instead, and --no-names leaves all names without meaning.\n\n\
        Examples:\n  \
        surefoot map import level.glb --out level.sfmap\n  \
        surefoot map import level.obj --up z --scale 0.01 --out level.sfmap\n  \
        surefoot map import level.glb --json   # what became of each node, without saving a map")]
pub struct Args {
    /// The level: .glb, .gltf or .obj
    level: PathBuf,
    /// File to write the map to; optional with --json
    #[arg(long, value_name = "FILE", required_unless_present = "json")]
    out: Option<PathBuf>,
    #[command(flatten)]
    levels: LevelArgs,
    /// Print one JSON document: the map, warnings, counts of the geometry, and what became of each node
    #[arg(long)]
    json: bool,
}

/// Imports a level, and reports what became of it.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let imported = args.levels.import(&args.level)?;
    let write = || args.out.as_ref().map(|out| written(out, &surefoot_levels::encode(&imported.map))).transpose();
    if args.json {
        if let Some(line) = write()? {
            eprintln!("{line}");
        }
        return print_json(&report(&imported));
    }
    let (map, size) = (&imported.map, imported.map.size());
    let [x, y, z] = map.frame().origin.to_array();
    println!("map of {} x {} x {} m, hash {}", size.width, size.height, size.depth, map.hash());
    // Plans and graphs are in the map's frame, which begins at 0.
    println!("the level's origin is at {x} {y} {z} on the map");
    println!("{}", summary(&imported.nodes));
    print!("{}", listing(&imported.nodes));
    if let Some(line) = write()? {
        println!("{line}");
    }
    Ok(())
}
