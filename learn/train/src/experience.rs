//! Experience from other processes: environments of [`worlds`](super::worlds), or [`actors`](super::actors).
//!
//! Each source sends single steps with the version of the weights that chose the actions. The learner waits for a
//! number of steps, not for a certain source. A source reports where its steps do not continue the previous ones, so
//! that no row gets a wrong successor.

use super::actors::slots::{SlotState, Slots};
use super::collector::CollectorStats;
use super::config::TrainConfig;
use super::error::TrainError;
use super::replay::{RowKind, Step};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use surefoot_policy::Policy;
use tokio::sync::watch;
use tracing::warn;

/// Most steps of a source that wait for the learner; then the source waits.
const WAITING_STEPS: usize = 2;
/// Interval at which a waiting learner checks whether to stop.
const LOOK: Duration = Duration::from_millis(200);

/// What a learner does while no step arrives.
#[derive(Debug, Clone, Copy)]
struct Patience {
    /// Interval of the warnings.
    warn_every: Duration,
    /// Time after which the run ends.
    limit: Duration,
}

const PATIENCE: Patience = Patience { warn_every: Duration::from_secs(30), limit: Duration::from_secs(600) };

/// A policy and its number of updates.
pub(super) type Version = (Policy, u64);

/// Times and counts of all sources.
#[derive(Debug, Default)]
pub(super) struct Meters {
    /// Time spent on inference, us.
    pub act_us: AtomicU64,
    /// Time spent on encoding and decoding messages, us.
    pub encode_us: AtomicU64,
    /// Decisions since the start of the run, including random ones.
    pub decisions: AtomicU64,
    /// Connected sources.
    pub live: AtomicU64,
    /// Repeated steps, which were dropped.
    pub repeated: AtomicU64,
}

impl Meters {
    /// Adds time to a meter.
    pub fn add(to: &AtomicU64, time: Duration) {
        to.fetch_add(time.as_micros() as u64, Ordering::Relaxed);
    }

    /// Counts a source as connected until the result is dropped.
    pub fn live(self: &Arc<Self>) -> Live {
        self.live.fetch_add(1, Ordering::Relaxed);
        Live(self.clone())
    }
}

/// A connected source.
pub(super) struct Live(Arc<Meters>);

impl Drop for Live {
    fn drop(&mut self) {
        self.0.live.fetch_sub(1, Ordering::Relaxed);
    }
}

/// How the sources fared and where time went, since the last report.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Traffic {
    /// Share of time spent on inference.
    pub act: f64,
    /// Share of one core's time spent on encoding and decoding messages.
    pub encode: f64,
    /// Share of time in which the learner waited for steps.
    pub wait: f64,
    /// Connected sources.
    pub live: u64,
    /// Decisions that were not learned from, because their weights were too old.
    pub stale: u64,
    /// Number of lost sources.
    pub lost: u64,
    /// Repeated steps, which were dropped.
    pub repeated: u64,
}

/// What a source sends to the learner.
pub(super) enum Delivery {
    /// A step, and its statistics.
    Step(Step, CollectorStats),
    /// The next step does not continue the previous one.
    Closed {
        /// Whether the source was lost.
        is_lost: bool,
    },
}

/// A source's end: sends steps and receives new weights. Clones share it.
#[derive(Clone)]
pub(super) struct ExperienceSender {
    deliveries: SyncSender<(usize, Delivery)>,
    /// The latest policy.
    pub policies: watch::Receiver<Version>,
    /// Times and counts of all sources.
    pub meters: Arc<Meters>,
}

impl ExperienceSender {
    /// Sends a delivery of source `source_idx`; waits while the queue is full. `Break` when the run is over.
    pub fn send(&self, source_idx: usize, delivery: Delivery) -> ControlFlow<()> {
        self.deliveries.send((source_idx, delivery)).map_or(ControlFlow::Break(()), ControlFlow::Continue)
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        self.policies.has_changed().is_err()
    }
}

/// The learner's end: receives the steps of all sources.
pub struct ExperienceReceiver {
    deliveries: Receiver<(usize, Delivery)>,
    policies: watch::Sender<Version>,
    meters: Arc<Meters>,
    source_count: usize,
    npc_count: usize,
    max_staleness: u64,
    total_decisions: u64,
    stats: CollectorStats,
    traffic: Traffic,
    waited: Duration,
    patience: Patience,
    since: Instant,
    pub(super) slots: Slots,
}

impl fmt::Debug for ExperienceReceiver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ExperienceReceiver").field("source_count", &self.source_count).finish_non_exhaustive()
    }
}

/// The saved part of a receiver's state. Running attempts are lost.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct ExperienceState {
    total_decisions: u64,
    stats: CollectorStats,
    slots: Vec<SlotState>,
}

/// What one source delivered, for its replay buffer.
#[derive(Debug)]
pub enum Collected {
    /// Rows to append.
    Step(Step),
    /// The next step does not continue the previous one.
    Closed,
}

impl ExperienceReceiver {
    /// Creates both ends for `source_count` sources of `npc_count` NPCs each.
    pub(super) fn open(
        config: &TrainConfig,
        (source_count, npc_count): (usize, usize),
        policy: Policy,
        state: ExperienceState,
    ) -> (Self, ExperienceSender) {
        let (sender, deliveries) = sync_channel(WAITING_STEPS * source_count);
        let ExperienceState { total_decisions, stats, slots } = state;
        let meters = Arc::new(Meters { decisions: AtomicU64::new(total_decisions), ..Meters::default() });
        let policies = watch::Sender::new((policy, 0));
        let experience =
            ExperienceSender { deliveries: sender, policies: policies.subscribe(), meters: meters.clone() };
        let receiver = Self {
            deliveries,
            policies,
            meters,
            source_count,
            npc_count,
            max_staleness: config.max_staleness,
            total_decisions,
            stats,
            traffic: Traffic::default(),
            waited: Duration::ZERO,
            patience: PATIENCE,
            since: Instant::now(),
            slots: Slots::new(config.actors, slots),
        };
        (receiver, experience)
    }

    /// Number of sources.
    pub fn source_count(&self) -> usize {
        self.source_count
    }

    /// Number of NPCs of all sources.
    pub fn lane_count(&self) -> usize {
        self.source_count * self.npc_count
    }

    /// Number of decisions since the start of the run.
    pub fn total_decisions(&self) -> u64 {
        self.total_decisions
    }

    /// Returns and resets the statistics since the last call.
    pub fn take_stats(&mut self) -> CollectorStats {
        std::mem::take(&mut self.stats)
    }

    /// Returns and resets the traffic since the last call.
    pub fn take_traffic(&mut self) -> Traffic {
        let elapsed = std::mem::replace(&mut self.since, Instant::now()).elapsed().as_secs_f64().max(1e-9);
        let share = |meter: &AtomicU64| meter.swap(0, Ordering::Relaxed) as f64 * 1e-6 / elapsed;
        Traffic {
            act: share(&self.meters.act_us),
            encode: share(&self.meters.encode_us),
            wait: std::mem::take(&mut self.waited).as_secs_f64() / elapsed,
            live: self.meters.live.load(Ordering::Relaxed),
            repeated: self.meters.repeated.swap(0, Ordering::Relaxed),
            ..std::mem::take(&mut self.traffic)
        }
    }

    /// Publishes the policy of `version`, then waits for `step_count` steps per source on average, or until `stop` is
    /// set. Returns the steps with the index of their source.
    ///
    /// # Errors
    /// If no step arrives for ten minutes, or all sources have ended.
    pub(super) fn collect(
        &mut self,
        version: Version,
        step_count: usize,
        stop: &AtomicBool,
    ) -> Result<Vec<(usize, Collected)>, TrainError> {
        let updates = version.1;
        self.policies.send_replace(version);
        let mut collected = Vec::new();
        let mut step_total = 0;
        let (mut latest_step, mut said) = (Instant::now(), Duration::ZERO);
        while step_total < step_count * self.source_count && !stop.load(Ordering::Relaxed) {
            let started = Instant::now();
            let arrived = self.deliveries.recv_timeout(LOOK);
            self.waited += started.elapsed();
            match arrived {
                Ok((source_idx, Delivery::Step(step, stats))) => {
                    step_total += 1;
                    (latest_step, said) = (Instant::now(), Duration::ZERO);
                    collected.push((source_idx, Collected::Step(self.admit(step, stats, updates))));
                }
                Ok((source_idx, Delivery::Closed { is_lost })) => {
                    self.traffic.lost += u64::from(is_lost);
                    collected.push((source_idx, Collected::Closed));
                }
                Err(RecvTimeoutError::Timeout) => self.check_wait(latest_step.elapsed(), &mut said)?,
                Err(RecvTimeoutError::Disconnected) => return Err(TrainError::NoSource),
            }
        }
        Ok(collected)
    }

    /// Warns at intervals, and returns an error after too long a wait. `said` is the wait at the last warning.
    fn check_wait(&self, waited: Duration, said: &mut Duration) -> Result<(), TrainError> {
        let (live, count, limit) = (self.meters.live.load(Ordering::Relaxed), self.source_count, self.patience.limit);
        if waited >= limit {
            return Err(TrainError::NoSteps { waited, live, count });
        }
        if waited >= *said + self.patience.warn_every {
            *said = waited;
            let waited_s = waited.as_secs();
            warn!(
                "learner: no step for {waited_s} s, {live} of {count} environments or actors are connected; \
                 training ends after {} s without any",
                limit.as_secs()
            );
        }
        Ok(())
    }

    /// Counts a step. One with too old weights is not learned from, but its observations still close the attempts
    /// before it.
    fn admit(&mut self, mut step: Step, stats: CollectorStats, updates: u64) -> Step {
        self.total_decisions += stats.decisions;
        self.stats.add(stats);
        if step.version.saturating_add(self.max_staleness) < updates {
            self.traffic.stale += stats.decisions;
            step.kinds.fill(RowKind::Boundary);
        }
        step
    }

    /// Returns the state to save. Queued steps count as taken, so that no step is taken twice.
    pub fn save(&self) -> ExperienceState {
        ExperienceState { total_decisions: self.total_decisions, stats: self.stats, slots: self.slots.save() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened() -> (ExperienceReceiver, ExperienceSender, Policy) {
        let policy = Policy::shipped().unwrap();
        let config = TrainConfig { actors: 1, ..TrainConfig::default() };
        let (mut receiver, experience) =
            ExperienceReceiver::open(&config, (1, 1), policy.clone(), ExperienceState::default());
        receiver.patience = Patience { warn_every: Duration::from_millis(1), limit: Duration::from_millis(2) };
        (receiver, experience, policy)
    }

    #[test]
    fn a_learner_without_steps_ends_and_reports_its_sources() {
        let (mut receiver, experience, policy) = opened();
        // A source that comes and goes without a step is no progress.
        let _ = experience.send(0, Delivery::Closed { is_lost: true });
        let error = receiver.collect((policy, 0), 1, &AtomicBool::new(false)).unwrap_err();
        assert!(matches!(error, TrainError::NoSteps { live: 0, count: 1, .. }), "{error}");
        assert_eq!(receiver.traffic.lost, 1);
    }

    #[test]
    fn a_learner_whose_sources_have_all_ended_ends_at_once() {
        let (mut receiver, experience, policy) = opened();
        receiver.patience = PATIENCE;
        drop(experience);
        let error = receiver.collect((policy, 0), 1, &AtomicBool::new(false)).unwrap_err();
        assert!(matches!(error, TrainError::NoSource), "{error}");
    }
}
