//! The queue: a stream of NATS JetStream with jobs, which are removed when they are done, and a stream with answers,
//! which are kept for an hour, so that a restarted build finds earlier results. A third keeps jobs that no prover
//! could do.

use super::compute_class::ComputeClass;
use super::job::{Answer, Job, JobId, Refusal, open_answer, seal_answer};
use crate::error::FleetError;
use async_nats::connection::State;
use async_nats::jetstream::consumer::{AckPolicy, DeliverPolicy, PullConsumer, pull};
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, Stream};
use async_nats::jetstream::{Context, ContextBuilder};
use async_nats::{ConnectOptions, ServerAddr};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use surefoot_net::metrics::family;
use tokio::runtime::Handle;
use tracing::{info, warn};

/// Stream of jobs, as `operate/deploy/fleet/prover.yaml` names it.
const JOBS: &str = "SUREFOOT_JOBS";
/// Stream of answers.
const RESULTS: &str = "SUREFOOT_RESULTS";
/// Stream of jobs that no prover could do.
const DEAD: &str = "SUREFOOT_DEAD";
/// Maximum size of waiting jobs, bytes. Further jobs are refused; their senders try again and meanwhile do them
/// themselves.
const MAX_JOB_BYTES: i64 = 256 << 20;
/// Maximum size of stored answers, bytes. The oldest are removed.
const MAX_RESULT_BYTES: i64 = 1 << 30;
/// Time for which jobs and answers are kept.
const KEPT_FOR: Duration = Duration::from_secs(3600);
/// Time for which jobs that no prover could do are kept.
const DEAD_FOR: Duration = Duration::from_secs(7 * 24 * 3600);
/// Time after which a job is given to another prover, if its prover does not report progress.
pub(super) const ACK_WAIT: Duration = Duration::from_secs(10);
/// Longest wait for an answer of the server.
const PATIENCE: Duration = Duration::from_secs(2);
/// Space for the headers of a message, bytes.
const HEADER_LEN: usize = 1024;
/// Time after which the server forgets a reader of answers.
const READER_GONE: Duration = Duration::from_secs(60);

/// Jobs that belong together: their answers arrive together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Scope(String);

impl Scope {
    /// Returns the scope of these jobs, which is the same in every process.
    pub fn of(jobs: &[Job]) -> Self {
        let mut hasher = blake3::Hasher::new();
        jobs.iter().for_each(|job| {
            hasher.update(job.id.to_string().as_bytes());
        });
        Self(hasher.finalize().to_hex()[..32].to_owned())
    }

    /// Returns the scope in the subject of a job; `None` if the subject is unknown.
    pub fn of_subject(subject: &str) -> Option<Self> {
        let (_, last) = subject.rsplit_once('.')?;
        let is_ours = last.len() == 32 && last.bytes().all(|digit| digit.is_ascii_hexdigit());
        is_ours.then(|| Self(last.to_owned()))
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A connection to the queue, restored whenever it is lost. Clones share it.
#[derive(Debug, Clone)]
pub struct Queue {
    context: Context,
    place: String,
    /// Whether a warning says that it is unreachable.
    is_unavailable: Arc<AtomicBool>,
    pub(super) runtime: Handle,
}

impl Queue {
    /// Starts to connect to `urls`, `nats://user:password@host:port`, separated by commas. It does not wait for the
    /// server. Call this on a tokio runtime.
    pub async fn open(urls: &str) -> Result<Self, FleetError> {
        let malformed = |why: &dyn fmt::Display| {
            FleetError::new(
                "--nats",
                format!("{why}; it is nats://user:password@host:port, separate several by commas"),
            )
        };
        let addresses: Result<Vec<ServerAddr>, _> = urls.split(',').map(|url| url.trim().parse()).collect();
        let addresses = addresses.map_err(|error: std::io::Error| malformed(&error))?;
        let places: Vec<String> =
            addresses.iter().map(|address| format!("nats://{}:{}", address.host(), address.port())).collect();
        let place = places.join(",");
        let options = ConnectOptions::new().name("surefoot").retry_on_initial_connect().request_timeout(Some(PATIENCE));
        let options = options.reconnect_delay_callback(|attempts| {
            Duration::from_millis(50 << attempts.min(5)).min(Duration::from_secs(1))
        });
        let client = options.connect(addresses).await.map_err(|error| FleetError::new(place.clone(), error))?;
        let context = ContextBuilder::new().timeout(PATIENCE).ack_timeout(PATIENCE).build(client);
        Ok(Self { context, place, is_unavailable: Arc::default(), runtime: Handle::current() })
    }

    /// Addresses of the servers, without passwords.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Whether there is a connection now.
    pub fn is_connected(&self) -> bool {
        self.context.client().connection_state() == State::Connected
    }

    /// Metrics in Prometheus text format.
    pub(super) fn metrics(&self) -> String {
        let is_connected = f64::from(u8::from(self.is_connected()));
        family("queue_connected", "gauge", "Whether NATS answers.", [("", is_connected)])
    }

    /// Logs that the queue is unreachable, unless that is logged.
    pub(super) fn note_unreachable(&self, error: &FleetError) {
        if !self.is_unavailable.swap(true, Ordering::Relaxed) {
            warn!(%error, "queue: NATS is unreachable; this process works alone");
        }
    }

    /// Logs that the queue is reachable again, if it was unreachable.
    pub(super) fn note_reachable(&self) {
        if self.is_unavailable.swap(false, Ordering::Relaxed) {
            info!(nats = %self.place, "queue: NATS is reachable again");
        }
    }

    /// Whether the server accepts a message of this size.
    pub(super) fn fits(&self, bytes: usize) -> bool {
        // The limit is unknown before the first connection.
        let most = self.context.client().server_info().max_payload;
        most == 0 || bytes + HEADER_LEN <= most
    }

    /// Returns a unique name.
    pub(super) fn nonce(&self) -> String {
        self.context.client().new_inbox()
    }

    pub(super) fn failed(&self, error: impl fmt::Display) -> FleetError {
        FleetError::new(self.place.clone(), error)
    }

    async fn stream(&self, config: Config) -> Result<Stream, FleetError> {
        self.context.get_or_create_stream(config).await.map_err(|error| self.failed(error))
    }

    pub(super) async fn jobs(&self) -> Result<Stream, FleetError> {
        let config = Config {
            name: JOBS.to_owned(),
            subjects: vec!["surefoot.jobs.>".to_owned()],
            retention: RetentionPolicy::WorkQueue,
            discard: DiscardPolicy::New,
            max_bytes: MAX_JOB_BYTES,
            max_age: KEPT_FOR,
            ..Config::default()
        };
        self.stream(config).await
    }

    pub(super) async fn results(&self) -> Result<Stream, FleetError> {
        let config = Config {
            name: RESULTS.to_owned(),
            subjects: vec!["surefoot.results.>".to_owned()],
            max_bytes: MAX_RESULT_BYTES,
            max_age: KEPT_FOR,
            max_messages_per_subject: 1,
            allow_direct: true,
            ..Config::default()
        };
        self.stream(config).await
    }

    /// Returns the consumer from which the provers of a compute class pull.
    pub(super) async fn consumer(&self, lane: &ComputeClass) -> Result<PullConsumer, FleetError> {
        let name = format!("prove-{lane}");
        let config = pull::Config {
            durable_name: Some(name.clone()),
            filter_subject: format!("surefoot.jobs.{lane}.*"),
            ack_policy: AckPolicy::Explicit,
            ack_wait: ACK_WAIT,
            ..pull::Config::default()
        };
        self.jobs().await?.get_or_create_consumer(&name, config).await.map_err(|error| self.failed(error))
    }

    /// Returns the reader of the answers of a scope: existing ones, then new ones.
    pub(super) async fn reader(&self, scope: &Scope) -> Result<PullConsumer, FleetError> {
        let config = pull::Config {
            deliver_policy: DeliverPolicy::All,
            filter_subject: format!("surefoot.results.{scope}.*"),
            ack_policy: AckPolicy::None,
            memory_storage: true,
            inactive_threshold: READER_GONE,
            ..pull::Config::default()
        };
        self.results().await?.create_consumer(config).await.map_err(|error| self.failed(error))
    }

    /// Sends a job and returns its sequence number. `message` identifies repeats of one try to send it.
    pub(super) async fn send(
        &self,
        lane: &ComputeClass,
        scope: &Scope,
        job: &Job,
        message: &str,
    ) -> Result<u64, FleetError> {
        let publish = PublishMessage::build().payload(job.bytes.clone().into()).message_id(message);
        self.publish(format!("surefoot.jobs.{lane}.{scope}"), publish).await
    }

    /// Stores an answer. A too large one becomes a refusal.
    pub(super) async fn answer(&self, scope: &Scope, job: JobId, answer: &Answer) -> Result<(), FleetError> {
        let mut bytes = seal_answer(job, answer);
        if !self.fits(bytes.len()) {
            let refusal = Refusal::unable(format!("a result of {} bytes is more than NATS takes", bytes.len()));
            bytes = seal_answer(job, &Err(refusal));
        }
        let publish = PublishMessage::build().payload(bytes.into());
        self.publish(result_subject(scope, job), publish).await?;
        Ok(())
    }

    /// Whether the job is done: it was sent twice, or its prover died before it acknowledged the job.
    pub(super) async fn is_answered(&self, scope: &Scope, job: JobId) -> bool {
        let Ok(results) = self.context.get_stream_no_info(RESULTS).await else { return false };
        let found = results.direct_get_last_for_subject(result_subject(scope, job)).await;
        found.is_ok_and(|found| matches!(open_answer(job, &found.payload), Ok(Ok(_))))
    }

    /// Keeps a job that no prover could do.
    pub(super) async fn bury(&self, lane: &ComputeClass, bytes: Vec<u8>, reason: &str) -> Result<(), FleetError> {
        let config = Config {
            name: DEAD.to_owned(),
            subjects: vec!["surefoot.dead.>".to_owned()],
            max_bytes: MAX_JOB_BYTES,
            max_age: DEAD_FOR,
            ..Config::default()
        };
        self.stream(config).await?;
        // Headers must not contain line breaks.
        let reason: String = reason.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
        let publish = PublishMessage::build().payload(bytes.into()).header("Reason", reason.as_str());
        self.publish(format!("surefoot.dead.{lane}"), publish).await?;
        Ok(())
    }

    /// Removes a job that no process has started.
    pub(super) async fn remove(&self, sequence: u64) {
        let Ok(jobs) = self.context.get_stream_no_info(JOBS).await else { return };
        // It may be done already. If the queue is unreachable, a prover does it in vain.
        let _ = jobs.delete_message(sequence).await;
    }

    async fn publish(&self, subject: String, publish: PublishMessage) -> Result<u64, FleetError> {
        let sent = self.context.send_publish(subject, publish).await.map_err(|error| self.failed(error))?;
        Ok(sent.await.map_err(|error| self.failed(error))?.sequence)
    }
}

fn result_subject(scope: &Scope, job: JobId) -> String {
    format!("surefoot.results.{scope}.{job}")
}
