//! Runs units: surveys a map, builds its graph, and attempts all goals.

use super::config::{EvalConfig, EvalError, Method, Price};
use super::maps::{EvalMap, GoalArea, MapName};
use super::reachable::{PlayableArea, Terrain, is_on_foot, reachable};
use super::record::Record;
use super::unit::{Batch, GraphFigures, Unit};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use surefoot_game_client::attempts::{Rules, attempt};
use surefoot_game_client::{Game, Level, probes};
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::settings::BUILDER_VERSION;
use surefoot_planner::threads::map_indices;
use surefoot_planner::{BuildSettings, BuildStats, Built, NavGraph, Progress, Router};
use surefoot_policy::Policy;
use surefoot_policy::checkpoint::write_atomically;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::attempts::Figures;
use surefoot_rollout::graphs::build;
use surefoot_rollout::{AttemptResult, Goal, Motion, Rollout};
use surefoot_world::character::MoveScratch;
use surefoot_world::reach::Reach;
use surefoot_world::{CharacterProfile, End, Map, TaskConfig, navigable};

/// Number of navigable points that the goals of one map are drawn from.
const POINTS_PER_MAP: usize = 3000;
/// Version of unit results; incremented when a run would no longer reproduce saved units.
const VERSION: u32 = 9;

/// A map, its survey, and the graphs that were built on it so far.
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
                let (threads, progress) = (config.thread_count, Progress::default());
                free.insert(match &config.game {
                    Some(game) => probes::build(game, &context, &settings, threads, &progress)?.built,
                    None => build(&context, &settings, threads, &progress)?,
                })
            }
        })
    }
}

/// Loads a saved unit, or runs and saves it. `surveyed` caches the map between units.
pub fn load_or_run(
    policy: &Policy,
    config: &EvalConfig,
    choice: &EvalMap,
    seed: u64,
    surveyed: &mut Option<Surveyed>,
) -> Result<Unit, EvalError> {
    let builder = config.record.as_deref().map_or(BUILDER_VERSION, Record::builder);
    let key = key(policy, config, choice, seed, builder);
    if let Some(record) = config.record.as_deref().filter(|record| record.is_checked()) {
        let (unit, batches) = record.look_up(&key)?;
        if !batches.is_empty() {
            let site = Site::new(policy, config, choice, survey(surveyed, config, choice), seed)?;
            let again = site.attempt(&batches)?;
            for (batch, (attempts, _)) in batches.into_iter().zip(again) {
                record.compare(&unit, batch, &attempts);
            }
        }
        return Ok(unit);
    }
    let path = path_of(policy, config, choice, seed);
    let unit = match path.as_deref().and_then(|path| load(path, config.goals)) {
        Some(unit) => unit,
        None if config.shard.is_some_and(|shard| !shard.holds(&choice.name().to_string(), seed)) => {
            return Ok(of_other_shard(config, choice, seed));
        }
        None => {
            let unit = Site::new(policy, config, choice, survey(surveyed, config, choice), seed)?.run()?;
            if let Some(path) = &path {
                save(path, &unit)?;
            }
            unit
        }
    };
    if let Some(record) = &config.record {
        record.add(policy, &key, &unit);
    }
    Ok(unit)
}

/// Saves a unit that another process has run, so that this evaluation finds it.
pub fn keep(
    policy: &Policy,
    config: &EvalConfig,
    (choice, seed): (&EvalMap, u64),
    unit: &Unit,
) -> Result<(), EvalError> {
    path_of(policy, config, choice, seed).map_or(Ok(()), |path| save(&path, unit))
}

/// Whether a unit is saved, so that it need not be run.
pub fn is_kept(policy: &Policy, config: &EvalConfig, choice: &EvalMap, seed: u64) -> bool {
    path_of(policy, config, choice, seed).is_some_and(|path| load(&path, config.goals).is_some())
}

/// The file of a unit; `None` if the configuration saves none.
fn path_of(policy: &Policy, config: &EvalConfig, choice: &EvalMap, seed: u64) -> Option<PathBuf> {
    config
        .keep_in
        .as_ref()
        .map(|folder| folder.join(format!("{}.json", key(policy, config, choice, seed, BUILDER_VERSION))))
}

/// A placeholder for a unit of another shard: all its attempts are missing. It is neither saved nor recorded.
fn of_other_shard(config: &EvalConfig, choice: &EvalMap, seed: u64) -> Unit {
    Unit {
        map: choice.name(),
        seed,
        distances: vec![1.0; config.goals],
        reachable: vec![true; config.goals],
        on_foot: vec![false; config.goals],
        attempts: vec![AttemptResult::without_plans(End::NoProgress, 0, 0.0); config.goals],
        motion: Default::default(),
        graph: None,
        playable: None,
    }
}

fn survey<'s>(surveyed: &'s mut Option<Surveyed>, config: &EvalConfig, choice: &EvalMap) -> &'s mut Surveyed {
    surveyed.get_or_insert_with(|| {
        let map = choice.load();
        let reach = Reach::survey_far(&map, &config.profile, config.thread_count);
        Surveyed { map, reach, graphs: HashMap::new() }
    })
}

fn save(path: &Path, unit: &Unit) -> Result<(), EvalError> {
    let bytes = serde_json::to_vec(unit).expect("a unit is plain data");
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| write_atomically(path, &bytes).map_err(std::io::Error::other))
        .map_err(|source| EvalError::Io { path: path.to_owned(), source })
}

/// File name of a unit, which depends on everything that determines its result, the version of the builder included.
fn key(policy: &Policy, config: &EvalConfig, choice: &EvalMap, seed: u64, builder: u32) -> String {
    let EvalConfig { goals, method, distance, noise_share, rehearses, follow, price, profile, .. } = config;
    let map = choice.identity();
    let text = format!(
        "{VERSION} {} {} {map} {seed} {goals} {method:?} {distance:?} {noise_share} {rehearses} {follow:?} {price:?} \
         {:?} {profile:?}{}",
        policy.weights_hash(),
        policy.senses_transports(),
        TaskConfig::default(),
        if *method == Method::Policy { String::new() } else { format!(" {builder}") },
    );
    format!("{}-{}-{seed}-{}", method.name(), choice.seed(), &blake3::hash(text.as_bytes()).to_hex()[..16])
}

/// Loads a unit; `None` if it is missing, damaged or incomplete.
fn load(path: &Path, goal_count: usize) -> Option<Unit> {
    let unit: Unit = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
    (unit.attempts.len() == goal_count && unit.distances.len() == goal_count).then_some(unit)
}

/// Everything that the attempts of a unit need.
struct Site<'a> {
    policy: &'a Policy,
    config: &'a EvalConfig,
    name: MapName,
    map: &'a Arc<Map>,
    reach: &'a Reach,
    router: Option<(Router, BuildStats)>,
    /// Share of the ground from which the goals come, if that is not all.
    playable: Option<f64>,
    goals: Vec<Goal>,
    seed: u64,
}

impl<'a> Site<'a> {
    fn new(
        policy: &'a Policy,
        config: &'a EvalConfig,
        choice: &EvalMap,
        surveyed: &'a mut Surveyed,
        seed: u64,
    ) -> Result<Self, EvalError> {
        let EvalConfig { profile, distance, goals, .. } = config;
        let terrain = Terrain { map: &surveyed.map, profile, reach: &surveyed.reach };
        let is_limited = matches!(choice, EvalMap::Level { goals: GoalArea::Playable, .. });
        let area = is_limited.then(|| PlayableArea::of(&terrain));
        let goals = draw_goals((&surveyed.map, choice), (profile, area.as_ref()), distance, *goals, seed)?;
        let playable = area.map(|area| area.share);
        let built = match config.method {
            Method::Policy => None,
            Method::Graph(settings) => Some(match &config.graph {
                Some(graph) => Built { graph: NavGraph::clone(graph), stats: BuildStats::default() },
                None => surveyed.graph(policy, config, settings.with_seed(seed))?.clone(),
            }),
        };
        let router = built.map(|built| {
            let graph = match config.price {
                Price::Risk => built.graph,
                Price::Steps => built.graph.priced_by_decisions(),
            };
            (Router::new(graph, DEFAULT_LABEL_LIMIT, config.thread_count), built.stats)
        });
        let Surveyed { map, reach, .. } = surveyed;
        Ok(Self { policy, config, name: choice.name(), map, reach, router, playable, goals, seed })
    }

    fn router(&self) -> Option<&Router> {
        self.router.as_ref().map(|(router, _)| router)
    }

    fn run(&self) -> Result<Unit, EvalError> {
        let started = Instant::now();
        let terrain = Terrain { map: self.map, profile: &self.config.profile, reach: self.reach };
        let mut reachable = reachable(&terrain, self.router(), &self.goals);
        let batches: Vec<Batch> = Batch::all(self.goals.len()).collect();
        let results = self.attempt(&batches)?;
        let mut attempts: Vec<Option<AttemptResult>> = vec![None; self.goals.len()];
        let (mut search_us, mut motion) = (Vec::new(), Motion::default());
        for (batch, (of_batch, figures)) in batches.into_iter().zip(results) {
            for (idx, attempt) in batch.indices(self.goals.len()).zip(of_batch) {
                attempts[idx] = Some(attempt);
            }
            search_us.extend(figures.times.search_us);
            motion.add(&figures.motion);
        }
        let attempts: Vec<AttemptResult> = attempts.into_iter().flatten().collect();
        // A goal that was reached is reachable, even if the survey disagrees.
        for (reachable, attempt) in reachable.iter_mut().zip(&attempts) {
            *reachable |= attempt.end == End::Reached;
        }
        let eval_s = started.elapsed().as_secs_f64();
        search_us.sort_unstable_by(f64::total_cmp);
        let graph = self.router.as_ref().map(|(router, stats)| GraphFigures {
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
        Ok(Unit {
            map: self.name.clone(),
            seed: self.seed,
            distances: self.goals.iter().map(Goal::distance).collect(),
            reachable,
            on_foot: self.goals.iter().map(|goal| is_on_foot(&terrain, goal)).collect(),
            attempts,
            motion,
            graph,
            playable: self.playable,
        })
    }

    /// Attempts the goals of these batches, distributed over threads, and returns the results in the order of the
    /// batches.
    fn attempt(&self, batches: &[Batch]) -> Result<Vec<(Vec<AttemptResult>, Figures)>, EvalError> {
        let results = map_indices(batches.len(), self.config.thread_count, |idx| {
            let batch = batches[idx];
            match &self.config.game {
                Some(game) => self.attempt_in(game, batch),
                None => Ok(self.attempt_here(batch)),
            }
        });
        results.into_iter().collect()
    }

    fn goals_of(&self, batch: Batch) -> Vec<Goal> {
        batch.indices(self.goals.len()).map(|idx| self.goals[idx]).collect()
    }

    /// Seed of the noise of a batch.
    fn seed_of(&self, batch: Batch) -> u64 {
        self.seed.wrapping_mul(1_000_003).wrapping_add(batch.idx() as u64)
    }

    fn attempt_here(&self, batch: Batch) -> (Vec<AttemptResult>, Figures) {
        let config = self.config;
        let mut rollout = Rollout::new(self.map.clone(), config.profile.clone(), TaskConfig::default());
        rollout.noise_share = config.noise_share;
        (rollout.rehearses, rollout.follow) = (config.rehearses, config.follow);
        rollout.seed = self.seed_of(batch);
        let mut figures = Figures::default();
        let attempts = rollout.measure(self.policy, self.router(), &self.goals_of(batch), &mut figures);
        (attempts, figures)
    }

    /// Attempts the goals of a batch in a game.
    fn attempt_in(&self, game: &Game, batch: Batch) -> Result<(Vec<AttemptResult>, Figures), EvalError> {
        let EvalConfig { profile, follow, rehearses, noise_share, .. } = self.config;
        let level = Level { map: self.map.clone(), body: profile.clone(), solid_npcs: false };
        let (rehearses, noise_share, seed) = (*rehearses, *noise_share, self.seed_of(batch));
        let rules = Rules { follow: *follow, rehearses, noise_share, seed };
        Ok(attempt(game, &level, self.policy, self.router(), (&self.goals_of(batch), rules))?)
    }
}

/// Goals of a map, the nearest first. Equal arguments give equal goals.
///
/// # Errors
/// If the map has no ground for the body, or too few goals at these distances.
pub fn draw_goals(
    (map, choice): (&Map, &EvalMap),
    (profile, within): (&CharacterProfile, Option<&PlayableArea<'_>>),
    distance: &Range<f32>,
    count: usize,
    seed: u64,
) -> Result<Vec<Goal>, EvalError> {
    let mut rng = ChaCha8Rng::seed_from_u64(choice.seed());
    rng.set_stream(1000 + seed);
    let mut points = navigable::sample_many(map, profile, POINTS_PER_MAP, &mut rng)?;
    if let Some(area) = within {
        let mut scratch = MoveScratch::default();
        points.retain(|point| area.contains(*point, &mut scratch));
    }
    if points.is_empty() {
        return Err(EvalError::NoGoals(choice.name()));
    }
    let mut goals = Goal::draw(&points, distance.clone(), count, &mut rng);
    if goals.len() < count {
        return Err(EvalError::NoGoals(choice.name()));
    }
    goals.sort_by(|a, b| a.distance().total_cmp(&b.distance()));
    Ok(goals)
}
