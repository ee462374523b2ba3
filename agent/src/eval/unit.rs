//! Units: all goals of one map and seed, each attempted once.

use super::config::{EvalConfig, EvalError, EvalMap, MapName, Method, Price};
use super::reachable::{Terrain, reachable};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use surefoot_planner::search::DEFAULT_TABLE_LIMIT;
use surefoot_planner::settings::BUILDER_VERSION;
use surefoot_planner::{BuildSettings, Built, Progress, Router};
use surefoot_policy::Policy;
use surefoot_policy::checkpoint::write_atomically;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::attempts::Figures;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{Attempt, Goal, Motion, Rollout};
use surefoot_world::reach::Reach;
use surefoot_world::{End, Map, TaskConfig, navigable};

/// Number of navigable points that the goals of one map are drawn from.
const POINTS_PER_MAP: usize = 3000;
/// Most goals in a batch. Independent of the number of threads, so that results are too.
const GOALS_PER_BATCH: usize = 128;
/// Version of unit results; incremented when a run would no longer reproduce saved units.
const VERSION: u32 = 6;

/// The attempts at all goals of one map and seed, the nearest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Name of the map.
    pub map: MapName,
    /// Seed of goals, graph and noise.
    pub seed: u64,
    /// Straight-line distance of each goal, m, ascending.
    pub distances: Vec<f32>,
    /// Whether each goal can be reached: a survey or a proved edge connects it with the start, or the attempt did.
    pub reachable: Vec<bool>,
    /// Result of the attempt at each goal.
    pub attempts: Vec<Attempt>,
    /// How the NPCs moved.
    pub motion: Motion,
    /// Figures of the graph, if one was used.
    pub graph: Option<GraphFigures>,
}

/// Figures of a graph, or means over graphs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GraphFigures {
    /// Number of vertices.
    pub vertices: f64,
    /// Number of proved edges.
    pub edges: f64,
    /// Number of islands.
    pub islands: f64,
    /// Share of ordered vertex pairs with a path.
    pub connected: f64,
    /// Build time, s.
    pub build_s: f64,
    /// Number of probes.
    pub probes: f64,
    /// Number of candidate edges.
    pub candidates: f64,
    /// Wall time of all attempts together, s.
    pub eval_s: f64,
    /// Median duration of a search, us.
    pub search_us_median: f64,
}

/// A map, what a character can reach on it, and the graphs of it that were built so far.
pub struct Surveyed {
    map: Arc<Map>,
    reach: Reach,
    /// By everything that determines them.
    graphs: HashMap<String, Built>,
}

impl Surveyed {
    /// The graph of this map with these settings; built for the first unit that needs it.
    fn graph(&mut self, policy: &Policy, config: &EvalConfig, settings: BuildSettings) -> Result<&Built, EvalError> {
        let key = format!("{} {} {settings:?}", policy.weights_hash(), policy.senses_transports());
        Ok(match self.graphs.entry(key) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => {
                let context =
                    ProbeContext { map: self.map.clone(), profile: config.profile.clone(), policy: policy.clone() };
                free.insert(build(&context, &settings, config.thread_count, &Progress::default())?)
            }
        })
    }
}

/// Loads a saved unit, or runs and saves it. `surveyed` caches the map between units.
///
/// # Errors
/// As for [`super::evaluate`].
pub fn load_or_run(
    policy: &Policy,
    config: &EvalConfig,
    choice: &EvalMap,
    seed: u64,
    surveyed: &mut Option<Surveyed>,
) -> Result<Unit, EvalError> {
    let path = config.keep_in.as_ref().map(|folder| folder.join(format!("{}.json", key(policy, config, choice, seed))));
    if let Some(unit) = path.as_deref().and_then(|path| load(path, config.goals)) {
        return Ok(unit);
    }
    let surveyed = surveyed.get_or_insert_with(|| {
        let map = choice.load();
        let reach = Reach::survey_far(&map, &config.profile, config.thread_count);
        Surveyed { map, reach, graphs: HashMap::new() }
    });
    let unit = run(policy, config, choice, surveyed, seed)?;
    if let Some(path) = path {
        let bytes = serde_json::to_vec(&unit).expect("a unit is plain data");
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder)
            .and_then(|()| write_atomically(&path, &bytes).map_err(std::io::Error::other))
            .map_err(|source| EvalError::Io { path, source })?;
    }
    Ok(unit)
}

/// File name of a unit, which depends on everything that determines its result.
fn key(policy: &Policy, config: &EvalConfig, choice: &EvalMap, seed: u64) -> String {
    let EvalConfig { goals, method, distance, noise_share, rehearses, follow, price, profile, .. } = config;
    let map = choice.identity();
    let text = format!(
        "{VERSION} {} {} {map} {seed} {goals} {method:?} {distance:?} {noise_share} {rehearses} {follow:?} {price:?} {:?} {:?}{}",
        policy.weights_hash(),
        policy.senses_transports(),
        TaskConfig::default(),
        profile,
        if *method == Method::Policy { String::new() } else { format!(" {BUILDER_VERSION}") },
    );
    format!("{}-{}-{seed}-{}", method.name(), choice.seed(), &blake3::hash(text.as_bytes()).to_hex()[..16])
}

/// Loads a unit; `None` if it is missing, damaged or incomplete.
fn load(path: &Path, goal_count: usize) -> Option<Unit> {
    let unit: Unit = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
    (unit.attempts.len() == goal_count && unit.distances.len() == goal_count).then_some(unit)
}

fn run(
    policy: &Policy,
    config: &EvalConfig,
    choice: &EvalMap,
    surveyed: &mut Surveyed,
    seed: u64,
) -> Result<Unit, EvalError> {
    let goals = draw_goals(&surveyed.map, config, choice, seed)?;
    let built = match config.method {
        Method::Policy => None,
        Method::Graph(settings) => Some(surveyed.graph(policy, config, settings.with_seed(seed))?),
    };
    let stats = built.map(|built| built.stats);
    let router = built.map(|built| {
        let graph = match config.price {
            Price::Risk => built.graph.clone(),
            Price::Steps => built.graph.priced_by_steps(),
        };
        Router::new(graph, DEFAULT_TABLE_LIMIT, config.thread_count)
    });
    let Surveyed { map, reach, .. } = surveyed;
    let started = Instant::now();
    let terrain = Terrain { map, profile: &config.profile, reach };
    let mut reachable = reachable(&terrain, router.as_ref(), &goals);
    let (attempts, Figures { mut search_us, motion }) = run_goals(policy, map, router.as_ref(), &goals, config, seed);
    // A goal that was reached can be reached, whatever the survey says.
    for (reachable, attempt) in reachable.iter_mut().zip(&attempts) {
        *reachable |= attempt.end == End::Reached;
    }
    let eval_s = started.elapsed().as_secs_f64();
    search_us.sort_unstable_by(f64::total_cmp);
    let graph = router.zip(stats).map(|(router, stats)| GraphFigures {
        vertices: router.graph().vertex_count() as f64,
        edges: router.graph().edge_count() as f64,
        islands: f64::from(router.graph().island_count()),
        connected: router.graph().connected_share(),
        build_s: stats.seconds,
        probes: stats.probes as f64,
        candidates: stats.candidates as f64,
        search_us_median: search_us[search_us.len() / 2],
        eval_s,
    });
    let distances = goals.iter().map(Goal::distance).collect();
    Ok(Unit { map: choice.name(), seed, distances, reachable, attempts, motion, graph })
}

fn draw_goals(map: &Map, config: &EvalConfig, choice: &EvalMap, seed: u64) -> Result<Vec<Goal>, EvalError> {
    let mut rng = ChaCha8Rng::seed_from_u64(choice.seed());
    rng.set_stream(1000 + seed);
    let points = navigable::sample_many(map, &config.profile, POINTS_PER_MAP, &mut rng)?;
    let mut goals = Goal::draw(&points, config.distance.clone(), config.goals, &mut rng);
    if goals.len() < config.goals {
        return Err(EvalError::NoGoals(choice.name()));
    }
    goals.sort_by(|a, b| a.distance().total_cmp(&b.distance()));
    Ok(goals)
}

/// Distributes the goals over threads. Every batch mixes near and far goals, so that batches take similar times.
fn run_goals(
    policy: &Policy,
    map: &Arc<Map>,
    router: Option<&Router>,
    goals: &[Goal],
    config: &EvalConfig,
    seed: u64,
) -> (Vec<Attempt>, Figures) {
    let batch_count = goals.len().div_ceil(GOALS_PER_BATCH);
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::from_iter((0..batch_count).map(|_| None)));
    std::thread::scope(|scope| {
        for _ in 0..config.thread_count.max(1) {
            scope.spawn(|| {
                loop {
                    let idx = next.fetch_add(1, Ordering::Relaxed);
                    if idx >= batch_count {
                        return;
                    }
                    let batch: Vec<Goal> = goals.iter().skip(idx).step_by(batch_count).copied().collect();
                    let mut rollout = Rollout::new(map.clone(), config.profile.clone(), TaskConfig::default());
                    rollout.noise_share = config.noise_share;
                    (rollout.rehearses, rollout.follow) = (config.rehearses, config.follow);
                    rollout.seed = seed.wrapping_mul(1_000_003).wrapping_add(idx as u64);
                    let mut figures = Figures::default();
                    let attempts = rollout.measure(policy, router, &batch, &mut figures);
                    results.lock().expect("no rollout panics")[idx] = Some((attempts, figures));
                }
            });
        }
    });
    let batches: Vec<(Vec<Attempt>, Figures)> =
        results.into_inner().expect("no rollout panics").into_iter().flatten().collect();
    let attempts = (0..goals.len()).map(|idx| batches[idx % batch_count].0[idx / batch_count]).collect();
    let mut figures = Figures::default();
    for (_, of_batch) in batches {
        figures.search_us.extend(of_batch.search_us);
        figures.motion.add(&of_batch.motion);
    }
    (attempts, figures)
}
