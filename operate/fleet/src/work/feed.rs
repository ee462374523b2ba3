//! The feed of a dispatch: sends its jobs to the queue and brings their answers, for as long as the dispatch lasts. While the queue is away,
//! it tries again.

use super::board::Board;
use super::compute_class::ComputeClass;
use super::job::{Answer, Job, JobId, open_answer};
use super::queue::{Queue, Scope};
use crate::error::FleetError;
use parking_lot::{Mutex, MutexGuard};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_stream::StreamExt;
use tracing::warn;

/// Pause before the queue is tried again.
const RETRY: Duration = Duration::from_millis(300);
/// Time without any answer after which jobs are sent again: the server may have lost them.
const RESEND: Duration = Duration::from_secs(30);
/// Interval in which a server shows that it is there.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// How long one request for answers waits.
const EXPIRES: Duration = Duration::from_secs(10);

/// Brings an answer to a job to whoever dispatches.
type Hear = dyn Fn(usize, Answer) + Send + Sync;

/// Sends jobs and brings answers until it is dropped; then jobs that nobody has begun leave the queue.
pub(super) struct Feed {
    shared: Arc<Shared>,
    task: JoinHandle<()>,
}

struct Shared {
    queue: Queue,
    lane: ComputeClass,
    scope: Scope,
    jobs: Vec<Job>,
    board: Arc<Board>,
    /// Number of each job in the stream, once it is there.
    sequences: Mutex<Vec<Option<u64>>>,
    /// Whether the answers were read that were there at first.
    is_read: watch::Sender<bool>,
    /// Number of answers so far.
    answers: watch::Sender<u64>,
}

impl Feed {
    /// Begins to send the jobs of `board`.
    pub fn start(
        (queue, lane, scope): (Queue, ComputeClass, Scope),
        jobs: Vec<Job>,
        board: Arc<Board>,
        hear: impl Fn(usize, Answer) + Send + Sync + 'static,
    ) -> Self {
        let sequences = Mutex::new(vec![None; jobs.len()]);
        let (is_read, answers) = (watch::Sender::new(false), watch::Sender::new(0));
        if !queue.is_connected() {
            queue.note_unreachable(&queue.failed("there is no connection"));
        }
        let shared = Arc::new(Shared { queue, lane, scope, jobs, board, sequences, is_read, answers });
        let running = shared.clone();
        let task = shared.queue.runtime.spawn(async move {
            tokio::join!(running.send_all(), running.read_all(&hear));
        });
        Self { shared, task }
    }

    /// Takes a job out of the queue that a thread of this process has begun, unless a prover has it already.
    pub fn withdraw(&self, idx: usize) {
        if let Some(sequence) = self.shared.sequences()[idx].take() {
            let shared = self.shared.clone();
            self.shared.queue.runtime.spawn(async move { shared.remove(&[sequence]).await });
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.task.abort();
        let rest: Vec<u64> = self.shared.sequences().iter_mut().filter_map(Option::take).collect();
        if !rest.is_empty() {
            let shared = self.shared.clone();
            self.shared.queue.runtime.spawn(async move { shared.remove(&rest).await });
        }
    }
}

impl Shared {
    fn sequences(&self) -> MutexGuard<'_, Vec<Option<u64>>> {
        self.sequences.lock()
    }

    /// Sends all jobs that are open, and again when nobody has answered for long.
    async fn send_all(&self) {
        // What was answered before, for a process that died, need not be sent. It never fails: the sender lives.
        let _ = self.is_read.subscribe().wait_for(|is_read| *is_read).await;
        let mut answers = self.answers.subscribe();
        loop {
            let nonce = self.queue.nonce();
            for idx in 0..self.jobs.len() {
                self.send(idx, &nonce).await;
            }
            while tokio::time::timeout(RESEND, answers.changed()).await.is_ok() {}
        }
    }

    /// Sends a job, as soon as the queue takes it.
    async fn send(&self, idx: usize, nonce: &str) {
        if !self.queue.fits(self.jobs[idx].bytes.len()) {
            self.board.forsake();
            return;
        }
        let is_open = || !self.board.is_settled(idx) && !self.board.is_taken(idx);
        while is_open() {
            match self.queue.send(&self.lane, &self.scope, &self.jobs[idx], &format!("{nonce} {idx}")).await {
                Ok(sequence) => {
                    self.queue.note_reachable();
                    if is_open() {
                        self.sequences()[idx] = Some(sequence);
                    } else {
                        self.remove(&[sequence]).await;
                    }
                    return;
                }
                Err(error) => {
                    self.queue.note_unreachable(&error);
                    // The stream is made again, should the server have lost it.
                    let _ = self.queue.jobs().await;
                    tokio::time::sleep(RETRY).await;
                }
            }
        }
    }

    /// Brings all answers. They are read again from the first whenever the connection was lost.
    async fn read_all(&self, hear: &Hear) {
        let places: HashMap<String, usize> =
            self.jobs.iter().enumerate().map(|(idx, job)| (job.id.to_string(), idx)).collect();
        loop {
            let Err(error) = self.read(&places, hear).await;
            self.queue.note_unreachable(&error);
            tokio::time::sleep(RETRY).await;
        }
    }

    async fn read(&self, places: &HashMap<String, usize>, hear: &Hear) -> Result<std::convert::Infallible, FleetError> {
        // All of it is there before anything is sent, so that autoscalers see jobs that wait where no prover is yet.
        self.queue.consumer(&self.lane).await?;
        let reader = self.queue.reader(&self.scope).await?;
        let mut pending = reader.cached_info().num_pending;
        let messages = reader.stream().heartbeat(HEARTBEAT).expires(EXPIRES).messages().await;
        let mut messages = messages.map_err(|error| self.queue.failed(error))?;
        self.queue.note_reachable();
        loop {
            if pending == 0 {
                self.is_read.send_replace(true);
            }
            let message = messages.next().await.ok_or_else(|| self.queue.failed("no more answers"))?;
            let message = message.map_err(|error| self.queue.failed(error))?;
            pending = pending.saturating_sub(1);
            let name = message.subject.rsplit('.').next().unwrap_or_default();
            let Some(&idx) = places.get(name) else { continue };
            self.hear(idx, self.jobs[idx].id, &message.payload, hear);
        }
    }

    fn hear(&self, idx: usize, job: JobId, bytes: &[u8], hear: &Hear) {
        match open_answer(job, bytes) {
            // Somebody was told before; this time it may go better.
            Ok(Err(_)) if !*self.is_read.borrow() => {}
            Ok(answer) => {
                self.sequences()[idx] = None;
                self.answers.send_modify(|count| *count += 1);
                hear(idx, answer);
            }
            Err(damage) => warn!(%job, %damage, "an answer is damaged, and ignored"),
        }
    }

    /// Removes jobs from the queue, as far as it is there. Those that are done are no longer in it.
    async fn remove(&self, sequences: &[u64]) {
        for &sequence in sequences {
            self.queue.remove(sequence).await;
        }
    }
}
