//! One connection to the server: sends hello, then dispatches messages to the tasks of the worlds.

use super::capacity::CapacityShare;
use super::config::WorkConfig;
use super::graph::{Graph, GraphKey, Graphs};
use super::inference::Inference;
use super::maps::{Arrival, Maps};
use super::world::{MotionSettings, RehearsalMap, WorldError, WorldMessage, WorldParts, WorldTask, ZoneNews};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;
use surefoot_net::client::{Dialer, Link};
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_planner::Zones;
use surefoot_policy::Policy;
use surefoot_proto::convert::{self, FieldError};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::work_response::Message;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::zones;
use surefoot_world::sense::OBSERVATION_VERSION;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;
use tracing::{info, warn};

/// Most answers that wait to be sent; when the queue is full, worlds wait.
const OUT_QUEUE: usize = 256;
/// Most messages that wait for a world's task. When the queue is full, observations are dropped and the server counts
/// missed decisions.
const WORLD_QUEUE: usize = 256;

/// One connection to a server.
pub(super) struct Session<'a> {
    /// URI of the server.
    pub address: &'a str,
    pub config: &'a WorkConfig,
    pub policy: &'a Policy,
    /// The planner's graphs; none without a planner.
    pub graphs: Option<&'a Graphs>,
    /// Maps to rehearse on; none without rehearsals.
    pub maps: Option<&'a Arc<Maps>>,
    /// The worker's capacity, of which the server gets a share.
    pub capacity_share: &'a CapacityShare,
}

/// How a connection ended.
#[derive(Debug)]
pub(super) enum SessionEnd {
    /// The server refused this worker before it accepted a hello.
    Refused(Status),
    /// The connection was lost, or is of no use any more; another one may be.
    Lost(Status),
    /// The planner proves edges with another policy.
    OtherPolicy(Status),
}

/// Tasks of worlds, one for each body of their NPCs. They end with the session.
struct Worlds {
    /// The NPCs of each world.
    npcs: BTreeMap<u64, BTreeSet<u64>>,
    /// By the id of the world and the index of the body.
    queues: BTreeMap<(u64, u32), mpsc::Sender<WorldMessage>>,
    /// What each task decides on.
    keys: BTreeMap<(u64, u32), GraphKey>,
    inference: Inference,
    tasks: JoinSet<Result<(), WorldError>>,
}

/// An open connection to a server.
struct Connection {
    link: Link,
    responses: tonic::Streaming<wire::WorkResponse>,
    out: mpsc::Sender<wire::WorkRequest>,
    /// Whether the server has accepted the worker.
    is_welcome: bool,
    /// The capacity that the server knows.
    offered: u32,
}

impl Session<'_> {
    /// Decides for NPCs until the connection is lost.
    pub async fn run(&self, server: &Dialer) -> SessionEnd {
        let mut connection = match self.connect(server).await {
            Ok(connection) => connection,
            Err(status) => return SessionEnd::Refused(status),
        };
        let inference = match Inference::start(self.policy.clone()) {
            Ok(inference) => inference,
            Err(error) => return SessionEnd::Refused(Status::resource_exhausted(format!("no thread: {error}"))),
        };
        let mut worlds = Worlds::new(inference);
        let other_policy = async {
            match self.graphs {
                Some(graphs) => graphs.other_policy().await,
                None => std::future::pending().await,
            }
        };
        tokio::pin!(other_policy);
        let mut changes = self.capacity_share.changes();
        loop {
            let response = tokio::select! {
                response = connection.responses.next() => response,
                Ok(()) = changes.changed(), if connection.is_welcome => {
                    connection.offer(self.capacity_share.offer(self.address));
                    continue;
                }
                status = &mut other_policy => return SessionEnd::OtherPolicy(status),
                Some(ended) = worlds.tasks.join_next() => match ended {
                    // The server ended the world.
                    Ok(Ok(())) => continue,
                    // The server reassigns the NPCs once this connection has ended.
                    Ok(Err(error)) => return SessionEnd::Lost(Status::internal(error.to_string())),
                    Err(error) => return SessionEnd::Lost(Status::internal(format!("a world's task failed: {error}"))),
                },
            };
            let message = match response {
                Some(Ok(response)) => response.message,
                Some(Err(status)) if !connection.is_welcome => return SessionEnd::Refused(status),
                Some(Err(status)) => return SessionEnd::Lost(status),
                None => return SessionEnd::Lost(Status::unavailable("the server ended the stream")),
            };
            if worlds.record_assignments(message.as_ref()) {
                self.capacity_share.note(self.address, worlds.npc_count());
            }
            if let Some(Err(status)) = message.map(|message| self.handle(message, &mut worlds, &mut connection)) {
                return SessionEnd::Lost(status);
            }
        }
    }

    /// Handles a message of the server.
    fn handle(&self, message: Message, worlds: &mut Worlds, connection: &mut Connection) -> Result<(), Status> {
        match message {
            Message::Welcome(welcome) => {
                connection.is_welcome = true;
                info!(worker = welcome.worker_id, server = self.address, "deciding for NPCs");
            }
            Message::Assignment(assignment) => {
                let known = worlds.keys.get(&(assignment.world_id, assignment.body_idx));
                if !known.is_some_and(|key| key.is_for(&assignment)) {
                    // If another body had this index, no NPC has that body any more: its task ends with the queue.
                    self.start_world(worlds, connection, &assignment)?;
                }
                if let Some(zones) = &assignment.zones {
                    let task = (assignment.world_id, assignment.body_idx);
                    worlds.pass(task, WorldMessage::Zones(zone_news(zones)?))?;
                }
            }
            Message::Release(release) => {
                worlds.pass_to_all(release.world_id, || WorldMessage::Release(release.npc_ids.clone()))?;
            }
            Message::Ended(ended) => worlds.pass_to_all(ended.world_id, || WorldMessage::Ended(ended.clone()))?,
            Message::Observations(batch) => {
                worlds.pass(
                    (batch.world_id, batch.body_idx),
                    WorldMessage::Observations(Box::new(batch), Instant::now()),
                )?;
            }
            Message::Edited(edited) => self.edit_world(worlds, &connection.link, &edited)?,
            Message::ZonesChanged(wire::ZonesChanged { world_id, changed }) => {
                let news = zone_news(&changed.unwrap_or_default())?;
                worlds.pass_to_all(world_id, || WorldMessage::Zones(news.clone()))?;
            }
            Message::Over(over) => worlds.end(over.world_id),
        }
        Ok(())
    }

    async fn connect(&self, server: &Dialer) -> Result<Connection, Status> {
        // Other servers get their share as soon as they are connected.
        let capacity = self.capacity_share.offer_next().max(1);
        let link = server.connect().await.map_err(|error| Status::unavailable(error.to_string()))?;
        let mut client = WorldServiceClient::new(link.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let (out, requests) = mpsc::channel(OUT_QUEUE);
        let hello = wire::Hello {
            name: self.config.name.clone(),
            capacity,
            observation_len: self.policy.observation_len() as u32,
            observation_version: OBSERVATION_VERSION,
            policy: self.policy.label(),
        };
        let hello = wire::WorkRequest { message: Some(wire::work_request::Message::Hello(hello)) };
        out.send(hello).await.map_err(|_| Status::internal("the request stream closed"))?;
        let responses = client.work(ReceiverStream::new(requests)).await?.into_inner();
        Ok(Connection { link, responses, out, is_welcome: false, offered: capacity })
    }

    fn start_world(
        &self,
        worlds: &mut Worlds,
        connection: &Connection,
        assignment: &wire::Assignment,
    ) -> Result<(), Status> {
        let server = &connection.link;
        let body = convert::body(assignment.body.as_ref())?;
        let (sender, messages) = mpsc::channel(WORLD_QUEUE);
        let key = GraphKey::of(assignment);
        let map = self.map_of(&key, server).zip(self.maps).map(|(map, maps)| RehearsalMap {
            maps: maps.clone(),
            map,
            requested: Instant::now(),
            body,
        });
        let parts = WorldParts {
            policy: self.policy.clone(),
            inference: worlds.inference.clone(),
            motion: MotionSettings { noise_share: self.config.noise_share, composes: self.config.composes },
            graph: self.graph_of(&key, server),
            map,
            out: connection.out.clone(),
        };
        worlds.tasks.spawn(WorldTask::new(assignment, parts).run(messages));
        worlds.queues.insert((assignment.world_id, assignment.body_idx), sender);
        worlds.keys.insert((assignment.world_id, assignment.body_idx), key);
        Ok(())
    }

    /// The map of a world to rehearse on; without a planner there is nothing to rehearse.
    fn map_of(&self, key: &GraphKey, server: &Link) -> Option<watch::Receiver<Arrival>> {
        self.maps.filter(|_| self.graphs.is_some()).map(|maps| maps.of(key, server.clone()))
    }

    fn graph_of(&self, key: &GraphKey, server: &Link) -> Option<Arc<Graph>> {
        self.graphs.map(|graphs| graphs.of(key.clone(), server.clone()))
    }

    /// Passes the new pieces on the map of a world to its tasks, with the map and its graphs.
    fn edit_world(&self, worlds: &mut Worlds, server: &Link, edited: &wire::MapEdited) -> Result<(), Status> {
        let tasks = (edited.world_id, 0)..=(edited.world_id, u32::MAX);
        let mut messages = Vec::new();
        for (&task, key) in worlds.keys.range_mut(tasks) {
            *key = key.with_pieces(edited.pieces.clone());
            let (map, graph) = (self.map_of(key, server), self.graph_of(key, server));
            messages.push((task, WorldMessage::Edited { map, graph }));
        }
        messages.into_iter().try_for_each(|(task, message)| worlds.pass(task, message))
    }
}

/// Converts zones and tags.
fn zone_news(news: &wire::WorldZones) -> Result<ZoneNews, Status> {
    let list = |list: &wire::ZoneList| zones::list(&list.zones, "zones").map(Zones::new);
    let tags = |npc: &wire::NpcTags| Ok((npc.npc_id, zones::tags(&npc.tags, "tags")?));
    Ok(ZoneNews {
        zones: news.zones.as_ref().map(list).transpose()?,
        tags: news.tags.iter().map(tags).collect::<Result<_, FieldError>>()?,
    })
}

impl Connection {
    /// Offers a capacity to the server, if it knows another one.
    fn offer(&mut self, capacity: u32) {
        if capacity != self.offered {
            let message = wire::work_request::Message::Capacity(capacity);
            // If too many answers wait, the next change sends it.
            if self.out.try_send(wire::WorkRequest { message: Some(message) }).is_ok() {
                self.offered = capacity;
            }
        }
    }
}

impl Worlds {
    fn new(inference: Inference) -> Self {
        let (npcs, queues, keys) = Default::default();
        Self { npcs, queues, keys, inference, tasks: JoinSet::new() }
    }

    /// Ends the tasks of a world, together with their queues.
    fn end(&mut self, world_id: u64) {
        self.queues.retain(|(of_world, _), _| *of_world != world_id);
        self.keys.retain(|(of_world, _), _| *of_world != world_id);
    }

    /// Records which NPCs are assigned, and returns whether their number may have changed.
    fn record_assignments(&mut self, message: Option<&Message>) -> bool {
        match message {
            Some(Message::Assignment(assignment)) => {
                self.npcs.entry(assignment.world_id).or_default().extend(&assignment.npc_ids);
            }
            Some(Message::Release(release)) => {
                if let Some(npcs) = self.npcs.get_mut(&release.world_id) {
                    release.npc_ids.iter().for_each(|npc| _ = npcs.remove(npc));
                }
            }
            Some(Message::Over(over)) => _ = self.npcs.remove(&over.world_id),
            Some(Message::Welcome(_)) => {}
            _ => return false,
        }
        true
    }

    fn npc_count(&self) -> u32 {
        self.npcs.values().map(BTreeSet::len).sum::<usize>() as u32
    }

    /// Passes a message to all tasks of a world, each of which picks its own NPCs.
    fn pass_to_all(&self, world_id: u64, message: impl Fn() -> WorldMessage) -> Result<(), Status> {
        self.queues.range((world_id, 0)..=(world_id, u32::MAX)).try_for_each(|(&task, _)| self.pass(task, message()))
    }

    /// Passes a message to a world's task. Observations that find a full queue are dropped. No other message may be
    /// lost, so a full queue ends the session and the server reassigns its NPCs.
    fn pass(&self, task: (u64, u32), message: WorldMessage) -> Result<(), Status> {
        // The server may have sent a message before the world ended.
        let Some(queue) = self.queues.get(&task) else { return Ok(()) };
        let (world_id, _) = task;
        match queue.try_send(message) {
            Ok(()) => Ok(()),
            Err(TrySendError::Full(WorldMessage::Observations(..))) => {
                warn!(world_id, "this worker is too slow: a batch of observations is dropped");
                Ok(())
            }
            Err(TrySendError::Full(_)) => {
                Err(Status::resource_exhausted("this worker is too slow: a world's queue is full"))
            }
            Err(TrySendError::Closed(_)) => Err(Status::internal("a world's task has ended")),
        }
    }
}
