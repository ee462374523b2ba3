//! The load on the database and the object store of a fleet: a server with a crowd, and a PostgreSQL on this machine
//! that is idle otherwise.

use super::record_load::RecordLoad;
use crate::bench::serve::{Scene, WORLDS};
use crate::processes::{Setup, cpu_s};
use anyhow::{Context, ensure};
use std::time::{Duration, Instant};
use surefoot_cli::commands::services::CacheArgs;
use surefoot_fleet::blobs::Blobs;
use surefoot_fleet::database::Database;
use surefoot_fleet::worlds;
use surefoot_proto::convert::map_spec_to_wire;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_world::MapSpec;

/// Number of NPCs, as in the largest recorded crowd.
const NPCS: usize = 1024;
const WARM_UP: Duration = Duration::from_secs(10);
const SPAN: Duration = Duration::from_secs(30);
/// Interval at which a server saves its worlds, and lease of a process, s: the defaults.
const SAVE_EVERY_S: f64 = 2.0;
const LEASE_S: f64 = 5.0;

/// Measures with this database and object store, and removes its worlds from them.
pub async fn measure(store: &str, blobs: &str) -> anyhow::Result<RecordLoad> {
    let (database, opened) = (Database::open(store).await?, Blobs::open(blobs)?);
    let cache = CacheArgs::default_folder()?.join("bench-serve");
    let of_server = &["--store", store, "--blobs", blobs];
    let scene = Scene::start(Setup { of_server, ..Setup::new(NPCS, &cache) }).await?;
    scene.measure(WARM_UP).await?;
    let (cpu, server, commits) = (postgres_cpu_s()?, scene.cpu_s()?[0], database.commits().await?);
    let started = Instant::now();
    let measured = scene.measure(SPAN).await?;
    let seconds = started.elapsed().as_secs_f64();
    let (cpu, server) = (postgres_cpu_s()? - cpu, scene.cpu_s()?[0] - server);
    // PostgreSQL reports its counts up to a second late, at both ends.
    let commits = (database.commits().await? - commits) as f64;
    ensure!(cpu > 0.0 && commits > 0.0, "PostgreSQL made no commits on this machine, where its CPU time is measured");
    let by_clock = f64::from(WORLDS as u32) / SAVE_EVERY_S + 3.0 / LEASE_S;
    let load = RecordLoad {
        save_every_s: SAVE_EVERY_S,
        renew_every_s: LEASE_S / 3.0,
        notes_per_s: (commits / seconds - by_clock).max(0.0),
        cpu_us_per_write: 1e6 * cpu / commits,
        save_bytes: save_bytes(&scene, &database, &opened).await?,
    };
    eprintln!(
        "over PostgreSQL, {NPCS} NPCs: {:.1} commits/s, of which {:.1} record what happened; {:.0} us of CPU each; \
         server {:.1} % of a core, tick p99 {:.2} ms; a saved world {:.0} bytes + {:.0} for each NPC",
        commits / seconds,
        load.notes_per_s,
        load.cpu_us_per_write,
        100.0 * server / seconds,
        measured.p99_ms(),
        load.save_bytes[0],
        load.save_bytes[1],
    );
    Ok(load)
}

/// Bytes of a saved world without NPCs, and of each NPC. Removes all worlds.
async fn save_bytes(scene: &Scene, database: &Database, blobs: &Blobs) -> anyhow::Result<[f64; 2]> {
    let mut client = WorldServiceClient::new(scene.services.server.clone());
    let map = Some(map_spec_to_wire(&MapSpec::new(1)));
    let empty = client.create_world(wire::CreateWorldRequest { map, ..Default::default() }).await?.into_inner();
    let empty = empty.world.context("a world")?.world_id;
    let (mut none, mut all) = (0.0, Vec::new());
    for (id, blob) in worlds::saved(database).await? {
        // A world that was saved again in the meantime is skipped.
        let Some(bytes) = blobs.get(blob).await? else { continue };
        if id.0 == empty {
            none = bytes.len() as f64;
        } else {
            all.push(bytes.len() as f64);
        }
    }
    let worlds = client.list_worlds(wire::ListWorldsRequest::default()).await?.into_inner().worlds;
    for world_id in worlds.into_iter().map(|world| world.world_id) {
        client.drop_world(wire::DropWorldRequest { world_id }).await?;
    }
    ensure!(none > 0.0 && !all.is_empty(), "no saved world could be read");
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    Ok([none, (mean - none).max(0.0) * f64::from(WORLDS as u32) / NPCS as f64])
}

/// CPU time so far of all processes of PostgreSQL on this machine, s.
fn postgres_cpu_s() -> anyhow::Result<f64> {
    let mut sum = 0.0;
    for entry in std::fs::read_dir("/proc").context("no processes are listed here")?.flatten() {
        let name = std::fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
        if name.trim() == "postgres" {
            // The process may have ended.
            sum += cpu_s(&entry.file_name().to_string_lossy()).unwrap_or_default();
        }
    }
    Ok(sum)
}
