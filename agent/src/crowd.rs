//! A simulated game client: keeps a crowd of NPCs on one world busy with random goals, over gRPC.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::HashSet;
use std::time::Duration;
use surefoot_net::client::Link;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, NpcStatus};
use tokio::sync::watch;
use tokio_stream::StreamExt;
use tonic::{Request, Status};

/// Number of points that positions and goals are drawn from.
const GROUND_POINTS: u32 = 2000;
/// Snapshots per second that the crowd reads.
const RATE_HZ: f32 = 4.0;
/// Seconds between two messages of the world's figures.
const STATS_PERIOD_S: f32 = 0.25;
/// Longest wait for a world: server, workers and planner may generate a large map on the same cores at once.
const WORLD_LIMIT: Duration = Duration::from_secs(600);
/// Most NPCs in one batch call.
const BATCH: usize = 1024;

/// A crowd of NPCs on one world.
#[derive(Debug)]
pub struct Crowd {
    client: WorldServiceClient<Link>,
    world: wire::World,
    /// The NPCs of the crowd. Those of other clients of its world are left alone.
    npcs: HashSet<u64>,
    points: Vec<wire::Vec3>,
    rng: ChaCha8Rng,
}

impl Crowd {
    /// Creates a world and spawns `npc_count` NPCs with goals.
    pub async fn start(
        link: impl Into<Link>,
        world: wire::CreateWorldRequest,
        npc_count: usize,
        seed: u64,
    ) -> Result<Self, Status> {
        let mut client = WorldServiceClient::new(link.into()).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let mut request = Request::new(world);
        request.set_timeout(WORLD_LIMIT);
        let created = client.create_world(request).await?.into_inner();
        let world = created.world.ok_or_else(|| Status::internal("the server returned no world"))?;
        let request = wire::SampleGroundRequest {
            world_id: world.world_id,
            count: GROUND_POINTS,
            seed,
            body: None,
            ..Default::default()
        };
        let points = client.sample_ground(request).await?.into_inner().points;
        let rng = ChaCha8Rng::seed_from_u64(seed);
        let mut crowd = Self { client, world, npcs: HashSet::new(), points, rng };
        let spawns: Vec<wire::Spawn> = (0..npc_count).map(|_| crowd.spawn()).collect();
        for spawns in spawns.chunks(BATCH) {
            let request = wire::BatchSpawnNpcsRequest {
                world_id: crowd.world.world_id,
                spawns: spawns.to_vec(),
                ..Default::default()
            };
            for result in crowd.client.batch_spawn_npcs(request).await?.into_inner().results {
                match result.result {
                    Some(wire::spawn_result::Result::NpcId(id)) => _ = crowd.npcs.insert(id),
                    Some(wire::spawn_result::Result::Error(error)) => {
                        return Err(Status::new(error.code.into(), error.message));
                    }
                    None => {}
                }
            }
        }
        Ok(crowd)
    }

    /// The crowd's world.
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
        wire::Spawn { position: Some(self.point()), yaw: self.yaw(), goal: Some(self.point()), ..Default::default() }
    }

    /// Gives its idle NPCs new goals and revives those that are down, until a stream ends. Sends figures of the world
    /// to `latest`.
    pub async fn keep_busy(mut self, latest: watch::Sender<wire::WatchStatsResponse>) -> Result<(), Status> {
        let world_id = self.world.world_id;
        let request = wire::WatchWorldRequest { world_id, rate_hz: RATE_HZ, ..Default::default() };
        let mut snapshots = self.client.watch_world(request).await?.into_inner();
        let request = wire::WatchStatsRequest { world_id, period_s: STATS_PERIOD_S };
        let mut stats = self.client.watch_stats(request).await?.into_inner();
        loop {
            tokio::select! {
                snapshot = snapshots.next() => match snapshot {
                    Some(snapshot) => self.assign_goals(&snapshot?.npcs).await?,
                    None => return Ok(()),
                },
                stats = stats.next() => match stats {
                    Some(stats) => drop(latest.send_replace(stats?)),
                    None => return Ok(()),
                },
            }
        }
    }

    /// Revives NPCs of the crowd that are down and gives its idle NPCs a goal. Ignores failures of single NPCs, which
    /// have changed since the snapshot; the next snapshot shows their state.
    async fn assign_goals(&mut self, npcs: &[wire::Npc]) -> Result<(), Status> {
        let (mut teleports, mut goals) = (Vec::new(), Vec::new());
        for npc in npcs {
            let npc_id = npc.npc_id;
            if !self.npcs.contains(&npc_id) {
                continue;
            }
            match npc.status() {
                NpcStatus::Seeking | NpcStatus::Unspecified => continue,
                NpcStatus::Idle => {}
                NpcStatus::Down => {
                    teleports.push(wire::TeleportNpcRequest {
                        npc_id,
                        position: Some(self.point()),
                        yaw: self.yaw(),
                        ..Default::default()
                    });
                }
            }
            goals.push(wire::SetGoalRequest { npc_id, goal: Some(self.point()), ..Default::default() });
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
