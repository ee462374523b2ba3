//! One connection to the server: sends hello, then dispatches messages to the tasks of the worlds.

use super::ahead::Maps;
use super::config::WorkConfig;
use super::graph::{Graph, GraphKey, Graphs};
use super::inference::Inference;
use super::room::Room;
use super::world::{Manner, Stage, WorldError, WorldMessage, WorldTask};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;
use surefoot_net::client::{Dialer, Link};
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_policy::Policy;
use surefoot_proto::convert;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::work_response::Message;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_world::sense::OBSERVATION_VERSION;
use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;
use tokio::task::JoinSet;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;
use tracing::{info, warn};

/// Most answers waiting to be sent; when full, worlds wait.
const OUT_QUEUE: usize = 256;
/// Most messages waiting for a world's task. When full, observations are dropped, and the server counts missed decisions.
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
    pub room: &'a Room,
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

impl Session<'_> {
    /// Decides for NPCs until the connection is lost.
    pub async fn run(&self, server: &Dialer) -> SessionEnd {
        // Other servers get their share of it as soon as they are connected.
        let room = self.room.offer_next().max(1);
        let (channel, mut responses, out) = match self.connect(server, room).await {
            Ok(connected) => connected,
            Err(status) => return SessionEnd::Refused(status),
        };
        let mut is_welcome = false;
        let inference = match Inference::start(self.policy.clone()) {
            Ok(inference) => inference,
            Err(error) => return SessionEnd::Refused(Status::resource_exhausted(format!("no thread: {error}"))),
        };
        let mut worlds = Worlds {
            npcs: BTreeMap::new(),
            queues: BTreeMap::new(),
            keys: BTreeMap::new(),
            tasks: JoinSet::new(),
            inference,
        };
        let other_policy = async {
            match self.graphs {
                Some(graphs) => graphs.other_policy().await,
                None => std::future::pending().await,
            }
        };
        tokio::pin!(other_policy);
        let (mut changes, mut offered) = (self.room.changes(), room);
        loop {
            let response = tokio::select! {
                response = responses.next() => response,
                Ok(()) = changes.changed(), if is_welcome => {
                    let offer = self.room.offer(self.address);
                    if offer != offered {
                        let message = wire::work_request::Message::Capacity(offer);
                        // When too many answers wait, the next change says it.
                        let is_sent = out.try_send(wire::WorkRequest { message: Some(message) }).is_ok();
                        offered = if is_sent { offer } else { offered };
                    }
                    continue;
                }
                status = &mut other_policy => return SessionEnd::OtherPolicy(status),
                Some(ended) = worlds.tasks.join_next() => match ended {
                    // The server ended the world.
                    Ok(Ok(())) => continue,
                    // The server assigns the NPCs anew once this connection is gone.
                    Ok(Err(error)) => return SessionEnd::Lost(Status::internal(error.to_string())),
                    Err(error) => return SessionEnd::Lost(Status::internal(format!("a world's task failed: {error}"))),
                },
            };
            let message = match response {
                Some(Ok(response)) => response.message,
                Some(Err(status)) if !is_welcome => return SessionEnd::Refused(status),
                Some(Err(status)) => return SessionEnd::Lost(status),
                None => return SessionEnd::Lost(Status::unavailable("the server ended the stream")),
            };
            if worlds.note(message.as_ref()) {
                self.room.note(self.address, worlds.npc_count());
            }
            let passed = match message {
                Some(Message::Welcome(welcome)) => {
                    is_welcome = true;
                    info!(worker = welcome.worker_id, server = self.address, "deciding for NPCs");
                    Ok(())
                }
                Some(Message::Assignment(assignment)) => {
                    let known = worlds.keys.get(&(assignment.world_id, assignment.body_idx));
                    if known.is_some_and(|key| key.is_for(&assignment)) {
                        Ok(())
                    } else {
                        // Where another body had this index, no NPC has it any more: the task ends with its queue.
                        self.start_world(&mut worlds, channel.clone(), &assignment, out.clone())
                    }
                }
                Some(Message::Release(release)) => {
                    worlds.pass_to_all(release.world_id, || WorldMessage::Release(release.npc_ids.clone()))
                }
                Some(Message::Ended(ended)) => {
                    worlds.pass_to_all(ended.world_id, || WorldMessage::Ended(ended.clone()))
                }
                Some(Message::Observations(batch)) => {
                    worlds.pass((batch.world_id, batch.body_idx), WorldMessage::Observations(batch))
                }
                Some(Message::Edited(edited)) => self.edit_world(&mut worlds, &channel, &edited),
                Some(Message::Over(over)) => {
                    // Its tasks end with the queues.
                    worlds.queues.retain(|(world_id, _), _| *world_id != over.world_id);
                    worlds.keys.retain(|(world_id, _), _| *world_id != over.world_id);
                    Ok(())
                }
                None => Ok(()),
            };
            if let Err(status) = passed {
                return SessionEnd::Lost(status);
            }
        }
    }

    async fn connect(
        &self,
        server: &Dialer,
        capacity: u32,
    ) -> Result<(Link, tonic::Streaming<wire::WorkResponse>, mpsc::Sender<wire::WorkRequest>), Status> {
        let channel = server.connect().await.map_err(|error| Status::unavailable(error.to_string()))?;
        let mut client = WorldServiceClient::new(channel.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES);
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
        Ok((channel, responses, out))
    }

    fn start_world(
        &self,
        worlds: &mut Worlds,
        server: Link,
        assignment: &wire::Assignment,
        out: mpsc::Sender<wire::WorkRequest>,
    ) -> Result<(), Status> {
        let body = convert::body(assignment.body.as_ref())?;
        let (sender, messages) = mpsc::channel(WORLD_QUEUE);
        let key = GraphKey::of(assignment);
        let maps = self.maps.filter(|_| self.graphs.is_some());
        let stage = maps.map(|maps| Stage {
            maps: maps.clone(),
            map: maps.of(&key, server.clone()),
            awaited_since: Instant::now(),
            body,
        });
        let graph: Option<Arc<Graph>> = self.graphs.map(|graphs| graphs.of(key.clone(), server));
        let manner = Manner { noise_share: self.config.noise_share, composes: self.config.composes };
        let inference = worlds.inference.clone();
        let world = WorldTask::new(assignment, (self.policy.clone(), inference), manner, graph, stage, out);
        worlds.tasks.spawn(world.run(messages));
        worlds.queues.insert((assignment.world_id, assignment.body_idx), sender);
        worlds.keys.insert((assignment.world_id, assignment.body_idx), key);
        Ok(())
    }

    /// Tells the tasks of a world that its map has other pieces, and asks for the graphs of that map.
    fn edit_world(&self, worlds: &mut Worlds, server: &Link, edited: &wire::MapEdited) -> Result<(), Status> {
        let tasks = (edited.world_id, 0)..=(edited.world_id, u32::MAX);
        let mut messages = Vec::new();
        for (&task, key) in worlds.keys.range_mut(tasks) {
            *key = key.with_pieces(edited.pieces.clone());
            let map = self.maps.filter(|_| self.graphs.is_some()).map(|maps| maps.of(key, server.clone()));
            let graph = self.graphs.map(|graphs| graphs.of(key.clone(), server.clone()));
            messages.push((task, WorldMessage::Edited { map, graph }));
        }
        messages.into_iter().try_for_each(|(task, message)| worlds.pass(task, message))
    }
}

impl Worlds {
    /// Takes in which NPCs are assigned; whether there may be another number of them.
    fn note(&mut self, message: Option<&Message>) -> bool {
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

    /// Passes a message to all tasks of a world: each picks the NPCs that are its own.
    fn pass_to_all(&self, world_id: u64, message: impl Fn() -> WorldMessage) -> Result<(), Status> {
        self.queues.range((world_id, 0)..=(world_id, u32::MAX)).try_for_each(|(&task, _)| self.pass(task, message()))
    }

    /// Passes a message to a world's task. Observations that find a full queue are dropped; any other message must not be lost, so
    /// the session ends and the server assigns its NPCs anew.
    fn pass(&self, task: (u64, u32), message: WorldMessage) -> Result<(), Status> {
        // The server may have had a message under way when the world ended.
        let Some(queue) = self.queues.get(&task) else { return Ok(()) };
        let (world_id, _) = task;
        match queue.try_send(message) {
            Ok(()) => Ok(()),
            Err(TrySendError::Full(WorldMessage::Observations(_))) => {
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
