//! `surefoot graph reach` and `diff`: reachability as a check.

use super::{Loaded, Target};
use crate::commands::map::{Source, check_scale};
use crate::commands::{core_count, parse_share};
use crate::terminal::{print_json, with_spinner};
use anyhow::{Context, bail};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use surefoot_planner::NavGraph;
use surefoot_planner::export::{frame_of, import_json};
use surefoot_planner::reachability::{Connection, Difference, Island, compare_levels, describe, reached_from_main};
use surefoot_report::render::Picture;
use surefoot_world::map::LevelFrame;
use surefoot_world::reach::{Means, PlayArea, Reach};
use surefoot_world::{DVec3, Vec3};

/// Find places that no character reaches.
///
/// The report has two parts: geometry (a survey of every place to stand, with scripted leaps) and the graph (what the
/// policy has proved).
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot graph reach 2000\n  \
        surefoot graph reach level.sfmap --png reach.png\n  \
        surefoot graph reach level.sfmap --min-reachable 0.98 --min-connected 0.95 --max-traps 0 --junit reach.xml")]
pub struct Args {
    #[command(flatten)]
    target: Target,
    /// Fail if a smaller share of all places to stand can be reached from the level's spawn points, or without any
    /// from the largest region
    #[arg(long, value_name = "SHARE", value_parser = parse_share::<f64>)]
    min_reachable: Option<f64>,
    /// Fail if a smaller share of ordered vertex pairs has a path
    #[arg(long, value_name = "SHARE", value_parser = parse_share::<f64>)]
    min_connected: Option<f64>,
    /// Fail if the graph has more one-way traps than this
    #[arg(long, value_name = "N")]
    max_traps: Option<usize>,
    /// Write the checks as JUnit XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Draw coverage from above: the distance of each place from the nearest reached vertex
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Pixels per metre in the picture
    #[arg(long, default_value_t = 4.0, value_name = "PIXELS")]
    pixels_per_m: f32,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Most regions of unreached ground that are listed.
const LISTED: usize = 20;
/// Smallest unreached region that is listed, in places of 1.25 m x 1.25 m.
const LISTED_PLACES: u64 = 8;
/// Distance from a vertex at which a place counts as not covered, m.
const FAR_M: f32 = 20.0;

#[derive(Serialize)]
struct Report {
    map: String,
    /// Share of places to stand that can be reached from where play begins, by geometry.
    reachable: f64,
    /// Share of ordered pairs of places that are connected only with each means.
    lost_without: BTreeMap<String, f64>,
    /// Ground that cannot be reached, the largest first.
    unreached: Vec<Unreached>,
    graph: Connection,
    checks: Vec<Check>,
}

#[derive(Serialize)]
struct Unreached {
    places: u64,
    at: Vec3,
    /// The same in the level's own coordinates, if they are not those of the map.
    #[serde(skip_serializing_if = "Option::is_none")]
    at_in_level: Option<DVec3>,
}

impl Unreached {
    fn describe(&self, frame: &LevelFrame) -> String {
        format!("not reached: {} places around {}", self.places, frame.describe(self.at))
    }
}

#[derive(Serialize)]
struct Check {
    name: &'static str,
    passed: bool,
    message: String,
    /// Where to look, if the check has failed: a line for each place.
    #[serde(skip)]
    places: Vec<String>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let loaded = args.target.load(None)?;
    let Loaded { context, graph, .. } = &loaded;
    check_scale(args.pixels_per_m, &context.map)?;
    let survey =
        with_spinner("surveying the level", || Reach::survey_far(&context.map, &context.profile, core_count()));
    let frame = context.map.frame();
    let area = PlayArea::of(&context.map, &context.profile, &survey);
    let report = args.report((&survey, &area), graph, frame);
    if let Some(path) = &args.png {
        draw(&loaded, (&survey, &area), args.pixels_per_m).save(path)?;
    }
    if let Some(path) = &args.junit {
        std::fs::write(path, junit(&report)).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if args.json {
        print_json(&report)?;
    } else {
        print_report(&report, frame);
    }
    let failed: Vec<&str> =
        report.checks.iter().filter(|check| !check.passed).map(|check| check.message.as_str()).collect();
    if !failed.is_empty() {
        bail!("{}", failed.join("; "));
    }
    Ok(())
}

impl Args {
    fn report(&self, (survey, area): (&Reach, &PlayArea), graph: &NavGraph, frame: &LevelFrame) -> Report {
        let cells = survey.ground.cells();
        let reached = cells.iter().filter(|cell| area.reaches(cell.island)).count();
        let reachable = reached as f64 / cells.len().max(1) as f64;
        let all = survey.share_by(|_| true);
        let lost_without = Means::ALL
            .iter()
            .copied()
            .map(|means| (means.name().to_owned(), (all - survey.share_by(|other| other != means)).max(0.0)));
        let graph = describe(graph).in_level(frame);
        let unreached = unreached((survey, area), frame);
        let lines = |is_listed: &dyn Fn(&Island) -> bool| {
            let listed = graph.islands.iter().skip(1).filter(|island| is_listed(island)).take(LISTED);
            listed.map(|island| describe_island(island, frame)).collect()
        };
        let mut checks = self.checks(reachable, &graph);
        for check in checks.iter_mut().filter(|check| !check.passed) {
            check.places = match check.name {
                "reachable" => unreached.iter().map(|region| region.describe(frame)).collect(),
                "traps" => lines(&Island::is_trap),
                _ => lines(&|_| true),
            };
        }
        Report {
            map: self.target.source.map.clone(),
            reachable,
            lost_without: lost_without.filter(|(_, lost)| *lost > 0.0).collect(),
            unreached,
            checks,
            graph,
        }
    }

    fn checks(&self, reachable: f64, graph: &Connection) -> Vec<Check> {
        let mut checks = Vec::new();
        if let Some(least) = self.min_reachable {
            let message =
                format!("{:.2} % of places can be reached, at least {:.2} % must", 100.0 * reachable, 100.0 * least);
            checks.push(Check::new("reachable", reachable >= least, message));
        }
        if let Some(least) = self.min_connected {
            let connected = graph.connected;
            let message = format!(
                "{:.2} % of vertex pairs are connected, at least {:.2} % must",
                100.0 * connected,
                100.0 * least
            );
            checks.push(Check::new("connected", connected >= least, message));
        }
        if let Some(most) = self.max_traps {
            let traps = graph.islands.iter().filter(|island| island.is_trap()).count();
            let message = format!("{traps} one-way traps, at most {most} allowed");
            checks.push(Check::new("traps", traps <= most, message));
        }
        checks
    }
}

impl Check {
    fn new(name: &'static str, passed: bool, message: String) -> Self {
        Self { name, passed, message, places: Vec::new() }
    }
}

/// Regions that cannot be reached from where play begins.
fn unreached((survey, area): (&Reach, &PlayArea), frame: &LevelFrame) -> Vec<Unreached> {
    let mut found: BTreeMap<u32, Unreached> = BTreeMap::new();
    for cell in survey.ground.cells().iter().filter(|cell| !area.reaches(cell.island)) {
        let begin = || Unreached { places: 0, at: cell.feet, at_in_level: frame.other_place(cell.feet) };
        found.entry(area.region_of(cell.island)).or_insert_with(begin).places += 1;
    }
    let mut found: Vec<Unreached> = found.into_values().filter(|region| region.places >= LISTED_PLACES).collect();
    found.sort_by_key(|region| std::cmp::Reverse(region.places));
    found.truncate(LISTED);
    found
}

fn describe_island(island: &Island, frame: &LevelFrame) -> String {
    let kind = match (island.entered, island.left) {
        (true, false) => "one-way trap",
        (false, true) => "never entered",
        (false, false) => "cut off",
        (true, true) => "joined",
    };
    format!("{kind}: {} vertices around {}", island.vertices, frame.describe(island.at))
}

fn print_report(report: &Report, frame: &LevelFrame) {
    println!(
        "map {}: {:.2} % of all places to stand can be reached, by geometry",
        report.map,
        100.0 * report.reachable
    );
    for (means, lost) in &report.lost_without {
        println!("  without {}: {:.1} % of place pairs are cut off", means.replace('_', " "), 100.0 * lost);
    }
    for region in &report.unreached {
        println!("  {}", region.describe(frame));
    }
    let graph = &report.graph;
    println!(
        "graph: {} vertices, {} edges, {} islands, {:.2} % of vertex pairs connected",
        graph.vertices,
        graph.edges,
        graph.islands.len(),
        100.0 * graph.connected
    );
    for (ability, lost) in &graph.lost_without {
        println!("  without {}: {:.1} % of vertex pairs are cut off", ability.replace('_', " "), 100.0 * lost);
    }
    for island in graph.islands.iter().skip(1).take(LISTED) {
        println!("  {}", describe_island(island, frame));
    }
    for check in &report.checks {
        println!("{} {}: {}", if check.passed { "ok" } else { "FAILED" }, check.name, check.message);
    }
}

fn junit(report: &Report) -> String {
    let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    let failures = report.checks.iter().filter(|check| !check.passed).count();
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuite name=\"reachability of {}\" tests=\"{}\" \
         failures=\"{failures}\">\n",
        escape(&report.map),
        report.checks.len()
    );
    for check in &report.checks {
        write!(xml, "  <testcase classname=\"surefoot.reach\" name=\"{}\"", check.name)
            .expect("a String takes everything");
        xml += &if check.passed {
            "/>\n".to_owned()
        } else {
            let places: String = check.places.iter().map(|place| escape(place) + "\n").collect();
            format!("><failure message=\"{}\">\n{places}</failure></testcase>\n", escape(&check.message))
        };
    }
    xml + "</testsuite>\n"
}

/// Draws places by their distance to the nearest vertex reached from the main island; red where geometry finds no path.
fn draw(loaded: &Loaded, (survey, area): (&Reach, &PlayArea), scale: f32) -> Picture {
    let Loaded { context, graph, .. } = loaded;
    let reached: Vec<Vec3> = graph
        .vertices()
        .zip(reached_from_main(graph))
        .filter(|(_, reached)| *reached)
        .map(|(vertex, _)| graph.position(vertex))
        .collect();
    let mut picture = Picture::top_view(&context.map, scale);
    let radius = (0.9 * scale).max(1.0);
    for cell in survey.ground.cells() {
        let colour = if area.reaches(cell.island) {
            let nearest = reached.iter().map(|vertex| vertex.distance(cell.feet)).fold(FAR_M, f32::min);
            let far = nearest / FAR_M;
            [(40.0 + 215.0 * far) as u8, (200.0 - 60.0 * far) as u8, 60]
        } else {
            [220, 20, 40]
        };
        picture.dot(cell.feet, radius, colour);
    }
    for vertex in reached {
        picture.dot(vertex, 1.5, [250, 250, 250]);
    }
    let far = format!("{FAR_M} m from a reached vertex");
    let entries = [
        ([40, 200, 60], "at a reached vertex"),
        ([255, 140, 60], far.as_str()),
        ([220, 20, 40], "no path, by geometry"),
    ];
    picture.add_legend(&format!("map {}", loaded_name(loaded)), &entries);
    picture
}

fn loaded_name(loaded: &Loaded) -> String {
    loaded.context.map.spec().map_or_else(|| loaded.context.map.hash().to_string(), |spec| spec.seed.to_string())
}

/// Compare what is reachable in two versions of a level.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot graph diff level.sfmap changed.sfmap\n  \
        surefoot graph diff before.json after.json --fail-on-loss   # files of graph export --format json")]
pub struct DiffArgs {
    #[command(flatten)]
    before: Target,
    /// The later version: a seed, the file of a map, or a graph exported as JSON, as for the earlier version
    #[arg(value_name = "SEED|FILE")]
    after: String,
    /// Fail if places can no longer be reached
    #[arg(long)]
    fail_on_loss: bool,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub fn diff(args: &DiffArgs) -> anyhow::Result<()> {
    let load = |source: &Source| -> anyhow::Result<(NavGraph, Option<LevelFrame>)> {
        let map = &source.map;
        if Path::new(map).extension().is_some_and(|extension| extension == "json") {
            let text = std::fs::read_to_string(map).with_context(|| format!("cannot read {map}"))?;
            let graph = import_json(&text).with_context(|| format!("cannot use {map}"))?;
            return Ok((graph, frame_of(&text)));
        }
        let target = Target { source: source.clone(), ..args.before.clone() };
        let Loaded { graph, context, .. } = target.load(None)?;
        Ok((graph, source.frame_of(&context.map)))
    };
    let [before, after] = args.before.source.versions(&args.after)?;
    let (before, after) = (load(&before)?, load(&after)?);
    // A version that does not say where its level lies is taken to lie where the other one does.
    let frame_before = before.1.or(after.1).unwrap_or_default();
    let frame_after = after.1.unwrap_or(frame_before);
    let difference = compare_levels((&before.0, &frame_before), (&after.0, &frame_after));
    if args.json {
        print_json(&difference)?;
    } else {
        print_difference(&difference, [&frame_before, &frame_after]);
    }
    if args.fail_on_loss && !difference.lost.is_empty() {
        bail!("{} places can no longer be reached", difference.lost.len());
    }
    Ok(())
}

fn print_difference(difference: &Difference, [frame_before, frame_after]: [&LevelFrame; 2]) {
    println!(
        "vertex pairs connected: {:.2} % before, {:.2} % after; islands: {} before, {} after",
        100.0 * difference.connected_before,
        100.0 * difference.connected_after,
        difference.islands.0,
        difference.islands.1
    );
    let lists = [("lost", &difference.lost, frame_before), ("gained", &difference.gained, frame_after)];
    for (what, places, frame) in lists {
        println!("{what}: {} places", places.len());
        places.iter().take(LISTED).for_each(|at| println!("  {}", frame.describe(*at)));
    }
}
