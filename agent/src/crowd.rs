//! A stand-in for a game client: keeps a crowd of NPCs on one world busy with random goals, over gRPC.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use surefoot_net::client::Link;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, NpcStatus};
use tokio::sync::watch;
use tokio_stream::StreamExt;
use tonic::{Code, Status};

/// Places that goals are drawn from.
const GROUND_POINTS: u32 = 2000;
/// Snapshots a second that the crowd is steered by.
const RATE_HZ: f32 = 4.0;

/// A crowd on one world.
#[derive(Debug)]
pub struct Crowd {
    client: WorldServiceClient<Link>,
    world: wire::World,
    points: Vec<wire::Vec3>,
    rng: ChaCha8Rng,
}

impl Crowd {
    /// Creates a world on `map` and puts `npc_count` NPCs on it.
    ///
    /// # Errors
    /// Whatever the server answers.
    pub async fn start(link: impl Into<Link>, map: wire::MapSpec, npc_count: usize, seed: u64) -> Result<Self, Status> {
        let mut client = WorldServiceClient::new(link.into()).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let request =
            wire::CreateWorldRequest { map: Some(map), mode: wire::TimeMode::Realtime.into(), ..Default::default() };
        let created = client.create_world(request).await?.into_inner();
        let world = created.world.ok_or_else(|| Status::internal("the server described no world"))?;
        let request = wire::SampleGroundRequest { world_id: world.world_id, count: GROUND_POINTS, seed };
        let points = client.sample_ground(request).await?.into_inner().points;
        let mut crowd = Self { client, world, points, rng: ChaCha8Rng::seed_from_u64(seed) };
        for _ in 0..npc_count {
            let request = wire::SpawnNpcRequest {
                world_id: crowd.world.world_id,
                position: Some(crowd.point()),
                yaw: crowd.yaw(),
            };
            let npc_id = crowd.client.spawn_npc(request).await?.into_inner().npc_id;
            crowd.send_somewhere(npc_id).await?;
        }
        Ok(crowd)
    }

    /// The world it lives on.
    pub fn world(&self) -> &wire::World {
        &self.world
    }

    fn point(&mut self) -> wire::Vec3 {
        self.points[self.rng.random_range(0..self.points.len())]
    }

    fn yaw(&mut self) -> f32 {
        self.rng.random_range(-std::f32::consts::PI..std::f32::consts::PI)
    }

    async fn send_somewhere(&mut self, npc_id: u64) -> Result<(), Status> {
        let request = wire::SetGoalRequest { npc_id, goal: Some(self.point()) };
        self.client.set_goal(request).await.map(drop)
    }

    /// Gives every idle NPC a new goal and revives those that are down, until the stream ends; snapshots go to
    /// `latest`.
    ///
    /// # Errors
    /// What ended the stream, or what the server answered to a call.
    pub async fn keep_busy(mut self, latest: watch::Sender<wire::WatchWorldResponse>) -> Result<(), Status> {
        let request = wire::WatchWorldRequest { world_id: self.world.world_id, rate_hz: RATE_HZ, ..Default::default() };
        let mut snapshots = self.client.watch_world(request).await?.into_inner();
        while let Some(snapshot) = snapshots.next().await {
            let snapshot = snapshot?;
            for npc in &snapshot.npcs {
                match self.attend(npc).await {
                    // It fell, or was revived, since the snapshot was taken.
                    Err(status) if status.code() == Code::FailedPrecondition => {}
                    result => result?,
                }
            }
            latest.send_replace(snapshot);
        }
        Ok(())
    }

    async fn attend(&mut self, npc: &wire::Npc) -> Result<(), Status> {
        match npc.status() {
            NpcStatus::Idle => self.send_somewhere(npc.npc_id).await,
            NpcStatus::Down => {
                let request =
                    wire::TeleportNpcRequest { npc_id: npc.npc_id, position: Some(self.point()), yaw: self.yaw() };
                self.client.teleport_npc(request).await?;
                self.send_somewhere(npc.npc_id).await
            }
            NpcStatus::Seeking | NpcStatus::Unspecified => Ok(()),
        }
    }
}
