//! The suites with tables of their own.

use super::args::Args;
use super::results::Results;
use surefoot_cli::commands::load_policy;
use surefoot_cli::commands::map::parse_specs;
use surefoot_cli::terminal::with_bar;
use surefoot_eval::ablation::{self, Policies};
use surefoot_eval::living::{self, LivingConfig};
use surefoot_eval::suite::{self, Entry};
use surefoot_eval::variants::{self, Variant};
use surefoot_eval::{EvalConfig, EvalMap, Method};
use surefoot_planner::{Placement, Probing};
use surefoot_policy::Policy;
use surefoot_world::{Arrival, MapSpec};

/// The rows of the paper's table for which `--models` has weights.
fn paper_entries(args: &Args) -> anyhow::Result<Vec<Entry>> {
    let load = |name: &str| -> anyhow::Result<Option<Policy>> {
        let folder = args.models.join(name);
        if !folder.exists() {
            eprintln!("no {}: its row is omitted", folder.display());
            return Ok(None);
        }
        load_policy(Some(&folder)).map(|policy| Some(args.rules.apply(policy)))
    };
    let maps = args.specs("test")?;
    let mut specific = Vec::new();
    for spec in &maps {
        specific.extend(load(&format!("lstm-map-{}", spec.seed))?.map(|policy| (policy, vec![*spec])));
    }
    let (reactive, recurrent) = (load("general-reactive")?, load("general-lstm")?);
    // The paper's graphs are those of its LSTM.
    let follower = if args.rules.faithful { &recurrent } else { &reactive };
    let mut entries = Vec::new();
    let mut push = |name, method, models: Vec<(Policy, Vec<MapSpec>)>| {
        if !models.is_empty() {
            entries.push(Entry { name, method, models });
        }
    };
    let on_all = |policy: Option<Policy>| policy.map(|policy| (policy, maps.clone())).into_iter().collect::<Vec<_>>();
    push("map-specific LSTM", Method::Policy, specific);
    push("general reactive", Method::Policy, on_all(reactive.clone()));
    push("general LSTM", Method::Policy, on_all(recurrent.clone()));
    let rows = [
        ("unconstrained random graph", Placement::Random),
        ("distance-constrained graph", Placement::Spaced),
        ("density-based graph", Placement::Density),
        ("trajectory merging graph", Placement::Trajectories),
        ("trajectory merging graph with edge tests", Placement::TrajectoriesTested),
        ("flood graph", Placement::Flood),
        ("flood graph with grandchild edges", Placement::FloodGrandchildren),
    ];
    for (name, placement) in rows {
        let settings = args.rules.graph(args.graph.settings()?)?.with(|it| {
            it.probing = Probing::Exhaustive;
            (it.special_moves, it.arrival) = (false, Arrival::Touch);
            it.placement = placement;
        })?;
        push(name, Method::Graph(settings), on_all(follower.clone()));
    }
    if !args.rules.faithful {
        push("ours: frugal, with special moves", Method::Graph(args.graph.settings()?), on_all(reactive));
    }
    Ok(entries)
}

/// The paper's table.
pub fn paper(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let entries = paper_entries(args)?;
    let splits = [("training", parse_specs("0..4", args.generated.size)?)].into_iter().chain([
        ("validation", parse_specs("validation", args.generated.size)?),
        ("test", parse_specs("test", args.generated.size)?),
    ]);
    let report = with_bar("evaluating", |bar| suite::run(&entries, &splits.collect::<Vec<_>>(), base, bar))?;
    Ok(Results::Paper(report))
}

fn eval_maps(text: &str, side: u32) -> anyhow::Result<Vec<EvalMap>> {
    Ok(parse_specs(text, side)?.into_iter().map(EvalMap::from).collect())
}

/// Crowds, doors, lifts, platforms, floors that vanish, players, and chases.
pub fn living(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let policy = load_policy(Some(&args.models.join("general-reactive")))?;
    let scenes = args.scene.clone();
    let scene_count = if scenes.is_empty() { living::SCENES.len() } else { scenes.len() };
    let (thread_count, settings) = (base.thread_count, args.graph.settings()?);
    let config = LivingConfig { scenes, runs: args.runs, thread_count, settings };
    let report = with_bar("evaluating", |bar| {
        let mut begun = 0;
        living::run(&policy, &config, |scene| {
            begun += 1;
            bar(scene, begun, scene_count);
        })
    })?;
    Ok(Results::Living(report))
}

/// What each of our choices adds.
pub fn ablation(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let load = |name: &str| load_policy(Some(&args.models.join(name)));
    let policies = Policies { recurrent: load("general-lstm")?, reactive: load("general-reactive")? };
    let settings = args.graph.settings()?;
    let report = with_bar("evaluating", |bar| {
        ablation::run(&policies, base, settings, |done, total| bar("evaluating", done, total))
    })?;
    Ok(Results::Ablation(Box::new(report)))
}

/// Success and run time over numbers of vertices and neighbours.
pub fn sweep(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let base = EvalConfig { maps: eval_maps("validation", args.generated.size)?, ..base.clone() };
    let policy = load_policy(Some(&args.models.join("general-reactive")))?;
    Ok(Results::Sweep(run_variants(&base, &variants::sweep(&policy), 25.0)?))
}

/// Seed and side in metres of the large map; the paper's has 1 km.
const BIG_MAP: (u64, u32) = (3000, 1000);
/// Numbers of vertices of the large map's graphs, as in the paper.
const BIG_VERTICES: [usize; 4] = [200, 400, 800, 1600];
/// Nearest neighbours that each vertex forms candidate edges with.
const BIG_NEIGHBOURS: usize = 20;

/// The 1 km map: the policy trained on it without a graph and with graphs of growing size, then the general policy.
pub fn big_map(args: &Args, base: &EvalConfig) -> anyhow::Result<Results> {
    let (seed, side) = BIG_MAP;
    let base = EvalConfig { maps: eval_maps(&seed.to_string(), side)?, ..base.clone() };
    let specific = load_policy(Some(&args.models.join(format!("lstm-map-{seed}"))))?;
    let general = load_policy(Some(&args.models.join("general-reactive")))?;
    let graph = |vertices| -> anyhow::Result<Method> {
        let settings = args.graph.settings()?.with(|it| {
            it.vertices = vertices;
            it.neighbours = BIG_NEIGHBOURS;
        });
        Ok(Method::Graph(settings?))
    };
    let mut entries = vec![Variant { name: "no graph".to_owned(), policy: specific.clone(), method: Method::Policy }];
    for vertices in BIG_VERTICES {
        let name = format!("{vertices} vertices");
        entries.push(Variant { name, policy: specific.clone(), method: graph(vertices)? });
    }
    let most = BIG_VERTICES[BIG_VERTICES.len() - 1];
    let name = format!("{most} vertices, general weights");
    entries.push(Variant { name, policy: general, method: graph(most)? });
    Ok(Results::BigMap(run_variants(&base, &entries, 100.0)?))
}

fn run_variants(base: &EvalConfig, entries: &[Variant], bin_m: f32) -> anyhow::Result<Vec<variants::Outcome>> {
    Ok(with_bar("evaluating", |bar| variants::run(entries, base, bin_m, bar))?)
}
