//! Growth of calls to a world server: a batch of spawns, moves of players, and readers of events, on a
//! server process of its own.

use super::Case;
use crate::processes::{Process, connect, free_address, start};
use anyhow::Context;
use std::rc::Rc;
use std::time::{Duration, Instant};
use surefoot_proto::convert::map_spec_to_wire;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_world::MapSpec;
use tokio::runtime::Runtime;
use tonic::transport::Channel;

/// A map that belongs to no split.
const SEED: u64 = 6000;
/// Time over which the readers of events are measured.
const SPAN: Duration = Duration::from_secs(2);
/// Number of calls that move all players; their mean is reported.
const MOVES: u32 = 50;
/// Streams of one connection: the server allows 128.
const STREAMS_EACH: usize = 100;

/// A server, and the runtime of its clients.
struct Served {
    runtime: Runtime,
    process: Process,
    uri: String,
    channel: Channel,
}

type Client = WorldServiceClient<Channel>;

impl Served {
    fn start() -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        let address = free_address()?.to_string();
        let process = start(&["serve", "--listen", &address, "--max-npcs-per-client", "100000"])?;
        let uri = format!("http://{address}");
        let channel = runtime.block_on(connect(&uri))?;
        Ok(Self { runtime, process, uri, channel })
    }

    /// Runs `work` on a new world, then drops the world.
    fn on_a_world<F: Future<Output = anyhow::Result<f64>>>(
        &self,
        work: impl FnOnce(Client, u64) -> F,
    ) -> anyhow::Result<f64> {
        self.runtime.block_on(async {
            let mut client = WorldServiceClient::new(self.channel.clone());
            let map = Some(map_spec_to_wire(&MapSpec::new(SEED)));
            let created = client.create_world(wire::CreateWorldRequest { map, ..Default::default() }).await?;
            let world_id = created.into_inner().world.context("a created world")?.world_id;
            let measured = work(client.clone(), world_id).await;
            client.drop_world(wire::DropWorldRequest { world_id }).await?;
            measured
        })
    }
}

/// Spawns NPCs in one call. Returns their ids and the duration of the call, s.
async fn spawn(client: &mut Client, world_id: u64, count: usize) -> anyhow::Result<(Vec<u64>, f64)> {
    let request = wire::SampleGroundRequest { world_id, count: count as u32, ..Default::default() };
    let places = client.sample_ground(request).await?.into_inner().points;
    let spawns = places.into_iter().map(|place| wire::Spawn { position: Some(place), ..Default::default() }).collect();
    let request = wire::BatchSpawnNpcsRequest { world_id, spawns, ..Default::default() };
    let since = Instant::now();
    let results = client.batch_spawn_npcs(request).await?.into_inner().results;
    let seconds = since.elapsed().as_secs_f64();
    let id = |result: wire::SpawnResult| match result.result {
        Some(wire::spawn_result::Result::NpcId(id)) => Ok(id),
        other => anyhow::bail!("a spawn failed: {other:?}"),
    };
    Ok((results.into_iter().map(id).collect::<anyhow::Result<_>>()?, seconds))
}

async fn move_players(mut client: Client, world_id: u64, count: usize) -> anyhow::Result<f64> {
    let request = wire::SampleGroundRequest { world_id, count: 1, ..Default::default() };
    let position = client.sample_ground(request).await?.into_inner().points.pop();
    let mut moves = Vec::new();
    for _ in 0..count {
        let request = wire::SpawnPlayerRequest { world_id, position, ..Default::default() };
        let player_id = client.spawn_player(request).await?.into_inner().player_id;
        moves.push(wire::PlayerMove { player_id, position, velocity: None });
    }
    let since = Instant::now();
    for _ in 0..MOVES {
        client.move_players(wire::MovePlayersRequest { world_id, moves: moves.clone(), ..Default::default() }).await?;
    }
    Ok(since.elapsed().as_secs_f64() / f64::from(MOVES))
}

/// Additional CPU time of the server, s, when each of `count` NPCs has a reader.
async fn read_events(served: &Served, mut client: Client, world_id: u64, count: usize) -> anyhow::Result<f64> {
    let (npcs, _) = spawn(&mut client, world_id, count).await?;
    let busy = async || {
        let before = served.process.cpu_s()?;
        tokio::time::sleep(SPAN).await;
        anyhow::Ok(served.process.cpu_s()? - before)
    };
    let alone = busy().await?;
    let mut readers = Vec::new();
    for npcs in npcs.chunks(STREAMS_EACH) {
        let mut client = WorldServiceClient::new(connect(&served.uri).await?);
        for &npc_id in npcs {
            let request = wire::WatchEventsRequest { world_id, npc_ids: vec![npc_id], ..Default::default() };
            readers.push(client.watch_events(request).await?.into_inner());
        }
    }
    let watched = busy().await?;
    drop(readers);
    Ok((watched - alone).max(0.01))
}

pub(super) fn cases() -> anyhow::Result<Vec<Case>> {
    let served = Rc::new(Served::start()?);
    let of = |served: &Rc<Served>| Rc::clone(served);
    let (spawning, moving, reading) = (of(&served), of(&served), served);
    Ok(vec![
        Case::new("spawn_batch", "NPCs of one call", 1024, move |count| {
            spawning.on_a_world(async |mut client, world_id| Ok(spawn(&mut client, world_id, count).await?.1))
        }),
        Case::new("move_players", "players of one call", 256, move |count| {
            moving.on_a_world(|client, world_id| move_players(client, world_id, count))
        }),
        Case::new("event_readers", "readers of one NPC each; CPU time of two seconds", 100, move |count| {
            reading.on_a_world(|client, world_id| read_events(&reading, client, world_id, count))
        }),
    ])
}
