//! `surefoot map show`.

use super::levels::summary;
use super::source::{BodyArg, Source};
use crate::commands::core_count;
use crate::terminal::{print_json, with_spinner};
use anyhow::bail;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;
use surefoot_levels::role_counts;
use surefoot_report::render::{self, Picture, View};
use surefoot_world::Map;
use surefoot_world::map::MoverKind;
use surefoot_world::reach::{Means, Reach};

/// Describe a map, measure how it is connected, or draw it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot map show 2000\n  \
        surefoot map show 7 --features all --stats\n  \
        surefoot map show 7 --png map.png --iso\n  \
        surefoot map show 7 --png floor.png --section 31.5\n  \
        surefoot map show 3000 --size 1000 --height 200 --json")]
pub struct Args {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    body: BodyArg,
    /// Measure the share of reachable goals among random ones, on foot and by every means
    #[arg(long)]
    stats: bool,
    /// Draw the map into this file
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// View from above (the default)
    #[arg(long, conflicts_with_all = ["iso", "section"])]
    top: bool,
    /// View from a corner
    #[arg(long, conflicts_with = "section")]
    iso: bool,
    /// View from above, cut off at this height in metres
    #[arg(long, value_name = "Y")]
    section: Option<f32>,
    /// Give all ground that is connected on foot one colour
    #[arg(long)]
    islands: bool,
    /// Pixels per metre in the picture; default: a picture 1,000 pixels wide, but at most 8
    #[arg(long, value_name = "PIXELS")]
    pixels_per_m: Option<f32>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Describes or draws a map.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let started = Instant::now();
    let (map, nodes) = args.source.load_with_nodes()?;
    let seconds = started.elapsed().as_secs_f64();
    let profile = args.body.profile()?;
    let reach = (args.stats || args.islands)
        .then(|| with_spinner("surveying the map", || Reach::survey(&map, &profile, core_count())));
    if let Some(path) = &args.png {
        draw(args, &map, reach.as_ref())?.save(path)?;
    }
    let (devices, movers) = (device_counts(&map), mover_counts(&map));
    let size = map.size();
    let mut description = serde_json::json!({
        "seed": map.spec().map(|spec| spec.seed),
        "size": { "width": size.width, "height": size.height, "depth": size.depth },
        "hash": map.hash().to_string(),
        "triangles": map.mesh().triangles().len(),
        "memory_mb": map.memory_bytes() as f64 / 1.0e6,
        "load_s": seconds,
        "features": devices.into_iter().collect::<BTreeMap<_, _>>(),
        "movers": movers.iter().copied().collect::<BTreeMap<_, _>>(),
    });
    if !nodes.is_empty() {
        let roles = role_counts(&nodes).into_iter().map(|(role, count)| (role.to_string(), count));
        description["nodes"] = serde_json::json!(roles.collect::<BTreeMap<_, _>>());
    }
    let stats = reach.as_ref().filter(|_| args.stats).map(Stats::of);
    if let Some(stats) = &stats {
        stats.add_to(&mut description);
    }
    if args.json {
        return print_json(&description);
    }
    println!("map {} ({} x {} x {} m), hash {}", args.source.map, size.width, size.height, size.depth, map.hash());
    if !nodes.is_empty() {
        println!("{}", summary(&nodes));
    }
    println!(
        "{} triangles, {:.0} MB, ready in {seconds:.2} s",
        map.mesh().triangles().len(),
        map.memory_bytes() as f64 / 1.0e6
    );
    let devices = devices.into_iter().map(|(name, count)| (name.replace('_', " "), count));
    let all = devices.chain(movers.into_iter().map(|(name, count)| (format!("{name}s"), count)));
    let all: Vec<String> = all.filter(|(_, count)| *count > 0).map(|(name, count)| format!("{count} {name}")).collect();
    println!("{}", all.join(", "));
    if let Some(stats) = stats {
        stats.print();
    }
    Ok(())
}

/// Numbers of the parts of a map that stand still.
fn device_counts(map: &Map) -> [(&'static str, usize); 10] {
    let placed = map.placed();
    [
        ("plateaus", placed.plateaus.len()),
        ("buildings", placed.buildings.len()),
        ("pools", placed.pools.len()),
        ("pads", placed.pads.len()),
        ("zip_lines", placed.zip_lines.len()),
        ("ravines", placed.ravines.len()),
        ("caves", placed.caves.len()),
        ("teleporters", placed.teleporters.len()),
        ("jetpacks", placed.jetpacks.len()),
        ("spots", placed.spots.len()),
    ]
}

/// Numbers of the movers of each kind.
fn mover_counts(map: &Map) -> Vec<(&'static str, usize)> {
    let count = |kind: MoverKind| map.movers().iter().filter(|it| it.kind == kind).count();
    MoverKind::ALL.iter().map(|&kind| (kind.name(), count(kind))).collect()
}

fn draw(args: &Args, map: &Map, reach: Option<&Reach>) -> anyhow::Result<Picture> {
    let side = map.extent().x.max(map.extent().z);
    let scale = args.pixels_per_m.unwrap_or((1000.0 / side).min(8.0));
    check_scale(scale, map)?;
    let view = match args.section {
        Some(y) if !(0.0..=map.extent().y).contains(&y) => {
            bail!("--section is {y}, the map reaches from 0 to {} m", map.extent().y)
        }
        Some(y) => View::Section(y),
        None if args.iso => View::Iso,
        None => View::Top,
    };
    let islands = reach.filter(|_| args.islands).map(|reach| &reach.ground);
    let mut picture = Picture::of(map, view, scale, islands);
    let mut entries = render::legend(map);
    if islands.is_some() {
        entries[0] = ([200, 160, 120], "one colour: connected on foot");
    }
    picture.add_legend(&format!("map {}", args.source.map), &entries);
    Ok(picture)
}

/// Checks the scale of a picture.
pub fn check_scale(scale: f32, map: &Map) -> anyhow::Result<()> {
    let side = map.extent().x.max(map.extent().z);
    if !(0.1..=16.0).contains(&scale) || scale * side > 8192.0 {
        bail!("--pixels-per-m is {scale}, allowed are 0.1 to 16 and at most 8192 pixels a side");
    }
    Ok(())
}

/// How a map is connected.
struct Stats {
    walk: f64,
    all: f64,
    island_count: usize,
    place_count: usize,
    /// Share of pairs of places that are cut off without each means.
    needs: Vec<(&'static str, f64)>,
}

impl Stats {
    fn of(reach: &Reach) -> Self {
        let all = reach.share_by(|_| true);
        Self {
            walk: reach.share_on_foot(),
            all,
            island_count: reach.ground.islands().len(),
            place_count: reach.ground.cells().len(),
            needs: Means::ALL
                .iter()
                .copied()
                .map(|means| (means.name(), all - reach.share_by(|other| other != means)))
                .collect(),
        }
    }

    fn add_to(&self, description: &mut serde_json::Value) {
        description["walk_connected"] = self.walk.into();
        description["all_connected"] = self.all.into();
        description["islands"] = self.island_count.into();
        description["places"] = self.place_count.into();
        description["cut_off_without"] = serde_json::json!(self.needs.iter().copied().collect::<BTreeMap<_, _>>());
    }

    fn print(&self) {
        println!("random goals connected on foot: {:.1} %", self.walk * 100.0);
        println!("random goals connected by every means: {:.1} %", self.all * 100.0);
        println!("{} islands among {} places to stand (1.25 m apart)", self.island_count, self.place_count);
        let mut needs: Vec<_> = self.needs.iter().filter(|(_, share)| *share >= 0.0005).collect();
        needs.sort_by(|a, b| b.1.total_cmp(&a.1));
        let needs = needs.iter().map(|(name, share)| format!("{} {:.1} %", name.replace('_', " "), share * 100.0));
        println!("cut off without: {}", needs.collect::<Vec<_>>().join(", "));
    }
}
