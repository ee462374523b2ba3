//! Sends NPCs of a world server to the goals of a set. Workers decide for them: ours, or others that implement the
//! protocol of `Work`. The server reports how each attempt ended.

use super::set::{GoalSet, SetMap};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use surefoot_net::client::Link;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::convert;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, npc_event, spawn_result};
use surefoot_rollout::AttemptResult;
use surefoot_world::{DECISION_SECONDS, End, Vec3};
use tokio_stream::StreamExt;
use tonic::{Code, Request, Status, Streaming};

/// Longest wait for a world, whose map may have to be generated.
const WORLD_LIMIT: Duration = Duration::from_secs(600);
/// Most NPCs in one batch call.
const BATCH: usize = 1024;

/// How a set is hosted.
#[derive(Debug, Clone, Copy)]
pub struct Hosting {
    /// Whether worlds wait for the workers' decisions, instead of running at 60 Hz.
    pub lockstep: bool,
    /// Most attempts at the same time. As many worlds run together as this allows, at least one.
    pub at_once: usize,
    /// Goals of each map that are attempted first, unscored, so that workers can prepare the map.
    pub warm_up: usize,
    /// Time limit for the attempts on worlds that run together.
    pub limit: Duration,
}

/// What happened on one map.
#[derive(Debug, Clone)]
pub struct Hosted {
    /// The attempts, in the order of the goals. Their lengths are unknown, and 0.
    pub attempts: Vec<AttemptResult>,
    /// Duration of the unscored attempts, s: the workers' preparation and the slowest attempt.
    pub warm_up_s: f64,
    /// Figures of the world at the end.
    pub stats: Stats,
}

/// Figures of a world.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stats {
    /// Ticks that were late or dropped; none in lockstep.
    pub ticks_late: u64,
    /// All ticks.
    pub ticks: u64,
    /// Decisions that were answered in time.
    pub answered: u64,
    /// Decisions that were missed.
    pub missed: u64,
}

/// Attempts all goals of a set of generated maps on a server, and returns what happened on each map. `progress` gets
/// the name of each map when its world begins.
///
/// # Errors
/// The status of the first call that fails. INVALID_ARGUMENT if a map of the set is not generated.
pub async fn host(
    link: Link,
    set: &GoalSet,
    hosting: Hosting,
    mut progress: impl FnMut(&str),
) -> Result<Vec<Hosted>, Status> {
    let mut client = WorldServiceClient::new(link).max_decoding_message_size(MAX_MESSAGE_BYTES);
    let mut hosted = Vec::with_capacity(set.maps.len());
    let mut rest = set.maps.as_slice();
    while !rest.is_empty() {
        let (now, later) = rest.split_at(worlds_at_once(rest, hosting.at_once));
        rest = later;
        let mut worlds = Vec::with_capacity(now.len());
        for map in now {
            progress(&map.name);
            worlds.push(Hall::open(&mut client, set, map, hosting).await?);
        }
        for world in &mut worlds {
            world.begin_warm_up(&mut client, hosting.warm_up).await?;
        }
        for world in &mut worlds {
            world.end_warm_up(hosting.limit).await?;
        }
        // All worlds start before the first wait.
        for world in &mut worlds {
            let all: Vec<usize> = (0..world.map.goals.len()).collect();
            world.send(&mut client, &all).await?;
        }
        let until = Instant::now() + hosting.limit;
        for mut world in worlds {
            let attempts = world.await_ends(until).await?;
            let stats = world.stats(&mut client).await?;
            hosted.push(Hosted { attempts, warm_up_s: world.warm_up_s, stats });
            client.drop_world(wire::DropWorldRequest { world_id: world.world_id }).await?;
        }
    }
    Ok(hosted)
}

/// Number of the next maps that run together.
fn worlds_at_once(maps: &[SetMap], at_once: usize) -> usize {
    let mut npcs = 0;
    let fits = |map: &&SetMap| {
        npcs += map.goals.len();
        npcs <= at_once
    };
    maps.iter().take_while(fits).count().max(1)
}

/// A world with the NPCs of one map of the set.
struct Hall<'s> {
    map: &'s SetMap,
    world_id: u64,
    events: Streaming<wire::WatchEventsResponse>,
    /// Goals that are under way, by NPC.
    under_way: BTreeMap<u64, usize>,
    ends: BTreeMap<usize, AttemptResult>,
    /// When the unscored attempts began.
    opened: Instant,
    warm_up_s: f64,
}

impl<'s> Hall<'s> {
    async fn open(
        client: &mut WorldServiceClient<Link>,
        set: &GoalSet,
        map: &'s SetMap,
        hosting: Hosting,
    ) -> Result<Self, Status> {
        let spec = map.spec.ok_or_else(|| {
            Status::invalid_argument(format!("map {} is a level: hosted sets need generated maps", map.name))
        })?;
        let mode = if hosting.lockstep { wire::TimeMode::Lockstep } else { wire::TimeMode::Realtime };
        let mut request = Request::new(wire::CreateWorldRequest {
            map: Some(convert::map_spec_to_wire(&spec)),
            mode: mode.into(),
            body: Some(convert::body_to_wire(&set.body)),
            // All scored attempts ignore other NPCs.
            solid_npcs: Some(false),
            ..Default::default()
        });
        request.set_timeout(WORLD_LIMIT);
        let world = client.create_world(request).await?.into_inner().world;
        let world_id = world.ok_or_else(|| Status::internal("the server sent no world"))?.world_id;
        let request = wire::WatchEventsRequest { world_id, ..Default::default() };
        let mut events = client.watch_events(request).await?.into_inner();
        // The first message marks the start of the stream: no later event is missed.
        events.next().await.transpose()?;
        let (under_way, ends) = Default::default();
        Ok(Self { map, world_id, events, under_way, ends, opened: Instant::now(), warm_up_s: 0.0 })
    }

    /// Starts attempts at `count` of the goals, near and far ones.
    async fn begin_warm_up(&mut self, client: &mut WorldServiceClient<Link>, count: usize) -> Result<(), Status> {
        let count = count.min(self.map.goals.len());
        let some: Vec<usize> = (0..count).map(|idx| idx * self.map.goals.len() / count).collect();
        self.opened = Instant::now();
        self.send(client, &some).await
    }

    /// Waits until they have ended, and discards their results.
    async fn end_warm_up(&mut self, limit: Duration) -> Result<(), Status> {
        self.await_ends(self.opened + limit).await?;
        self.warm_up_s = self.opened.elapsed().as_secs_f64();
        self.ends.clear();
        Ok(())
    }

    /// Spawns an NPC for each of these goals.
    async fn send(&mut self, client: &mut WorldServiceClient<Link>, goals: &[usize]) -> Result<(), Status> {
        for some in goals.chunks(BATCH) {
            let spawn = |idx: &usize| {
                let goal = self.map.goals[*idx];
                let at = |place: [f32; 3]| Some(convert::to_wire(Vec3::from_array(place)));
                wire::Spawn { position: at(goal.start), yaw: goal.yaw, goal: at(goal.goal), ..Default::default() }
            };
            let request = wire::BatchSpawnNpcsRequest {
                world_id: self.world_id,
                spawns: some.iter().map(spawn).collect(),
                ..Default::default()
            };
            let results = client.batch_spawn_npcs(request).await?.into_inner().results;
            for (idx, result) in some.iter().zip(results) {
                match result.result {
                    Some(spawn_result::Result::NpcId(npc_id)) => _ = self.under_way.insert(npc_id, *idx),
                    Some(spawn_result::Result::Error(error)) => {
                        return Err(Status::new(error.code.into(), error.message));
                    }
                    None => return Err(Status::internal("the server sent an empty result for an NPC")),
                }
            }
        }
        Ok(())
    }

    /// Waits until all attempts have ended or the time is up. Unfinished attempts then count as without progress.
    async fn await_ends(&mut self, until: Instant) -> Result<Vec<AttemptResult>, Status> {
        while !self.under_way.is_empty() {
            let next = tokio::time::timeout_at(until.into(), self.events.next());
            let Ok(message) = next.await else { break };
            let message =
                message.ok_or_else(|| Status::new(Code::Unavailable, "the server closed the event stream"))??;
            for event in message.events {
                if let Some(npc_event::Event::AttemptEnded(ended)) = event.event {
                    self.note(event.npc_id, &ended);
                }
            }
        }
        for idx in std::mem::take(&mut self.under_way).into_values() {
            self.ends.insert(idx, attempt(End::NoProgress, 0.0));
        }
        Ok(self.ends.values().copied().collect())
    }

    fn note(&mut self, npc_id: u64, ended: &wire::AttemptEnded) {
        let end = convert::end(ended.outcome).unwrap_or(End::NoProgress);
        if let Some(idx) = self.under_way.remove(&npc_id) {
            self.ends.insert(idx, attempt(end, ended.seconds));
        }
    }

    async fn stats(&self, client: &mut WorldServiceClient<Link>) -> Result<Stats, Status> {
        let request = wire::WatchStatsRequest { world_id: self.world_id, period_s: 1.0 };
        let mut stats = client.watch_stats(request).await?.into_inner();
        let stats = stats.next().await.transpose()?.and_then(|it| it.stats).unwrap_or_default();
        Ok(Stats {
            ticks_late: stats.ticks_late + stats.ticks_dropped,
            ticks: stats.tick_histogram.iter().sum(),
            answered: stats.decisions_answered,
            missed: stats.decisions_missed,
        })
    }
}

/// An attempt with the end and the duration that the server reported.
fn attempt(end: End, seconds: f32) -> AttemptResult {
    AttemptResult::without_plans(end, (seconds / DECISION_SECONDS).ceil() as u32, 0.0)
}
