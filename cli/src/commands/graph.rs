//! `surefoot graph`.

use super::services::{GraphArgs, cache_folder};
use super::{core_count, load_policy};
use crate::render::Picture;
use crate::terminal::{print_json, progress_bar};
use anyhow::bail;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use surefoot_agent::follow::{FollowConfig, Follower};
use surefoot_agent::rollout::{DEFAULT_NOISE_SHARE, follow, plan};
use surefoot_planner::build::{GraphId, Progress, build};
use surefoot_planner::cache::{DiskStore, GraphStore};
use surefoot_planner::probe::ProbeContext;
use surefoot_planner::search::DEFAULT_TABLE_LIMIT;
use surefoot_planner::{Ability, BuildSettings, Built, NavGraph, Router};
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, End, Map, MapSpec, OBSERVATION_LEN, TaskConfig, Vec3, World, navigable};

/// Build and look at graphs.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Build the graph of a map into the cache, or find it there, and describe or draw it.
    Build(Args),
    /// The same as build.
    Show(Args),
}

/// Build the graph of a map into the cache, or find it there, and describe or draw it.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  surefoot graph build 2000\n  surefoot graph show 2000 --png graph.png --tracks 24\n  surefoot graph build 7 --vertices 800 --neighbours 20 --json"
)]
pub struct Args {
    /// Seed of the map
    seed: u64,
    /// Side in metres
    #[arg(long, default_value_t = 250, value_name = "METRES")]
    size: u32,
    #[command(flatten)]
    graph: GraphArgs,
    /// Folder of the graph cache; default: surefoot in the user's cache folder
    #[arg(long, value_name = "FOLDER", env = "SUREFOOT_CACHE")]
    cache: Option<PathBuf>,
    /// Folder of the model, or general-reactive or general-lstm; default: general-reactive
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Draw map and graph from above into this file
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Also run so many NPCs to random goals by plan and draw their tracks
    #[arg(long, default_value_t = 0, value_name = "N", requires = "png")]
    tracks: usize,
    /// Pixels per metre of the picture
    #[arg(long, default_value_t = 4.0)]
    scale: f32,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    let (Command::Build(args) | Command::Show(args)) = command;
    if !(0.1..=16.0).contains(&args.scale) || args.scale * args.size as f32 > 8192.0 {
        bail!("--scale is {}, allowed are 0.1 to 16 and at most 8192 pixels a side", args.scale);
    }
    let settings = args.graph.settings();
    settings.validate()?;
    let context = ProbeContext {
        map: Arc::new(Map::generate(&MapSpec::with_side(args.seed, args.size))?),
        profile: CharacterProfile::default(),
        policy: load_policy(args.model.as_deref())?,
    };
    let id = GraphId::of(&context, &settings);
    let store = DiskStore::open(&cache_folder(args.cache.as_deref())?)?;
    let (built, cached) = match store.get(&id)? {
        Some(built) => (built, true),
        None => {
            let built = build_with_bar(&context, &settings)?;
            store.put(&id, &built)?;
            (built, false)
        }
    };
    if let Some(path) = &args.png {
        let router = Router::new(built.graph.clone(), DEFAULT_TABLE_LIMIT, core_count());
        let mut picture = Picture::top_view(&context.map, args.scale);
        draw_graph(&mut picture, &built.graph);
        let arrived = draw_tracks(&mut picture, &context.map, &context.policy, &router, args.tracks)?;
        picture.save(path)?;
        if args.tracks > 0 && !args.json {
            println!("{arrived} of {} NPCs arrived", args.tracks);
        }
    }
    describe(args, &id, &built, cached)
}

fn build_with_bar(context: &ProbeContext, settings: &BuildSettings) -> anyhow::Result<Built> {
    let progress = Progress::default();
    let bar = progress_bar(0, "probing");
    let built = std::thread::scope(|scope| {
        let building = scope.spawn(|| build(context, settings, core_count(), &progress));
        while !building.is_finished() {
            bar.set_length(progress.total.load(Ordering::Relaxed));
            bar.set_position(progress.done.load(Ordering::Relaxed));
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        building.join().expect("the build does not panic")
    })?;
    bar.finish_and_clear();
    Ok(built)
}

fn describe(args: &Args, id: &GraphId, built: &Built, cached: bool) -> anyhow::Result<()> {
    let graph = &built.graph;
    let by_ability = |ability: Ability| graph.edges().filter(|edge| edge.evidence.ability == ability).count();
    let abilities = Ability::ALL;
    if args.json {
        let counts: serde_json::Map<_, _> =
            abilities.iter().map(|&a| (a.name().to_owned(), by_ability(a).into())).collect();
        return print_json(&serde_json::json!({
            "graph_id": id.to_string(),
            "map_seed": args.seed,
            "vertices": graph.vertex_count(),
            "edges": graph.edge_count(),
            "edges_by_ability": counts,
            "islands": graph.island_count(),
            "connected": graph.connected_share(),
            "candidates": built.stats.candidates,
            "probes": built.stats.probes,
            "build_s": built.stats.seconds,
            "cached": cached,
        }));
    }
    println!("graph {id}{}", if cached { " (from the cache)" } else { "" });
    println!(
        "{} vertices, {} edges, {} islands, {:.1} % of vertex pairs connected",
        graph.vertex_count(),
        graph.edge_count(),
        graph.island_count(),
        100.0 * graph.connected_share()
    );
    let counts: Vec<String> = abilities.iter().map(|&a| format!("{} {}", a.name(), by_ability(a))).collect();
    println!("edges by ability: {}", counts.join(", "));
    println!("{} probes in {:.1} s", built.stats.probes, built.stats.seconds);
    Ok(())
}

fn ability_colour(ability: Ability) -> [u8; 3] {
    match ability {
        Ability::Walk => [240, 240, 240],
        Ability::Jump => [90, 220, 255],
        Ability::DoubleJump => [70, 120, 255],
        Ability::Pad => [255, 220, 60],
        Ability::ZipLine => [255, 80, 200],
        Ability::Teleporter => [150, 80, 255],
        Ability::Jetpack => [80, 255, 220],
    }
}

fn draw_graph(picture: &mut Picture, graph: &NavGraph) {
    for edge in graph.edges() {
        let colour = ability_colour(edge.evidence.ability);
        picture.line(graph.position(edge.from), graph.position(edge.to), colour, 0.16);
    }
    for vertex in 0..graph.vertex_count() as u32 {
        picture.dot(graph.position(vertex), 1.5, [250, 250, 250]);
    }
}

/// Runs NPCs to random goals by plan, draws where they went, and returns how many arrived.
fn draw_tracks(
    picture: &mut Picture,
    map: &Arc<Map>,
    policy: &Policy,
    router: &Router,
    count: usize,
) -> anyhow::Result<usize> {
    const COLOURS: [[u8; 3]; 6] =
        [[255, 80, 160], [255, 150, 40], [160, 90, 255], [40, 230, 170], [255, 60, 60], [60, 200, 255]];
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let points = navigable::sample_many(map, &CharacterProfile::default(), 2 * count, &mut rng)?;
    let mut arrived = 0;
    for (idx, pair) in points.chunks_exact(2).enumerate() {
        let (track, reached) = run_one(map, policy, router, pair[0], pair[1], &mut rng);
        for step in track.windows(2) {
            for shift in [0.0, 0.25] {
                let aside = Vec3::new(shift, 0.0, shift);
                picture.line(step[0] + aside, step[1] + aside, COLOURS[idx % COLOURS.len()], 1.0);
            }
        }
        picture.dot(pair[0], 4.0, [20, 20, 20]);
        picture.dot(pair[1], 5.0, COLOURS[idx % COLOURS.len()]);
        arrived += usize::from(reached);
    }
    Ok(arrived)
}

fn run_one(
    map: &Arc<Map>,
    policy: &Policy,
    router: &Router,
    start: Vec3,
    goal: Vec3,
    rng: &mut ChaCha8Rng,
) -> (Vec<Vec3>, bool) {
    let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
    let slot = world.spawn(start, 0.0);
    let mut follower = Follower::new(goal, FollowConfig::default());
    let (mut row, mut actions, mut track) = (vec![0.0; OBSERVATION_LEN], Vec::new(), vec![start]);
    let mut memory = vec![0.0; policy.memory_len()];
    let mut search_us = Vec::new();
    let waypoint = plan(&mut follower, router, start, &mut search_us);
    world.set_goal(slot, waypoint);
    loop {
        world.observe(slot, &mut row);
        policy.act(&row, &mut memory, DEFAULT_NOISE_SHARE, rng, &mut actions);
        world.decide(slot, actions[0]);
        world.tick_decision();
        let leg_end = world.close_decision(slot).and_then(|outcome| outcome.end);
        track.push(world.npc(slot).expect("the only NPC").body.feet);
        if let Some(end) = follow(&mut world, slot, &mut follower, router, leg_end, &mut search_us) {
            return (track, end == End::Reached);
        }
    }
}
