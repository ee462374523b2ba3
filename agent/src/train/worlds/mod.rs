//! Experience from worlds that run elsewhere: servers of ours, or games that serve environments (docs/games.md).
//!
//! Every environment is stepped by a [`stream`] of its own, with the goals and attempts that [`lanes`] draws, and all of them ask one
//! [`brain`] for their actions: it decides for as many NPCs at once as happen to wait (Espeholt et al. 2020, "SEED RL": inference where the
//! learner is). While one environment of a world moves, others of it decide, and nobody waits for the slowest: [`Worlds::collect`] takes
//! steps as they come. A world that goes away costs its running attempts; its streams wait until it is back.

mod brain;
mod lanes;
mod stream;

use super::collector::CollectorStats;
use super::config::TrainConfig;
use super::replay::{RowKind, Step};
use crate::game::{Game, GameError};
use brain::Brain;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, RwLock};
use std::time::{Duration, Instant};
use stream::{Arrival, Stream};
use surefoot_policy::Policy;

/// Connects to the world at an address.
pub type Connect = Arc<dyn Fn(&str) -> Result<Game, GameError> + Send + Sync>;

/// Steps that may wait for the learner, for each environment; then its NPCs wait.
const WAITING_STEPS: usize = 2;
/// Interval at which a learner that waits for steps looks whether it should stop.
const LOOK: Duration = Duration::from_millis(200);

/// Weights, and the number of updates behind them.
pub(super) type Published = Arc<RwLock<(Arc<Policy>, u64)>>;

/// Times and counts that streams and the brain add to.
#[derive(Debug, Default)]
pub(super) struct Meters {
    /// Time in which actions were computed, us.
    act_us: AtomicU64,
    /// Time in which streams packed and read messages, us, all streams together.
    encode_us: AtomicU64,
    /// Decisions of streams since the beginning of the run, random ones included.
    decisions: AtomicU64,
    /// Streams that are connected.
    live: AtomicU64,
}

impl Meters {
    fn add(to: &AtomicU64, time: Duration) {
        to.fetch_add(time.as_micros() as u64, Ordering::Relaxed);
    }
}

/// What happened since it was last taken, besides what the NPCs did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Traffic {
    /// Share of the time in which actions were computed.
    pub act: f64,
    /// Share of the time in which messages were packed and read, of one core.
    pub encode: f64,
    /// Share of the time in which the collector waited for steps.
    pub wait: f64,
    /// Environments that are connected.
    pub live: u64,
    /// Decisions that were dropped, since the weights that chose their actions were too old.
    pub stale: u64,
    /// Times that a world went away.
    pub lost: u64,
}

/// All environments of a run, as a source of experience.
pub struct Worlds {
    arrivals: Receiver<(usize, Arrival)>,
    published: Published,
    meters: Arc<Meters>,
    stopping: Arc<AtomicBool>,
    stream_count: usize,
    lane_count: usize,
    max_staleness: u64,
    total_decisions: u64,
    stats: CollectorStats,
    traffic: Traffic,
    waited: Duration,
    since: Instant,
}

impl fmt::Debug for Worlds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Worlds").field("streams", &self.stream_count).finish_non_exhaustive()
    }
}

/// What remains of the source when a run is saved. Running attempts are lost.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct WorldsState {
    total_decisions: u64,
    stats: CollectorStats,
}

/// Steps that came from one environment, or the end of all its attempts.
#[derive(Debug)]
pub enum Collected {
    /// Rows to append.
    Step(Step),
    /// The attempts of all its NPCs ended without a last observation: what follows does not continue them.
    Closed,
}

impl Worlds {
    /// Starts the streams of `config.worlds`, which connect on their own and again when a connection is lost.
    pub fn start(config: &TrainConfig, policy: Arc<Policy>, connect: &Connect, state: Option<WorldsState>) -> Self {
        let streams = stream_places(config);
        let (stream_count, lane_count) = (streams.len(), config.collector.npcs_per_world);
        let (sender, arrivals) = sync_channel(WAITING_STEPS * stream_count);
        let meters = Arc::new(Meters::default());
        let WorldsState { total_decisions, stats } =
            state.unwrap_or(WorldsState { total_decisions: 0, stats: CollectorStats::default() });
        meters.decisions.store(total_decisions, Ordering::Relaxed);
        let (published, stopping) = (Arc::new(RwLock::new((policy, 0))), Arc::new(AtomicBool::new(false)));
        let brain = Brain::start(config, published.clone(), meters.clone(), total_decisions);
        for (idx, place) in streams.into_iter().enumerate() {
            let stream = Stream {
                idx,
                place,
                config: config.collector.clone(),
                memory_len: config.sac.network.hidden_len(),
                steps_per_map: config.steps_per_round as u64 * config.collector.rounds_per_map,
                seed: config.seed ^ total_decisions.wrapping_mul(0x9E37_79B9_7F4A_7C15),
                connect: connect.clone(),
                brain: brain.clone(),
                arrivals: sender.clone(),
                meters: meters.clone(),
                stopping: stopping.clone(),
            };
            std::thread::spawn(move || stream.run());
        }
        Self {
            arrivals,
            published,
            meters,
            stopping,
            stream_count,
            lane_count,
            max_staleness: config.max_staleness,
            total_decisions,
            stats,
            traffic: Traffic::default(),
            waited: Duration::ZERO,
            since: Instant::now(),
        }
    }

    /// Number of environments.
    pub fn stream_count(&self) -> usize {
        self.stream_count
    }

    /// Number of NPCs of all environments.
    pub fn lane_count(&self) -> usize {
        self.stream_count * self.lane_count
    }

    /// Number of decisions since the beginning of the run.
    pub fn total_decisions(&self) -> u64 {
        self.total_decisions
    }

    /// Returns and resets the statistics of NPCs since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        std::mem::take(&mut self.stats)
    }

    /// Returns and resets what else happened since the last call.
    pub fn take_traffic(&mut self) -> Traffic {
        let elapsed = std::mem::replace(&mut self.since, Instant::now()).elapsed().as_secs_f64().max(1e-9);
        let share = |meter: &AtomicU64| meter.swap(0, Ordering::Relaxed) as f64 * 1e-6 / elapsed;
        Traffic {
            act: share(&self.meters.act_us),
            encode: share(&self.meters.encode_us),
            wait: std::mem::take(&mut self.waited).as_secs_f64() / elapsed,
            live: self.meters.live.load(Ordering::Relaxed),
            ..std::mem::take(&mut self.traffic)
        }
    }

    /// Lets NPCs act with `policy`, which is `version` updates old, and waits for `step_count` decisions of as many NPCs as there are,
    /// whichever they come from; for fewer once `stop` is set. Returns them with the environment that each came from.
    pub fn collect(
        &mut self,
        policy: Policy,
        version: u64,
        step_count: usize,
        stop: &AtomicBool,
    ) -> Vec<(usize, Collected)> {
        *self.published.write().expect("no holder panics") = (Arc::new(policy), version);
        let mut collected = Vec::new();
        let mut step_total = 0;
        while step_total < step_count * self.stream_count && !stop.load(Ordering::Relaxed) {
            let started = Instant::now();
            let arrived = self.arrivals.recv_timeout(LOOK);
            self.waited += started.elapsed();
            match arrived {
                Ok((stream, Arrival::Step(step, stats))) => {
                    step_total += 1;
                    collected.push((stream, Collected::Step(self.admit(step, stats, version))));
                }
                Ok((stream, Arrival::Closed { is_lost })) => {
                    self.traffic.lost += u64::from(is_lost);
                    collected.push((stream, Collected::Closed));
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => unreachable!("streams run until they are told to stop"),
            }
        }
        collected
    }

    /// Counts a step. From one whose weights were too old nothing is learned; its observations still close the attempts before it.
    fn admit(&mut self, mut step: Step, stats: CollectorStats, version: u64) -> Step {
        self.total_decisions += stats.decisions;
        self.stats.add(stats);
        if step.version + self.max_staleness < version {
            self.traffic.stale += stats.decisions;
            step.kinds.fill(RowKind::Boundary);
        }
        step
    }

    /// What is saved.
    pub fn save(&self) -> WorldsState {
        WorldsState { total_decisions: self.total_decisions, stats: self.stats }
    }
}

impl Drop for Worlds {
    fn drop(&mut self) {
        self.stopping.store(true, Ordering::Relaxed);
    }
}

/// Where an environment runs.
#[derive(Debug, Clone)]
pub(super) struct Place {
    /// Address of the world.
    uri: String,
    /// Index of the saved level that the world runs; `None` if it runs maps that are generated.
    level: Option<u64>,
}

/// The environments of a run: those of the first world, of the second one, and so on.
fn stream_places(config: &TrainConfig) -> Vec<Place> {
    let level_count = config.collector.levels.len();
    let place = |(idx, uri): (usize, &String)| {
        let level = (level_count > 0).then(|| (idx % level_count) as u64);
        std::iter::repeat_n(Place { uri: uri.clone(), level }, config.envs_per_world)
    };
    config.worlds.iter().enumerate().flat_map(place).collect()
}
