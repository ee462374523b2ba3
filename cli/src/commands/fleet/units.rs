//! Units of evaluations as jobs, and the runner of a prover, which runs every kind of job.

use anyhow::Context;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::sync::atomic::{AtomicU64, Ordering};
use surefoot_eval::unit::Unit;
use surefoot_eval::{EvalConfig, EvalMap, GoalArea, Method, Price, keep, missing, run_units};
use surefoot_fleet::error::FleetError;
use surefoot_fleet::work::dispatch::{Dispatcher, Threads, Work};
use surefoot_fleet::work::job::{Answer, Job, JobKind, Opened, Refusal};
use surefoot_fleet::work::map_cache::{MapCache, MapRef};
use surefoot_fleet::work::{maps, probes, prover};
use surefoot_net::metrics::family;
use surefoot_planner::{Attach, BuildSettings};
use surefoot_policy::Policy;
use surefoot_rollout::FollowConfig;
use surefoot_world::{Arrival, CharacterProfile, Gait};

/// Most bytes of a unit after decompression.
const MAX_UNIT_BYTES: u64 = 256 << 20;

/// Runs jobs of every kind.
pub struct Runner {
    policy: Policy,
    maps: MapCache,
    probes: AtomicU64,
}

impl Runner {
    /// A runner with this policy.
    pub fn new(policy: Policy, maps: MapCache) -> Self {
        Self { policy, maps, probes: AtomicU64::new(0) }
    }
}

impl prover::Runner for Runner {
    fn run(&self, job: &Opened) -> Answer {
        match job.kind {
            JobKind::Probes => {
                let (result, count) = probes::prove(job, &self.policy, &self.maps)?;
                self.probes.fetch_add(count as u64, Ordering::Relaxed);
                Ok(result)
            }
            JobKind::Unit => evaluate(job, &self.policy, &self.maps),
            JobKind::Map => maps::generate(job, &self.maps),
        }
    }

    fn metrics(&self) -> String {
        family("probes_total", "counter", "Probes run.", [("", self.probes.load(Ordering::Relaxed) as f64)])
    }
}

/// A unit, and all that its result depends on.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct UnitJob {
    map: MapRef,
    /// Name of a level in reports, and where its goals come from.
    level: Option<(String, GoalArea)>,
    profile: CharacterProfile,
    policy: String,
    senses_transports: bool,
    goals: u32,
    seed: u64,
    graph: Option<BuildSettings>,
    distance: (f32, f32),
    noise_share: f32,
    rehearses: bool,
    follow: Follow,
    is_priced_by_steps: bool,
}

/// Rules of following plans.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Follow {
    replan_after: u32,
    patience: u32,
    max_replans: u32,
    remembers: bool,
    attaches_to_several: bool,
    composes: bool,
    arrival: Arrival,
    #[serde(default)]
    gait: Gait,
}

impl UnitJob {
    fn new(policy: &Policy, config: &EvalConfig, (choice, map): (&EvalMap, MapRef), seed: u64) -> Self {
        let FollowConfig { replan_after, patience, max_replans, remembers, attach, composes, arrival, gait } =
            config.follow;
        let attaches_to_several = attach == Attach::Several;
        Self {
            map,
            level: match choice {
                EvalMap::Generated(_) => None,
                EvalMap::Level { name, goals, .. } => Some((name.clone(), *goals)),
            },
            profile: config.profile.clone(),
            policy: policy.weights_hash().to_owned(),
            senses_transports: policy.senses_transports(),
            goals: config.goals as u32,
            seed,
            graph: match config.method {
                Method::Policy => None,
                Method::Graph(settings) => Some(settings),
            },
            distance: (config.distance.start, config.distance.end),
            noise_share: config.noise_share,
            rehearses: config.rehearses,
            follow: Follow {
                replan_after,
                patience,
                max_replans,
                remembers,
                attaches_to_several,
                composes,
                arrival,
                gait,
            },
            is_priced_by_steps: config.price == Price::Steps,
        }
    }

    /// The configuration of the job, after its values have been checked.
    fn config(self, maps: &MapCache) -> Result<EvalConfig, Refusal> {
        let Follow { replan_after, patience, max_replans, remembers, attaches_to_several, composes, arrival, gait } =
            self.follow;
        let (low, high) = self.distance;
        let is_sound = (1..=100_000).contains(&self.goals)
            && (1..=100_000).contains(&patience)
            && (1..=100_000).contains(&replan_after)
            && (0.0..=1.0).contains(&self.noise_share)
            && gait.is_allowed()
            && low >= 0.0
            && low < high;
        if !is_sound {
            return Err(Refusal::impossible("a value of the unit is out of range"));
        }
        let map = match (self.map, self.level) {
            (MapRef::Spec(spec), None) => EvalMap::Generated(spec),
            (map @ MapRef::Saved { .. }, Some((name, goals))) => EvalMap::Level { name, map: maps.map(&map)?, goals },
            _ => return Err(Refusal::impossible("a level needs a name, a generated map has none")),
        };
        let attach = if attaches_to_several { Attach::Several } else { Attach::Nearest };
        Ok(EvalConfig {
            maps: vec![map],
            profile: self.profile,
            goals: self.goals as usize,
            seeds: vec![self.seed],
            method: self.graph.map_or(Method::Policy, Method::Graph),
            distance: low..high,
            noise_share: self.noise_share,
            rehearses: self.rehearses,
            follow: FollowConfig { replan_after, patience, max_replans, remembers, attach, composes, arrival, gait },
            game: None,
            graph: None,
            price: if self.is_priced_by_steps { Price::Steps } else { Price::Risk },
            thread_count: 1,
            keep_in: None,
            shard: None,
            record: None,
        })
    }
}

/// Runs the unit of a job.
fn evaluate(job: &Opened, policy: &Policy, maps: &MapCache) -> Answer {
    let unit: UnitJob = job.body().map_err(Refusal::impossible)?;
    if unit.policy != policy.weights_hash() {
        return Err(Refusal::unable("this prover has another policy"));
    }
    let policy = if unit.senses_transports { policy.clone() } else { policy.clone().without_transports() };
    let config = unit.config(maps)?;
    let units = run_units(&policy, &config, |_, _| {}).map_err(Refusal::impossible)?;
    compress(&units[0]).map_err(Refusal::impossible)
}

/// Compresses a unit for the queue, whose messages have at most a megabyte.
fn compress(unit: &Unit) -> std::io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    serde_json::to_writer(&mut encoder, unit)?;
    encoder.finish()
}

/// The units of an evaluation.
struct Units<'a> {
    policy: &'a Policy,
    config: &'a EvalConfig,
    choices: &'a [(EvalMap, u64)],
    is_done: &'a (dyn Fn() + Sync),
}

impl Work for Units<'_> {
    type Output = Unit;

    fn run_locally(&self, idx: usize, _: &(dyn Fn() -> bool + Sync)) -> Option<Result<Unit, String>> {
        let (choice, seed) = &self.choices[idx];
        let config = EvalConfig {
            maps: vec![choice.clone()],
            seeds: vec![*seed],
            keep_in: None,
            thread_count: 1,
            ..self.config.clone()
        };
        let units = run_units(self.policy, &config, |_, _| {}).map_err(|error| error.to_string());
        Some(units.map(|mut units| units.remove(0)))
    }

    fn read(&self, idx: usize, result: &[u8]) -> Result<Unit, String> {
        let unit: Unit =
            serde_json::from_reader(GzDecoder::new(result).take(MAX_UNIT_BYTES)).map_err(|error| error.to_string())?;
        let (choice, seed) = &self.choices[idx];
        let counts = [unit.distances.len(), unit.reachable.len(), unit.on_foot.len(), unit.attempts.len()];
        let is_wanted = unit.map == choice.name() && unit.seed == *seed && counts == [self.config.goals; 4];
        if is_wanted { Ok(unit) } else { Err("the result belongs to another unit".to_owned()) }
    }

    fn settled(&self, _: usize, _: &Unit) {
        (self.is_done)();
    }
}

/// Has the units run that are missing in the folder of an evaluation, on provers and on `threads` of this process, and
/// saves them there. Call this from a thread that may block.
pub fn gather(
    (dispatcher, maps): (&Dispatcher, &MapCache),
    policy: &Policy,
    config: &EvalConfig,
    threads: Threads,
    is_done: &(dyn Fn() + Sync),
) -> anyhow::Result<()> {
    let choices = missing(policy, config);
    let jobs: Result<Vec<Job>, FleetError> = (0..)
        .zip(&choices)
        .map(|(place, (choice, seed))| {
            let map = match choice {
                EvalMap::Generated(spec) => MapRef::Spec(*spec),
                EvalMap::Level { map, .. } => maps.runtime().block_on(MapRef::save(map, maps.blobs()))?,
            };
            Ok(Job::new(JobKind::Unit, place, &UnitJob::new(policy, config, (choice, map), *seed)))
        })
        .collect();
    let work = Units { policy, config, choices: &choices, is_done };
    let units = dispatcher.run(jobs?, &work, threads)?.context("the dispatcher was cancelled")?;
    for ((choice, seed), unit) in choices.iter().zip(&units) {
        keep(policy, config, (choice, *seed), unit)?;
    }
    Ok(())
}
