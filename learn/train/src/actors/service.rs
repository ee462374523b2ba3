//! The learner's side: `LearnerService`.

use super::slots::{ActorSession, Slots, StepOrder};
use super::{npc_count, wire as messages};
use crate::config::TrainConfig;
use crate::experience::{Delivery, ExperienceSender};
use std::fmt;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use surefoot_net::serving::{Endpoint, MAX_MESSAGE_BYTES, Shutdown, shutting_down};
use surefoot_net::status;
use surefoot_policy::ActorConfig;
use surefoot_proto::learn::v1 as wire;
use surefoot_proto::learn::v1::feed_request::Message as FromActor;
use surefoot_proto::learn::v1::feed_response::Message as ToActor;
use surefoot_proto::learn::v1::learner_service_server::{LearnerService, LearnerServiceServer};
use surefoot_proto::reason::Reason;
use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};

/// Name of the service, for health checks.
const SERVICE: &str = "surefoot.learn.v1.LearnerService";
/// Most messages that wait for one actor.
const QUEUE: usize = 4;
/// Longest id of an actor, characters.
const MAX_ID: usize = 64;

/// The endpoint for actors, and the threads that serve it.
pub struct Listener {
    /// The bound address.
    pub endpoint: Endpoint,
    /// The threads.
    pub runtime: Runtime,
    /// Shortest interval between two versions of weights for one actor.
    pub weights_every: Duration,
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listener").field("endpoint", &self.endpoint).finish_non_exhaustive()
    }
}

/// Serves actors until the run is over.
pub(super) fn start(config: &TrainConfig, listener: Listener, slots: Slots, experience: ExperienceSender) {
    let Listener { endpoint, runtime, weights_every } = listener;
    let shutdown = Shutdown::default();
    let max_message_bytes = endpoint.limits().max_message_bytes;
    let api = LearnerApi {
        terms: Arc::new(Terms::new(config)),
        slots,
        experience: experience.clone(),
        weights_every,
        shutdown: shutdown.clone(),
    };
    let service = LearnerServiceServer::new(api)
        .max_decoding_message_size(max_message_bytes)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    std::thread::spawn(move || {
        runtime.block_on(async move {
            let mut routes = tonic::service::Routes::builder();
            routes.add_service(service);
            let mut policies = experience.policies;
            let stopping = shutdown.clone();
            tokio::spawn(async move {
                while policies.changed().await.is_ok() {}
                stopping.trigger();
            });
            if let Err(error) = endpoint.serve(routes, &[SERVICE], || async { String::new() }, shutdown).await {
                tracing::error!("learner: cannot serve actors: {error}");
            }
        });
    });
}

/// The configuration for all actors, and the sizes of their steps.
#[derive(Debug)]
struct Terms {
    config: String,
    npc_count: usize,
    network: ActorConfig,
}

impl Terms {
    fn new(config: &TrainConfig) -> Self {
        let network = config.sac.network;
        let mut shared = config.clone();
        // The configured number of random decisions is for the whole run, and a path means nothing on another machine.
        shared.collector.random_decisions /= config.actors.max(1) as u64;
        shared.start_from = None;
        Self {
            config: serde_json::to_string(&shared).expect("a config is plain data"),
            npc_count: npc_count(config),
            network,
        }
    }
}

#[derive(Clone)]
struct LearnerApi {
    terms: Arc<Terms>,
    slots: Slots,
    experience: ExperienceSender,
    weights_every: Duration,
    shutdown: Shutdown,
}

type BoxStream<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl LearnerService for LearnerApi {
    type FeedStream = BoxStream<wire::FeedResponse>;

    async fn feed(&self, request: Request<Streaming<wire::FeedRequest>>) -> Result<Response<Self::FeedStream>, Status> {
        let mut requests = request.into_inner();
        let first = requests.next().await.transpose()?.and_then(|request| request.message);
        let Some(FromActor::Hello(hello)) = first else {
            return Err(status::failure(Reason::MalformedRequest, "the first message must be hello"));
        };
        if hello.actor_id.is_empty() || hello.actor_id.chars().count() > MAX_ID {
            return Err(status::invalid("hello.actor_id", format!("must have 1 to {MAX_ID} characters")));
        }
        let session = self.slots.join(&hello.actor_id).ok_or_else(|| {
            let message = "all slots for actors are taken: start the learner with a larger --actors";
            status::quota(Reason::TooManyActors, "learner", message)
        })?;
        let (queue, responses) = mpsc::channel(QUEUE);
        let connection = Connection { api: self.clone(), session, queue };
        tokio::spawn(connection.run(requests));
        Ok(Response::new(Box::pin(ReceiverStream::new(responses))))
    }
}

/// The connection of one actor.
struct Connection {
    api: LearnerApi,
    session: ActorSession,
    queue: mpsc::Sender<Result<wire::FeedResponse, Status>>,
}

impl Connection {
    async fn run(self, requests: Streaming<wire::FeedRequest>) {
        let _live = self.api.experience.meters.live();
        if let Err(status) = self.serve(requests).await {
            // The actor may have disconnected.
            let _ = self.queue.send(Err(status)).await;
        }
    }

    async fn serve(&self, mut requests: Streaming<wire::FeedRequest>) -> Result<(), Status> {
        let LearnerApi { terms, experience, weights_every, shutdown, .. } = &self.api;
        if self.session.is_reassigned {
            self.deliver(Delivery::Closed { is_lost: true }).await?;
        }
        let welcome = wire::Welcome {
            config: terms.config.clone(),
            taken: self.session.taken,
            npc_count: terms.npc_count as u32,
        };
        self.send(ToActor::Welcome(welcome)).await?;
        let mut policies = experience.policies.clone();
        policies.mark_changed();
        let mut due = tokio::time::interval(*weights_every);
        due.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = shutdown.wait();
        tokio::pin!(stopping);
        loop {
            tokio::select! {
                () = &mut stopping => return Err(shutting_down()),
                _ = due.tick() => {
                    if policies.has_changed().map_err(|_| shutting_down())? {
                        let newest = policies.borrow_and_update().clone();
                        let weights = messages::weights_to_wire(&newest);
                        self.send(ToActor::Weights(weights)).await?;
                    }
                }
                request = requests.next() => match request.transpose()?.map(|request| request.message) {
                    None => return Ok(()),
                    Some(Some(FromActor::Step(step))) => self.take(&step).await?,
                    Some(_) => return Err(status::failure(Reason::MalformedRequest, "only steps may follow hello")),
                },
            }
        }
    }

    /// Takes a step, unless it was taken before.
    async fn take(&self, message: &wire::FeedStep) -> Result<(), Status> {
        let Terms { npc_count, network, .. } = &*self.api.terms;
        let step = messages::step(message, *npc_count, network);
        let (step, stats) = step.map_err(|error| status::invalid("step", error.to_string()))?;
        match self.session.take(message.number) {
            StepOrder::Replaced => {
                return Err(status::failure(Reason::ActorReplaced, "this actor has connected again"));
            }
            StepOrder::Repeated => {
                _ = self.api.experience.meters.repeated.fetch_add(1, std::sync::atomic::Ordering::Relaxed)
            }
            order => {
                if order == StepOrder::AfterGap || message.is_new {
                    self.deliver(Delivery::Closed { is_lost: order == StepOrder::AfterGap }).await?;
                }
                self.deliver(Delivery::Step(step, stats)).await?;
            }
        }
        self.send(ToActor::Taken(wire::Taken { number: message.number })).await
    }

    /// Sends a delivery to the learner; waits while its queue is full.
    async fn deliver(&self, delivery: Delivery) -> Result<(), Status> {
        let (experience, slot_idx) = (self.api.experience.clone(), self.session.slot_idx);
        let sent = tokio::task::spawn_blocking(move || experience.send(slot_idx, delivery).is_continue()).await;
        if sent.unwrap_or(false) { Ok(()) } else { Err(shutting_down()) }
    }

    async fn send(&self, message: ToActor) -> Result<(), Status> {
        let response = wire::FeedResponse { message: Some(message) };
        self.queue.send(Ok(response)).await.map_err(|_| Status::cancelled("the actor has disconnected"))
    }
}
