//! `surefoot top`: figures of a running server in the terminal.

use super::endpoint::CredentialArgs;
use super::up::{attempts, percent};
use crate::terminal::is_interactive;
use anyhow::Context;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::{Duration, Instant};
use surefoot_net::client::Link;
use surefoot_net::serving::MAX_MESSAGE_BYTES;
use surefoot_proto::world::v1::world_service_client::WorldServiceClient;
use surefoot_proto::world::v1::{self as wire, NpcStatus, Standing, WorldStats};
use surefoot_server::times::TickTimes;
use tonic::Status;

/// Most NPCs in the list of those that stand longest.
const LISTED: usize = 10;

/// Watch the figures of a running world server, and why NPCs stand.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot top\n  \
        surefoot top http://server:7600 --every 5\n  \
        surefoot top --world 4294967297\n  \
        surefoot top --count 1   # once, for scripts")]
pub struct Args {
    /// URI of the world server
    #[arg(default_value = "http://127.0.0.1:7600", value_name = "URI", env = "SUREFOOT_SERVER")]
    server: String,
    /// Interval between updates
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS")]
    every: f64,
    /// Also list the NPCs of this world that stand longest
    #[arg(long, value_name = "ID")]
    world: Option<u64>,
    /// Exit after N updates
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

/// Shows the figures of a server until Ctrl-C.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let pause = Duration::try_from_secs_f64(args.every).context("--every")?.max(Duration::from_millis(100));
    tokio::runtime::Builder::new_current_thread().enable_all().build()?.block_on(async {
        let dialer = args.credentials.credentials()?.dial(&args.server)?;
        let link = dialer.connect().await.with_context(|| format!("cannot connect to {}", args.server))?;
        let mut client = WorldServiceClient::new(link).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let mut before = sample(&mut client).await?;
        let mut stood = Stood::default();
        stood.follow(&before, args.world);
        for _ in 0..args.count.unwrap_or(u64::MAX) {
            tokio::time::sleep(pause).await;
            let now = sample(&mut client).await?;
            // Cursor to the top left and clear, so that the table stays in place.
            let clear = if is_interactive() { "\x1b[H\x1b[2J" } else { "" };
            stood.follow(&now, args.world);
            println!("{clear}{}{}", table(&args.server, &before, &now, pause), stood.list());
            before = now;
        }
        Ok(())
    })
}

/// One world's state and figures at one moment.
struct Sample {
    world: wire::World,
    npcs: Vec<wire::Npc>,
    stats: WorldStats,
}

async fn sample(client: &mut WorldServiceClient<Link>) -> anyhow::Result<Vec<Sample>> {
    let request = wire::ListWorldsRequest { page_size: 1000, ..Default::default() };
    let worlds = client.list_worlds(request).await.context("the connection to the server is lost")?;
    let mut samples = Vec::new();
    for world in worlds.into_inner().worlds {
        // A world may be dropped between two calls.
        if let Ok(sample) = sample_world(client, world).await {
            samples.push(sample);
        }
    }
    Ok(samples)
}

async fn sample_world(client: &mut WorldServiceClient<Link>, world: wire::World) -> Result<Sample, Status> {
    let world_id = world.world_id;
    let first = client.watch_stats(wire::WatchStatsRequest { world_id, ..Default::default() }).await?;
    let stats = first.into_inner().message().await?.and_then(|message| message.stats).unwrap_or_default();
    let request = wire::WatchWorldRequest { world_id, ..Default::default() };
    let first = client.watch_world(request).await?.into_inner().message().await?;
    Ok(Sample { world, npcs: first.unwrap_or_default().npcs, stats })
}

fn table(server: &str, before: &[Sample], now: &[Sample], span: Duration) -> String {
    let mut text = format!(
        "{server}   {} worlds, {} NPCs\n\n{:>6} {:>10} {:>6} {:>6} {:>6} {:>6} {:>7} {:>9} {:>9} {:>7} {:>8} {:>9} \
         {:>8} {:>8}\n",
        now.len(),
        now.iter().map(|sample| sample.npcs.len()).sum::<usize>(),
        "world",
        "seed",
        "idle",
        "seek",
        "down",
        "alone",
        "ticks/s",
        "p50 ms",
        "p99 ms",
        "late",
        "dropped",
        "decide/s",
        "missed",
        "success"
    );
    for sample in now {
        let old = before.iter().find(|old| old.world.world_id == sample.world.world_id);
        row(&mut text, sample, old, span);
        text += &reasons(&sample.npcs);
    }
    text
}

/// A line with the reasons for which NPCs stand, and their numbers; empty if none stands.
fn reasons(npcs: &[wire::Npc]) -> String {
    let mut counts: BTreeMap<i32, usize> = BTreeMap::new();
    for npc in npcs.iter().filter(|npc| npc.standing() != Standing::Unspecified) {
        *counts.entry(npc.standing).or_default() += 1;
    }
    let reason = |(&reason, count): (&i32, &usize)| format!("{count} {}", reason_name(reason));
    let reasons: Vec<String> = counts.iter().map(reason).collect();
    if reasons.is_empty() { String::new() } else { format!("{:>6} stand: {}\n", "", reasons.join(", ")) }
}

/// A reason for people, such as `no worker`.
fn reason_name(reason: i32) -> String {
    let name = Standing::try_from(reason).map_or("UNKNOWN", |reason| reason.as_str_name());
    name.trim_start_matches("STANDING_").to_lowercase().replace('_', " ")
}

/// The NPCs of the chosen world that stand, and since when.
#[derive(Default)]
struct Stood {
    since: BTreeMap<u64, (Instant, i32)>,
}

impl Stood {
    /// Follows the NPCs of the world `chosen`.
    fn follow(&mut self, samples: &[Sample], chosen: Option<u64>) {
        let chosen = samples.iter().filter(|sample| Some(sample.world.world_id) == chosen);
        let standing = chosen.flat_map(|sample| &sample.npcs).filter(|npc| npc.standing() != Standing::Unspecified);
        let since = |npc: &wire::Npc| self.since.get(&npc.npc_id).map_or_else(Instant::now, |(since, _)| *since);
        self.since = standing.map(|npc| (npc.npc_id, (since(npc), npc.standing))).collect();
    }

    /// Those that stand longest, with the time for which this program has seen them stand.
    fn list(&self) -> String {
        let mut longest: Vec<_> = self.since.iter().collect();
        longest.sort_by_key(|(_, (since, _))| *since);
        let line = |(npc, (since, reason)): &(&u64, &(Instant, i32))| {
            format!("NPC {npc} has stood for {:.0} s: {}\n", since.elapsed().as_secs_f64(), reason_name(*reason))
        };
        let lines: String = longest.iter().take(LISTED).map(line).collect();
        if lines.is_empty() { lines } else { format!("\n{lines}") }
    }
}

fn row(text: &mut String, sample: &Sample, old: Option<&Sample>, span: Duration) {
    let stats = &sample.stats;
    let past = old.map(|old| old.stats.clone()).unwrap_or_default();
    let since = |value: fn(&WorldStats) -> u64| value(stats).saturating_sub(value(&past));
    let rate = |count: u64| count as f64 / span.as_secs_f64();
    let times = |stats: &WorldStats| TickTimes::from_counts(&stats.tick_histogram);
    let recent = times(stats).since(&times(&past));
    let count = |status: NpcStatus| sample.npcs.iter().filter(|npc| npc.status() == status).count();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{:>6} {:>10} {:>6} {:>6} {:>6} {:>6} {:>7.1} {:>9.2} {:>9.2} {:>7} {:>8} {:>9.0} {:>7.2}% {:>7.1}%",
        sample.world.world_id,
        sample.world.map.as_ref().map_or(0, |map| map.seed),
        count(NpcStatus::Idle),
        count(NpcStatus::Seeking),
        count(NpcStatus::Down),
        stats.npcs_without_worker,
        rate(recent.count()),
        recent.quantile_us(0.5) / 1000.0,
        recent.quantile_us(0.99) / 1000.0,
        since(|stats| stats.ticks_late),
        since(|stats| stats.ticks_dropped),
        rate(since(|stats| stats.decisions_answered)),
        percent(since(|stats| stats.decisions_missed), since(|stats| stats.decisions_requested)),
        percent(stats.reached, attempts(stats)),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn npcs_that_stand_are_counted_by_reason() {
        let npc = |reason: Standing| wire::Npc { standing: reason.into(), ..wire::Npc::default() };
        let npcs = [Standing::Barred, Standing::NoWorker, Standing::Unspecified, Standing::NoWorker].map(npc);
        assert_eq!(reasons(&npcs), "       stand: 2 no worker, 1 barred\n");
        assert_eq!(reasons(&npcs[2..3]), "");
    }
}
