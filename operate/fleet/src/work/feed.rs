//! The feed of a dispatch: sends its jobs to the queue and receives their answers, until the dispatch ends. While the
//! queue is unreachable, it tries again.

use super::board::Board;
use super::compute_class::ComputeClass;
use super::job::{Answer, Job, JobId, open_answer};
use super::queue::{Queue, Scope};
use crate::error::FleetError;
use parking_lot::Mutex;
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
/// Period at which a server shows that it is alive.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Duration of one request for answers.
const EXPIRES: Duration = Duration::from_secs(10);

/// Takes an answer to a job.
type Hear = dyn Fn(usize, Answer) + Send + Sync;

/// Sends jobs and receives answers until it is dropped. Then it removes jobs that no process has started from the
/// queue.
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
    /// Sequence number of each job that is in the stream.
    sequences: Mutex<Vec<Option<u64>>>,
    /// Whether the answers that existed at the start have been read.
    is_read: watch::Sender<bool>,
    /// Number of answers so far.
    answers: watch::Sender<u64>,
}

impl Feed {
    /// Starts to send the jobs of `board`.
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

    /// Removes a job that this process has started from the queue, unless a prover has it.
    pub fn withdraw(&self, idx: usize) {
        if let Some(sequence) = self.shared.sequences.lock()[idx].take() {
            let shared = self.shared.clone();
            self.shared.queue.runtime.spawn(async move { shared.remove(&[sequence]).await });
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.task.abort();
        let rest: Vec<u64> = self.shared.sequences.lock().iter_mut().filter_map(Option::take).collect();
        if !rest.is_empty() {
            let shared = self.shared.clone();
            self.shared.queue.runtime.spawn(async move { shared.remove(&rest).await });
        }
    }
}

impl Shared {
    /// Sends all open jobs, and again after a long time without answers.
    async fn send_all(&self) {
        // Jobs that were answered for an earlier process need not be sent. The wait never fails: the sender lives.
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
                        self.sequences.lock()[idx] = Some(sequence);
                    } else {
                        self.remove(&[sequence]).await;
                    }
                    return;
                }
                Err(error) => {
                    self.queue.note_unreachable(&error);
                    // The server may have lost the stream: create it again.
                    let _ = self.queue.jobs().await;
                    tokio::time::sleep(RETRY).await;
                }
            }
        }
    }

    /// Receives all answers. After a lost connection, it starts again with the first.
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
        // The consumer exists before jobs are sent, so that autoscalers see waiting jobs before there is a prover.
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
            // An earlier process got this refusal; another try may succeed.
            Ok(Err(_)) if !*self.is_read.borrow() => {}
            Ok(answer) => {
                self.sequences.lock()[idx] = None;
                self.answers.send_modify(|count| *count += 1);
                hear(idx, answer);
            }
            Err(damage) => warn!(%job, %damage, "provers: ignored a damaged answer"),
        }
    }

    /// Removes jobs from the queue. Jobs that are done are no longer in it.
    async fn remove(&self, sequences: &[u64]) {
        for &sequence in sequences {
            self.queue.remove(sequence).await;
        }
    }
}
