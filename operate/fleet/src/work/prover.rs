//! A prover: pulls the jobs of its compute class, does them, stores their results, and only then acknowledges them. If
//! it dies, the queue gives its unfinished jobs to other provers.

use super::compute_class::ComputeClass;
use super::job::{Answer, Job, Opened, Refusal};
use super::queue::{ACK_WAIT, Queue, Scope};
use crate::error::FleetError;
use async_nats::jetstream::{AckKind, Message};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use surefoot_net::metrics::family;
use surefoot_net::serving::Shutdown;
use tokio::task::JoinSet;
use tokio_stream::StreamExt;
use tracing::warn;

/// Maximum number of deliveries of a job. Then its sender gets a refusal: its provers keep dying.
const MAX_DELIVERIES: i64 = 5;
/// Duration of a request for a job.
const EXPIRES: Duration = Duration::from_secs(10);
/// Period at which a server shows that it is alive.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Pause before the queue is tried again.
const RETRY: Duration = Duration::from_millis(300);
/// Longest time for which a prover tries to store a result. Then the queue gives the job to another one.
const STORE_FOR: Duration = Duration::from_secs(30);
/// Longest time for which jobs continue after the signal to stop.
const DRAIN: Duration = Duration::from_secs(10);

/// Does jobs on threads that may block.
pub trait Runner: Send + Sync {
    /// Does a job and returns its result.
    fn run(&self, job: &Opened) -> Answer;

    /// Further metrics, in Prometheus text format.
    fn metrics(&self) -> String {
        String::new()
    }
}

/// Counters of a prover.
#[derive(Debug, Default)]
struct Counters {
    done: AtomicU64,
    refused: AtomicU64,
    damaged: AtomicU64,
    redelivered: AtomicU64,
    spared: AtomicU64,
    micros: AtomicU64,
}

impl Counters {
    fn add(counter: &AtomicU64) {
        counter.fetch_add(1, Ordering::Relaxed);
    }
}

/// A prover. Clones share its counters.
#[derive(Clone)]
pub struct Prover {
    queue: Queue,
    lane: ComputeClass,
    runner: Arc<dyn Runner>,
    counters: Arc<Counters>,
}

impl Prover {
    /// Creates a prover of a compute class.
    pub fn new(queue: Queue, lane: ComputeClass, runner: Arc<dyn Runner>) -> Self {
        Self { queue, lane, runner, counters: Arc::default() }
    }

    /// Does up to `thread_count` jobs at a time until `shutdown`. Started jobs may continue for 10 s.
    pub async fn run(self, thread_count: usize, shutdown: Shutdown) {
        let mut threads = JoinSet::new();
        for _ in 0..thread_count {
            threads.spawn(self.clone().work(shutdown.clone()));
        }
        shutdown.wait().await;
        // The queue gives longer jobs to other provers.
        let _ = tokio::time::timeout(DRAIN, threads.join_all()).await;
    }

    /// Metrics in Prometheus text format.
    pub fn metrics(&self) -> String {
        let Counters { done, refused, damaged, redelivered, spared, micros } = &*self.counters;
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed) as f64;
        let counters = [
            ("jobs_done_total", "Jobs done.", load(done)),
            ("jobs_failed_total", "Jobs that could not be done.", load(refused)),
            ("jobs_damaged_total", "Messages that were no jobs.", load(damaged)),
            ("jobs_redelivered_total", "Jobs that another prover had begun.", load(redelivered)),
            ("jobs_spared_total", "Jobs that were done already.", load(spared)),
            ("job_seconds_total", "Time spent on jobs, s.", load(micros) / 1.0e6),
        ];
        let counters = counters.map(|(name, help, count)| family(name, "counter", help, [("", count)]));
        counters.concat() + &self.queue.metrics() + &self.runner.metrics()
    }

    async fn work(self, shutdown: Shutdown) {
        while !shutdown.is_triggered() {
            let Err(error) = self.pull(&shutdown).await else { return };
            self.queue.note_unreachable(&error);
            tokio::select! {
                () = tokio::time::sleep(RETRY) => {}
                () = shutdown.wait() => {}
            }
        }
    }

    /// Does one job after another until `shutdown`.
    async fn pull(&self, shutdown: &Shutdown) -> Result<(), FleetError> {
        let consumer = self.queue.consumer(&self.lane).await?;
        self.queue.results().await?;
        // The next job is requested when this one is done, so that no prover holds waiting jobs.
        let messages = consumer.stream().max_messages_per_batch(1).heartbeat(HEARTBEAT).expires(EXPIRES);
        let mut messages = messages.messages().await.map_err(|error| self.queue.failed(error))?;
        self.queue.note_reachable();
        loop {
            let next = tokio::select! {
                () = shutdown.wait() => return Ok(()),
                next = messages.next() => next,
            };
            let message = next.ok_or_else(|| self.queue.failed("no more jobs"))?;
            self.handle(message.map_err(|error| self.queue.failed(error))?).await;
        }
    }

    async fn handle(&self, message: Message) {
        let opened = Job::open(&message.payload).map_err(|damage| damage.to_string());
        let scope = Scope::of_subject(&message.subject).ok_or_else(|| "its subject is unknown".to_owned());
        let (job, scope) = match opened.and_then(|job| Ok((job, scope?))) {
            Ok(both) => both,
            Err(reason) => {
                let (subject, bytes) = (&message.subject, message.payload.len());
                warn!(%subject, bytes, %reason, "prover: removed a message that is not a job");
                Counters::add(&self.counters.damaged);
                // Every prover would find the same.
                let _ = message.ack_with(AckKind::Term).await;
                return;
            }
        };
        let deliveries = message.info().map_or(1, |info| info.delivered);
        if deliveries > 1 {
            Counters::add(&self.counters.redelivered);
        }
        if self.queue.is_answered(&scope, job.id).await {
            Counters::add(&self.counters.spared);
            let _ = message.ack().await;
            return;
        }
        let answer = if deliveries > MAX_DELIVERIES {
            Err(Refusal::impossible(format!("{MAX_DELIVERIES} provers in a row ended while they did job {}", job.id)))
        } else {
            self.run_job(&message, job.clone()).await
        };
        if let Err(refusal) = &answer {
            Counters::add(&self.counters.refused);
            warn!(job = %job.id, kind = ?job.kind, reason = %refusal.reason, "prover: cannot do a job");
        } else {
            Counters::add(&self.counters.done);
        }
        if self.store(&message, &scope, &job, &answer).await {
            // If this is lost, the job is delivered again, and spared.
            let _ = message.ack().await;
        }
    }

    /// Does a job on a thread, and tells the server meanwhile that it goes on.
    async fn run_job(&self, message: &Message, job: Opened) -> Answer {
        let started = Instant::now();
        let runner = self.runner.clone();
        let mut running = tokio::task::spawn_blocking(move || runner.run(&job));
        let answer = loop {
            tokio::select! {
                ended = &mut running => break ended,
                () = tokio::time::sleep(ACK_WAIT / 3) => drop(message.ack_with(AckKind::Progress).await),
            }
        };
        self.counters.micros.fetch_add(started.elapsed().as_micros() as u64, Ordering::Relaxed);
        // What panics here would panic elsewhere.
        answer.unwrap_or_else(|error| Err(Refusal::impossible(error)))
    }

    /// Stores an answer; whether it is stored.
    async fn store(&self, message: &Message, scope: &Scope, job: &Opened, answer: &Answer) -> bool {
        let since = Instant::now();
        loop {
            let stored = async {
                if let Err(refusal) = answer
                    && refusal.is_final
                {
                    self.queue.bury(&self.lane, message.payload.to_vec(), &refusal.reason).await?;
                }
                self.queue.answer(scope, job.id, answer).await
            };
            match stored.await {
                Ok(()) => return true,
                Err(error) if since.elapsed() > STORE_FOR => {
                    warn!(%error, job = %job.id, "a result cannot be stored; another prover does the job again");
                    return false;
                }
                Err(_) => tokio::time::sleep(RETRY).await,
            }
        }
    }
}
