//! The learner's side: `LearnerService`.

use super::slots::{Seat, Slots, Verdict};
use super::{npc_count, wire as messages};
use crate::config::TrainConfig;
use crate::inflow::{Arrival, Inlet};
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

/// Where actors connect, and on which threads they are served.
pub struct Listener {
    /// The bound address.
    pub endpoint: Endpoint,
    /// The threads.
    pub runtime: Runtime,
    /// Shortest time between two versions of weights that an actor is sent.
    pub weights_every: Duration,
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listener").field("endpoint", &self.endpoint).finish_non_exhaustive()
    }
}

/// Serves actors until the learner is gone.
pub(super) fn start(config: &TrainConfig, listener: Listener, slots: Slots, inlet: Inlet) {
    let Listener { endpoint, runtime, weights_every } = listener;
    let shutdown = Shutdown::default();
    let max_message_bytes = endpoint.limits().max_message_bytes;
    let api = LearnerApi {
        terms: Arc::new(Terms::new(config)),
        slots,
        inlet: inlet.clone(),
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
            let mut policies = inlet.policies;
            let stopping = shutdown.clone();
            tokio::spawn(async move {
                while policies.changed().await.is_ok() {}
                stopping.trigger();
            });
            if let Err(error) = endpoint.serve(routes, &[SERVICE], || async { String::new() }, shutdown).await {
                tracing::error!("actors cannot be served: {error}");
            }
        });
    });
}

/// What all actors are told, and what is expected of them.
#[derive(Debug)]
struct Terms {
    config: String,
    npc_count: usize,
    network: ActorConfig,
}

impl Terms {
    fn new(config: &TrainConfig) -> Self {
        let network = config.sac.network;
        let mut told = config.clone();
        // Random decisions are those of the whole run, and where the learner runs concerns nobody.
        told.collector.random_decisions /= config.actors.max(1) as u64;
        told.start_from = None;
        Self {
            config: serde_json::to_string(&told).expect("a config is plain data"),
            npc_count: npc_count(config),
            network,
        }
    }
}

#[derive(Clone)]
struct LearnerApi {
    terms: Arc<Terms>,
    slots: Slots,
    inlet: Inlet,
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
        let seat = self.slots.join(&hello.actor_id).ok_or_else(|| {
            let message = "all places for actors are taken: start the learner with more --actors";
            status::quota(Reason::TooManyActors, "learner", message)
        })?;
        let (queue, responses) = mpsc::channel(QUEUE);
        let session = Session { api: self.clone(), seat, queue };
        tokio::spawn(session.run(requests));
        Ok(Response::new(Box::pin(ReceiverStream::new(responses))))
    }
}

/// The connection of one actor.
struct Session {
    api: LearnerApi,
    seat: Seat,
    queue: mpsc::Sender<Result<wire::FeedResponse, Status>>,
}

impl Session {
    async fn run(self, requests: Streaming<wire::FeedRequest>) {
        let _live = self.api.inlet.meters.live();
        if let Err(status) = self.serve(requests).await {
            // Whoever is gone cannot be told.
            let _ = self.queue.send(Err(status)).await;
        }
    }

    async fn serve(&self, mut requests: Streaming<wire::FeedRequest>) -> Result<(), Status> {
        let LearnerApi { terms, inlet, weights_every, shutdown, .. } = &self.api;
        if self.seat.is_handed_on {
            self.hand_over(Arrival::Closed { is_lost: true }).await?;
        }
        let welcome =
            wire::Welcome { config: terms.config.clone(), taken: self.seat.taken, npc_count: terms.npc_count as u32 };
        self.say(ToActor::Welcome(welcome)).await?;
        let mut policies = inlet.policies.clone();
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
                        self.say(ToActor::Weights(weights)).await?;
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
        match self.seat.take(message.number) {
            Verdict::Superseded => {
                return Err(status::failure(Reason::ActorReplaced, "this actor has connected again"));
            }
            Verdict::Repeated => _ = self.api.inlet.meters.repeated.fetch_add(1, std::sync::atomic::Ordering::Relaxed),
            verdict => {
                if verdict == Verdict::AfterGap || message.is_new {
                    self.hand_over(Arrival::Closed { is_lost: verdict == Verdict::AfterGap }).await?;
                }
                self.hand_over(Arrival::Step(step, stats)).await?;
            }
        }
        self.say(ToActor::Taken(wire::Taken { number: message.number })).await
    }

    /// Hands something to the learner once it has taken what came before.
    async fn hand_over(&self, arrival: Arrival) -> Result<(), Status> {
        let (inlet, slot_idx) = (self.api.inlet.clone(), self.seat.slot_idx);
        let sent = tokio::task::spawn_blocking(move || inlet.send(slot_idx, arrival).is_continue()).await;
        if sent.unwrap_or(false) { Ok(()) } else { Err(shutting_down()) }
    }

    async fn say(&self, message: ToActor) -> Result<(), Status> {
        let response = wire::FeedResponse { message: Some(message) };
        self.queue.send(Ok(response)).await.map_err(|_| Status::cancelled("the actor is gone"))
    }
}
