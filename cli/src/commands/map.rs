//! `surefoot map`.

use crate::render::Picture;
use crate::terminal::print_json;
use anyhow::bail;
use std::path::PathBuf;
use std::time::Instant;
use surefoot_world::{Map, MapSpec};

/// Look at maps.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Describe a map, or draw it.
    Show(ShowArgs),
}

/// Describe a generated map, or draw it from above.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot map show 2000\n  surefoot map show 7 --png map.png --scale 4\n  surefoot map show 3000 --size 1000 --json"
)]
pub struct ShowArgs {
    /// Seed of the map
    seed: u64,
    /// Side in metres
    #[arg(long, default_value_t = 250, value_name = "METRES")]
    size: u32,
    /// Write a shaded top view here
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Pixels per metre of the picture
    #[arg(long, default_value_t = 3.0)]
    scale: f32,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Show(args) => show(args),
    }
}

fn show(args: &ShowArgs) -> anyhow::Result<()> {
    if !(0.1..=16.0).contains(&args.scale) || args.scale * args.size as f32 > 8192.0 {
        bail!("--scale is {}, allowed are 0.1 to 16 and at most 8192 pixels a side", args.scale);
    }
    let started = Instant::now();
    let map = Map::generate(&MapSpec::with_side(args.seed, args.size))?;
    let seconds = started.elapsed().as_secs_f64();
    if let Some(path) = &args.png {
        Picture::top_view(&map, args.scale).save(path)?;
    }
    let description = serde_json::json!({
        "seed": args.seed,
        "size": { "width": map.spec().size.width, "height": map.spec().size.height, "depth": map.spec().size.depth },
        "hash": map.hash().to_string(),
        "triangles": map.mesh().triangles().len(),
        "memory_mb": map.mesh().memory_bytes() as f64 / 1.0e6,
        "generate_s": seconds,
        "features": {
            "plateaus": map.plateaus().len(),
            "buildings": map.buildings().len(),
            "pools": map.pools().len(),
            "pads": map.pads().len(),
        },
    });
    if args.json {
        return print_json(&description);
    }
    println!("map {} ({} m a side), hash {}", args.seed, args.size, map.hash());
    println!(
        "{} triangles, {:.0} MB, generated in {seconds:.2} s",
        map.mesh().triangles().len(),
        map.mesh().memory_bytes() as f64 / 1.0e6
    );
    println!(
        "{} plateaus, {} buildings, {} pools, {} jump pads",
        map.plateaus().len(),
        map.buildings().len(),
        map.pools().len(),
        map.pads().len()
    );
    Ok(())
}
