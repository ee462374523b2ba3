//! The lease of a server of a fleet: renewing it, taking over worlds of servers that are gone, writing journals of its
//! own worlds, and dropping these when the lease may have expired.

use crate::store::{SharedStore, StoreError};
use crate::worlds::Worlds;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::{info, warn};

/// Time between two writes of journals. Events, and answers to changes, are delayed by up to this time.
const WRITE_EVERY: Duration = Duration::from_millis(25);
/// Longest time between two queries for worlds without a server.
const CLAIM_EVERY: Duration = Duration::from_secs(2);

/// Does all this until it is dropped. `ready` becomes true after the first query for worlds without a server,
/// `holds_lease` follows the lease.
pub async fn run(worlds: Worlds, ready: watch::Sender<bool>, holds_lease: watch::Sender<bool>) {
    tokio::join!(renew(&worlds), claim(&worlds, ready), write_journals(&worlds), watch_expiry(&worlds, holds_lease));
}

/// The part of the store that the servers of a fleet share.
fn shared(worlds: &Worlds) -> &dyn SharedStore {
    worlds.shared_store().expect("only a server of a fleet has a lease")
}

/// Bounds a call, because a cut link never answers.
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
            // The server has left the fleet.
            Err(StoreError::Expired) if worlds.shutdown().is_triggered() => return,
            Err(StoreError::Expired) => {
                worlds.lose_all("the lease has expired");
                match with_timeout(shared.lease(), shared.rejoin()).await {
                    Ok(()) => info!("lease: joined the fleet again as a new member"),
                    Err(error) => {
                        warn!(%error, "lease: cannot join the fleet again; trying again after the next renewal")
                    }
                }
            }
            Err(error) => warn!(%error, "lease: renewal failed; worlds stop when the lease expires"),
        }
    }
}

/// Drops all worlds as soon as other servers may have taken them over.
async fn watch_expiry(worlds: &Worlds, holds_lease: watch::Sender<bool>) {
    let shared = shared(worlds);
    let mut due = interval(shared.lease() / 20);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        due.tick().await;
        let holds = shared.holds_lease();
        holds_lease.send_if_modified(|known| std::mem::replace(known, holds) != holds);
        if !holds {
            worlds.lose_all("the lease may have expired");
        }
    }
}

/// Takes over worlds, and restores worlds that the store assigns to this server and that do not run, such as after a
/// claim whose answer was late, or after a panic.
async fn claim(worlds: &Worlds, ready: watch::Sender<bool>) {
    let shared = shared(worlds);
    let pause = (shared.lease() / 3).min(CLAIM_EVERY);
    while !worlds.shutdown().is_triggered() {
        if shared.holds_lease() {
            let (started, lease_epoch, held) = (Instant::now(), shared.lease_epoch(), worlds.held());
            match with_timeout(pause, shared.claim(worlds.config().max_worlds, &held)).await {
                Ok(claimed) => {
                    if !claimed.is_empty() {
                        info!(count = claimed.len(), ms = started.elapsed().as_millis(), "lease: taking over worlds");
                    }
                    claimed.into_iter().for_each(|id| worlds.begin_takeover(id, lease_epoch));
                    ready.send_replace(true);
                }
                Err(error) => warn!(%error, "lease: cannot query for worlds whose server is gone"),
            }
        }
        // A change wakes this early.
        let _ = tokio::time::timeout(pause, shared.changed()).await;
    }
}

async fn write_journals(worlds: &Worlds) {
    let shared = shared(worlds);
    let mut due = interval(WRITE_EVERY);
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
            // The worlds that run now belong to the next lease epoch.
            Ok(_) if shared.lease_epoch() != lease_epoch => {}
            Ok(written) => {
                is_failing = false;
                journals.iter().for_each(|(id, journal)| match written.get(id) {
                    Some(true) => worlds.confirm(*id, journal.through),
                    Some(false) => worlds.lose(*id, "another server has it"),
                    None => {}
                });
            }
            Err(error) => {
                if !std::mem::replace(&mut is_failing, true) {
                    warn!(%error, "lease: cannot write world events to the database; changes and event streams wait");
                }
            }
        }
    }
}
