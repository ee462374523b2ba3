//! An actor: runs NPCs with the learner's weights, and sends their steps to the learner.

use super::wire as messages;
use crate::collector::CollectorStats;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::experience::Collected;
use crate::replay::Step;
use crate::source::{RunIo, Source};
use crate::worlds::Connect;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use surefoot_net::client::{Credentials, LinkError};
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_policy::{CheckpointError, Policy};
use surefoot_proto::learn::v1 as wire;
use surefoot_proto::learn::v1::feed_request::Message as FromActor;
use surefoot_proto::learn::v1::feed_response::Message as ToActor;
use surefoot_proto::learn::v1::learner_service_client::LearnerServiceClient;
use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status};

/// Most unacknowledged steps; then the NPCs wait.
const MAX_UNACKNOWLEDGED: usize = 8;
/// Wait before a lost learner is retried.
const RETRY: Duration = Duration::from_secs(1);
/// Longest wait for the learner's first messages.
const WELCOME_LIMIT: Duration = Duration::from_secs(30);
/// Interval at which a waiting actor checks whether to stop.
const LOOK: Duration = Duration::from_millis(100);
/// Interval of progress lines.
const REPORT_EVERY: Duration = Duration::from_secs(10);

/// Configuration of an actor, besides the learner's.
pub struct ActorConfig {
    /// Address of the learner.
    pub learner: String,
    /// Credentials for the learner.
    pub credentials: Credentials,
    /// Id of this actor, unique in the run.
    pub actor_id: String,
    /// Seed of goals and noise, different for each actor of a run.
    pub seed: u64,
    /// Saved levels to run instead of the learner's, whose files are on another machine.
    pub levels: Vec<PathBuf>,
    /// Address of a game or server that runs the NPCs; `None`: this process does.
    pub world: Option<String>,
    /// Connects to that address.
    pub connect: Connect,
}

/// Why an actor cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum ActorError {
    /// The address or the credentials of the learner are unusable.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The learner refused this actor or its steps.
    #[error("the learner refused: {0}")]
    Refused(String),
    /// The learner sent an unexpected message.
    #[error("the learner sent {0}")]
    Contract(String),
    /// The learner's configuration cannot be used here.
    #[error(transparent)]
    Config(#[from] TrainError),
    /// The learner's weights cannot be used.
    #[error(transparent)]
    Weights(#[from] CheckpointError),
    /// No threads can be started.
    #[error("cannot start threads")]
    Threads(#[from] std::io::Error),
}

/// Feeds a learner until `stop` is set, and reconnects whenever the connection is lost. Progress lines go to `report`.
///
/// # Errors
/// If the learner cannot be used: its address, its configuration, or its answers.
pub fn act(config: ActorConfig, stop: &AtomicBool, mut report: impl FnMut(&str)) -> Result<(), ActorError> {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let mut actor = Actor {
        config,
        npcs: None,
        unacknowledged: VecDeque::new(),
        last_number: 0,
        is_cut: false,
        tally: Tally::new(),
    };
    while !stop.load(Ordering::Relaxed) {
        match actor.run_session(&runtime, stop, &mut report) {
            Ok(()) => {}
            Err(Broken::Fatal(error)) => return Err(error),
            Err(Broken::Lost(reason)) => {
                report(&format!("the learner at {} is unreachable: {reason}; retrying", actor.config.learner));
                pause(RETRY, stop);
            }
        }
    }
    Ok(())
}

fn pause(time: Duration, stop: &AtomicBool) {
    let since = Instant::now();
    while since.elapsed() < time && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(LOOK.min(time));
    }
}

/// What ends a connection.
enum Broken {
    /// The connection was lost; retry.
    Lost(String),
    /// Retrying would not help.
    Fatal(ActorError),
}

impl<E: Into<ActorError>> From<E> for Broken {
    fn from(error: E) -> Self {
        Self::Fatal(error.into())
    }
}

impl Broken {
    fn of(status: &Status) -> Self {
        match status.code() {
            Code::InvalidArgument
            | Code::Unauthenticated
            | Code::PermissionDenied
            | Code::Unimplemented
            | Code::ResourceExhausted => Self::Fatal(ActorError::Refused(status.message().to_owned())),
            _ => Self::Lost(status.message().to_owned()),
        }
    }
}

struct Actor {
    config: ActorConfig,
    /// The NPCs, once the learner has sent its configuration.
    npcs: Option<NpcSource>,
    /// Steps that the learner has not acknowledged.
    unacknowledged: VecDeque<wire::FeedStep>,
    last_number: u64,
    /// Whether the next step does not continue the previous one.
    is_cut: bool,
    tally: Tally,
}

struct NpcSource {
    config: TrainConfig,
    source: Source,
    version: (Policy, u64),
}

/// The two ends of a connection.
struct Session {
    requests: mpsc::Sender<wire::FeedRequest>,
    responses: Receiver<Result<ToActor, Status>>,
}

impl Session {
    /// Opens a connection, and sends the hello.
    fn open(runtime: &Runtime, config: &ActorConfig) -> Result<Self, Broken> {
        let dialer = config.credentials.dial(&config.learner).map_err(ActorError::from)?;
        let link = runtime.block_on(dialer.connect()).map_err(|error| Broken::Lost(error.to_string()))?;
        let mut client = LearnerServiceClient::new(link)
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES);
        let (requests, outgoing) = mpsc::channel(MAX_UNACKNOWLEDGED + 1);
        let hello = FromActor::Hello(wire::Hello { actor_id: config.actor_id.clone() });
        let session = |responses| Self { requests: requests.clone(), responses };
        let (sender, responses) = channel();
        // The channel is empty, so this does not wait.
        let _ = requests.try_send(wire::FeedRequest { message: Some(hello) });
        let feeding = runtime.block_on(client.feed(ReceiverStream::new(outgoing)));
        let mut incoming = feeding.map_err(|status| Broken::of(&status))?.into_inner();
        runtime.spawn(async move {
            while let Some(response) = incoming.next().await {
                let message = response.map(|response| response.message).transpose();
                // A message of a later version of the contract is ignored.
                let Some(message) = message else { continue };
                if sender.send(message).is_err() {
                    return;
                }
            }
        });
        Ok(session(responses))
    }

    /// Waits for a message from the learner; `None` if none has arrived after `limit`.
    fn receive(&self, limit: Duration) -> Result<Option<ToActor>, Broken> {
        match self.responses.recv_timeout(limit) {
            Ok(message) => message.map(Some).map_err(|status| Broken::of(&status)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Broken::Lost("it closed the connection".to_owned())),
        }
    }

    fn send(&self, step: &wire::FeedStep) -> Result<(), Broken> {
        let request = wire::FeedRequest { message: Some(FromActor::Step(step.clone())) };
        self.requests.blocking_send(request).map_err(|_| Broken::Lost("it closed the connection".to_owned()))
    }
}

impl Actor {
    fn run_session(
        &mut self,
        runtime: &Runtime,
        stop: &AtomicBool,
        report: &mut impl FnMut(&str),
    ) -> Result<(), Broken> {
        let session = Session::open(runtime, &self.config)?;
        let Some(ToActor::Welcome(welcome)) = session.receive(WELCOME_LIMIT)? else {
            return Err(ActorError::Contract("no welcome".to_owned()).into());
        };
        let Some(ToActor::Weights(weights)) = session.receive(WELCOME_LIMIT)? else {
            return Err(ActorError::Contract("no weights".to_owned()).into());
        };
        self.prepare(&welcome, &weights)?;
        report(&format!("feeding {} with weights of {} updates", self.config.learner, weights.version));
        self.unacknowledged.retain(|step| step.number > welcome.taken);
        if welcome.taken < self.last_number
            && self.unacknowledged.front().is_none_or(|step| step.number > welcome.taken + 1)
        {
            // The learner resumed from an older checkpoint and lost steps that it had taken. Numbers continue.
            self.is_cut = true;
        }
        for step in &self.unacknowledged {
            session.send(step)?;
        }
        while !stop.load(Ordering::Relaxed) {
            while let Some(message) = session.receive(Duration::ZERO)? {
                self.note(message)?;
            }
            while self.unacknowledged.len() >= MAX_UNACKNOWLEDGED && !stop.load(Ordering::Relaxed) {
                if let Some(message) = session.receive(LOOK)? {
                    self.note(message)?;
                }
            }
            for step in self.collect(stop)? {
                session.send(&step)?;
                self.unacknowledged.push_back(step);
            }
            if let Some(line) = self.tally.line(&self.npcs) {
                report(&line);
            }
        }
        Ok(())
    }

    /// Creates the NPCs that the learner's configuration describes, unless they exist already.
    fn prepare(&mut self, welcome: &wire::Welcome, weights: &wire::Weights) -> Result<(), ActorError> {
        let mut config: TrainConfig = serde_json::from_str(&welcome.config)
            .map_err(|error| ActorError::Contract(format!("a malformed configuration: {error}")))?;
        config.seed = self.config.seed;
        config.actors = 0;
        if !self.config.levels.is_empty() {
            config.train_on_levels(self.config.levels.clone());
        }
        if let Some(world) = &self.config.world {
            config.worlds = vec![world.clone()];
            config.envs_per_world = 1;
            config.collector.npcs_per_world = welcome.npc_count as usize;
        }
        let version = messages::policy(weights, &config.name, config.sac.network)?;
        match &mut self.npcs {
            Some(npcs) if npcs.config == config => npcs.version = version,
            npcs => {
                config.validate()?;
                let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
                rng.set_stream(20);
                let io = RunIo { connect: self.config.connect.clone(), listener: None };
                let source = Source::new(&config, rng, version.0.clone(), io)?;
                if source.lane_count() != welcome.npc_count as usize {
                    let (found, wanted) = (source.lane_count(), welcome.npc_count);
                    return Err(ActorError::Contract(format!("a configuration of {found} NPCs, but expects {wanted}")));
                }
                self.is_cut = npcs.is_some();
                *npcs = Some(NpcSource { config, source, version });
            }
        }
        Ok(())
    }

    fn note(&mut self, message: ToActor) -> Result<(), ActorError> {
        match message {
            ToActor::Welcome(_) => return Err(ActorError::Contract("a second welcome".to_owned())),
            ToActor::Taken(taken) => self.unacknowledged.retain(|step| step.number > taken.number),
            ToActor::Weights(weights) => {
                let npcs = self.npcs.as_mut().expect("set by the welcome");
                self.tally.received += weights.weights.len();
                npcs.version = messages::policy(&weights, &npcs.config.name, npcs.config.sac.network)?;
            }
        }
        Ok(())
    }

    /// Collects one decision of each NPC.
    fn collect(&mut self, stop: &AtomicBool) -> Result<Vec<wire::FeedStep>, ActorError> {
        let npcs = self.npcs.as_mut().expect("set by the welcome");
        let collected = npcs.source.collect(npcs.version.clone(), 1, stop)?;
        let mut stats = npcs.source.take_stats();
        let mut steps = Vec::new();
        for (_, collected) in collected {
            match collected {
                Collected::Closed => self.is_cut = true,
                Collected::Step(step) => steps.push(self.message(&step, std::mem::take(&mut stats))),
            }
        }
        Ok(steps)
    }

    fn message(&mut self, step: &Step, stats: CollectorStats) -> wire::FeedStep {
        self.last_number += 1;
        let is_new = std::mem::take(&mut self.is_cut);
        let message = messages::step_to_wire(self.last_number, is_new, step, stats);
        self.tally.decisions += step.kinds.len();
        self.tally.sent += message.rows.len() + message.memory.len();
        message
    }
}

/// Counts since the last progress line.
struct Tally {
    decisions: usize,
    sent: usize,
    received: usize,
    since: Instant,
}

impl Tally {
    fn new() -> Self {
        Self { decisions: 0, sent: 0, received: 0, since: Instant::now() }
    }

    /// Returns a progress line, if one is due.
    fn line(&mut self, npcs: &Option<NpcSource>) -> Option<String> {
        let (elapsed, npcs) = (self.since.elapsed(), npcs.as_ref()?);
        if elapsed < REPORT_EVERY {
            return None;
        }
        let rate = |count: usize| count as f64 / elapsed.as_secs_f64();
        let line = format!(
            "{:.0} decisions/s | sent {:.0} kB/s, received {:.0} kB/s of weights | weights of {} updates",
            rate(self.decisions),
            rate(self.sent) * 1e-3,
            rate(self.received) * 1e-3,
            npcs.version.1,
        );
        *self = Self::new();
        Some(line)
    }
}
