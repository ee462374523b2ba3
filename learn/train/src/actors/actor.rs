//! An actor: NPCs that act with the learner's weights, and whose experience goes to the learner.

use super::wire as messages;
use crate::collector::CollectorStats;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::inflow::Collected;
use crate::replay::Step;
use crate::source::{Source, Ties};
use crate::worlds::Connect;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
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

/// Steps that may be on their way; then the NPCs wait.
const MAX_UNTAKEN: usize = 8;
/// Wait before a learner that went away is tried again.
const RETRY: Duration = Duration::from_secs(1);
/// Longest wait for the learner's first words.
const WELCOME_LIMIT: Duration = Duration::from_secs(30);
/// Interval at which an actor that waits looks whether it should stop.
const LOOK: Duration = Duration::from_millis(100);
/// Interval between two lines that tell how it goes.
const TELL_EVERY: Duration = Duration::from_secs(10);

/// What an actor is told besides the learner's configuration.
pub struct ActorConfig {
    /// Address of the learner.
    pub learner: String,
    /// What the learner is shown.
    pub credentials: Credentials,
    /// Name of this actor, which must be no other's; kept while it runs.
    pub actor_id: String,
    /// Seed of goals and noise; each actor of a run needs another one.
    pub seed: u64,
    /// Saved levels to run instead of the learner's, whose files are elsewhere.
    pub levels: Vec<PathBuf>,
    /// A game or server in which the NPCs move, instead of this process.
    pub world: Option<String>,
    /// Connects to it.
    pub connect: Connect,
}

/// Why an actor cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ActorError {
    /// The address or the credentials of the learner are unusable.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The learner does not want this actor, or what it feeds.
    #[error("the learner refused: {0}")]
    Refused(String),
    /// What the learner sent makes no sense.
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

/// Feeds a learner until `stop` is set; while it is away, waits for it to come back. Lines that tell how it goes are passed to `report`.
///
/// # Errors
/// If the learner cannot be used: its address, its configuration, or its answers.
pub fn act(config: ActorConfig, stop: &AtomicBool, mut report: impl FnMut(&str)) -> Result<(), ActorError> {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let mut actor =
        Actor { config, crew: None, untaken: VecDeque::new(), last_number: 0, is_cut: false, tally: Tally::new() };
    while !stop.load(Ordering::Relaxed) {
        match actor.run_session(&runtime, stop, &mut report) {
            Ok(()) => {}
            Err(Broken::ForGood(error)) => return Err(error),
            Err(Broken::Away(reason)) => {
                report(&format!("the learner at {} is away: {reason}", actor.config.learner));
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
    /// The learner may come back.
    Away(String),
    /// It is of no use.
    ForGood(ActorError),
}

impl<E: Into<ActorError>> From<E> for Broken {
    fn from(error: E) -> Self {
        Self::ForGood(error.into())
    }
}

impl Broken {
    fn of(status: &Status) -> Self {
        match status.code() {
            Code::InvalidArgument
            | Code::Unauthenticated
            | Code::PermissionDenied
            | Code::Unimplemented
            | Code::ResourceExhausted => Self::ForGood(ActorError::Refused(status.message().to_owned())),
            _ => Self::Away(status.message().to_owned()),
        }
    }
}

struct Actor {
    config: ActorConfig,
    /// The NPCs, once the learner has said what to do.
    crew: Option<Crew>,
    /// Messages that the learner has not said to have taken.
    untaken: VecDeque<wire::FeedStep>,
    last_number: u64,
    /// Whether the next step does not continue the one before.
    is_cut: bool,
    tally: Tally,
}

struct Crew {
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
    /// Opens a connection, and says who we are.
    fn open(runtime: &Runtime, config: &ActorConfig) -> Result<Self, Broken> {
        let dialer = config.credentials.dial(&config.learner).map_err(ActorError::from)?;
        let link = runtime.block_on(dialer.connect()).map_err(|error| Broken::Away(error.to_string()))?;
        let mut client = LearnerServiceClient::new(link)
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES);
        let (requests, outgoing) = mpsc::channel(MAX_UNTAKEN + 1);
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

    /// Waits for a message of the learner.
    fn receive(&self, limit: Duration) -> Result<Option<ToActor>, Broken> {
        match self.responses.recv_timeout(limit) {
            Ok(message) => message.map(Some).map_err(|status| Broken::of(&status)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Broken::Away("it ended the connection".to_owned())),
        }
    }

    /// A message of the learner that is there already.
    fn poll(&self) -> Result<Option<ToActor>, Broken> {
        match self.responses.try_recv() {
            Ok(message) => message.map(Some).map_err(|status| Broken::of(&status)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(Broken::Away("it ended the connection".to_owned())),
        }
    }

    fn send(&self, step: &wire::FeedStep) -> Result<(), Broken> {
        let request = wire::FeedRequest { message: Some(FromActor::Step(step.clone())) };
        self.requests.blocking_send(request).map_err(|_| Broken::Away("it ended the connection".to_owned()))
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
        self.untaken.retain(|step| step.number > welcome.taken);
        if welcome.taken < self.last_number && self.untaken.front().is_none_or(|step| step.number > welcome.taken + 1) {
            // The learner has lost steps of ours that it had taken, since it went on from an older checkpoint. Numbers go on.
            self.is_cut = true;
        }
        for step in &self.untaken {
            session.send(step)?;
        }
        while !stop.load(Ordering::Relaxed) {
            while let Some(message) = session.poll()? {
                self.note(message)?;
            }
            while self.untaken.len() >= MAX_UNTAKEN && !stop.load(Ordering::Relaxed) {
                if let Some(message) = session.receive(LOOK)? {
                    self.note(message)?;
                }
            }
            for step in self.collect(stop)? {
                session.send(&step)?;
                self.untaken.push_back(step);
            }
            if let Some(line) = self.tally.line(&self.crew) {
                report(&line);
            }
        }
        Ok(())
    }

    /// Makes NPCs as the learner wants them, or checks that those at hand are so.
    fn prepare(&mut self, welcome: &wire::Welcome, weights: &wire::Weights) -> Result<(), ActorError> {
        let mut config: TrainConfig = serde_json::from_str(&welcome.config)
            .map_err(|error| ActorError::Contract(format!("a configuration that is none: {error}")))?;
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
        match &mut self.crew {
            Some(crew) if crew.config == config => crew.version = version,
            crew => {
                config.validate()?;
                let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
                rng.set_stream(20);
                let ties = Ties { connect: self.config.connect.clone(), listener: None };
                let source = Source::new(&config, rng, version.0.clone(), ties)?;
                if source.lane_count() != welcome.npc_count as usize {
                    let (found, wanted) = (source.lane_count(), welcome.npc_count);
                    return Err(ActorError::Contract(format!("a configuration of {found} NPCs, and wants {wanted}")));
                }
                self.is_cut = crew.is_some();
                *crew = Some(Crew { config, source, version });
            }
        }
        Ok(())
    }

    fn note(&mut self, message: ToActor) -> Result<(), ActorError> {
        match message {
            ToActor::Welcome(_) => return Err(ActorError::Contract("a second welcome".to_owned())),
            ToActor::Taken(taken) => self.untaken.retain(|step| step.number > taken.number),
            ToActor::Weights(weights) => {
                let crew = self.crew.as_mut().expect("it was welcomed");
                self.tally.received += weights.weights.len();
                crew.version = messages::policy(&weights, &crew.config.name, crew.config.sac.network)?;
            }
        }
        Ok(())
    }

    /// Collects a decision of all NPCs.
    fn collect(&mut self, stop: &AtomicBool) -> Result<Vec<wire::FeedStep>, ActorError> {
        let crew = self.crew.as_mut().expect("it was welcomed");
        let collected = crew.source.collect(crew.version.clone(), 1, stop)?;
        let mut stats = crew.source.take_stats();
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

/// What was done since it was last told.
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

    /// A line, if it is time for one.
    fn line(&mut self, crew: &Option<Crew>) -> Option<String> {
        let (elapsed, crew) = (self.since.elapsed(), crew.as_ref()?);
        if elapsed < TELL_EVERY {
            return None;
        }
        let rate = |count: usize| count as f64 / elapsed.as_secs_f64();
        let line = format!(
            "{:.0} decisions/s | sent {:.0} kB/s, received {:.0} kB/s of weights | weights of {} updates",
            rate(self.decisions),
            rate(self.sent) * 1e-3,
            rate(self.received) * 1e-3,
            crew.version.1,
        );
        *self = Self::new();
        Some(line)
    }
}
