//! Experience that comes from elsewhere, as it comes: from environments of [`worlds`](super::worlds), or from [`actors`](super::actors).
//!
//! Sources hand their steps over one by one, each with the version of the weights that chose the actions. The learner waits for a number
//! of them, never for a certain source. Where attempts broke off the source says so: nothing is taken for a successor that is none.

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

/// Steps that may wait for the learner, for each source; then its NPCs wait.
const WAITING_STEPS: usize = 2;
/// Interval at which a learner that waits for steps looks whether it should stop.
const LOOK: Duration = Duration::from_millis(200);

/// What a learner does while no step comes.
#[derive(Debug, Clone, Copy)]
struct Patience {
    /// It says what it waits for after each such time.
    say_every: Duration,
    /// It ends after that time.
    limit: Duration,
}

const PATIENCE: Patience = Patience { say_every: Duration::from_secs(30), limit: Duration::from_secs(600) };

/// A policy, and the number of updates behind it.
pub(super) type Version = (Policy, u64);

/// Times and counts that sources add to.
#[derive(Debug, Default)]
pub(super) struct Meters {
    /// Time in which actions were computed, us.
    pub act_us: AtomicU64,
    /// Time in which messages were packed and read, us, all sources together.
    pub encode_us: AtomicU64,
    /// Decisions since the beginning of the run, random ones included.
    pub decisions: AtomicU64,
    /// Sources that are connected.
    pub live: AtomicU64,
    /// Steps that came again and were not taken.
    pub repeated: AtomicU64,
}

impl Meters {
    /// Adds time to one of them.
    pub fn add(to: &AtomicU64, time: Duration) {
        to.fetch_add(time.as_micros() as u64, Ordering::Relaxed);
    }

    /// Counts a source as connected while the result lives.
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

/// What happened since it was last taken, besides what the NPCs did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Traffic {
    /// Share of the time in which actions were computed.
    pub act: f64,
    /// Share of the time in which messages were packed and read, of one core.
    pub encode: f64,
    /// Share of the time in which the collector waited for steps.
    pub wait: f64,
    /// Sources that are connected.
    pub live: u64,
    /// Decisions from which nothing is learned, since the weights that chose the actions were too old.
    pub stale: u64,
    /// Times that a source went away.
    pub lost: u64,
    /// Steps that came again and were not taken.
    pub repeated: u64,
}

/// What a source hands over.
pub(super) enum Arrival {
    /// Rows, and what they were like.
    Step(Step, CollectorStats),
    /// What follows does not continue what came before.
    Closed {
        /// Whether the source went away.
        is_lost: bool,
    },
}

/// Where a source hands its steps over, and learns of new weights; clones share it.
#[derive(Clone)]
pub(super) struct Inlet {
    arrivals: SyncSender<(usize, Arrival)>,
    /// The present policy.
    pub policies: watch::Receiver<Version>,
    /// Times and counts.
    pub meters: Arc<Meters>,
}

impl Inlet {
    /// Hands something over as source `source_idx`, once the learner has taken what came before; `Break` when the run is over.
    pub fn send(&self, source_idx: usize, arrival: Arrival) -> ControlFlow<()> {
        self.arrivals.send((source_idx, arrival)).map_or(ControlFlow::Break(()), ControlFlow::Continue)
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        self.policies.has_changed().is_err()
    }
}

/// The learner's end of all sources.
pub struct Inflow {
    arrivals: Receiver<(usize, Arrival)>,
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

impl fmt::Debug for Inflow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Inflow").field("source_count", &self.source_count).finish_non_exhaustive()
    }
}

/// What remains of the sources when a run is saved. Running attempts are lost.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct InflowState {
    total_decisions: u64,
    stats: CollectorStats,
    slots: Vec<SlotState>,
}

/// What came from one source.
#[derive(Debug)]
pub enum Collected {
    /// Rows to append.
    Step(Step),
    /// What follows does not continue what came before.
    Closed,
}

impl Inflow {
    /// Opens the learner's end for the sources of `config`: `source_count` of them, of `npc_count` NPCs each.
    pub(super) fn open(
        config: &TrainConfig,
        (source_count, npc_count): (usize, usize),
        policy: Policy,
        state: InflowState,
    ) -> (Self, Inlet) {
        let (sender, arrivals) = sync_channel(WAITING_STEPS * source_count);
        let InflowState { total_decisions, stats, slots } = state;
        let meters = Arc::new(Meters { decisions: AtomicU64::new(total_decisions), ..Meters::default() });
        let policies = watch::Sender::new((policy, 0));
        let inlet = Inlet { arrivals: sender, policies: policies.subscribe(), meters: meters.clone() };
        let inflow = Self {
            arrivals,
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
        (inflow, inlet)
    }

    /// Number of sources.
    pub fn source_count(&self) -> usize {
        self.source_count
    }

    /// Number of NPCs of all sources.
    pub fn lane_count(&self) -> usize {
        self.source_count * self.npc_count
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
            repeated: self.meters.repeated.swap(0, Ordering::Relaxed),
            ..std::mem::take(&mut self.traffic)
        }
    }

    /// Lets NPCs act with the policy of `version`, and waits for `step_count` decisions of as many NPCs as there are, whichever they come
    /// from; for fewer once `stop` is set. Returns them with the source that each came from.
    ///
    /// # Errors
    /// If no step comes for ten minutes, or all sources have ended.
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
            let arrived = self.arrivals.recv_timeout(LOOK);
            self.waited += started.elapsed();
            match arrived {
                Ok((source_idx, Arrival::Step(step, stats))) => {
                    step_total += 1;
                    (latest_step, said) = (Instant::now(), Duration::ZERO);
                    collected.push((source_idx, Collected::Step(self.admit(step, stats, updates))));
                }
                Ok((source_idx, Arrival::Closed { is_lost })) => {
                    self.traffic.lost += u64::from(is_lost);
                    collected.push((source_idx, Collected::Closed));
                }
                Err(RecvTimeoutError::Timeout) => self.check_wait(latest_step.elapsed(), &mut said)?,
                Err(RecvTimeoutError::Disconnected) => return Err(TrainError::NoSource),
            }
        }
        Ok(collected)
    }

    /// Says now and then, since `said`, what the learner waits for; an error if it has waited too long.
    fn check_wait(&self, waited: Duration, said: &mut Duration) -> Result<(), TrainError> {
        let (live, count, limit) = (self.meters.live.load(Ordering::Relaxed), self.source_count, self.patience.limit);
        if waited >= limit {
            return Err(TrainError::NoSteps { waited, live, count });
        }
        if waited >= *said + self.patience.say_every {
            *said = waited;
            let waited_s = waited.as_secs();
            warn!(
                "the learner has waited {waited_s} s for steps: {live} of {count} environments or actors are connected; \
                 training ends after {} s without any",
                limit.as_secs()
            );
        }
        Ok(())
    }

    /// Counts a step. From one whose weights were too old nothing is learned; its observations still close the attempts before it.
    fn admit(&mut self, mut step: Step, stats: CollectorStats, updates: u64) -> Step {
        self.total_decisions += stats.decisions;
        self.stats.add(stats);
        if step.version.saturating_add(self.max_staleness) < updates {
            self.traffic.stale += stats.decisions;
            step.kinds.fill(RowKind::Boundary);
        }
        step
    }

    /// What is saved. Steps on their way count as taken, so that none is ever taken twice.
    pub fn save(&self) -> InflowState {
        InflowState { total_decisions: self.total_decisions, stats: self.stats, slots: self.slots.save() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened() -> (Inflow, Inlet, Policy) {
        let policy = Policy::shipped().unwrap();
        let config = TrainConfig { actors: 1, ..TrainConfig::default() };
        let (mut inflow, inlet) = Inflow::open(&config, (1, 1), policy.clone(), InflowState::default());
        inflow.patience = Patience { say_every: Duration::from_millis(1), limit: Duration::from_millis(2) };
        (inflow, inlet, policy)
    }

    #[test]
    fn a_learner_without_steps_ends_and_says_what_it_has_waited_for() {
        let (mut inflow, inlet, policy) = opened();
        // A source that comes and goes without a step is no progress.
        let _ = inlet.send(0, Arrival::Closed { is_lost: true });
        let error = inflow.collect((policy, 0), 1, &AtomicBool::new(false)).unwrap_err();
        assert!(matches!(error, TrainError::NoSteps { live: 0, count: 1, .. }), "{error}");
        assert_eq!(inflow.traffic.lost, 1);
    }

    #[test]
    fn a_learner_whose_sources_have_all_ended_ends_at_once() {
        let (mut inflow, inlet, policy) = opened();
        inflow.patience = PATIENCE;
        drop(inlet);
        let error = inflow.collect((policy, 0), 1, &AtomicBool::new(false)).unwrap_err();
        assert!(matches!(error, TrainError::NoSource), "{error}");
    }
}
