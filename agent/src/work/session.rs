//! One connection to the server: sends hello, then dispatches messages to the tasks of the worlds.

use super::config::WorkConfig;
use super::graph::Graph;
use super::world::{WorldMessage, WorldTask};
use std::collections::BTreeMap;
use surefoot_net::client::{Dialer, Link};
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_policy::Policy;
use surefoot_proto::plans::settings_to_wire;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_world::OBSERVATION_LEN;
use surefoot_world::sense::OBSERVATION_VERSION;
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;
use tracing::{info, warn};

/// Most answers waiting to be sent; when full, worlds wait.
const OUT_QUEUE: usize = 256;
/// Most messages waiting for a world's task; further ones are dropped. The server's own queue fills up first.
const WORLD_QUEUE: usize = 256;

/// One connection to the server.
pub(super) struct Session<'a> {
    pub config: &'a WorkConfig,
    pub policy: &'a Policy,
    pub planner: Option<Link>,
}

impl Session<'_> {
    /// Decides for NPCs until the connection is lost.
    pub async fn run(&self, server: &Dialer) -> Result<(), Status> {
        let channel = server.connect().await.map_err(|error| Status::unavailable(error.to_string()))?;
        let mut client = WorldServiceClient::new(channel.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let (out, requests) = mpsc::channel(OUT_QUEUE);
        let hello = wire::Hello {
            name: self.config.name.clone(),
            capacity: self.config.capacity,
            observation_len: OBSERVATION_LEN as u32,
            observation_version: OBSERVATION_VERSION,
            policy: self.policy.label(),
        };
        let hello = wire::WorkRequest { message: Some(wire::work_request::Message::Hello(hello)) };
        out.send(hello).await.map_err(|_| Status::internal("the request stream closed"))?;
        let mut responses = client.work(ReceiverStream::new(requests)).await?.into_inner();
        let mut worlds: BTreeMap<u64, mpsc::Sender<WorldMessage>> = BTreeMap::new();
        while let Some(response) = responses.next().await {
            match response?.message {
                Some(wire::work_response::Message::Welcome(welcome)) => {
                    info!(worker = welcome.worker_id, server = self.config.server, "deciding for NPCs");
                }
                Some(wire::work_response::Message::Assignment(assignment)) => {
                    worlds
                        .entry(assignment.world_id)
                        .or_insert_with(|| self.start_world(channel.clone(), &assignment, out.clone()));
                }
                Some(wire::work_response::Message::Release(release)) => {
                    if let Some(world) = worlds.get(&release.world_id) {
                        forward(world, WorldMessage::Release(release.npc_ids));
                    }
                }
                Some(wire::work_response::Message::Ended(ended)) => {
                    if let Some(world) = worlds.get(&ended.world_id) {
                        forward(world, WorldMessage::Ended(ended));
                    }
                }
                Some(wire::work_response::Message::Observations(batch)) => {
                    if let Some(world) = worlds.get(&batch.world_id) {
                        forward(world, WorldMessage::Observations(batch));
                    }
                }
                None => {}
            }
        }
        Ok(())
    }

    fn start_world(
        &self,
        server: Link,
        assignment: &wire::Assignment,
        out: mpsc::Sender<wire::WorkRequest>,
    ) -> mpsc::Sender<WorldMessage> {
        let (sender, messages) = mpsc::channel(WORLD_QUEUE);
        let graph = self
            .planner
            .clone()
            .map(|planner| Graph::start(server, planner, assignment, settings_to_wire(&self.config.graph)));
        let world = WorldTask::new(assignment, self.policy.clone(), self.config.noise_share, graph, out);
        tokio::spawn(world.run(messages));
        sender
    }
}

/// Passes a message to a world's task. A full queue means that this worker is far too slow: the message is dropped, and the
/// server counts missed decisions.
fn forward(world: &mpsc::Sender<WorldMessage>, message: WorldMessage) {
    if world.try_send(message).is_err() {
        warn!("a world's queue is full: dropping a message");
    }
}
