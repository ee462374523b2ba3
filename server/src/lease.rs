//! A server's time in a fleet: it keeps its lease, takes over worlds of servers that are gone, records what happens in its own, and drops
//! them when its lease is not sure.

use crate::store::{SharedStore, StoreError};
use crate::worlds::Worlds;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::{info, warn};

/// Time between two records of what happened: so much longer than alone do clients wait for events, and for the answers to changes.
const RECORD_EVERY: Duration = Duration::from_millis(25);
/// Longest time between two looks for worlds without a server.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// Does all this until it is dropped. `ready` becomes true once this server has looked for worlds; `holds_lease` is whether it holds its lease.
pub async fn run(worlds: Worlds, ready: watch::Sender<bool>, holds_lease: watch::Sender<bool>) {
    tokio::join!(renew(&worlds), claim(&worlds, ready), record(&worlds), watch_expiry(&worlds, holds_lease));
}

/// The shared part of the store, which a server of a fleet has.
fn shared(worlds: &Worlds) -> &dyn SharedStore {
    worlds.shared_store().expect("only for a server of a fleet")
}

/// Bounds a call: a link that is cut answers nothing at all.
async fn with_timeout<T>(limit: Duration, call: impl Future<Output = Result<T, StoreError>>) -> Result<T, StoreError> {
    let silent = |_| StoreError::Unavailable(format!("no answer within {} s", limit.as_secs_f32()));
    tokio::time::timeout(limit, call).await.map_err(silent)?
}

async fn renew(worlds: &Worlds) {
    let shared = shared(worlds);
    let pause = shared.lease() / 3;
    loop {
        tokio::time::sleep(pause).await;
        let renewed =
            if shared.holds_lease() { with_timeout(pause, shared.renew()).await } else { Err(StoreError::Expired) };
        match renewed {
            Ok(()) => {}
            // It has left.
            Err(StoreError::Expired) if worlds.shutdown().is_triggered() => return,
            Err(StoreError::Expired) => {
                worlds.lose_all("the lease of this server is over");
                match with_timeout(shared.lease(), shared.rejoin()).await {
                    Ok(()) => info!("this server is a new member of the fleet"),
                    Err(error) => warn!(%error, "this server cannot join the fleet again"),
                }
            }
            Err(error) => warn!(%error, "the lease of this server is not renewed"),
        }
    }
}

/// Drops all worlds as soon as others may have them.
async fn watch_expiry(worlds: &Worlds, holds_lease: watch::Sender<bool>) {
    let shared = shared(worlds);
    let mut due = interval(shared.lease() / 20);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        due.tick().await;
        let holds = shared.holds_lease();
        holds_lease.send_if_modified(|known| std::mem::replace(known, holds) != holds);
        if !holds {
            worlds.lose_all("the lease of this server is not sure");
        }
    }
}

/// Takes over worlds, and restores what is this server's in the store and does not run. So each look puts right what the one before left
/// behind, such as a claim whose answer was late or a world that panicked.
async fn claim(worlds: &Worlds, ready: watch::Sender<bool>) {
    let shared = shared(worlds);
    let pause = (shared.lease() / 3).min(LOOK_EVERY);
    while !worlds.shutdown().is_triggered() {
        if shared.holds_lease() {
            let (asked, lease_epoch, held) = (Instant::now(), shared.lease_epoch(), worlds.held());
            match with_timeout(pause, shared.claim(worlds.config().max_worlds, &held)).await {
                Ok(claimed) => {
                    if !claimed.is_empty() {
                        info!(count = claimed.len(), ms = asked.elapsed().as_millis(), "worlds are taken over");
                    }
                    claimed.into_iter().for_each(|id| worlds.begin_takeover(id, lease_epoch));
                    ready.send_replace(true);
                }
                Err(error) => warn!(%error, "cannot query for worlds whose server is gone"),
            }
        }
        // A server that has left has done so before this returns.
        let _ = tokio::time::timeout(pause, shared.changed()).await;
    }
}

async fn record(worlds: &Worlds) {
    let shared = shared(worlds);
    let mut due = interval(RECORD_EVERY);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_failing = false;
    loop {
        due.tick().await;
        let lease_epoch = shared.lease_epoch();
        let journals = worlds.unconfirmed().await;
        if journals.is_empty() || shared.lease_epoch() != lease_epoch {
            continue;
        }
        match with_timeout(shared.lease(), shared.append_journals(lease_epoch, &journals)).await {
            // What there is by now are the worlds of the next lease epoch.
            Ok(_) if shared.lease_epoch() != lease_epoch => {}
            Ok(recorded) => {
                is_failing = false;
                for (id, journal) in &journals {
                    match recorded.get(id) {
                        Some(true) => worlds.confirm(*id, journal.through),
                        Some(false) => worlds.lose(*id, "another server has it"),
                        None => {}
                    }
                }
            }
            Err(error) => {
                if !std::mem::replace(&mut is_failing, true) {
                    warn!(%error, "cannot write world events to the database; changes and event streams wait");
                }
            }
        }
    }
}
