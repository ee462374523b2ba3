//! The queue: two streams of NATS JetStream, one with jobs, which are removed when they are done, and one with answers, which are kept for an
//! hour, so that a build that starts again finds what was proved before. A third keeps jobs that nobody could do.

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
use tokio::runtime::Handle;
use tracing::{info, warn};

/// Stream of jobs, as `operate/deploy/fleet/prover.yaml` names it.
const JOBS: &str = "SUREFOOT_JOBS";
/// Stream of answers.
const RESULTS: &str = "SUREFOOT_RESULTS";
/// Stream of jobs that nobody could do.
const DEAD: &str = "SUREFOOT_DEAD";
/// Most bytes of jobs that wait. Further ones are refused, and whoever sends them tries again and works on by itself meanwhile.
const MAX_JOB_BYTES: i64 = 256 << 20;
/// Most bytes of answers that are kept; the oldest are removed.
const MAX_RESULT_BYTES: i64 = 1 << 30;
/// Time for which jobs and answers are kept.
const KEPT_FOR: Duration = Duration::from_secs(3600);
/// Time for which jobs that nobody could do are kept.
const DEAD_FOR: Duration = Duration::from_secs(7 * 24 * 3600);
/// Time after which a job whose prover does not say that it goes on is given to another one.
pub(super) const ACK_WAIT: Duration = Duration::from_secs(10);
/// Longest wait for an answer of the server.
const PATIENCE: Duration = Duration::from_secs(2);
/// Room that headers of a message take, bytes.
const HEADER_LEN: usize = 1024;
/// Time after which the server forgets who waits for answers.
const READER_GONE: Duration = Duration::from_secs(60);

/// Jobs that belong together: their answers arrive together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Scope(String);

impl Scope {
    /// The scope of these jobs: the same for the same jobs, also in another process.
    pub fn of(jobs: &[Job]) -> Self {
        let mut hasher = blake3::Hasher::new();
        jobs.iter().for_each(|job| {
            hasher.update(job.id.to_string().as_bytes());
        });
        Self(hasher.finalize().to_hex()[..32].to_owned())
    }

    /// The scope in the subject of a job.
    fn of_subject(subject: &str) -> Option<Self> {
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

/// A connection to the queue, which is made again whenever it is lost. Clones share it.
#[derive(Debug, Clone)]
pub struct Queue {
    context: Context,
    place: String,
    /// Whether somebody was told that it is away.
    is_unavailable: Arc<AtomicBool>,
    pub(super) runtime: Handle,
}

impl Queue {
    /// Begins to connect to `urls`, `nats://user:password@host:port`, divided by commas. It does not wait until the server answers. Call
    /// this on a tokio runtime.
    ///
    /// # Errors
    /// If a URL is malformed.
    pub async fn open(urls: &str) -> Result<Self, FleetError> {
        let malformed = |why: &dyn fmt::Display| {
            FleetError::new(
                "--nats",
                format!("{why}; it is nats://user:password@host:port, several are divided by commas"),
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

    /// Says that the queue is away, once in a row.
    pub(super) fn note_unreachable(&self, error: &FleetError) {
        if !self.is_unavailable.swap(true, Ordering::Relaxed) {
            warn!(%error, "the queue is away");
        }
    }

    /// Says that the queue is back if it was away.
    pub(super) fn note_reachable(&self) {
        if self.is_unavailable.swap(false, Ordering::Relaxed) {
            info!(nats = %self.place, "the queue is back");
        }
    }

    /// Whether the server takes a message of this many bytes.
    pub(super) fn fits(&self, bytes: usize) -> bool {
        // Before the first connection, nothing is known.
        let most = self.context.client().server_info().max_payload;
        most == 0 || bytes + HEADER_LEN <= most
    }

    /// A name that nobody else has.
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

    /// The consumer from which the provers of a lane pull.
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

    /// Whoever waits for the answers of a scope: those that are there, then those that come.
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

    /// Sends a job and returns its number in the stream. `message` tells repeats of the same attempt to send it.
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

    /// Stores an answer; one that is too long becomes a refusal.
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

    /// Whether the job is done already: it was sent twice, or its prover died before it could say so.
    pub(super) async fn is_answered(&self, scope: &Scope, job: JobId) -> bool {
        let Ok(results) = self.context.get_stream_no_info(RESULTS).await else { return false };
        let found = results.direct_get_last_for_subject(result_subject(scope, job)).await;
        found.is_ok_and(|found| matches!(open_answer(job, &found.payload), Ok(Ok(_))))
    }

    /// Keeps a job that nobody could do.
    pub(super) async fn bury(&self, lane: &ComputeClass, bytes: Vec<u8>, reason: &str) -> Result<(), FleetError> {
        let config = Config {
            name: DEAD.to_owned(),
            subjects: vec!["surefoot.dead.>".to_owned()],
            max_bytes: MAX_JOB_BYTES,
            max_age: DEAD_FOR,
            ..Config::default()
        };
        self.stream(config).await?;
        // Headers are lines.
        let reason: String = reason.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
        let publish = PublishMessage::build().payload(bytes.into()).header("Reason", reason.as_str());
        self.publish(format!("surefoot.dead.{lane}"), publish).await?;
        Ok(())
    }

    /// Removes a job that nobody has begun.
    pub(super) async fn remove(&self, sequence: u64) {
        let Ok(jobs) = self.context.get_stream_no_info(JOBS).await else { return };
        // It may be done already. If the queue is away, a prover does it for nobody.
        let _ = jobs.delete_message(sequence).await;
    }

    async fn publish(&self, subject: String, publish: PublishMessage) -> Result<u64, FleetError> {
        let sent = self.context.send_publish(subject, publish).await.map_err(|error| self.failed(error))?;
        Ok(sent.await.map_err(|error| self.failed(error))?.sequence)
    }
}

/// The scope in the subject of a job; `None` if the job is not one of ours.
pub(super) fn scope_of(subject: &str) -> Option<Scope> {
    Scope::of_subject(subject)
}

fn result_subject(scope: &Scope, job: JobId) -> String {
    format!("surefoot.results.{scope}.{job}")
}
