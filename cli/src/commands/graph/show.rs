//! `surefoot graph build` and `show`.

use super::{Loaded, Target};
use crate::commands::core_count;
use crate::commands::map::check_scale;
use crate::terminal::print_json;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::path::PathBuf;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::{NavGraph, Router};
use surefoot_report::render::Picture;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::{Goal, Rollout};
use surefoot_world::{Ability, End, TaskConfig, Vec3, navigable};

/// Build the graph of a map, or take it from the cache, and describe or draw it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot graph build 2000\n  \
        surefoot graph show 2000 --png graph.png --tracks 24\n  \
        surefoot graph build 7 --vertices 800 --neighbours 20 --json\n  \
        surefoot graph build changed.sfmap --changed-from level.sfmap\n  \
        surefoot graph build level.glb --world http://127.0.0.1:7700 --json\n  \
        surefoot graph build level.obj --world tcp://127.0.0.1:7701")]
pub struct Args {
    #[command(flatten)]
    target: Target,
    /// Start from the graph of this earlier version of the map and probe only what changed
    #[arg(long, value_name = "SEED|FILE")]
    changed_from: Option<String>,
    /// Draw the map and the graph from above into this file
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Also run N NPCs to random goals by plan and draw their tracks
    #[arg(long, default_value_t = 0, value_name = "N", requires = "png")]
    tracks: usize,
    /// Pixels per metre in the picture
    #[arg(long, default_value_t = 4.0, value_name = "PIXELS")]
    pixels_per_m: f32,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let loaded = args.target.load(args.changed_from.as_deref())?;
    let Loaded { context, graph, .. } = &loaded;
    check_scale(args.pixels_per_m, &context.map)?;
    if let Some(path) = &args.png {
        let router = Router::new(graph.clone(), DEFAULT_LABEL_LIMIT, core_count());
        let mut picture = Picture::top_view(&context.map, args.pixels_per_m);
        draw_graph(&mut picture, graph);
        let arrived = draw_tracks(&mut picture, context, &router, args.tracks)?;
        picture.save(path)?;
        if args.tracks > 0 && !args.json {
            println!("{arrived} of {} NPCs arrived", args.tracks);
        }
    }
    describe(args, &loaded)
}

fn describe(args: &Args, loaded: &Loaded) -> anyhow::Result<()> {
    let Loaded { id, graph, stats, cached, unapplied, retried, of_draft, .. } = loaded;
    let by_ability = |ability: Ability| graph.edges().filter(|edge| edge.evidence.ability == ability).count();
    let counts = graph.abilities().map(|(ability, name)| (name, by_ability(ability))).filter(|(_, count)| *count > 0);
    if args.json {
        let counts: serde_json::Map<_, _> = counts.map(|(name, count)| (name.to_owned(), count.into())).collect();
        return print_json(&serde_json::json!({
            "graph_id": id.as_ref().map(ToString::to_string),
            "map": args.target.source.map,
            "vertices": graph.vertex_count(),
            "edges": graph.edge_count(),
            "edges_by_ability": counts,
            "islands": graph.island_count(),
            "connected": graph.connected_share(),
            "candidates": stats.candidates,
            "special_candidates": stats.special,
            "probes": stats.probes,
            "build_s": stats.seconds,
            "cached": cached,
            "retried": retried,
            "of_draft": of_draft,
            "unapplied_edits": unapplied.len(),
        }));
    }
    match id {
        Some(id) => println!("graph {id}{}", if *cached { " (from the cache)" } else { "" }),
        None => println!("graph proved in a game, which has no id"),
    }
    println!(
        "{} vertices, {} edges, {} islands, {:.1} % of vertex pairs connected",
        graph.vertex_count(),
        graph.edge_count(),
        graph.island_count(),
        100.0 * graph.connected_share()
    );
    let counts: Vec<String> = counts.map(|(name, count)| format!("{name} {count}")).collect();
    println!("edges by ability: {}", counts.join(", "));
    println!(
        "{} probes of {} candidates ({} from devices and ledges) in {:.1} s",
        stats.probes, stats.candidates, stats.special, stats.seconds
    );
    if let Some(of_draft) = of_draft {
        println!("{of_draft} edges, which plans hardly use, were proved here and not in the game");
    }
    if let Some(retried) = retried {
        println!("{retried} candidates were probed again because of changes");
    }
    loaded.print_unapplied();
    Ok(())
}

fn draw_graph(picture: &mut Picture, graph: &NavGraph) {
    let at = |vertex| graph.position(vertex);
    let edges = graph.edges().map(|edge| (at(edge.key.from), at(edge.key.to), edge.evidence.ability));
    picture.graph(graph.vertices().map(at), edges);
}

/// Runs NPCs to random goals by plan, draws their tracks, and returns how many arrived.
fn draw_tracks(
    picture: &mut Picture,
    ProbeContext { map, profile, policy }: &ProbeContext,
    router: &Router,
    count: usize,
) -> anyhow::Result<usize> {
    const COLOURS: [[u8; 3]; 6] =
        [[255, 80, 160], [255, 150, 40], [160, 90, 255], [40, 230, 170], [255, 60, 60], [60, 200, 255]];
    let points = navigable::sample_many(map, profile, 2 * count, &mut ChaCha8Rng::seed_from_u64(7))?;
    let goal = |pair: &[Vec3]| Goal { start: pair[0], yaw: 0.0, goal: pair[1] };
    let goals: Vec<Goal> = points.chunks_exact(2).map(goal).collect();
    let rollout = Rollout::new(map.clone(), profile.clone(), TaskConfig::default());
    let played = rollout.play(policy, Some(router), &goals);
    for ((goal, played), colour) in goals.iter().zip(&played).zip(COLOURS.iter().cycle()) {
        for step in played.track.windows(2) {
            for shift in [0.0, 0.25] {
                let aside = Vec3::new(shift, 0.0, shift);
                picture.line(step[0] + aside, step[1] + aside, *colour, 1.0);
            }
        }
        picture.dot(goal.start, 4.0, [20, 20, 20]);
        picture.dot(goal.goal, 5.0, *colour);
    }
    Ok(played.iter().filter(|played| played.attempt.end == End::Reached).count())
}
