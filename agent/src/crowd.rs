//! A stand-in for a game client: keeps a crowd of NPCs on one world busy with random goals, over gRPC.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use surefoot_net::client::Link;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, NpcStatus};
use tokio::sync::watch;
use tokio_stream::StreamExt;
use tonic::Status;

/// Places that goals are drawn from.
const GROUND_POINTS: u32 = 2000;
/// Snapshots a second that the crowd is steered by.
const RATE_HZ: f32 = 4.0;
/// Seconds between two figures of the world.
const STATS_PERIOD_S: f32 = 0.25;
/// NPCs that one call is about.
const BATCH: usize = 1024;

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
        let spawns: Vec<wire::Spawn> = (0..npc_count).map(|_| crowd.spawn()).collect();
        for spawns in spawns.chunks(BATCH) {
            let request = wire::BatchSpawnNpcsRequest {
                world_id: crowd.world.world_id,
                spawns: spawns.to_vec(),
                ..Default::default()
            };
            for result in crowd.client.batch_spawn_npcs(request).await?.into_inner().results {
                if let Some(wire::spawn_result::Result::Error(error)) = result.result {
                    return Err(Status::new(error.code.into(), error.message));
                }
            }
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

    fn spawn(&mut self) -> wire::Spawn {
        wire::Spawn { position: Some(self.point()), yaw: self.yaw(), goal: Some(self.point()) }
    }

    /// Gives every idle NPC a new goal and revives those that are down, until a stream ends; figures of the world go to
    /// `latest`.
    ///
    /// # Errors
    /// What ended the stream, or what the server answered to a call.
    pub async fn keep_busy(mut self, latest: watch::Sender<wire::WatchStatsResponse>) -> Result<(), Status> {
        let world_id = self.world.world_id;
        let request = wire::WatchWorldRequest { world_id, rate_hz: RATE_HZ, ..Default::default() };
        let mut snapshots = self.client.watch_world(request).await?.into_inner();
        let request = wire::WatchStatsRequest { world_id, period_s: STATS_PERIOD_S };
        let mut stats = self.client.watch_stats(request).await?.into_inner();
        loop {
            tokio::select! {
                snapshot = snapshots.next() => match snapshot {
                    Some(snapshot) => self.attend(&snapshot?.npcs).await?,
                    None => return Ok(()),
                },
                stats = stats.next() => match stats {
                    Some(stats) => drop(latest.send_replace(stats?)),
                    None => return Ok(()),
                },
            }
        }
    }

    /// Revives those that are down and sends those that are idle somewhere. One that cannot be sent fell, or was revived, since
    /// the snapshot was taken: the next one shows it.
    async fn attend(&mut self, npcs: &[wire::Npc]) -> Result<(), Status> {
        let (mut teleports, mut goals) = (Vec::new(), Vec::new());
        for npc in npcs {
            let npc_id = npc.npc_id;
            match npc.status() {
                NpcStatus::Seeking | NpcStatus::Unspecified => continue,
                NpcStatus::Idle => {}
                NpcStatus::Down => {
                    teleports.push(wire::TeleportNpcRequest { npc_id, position: Some(self.point()), yaw: self.yaw() });
                }
            }
            goals.push(wire::SetGoalRequest { npc_id, goal: Some(self.point()) });
        }
        for teleports in teleports.chunks(BATCH) {
            let request = wire::BatchTeleportNpcsRequest { teleports: teleports.to_vec() };
            self.client.batch_teleport_npcs(request).await?;
        }
        for goals in goals.chunks(BATCH) {
            let request = wire::BatchSetGoalsRequest { goals: goals.to_vec() };
            self.client.batch_set_goals(request).await?;
        }
        Ok(())
    }
}
