//! A dispatch: jobs that belong together. Each is done by a prover or by a thread of this process, whichever is first.
//!
//! Provers start with the first jobs, threads here with the last, until all jobs are settled. A prover that dies, an
//! unreachable queue, or no prover at all cost time, never the result.

use super::board::Board;
use super::compute_class::ComputeClass;
use super::feed::Feed;
use super::job::{Answer, Job};
use super::queue::{Queue, Scope};
use crate::error::FleetError;
use parking_lot::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use surefoot_net::metrics::family;
use tracing::warn;

/// Period at which cancellation is checked.
const TURN: Duration = Duration::from_millis(20);
/// Silence of all provers after which this process does all jobs.
const SILENCE: Duration = Duration::from_secs(2);
/// Time for which provers that have answered are expected to answer again.
const MEMORY: Duration = Duration::from_secs(60);

/// The content of jobs, and how this process does them without provers.
pub trait Work: Sync {
    /// Result of a job.
    type Output: Send + 'static;

    /// Does a job in this process. Returns `None` if `is_settled` became true before it was done. An error ends the
    /// dispatch.
    fn run_locally(&self, idx: usize, is_settled: &(dyn Fn() -> bool + Sync)) -> Option<Result<Self::Output, String>>;

    /// Reads and checks the result of a prover. An invalid one is ignored.
    fn read(&self, idx: usize, result: &[u8]) -> Result<Self::Output, String>;

    /// Called once for each job, by the thread that dispatches.
    fn settled(&self, _idx: usize, _output: &Self::Output) {}

    /// Whether the remaining jobs need not be done.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Threads of this process that do jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Threads {
    /// Number while provers answer.
    pub beside_provers: usize,
    /// Number while no prover answers.
    pub alone: usize,
}

/// Sends jobs. Clones share their knowledge of provers.
#[derive(Debug, Clone)]
pub struct Dispatcher {
    queue: Queue,
    lane: ComputeClass,
    known: Arc<Known>,
}

/// Knowledge of provers.
#[derive(Debug, Default)]
struct Known {
    /// Time of the latest answer.
    heard: Mutex<Option<Instant>>,
    done_here: AtomicU64,
    done_there: AtomicU64,
    ignored: AtomicU64,
}

impl Known {
    fn hear(&self) {
        *self.heard.lock() = Some(Instant::now());
    }

    /// Whether no prover has answered since `since`.
    fn is_silent(&self, since: Instant) -> bool {
        let heard = *self.heard.lock();
        heard.is_none_or(|heard| heard.elapsed() > MEMORY || heard.max(since).elapsed() > SILENCE)
    }
}

/// The end of a job.
enum Event<T> {
    /// A thread of this process did it.
    Here(usize, Result<T, String>),
    /// A prover answered.
    There(usize, Answer),
}

impl Dispatcher {
    /// Sends jobs to provers of a lane.
    pub fn new(queue: Queue, lane: ComputeClass) -> Self {
        Self { queue, lane, known: Arc::default() }
    }

    /// The queue.
    pub fn queue(&self) -> &Queue {
        &self.queue
    }

    /// Gets all jobs done and returns their results, in order; `None` if the work was cancelled. Call this from a
    /// thread that may block.
    pub fn run<W: Work>(
        &self,
        jobs: Vec<Job>,
        work: &W,
        threads: Threads,
    ) -> Result<Option<Vec<W::Output>>, FleetError> {
        let count = jobs.len();
        if count == 0 {
            return Ok(Some(Vec::new()));
        }
        let (since, board) = (Instant::now(), Arc::new(Board::new(count)));
        let (events, inbox) = mpsc::channel::<Event<W::Output>>();
        let answers = events.clone();
        let hear = {
            let board = board.clone();
            move |idx, answer| {
                if board.admit(idx) {
                    // The receiver may have been dropped.
                    let _ = answers.send(Event::There(idx, answer));
                }
            }
        };
        let scope = Scope::of(&jobs);
        let feed = Feed::start((self.queue.clone(), self.lane.clone(), scope), jobs, board.clone(), hear);
        std::thread::scope(|scope| {
            let thread_count = threads.alone.max(threads.beside_provers).max(1).min(count);
            for idx in 0..thread_count {
                let (events, board, feed, known) = (events.clone(), &*board, &feed, &*self.known);
                scope.spawn(move || {
                    let may_work = || idx < threads.beside_provers || board.is_forsaken() || known.is_silent(since);
                    while !board.is_over() {
                        if !may_work() {
                            std::thread::sleep(TURN);
                            continue;
                        }
                        let Some(idx) = board.take() else { return };
                        feed.withdraw(idx);
                        if let Some(done) = work.run_locally(idx, &|| board.is_settled(idx)) {
                            // The receiver may have been dropped.
                            let _ = events.send(Event::Here(idx, done));
                        }
                    }
                });
            }
            let ended = self.gather(&inbox, &board, work, count);
            board.end();
            ended
        })
    }

    /// Takes the first result of each job.
    fn gather<W: Work>(
        &self,
        inbox: &mpsc::Receiver<Event<W::Output>>,
        board: &Board,
        work: &W,
        count: usize,
    ) -> Result<Option<Vec<W::Output>>, FleetError> {
        let mut outputs: Vec<Option<W::Output>> = (0..count).map(|_| None).collect();
        let mut open = count;
        while open > 0 {
            if work.is_cancelled() {
                return Ok(None);
            }
            let Ok(event) = inbox.recv_timeout(TURN) else { continue };
            if matches!(event, Event::There(..)) {
                board.release();
            }
            let (idx, output) = match event {
                Event::Here(idx, done) => {
                    self.known.done_here.fetch_add(1, Ordering::Relaxed);
                    (idx, done.map_err(|reason| self.queue.failed(reason))?)
                }
                Event::There(idx, _) if board.is_settled(idx) => continue,
                Event::There(idx, answer) => match self.read(work, idx, answer)? {
                    Some(output) => (idx, output),
                    None => {
                        board.forsake();
                        continue;
                    }
                },
            };
            if !board.settle(idx) {
                continue;
            }
            work.settled(idx, &output);
            outputs[idx] = Some(output);
            open -= 1;
        }
        Ok(outputs.into_iter().collect())
    }

    /// Reads the answer of a prover; `None` if it is invalid.
    fn read<W: Work>(&self, work: &W, idx: usize, answer: Answer) -> Result<Option<W::Output>, FleetError> {
        self.known.hear();
        let reason = match answer {
            Ok(result) => match work.read(idx, &result) {
                Ok(output) => {
                    self.known.done_there.fetch_add(1, Ordering::Relaxed);
                    return Ok(Some(output));
                }
                Err(reason) => reason,
            },
            Err(refusal) if refusal.is_final => return Err(self.queue.failed(refusal.reason)),
            Err(refusal) => refusal.reason,
        };
        warn!(%reason, "provers: an answer is invalid; this process does the job");
        self.known.ignored.fetch_add(1, Ordering::Relaxed);
        Ok(None)
    }

    /// Metrics in Prometheus text format.
    pub fn metrics(&self) -> String {
        let Known { done_here, done_there, ignored, .. } = &*self.known;
        let [here, there, ignored] = [done_here, done_there, ignored].map(|count| count.load(Ordering::Relaxed) as f64);
        let settled = [("{by=\"provers\"}", there), ("{by=\"this\"}", here)];
        self.queue.metrics()
            + &family("jobs_settled_total", "counter", "Jobs of builds, by the process that did them.", settled)
            + &family("answers_ignored_total", "counter", "Invalid answers of provers.", [("", ignored)])
    }
}
