//! The paper's evaluation protocol: random goals on whole maps, success by difficulty, failures by their end.

use crate::rollout::{Attempt, Goal, Rollout};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use surefoot_planner::build::{BuildError, BuildSettings, Progress, build};
use surefoot_planner::probe::ProbeContext;
use surefoot_policy::Policy;
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::{CharacterProfile, End, Map, MapSpec, SpecError, TaskConfig};

/// Navigable points that the goals of one map are drawn from.
const POINTS_PER_MAP: usize = 3000;

/// How goals are approached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The policy heads straight for the goal.
    Policy,
    /// The policy follows plans on a graph built so.
    Graph(BuildSettings),
}

/// What to evaluate.
#[derive(Debug, Clone)]
pub struct EvalConfig {
    /// Maps.
    pub maps: Vec<MapSpec>,
    /// Goals per map and seed.
    pub goals: usize,
    /// Seeds of goals, graphs and noise: one whole evaluation each.
    pub seeds: Vec<u64>,
    /// How goals are approached.
    pub method: Method,
    /// Straight-line distance of goals, m.
    pub distance: Range<f32>,
    /// Share of the policy's exploration noise to act with.
    pub noise_share: f32,
    /// Threads to use.
    pub thread_count: usize,
}

/// Why an evaluation cannot run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EvalError {
    /// A map spec is out of range.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// A map offers nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// A graph cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// No two points of a map have the wanted distance.
    #[error("map {0} has no goals at that distance")]
    NoGoals(u64),
}

/// A share of successes with its 95 % Wilson interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rate {
    /// Share that succeeded.
    pub rate: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Attempts.
    pub n: usize,
}

impl Rate {
    /// The rate of `successes` in `n` attempts.
    pub fn of(successes: usize, n: usize) -> Self {
        if n == 0 {
            return Self { rate: 0.0, low: 0.0, high: 1.0, n };
        }
        let (z, count) = (1.959_964f64, n as f64);
        let rate = successes as f64 / count;
        let centre = rate + z * z / (2.0 * count);
        let spread = z * (rate * (1.0 - rate) / count + z * z / (4.0 * count * count)).sqrt();
        let scale = 1.0 + z * z / count;
        Self { rate, low: ((centre - spread) / scale).max(0.0), high: ((centre + spread) / scale).min(1.0), n }
    }
}

/// Success by difficulty: thirds of each map's goals by distance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Success {
    /// All goals.
    pub all: Rate,
    /// The nearest third.
    pub easy: Rate,
    /// The middle third.
    pub medium: Rate,
    /// The farthest third.
    pub hard: Rate,
}

/// Mean figures of the graphs that were used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GraphFigures {
    /// Vertices.
    pub vertices: f64,
    /// Proved edges.
    pub edges: f64,
    /// Islands.
    pub islands: f64,
    /// Share of ordered vertex pairs with a path.
    pub connected: f64,
    /// Build time, s.
    pub build_s: f64,
    /// Probes run.
    pub probes: f64,
    /// Median duration of a search, us.
    pub search_us_median: f64,
}

/// The result of an evaluation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// `policy`, `random` or `spaced`.
    pub method: String,
    /// Name of the weights.
    pub model: String,
    /// Seeds of the maps.
    pub maps: Vec<u64>,
    /// Goals per map and seed.
    pub goals: usize,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// Success rates.
    pub success: Success,
    /// Standard deviation of the overall rate between seeds; absent with one seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Attempts by how they ended.
    pub ends: BTreeMap<&'static str, usize>,
    /// Mean seconds of successful attempts.
    pub seconds_to_goal: f64,
    /// Plans asked for beyond the first, per attempt.
    pub replans: f64,
    /// Figures of the graphs, where graphs are used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub graph: Option<GraphFigures>,
}

/// Which third of the goals an attempt belongs to.
struct Outcome {
    seed_idx: usize,
    third: usize,
    attempt: Attempt,
}

/// Runs the protocol; `progress` gets the attempts finished and their total.
///
/// # Errors
/// If a map, its goals or a graph cannot be made.
pub fn evaluate(
    policy: &Policy,
    config: &EvalConfig,
    mut progress: impl FnMut(usize, usize),
) -> Result<Report, EvalError> {
    let profile = CharacterProfile::default();
    let total = config.maps.len() * config.seeds.len() * config.goals;
    let mut outcomes: Vec<Outcome> = Vec::with_capacity(total);
    let (mut search_us, mut builds) = (Vec::new(), Vec::new());
    for spec in &config.maps {
        let map = Arc::new(Map::generate(spec)?);
        for (seed_idx, &seed) in config.seeds.iter().enumerate() {
            let goals = draw_goals(&map, &profile, config, spec.seed, seed)?;
            let graph = match config.method {
                Method::Policy => None,
                Method::Graph(settings) => {
                    let context = ProbeContext { map: map.clone(), profile: profile.clone(), policy: policy.clone() };
                    let settings = BuildSettings { seed, ..settings };
                    let built = build(&context, &settings, config.thread_count, &Progress::default())?;
                    let graph = built.graph.clone();
                    builds.push(built);
                    Some(graph)
                }
            };
            let attempts = run_goals(policy, &map, graph.as_ref(), &goals, config, seed, &mut search_us);
            outcomes.extend(attempts.into_iter().enumerate().map(|(idx, attempt)| {
                // Goals are sorted by distance, so thirds are ranges.
                Outcome { seed_idx, third: idx * 3 / goals.len(), attempt }
            }));
            progress(outcomes.len(), total);
        }
    }
    search_us.sort_unstable_by(f64::total_cmp);
    let mean =
        |value: &dyn Fn(&surefoot_planner::Built) -> f64| builds.iter().map(value).sum::<f64>() / builds.len() as f64;
    let graph = (!builds.is_empty()).then(|| GraphFigures {
        vertices: mean(&|built| built.graph.vertex_count() as f64),
        edges: mean(&|built| built.graph.edge_count() as f64),
        islands: mean(&|built| f64::from(built.graph.island_count())),
        connected: mean(&|built| built.graph.connected_share()),
        build_s: mean(&|built| built.seconds),
        probes: mean(&|built| built.probes as f64),
        search_us_median: search_us[search_us.len() / 2],
    });
    Ok(summarise(policy, config, &outcomes, graph))
}

fn draw_goals(
    map: &Map,
    profile: &CharacterProfile,
    config: &EvalConfig,
    map_seed: u64,
    seed: u64,
) -> Result<Vec<Goal>, EvalError> {
    let mut rng = ChaCha8Rng::seed_from_u64(map_seed);
    rng.set_stream(1000 + seed);
    let points = navigable::sample_many(map, profile, POINTS_PER_MAP, &mut rng)?;
    let mut goals = Goal::draw(&points, config.distance.clone(), config.goals, &mut rng);
    if goals.len() < config.goals {
        return Err(EvalError::NoGoals(map_seed));
    }
    goals.sort_by(|a, b| a.distance().total_cmp(&b.distance()));
    Ok(goals)
}

/// Splits the goals over threads in small batches; results do not depend on how many threads there are.
fn run_goals(
    policy: &Policy,
    map: &Arc<Map>,
    graph: Option<&surefoot_planner::NavGraph>,
    goals: &[Goal],
    config: &EvalConfig,
    seed: u64,
    search_us: &mut Vec<f64>,
) -> Vec<Attempt> {
    const GOALS_PER_BATCH: usize = 128;
    let batches: Vec<&[Goal]> = goals.chunks(GOALS_PER_BATCH).collect();
    let next = std::sync::atomic::AtomicUsize::new(0);
    let results = std::sync::Mutex::new(vec![None; batches.len()]);
    std::thread::scope(|scope| {
        for _ in 0..config.thread_count.max(1) {
            scope.spawn(|| {
                loop {
                    let idx = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    let Some(batch) = batches.get(idx) else { return };
                    let mut rollout = Rollout::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
                    rollout.noise_share = config.noise_share;
                    rollout.seed = seed.wrapping_mul(1_000_003).wrapping_add(idx as u64);
                    let mut times = Vec::new();
                    let attempts = match graph {
                        Some(graph) => rollout.run_by_plan(policy, graph, batch, &mut times),
                        None => rollout.run(policy, batch),
                    };
                    results.lock().expect("no rollout panics")[idx] = Some((attempts, times));
                }
            });
        }
    });
    let results = results.into_inner().expect("no rollout panics");
    let mut attempts = Vec::with_capacity(goals.len());
    for (batch, times) in results.into_iter().flatten() {
        attempts.extend(batch);
        search_us.extend(times);
    }
    attempts
}

fn summarise(policy: &Policy, config: &EvalConfig, outcomes: &[Outcome], graph: Option<GraphFigures>) -> Report {
    let rate = |keep: &dyn Fn(&Outcome) -> bool| {
        let kept: Vec<&Outcome> = outcomes.iter().filter(|outcome| keep(outcome)).collect();
        Rate::of(kept.iter().filter(|outcome| outcome.attempt.end == End::Reached).count(), kept.len())
    };
    let per_seed: Vec<f64> = (0..config.seeds.len()).map(|idx| rate(&|outcome| outcome.seed_idx == idx).rate).collect();
    let mean = per_seed.iter().sum::<f64>() / per_seed.len() as f64;
    let spread = (per_seed.len() > 1)
        .then(|| (per_seed.iter().map(|rate| (rate - mean).powi(2)).sum::<f64>() / (per_seed.len() - 1) as f64).sqrt());
    let mut ends: BTreeMap<&'static str, usize> = End::ALL.iter().map(|end| (end.name(), 0)).collect();
    for outcome in outcomes {
        *ends.entry(outcome.attempt.end.name()).or_default() += 1;
    }
    let reached: Vec<&Attempt> =
        outcomes.iter().map(|outcome| &outcome.attempt).filter(|attempt| attempt.end == End::Reached).collect();
    let decisions: f64 = reached.iter().map(|attempt| f64::from(attempt.decisions)).sum();
    let replans: f64 = outcomes.iter().map(|outcome| f64::from(outcome.attempt.replans)).sum();
    let method = match config.method {
        Method::Policy => "policy",
        Method::Graph(settings) => match settings.placement {
            surefoot_planner::Placement::Random => "random",
            surefoot_planner::Placement::Spaced => "spaced",
        },
    };
    Report {
        method: method.to_owned(),
        model: policy.manifest().name.clone(),
        maps: config.maps.iter().map(|spec| spec.seed).collect(),
        goals: config.goals,
        seeds: config.seeds.clone(),
        success: Success {
            all: rate(&|_| true),
            easy: rate(&|outcome| outcome.third == 0),
            medium: rate(&|outcome| outcome.third == 1),
            hard: rate(&|outcome| outcome.third == 2),
        },
        spread,
        ends,
        seconds_to_goal: decisions * f64::from(surefoot_world::DECISION_SECONDS) / reached.len().max(1) as f64,
        replans: replans / outcomes.len().max(1) as f64,
        graph,
    }
}
