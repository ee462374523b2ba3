//! The streams of one world side by side: bytes of snapshots, deltas and segments, and how far the places that segments
//! draw are from those in the snapshots.

use super::Figure;
use anyhow::Context;
use prost::Message;
use std::collections::BTreeMap;
use std::time::Duration;
use surefoot_proto::segments::{DrawnPose, DrawnWorld};
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::segment_start::Who;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use tokio::time::Instant;
use tonic::transport::Channel;

/// Duration of the measurement.
const SPAN: Duration = Duration::from_secs(20);
/// Most ticks of a segment.
const MAX_TICKS: u32 = 30;
/// Target for the worst error of a drawn place, cm.
const TARGET_ERROR_CM: f64 = 5.0;

/// Watches a world of NPCs by all streams at once.
pub async fn figures(mut client: WorldServiceClient<Channel>, world_id: u64) -> anyhow::Result<Vec<Figure>> {
    let watch = wire::WatchWorldRequest { world_id, rate_hz: 10.0, ..Default::default() };
    let mut whole = client.watch_world(watch).await?.into_inner();
    let mut deltas = client.watch_world(wire::WatchWorldRequest { delta: true, ..watch }).await?.into_inner();
    let mut truth = client.watch_world(wire::WatchWorldRequest { rate_hz: 60.0, ..watch }).await?.into_inner();
    let request = wire::WatchSegmentsRequest { world_id, max_ticks: MAX_TICKS, ..Default::default() };
    let mut segments = client.watch_segments(request).await?.into_inner();

    // The first messages have all NPCs.
    let ended = "the world ended";
    let npcs = whole.message().await?.context(ended)?.npcs.len();
    deltas.message().await?.context(ended)?;
    let mut drawn = DrawnWorld::default();
    drawn.take(&segments.message().await?.context(ended)?);
    let (mut bytes, mut rows, mut restarts) = ([0; 3], 0, 0);
    let (mut pending, mut worst_m, mut compared) = (BTreeMap::new(), 0.0_f64, 0);
    let (began, end) = (Instant::now(), tokio::time::sleep(SPAN));
    tokio::pin!(end);
    loop {
        tokio::select! {
            message = whole.message() => bytes[0] += message?.context(ended)?.encoded_len(),
            message = deltas.message() => bytes[1] += message?.context(ended)?.encoded_len(),
            message = segments.message() => {
                let message = message?.context(ended)?;
                bytes[2] += message.encoded_len();
                rows += message.bodies.len();
                restarts += usize::from(message.restarts);
                drawn.take(&message);
            }
            message = truth.message() => {
                let snapshot = message?.context(ended)?;
                pending.insert(snapshot.tick, snapshot);
            }
            () = &mut end => break,
        }
        let known = drawn.tick().saturating_sub(u64::from(MAX_TICKS) + 1);
        while let Some(snapshot) = pending.first_entry().filter(|it| *it.key() <= known).map(|it| it.remove()) {
            if snapshot.tick >= drawn.since() {
                worst_m = worst_m.max(error_m(&drawn, &snapshot));
                compared += snapshot.npcs.len();
                drawn.forget_before(snapshot.tick);
            }
        }
    }
    let npc_seconds = npcs as f64 * began.elapsed().as_secs_f64();
    let [whole, deltas, segments] = bytes.map(|bytes| bytes as f64 / npc_seconds);
    eprintln!(
        "{npcs} NPCs: {whole:.0} bytes per NPC and second in snapshots, {deltas:.0} in deltas, {segments:.1} in {:.2} \
         segments; worst error {:.2} cm at {compared} places; {restarts} restarts",
        rows as f64 / npc_seconds,
        100.0 * worst_m
    );
    Ok(vec![
        Figure::new("snapshot_bytes_npc_s", whole, "bytes"),
        Figure::new("delta_bytes_npc_s", deltas, "bytes"),
        Figure::new("segment_bytes_npc_s", segments, "bytes").with_reference("deltas", deltas, false),
        Figure::new("segment_error_cm", 100.0 * worst_m, "cm").at_most(TARGET_ERROR_CM),
    ])
}

/// The greatest distance of a drawn NPC from its place in a snapshot, m.
fn error_m(drawn: &DrawnWorld, snapshot: &wire::WatchWorldResponse) -> f64 {
    let places = snapshot.npcs.iter().filter_map(|npc| Some((npc.npc_id, npc.position?)));
    let places: BTreeMap<u64, wire::Vec3> = places.collect();
    let error = |pose: DrawnPose| {
        let Who::NpcId(npc) = pose.who else { return None };
        let wire::Vec3 { x, y, z } = *places.get(&npc)?;
        let apart = [x, y, z].into_iter().zip(pose.position).map(|(place, drawn)| (f64::from(place) - drawn).powi(2));
        Some(apart.sum::<f64>().sqrt())
    };
    drawn.at(snapshot.tick).filter_map(error).fold(0.0, f64::max)
}
